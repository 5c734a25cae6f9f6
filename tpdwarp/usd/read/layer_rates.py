"""Rates of layers that USD cannot compose: where one layer has no time codes in a second, or no number of them, and
another has, USD looks for the time samples between them for ever."""

from __future__ import annotations

from collections.abc import Sequence

from pxr import Sdf, Usd

from tpdwarp.errors import InputError, WarnOnce
from tpdwarp.usd.read.values import ITS_DEFAULT

# Rates that count, and the one that counts for others.
HIGHEST_RATE = 1e6
DEFAULT_RATE = 24.0


def is_rate(value: float) -> bool:
    """Whether so many time codes or frames in a second mean anything."""
    return 1 / HIGHEST_RATE <= value <= HIGHEST_RATE


def rate_or_default(name: str, value: float, warnings: WarnOnce) -> float:
    """A rate, or the default for one that means nothing, which is said of ``name``."""
    if is_rate(value):
        return value
    wanted = f"author a rate above 0, at most {HIGHEST_RATE:g}"
    warnings(name, f"holds {value:g}; {ITS_DEFAULT}, {DEFAULT_RATE:g} ({wanted})")
    return DEFAULT_RATE


def mend_rates(layers: Sequence[Sdf.Layer], warnings: WarnOnce) -> None:
    """Takes rates that mean nothing from layers in memory, before a stage is composed of them; files stay as they are.

    Args:
        layers: The layers, the root layer first.
        warnings: Takes what is taken.
    """
    for layer in layers if len(layers) > 1 else ():
        # Its frames per second stand in for time codes where it has none.
        if is_rate(layer.timeCodesPerSecond):
            continue
        of = "the stage's" if layer is layers[0] else f"layer {layer.identifier}:"
        rate_or_default(f"{of} timeCodesPerSecond", layer.timeCodesPerSecond, warnings)
        allowed = layer.permissionToEdit
        layer.SetPermissionToEdit(True)
        layer.timeCodesPerSecond = DEFAULT_RATE
        layer.SetPermissionToEdit(allowed)


def check_rates(stage: Usd.Stage, file: str) -> None:
    """Refuses a stage of layers that belong to someone else, where :func:`mend_rates` would have to change one.

    Raises:
        InputError: A rate means nothing, and there are other layers.
    """
    layers = [layer for layer in stage.GetUsedLayers() if layer != stage.GetSessionLayer()]
    for layer in layers if len(layers) > 1 else ():
        if not is_rate(layer.timeCodesPerSecond):
            raise InputError(
                f"layer {layer.identifier} holds {layer.timeCodesPerSecond:g} time codes per second, with which no "
                f"other layer can be composed (author a rate above 0, at most {HIGHEST_RATE:g})",
                file,
            )
