"""Estimators of caustic irradiance, by the name users give them."""

from __future__ import annotations

from tpdwarp.estimators.accumulation import Accumulation
from tpdwarp.estimators.distribution import Distribution
from tpdwarp.estimators.estimator import Estimator
from tpdwarp.estimators.static import Static
from tpdwarp.estimators.temporal import Temporal
from tpdwarp.estimators.time_dependent import TimeDependent

ESTIMATORS: dict[str, type[Estimator]] = {
    "tpd": Temporal,
    "pd": Static,
    "tdpm": TimeDependent,
    "accumulation": Accumulation,
    "distribution": Distribution,
}
