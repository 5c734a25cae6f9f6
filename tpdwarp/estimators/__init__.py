"""Estimators of caustic irradiance, by the name users give them."""

from __future__ import annotations

from tpdwarp.estimators.accumulation import Accumulation
from tpdwarp.estimators.distribution import Distribution
from tpdwarp.estimators.estimator import Estimator
from tpdwarp.estimators.seen_light import SeenLight
from tpdwarp.estimators.static import Static
from tpdwarp.estimators.temporal import Temporal
from tpdwarp.estimators.time_dependent import TimeDependent
from tpdwarp.settings import LightSettings

ESTIMATORS: dict[str, type[Estimator]] = {
    "tpd": Temporal,
    "pd": Static,
    "tdpm": TimeDependent,
    "accumulation": Accumulation,
    "distribution": Distribution,
}


def estimator_of(settings: LightSettings, seen_light: SeenLight | None = None) -> Estimator:
    """The estimator that the settings name.

    Args:
        seen_light: What is looked at, for those whose photons go where it is; None where light is wanted wherever it
            falls.
    """
    return Temporal(seen_light) if settings.estimator == "tpd" else ESTIMATORS[settings.estimator]()
