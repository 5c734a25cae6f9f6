"""Warnings about light that is lost, or that no surface focuses, once for a sequence."""

from __future__ import annotations

from tpdwarp.errors import logger
from tpdwarp.io.frame_names import frame_text
from tpdwarp.photons.energy import COARSE_PARTS, FEWEST_OF_SEVERAL, STARVED, EnergyAccount
from tpdwarp.scene.description import Interaction, SceneSource, Shutter
from tpdwarp.scene.requirements import requirements_of

# Part of the flux sent that may be lost without a warning. Chosen, not derived: it shows as 1 % of the caustic.
LOST_SHARE = 0.01


class EnergyWatch:
    """Looks at the energy account of each frame.

    Args:
        source: The scene that is traced.
    """

    def __init__(self, source: SceneSource) -> None:
        self._source = source
        self._warned_of_loss = self._warned_of_no_caustic = self._warned_of_starving = False
        self._warned_of_no_receiver = self._warned_of_parts = False

    def __call__(self, frame: float, shutter: Shutter, energy: EnergyAccount) -> None:
        """Warns at the first frame that loses more than 1 % of the flux sent, starved lights, no caustic, or
        lights with extent in a number of parts whose light errs far more than by another.

        There is no caustic without something specular, or something diffuse for light to fall on.
        """
        if not self._warned_of_loss and energy.lost_total > LOST_SHARE * energy.sent > 0:
            self._warned_of_loss = True
            causes = sorted(energy.lost, key=lambda cause: energy.lost[cause], reverse=True)
            shares = ", ".join(f"{cause} {energy.lost[cause] / energy.sent:.1%}" for cause in causes[:3])
            logger.warning(
                f"{self._source.file}: frame {frame_text(frame)} loses {energy.lost_total / energy.sent:.1%} "
                f"of the flux sent ({shares}); the statistics have every frame"
            )
        starved = energy.counts.get(STARVED, 0)
        if starved and not self._warned_of_starving:
            self._warned_of_starving = True
            logger.warning(
                f"{self._source.file}: frame {frame_text(frame)}: of several lights, {starved} "
                f"{'has' if starved == 1 else 'have'} fewer than {FEWEST_OF_SEVERAL} photons, too few to show what is "
                "focused (raise --photons)"
            )
        error = energy.counts.get(COARSE_PARTS, 0)
        if error and not self._warned_of_parts:
            self._warned_of_parts = True
            logger.warning(
                f"{self._source.file}: frame {frame_text(frame)}: light of lights with extent is foreseen to err by "
                f"{error / 1000.0:.0%} in as many parts as were asked for (leave out --light-splits)"
            )
        # Only a frame to which no flux was sent can lack a specular surface, so that most scenes are not read twice.
        if not self._warned_of_no_caustic and energy.sent == 0:
            if not requirements_of(self._source.at(shutter)).caustics:
                logger.warning(
                    f"{self._source.file}: frame {frame_text(frame)} has no surface that reflects or refracts, "
                    "so there can be no caustic (bind a material with opacity 0, or with metallic 1 and roughness 0)"
                )
            self._warned_of_no_caustic = True
        if not self._warned_of_no_receiver and energy.sent > 0 and energy.deposited == 0:
            meshes = self._source.at(shutter).meshes
            if not any(material.interaction == Interaction.DIFFUSE for mesh in meshes for material in mesh.materials):
                logger.warning(
                    f"{self._source.file}: frame {frame_text(frame)} has no diffuse surface, so light of photons stays "
                    "nowhere (add a floor, or whatever the caustic is to fall on)"
                )
            self._warned_of_no_receiver = True
