"""Channel groups of an image: the beauty, its alpha, and each AOV."""

from __future__ import annotations

from collections.abc import Sequence

from tpdwarp.checks.limits import BEAUTY

ALPHA = "alpha"


def channel_groups(names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Channels by group: ``R,G,B`` are the beauty, ``A`` is ``alpha``, ``caustic.R`` belongs to ``caustic``.

    Alpha stands alone, for its many ones would make every difference of the colours look small.
    """
    groups: dict[str, list[str]] = {}
    for name in names:
        group = BEAUTY if name in ("R", "G", "B") else ALPHA if name == "A" else name.rpartition(".")[0] or name
        groups.setdefault(group, []).append(name)
    return {group: tuple(channels) for group, channels in groups.items()}


def is_color(channels: Sequence[str]) -> bool:
    """Whether a group's channels are red, green and blue, in this order."""
    return tuple(name.rpartition(".")[2] for name in channels) == ("R", "G", "B")
