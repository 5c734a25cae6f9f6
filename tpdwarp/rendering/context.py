"""What stays the same from frame to frame: device, units, emission lattices, segments."""

from __future__ import annotations

from copy import copy

from tpdwarp.device import Launcher
from tpdwarp.photons.tracer import PhotonTracer
from tpdwarp.rendering.light_groups import LightGroups
from tpdwarp.scene.description import SceneSource
from tpdwarp.scene.device.loading import SceneLoader
from tpdwarp.settings import Settings
from tpdwarp.trajectories.light_splits import best_split_count
from tpdwarp.trajectories.segments import Segmentation


class RenderContext:
    """One animation with the settings that it is rendered with; whoever renders several frames keeps one.

    Args:
        source: Where scenes come from.
        settings: How to render.
        loader: Loads the scenes; None makes one for the device that the settings name.

    Raises:
        InputError: The device does not exist, or none of the source's reference scenes can be used.
    """

    def __init__(self, source: SceneSource, settings: Settings, loader: SceneLoader | None = None) -> None:
        self.source, self.settings = source, settings
        self.loader = loader or SceneLoader(source, Launcher(settings.device, settings.threads), settings.bounces)
        self.launcher, self.normalization = self.loader.launcher, self.loader.normalization
        self.tracer = PhotonTracer(self.loader, settings, best_split_count)
        self.segmentation = Segmentation(self.tracer)
        self.light_groups = LightGroups.of(settings.light_groups, source)

    def with_settings(self, settings: Settings) -> RenderContext:
        """The same animation with other photons, segments or AOVs; stills are not read again."""
        other = copy(self)
        other.settings = settings
        other.tracer = self.tracer.with_settings(settings)
        other.segmentation = Segmentation(other.tracer)
        other.light_groups = LightGroups.of(settings.light_groups, self.source)
        return other
