"""The kernels that a frame ends with, compiled while its photons are traced where they have not been yet."""

from __future__ import annotations

from tpdwarp.device import Launcher
from tpdwarp.footprints.gather import gather_kernel
from tpdwarp.footprints.lanes import lanes_of
from tpdwarp.footprints.weights import GatherForm
from tpdwarp.scene.device.loading import LoadedScene
from tpdwarp.settings import Settings
from tpdwarp.view.film import wants_motion
from tpdwarp.view.visibility import kernel_for


def prepare_kernels(loaded: LoadedScene, settings: Settings, launcher: Launcher) -> None:
    """Has the two largest of them compiled: the one that follows camera paths, and the one that adds up footprints.

    A stage may want others after all, which shows once its photons are traced; these are compiled then.

    Args:
        loaded: A scene of the animation.
        settings: How it is rendered.
        launcher: The device.
    """
    needs = loaded.requirements
    launcher.prepare(kernel_for(needs, needs.view_motion, settings.aovs))
    form = GatherForm(settings.kernel, settings.footprint, settings.time_filter, needs.light_columns)
    curved = needs.photon_motion and form.smooth and settings.path == "curved" and settings.trace_at != "open"
    moves, shaded = needs.photon_motion, needs.smooth_receivers
    with_motion = wants_motion(settings.aovs)
    launcher.prepare(gather_kernel(form, lanes_of(launcher), moves, curved, shaded, False, with_motion))
