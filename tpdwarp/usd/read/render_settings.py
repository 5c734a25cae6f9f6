"""RenderSettings: the camera, size and shutter a stage asks for, and how an aperture is fitted to an image."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import PurePosixPath

import numpy as np
from pxr import Sdf, Usd, UsdRender

from tpdwarp.errors import InputError, WarnOnce
from tpdwarp.usd.read.values import ITS_DEFAULT, text_at, texts_at, value_or_fallback

EARLIEST = Usd.TimeCode.EarliestTime().GetValue()

# What RenderVars call the picture itself.
BEAUTY = ("ci", "c.*", "lpe:c.*", "color", "beauty", "rgba", "rgb", "a", "alpha", "c", "lpe:c.*[lo]")
# Names all products at once, also in the name of an image.
EACH_PRODUCT = "<product>"
# The type of products that are plain images.
RASTER = "raster"
MOST_PIXELS = 2**30
# Of a pixel's sides. Chosen, not derived: anamorphic images have 2.
LARGEST_RATIO = 1e3
# A window that holds the whole image.
WHOLE = (0.0, 0.0, 1.0, 1.0)
POLICIES = ("expandAperture", "cropAperture", "adjustApertureWidth", "adjustApertureHeight", "adjustPixelAspectRatio")


@dataclass(frozen=True)
class RenderRequest:
    """What a RenderSettings prim (and its first product, whose authored values win) asks for.

    Attributes:
        path: Prim path; empty where the stage has no render settings.
        camera: Camera path, or empty.
        resolution: Width and height in pixels; None where not authored.
        pixel_aspect: Width of a pixel over its height.
        policy: How the aperture is fitted to the image.
        still: Whether motion blur is disabled.
        purposes: Purposes included; None where not authored.
        material_purpose: Material purpose looked for first.
        data_window: Part of the image that is rendered: left, bottom, right and top in 0 … 1, from its lower left.
        products: Path and name of each product; the name is that of its file, without folders, frame and kind.
        render_vars: What the product's RenderVars are called (``sourceName``, or the prim's name), but the beauty.
    """

    path: str = ""
    camera: str = ""
    resolution: tuple[int, int] | None = None
    pixel_aspect: float = 1.0
    policy: str = POLICIES[0]
    still: bool = False
    purposes: tuple[str, ...] | None = None
    material_purpose: str = "full"
    data_window: tuple[float, float, float, float] = WHOLE
    products: tuple[tuple[str, str], ...] = ()
    render_vars: tuple[str, ...] = ()


def read_request(stage: Usd.Stage, path: str, warnings: WarnOnce, wanted: str = "") -> RenderRequest:
    """The render settings at ``path``, or the stage's own where it is empty.

    Args:
        wanted: Path or name of the product; empty takes the first, as :data:`EACH_PRODUCT` does without a word.

    Raises:
        InputError: No RenderSettings at ``path``, or no such product.
    """
    if path:
        settings = UsdRender.Settings(stage.GetPrimAtPath(path)) if Sdf.Path.IsValidPathString(path) else None
        if not settings:
            raise InputError("is no RenderSettings prim (correct --renderSettingsPrimPath)", warnings.file, path)
    else:
        settings = UsdRender.Settings.GetStageRenderSettings(stage)
        if not settings:
            if wanted and wanted != EACH_PRODUCT:
                raise InputError("the stage has no RenderSettings (leave --product out)", warnings.file, wanted)
            return RenderRequest()
    products = _products(stage, settings)
    names = _names_of(products)
    product = _chosen(products, names, wanted, warnings)
    prims = [settings] if product is None else [product, settings]

    def authored(name: str) -> Usd.Attribute | None:
        attributes = (base.GetPrim().GetAttribute(name) for base in prims)
        return next((found for found in attributes if found and found.HasAuthoredValue()), None)

    def value(name: str, default: float | tuple[float, ...]) -> np.ndarray:
        found = authored(name)
        held = None if found is None else value_or_fallback(found, EARLIEST, warnings, np.shape(default))
        return np.array(default) if held is None else held

    resolution: tuple[int, int] | None = tuple(map(int, value("resolution", (0, 0))))
    if not (min(resolution) >= 1 and resolution[0] * resolution[1] <= MOST_PIXELS):
        if authored("resolution"):
            wanted = f"author sizes above 0, of {MOST_PIXELS} pixels at most"
            warnings(_where(authored("resolution")), f"holds {resolution} and is ignored ({wanted})")
        resolution = None
    pixel_aspect = float(value("pixelAspectRatio", 1.0))
    if not 1 / LARGEST_RATIO <= pixel_aspect <= LARGEST_RATIO:
        warnings(
            _where(authored("pixelAspectRatio")), f"holds {pixel_aspect:g}; {ITS_DEFAULT}, 1 (author a ratio above 0)"
        )
        pixel_aspect = 1.0
    chosen = authored("aspectRatioConformPolicy")
    policy = text_at(chosen, EARLIEST) if chosen else POLICIES[0]
    if policy not in POLICIES:
        warnings(_where(chosen), f"knows no {policy!r}; {POLICIES[0]} is used")
        policy = POLICIES[0]
    window = tuple(map(float, value("dataWindowNDC", WHOLE)))
    if not (np.isfinite(window).all() and window[0] < window[2] and window[1] < window[3]):
        warnings(_where(authored("dataWindowNDC")), "holds no window: the whole image is rendered")
        window = WHOLE
    cameras = [camera for base in prims for camera in base.GetCameraRel().GetForwardedTargets()]
    purposes = settings.GetIncludedPurposesAttr()
    materials = settings.GetMaterialBindingPurposesAttr()
    order = texts_at(materials) if materials.HasAuthoredValue() else ("full",)
    return RenderRequest(
        str(settings.GetPath()),
        str(cameras[0]) if cameras else "",
        resolution,
        pixel_aspect,
        policy,
        bool(value("disableMotionBlur", False)) or bool(value("instantaneousShutter", False)),
        texts_at(purposes) if purposes.HasAuthoredValue() else None,
        order[0] if order else "",
        window,
        tuple((str(found.GetPath()), name) for found, name in zip(products, names, strict=True)),
        () if product is None else _render_vars(stage, product),
    )


def conformed(
    window: tuple[float, float, float, float], aspect: float, policy: str
) -> tuple[float, float, float, float]:
    """A window (left, right, bottom, top) fitted to an image's aspect about its centre.

    Args:
        window: The camera's own window.
        aspect: Width of the image over its height.
        policy: One of :data:`POLICIES`; ``adjustPixelAspectRatio`` leaves the window as it is.
    """
    left, right, bottom, top = window
    width, height = right - left, top - bottom
    wider = aspect > width / height
    if policy == "adjustPixelAspectRatio":
        return window
    by_width = {
        "expandAperture": wider,
        "cropAperture": not wider,
        "adjustApertureWidth": True,
        "adjustApertureHeight": False,
    }[policy]
    if by_width:
        width = height * aspect
    else:
        height = width / aspect
    x, y = 0.5 * (left + right), 0.5 * (bottom + top)
    return x - 0.5 * width, x + 0.5 * width, y - 0.5 * height, y + 0.5 * height


def _products(stage: Usd.Stage, settings: UsdRender.Settings) -> list[UsdRender.Product]:
    targets = settings.GetProductsRel().GetForwardedTargets()
    return [product for path in targets if (product := UsdRender.Product(stage.GetPrimAtPath(path)))]


def _names_of(products: list[UsdRender.Product]) -> list[str]:
    """Names of products: of their files, where these differ, and else of their prims."""
    files = [text_at(product.GetProductNameAttr(), EARLIEST) for product in products]
    stems = [re.sub(r"[.#]*#[.#]*|[._]+$", "", PurePosixPath(file).stem) for file in files]
    if all(stems) and len(set(stems)) == len(stems):
        return stems
    names = [product.GetPrim().GetName() for product in products]
    if len(set(names)) == len(names):
        return names
    return [str(product.GetPath()).strip("/").replace("/", "_") for product in products]


def _chosen(
    products: list[UsdRender.Product], names: list[str], wanted: str, warnings: WarnOnce
) -> UsdRender.Product | None:
    """The product of this path or name; without one the first that is an image, or the first."""
    types = [text_at(product.GetProductTypeAttr(), EARLIEST) or RASTER for product in products]
    number = next((k for k, type in enumerate(types) if type == RASTER), 0)
    if wanted and wanted != EACH_PRODUCT:
        called = [
            (str(product.GetPath()), product.GetPrim().GetName(), name)
            for product, name in zip(products, names, strict=True)
        ]
        known = [k for k, by in enumerate(called) if wanted in by]
        if not known:
            raise InputError(f"no such product (there are {', '.join(names) or 'none'})", warnings.file, wanted)
        number = known[0]
    elif wanted != EACH_PRODUCT:
        for extra in products[:number] + products[number + 1 :]:
            warnings(
                str(extra.GetPath()),
                "is left out: one product of the render settings is rendered, the first that is an image "
                f"(choose with --product, or write {EACH_PRODUCT} in the name of the image for all)",
            )
    if not products:
        return None
    if types[number] != RASTER:
        where = f"{products[number].GetPath()}.productType"
        warnings(where, f"is {types[number]}, which is not written: it is rendered as an image of one depth")
    return products[number]


def _render_vars(stage: Usd.Stage, product: UsdRender.Product) -> tuple[str, ...]:
    """What the RenderVars of a product are called, but the beauty."""
    found = []
    for path in product.GetOrderedVarsRel().GetForwardedTargets():
        var = UsdRender.Var(stage.GetPrimAtPath(path))
        if var:
            found.append(text_at(var.GetSourceNameAttr(), EARLIEST) or var.GetPrim().GetName())
    return tuple(name for name in found if name.lower() not in BEAUTY)


def _where(attribute: Usd.Attribute | None) -> str:
    return "" if attribute is None else str(attribute.GetPath())
