"""Materials: a dialect's inputs, read to one physical description, mapped to the interactions that are rendered."""

from tpdwarp.usd.read.materials.reader import BRIGHTEST, DISPLAY_COLOR, Materials, Surface

__all__ = ["BRIGHTEST", "DISPLAY_COLOR", "Materials", "Surface"]
