"""RenderSettings: what a stage asks for, and apertures fitted to images."""

import math

import numpy as np
import pytest
from pxr import Gf, UsdGeom, UsdRender

from tests.usd.stages import SmallStage
from tpdwarp.errors import InputError
from tpdwarp.scene.description import Shutter
from tpdwarp.settings import Settings
from tpdwarp.usd.read.render_settings import POLICIES, conformed

WIDE = (-2.0, 4.0, -1.0, 1.0)


@pytest.fixture
def small(tmp_path):
    small = SmallStage(tmp_path)
    small.mesh()
    for name in ("First", "Second"):
        camera = UsdGeom.Camera.Define(small.stage, f"/{name}")
        camera.CreateHorizontalApertureAttr(20.0)
        camera.CreateVerticalApertureAttr(10.0)
        camera.CreateFocalLengthAttr(50.0)
        camera.CreateShutterCloseAttr(0.5)
    return small


def settings_on(small, path="/Render/Settings"):
    found = UsdRender.Settings.Define(small.stage, path)
    small.stage.SetMetadata("renderSettingsPrimPath", path)
    return found


@pytest.mark.parametrize(
    ("policy", "aspect", "window"),
    [
        ("expandAperture", 6.0, (-5.0, 7.0, -1.0, 1.0)),
        ("expandAperture", 1.5, (-2.0, 4.0, -2.0, 2.0)),
        ("cropAperture", 6.0, (-2.0, 4.0, -0.5, 0.5)),
        ("cropAperture", 1.5, (-0.5, 2.5, -1.0, 1.0)),
        ("adjustApertureWidth", 1.5, (-0.5, 2.5, -1.0, 1.0)),
        ("adjustApertureHeight", 6.0, (-2.0, 4.0, -0.5, 0.5)),
        ("adjustPixelAspectRatio", 6.0, WIDE),
    ],
)
def test_policies_fit_the_aperture_about_its_centre(policy, aspect, window):
    assert conformed(WIDE, aspect, policy) == pytest.approx(window, rel=1e-15)


@pytest.mark.parametrize("policy", POLICIES)
def test_an_aperture_of_the_images_aspect_stays_as_it_is(policy):
    assert conformed(WIDE, 3.0, policy) == pytest.approx(WIDE, rel=1e-15)


def test_camera_resolution_and_policy_come_from_the_stages_settings(small):
    found = settings_on(small)
    found.GetCameraRel().SetTargets(["/Second"])
    found.CreateResolutionAttr(Gf.Vec2i(300, 300))
    found.CreateAspectRatioConformPolicyAttr("cropAperture")
    scene = small.open()
    assert (scene.camera_path, scene.resolution()) == ("/Second", (300, 300))
    assert scene.at(Shutter.still(1)).camera.window == pytest.approx((-0.1, 0.1, -0.1, 0.1), rel=1e-6)


def test_authored_values_of_the_product_win_and_others_do_not(small):
    found = settings_on(small)
    found.CreateResolutionAttr(Gf.Vec2i(300, 200))
    found.CreatePixelAspectRatioAttr(2.0)
    product = UsdRender.Product.Define(small.stage, "/Render/Product")
    product.CreateResolutionAttr(Gf.Vec2i(64, 64))
    product.GetCameraRel().SetTargets(["/Second"])
    found.GetProductsRel().SetTargets(["/Render/Product"])
    scene = small.open()
    assert (scene.camera_path, scene.resolution()) == ("/Second", (64, 64))
    # 64 pixels of aspect 2 are as wide as the 2:1 aperture.
    assert scene.at(Shutter.still(1)).camera.window == pytest.approx((-0.2, 0.2, -0.1, 0.1), rel=1e-6)


def test_settings_are_found_by_path(small):
    UsdRender.Settings.Define(small.stage, "/Render/Other").CreateResolutionAttr(Gf.Vec2i(10, 20))
    assert small.open(camera="/First", render_settings="/Render/Other").resolution() == (10, 20)
    with pytest.raises(InputError, match="/Mesh: is no RenderSettings"):
        small.open(render_settings="/Mesh")


def test_disabled_motion_blur_makes_a_still_unless_asked_otherwise(small):
    settings_on(small).CreateDisableMotionBlurAttr(True)
    scene = small.open(camera="/First")
    assert scene.shutter(2, Settings()) == Shutter.still(2)
    assert scene.shutter(2, Settings(exposure=1.0)) == Shutter(2, 2, 3)


def test_a_camera_of_the_settings_that_is_none_is_refused(small):
    settings_on(small).GetCameraRel().SetTargets(["/Mesh"])
    with pytest.raises(InputError, match="/Mesh: is no camera"):
        small.open()


def test_included_purposes_of_the_settings_count_unless_the_user_names_others(small):
    for purpose in ("proxy", "render"):
        UsdGeom.Imageable(small.mesh(f"/{purpose}")).CreatePurposeAttr(purpose)
    settings_on(small).CreateIncludedPurposesAttr(["default", "proxy"])
    paths = [m.path for m in small.open(camera="/First").at(Shutter.still(1)).meshes]
    assert paths == ["/Mesh", "/proxy"]
    asked = small.open(camera="/First", purposes=("render", "guide"))
    assert [m.path for m in asked.at(Shutter.still(1)).meshes] == ["/Mesh", "/render"]


@pytest.mark.parametrize("resolution", [(0, 10), (10, -1), (2**31 - 1, 2**31 - 1)])
def test_impossible_resolutions_are_ignored(small, resolution):
    made = settings_on(small)
    made.CreateResolutionAttr(Gf.Vec2i(*resolution))
    scene = small.open()
    assert scene.resolution()[0] == 960
    assert any("/Render/Settings.resolution" in line and "is ignored" in line for line in scene.warnings.messages)


@pytest.mark.parametrize("aspect", [0.0, -1.0, math.nan, math.inf])
def test_impossible_pixels_are_square(small, aspect):
    settings_on(small).CreatePixelAspectRatioAttr(aspect)
    scene = small.open()
    assert scene.pixel_aspect == 1.0
    assert any("/Render/Settings.pixelAspectRatio" in line for line in scene.warnings.messages)


@pytest.mark.parametrize(
    ("window", "size", "edges"),
    [
        ((0.0, 0.0, 1.0, 1.0), (40, 20), (0, 40, 0, 20)),
        ((0.0, 0.0, 0.5, 1.0), (20, 20), (0, 20, 0, 20)),
        # From the lower left: the upper quarter is rows 0 … 5.
        ((0.25, 0.75, 1.0, 1.0), (30, 5), (10, 40, 0, 5)),
        ((0.11, 0.0, 0.13, 0.04), (1, 1), (5, 6, 19, 20)),
        ((-1.0, -1.0, 2.0, 0.5), (40, 10), (0, 40, 10, 20)),
    ],
)
def test_the_data_window_is_cut_out_of_the_image(small, window, size, edges):
    found = settings_on(small)
    found.CreateResolutionAttr(Gf.Vec2i(40, 20))
    whole = small.open(camera="/First").at(Shutter.still(1)).camera.window
    found.CreateDataWindowNDCAttr(Gf.Vec4f(*window))
    scene = small.open(camera="/First")
    region = scene.region()
    assert (region.first, region.end, region.above, region.below) == edges
    assert region.size == size and scene.resolution() == (40, 20)
    # The camera is that of the whole image.
    assert scene.at(Shutter.still(1)).camera.window == whole


@pytest.mark.parametrize(
    ("crop", "edges"),
    [
        ((0.0, 0.0, 1.0, 1.0), (0, 40, 0, 20)),
        ((0.25, 0.75, 1.0, 1.0), (10, 40, 0, 5)),
        # Pixels, from the upper left.
        ((10, 0, 40, 5), (10, 40, 0, 5)),
        ((39, 19, 40, 20), (39, 40, 19, 20)),
        ((30, 10, 100, 100), (30, 40, 10, 20)),
    ],
)
def test_a_crop_comes_before_the_stages_data_window(small, crop, edges):
    found = settings_on(small)
    found.CreateResolutionAttr(Gf.Vec2i(40, 20))
    found.CreateDataWindowNDCAttr(Gf.Vec4f(0.0, 0.0, 0.5, 0.5))
    region = small.open(camera="/First", crop=crop).region()
    assert (region.first, region.end, region.above, region.below) == edges


def test_a_crop_outside_of_the_image_is_refused(small):
    settings_on(small).CreateResolutionAttr(Gf.Vec2i(40, 20))
    with pytest.raises(InputError, match="lies outside of the image of 40 × 20"):
        small.open(camera="/First", crop=(40, 0, 50, 10)).region()


@pytest.mark.parametrize("crop", [(0, 0, 1), (0.5, 0, 0.5, 1), (0, 0, np.nan, 1), (0.5, 0, 20, 10), (-1, 0, 9, 9)])
def test_crops_that_mean_nothing_are_refused(crop):
    with pytest.raises(InputError, match="crop"):
        Settings(crop=crop)


def test_a_data_window_of_nothing_is_said_and_the_whole_rendered(small):
    found = settings_on(small)
    found.CreateResolutionAttr(Gf.Vec2i(40, 20))
    found.CreateDataWindowNDCAttr(Gf.Vec4f(0.5, 0, 0.5, 1))
    scene = small.open(camera="/First")
    assert scene.resolution() == (40, 20)
    assert any("dataWindowNDC" in m for m in scene.warnings.messages)


def products(small, files=("", "")):
    found = settings_on(small)
    found.CreateResolutionAttr(Gf.Vec2i(40, 20))
    made = []
    for name, camera, file in zip(("One", "Two"), ("/First", "/Second"), files, strict=True):
        product = UsdRender.Product.Define(small.stage, f"/Render/{name}")
        product.GetCameraRel().SetTargets([camera])
        if file:
            product.CreateProductNameAttr(file)
        made.append(product)
    found.GetProductsRel().SetTargets(["/Render/One", "/Render/Two"])
    made[1].CreateResolutionAttr(Gf.Vec2i(30, 10))
    return made


def test_the_first_product_is_rendered_and_that_is_said(small):
    products(small)
    scene = small.open()
    assert scene.camera_path == "/First" and scene.resolution() == (40, 20)
    assert [m for m in scene.warnings.messages if "/Render/Two" in m] == scene.warnings.messages != []


@pytest.mark.parametrize("wanted", ["/Render/Two", "Two"])
def test_a_product_is_chosen_by_path_or_name(small, wanted):
    products(small)
    scene = small.open(product=wanted)
    assert scene.camera_path == "/Second" and scene.resolution() == (30, 10)
    assert scene.warnings.messages == []


@pytest.mark.parametrize(
    ("files", "names"),
    [
        (("", ""), ("One", "Two")),
        (("out/beauty.####.exr", "out/crop.####.exr"), ("beauty", "crop")),
        (("same.exr", "same.exr"), ("One", "Two")),
        (("a.b.exr", "c.exr"), ("a.b", "c")),
    ],
)
def test_products_are_called_as_their_files_are(small, files, names):
    products(small, files)
    assert small.open().products == (("/Render/One", names[0]), ("/Render/Two", names[1]))
    assert small.open(product=names[1]).camera_path == "/Second"


def test_products_that_are_not_there_are_refused(small):
    with pytest.raises(InputError, match="no RenderSettings"):
        small.open(product="Two")
    products(small)
    with pytest.raises(InputError, match=r"no such product \(there are One, Two\)"):
        small.open(product="Three")


def test_the_vars_of_a_product_are_named_but_for_the_beauty(small):
    one, _ = products(small)
    for name, source in (("color", "Ci"), ("depth", ""), ("Normals", "N")):
        var = UsdRender.Var.Define(small.stage, f"/Render/Vars/{name}")
        if source:
            var.CreateSourceNameAttr(source)
    one.GetOrderedVarsRel().SetTargets([f"/Render/Vars/{name}" for name in ("color", "depth", "Normals")])
    assert small.open().render_vars == ("depth", "N")


def test_the_aspect_of_a_pixel_is_the_one_asked_for_or_that_of_the_fit(small):
    assert small.open().pixel_aspect == 1.0
    settings = settings_on(small)
    settings.CreatePixelAspectRatioAttr(2.0)
    assert small.open().pixel_aspect == 2.0
    settings.CreateResolutionAttr(Gf.Vec2i(100, 100))
    settings.CreateAspectRatioConformPolicyAttr("adjustPixelAspectRatio")
    # An aperture twice as wide as high in a square image.
    assert small.open().pixel_aspect == pytest.approx(2.0)
    settings.GetResolutionAttr().Set(Gf.Vec2i(100, 200))
    assert small.open().pixel_aspect == pytest.approx(4.0)
