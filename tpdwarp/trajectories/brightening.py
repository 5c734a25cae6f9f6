"""Lights that change while the shutter is open: photons whose flux follows them.

A footprint's flux goes along a line while the shutter is open. That is enough of a light that brightens a little. Where
a light flashes, fades by stops, or changes its colour, photons are cut into parts of the shutter, each with the flux
that its light has then, and with the line that is nearest; where colours change, for each colour on its own. All
parts of a photon lie on its trajectory, so that nothing is traced again.

Beyond the paper, whose lights do not change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from tpdwarp.photons.light_columns import LightImage
from tpdwarp.photons.photon_map import PhotonMap, TrajectoryColumns
from tpdwarp.photons.power_curves import PowerCurve, PowerPiece
from tpdwarp.photons.vectors import lengths
from tpdwarp.scene.description import LightAtShutter, SceneSource, Shutter

# Powers that differ by less do not: single precision, in which stages store intensities.
SAME_POWER = 1e-6
# On a line, flux that changes by more than this part of its mean would be below zero at one end.
LARGEST_GAIN = 2.0


def power_curves(source: SceneSource, shutter: Shutter, paths: Sequence[str]) -> tuple[PowerCurve | None, ...]:
    """How lights change over ``shutter``; None of those that do not.

    Args:
        source: Whose lights they are.
        shutter: The exposure, or a segment of it.
        paths: Prim paths of the lights.
    """

    def lights_over(begin: float, end: float) -> Sequence[LightAtShutter]:
        opens, closes = (shutter.open + shutter.exposure * part for part in (begin, end))
        return source.at(Shutter(shutter.frame, opens, closes)).lights

    @cache
    def powers(begin: float, end: float) -> np.ndarray:
        return powers_of(lights_over(begin, end), paths)

    @cache
    def extents(begin: float, end: float) -> dict[str, np.ndarray]:
        return {light.path: light.extent.sizes for light in lights_over(begin, end) if light.extent is not None}

    def sized(piece: PowerPiece, path: str) -> PowerPiece:
        begin, end = (0.5 + piece.time + 0.5 * side * piece.duration for side in (-1.0, 1.0))
        now, whole = (found.get(path, np.ones(2)) for found in (extents(begin, end), extents(0.0, 1.0)))
        if np.array_equal(now, whole) or not whole.all():
            return piece
        return replace(piece, image=tuple(map(float, now / whole)))

    def curve(number: int) -> PowerCurve | None:
        found = PowerCurve.of(lambda begin, end: powers(begin, end)[number])
        (first, *others) = found.pieces or (None,)
        if first is None or (not others and first.duration == 1.0 and abs(first.gain) < SAME_POWER):
            return None
        return PowerCurve(tuple(sized(piece, paths[number]) for piece in found.pieces))

    return tuple(curve(number) for number in range(len(paths)))


def lights_change(lights: Sequence[LightAtShutter], others: Sequence[LightAtShutter]) -> bool:
    """Whether some have another power."""
    paths = sorted({light.path for light in (*lights, *others)})
    return not np.allclose(powers_of(lights, paths), powers_of(others, paths), rtol=SAME_POWER, atol=0.0)


def steady_lights(
    lights: Sequence[LightAtShutter], whole: Sequence[LightAtShutter], part: float, duration: float
) -> list[LightAtShutter]:
    """Lights with the power that they have over a longer shutter; those that do not shine meanwhile as they would.

    Args:
        lights: Over part of the shutter.
        whole: Over all of it.
        part: Where the middle of the part lies, −½ … ½.
        duration: Its length.
    """
    found = {light.path: light for light in lights}
    steady = []
    for light in whole:
        there = found.get(light.path)
        steady.append(_at_part(light, part, duration) if there is None else replace(there, power=light.power))
    return steady


def _at_part(light: LightAtShutter, part: float, duration: float) -> LightAtShutter:
    """A light of a whole shutter over a part of it, through which it moves steadily."""
    axes = light.axes + part * light.axes_motion
    return replace(
        light,
        position=light.position + part * light.position_motion,
        axes=axes / np.linalg.norm(axes, axis=1, keepdims=True),
        position_motion=duration * light.position_motion,
        axes_motion=duration * light.axes_motion,
    )


def follow_lights(photons: PhotonMap) -> list[PhotonMap]:
    """Photons in the parts of the shutter that the curves of their lights ask for: the same light, as it changes."""
    if not any(photons.power_curves):
        return [photons]
    found = []
    for number, curve in enumerate(photons.power_curves):
        rows = photons.light == number
        if not rows.any():
            continue
        own = replace(photons.rows(rows), power_curves=())
        if curve is None:
            found.append(own)
            continue
        for piece in curve.pieces:
            part = over_piece(own, piece.time, piece.duration, piece.power, piece.gain, piece.center)
            found.append(part if piece.image == (1.0, 1.0) else _with_image(part, piece.image))
    return found


def _with_image(photons: PhotonMap, sizes: tuple[float, float]) -> PhotonMap:
    """Photons of a light that is by ``sizes`` as large along a and b as what they were traced with."""
    if not len(photons.image):
        return photons
    # Lobes of rough surfaces took up the image.
    of_light = (photons.image != int(LightImage.LOBE))[:, None]
    a, b = (np.where(of_light, np.float32(size), np.float32(1.0)) for size in sizes)
    return replace(photons, dxda=a * photons.dxda, dxdb=b * photons.dxdb)


def powers_of(lights: Sequence[LightAtShutter], paths: Sequence[str]) -> np.ndarray:
    """The power of lights by their paths, nothing of those that do not shine, shape [n, 3]."""
    total: dict[str, np.ndarray] = {}
    for light in lights:
        total[light.path] = total.get(light.path, 0.0) + np.array(light.power, np.float64)
    return np.array([total.get(path, np.zeros(3)) for path in paths]).reshape(-1, 3)


def gained_flux(photons: PhotonMap) -> float:
    """By how much more light photons carry whose flux grows while that of their light does.

    The mean of the product of two lines is not that of the means: what comes nearer to a lamp as it brightens catches
    more of its light.
    """
    gained = 0.0
    for number, curve in enumerate(photons.power_curves):
        if curve is not None:
            rows = photons.light == number
            growing = (photons.flux[rows] * photons.trajectory.gain[rows, None]).sum(axis=0, dtype=np.float64)
            gained += float(growing @ sum(piece.power * piece.duration * piece.center for piece in curve.pieces))
    return gained


def over_piece(
    photons: PhotonMap, time: float, duration: float, flux: np.ndarray, gain: np.ndarray | float, center: float = 0.0
) -> PhotonMap:
    """Photons over a part of the time for which they shine, with the flux that they have then.

    Args:
        photons: They, with trajectories.
        time, duration: Middle, −½ … ½, and length of the part, of the time for which they shine.
        flux: By what their flux is multiplied meanwhile, beside its own gain: [3], or [n, 1].
        gain: Change of that over the part, as a part of it: a number, or [n].
        center: The time of its light on average.
    """
    late, part = np.float32(time), np.float32(duration)
    curve = photons.trajectory
    grown = 1.0 + late * curve.gain
    mean = 1.0 + np.float32(center) * curve.gain
    flux = part * flux.astype(np.float32) * mean[:, None]
    gain = part * curve.gain / grown + np.float32(gain)
    rates = [curve.dxdut, curve.dxdvt]
    if late:
        rates = [_limited(rate, column) for rate, column in zip(rates, (photons.dxdu, photons.dxdv), strict=True)]
    return replace(
        photons,
        position=photons.position + late * (photons.dxdt + late / 2 * (curve.dxdtt + late / 3 * curve.dxdttt)),
        dxdt=part * (photons.dxdt + late * (curve.dxdtt + late / 2 * curve.dxdttt)),
        dxdu=photons.dxdu + late * rates[0],
        dxdv=photons.dxdv + late * rates[1],
        receiver_motion=part * photons.receiver_motion,
        flux=photons.flux * flux,
        trajectory=TrajectoryColumns(
            part**2 * (curve.dxdtt + late * curve.dxdttt),
            part**3 * curve.dxdttt,
            part * rates[0],
            part * rates[1],
            np.clip(gain, -LARGEST_GAIN, LARGEST_GAIN),
        ),
        time=photons.time + photons.duration * time,
        duration=photons.duration * duration,
    )


def _limited(rate: np.ndarray, column: np.ndarray) -> np.ndarray:
    """The rate of a column [n, 3], no larger than lets it change by half to either end of the shutter, as footprints
    do."""
    size, length = lengths(rate), lengths(column)
    return rate * np.divide(length, size, out=np.ones_like(size), where=size > length)[:, None]
