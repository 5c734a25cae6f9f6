"""One ball over a floor, authored in many ways: each must give the flux and the picture that its dialect means."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from pxr import Gf, Sdf, UsdGeom, UsdShade

from tests.usd.stages import SmallStage, set_inputs
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
from tpdwarp.scene.description import Interaction, Material, Shutter
from tpdwarp.settings import Settings
from tpdwarp.usd.read.materials.interactions import DARKEST

GLASS, MIRROR, DIFFUSE = Interaction.DIELECTRIC, Interaction.MIRROR, Interaction.DIFFUSE
STANDARD, OPEN, GLTF = (f"ND_{name}_surfaceshader" for name in ("standard_surface", "open_pbr_surface", "gltf_pbr"))
SHARP = {"specular_roughness": 0.0}
RED = (1.0, 0.0, 0.0)


class Network:
    """A material of shaders named ``S`` (the surface), ``N1``, ``N2`` …; links are (input, node, output)."""

    def __init__(self, context, surface, inputs, nodes=(), links=(), mdl=False):
        self.context, self.surface, self.inputs, self.mdl = context, surface, inputs, mdl
        self.nodes, self.links = nodes, links

    def author(self, small):
        stage = small.stage
        material = UsdShade.Material.Define(stage, "/M")
        shaders = {}
        for name, kind, inputs in (("S", self.surface, self.inputs), *self.nodes):
            shader = shaders[name] = UsdShade.Shader.Define(stage, f"/M/{name}")
            if self.mdl:
                prim = shader.GetPrim()
                prim.CreateAttribute("info:implementationSource", Sdf.ValueTypeNames.Token).Set("sourceAsset")
                prim.CreateAttribute("info:mdl:sourceAsset", Sdf.ValueTypeNames.Asset).Set(f"{kind}.mdl")
                prim.CreateAttribute("info:mdl:sourceAsset:subIdentifier", Sdf.ValueTypeNames.Token).Set(kind)
            else:
                shader.CreateIdAttr(kind)
            for key, value in inputs.items():
                author(shader, key, value)
        for name, key, node, output in self.links:
            shaders[name].CreateInput(key, Sdf.ValueTypeNames.Token).ConnectToSource(
                shaders[node].ConnectableAPI(), output
            )
        output = material.CreateSurfaceOutput(self.context) if self.context else material.CreateSurfaceOutput()
        output.ConnectToSource(shaders["S"].ConnectableAPI(), "out")


def author(shader, name, value):
    types = Sdf.ValueTypeNames
    if isinstance(value, bool):
        shader.CreateInput(name, types.Bool).Set(value)
    elif isinstance(value, int):
        shader.CreateInput(name, types.Int).Set(value)
    elif isinstance(value, str):
        shader.CreateInput(name, types.String).Set(value)
    elif isinstance(value, tuple):
        kind = {2: types.Float2, 3: types.Color3f, 4: types.Float4}[len(value)]
        shader.CreateInput(name, kind).Set(value)
    else:
        shader.CreateInput(name, types.Float).Set(value)


def preview(**inputs):
    return Network("", "UsdPreviewSurface", inputs)


def fed(surface, name, *nodes, links=(), **inputs):
    """A MaterialX surface whose input ``name`` is fed by the first node."""
    named = [(f"N{k}", kind, values) for k, (kind, values) in enumerate(nodes, 1)]
    return Network("mtlx", surface, inputs, named, (("S", name, "N1", "out"), *links))


def lama(*nodes, links=(), context="ri", surface="LamaSurface", **inputs):
    """A surface of Lama's whose front is the first node."""
    named = [(f"N{k}", kind, values) for k, (kind, values) in enumerate(nodes, 1)]
    return Network(context, surface, inputs, named, (("S", "materialFront", "N1", "bxdf_out"), *links))


def mixed(surface, share, first, second, names):
    """A terminal that mixes two surfaces."""
    nodes = (("N1", *first), ("N2", *second))
    links = tuple(("S", name, f"N{k}", "out") for k, name in enumerate(names, 1))
    return Network("arnold" if surface.startswith("arnold") else "mtlx", surface, {"mix": share}, nodes, links)


def bsdf(*nodes, links=(), **inputs):
    return fed("ND_surface", "bsdf", *nodes, links=links, **inputs)


CLEAR = {
    "preview opacity 0": preview(opacity=0.0, roughness=0.0, ior=1.5),
    "preview without roughness": preview(opacity=0.0),
    "preview transmission": preview(transmission=1.0, roughness=0.0),
    "preview opacity nearly 0": preview(opacity=0.005, roughness=0.02),
    "preview mode transparent": preview(opacity=0.0, roughness=0.0, opacityMode="transparent"),
    "preview in specular workflow": preview(opacity=0.0, roughness=0.0, useSpecularWorkflow=1),
    "MaterialX preview": Network("mtlx", "ND_UsdPreviewSurface_surfaceshader", {"opacity": 0.0, "roughness": 0.0}),
    "standard_surface": Network("mtlx", STANDARD, {"transmission": 1.0, **SHARP}),
    "standard_surface, version": Network("mtlx", f"{STANDARD}_100", {"transmission": 1.0, **SHARP}),
    "standard_surface, universal": Network("", STANDARD, {"transmission": 1.0, **SHARP}),
    "standard_surface with base 0": Network("mtlx", STANDARD, {"transmission": 1.0, "base": 0.0, **SHARP}),
    "open_pbr": Network("mtlx", OPEN, {"transmission_weight": 1.0, **SHARP}),
    "gltf_pbr": Network("mtlx", GLTF, {"transmission": 1.0, "metallic": 0.0, "roughness": 0.0}),
    "arnold standard_surface": Network("arnold", "arnold:standard_surface", {"transmission": 1.0, **SHARP}),
    "arnold openpbr": Network("arnold", "arnold:openpbr_surface", {"transmission_weight": 1.0, **SHARP}),
    "PxrSurface": Network(
        "ri", "PxrSurface", {"refractionGain": 1.0, "reflectionGain": 1.0, "glassRoughness": 0.0, "diffuseGain": 0.0}
    ),
    "PxrDisneyBsdf": Network("ri", "PxrDisneyBsdf", {"specTrans": 1.0, "roughness": 0.0, "ior": 1.5}),
    "OmniGlass": Network("mdl", "OmniGlass", {"glass_ior": 1.5}, mdl=True),
    "OmniSurface": Network(
        "mdl",
        "OmniSurface",
        {
            "enable_specular_transmission": True,
            "specular_transmission_weight": 1.0,
            "specular_reflection_roughness": 0.0,
        },
        mdl=True,
    ),
    "constant node": fed(STANDARD, "transmission", ("ND_constant_float", {"value": 1.0}), **SHARP),
    "sum of nodes": fed(STANDARD, "transmission", ("ND_add_float", {"in1": 0.25, "in2": 0.75}), **SHARP),
    "inverted node": fed(STANDARD, "transmission", ("ND_invert_float", {"in": 0.0}), **SHARP),
    "mixed nodes": fed(STANDARD, "transmission", ("ND_mix_float", {"bg": 0.0, "fg": 1.0, "mix": 1.0}), **SHARP),
    "clamped node": fed(STANDARD, "transmission", ("ND_clamp_float", {"in": 3.0}), **SHARP),
    "node by node": fed(
        OPEN,
        "transmission_weight",
        ("ND_multiply_float", {"in2": 2.0}),
        ("ND_constant_float", {"value": 0.5}),
        links=(("N1", "in1", "N2", "out"),),
        **SHARP,
    ),
    "compared nodes": fed(
        OPEN, "transmission_weight", ("ND_ifgreater_float", {"value1": 2.0, "value2": 1.0, "in1": 1.0}), **SHARP
    ),
    "extracted channel": fed(
        OPEN, "transmission_weight", ("ND_extract_color3", {"in": (0.0, 1.0, 0.0), "index": 1}), **SHARP
    ),
    "dielectric node": bsdf(("ND_dielectric_bsdf", {"scatter_mode": "RT", "roughness": (0.0, 0.0), "ior": 1.5})),
    "dielectric layered": bsdf(
        ("ND_layer_bsdf", {}),
        ("ND_dielectric_bsdf", {"scatter_mode": "R", "roughness": (0.0, 0.0)}),
        ("ND_dielectric_bsdf", {"scatter_mode": "T", "roughness": (0.0, 0.0)}),
        links=(("N1", "top", "N2", "out"), ("N1", "base", "N3", "out")),
    ),
    "Schlick node": bsdf(
        ("ND_generalized_schlick_bsdf", {"scatter_mode": "RT", "color0": (0.04,) * 3, "roughness": (0.0, 0.0)})
    ),
    "terminal of a surface material": Network(
        "mtlx",
        "ND_surfacematerial",
        {},
        (("N1", STANDARD, {"transmission": 1.0, **SHARP}),),
        (("S", "surfaceshader", "N1", "out"),),
    ),
    "mixture of glass alone": Network(
        "mtlx",
        "ND_mix_surfaceshader",
        {"mix": 1.0},
        (("N1", STANDARD, {"transmission": 1.0, **SHARP}), ("N2", STANDARD, {})),
        (("S", "fg", "N1", "out"), ("S", "bg", "N2", "out")),
    ),
    "Arnold's front": Network(
        "arnold",
        "arnold:two_sided",
        {},
        (("N1", "arnold:standard_surface", {"transmission": 1.0, **SHARP}),),
        (("S", "front", "N1", "out"),),
    ),
    "Arnold's mixture of glass alone": Network(
        "arnold",
        "arnold:mix_shader",
        {"mix": 1.0},
        (("N1", "arnold:standard_surface", {"transmission": 1.0, **SHARP}), ("N2", "arnold:lambert", {})),
        (("S", "shader2", "N1", "out"), ("S", "shader1", "N2", "out")),
    ),
    "Arnold's nodes": Network(
        "arnold",
        "arnold:standard_surface",
        SHARP,
        (
            ("N1", "arnold:range", {"input": 3.0, "input_min": 2.0, "input_max": 4.0, "output_max": 2.0}),
            ("N2", "arnold:multiply", {"input1": 1.0}),
        ),
        (("S", "transmission", "N2", "out"), ("N2", "input2", "N1", "out")),
    ),
    "Arnold's old standard": Network("arnold", "arnold:standard", {"Kt": 1.0, "IOR": 1.5}),
    "MoonRay": Network("moonray", "DwaBaseMaterial", {"transmission": 1.0, "roughness": 0.0}),
    "Redshift": Network("redshift", "redshift::StandardMaterial", {"refr_weight": 1.0, "refl_roughness": 0.0}),
    "Lama": lama(("LamaDielectric", {"roughness": 0.0})),
    "Lama by its index": lama(
        ("LamaDielectric", {"roughness": 0.0, "fresnelMode": 1, "IOR": 1.5, "reflectivity": 0.1})
    ),
    "Lama by its reflectance": lama(("LamaDielectric", {"roughness": 0.0, "IOR": 1.9, "reflectivity": 0.04})),
    "Lama without a terminal": Network("ri", "LamaDielectric", {"roughness": 0.0}),
    "Lama of MaterialX": lama(("ND_lama_dielectric", {"roughness": 0.0}), context="mtlx", surface="ND_lama_surface"),
    "Lama's Schlick": lama(("LamaGeneralizedSchlick", {"roughness": 0.0})),
    "Lama's mixture of glass alone": lama(
        ("LamaMix", {"mix": 1.0}),
        ("LamaDiffuse", {}),
        ("LamaDielectric", {"roughness": 0.0}),
        links=(("N1", "material1", "N2", "bxdf_out"), ("N1", "material2", "N3", "bxdf_out")),
    ),
    "Adobe's": Network("adobe", "AdobeStandardMaterial_4_0", {"translucency": 1.0, "roughness": 0.0}),
    "thick glass of MDL": Network("mdl", "thick_glass_v2", {"ior": 1.5, "glass_color": (1.0, 1.0, 1.0)}, mdl=True),
    "flexible material of MDL": Network(
        "mdl", "flex_material_v2", {"ior": 1.5, "transparency": 1.0, "reflection_roughness": 0.0}, mdl=True
    ),
    "Houdini's principled shader": Network("", "principledshader::2.0", {"transparency": 1.0, "rough": 0.0}),
    "roughness of an anisotropy": bsdf(
        ("ND_dielectric_bsdf", {"scatter_mode": "RT"}),
        ("ND_roughness_anisotropy", {"roughness": 0.0, "anisotropy": 0.5}),
        links=(("N1", "roughness", "N2", "out"),),
    ),
    "unknown shader, known inputs": Network("", "SomeonesGlass", {"transmission": 1.0, "roughness": 0.0}),
}
# What is lost is named; the rest of the table says what is done instead.
APPROXIMATED = {
    "red standard_surface": (
        Network("mtlx", STANDARD, {"transmission": 1.0, "base_color": RED, **SHARP}),
        "base_color",
    ),
    "coated standard_surface": (Network("mtlx", STANDARD, {"transmission": 1.0, "coat": 1.0, **SHARP}), "coat"),
}
# Glass that takes from the light, or is not all there: what its dialect says of it.
DEEP = tuple(-math.log(max(c, DARKEST)) / 2.0 for c in RED)
PARTIAL = {
    "rough standard_surface": (Network("mtlx", STANDARD, {"transmission": 1.0}), {"roughness": 0.2**2}),
    "rough preview": (preview(opacity=0.0, roughness=0.25), {"roughness": 0.25**2}),
    "rough open_pbr": (Network("mtlx", OPEN, {"transmission_weight": 1.0}), {"roughness": 0.3**2}),
    # BSDF nodes hold the width itself.
    "rough dielectric node": (
        bsdf(("ND_dielectric_bsdf", {"scatter_mode": "RT", "roughness": (0.04, 0.04)})),
        {"roughness": 0.04},
    ),
    "rough Lama": (lama(("LamaDielectric", {"roughness": 0.2})), {"roughness": 0.04}),
    "rough by a node": (
        bsdf(
            ("ND_dielectric_bsdf", {"scatter_mode": "RT"}),
            ("ND_roughness_anisotropy", {"roughness": 0.2}),
            links=(("N1", "roughness", "N2", "out"),),
        ),
        {"roughness": 0.04},
    ),
    "glossy by a node": (
        bsdf(
            ("ND_dielectric_bsdf", {"scatter_mode": "RT"}),
            ("ND_glossiness_anisotropy", {"glossiness": 0.8}),
            links=(("N1", "roughness", "N2", "out"),),
        ),
        {"roughness": 0.04},
    ),
    "tinted Lama": (
        lama(("LamaDielectric", {"roughness": 0.0, "transmissionTint": RED})),
        {"transmittance": RED},
    ),
    "absorbing Lama": (
        lama(("LamaDielectric", {"roughness": 0.0, "absorptionColor": RED, "absorptionRadius": 2.0})),
        {"absorption": DEEP},
    ),
    "absorbing Adobe's": (
        Network(
            "adobe",
            "AdobeStandardMaterial_4_0",
            {"translucency": 1.0, "roughness": 0.0, "absorptionColor": RED, "absorptionDistance": 2.0},
        ),
        {"absorption": DEEP},
    ),
    "dispersive Adobe's": (
        Network("adobe", "AdobeStandardMaterial_4_0", {"translucency": 1.0, "roughness": 0.0, "dispersion": 0.5}),
        {"abbe": 40.0},
    ),
    # Its thickness is in metres, and the stage in centimetres.
    "thick glass of MDL": (
        Network("mdl", "thick_glass_v2", {"ior": 1.5, "glass_color": RED, "base_thickness": 0.02}, mdl=True),
        {"absorption": DEEP},
    ),
    "thin glass of MDL": (
        Network("mdl", "thin_glass_v2", {"ior": 1.5, "base_color": (1.0, 1.0, 1.0)}, mdl=True),
        {"thin_walled": True},
    ),
    "Houdini's principled shader": (
        Network(
            "",
            "principledshader::2.0",
            {"transparency": 1.0, "rough": 0.0, "transcolor": RED, "transdist": 2.0},
        ),
        {"absorption": DEEP},
    ),
    "glass in a share of a mixture": (
        mixed(
            "ND_mix_surfaceshader",
            0.75,
            (STANDARD, {"base_color": RED, "base": 1.0}),
            (STANDARD, {"transmission": 1.0, **SHARP}),
            ("bg", "fg"),
        ),
        {"diffuse_share": 0.25},
    ),
    "glass in a share of Arnold's mixture": (
        mixed(
            "arnold:mix_shader",
            0.25,
            ("arnold:standard_surface", {"transmission": 1.0, **SHARP}),
            ("arnold:lambert", {"Kd": 1.0, "Kd_color": RED}),
            ("shader1", "shader2"),
        ),
        {"diffuse_share": 0.25},
    ),
    "glass in a share of nodes": (
        bsdf(
            ("ND_mix_bsdf", {"mix": 0.25}),
            ("ND_dielectric_bsdf", {"scatter_mode": "RT", "roughness": (0.0, 0.0)}),
            ("ND_oren_nayar_diffuse_bsdf", {"color": RED}),
            links=(("N1", "bg", "N2", "out"), ("N1", "fg", "N3", "out")),
        ),
        {"diffuse_share": 0.25},
    ),
    "dispersive open_pbr": (
        Network("mtlx", OPEN, {"transmission_weight": 1.0, "transmission_dispersion_scale": 0.5, **SHARP}),
        {"abbe": 40.0},
    ),
    "dispersive standard_surface": (
        Network("mtlx", STANDARD, {"transmission": 1.0, "transmission_dispersion": 30.0, **SHARP}),
        {"abbe": 30.0},
    ),
    "dispersive gltf_pbr": (
        Network("mtlx", GLTF, {"transmission": 1.0, "metallic": 0.0, "roughness": 0.0, "dispersion": 0.5}),
        {"abbe": 40.0},
    ),
    "thin standard_surface": (
        Network("mtlx", STANDARD, {"transmission": 1.0, "thin_walled": True, **SHARP}),
        {"thin_walled": True},
    ),
    "thin PxrSurface": (
        Network("ri", "PxrSurface", {"refractionGain": 1.0, "glassRoughness": 0.0, "thinGlass": True}),
        {"thin_walled": True},
    ),
    "partly clear preview": (preview(opacity=0.25, roughness=0.0), {"diffuse_share": 0.25}),
    "partly clear open_pbr": (
        Network("mtlx", OPEN, {"transmission_weight": 0.75, **SHARP}),
        {"diffuse_share": 0.25},
    ),
    "tinted standard_surface": (
        Network("mtlx", STANDARD, {"transmission": 1.0, "transmission_color": RED, **SHARP}),
        {"transmittance": RED},
    ),
    "absorbing open_pbr": (
        Network(
            "mtlx", OPEN, {"transmission_weight": 1.0, "transmission_color": RED, "transmission_depth": 2.0, **SHARP}
        ),
        {"absorption": DEEP},
    ),
    "absorbing gltf_pbr": (
        Network(
            "mtlx",
            GLTF,
            {
                "transmission": 1.0,
                "metallic": 0.0,
                "roughness": 0.0,
                "attenuation_color": RED,
                "attenuation_distance": 2.0,
            },
        ),
        {"absorption": DEEP},
    ),
    "red OmniGlass": (
        Network("mdl", "OmniGlass", {"glass_ior": 1.5, "glass_color": RED}, mdl=True),
        {"transmittance": RED},
    ),
    "present for the most part": (
        Network("mtlx", OPEN, {"transmission_weight": 1.0, "geometry_opacity": 0.75, **SHARP}),
        {"presence": 0.75},
    ),
}
GOLD = (1.0, 0.75, 0.25)
OTHER = {
    "preview mirror": (preview(metallic=1.0, roughness=0.0, diffuseColor=GOLD), MIRROR, GOLD, 1.5),
    "preview chrome": (preview(metallic=0.995, roughness=0.001, diffuseColor=GOLD), MIRROR, GOLD, 1.5),
    "preview mirror in specular workflow": (
        preview(useSpecularWorkflow=1, specularColor=GOLD, diffuseColor=(0.0, 0.0, 0.0), roughness=0.0),
        MIRROR,
        GOLD,
        1.5,
    ),
    "standard_surface mirror": (
        Network("mtlx", STANDARD, {"metalness": 1.0, "base_color": GOLD, **SHARP}),
        MIRROR,
        GOLD,
        1.5,
    ),
    "open_pbr mirror": (
        Network("mtlx", OPEN, {"base_metalness": 1.0, "base_color": GOLD, **SHARP}),
        MIRROR,
        GOLD,
        1.5,
    ),
    "gltf_pbr is metal unless told": (
        Network("mtlx", GLTF, {"transmission": 1.0, "roughness": 0.0, "base_color": GOLD}),
        MIRROR,
        GOLD,
        1.5,
    ),
    "Schlick mirror": (
        bsdf(("ND_generalized_schlick_bsdf", {"color0": GOLD, "roughness": (0.0, 0.0)})),
        MIRROR,
        GOLD,
        1.5,
    ),
    # R = ((n − 1)² + k²) / ((n + 1)² + k²), 1/3 for n = 2 + √3 and k = 0.
    "conductor": (
        bsdf(("ND_conductor_bsdf", {"ior": (2 + 3**0.5,) * 3, "extinction": (0.0,) * 3, "roughness": (0.0, 0.0)})),
        MIRROR,
        (1 / 3,) * 3,
        1.5,
    ),
    "Arnold's old standard mirror": (
        Network("arnold", "arnold:standard", {"Kr": 1.0, "Kr_color": GOLD}),
        MIRROR,
        GOLD,
        1.0,
    ),
    "MoonRay mirror": (
        Network("moonray", "DwaBaseMaterial", {"metallic": 1.0, "metallic_color": GOLD, "roughness": 0.0}),
        MIRROR,
        GOLD,
        1.5,
    ),
    "Lama's metal": (
        lama(("LamaConductor", {"roughness": 0.0, "reflectivity": (1.0, 0.75, 0.5), "tint": (1.0, 1.0, 0.5)})),
        MIRROR,
        GOLD,
        1.5,
    ),
    "Lama's metal by its index": (
        lama(
            ("LamaConductor", {"roughness": 0.0, "fresnelMode": 1, "IOR": (2 + 3**0.5,) * 3, "extinction": (0.0,) * 3})
        ),
        MIRROR,
        (1 / 3,) * 3,
        1.5,
    ),
    "Lama's metal on top": (
        lama(
            ("LamaLayer", {}),
            ("LamaConductor", {"roughness": 0.0, "reflectivity": GOLD}),
            ("LamaDiffuse", {}),
            links=(("N1", "materialTop", "N2", "bxdf_out"), ("N1", "materialBase", "N3", "bxdf_out")),
        ),
        MIRROR,
        GOLD,
        1.5,
    ),
    "Lama's sum": (
        lama(
            ("LamaAdd", {"weight2": 1.0}),
            ("LamaDiffuse", {"color": (0.0, 0.0, 0.0)}),
            ("LamaConductor", {"roughness": 0.0, "reflectivity": GOLD}),
            links=(("N1", "material1", "N2", "bxdf_out"), ("N1", "material2", "N3", "bxdf_out")),
        ),
        MIRROR,
        GOLD,
        1.5,
    ),
    "Lama's diffuse": (lama(("LamaDiffuse", {"color": RED})), DIFFUSE, RED, 1.5),
    # What an artist says of a metal, and its complex index, are the same metal.
    "conductor by an artist": (
        bsdf(
            ("ND_conductor_bsdf", {"roughness": (0.0, 0.0)}),
            ("ND_artistic_ior", {"reflectivity": (0.75, 0.5, 0.25), "edge_color": (0.9, 0.5, 0.1)}),
            links=(("N1", "ior", "N2", "ior"), ("N1", "extinction", "N2", "extinction")),
        ),
        MIRROR,
        (0.75, 0.5, 0.25),
        1.5,
    ),
    "Adobe's metal": (
        Network("adobe", "AdobeStandardMaterial_4_0", {"metallic": 1.0, "roughness": 0.0, "baseColor": GOLD}),
        MIRROR,
        GOLD,
        1.5,
    ),
    "RealityKit's metal": (
        Network("mtlx", "ND_realitykit_pbr_surfaceshader", {"metallic": 1.0, "roughness": 0.0, "baseColor": GOLD}),
        MIRROR,
        GOLD,
        1.5,
    ),
    "RealityKit's card kept by its threshold": (
        Network("mtlx", "ND_realitykit_pbr_surfaceshader", {"baseColor": RED, "opacityThreshold": 0.5}),
        DIFFUSE,
        RED,
        1.5,
    ),
    "flexible metal of MDL": (
        Network(
            "mdl", "flex_material_v2", {"is_metal": 1.0, "reflection_roughness": 0.0, "base_color": GOLD}, mdl=True
        ),
        MIRROR,
        GOLD,
        1.4,
    ),
    "MoonRay base": (Network("moonray", "BaseMaterial", {"diffuse_color": RED}), DIFFUSE, RED, 1.5),
    "OmniPBR mirror": (
        Network(
            "mdl",
            "OmniPBR",
            {"metallic_constant": 1.0, "reflection_roughness_constant": 0.0, "diffuse_color_constant": GOLD},
            mdl=True,
        ),
        MIRROR,
        GOLD,
        1.5,
    ),
    "PxrDisney metal": (
        Network("ri", "PxrDisney", {"metallic": 1.0, "roughness": 0.0, "baseColor": GOLD}),
        MIRROR,
        GOLD,
        1.5,
    ),
    "water": (Network("mtlx", STANDARD, {"transmission": 1.0, "specular_IOR": 1.25, **SHARP}), GLASS, None, 1.25),
    "OmniGlass by default": (Network("mdl", "OmniGlass", {}, mdl=True), GLASS, None, 1.491),
    "plastic": (Network("mtlx", STANDARD, {"base_color": RED, "base": 0.5}), DIFFUSE, (0.5, 0.0, 0.0), 1.5),
    "preview plastic": (preview(diffuseColor=RED), DIFFUSE, RED, 1.5),
    "opaque gltf_pbr": (
        Network("mtlx", GLTF, {"metallic": 0.0, "base_color": RED, "alpha": 0.0}),
        DIFFUSE,
        RED,
        1.5,
    ),
    "preview card kept by its threshold": (
        preview(opacity=0.75, opacityThreshold=0.5, diffuseColor=RED),
        DIFFUSE,
        RED,
        1.5,
    ),
    "OmniPBR": (Network("mdl", "OmniPBR", {"diffuse_color_constant": RED}, mdl=True), DIFFUSE, RED, 1.5),
    "diffuse node": (bsdf(("ND_oren_nayar_diffuse_bsdf", {"color": RED})), DIFFUSE, RED, 1.5),
    "lambert": (Network("arnold", "arnold:lambert", {"Kd_color": RED, "Kd": 0.5}), DIFFUSE, (0.5, 0.0, 0.0), 1.5),
    "PxrDiffuse": (Network("ri", "PxrDiffuse", {"diffuseColor": RED}), DIFFUSE, RED, 1.5),
    "colour by nodes": (
        fed(STANDARD, "base_color", ("ND_combine3_color3", {"in1": 0.5, "in2": 0.25, "in3": 0.125})),
        DIFFUSE,
        (0.5, 0.25, 0.125),
        1.5,
    ),
}
ABSENT = {
    "preview cut out": preview(opacity=0.0, opacityMode="presence"),
    "preview below its threshold": preview(opacity=0.25, opacityThreshold=0.5),
    "standard_surface": Network("mtlx", STANDARD, {"opacity": (0.0, 0.0, 0.0), "transmission": 1.0}),
    "gltf_pbr masked": Network("mtlx", GLTF, {"alpha": 0.25, "alpha_mode": 1}),
    "RealityKit below its threshold": Network(
        "mtlx", "ND_realitykit_pbr_surfaceshader", {"opacity": 0.25, "opacityThreshold": 0.5}
    ),
    "Lama": lama(("LamaDielectric", {"roughness": 0.0}), presence=0.0),
    "OmniPBR": Network("mdl", "OmniPBR", {"enable_opacity": True, "opacity_constant": 0.0}, mdl=True),
}


def ball(folder, network):
    """A ball of radius 1 whose lowest point is half a unit above a floor, under a sun that stands upright."""
    small = SmallStage(folder)
    UsdGeom.SetStageUpAxis(small.stage, "Z")
    small.mesh("/Floor", [(4 * x - 2, 4 * y - 2, 0) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))])
    sphere = UsdGeom.Sphere.Define(small.stage, "/Ball")
    sphere.AddTranslateOp().Set(Gf.Vec3d(0, 0, 1.5))
    camera = UsdGeom.Camera.Define(small.stage, "/Camera")
    camera.AddTranslateOp().Set(Gf.Vec3d(0, -8, 3))
    camera.AddRotateXOp().Set(75.0)
    if network is not None:
        network.author(small)
        small.bind(sphere, "/M")
    return small.open(image_width=32)


def seen(folder, network):
    """The ball's material (None where there is no ball), and what is warned about."""
    source = ball(folder, network)
    meshes = {mesh.path: mesh for mesh in source.at(Shutter.still(1)).meshes}
    material = meshes["/Ball"].materials[0] if "/Ball" in meshes else None
    return source, material, source.warnings.messages


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    """Picture and fluxes of the ball of a material written as plainly as can be."""
    return cache(lambda *material: plain_picture(tmp_path_factory.mktemp("plain"), *material))


def plain_picture(folder, interaction, color, ior):
    plain = {
        GLASS: {"opacity": 0.0, "roughness": 0.0, "ior": ior},
        MIRROR: {"metallic": 1.0, "roughness": 0.0, "diffuseColor": color},
        DIFFUSE: {"diffuseColor": color},
    }[interaction]
    return picture(ball(folder, preview(**plain)))


def picture(source):
    frame = render_frame(RenderContext(source, Settings(photons=1024, samples=1)), Shutter.still(1), 32, 24)
    return np.stack([frame.channels[name] for name in "RGB"]), (frame.energy.sent, frame.energy.deposited)


def same(rendered, source, interaction, color, ior):
    pixels, fluxes = picture(source)
    expected, expected_fluxes = rendered(interaction, color, ior)
    np.testing.assert_array_equal(pixels, expected)
    assert fluxes == expected_fluxes
    assert (fluxes[1] > 0) == (interaction != DIFFUSE)


@pytest.mark.parametrize("way", CLEAR)
def test_clear_glass_is_clear_glass_in_every_dialect(tmp_path, rendered, way):
    source, material, warnings = seen(tmp_path, CLEAR[way])
    assert (material.interaction, material.path) == (GLASS, "/M") and warnings == []
    assert material.ior == pytest.approx(1.5, abs=1e-6)
    if material.ior == 1.5:
        same(rendered, source, GLASS, None, 1.5)


@pytest.mark.parametrize("way", APPROXIMATED)
def test_glass_that_is_more_than_clear_is_clear_and_what_is_lost_is_said(tmp_path, rendered, way):
    network, lost = APPROXIMATED[way]
    source, material, warnings = seen(tmp_path, network)
    assert material.interaction == GLASS and len(warnings) == 1 and f"/M/S.inputs:{lost}: " in warnings[0]
    same(rendered, source, GLASS, None, 1.5)


@pytest.mark.parametrize("way", PARTIAL)
def test_glass_takes_from_light_what_its_dialect_says(tmp_path, way):
    network, expected = PARTIAL[way]
    _, material, warnings = seen(tmp_path, network)
    plain = Material(GLASS, material.color, material.ior, "/M")
    assert warnings == [] and material.ior == pytest.approx(1.5)
    for name in ("presence", "diffuse_share", "transmittance", "absorption", "roughness", "abbe", "thin_walled"):
        assert getattr(material, name) == pytest.approx(expected.get(name, getattr(plain, name)), rel=1e-6), name


class WithBall:
    """A stage whose ball is of a material that is written down, as a source of scenes."""

    def __init__(self, source, material):
        self._source, self._material = source, material

    def __getattr__(self, name):
        return getattr(self._source, name)

    def at(self, shutter):
        scene = self._source.at(shutter)
        meshes = (replace(m, materials=(self._material,)) if m.path == "/Ball" else m for m in scene.meshes)
        return replace(scene, meshes=tuple(meshes))


@pytest.mark.slow
@pytest.mark.parametrize("way", PARTIAL)
def test_glass_that_takes_from_light_gives_the_picture_of_what_it_is(tmp_path, way):
    network, expected = PARTIAL[way]
    source, material, _ = seen(tmp_path, network)
    (tmp_path / "clear").mkdir()
    clear = ball(tmp_path / "clear", preview(opacity=0.0, roughness=0.0, ior=1.5))
    pixels, fluxes = picture(source)
    written = Material(GLASS, material.color, 1.5, "/M", **expected)
    expected_pixels, expected_fluxes = picture(WithBall(clear, written))
    # What is authored has single precision.
    np.testing.assert_allclose(pixels, expected_pixels, rtol=1e-4, atol=1e-5 * expected_pixels.max())
    assert fluxes == pytest.approx(expected_fluxes, rel=1e-5)
    assert fluxes[1] > 0
    # And it is another than that of clear glass.
    assert not np.allclose(pixels, picture(clear)[0], rtol=1e-3)


@pytest.mark.parametrize("way", OTHER)
def test_other_surfaces_are_what_their_dialect_means(tmp_path, rendered, way):
    network, interaction, color, ior = OTHER[way]
    source, material, warnings = seen(tmp_path, network)
    assert material.interaction == interaction and warnings == []
    assert material.ior == pytest.approx(ior, rel=1e-6)
    if interaction != GLASS:
        assert material.color == pytest.approx(color, rel=1e-6)
    # Single precision of what is authored may differ from that of the plain stage by its last digit.
    if material.ior == ior and (color is None or material.color == tuple(map(np.float32, color))):
        same(rendered, source, interaction, color, ior)


@pytest.mark.parametrize("way", ABSENT)
def test_what_is_cut_out_is_not_there(tmp_path, way):
    _, material, warnings = seen(tmp_path, ABSENT[way])
    assert material is None and warnings == []


def test_materialx_comes_before_what_is_for_all_and_other_renderers_come_last(tmp_path):
    def material(*contexts):
        folder = tmp_path / str(len(contexts))
        folder.mkdir()
        small = SmallStage(folder)
        found = UsdShade.Material.Define(small.stage, "/M")
        for context in contexts:
            shader = UsdShade.Shader.Define(small.stage, f"/M/of_{context or 'all'}")
            shader.CreateIdAttr("UsdPreviewSurface")
            author(shader, "ior", {"tpdwarp": 1.125, "mtlx": 1.25, "": 1.5, "ri": 1.75, "arnold": 2.0}[context])
            author(shader, "opacity", 0.0)
            output = found.CreateSurfaceOutput(context) if context else found.CreateSurfaceOutput()
            output.ConnectToSource(shader.ConnectableAPI(), "out")
        small.bind(small.mesh(), "/M")
        return small.open().at(Shutter.still(1)).meshes[0].materials[0].ior

    assert material("ri", "arnold", "", "mtlx", "tpdwarp") == 1.125
    assert material("ri", "arnold", "", "mtlx") == 1.25
    assert material("ri", "arnold", "") == 1.5
    assert material("ri", "arnold") == 2.0
    assert material("ri") == 1.75


@pytest.mark.parametrize(
    "unlit",
    [
        Network("mtlx", "ND_surface_unlit", {"emission_color": RED, "emission": 2.0}),
        Network("arnold", "arnold:flat", {"color": (2.0, 0.0, 0.0)}),
        Network("mtlx", "ND_realitykit_unlit_surfaceshader", {"color": (2.0, 0.0, 0.0)}),
        Network("ri", "PxrConstant", {"emitColor": (2.0, 0.0, 0.0)}),
        Network("arnold", "arnold:multiply", {"input1": RED, "input2": (2.0, 1.0, 1.0)}),
        fed("ND_surface", "edf", ("ND_uniform_edf", {"color": (2.0, 0.0, 0.0)})),
    ],
)
def test_what_is_unlit_shines_and_reflects_nothing(tmp_path, unlit):
    _, material, warnings = seen(tmp_path, unlit)
    # An EDF lights its surroundings elsewhere.
    assert len(warnings) == (unlit.surface == "ND_surface")
    assert (material.interaction, material.color, material.emission) == (DIFFUSE, (0, 0, 0), (2, 0, 0))


@pytest.mark.parametrize(
    ("network", "blamed"),
    [
        (
            lama(
                ("LamaLayer", {}),
                ("LamaDielectric", {"roughness": 0.0}),
                ("LamaDiffuse", {"color": RED}),
                links=(("N1", "materialTop", "N2", "bxdf_out"), ("N1", "materialBase", "N3", "bxdf_out")),
            ),
            "/M/N1.inputs:materialTop: is a coat",
        ),
        (lama(("LamaSSS", {"color": RED})), "/M/N1.inputs:color: is the colour of light scattered inside"),
        (bsdf(("ND_subsurface_bsdf", {"color": RED})), "/M/N1.inputs:color: is the colour of light scattered inside"),
        (
            mixed(
                "ND_mix_surfaceshader",
                0.25,
                (STANDARD, {"base_color": RED, "base": 1.0}),
                (STANDARD, {"metalness": 1.0, **SHARP}),
                ("bg", "fg"),
            ),
            "/M/S: a mixture of surfaces",
        ),
        (
            mixed(
                "ND_mix_surfaceshader",
                0.75,
                (STANDARD, {"base_color": RED, "base": 1.0}),
                ("Unheard of", {}),
                ("bg", "fg"),
            ),
            "/M/S: a mixture of surfaces",
        ),
    ],
)
def test_coats_scattering_and_mixtures_that_are_not_rendered_leave_what_is_and_are_said(tmp_path, network, blamed):
    _, material, warnings = seen(tmp_path, network)
    assert (material.interaction, material.color) == (DIFFUSE, RED)
    assert [blamed in line for line in warnings] == [True]


def test_what_scatters_inside_the_glass_of_lama_is_said(tmp_path):
    _, material, warnings = seen(tmp_path, lama(("LamaDielectric", {"scatterColor": RED, "roughness": 0.0})))
    assert material.interaction == GLASS
    assert ["/M/N1.inputs:scatterColor: is not rendered" in line for line in warnings] == [True]


def test_a_mixture_of_itself_ends(tmp_path):
    _, material, warnings = seen(
        tmp_path,
        Network(
            "mtlx",
            "ND_mix_surfaceshader",
            {"mix": 0.5},
            (("N1", STANDARD, {"transmission": 1.0, **SHARP}),),
            (("S", "bg", "N1", "out"), ("S", "fg", "S", "out")),
        ),
    )
    assert material.interaction == GLASS
    assert "mixture" in warnings[0]


def test_there_are_sixty_ways_to_author_the_ball():
    assert len(CLEAR) + len(APPROXIMATED) + len(PARTIAL) + len(OTHER) + len(ABSENT) >= 60


@pytest.mark.parametrize(
    ("kind", "weight"),
    [("ND_standard_surface_surfaceshader", "coat"), ("ND_open_pbr_surface_surfaceshader", "coat_weight")],
)
def test_a_coat_tints_what_lies_below_as_far_as_it_covers_it(tmp_path, kind, weight):
    small = SmallStage(tmp_path)
    mesh = small.mesh()
    shader = small.preview("/Material")
    shader.CreateIdAttr(kind)
    set_inputs(shader, base_color=(0.5, 0.5, 1.0), coat_color=(1.0, 0.5, 0.0), **{weight: 0.5})
    small.bind(mesh, "/Material")
    scene = small.open()
    color = scene.at(Shutter.still(1)).meshes[0].materials[0].color
    assert color == pytest.approx((0.5, 0.375, 0.5))
    # Its own reflection is not there.
    assert any(f"{weight}: is not rendered" in message for message in scene.warnings.messages)
