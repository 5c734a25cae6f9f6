"""The caustic of a travelling sinusoidal water surface on a flat floor, exactly averaged over pixel columns and time.

Collimated light falls straight down on z = h + a cos(k x − φ), φ = k c t + φ₀, and lands on the floor z = 0. The light
between two neighbouring emission points lands between their images; shared out over pixel columns by its cumulative
distribution, it stays finite where branches fold.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Wave:
    """Water under vertical light.

    Attributes:
        wavelength, amplitude: Of the surface, scene units.
        height: Mean level above the floor, scene units.
        ior: Of the water.
        speed: Scene units a frame, towards +x.
        phase: φ₀, radians; a crest is at x = φ₀/k at time 0.
        irradiance: Of the light on a horizontal plane [W/m²].
        fresnel: Whether what is reflected at the surface is missing below.
        vertices: x of the vertices of a mesh between which heights and normals are interpolated linearly, shape [v],
            ascending; None for the smooth surface.
    """

    wavelength: float = 1.3
    amplitude: float = 0.08
    height: float = 1.0
    ior: float = 1.33
    speed: float = 1.3 / 8
    phase: float = 0.0
    irradiance: float = 1.0
    fresnel: bool = True
    vertices: np.ndarray | None = None

    @property
    def wave_number(self) -> float:
        return 2 * math.pi / self.wavelength

    def smooth(self, x: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Height and unit normal (x and z) of the smooth surface, the shape of ``x`` each."""
        angle = self.wave_number * (x - self.speed * t) - self.phase
        slope = -self.amplitude * self.wave_number * np.sin(angle)
        length = np.sqrt(1 + slope**2)
        return self.height + self.amplitude * np.cos(angle), -slope / length, 1 / length

    def surface(self, x: np.ndarray, t: float, motion: str = "smooth") -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Height and unit shading normal (x and z), the shape of ``x`` each.

        Args:
            x: Positions.
            t: Time, frames.
            motion: ``smooth``, or ``linear``: heights and normals interpolated between whole frames.
        """
        at = x if self.vertices is None else self.vertices
        if motion == "smooth":
            values = self.smooth(at, t)
        elif motion == "linear":
            frame = math.floor(t)
            tau = t - frame
            values = tuple(
                (1 - tau) * a + tau * b for a, b in zip(self.smooth(at, frame), self.smooth(at, frame + 1), strict=True)
            )
        else:
            raise ValueError(f"motion is smooth or linear, not {motion!r}")
        if self.vertices is not None:
            values = tuple(np.interp(x, self.vertices, value) for value in values)
        z, nx, nz = values
        length = np.sqrt(nx**2 + nz**2)
        return z, nx / length, nz / length


def landing(x0: np.ndarray, t: float, wave: Wave, motion: str = "smooth") -> np.ndarray:
    """Where on the floor light lands that meets the surface at x0 [n], at time t (frames), shape [n]."""
    z, nx, nz = wave.surface(x0, t, motion)
    # Snell: the tangential part of the direction (0, −1) is divided by the index.
    sideways, down = nx * nz / wave.ior, (nz**2 - 1) / wave.ior
    rest = np.sqrt(1 - sideways**2 - down**2)
    return x0 + z * (sideways - rest * nx) / (rest * nz - down)


def transmittance(x0: np.ndarray, t: float, wave: Wave, motion: str = "smooth") -> np.ndarray:
    """Fresnel transmittance of the surface at x0 [n], or ones, shape [n]."""
    if not wave.fresnel:
        return np.ones(np.shape(x0))
    cos_i = wave.surface(x0, t, motion)[2]
    cos_t = np.sqrt(1 - (1 - cos_i**2) / wave.ior**2)
    perpendicular = (cos_i - wave.ior * cos_t) / (cos_i + wave.ior * cos_t)
    parallel = (wave.ior * cos_i - cos_t) / (wave.ior * cos_i + cos_t)
    return 1 - 0.5 * (perpendicular**2 + parallel**2)


def stretch(x0: np.ndarray, t: float, wave: Wave, motion: str = "smooth") -> np.ndarray:
    """∂x/∂x0 at x0 [n] of a surface without vertices, by a complex step (no cancellation), shape [n].

    Raises:
        ValueError: The wave has vertices, at which the derivative jumps.
    """
    if wave.vertices is not None:
        raise ValueError("the stretch of a meshed wave jumps at its vertices")
    return landing(np.asarray(x0) + 1e-30j, t, wave, motion).imag / 1e-30


def reach(wave: Wave) -> float:
    """An upper bound of |x − x0|."""
    slope = math.atan(wave.amplitude * wave.wave_number)
    deflection = math.tan(slope - math.asin(math.sin(slope) / wave.ior))
    return 1.01 * (wave.height + wave.amplitude) * deflection + 1e-9


def branches(x: float, t: float, wave: Wave, motion: str = "smooth", samples: int = 4096) -> np.ndarray:
    """All x0 whose light lands at x at time t, ascending, shape [b]; pairs closer than the samples are missed."""
    x0 = np.linspace(x - reach(wave), x + reach(wave), samples)
    side = landing(x0, t, wave, motion) > x
    crossed = np.flatnonzero(side[1:] != side[:-1])
    low, high, start = x0[crossed], x0[crossed + 1], side[crossed]
    for _ in range(60):
        middle = 0.5 * (low + high)
        same = (landing(middle, t, wave, motion) > x) == start
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return 0.5 * (low + high)


def irradiance(x: np.ndarray, t: float, wave: Wave, motion: str = "smooth") -> np.ndarray:
    """Point values Σ_branches E0 T/|∂x/∂x0| on the floor at x [m] and time t, shape [m] (infinite at a fold)."""
    values = []
    for at in np.atleast_1d(x):
        x0 = branches(float(at), t, wave, motion)
        values.append(np.sum(transmittance(x0, t, wave, motion) / np.abs(stretch(x0, t, wave, motion))))
    return wave.irradiance * np.array(values)


def column_irradiance(
    pixel_edges: np.ndarray, t: float, wave: Wave, motion: str = "smooth", per_wavelength: int = 4096
) -> np.ndarray:
    """Mean irradiance of each pixel column at one time, shape [m].

    Args:
        pixel_edges: Ascending x of the columns' edges, shape [m+1].
        t: Time, frames.
        wave: Water.
        motion: ``smooth`` or ``linear``.
        per_wavelength: Emission intervals a wavelength.
    """
    edges = np.asarray(pixel_edges, dtype=np.float64)
    start, end = edges[0] - reach(wave), edges[-1] + reach(wave)
    x0 = np.linspace(start, end, max(2, math.ceil((end - start) / wave.wavelength * per_wavelength)) + 1)
    if wave.vertices is not None:
        inside = (wave.vertices > start) & (wave.vertices < end)
        x0 = np.union1d(x0, wave.vertices[inside])
    flux = np.diff(x0) * transmittance(0.5 * (x0[1:] + x0[:-1]), t, wave, motion)
    x = landing(x0, t, wave, motion)
    low, high = np.minimum(x[1:], x[:-1]), np.maximum(x[1:], x[:-1])
    # Intervals that fold onto a point keep a width, far below any pixel, so that their density stays finite.
    high = np.maximum(high, low + 1e-9 * wave.wavelength)
    density = flux / (high - low)
    landed = _ramps(edges, low, density) - _ramps(edges, high, density)
    return wave.irradiance * np.diff(landed) / np.diff(edges)


def _ramps(at: np.ndarray, starts: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """Σ_i slope_i max(0, at − start_i), the shape of ``at``."""
    order = np.argsort(starts)
    starts, slopes = starts[order], slopes[order]
    count = np.searchsorted(starts, at)
    sums = np.concatenate([[0.0], np.cumsum(slopes)])
    moments = np.concatenate([[0.0], np.cumsum(slopes * starts)])
    return sums[count] * at - moments[count]


def irradiance_average(
    pixel_edges: np.ndarray,
    wave: Wave,
    open: float,
    close: float,
    times: int | np.ndarray = 256,
    motion: str = "smooth",
    per_wavelength: int = 4096,
) -> np.ndarray:
    """Mean irradiance of each pixel column over a shutter, shape [m].

    Args:
        pixel_edges: Ascending x of the columns' edges, shape [m+1].
        wave: Water.
        open, close: Shutter, frames (absolute); equal for a still.
        times: How many times, at the middles of equal parts of the shutter; or the times themselves, shape [k].
        motion: ``smooth``: the wave as it is; ``linear``: interpolated between whole frames, as USD does.
        per_wavelength: Emission intervals a wavelength.
    """
    if isinstance(times, int):
        count = times if close > open else 1
        times = open + (close - open) * (np.arange(count) + 0.5) / count
    return np.mean([column_irradiance(pixel_edges, float(t), wave, motion, per_wavelength) for t in times], axis=0)
