"""A stage at its default time: the values that hold apart from all time samples."""

from __future__ import annotations

from pxr import Usd

from tpdwarp.errors import WarnOnce
from tpdwarp.settings import StageSettings
from tpdwarp.usd.read.stage import StageScene


class DefaultTimeScene(StageScene):
    """A :class:`StageScene` whose attributes have their default values at every time code."""

    EDITS_SESSION = True

    def __init__(self, file: str, stage: Usd.Stage, settings: StageSettings, warnings: WarnOnce) -> None:
        pin_default_time(stage)
        super().__init__(file, stage, settings, warnings)


def pin_default_time(stage: Usd.Stage) -> None:
    """Hides all time samples and splines of ``stage`` behind the default values, in its session layer.

    A default in a stronger layer wins over samples in weaker ones. Attributes without a default are blocked: at the
    default time they have no value. Instances that hold samples are expanded, as prototypes cannot be edited.
    """
    stage.SetEditTarget(stage.GetSessionLayer())
    while instances := [prim for prim in stage.TraverseAll() if prim.IsInstance() and _varies(prim.GetPrototype())]:
        for prim in instances:
            prim.SetInstanceable(False)
    for prim in stage.TraverseAll():
        for attribute in _varying(prim):
            value = attribute.Get(Usd.TimeCode.Default())
            if value is None:
                attribute.Block()
            else:
                attribute.Set(value)


def _varying(prim: Usd.Prim) -> list[Usd.Attribute]:
    return [found for found in prim.GetAuthoredAttributes() if found.GetNumTimeSamples() or found.HasSpline()]


def _varies(prototype: Usd.Prim) -> bool:
    return any(_varying(prim) for prim in Usd.PrimRange(prototype, Usd.TraverseInstanceProxies()))
