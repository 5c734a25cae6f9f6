import numpy as np
import pytest

from tpdwarp.jobs.energy_warnings import EnergyWatch
from tpdwarp.photons.energy import COARSE_PARTS, FEWEST_OF_SEVERAL, STARVED, EnergyAccount
from tpdwarp.scene.description import Interaction, Material, MeshAtShutter, SceneAtShutter, Shutter

SHUTTER = Shutter.still(1.0)


class Source:
    file = "scene.usda"

    def __init__(self, interaction):
        self.reads = 0
        triangle = np.eye(3), np.array([[0, 1, 2]], np.int32)
        self.mesh = MeshAtShutter("/Mesh", *triangle, materials=(Material(interaction),))

    def at(self, shutter):
        self.reads += 1
        return SceneAtShutter(shutter, (self.mesh,), ())


@pytest.mark.parametrize(("lost", "warned"), [(0.9, False), (1.1, True)])
def test_the_limit_of_loss_is_a_hundredth_of_what_was_sent(caplog, lost, warned):
    source = Source(Interaction.DIELECTRIC)
    EnergyWatch(source)(1.0, SHUTTER, EnergyAccount(sent=100.0, deposited=50.0, lost={"bounces": lost}))
    assert bool(caplog.records) == warned and source.reads == 0


def test_loss_without_anything_sent_is_no_share(caplog):
    EnergyWatch(Source(Interaction.DIELECTRIC))(1.0, SHUTTER, EnergyAccount(lost={"bounces": 1.0}))
    assert not caplog.records


@pytest.mark.parametrize(
    ("interaction", "warned"), [(Interaction.DIFFUSE, 1), (Interaction.MIRROR, 0), (Interaction.DIELECTRIC, 0)]
)
def test_only_a_scene_without_specular_surfaces_can_have_no_caustic(caplog, interaction, warned):
    source = Source(interaction)
    watch = EnergyWatch(source)
    for frame in (1.0, 2.0):
        watch(frame, SHUTTER, EnergyAccount())
    assert [record.getMessage().split(" has ")[0] for record in caplog.records] == ["scene.usda: frame 1"] * warned
    assert source.reads == 1


@pytest.mark.parametrize(("interaction", "warned"), [(Interaction.DIFFUSE, 0), (Interaction.MIRROR, 1)])
def test_light_that_lands_nowhere_wants_a_diffuse_surface_and_says_so_once(caplog, interaction, warned):
    watch = EnergyWatch(Source(interaction))
    for frame in (1.0, 2.0):
        watch(frame, SHUTTER, EnergyAccount(sent=100.0, escaped=100.0))
    assert [("no diffuse surface" in record.getMessage()) for record in caplog.records] == [True] * warned


def test_starved_lights_are_warned_about_once_with_their_number(caplog):
    watch = EnergyWatch(Source(Interaction.DIELECTRIC))
    for frame in (1.0, 2.0):
        watch(frame, SHUTTER, EnergyAccount(sent=1.0, deposited=1.0, counts={STARVED: 2}))
    (record,) = caplog.records
    assert f"2 have fewer than {FEWEST_OF_SEVERAL} photons" in record.getMessage()


def test_too_few_parts_of_a_light_are_warned_about_once_with_what_they_err_by(caplog):
    watch = EnergyWatch(Source(Interaction.DIELECTRIC))
    for frame in (1.0, 2.0):
        watch(frame, SHUTTER, EnergyAccount(sent=1.0, deposited=1.0, counts={COARSE_PARTS: 278}))
    (record,) = caplog.records
    assert "to err by 28%" in record.getMessage() and "--light-splits" in record.getMessage()
