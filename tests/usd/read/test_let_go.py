"""A stage is let go of as its render ends: whoever writes its file anew and renders again sees what it holds then."""

import gc

import pytest
from pxr import Sdf

import tpdwarp
from tpdwarp.io.images import read_image
from tpdwarp.settings import Settings
from tpdwarp.usd.read.stage import StageScene

STAGE = """#usda 1.0
( upAxis = "Z" )
def Xform "World"
{
    def Mesh "Floor"
    {
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points = [(-2, -2, 0), (2, -2, 0), (2, 2, 0), (-2, 2, 0)]
        color3f[] primvars:displayColor = [(COLOR)]
        uniform token subdivisionScheme = "SCHEME"
    }
    def Sphere "Ball"
    {
        double3 xformOp:translate = (0, 0, 1)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def Mesh "Broken"
    {
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
        point3f[] points = [(0, 0, 0), (1, 0, nan), (0, 1, 0)]
    }
    def PointInstancer "Many"
    {
        int[] protoIndices = [0, 0]
        point3f[] positions = [(1, 1, 0.5), (-1, 1, 0.5)]
        rel prototypes = </World/Many/Cube>
        def Cube "Cube"
        {
            double size = 0.2
        }
    }
    def DistantLight "Sun"
    {
        float inputs:angle = 0
    }
}
"""


@pytest.fixture
def no_search_for_circles():
    gc.collect()
    gc.disable()
    yield
    gc.enable()


@pytest.mark.parametrize("scheme", ["none", "catmullClark"])
def test_its_layers_are_closed(tmp_path, no_search_for_circles, scheme):
    path = tmp_path / "stage.usda"
    path.write_text(STAGE.replace("COLOR", "1, 1, 1").replace("SCHEME", scheme))
    source = StageScene.open(str(path), Settings())
    for frame in (1.0, 2.0):
        assert len(source.at(source.shutter(frame, Settings())).meshes) > 2
    assert Sdf.Layer.Find(str(path))
    del source
    assert not Sdf.Layer.Find(str(path))


def test_what_is_written_anew_is_rendered(tmp_path, no_search_for_circles):
    path, seen = tmp_path / "stage.usda", []
    for number, color in enumerate(("1, 0, 0", "0, 1, 0")):
        path.write_text(STAGE.replace("COLOR", color).replace("SCHEME", "none"))
        image = tmp_path / f"{number}.exr"
        assert tpdwarp.render(str(path), str(image), frames=1, image_width=16, photons=256, samples=1).ok
        seen.append(image)
    red, green = (read_image(image)[0] for image in seen)
    assert red["R"].max() > red["G"].max() and green["G"].max() > green["R"].max()
