"""Light profiles of luminaires in the format of the IES (ANSI/IES LM-63)."""

from __future__ import annotations

import math
import os
import re
from dataclasses import dataclass

import numpy as np

# The photometric type whose angles are those about the axis of the light (θ = 0) and around it (φ).
TYPE_C = 1
# Numbers after TILT and before the angles: lamps, lumens, multiplier, counts of θ and φ, type, unit, width, length,
# height, then the ballast's factor, a reserved one, and watts.
HEADER = 13


@dataclass(frozen=True, eq=False)
class LightProfile:
    """Luminous intensity by direction.

    Attributes:
        theta: Angles from the axis [rad], ascending, shape [v].
        phi: Angles around it [rad], ascending from 0, shape [h]; those up to π/2, or π, stand for their mirror images.
        candela: Luminous intensity, shape [h, v].
    """

    theta: np.ndarray
    phi: np.ndarray
    candela: np.ndarray

    def around(self) -> np.ndarray:
        """The mean around the axis at each of ``theta`` [cd], shape [v]."""
        if len(self.phi) < 2:
            return self.candela[0]
        return np.trapezoid(self.candela, self.phi, axis=0) / (self.phi[-1] - self.phi[0])

    @property
    def is_round(self) -> bool:
        """Whether it is the same all around its axis, within a hundredth of its largest intensity."""
        return bool(np.ptp(self.candela, axis=0).max() <= 0.01 * self.candela.max())

    def at(self, theta: np.ndarray) -> np.ndarray:
        """The mean around the axis at any angles from it [rad]; nothing where the profile says nothing."""
        return np.interp(theta, self.theta, self.around(), left=0.0, right=0.0)

    def mean(self) -> float:
        """The mean over the hemisphere, or the sphere, that it covers [cd]."""
        covered = 0.5 * math.pi if self.theta[-1] <= 0.5 * math.pi + 1e-6 else math.pi
        theta = np.linspace(0.0, covered, 3601)
        sines = np.sin(theta)
        return float(np.trapezoid(self.at(theta) * sines) / np.trapezoid(sines))


def read_profile(path: str | os.PathLike[str]) -> LightProfile | None:
    """The profile in a file; None where there is none that can be read, or one of another photometric type than C."""
    try:
        with open(path, encoding="latin-1") as file:
            return parsed_profile(file.read())
    except (OSError, ValueError, IndexError):
        return None


def parsed_profile(text: str) -> LightProfile:
    """The profile that a file of this content holds.

    Raises:
        ValueError: It holds none that can be read.
        IndexError: It ends too early.
    """
    found = re.search(r"^TILT *= *(.*)$", text, re.MULTILINE)
    if not found:
        raise ValueError("has no line TILT=")
    numbers = [float(word) for word in re.split(r"[\s,]+", text[found.end() :].strip())]
    if found.group(1).strip().upper() == "INCLUDE":
        # How the lamp stands, so many pairs of angles and factors of it: of lamps that burn lower where they lean.
        numbers = numbers[2 + 2 * int(numbers[1]) :]
    _, _, multiplier, rows, columns, kind, _, _, _, _, ballast, _, _ = numbers[:HEADER]
    rows, columns = int(rows), int(columns)
    values = np.array(numbers[HEADER : HEADER + rows + columns + rows * columns])
    if int(kind) != TYPE_C or rows < 2 or columns < 1 or len(values) != rows + columns + rows * columns:
        raise ValueError("is of another photometric type than C, or too short")
    theta, phi = np.radians(values[:rows]), np.radians(values[rows : rows + columns])
    candela = values[rows + columns :].reshape(columns, rows) * (multiplier * ballast)
    if (np.diff(theta) <= 0).any() or (np.diff(phi) <= 0).any() or not (candela >= 0).all() or not candela.max() > 0:
        raise ValueError("holds angles that do not ascend, or no light")
    return LightProfile(theta, phi, candela)
