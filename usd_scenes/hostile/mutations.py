"""Mutations of USD layers: of specs and fields through Sdf, of the text of a layer, of its bytes."""

from __future__ import annotations

import re
from collections.abc import Callable
from random import Random
from typing import Any

from pxr import Sdf, Tf

from usd_scenes.hostile.values import INTEGERS, NUMBERS, TEXTS, TYPES, hostile

TIMES = (1.0, 1.5, 2.0, 3.0, 0.0, -1.0, 1e-9, 2.9999999, 4.0, 1e3, -1e6, 1e6, 1e12, 1e30, -1e300)
PRIM_TYPES = (
    "", "Xform", "Mesh", "Scope", "Camera", "DistantLight", "SphereLight", "RectLight", "PointInstancer", "Material",
    "Shader", "GeomSubset", "RenderSettings", "RenderProduct", "Points", "Sphere", "SkelRoot", "Nonsense", "Capsule",
    "CylinderLight", "DomeLight", "DomeLight_1", "BasisCurves", "NurbsPatch", "TetMesh", "Skeleton", "SkelAnimation",
    "BlendShape", "NodeGraph", "RenderVar", "Volume", "Plane", "HermiteCurves", "GeometryLight", "LightFilter",
)  # fmt: skip
NAMES = (
    "faceVertexCounts", "faceVertexIndices", "points", "normals", "velocities", "accelerations", "holeIndices",
    "orientation", "subdivisionScheme", "primvars:normals", "primvars:displayColor", "primvars:displayColor:indices",
    "visibility", "purpose", "xformOpOrder", "xformOp:transform", "xformOp:scale", "xformOp:rotateY",
    "inputs:intensity", "inputs:exposure", "inputs:color", "inputs:angle", "inputs:radius", "inputs:colorTemperature",
    "inputs:enableColorTemperature", "inputs:normalize", "inputs:diffuse", "inputs:specular", "inputs:ior",
    "inputs:opacity", "inputs:metallic", "inputs:roughness", "inputs:diffuseColor", "inputs:emissiveColor",
    "inputs:opacityMode", "inputs:clearcoat", "info:id", "focalLength", "horizontalAperture", "verticalAperture",
    "horizontalApertureOffset", "clippingRange", "clippingPlanes", "fStop", "projection", "shutter:open",
    "shutter:close", "exposure", "exposure:iso", "exposure:time", "exposure:fStop", "exposure:responsivity",
    "motion:blurScale", "motion:velocityScale", "protoIndices", "positions", "orientations", "orientationsf",
    "scales", "ids", "invisibleIds", "angularVelocities", "elementType", "indices", "familyName", "resolution",
    "pixelAspectRatio", "aspectRatioConformPolicy", "dataWindowNDC", "includedPurposes", "materialBindingPurposes",
    "disableMotionBlur", "treatAsPoint", "inputs:shaping:cone:angle", "inputs:shadow:enable", "widths", "type", "basis",
    "wrap", "curveVertexCounts", "height", "axis", "size", "extent", "extentsHint", "model:drawMode",
    "model:applyDrawMode", "model:cardGeometry", "model:cardTextureXPos", "creaseSharpnesses", "cornerIndices",
    "primvars:displayOpacity", "primvars:st", "primvars:st:indices", "primvars:skel:jointIndices",
    "primvars:skel:jointWeights", "primvars:skel:geomBindTransform", "skel:blendShapes", "blendShapeWeights",
    "rotations", "joints", "bindTransforms", "inputs:texture:file", "inputs:texture:format", "inputs:file",
    "inputs:shaping:focus", "inputs:shaping:ies:file", "inputs:length", "inputs:width", "poleAxis", "inputs:radius",
    "collection:lightLink:expansionRule", "collection:lightLink:includeRoot", "light:materialSyncMode", "focusDistance",
    "productName", "productType", "sourceName", "dataType", "inputs:opacityThreshold", "inputs:in", "inputs:varname",
)  # fmt: skip
RELATIONSHIPS = (
    "material:binding", "prototypes", "camera", "products", "proxyPrim", "light:filters", "material:binding:full",
    "skel:skeleton", "skel:animationSource", "skel:blendShapeTargets", "material:binding:preview", "portals",
    "collection:lightLink:includes", "collection:shadowLink:excludes", "light:filters", "orderedVars",
)  # fmt: skip
# A stage of a million frames is legal, and takes its time.
ENDS = tuple(value for value in NUMBERS if not 100 < abs(value) < 1e7)
STAGE_FIELDS = {
    **dict.fromkeys(("startTimeCode", "endTimeCode"), ENDS),
    **dict.fromkeys(("timeCodesPerSecond", "framesPerSecond", "metersPerUnit"), NUMBERS),
    "upAxis": ("X", "Y", "Z", "", "nonsense"),
    "defaultPrim": TEXTS,
    "renderSettingsPrimPath": ("/World", "/World/Camera", "nonsense", "", "/No"),
}

Mutation = Callable[[Random, Sdf.Layer], str]


def mutate_layer(random: Random, layer: Sdf.Layer) -> list[str]:
    """Changes a layer in one to four places; says what it did. What Sdf itself refuses is not done."""
    done = []
    for _ in range(random.choice((1, 1, 1, 2, 2, 3, 4))):
        mutation = random.choices(tuple(_WEIGHTS), tuple(_WEIGHTS.values()))[0]
        try:
            done.append(mutation(random, layer))
        except (Tf.ErrorException, TypeError, ValueError, OverflowError, RuntimeError, IndexError) as refused:
            done.append(f"{mutation.__name__} was refused ({type(refused).__name__})")
    return done


def mutate_text(random: Random, text: str) -> tuple[str, list[str]]:
    """Changes the text of a layer in one to three places."""
    done = []
    for _ in range(random.choice((1, 1, 2, 3))):
        name, change = random.choice(_TEXT_MUTATIONS)
        text = change(random, text)
        done.append(name)
    return text, done


def mutate_bytes(random: Random, data: bytes) -> tuple[bytes, list[str]]:
    """Cuts a file short, or overwrites a few of its bytes."""
    changed_data = bytearray(data)
    if random.random() < 0.4:
        size = random.choice((0, 1, 7, 8, 88, random.randrange(len(data))))
        return bytes(changed_data[:size]), [f"cut to {size} bytes"]
    places = [random.randrange(len(data)) for _ in range(random.choice((1, 2, 8)))]
    for place in places:
        changed_data[place] = random.randrange(256)
    return bytes(changed_data), [f"bytes {places} overwritten"]


# What is there.


def _specs(layer: Sdf.Layer) -> tuple[list[Sdf.PrimSpec], list[Sdf.AttributeSpec], list[Sdf.RelationshipSpec]]:
    prims, attributes, relationships = [], [], []

    def visit(path: Sdf.Path) -> None:
        spec = layer.GetObjectAtPath(path)
        if isinstance(spec, Sdf.PrimSpec) and path != Sdf.Path.absoluteRootPath:
            prims.append(spec)
        elif isinstance(spec, Sdf.AttributeSpec):
            attributes.append(spec)
        elif isinstance(spec, Sdf.RelationshipSpec):
            relationships.append(spec)

    layer.Traverse(Sdf.Path.absoluteRootPath, visit)
    return prims, attributes, relationships


def _attribute(random: Random, layer: Sdf.Layer) -> Sdf.AttributeSpec:
    return random.choice(_specs(layer)[1])


def _prim(random: Random, layer: Sdf.Layer) -> Sdf.PrimSpec:
    return random.choice(_specs(layer)[0])


def _target(random: Random, layer: Sdf.Layer, own: Sdf.Path) -> Sdf.Path:
    prims, attributes, relationships = _specs(layer)
    pools = [[own, own.GetPrimPath(), own.GetPrimPath().GetParentPath()], ["/No/Such", "/World.no", "/"]]
    pools += [[spec.path for spec in specs] for specs in (prims, prims, attributes, relationships) if specs]
    return Sdf.Path(random.choice(random.choice(pools)))


def _samples(layer: Sdf.Layer, spec: Sdf.AttributeSpec) -> list[float]:
    return layer.ListTimeSamplesForPath(spec.path)


# Attributes.


def change_value(random: Random, layer: Sdf.Layer) -> str:
    spec = _attribute(random, layer)
    times = _samples(layer, spec)
    if times and random.random() < 0.8:
        time = random.choice(times)
        value = hostile(random, spec.typeName, layer.QueryTimeSample(spec.path, time))
        layer.SetTimeSample(spec.path, time, value)
        return f"{spec.path} at {time} = {_short(value)}"
    value = hostile(random, spec.typeName, spec.default)
    spec.default = value
    return f"{spec.path} = {_short(value)}"


def remove_property(random: Random, layer: Sdf.Layer) -> str:
    _, attributes, relationships = _specs(layer)
    spec = random.choice([*attributes, *relationships])
    path = spec.path
    del layer.GetPrimAtPath(path.GetPrimPath()).properties[spec.name]
    return f"no {path}"


def add_time_sample(random: Random, layer: Sdf.Layer) -> str:
    spec = _attribute(random, layer)
    time = random.choice(TIMES)
    times = _samples(layer, spec)
    was = layer.QueryTimeSample(spec.path, times[0]) if times else spec.default
    value = Sdf.ValueBlock() if random.random() < 0.2 else hostile(random, spec.typeName, was)
    layer.SetTimeSample(spec.path, time, value)
    return f"{spec.path} at {time} = {_short(value)}"


def animate(random: Random, layer: Sdf.Layer) -> str:
    spec = _attribute(random, layer)
    was = spec.default
    for time in random.sample(TIMES, 3):
        layer.SetTimeSample(spec.path, time, was if random.random() < 0.5 else hostile(random, spec.typeName, was))
    return f"{spec.path} animated"


def erase_samples(random: Random, layer: Sdf.Layer) -> str:
    sampled = [spec for spec in _specs(layer)[1] if _samples(layer, spec)]
    spec = random.choice(sampled)
    times = _samples(layer, spec)
    kept = random.choice((0, 1))
    for time in times[kept:]:
        layer.EraseTimeSample(spec.path, time)
    return f"{spec.path} keeps {kept} samples"


def block(random: Random, layer: Sdf.Layer) -> str:
    spec = _attribute(random, layer)
    for time in _samples(layer, spec):
        if random.random() < 0.5:
            layer.SetTimeSample(spec.path, time, Sdf.ValueBlock())
    spec.default = Sdf.ValueBlock()
    return f"{spec.path} blocked"


def retype(random: Random, layer: Sdf.Layer) -> str:
    spec = _attribute(random, layer)
    prim, name = layer.GetPrimAtPath(spec.path.GetPrimPath()), spec.name
    kind = Sdf.ValueTypeNames.Find(random.choice(TYPES))
    del prim.properties[name]
    made = Sdf.AttributeSpec(prim, name, kind)
    value = hostile(random, kind, None)
    if random.random() < 0.8:
        made.default = value
    return f"{made.path} is {kind} {_short(value)}"


def add_property(random: Random, layer: Sdf.Layer) -> str:
    prim = _prim(random, layer)
    name = random.choice(NAMES)
    if name in prim.properties:
        del prim.properties[name]
    known = [spec for spec in _specs(layer)[1] if spec.name == name]
    kind = known[0].typeName if known and random.random() < 0.8 else Sdf.ValueTypeNames.Find(random.choice(TYPES))
    made = Sdf.AttributeSpec(prim, name, kind)
    value = hostile(random, kind, known[0].default if known else None)
    made.default = value
    return f"{made.path} is {kind} {_short(value)}"


def mistype_value(random: Random, layer: Sdf.Layer) -> str:
    """The type stays, the value is of another: Sdf stores what it is given."""
    spec = _attribute(random, layer)
    kind = Sdf.ValueTypeNames.Find(random.choice(TYPES))
    value = hostile(random, kind, None)
    if random.random() < 0.3:
        layer.SetTimeSample(spec.path, random.choice(TIMES), value)
    else:
        spec.SetInfo("default", value)
    return f"{spec.path} = {_short(value)} of {kind}"


def connect(random: Random, layer: Sdf.Layer) -> str:
    spec = _attribute(random, layer)
    target = _target(random, layer, spec.path)
    spec.connectionPathList.explicitItems = [target]
    return f"{spec.path} connected to {target}"


def rename_op(random: Random, layer: Sdf.Layer) -> str:
    orders = [spec for spec in _specs(layer)[1] if spec.name == "xformOpOrder" and spec.default]
    spec = random.choice(orders)
    items = list(spec.default)
    others = ("!resetXformStack!", "xformOp:none", "", "nonsense", "xformOp:scale", "!invert!xformOp:scale")
    items[random.randrange(len(items))] = random.choice((*others, items[0], "!invert!" + items[0]))
    spec.default = items
    return f"{spec.path} = {items}"


def interpolate(random: Random, layer: Sdf.Layer) -> str:
    interpolated = [spec for spec in _specs(layer)[1] if spec.name.startswith(("primvars:", "normals"))]
    spec = random.choice(interpolated)
    value = random.choice(("constant", "uniform", "vertex", "varying", "faceVarying", "nonsense", ""))
    spec.SetInfo("interpolation", value)
    if random.random() < 0.3:
        spec.SetInfo("elementSize", random.choice(INTEGERS))
    return f"{spec.path} interpolates {value!r}"


# Relationships.


def retarget(random: Random, layer: Sdf.Layer) -> str:
    prims, _, relationships = _specs(layer)
    if relationships and random.random() < 0.8:
        spec = random.choice(relationships)
    else:
        prim, name = random.choice(prims), random.choice(RELATIONSHIPS)
        spec = prim.properties.get(name) or Sdf.RelationshipSpec(prim, name)
    targets = [_target(random, layer, spec.path) for _ in range(random.choice((0, 1, 1, 2, 3)))]
    spec.targetPathList.explicitItems = list(dict.fromkeys(targets))
    return f"{spec.path} targets {[str(target) for target in targets]}"


# Prims and the stage.


def retype_prim(random: Random, layer: Sdf.Layer) -> str:
    prim = _prim(random, layer)
    prim.typeName = random.choice(PRIM_TYPES)
    return f"{prim.path} is a {prim.typeName!r}"


def remove_prim(random: Random, layer: Sdf.Layer) -> str:
    prim = _prim(random, layer)
    path = prim.path
    parent = prim.nameParent or layer.pseudoRoot
    del parent.nameChildren[prim.name]
    return f"no {path}"


def respecify(random: Random, layer: Sdf.Layer) -> str:
    prim = _prim(random, layer)
    prim.specifier = random.choice((Sdf.SpecifierOver, Sdf.SpecifierClass, Sdf.SpecifierDef))
    return f"{prim.path} is {prim.specifier}"


def compose(random: Random, layer: Sdf.Layer) -> str:
    prim = _prim(random, layer)
    target = _target(random, layer, prim.path).GetPrimPath()
    arc = random.choice(("reference", "payload", "inherit", "specialize", "outside"))
    if arc == "reference":
        prim.referenceList.prependedItems = [Sdf.Reference("", target)]
    elif arc == "payload":
        prim.payloadList.prependedItems = [Sdf.Payload("", target)]
    elif arc == "inherit":
        prim.inheritPathList.prependedItems = [target]
    elif arc == "specialize":
        prim.specializesList.prependedItems = [target]
    else:
        prim.referenceList.prependedItems = [Sdf.Reference("./no_such.usda")]
    if random.random() < 0.3:
        prim.instanceable = True
    return f"{prim.path} has {arc} {target}"


def set_prim_field(random: Random, layer: Sdf.Layer) -> str:
    prim = _prim(random, layer)
    what = random.choice(("active", "instanceable", "apiSchemas", "kind", "hidden"))
    if what == "active":
        prim.active = False
    elif what == "instanceable":
        prim.instanceable = not prim.instanceable
    elif what == "hidden":
        prim.hidden = True
    elif what == "kind":
        prim.kind = random.choice(TEXTS)
    else:
        schemas = (
            "LightAPI", "MeshLightAPI", "MotionAPI", "SkelBindingAPI", "ShapingAPI", "CollectionAPI:x", "Nonsense",
        )
        names = random.sample(schemas, 2)
        prim.SetInfo("apiSchemas", Sdf.TokenListOp.CreateExplicit(names))
    return f"{prim.path} {what} changed"


def set_stage_field(random: Random, layer: Sdf.Layer) -> str:
    name = random.choice(sorted(STAGE_FIELDS))
    root = layer.pseudoRoot
    if random.random() < 0.1:
        root.ClearInfo(name)
        return f"no {name}"
    value = random.choice(STAGE_FIELDS[name])
    root.SetInfo(name, value)
    return f"{name} = {value!r}"


def add_sublayer(random: Random, layer: Sdf.Layer) -> str:
    layer.subLayerPaths = [random.choice(("no_such.usda", "", "./no_such.usda", "x" * 300 + ".usda"))]
    layer.subLayerOffsets[0] = Sdf.LayerOffset(random.choice((0.0, 1e30)), random.choice((1.0, 0.0, -1.0)))
    return f"sublayer {layer.subLayerPaths[0][:20]}"


_WEIGHTS: dict[Mutation, float] = {
    change_value: 8,
    remove_property: 2,
    add_time_sample: 4,
    animate: 2,
    erase_samples: 1,
    block: 1.5,
    retype: 3,
    add_property: 4,
    mistype_value: 2,
    connect: 1,
    rename_op: 1,
    interpolate: 1,
    retarget: 2.5,
    retype_prim: 1.5,
    remove_prim: 1,
    respecify: 0.5,
    compose: 1,
    set_prim_field: 1,
    set_stage_field: 2,
    add_sublayer: 0.3,
}


def _short(value: Any) -> str:
    text = " ".join(str(value).split())
    return text if len(text) < 60 else text[:57] + "…"


# Text.

_NUMBER = re.compile(r"(?<![\w.\"])-?\d+(?:\.\d+)?(?![\w\"])")


def _any_line(random: Random, text: str) -> tuple[list[str], int]:
    lines = text.splitlines(keepends=True)
    return lines, random.randrange(len(lines)) if lines else 0


def _cut(random: Random, text: str) -> str:
    return text[: random.randrange(len(text) + 1)]


def _without_line(random: Random, text: str) -> str:
    lines, index = _any_line(random, text)
    return "".join(lines[:index] + lines[index + 1 :])


def _line_twice(random: Random, text: str) -> str:
    lines, index = _any_line(random, text)
    return "".join(lines[: index + 1] + lines[index:])


def _other_number(random: Random, text: str) -> str:
    found = list(_NUMBER.finditer(text))
    if not found:
        return text
    place = random.choice(found)
    others = ("", "nan", "inf", "-inf", "1e400", "1e-400", "-1", "0", "9" * 20, "1e38", "None", '"x"', "()", "[]")
    return text[: place.start()] + random.choice(others) + text[place.end() :]


def _without_sign(random: Random, text: str) -> str:
    places = [i for i, letter in enumerate(text) if letter in "()[]{}<>\",=:#"]
    if not places:
        return text
    place = random.choice(places)
    return text[:place] + text[place + 1 :]


def _noise(random: Random, text: str) -> str:
    place = random.randrange(len(text) + 1)
    noise = ("\0", "\x07", "é", "\ufffd", '"', "'''", "{", "}", "\\", "@", "#", "x" * 1000)
    return text[:place] + random.choice(noise) + text[place:]


def _other_word(random: Random, text: str) -> str:
    words = list(re.finditer(r"[A-Za-z_]\w*", text))
    if len(words) < 2:
        return text
    one, other = random.sample(words, 2)
    return text[: one.start()] + other.group() + text[one.end() :]


_TEXT_MUTATIONS: list[tuple[str, Callable[[Random, str], str]]] = [
    ("cut short", _cut),
    ("a line less", _without_line),
    ("a line twice", _line_twice),
    *[("another number", _other_number)] * 3,
    ("a sign less", _without_sign),
    ("noise", _noise),
    *[("another word", _other_word)] * 2,
]
