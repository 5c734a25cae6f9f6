"""What programs that write stages mean by values that USD defines otherwise."""

from __future__ import annotations

import re

from pxr import Usd

# Blender's own name for itself in the layers that it writes.
_BLENDER = re.compile(r"Blender v([5-9]|\d\d)\b")
# Blender 5 writes a sun of s W/m² and the angle a as a DistantLight of the intensity s/4 and the angle a/2, and reads
# such lights back so (found by exports and imports of Blender 5.0.1).
BLENDER_SUN, BLENDER_ANGLE = 4.0, 2.0
# The temperature that is white there; in USD it is (1.04, 0.98, 1.03).
BLENDER_WHITE = 6500.0


def is_of_blender(prim: Usd.Prim) -> bool:
    """Whether a prim is defined in a layer that Blender wrote."""
    stack = prim.GetPrimStack()
    return bool(stack) and _BLENDER.match(stack[-1].layer.documentation) is not None
