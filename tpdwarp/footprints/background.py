"""Background light: footprints so faint that none of them is told apart, shaped for coarse squares.

Closed glass sends much of its light through inner reflections, each a few percent of a photon, spread over most of a
floor: nine tenths of what footprints cover belongs to two or three percent of the flux. At any time the footprints of
one path tile the receiver, and their sum is as bright as each of them, Φ/|D_u x × D_v x|. So where that is far less
than what nearly all other light makes, its detail cannot matter, and the footprint is averaged over squares that are
larger than pixels, but small beside what it sweeps over itself; under lights with extent, beside their images.

Only flat receivers that stand still have background light: there squares make a raster (``rasters``). What is bright
goes there, too, where it is wide (``wide``), but with squares that change nothing of it.

Beyond the paper.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.footprints.bspline import SUPPORT
from tpdwarp.footprints.light_images import images_of, spline_over_image
from tpdwarp.footprints.photon_rows import PhotonRows, stacked
from tpdwarp.footprints.planes import Plane, on_any, planes_of
from tpdwarp.footprints.shaping import (
    LightImageArrays,
    PixelSize,
    cell_in_frame,
    light_on_plane,
    out_of_frame,
    pixel_on_plane,
    tangent_frame,
)
from tpdwarp.photons.light_columns import IMAGE_NONE
from tpdwarp.photons.photon_map import PhotonMap

# Photons of less than this part of the irradiance that all but a tenth of the flux exceeds are background.
# Chosen with ``scripts/benchmarks/solids.py``: ball, torus and blob err by .0173, .0255 and .1046 of their means with
# an eighth, by .0174, .0256 and .1045 without any background.
FAINT = 1.0 / 8.0
FAINT_QUANTILE = 0.1
# Squares that a background footprint covers at least: those of one at rest are at most 3/8 of a cell wide, and add
# side²/6 to the cell²/4 by which a B-spline blurs: a tenth of it. One that moves is blurred by its motion besides.
FEWEST_SQUARES = wp.constant(64.0)
# Squares across the narrow side of what one sweeps over: with fewer, light beside a focus leaks out of the lines that
# converge there. Chosen, not derived: a small lens on a floor 300 times as large showed .0080 for .0030 in a pixel
# beside the focus without, .0043 with eight, which made the torus of scripts/benchmarks/solids.py take half as long
# again.
FEWEST_ACROSS = wp.constant(4.0)
# Squares are powers of two in the tracer's units, and no finer than this, which bounds what numbers them.
FINEST_SQUARE = wp.constant(2.0**-11)
COARSEST_SQUARE = wp.constant(2.0**-3)
# Squares so many pixels wide at least gain anything beside gathering at each pixel.
FEWEST_PIXELS = wp.constant(1.5)
# Cells that a footprint of the B-spline reaches over.
CELLS = wp.constant(2.0 * SUPPORT)


@dataclass
class SplitLight:
    """Photons by how their light is looked up.

    Attributes:
        fine: Those whose footprints are gathered at every query.
        coarse: Those of the background, by the side of their squares.
        planes: Where those of the background landed.
    """

    fine: list[PhotonMap]
    coarse: dict[float, list[PhotonMap]] = field(default_factory=dict)
    planes: list[Plane] = field(default_factory=list)


@wp.kernel(enable_backward=False)
def measure_light(
    base: int,
    # In
    position: wp.array(dtype=wp.vec3),
    normal: wp.array(dtype=wp.vec3),
    dxdu: wp.array(dtype=wp.vec3),
    dxdv: wp.array(dtype=wp.vec3),
    dxdt: wp.array(dtype=wp.vec3),
    flux: wp.array(dtype=wp.vec3),
    images: LightImageArrays,
    smoothing: float,
    pixel: PixelSize,
    # Out
    brightness: wp.array(dtype=wp.float32),
    squares: wp.array(dtype=wp.float32),
):
    """How bright footprints are while they shine, and the largest squares that they cover enough of; 0 for none.

    Under lights with extent they are as wide as with the images of these. The area of a swept parallelogram is
    |a × b| + |a × c| + |b × c|, and it is narrowest across one of the three.
    """
    i = base + wp.tid()
    frame = tangent_frame(normal[i])
    u = dxdu[i]
    v = dxdv[i]
    light = int(IMAGE_NONE)
    if images.image.shape[0] > 0:
        light = images.image[i]
    if light != IMAGE_NONE:
        w = spline_over_image(cell_in_frame(frame, u, v), light_on_plane(images, i, frame))
        u = out_of_frame(frame, wp.vec2(w[0, 0], w[1, 0]))
        v = out_of_frame(frame, wp.vec2(w[0, 1], w[1, 1]))
    u *= CELLS * smoothing
    v *= CELLS * smoothing
    area = wp.length(wp.cross(u, v))
    brightness[i] = (flux[i][0] + flux[i][1] + flux[i][2]) / wp.max(area, 1.0e-30)
    over_u = wp.length(wp.cross(u, dxdt[i]))
    over_v = wp.length(wp.cross(v, dxdt[i]))
    across = wp.min((area + over_u) / wp.max(wp.length(u), 1.0e-15), (area + over_v) / wp.max(wp.length(v), 1.0e-15))
    if wp.length(dxdt[i]) > 1.0e-15:
        across = wp.min(across, (over_u + over_v) / wp.length(dxdt[i]))
    largest = wp.min(wp.sqrt((area + over_u + over_v) / FEWEST_SQUARES), across / FEWEST_ACROSS)
    on_plane = pixel_on_plane(pixel, position[i], normal[i], frame)
    pixel_area = wp.abs(on_plane.p[0] * on_plane.q[1] - on_plane.p[1] * on_plane.q[0])
    side = wp.pow(2.0, wp.floor(wp.log2(wp.max(largest, 1.0e-15))))
    squares[i] = 0.0
    if side >= FINEST_SQUARE and side * side >= FEWEST_PIXELS * FEWEST_PIXELS * pixel_area:
        squares[i] = wp.min(side, COARSEST_SQUARE)


def split_light(maps: list[PhotonMap], smoothing: float, pixel: PixelSize, launcher: Launcher) -> SplitLight:
    """Tells photons of the background from others.

    Where no path branches off with so little of its light, there is no background, and nothing is measured.
    """
    if not any((photons.share < FAINT).any() for photons in maps):
        return SplitLight(maps)
    bright, squares = _measured(maps, smoothing, pixel, launcher)
    while_shining = [of_map / photons.duration for photons, of_map in zip(maps, bright, strict=True)]
    brightness = np.concatenate(while_shining)
    flux = np.concatenate([photons.flux.sum(axis=1, dtype=np.float64) for photons in maps])
    limit = FAINT * _exceeded_by_most(brightness, flux)
    out = SplitLight([])
    faint = [
        (shining < limit) & (sides > 0.0) & ~photons.receiver_motion.any(axis=1)
        for photons, shining, sides in zip(maps, while_shining, squares, strict=True)
    ]
    receiver, position, normal = (
        np.concatenate([getattr(photons, name)[rows] for photons, rows in zip(maps, faint, strict=True)])
        for name in ("receiver", "position", "normal")
    )
    out.planes = planes_of(receiver, position, normal)
    for photons, chosen, sides in zip(maps, faint, squares, strict=True):
        chosen &= on_any(out.planes, photons.receiver, photons.position, photons.normal)
        out.fine.append(photons if not chosen.any() else photons.rows(~chosen))
        for side in np.unique(sides[chosen]):
            rows = photons.rows(chosen & (sides == side))
            # What is faint may go straight.
            out.coarse.setdefault(float(side), []).append(replace(rows, trajectory=None))
    return out


def _measured(
    maps: list[PhotonMap], smoothing: float, pixel: PixelSize, launcher: Launcher
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """What :func:`measure_light` finds for the photons of each map, measured at once: there may be many small ones."""
    parts = [PhotonRows(photons) for photons in maps]
    count = sum(map(len, parts))
    out = [launcher.zeros(count, wp.float32) for _ in range(2)]
    columns = ("position", "normal", "dxdu", "dxdv", "dxdt", "flux")
    given = [launcher.array(stacked(parts, name), wp.vec3) for name in columns]
    launcher(measure_light, count, [*given, images_of(parts, "bspline", launcher), float(smoothing), pixel, *out])
    ends = np.cumsum([len(part) for part in parts])[:-1]
    bright, squares = (np.split(values.numpy(), ends) for values in out)
    return bright, squares


def _exceeded_by_most(brightness: np.ndarray, flux: np.ndarray) -> float:
    """The brightness below which ``FAINT_QUANTILE`` of the flux lies; zero without any."""
    order = np.argsort(brightness)
    below = np.cumsum(flux[order])
    if not len(below) or not below[-1] > 0.0:
        return 0.0
    return float(brightness[order][np.searchsorted(below, FAINT_QUANTILE * below[-1])])
