"""Light splits: into how many parts lights with extent are cut for a given number of photons.

Light from the place (a, b) on a light lands x(a, b); a footprint takes x + a D_a x + b D_b x for it. What that misses
goes with the square of (a, b), so that N parts, 1/√N as wide each, miss 1/N of it. Where irradiance changes over a
length L, a miss e errs by e/L of the light; L is no less than what the light's image itself is across. Light that takes
another path from the rim of the light than from its middle errs by a part of itself, in a band that is 1/√N as wide; so
does light of which a cone leaves more or less from the rim than from the middle.
N parts share the photons, so that what footprints h wide blur, 3h²/(16L²), grows by N; that they interleave makes them
narrower (:func:`tpdwarp.scene.light_places.narrowing_of`), by N^¼ of that. The pieces of a round light are rectangles,
which leave the part M(N) of it out and cover as much twice, half a piece aside; that is seen where footprints are finer
than the light's image, i wide. Together, up to a factor:

    e/(2 L N) + c/√N + 3 h² N^¾/(16 L²) + .3 M i²/(√N L²)

as root mean squares over the photons of a coarse trace, weighted by the irradiance where they lie, as errors of
pictures are. Photons from the rim are traced from the point of the first surface at which those from the middle meet
it, so that each has its own e.

What is rough is traced as if it were smooth, for its lobes take up the columns of lights, and once more for these: L
is no less than what they blur either, and light in a band as wide as a part's image, i/√N, errs by i/√(i² + N b²) of
that where they are b wide.

Of lights that something specular cuts, some places shine on its other side, which no photon from the middle tells:
they have as many parts as leave each of them enough photons.

Lights share photons, so that many of them have as few parts as leave those enough.

Beyond the paper, whose lights are points or parallel.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from tpdwarp.clock import Clock
from tpdwarp.photons.lattices import EmissionPlan
from tpdwarp.photons.light_columns import LightImage
from tpdwarp.photons.path_tags import PathTags
from tpdwarp.photons.photon_map import PhotonMap, together
from tpdwarp.photons.tracer import LightSplits, PhotonTracer
from tpdwarp.photons.vectors import areas, lengths
from tpdwarp.scene.cut_lights import cut_lights
from tpdwarp.scene.device.loading import LoadedScene
from tpdwarp.scene.light_places import narrowing_of, prim_of
from tpdwarp.trajectories.neighbours import differences, has_three, neighbours, second_differences

# Photons of the trace from which the number of parts is chosen. Chosen, not derived.
PILOT_PHOTONS = 4096
# Photons that a part has at least. Chosen, not derived.
FEWEST_PHOTONS = 256
# So many of lights that something specular cuts. Chosen, not derived: with 65 536 a rectangle, a tube and a sphere
# half in water err by .042, .072 and .110 in 127 parts, by .057, .104 and .106 in 217, which take twice as long; of
# fewer photons, which so many parts would have, a tube errs by .41 in 19 parts, by less than .18 in 61.
FEWEST_OF_CUT = 512
PARTS_OF_CUT = 61
# Rings of pieces around the middle one of a disc, at most: 397 parts, each of which is a lattice to trace. Chosen, not
# derived: a sphere just above a ball errs by .057 in 169 parts with 262 144 photons, as with 65 536, by .041 in 397.
MOST_RINGS = 11
# Stills looked at, spread over the animation.
MOST_STILLS = 2
# Photons of each part that tell how much light lands, at least, and by how much more that may be. Chosen, not derived.
FEWEST_OF_GAINS = 64
MOST_GAIN = 2.0
# Gains of no more than this are left out: light from many parts is itself known no better (that of a tilted tube as the
# faces of a prism is 1.2 % too much).
UNKNOWN_GAIN = 0.02
# Places on the light, by its coordinates: the ends of its axes.
RIM = ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))
# The middle as a place on the light. Photons of all of it stand where their light has its own middle, beside that.
MIDDLE = (0.0, 0.0)
# Light that takes another path from some places errs by so much of itself: a quarter, as light that begins or ends
# within the shutter does.
CHANGED_ERROR = 0.25
# M(N) of the pieces of a disc (tests/trajectories/test_light_splits.py): this, times N to the power below.
LEFT_OUT, LEFT_OUT_POWER = 0.22, -3.0 / 8.0
# Blur by h²/(8L²), as rings and a torus in 19 to 91 parts err by 1.2 to 2 times that with 65 536 and 262 144 photons;
# and M i²/√N L² by a part, as a ball in 7 and 19 parts errs by .1 of it under a sun of 5° and by .8 under a sphere.
BLUR_FACTOR, OUTLINE_FACTOR = 1.5, 0.3
# More parts have to lessen the error by more than this part; one is enough where it errs by no more than that.
LEAST_GAIN = 0.25
ENOUGH = 0.01
# So many parts are enough that light errs by no more than this. Chosen, not derived: a rectangle over a ball of
# roughness .2 and .4 in 37 and 19 parts, which foresee that, errs by .011 and .009, in 91 by .010 and .007; suns of 90°
# and 180° over water in 61 parts by .027 and .038 (truths by .026 and .037), in 127 and 169 by .033 and .041.
ENOUGH_OF_PARTS = 0.0035
# What asks for a number of parts is told so where light errs by more than this, and by so many times what it would.
# Chosen, not derived: of 1, 4 and 16 parts of lamps and suns over water and glass it tells of all whose mean is off by
# 2 % (scripts/benchmarks/near_lights.py --splits auto 1 4 16).
VISIBLE, FAR_MORE = 0.025, 2.0


@dataclass(frozen=True)
class Foreseen:
    """What a coarse trace foresees of the parts that lights with extent may be cut into.

    Attributes:
        counts: Numbers of parts, shape [n].
        errors: The error of their light by each of them, up to a factor, shape [n].
        best: The number that is taken where the settings leave it to the program.
    """

    counts: np.ndarray
    errors: np.ndarray
    best: int

    def error_of(self, count: int) -> float:
        """The error with ``count`` parts, between the numbers looked at by their logarithm."""
        return float(np.interp(math.log(count), np.log(self.counts), self.errors))

    def is_worse(self, count: int) -> bool:
        """Whether light from ``count`` parts errs visibly, and far more than from the best number of them."""
        error = self.error_of(count)
        return error > VISIBLE and error > FAR_MORE * self.error_of(self.best)


def choose_splits(tracer: PhotonTracer, wanted: int | str) -> LightSplits:
    """The parts of the lights of an animation: the same for all frames, lest they flicker.

    Args:
        tracer: Traces with one part a light.
        wanted: Their number, or ``auto``.
    """
    foreseen = foreseen_splits(tracer)
    if wanted == "auto":
        return LightSplits(foreseen.best)
    count = int(wanted)
    if not foreseen.is_worse(count):
        return LightSplits(count)
    gains = _gains(tracer, count, foreseen.best) if count < foreseen.best else {}
    return LightSplits(count, foreseen.error_of(count), gains)


def _gains(tracer: PhotonTracer, count: int, best: int) -> dict[str, float]:
    """The light that lands from ``best`` parts of each light by that from ``count`` parts, by the paths of their prims.

    Points of the first surface that the middle of a part does not see have nothing of it, and others are told by first
    order what is not so near: both change how much light there is, beside glass by a fifth.
    """
    photons = max(PILOT_PHOTONS, FEWEST_OF_GAINS * best)
    landed: list[dict[str, float]] = []
    for parts in (count, best):
        traced = tracer.with_settings(replace(tracer.settings, light_splits=parts))
        found: dict[str, float] = {}
        for loaded in _loaded_stills(traced):
            there, _ = traced.trace(loaded, traced.plan(photons), Clock())
            sums = np.bincount(there.light, there.flux.sum(axis=1, dtype=np.float64), len(there.light_paths))
            extended = {light.path for light in loaded.scene.lights if light.extent is not None}
            for path, flux in zip(there.light_paths, sums, strict=True):
                if path in extended:
                    found[prim_of(path)] = found.get(prim_of(path), 0.0) + float(flux)
        landed.append(found)
    few, many = landed
    shining = [path for path in few if few[path] > 0.0]
    gains = {path: min(max(many.get(path, 0.0) / few[path], 1.0 / MOST_GAIN), MOST_GAIN) for path in shining}
    return {path: gain for path, gain in gains.items() if abs(gain - 1.0) > UNKNOWN_GAIN}


def _loaded_stills(tracer: PhotonTracer) -> Iterator[LoadedScene]:
    """Some of the stills of an animation, spread over it."""
    stills = tracer.source.reference_shutters()
    for still in stills[:: max(1, -(-len(stills) // MOST_STILLS))]:
        yield tracer.load(still, Clock())


def foreseen_splits(tracer: PhotonTracer) -> Foreseen:
    """What stills of an animation say about the parts of its lights, by a tracer with one part a light."""
    photons = tracer.settings.photons
    if tracer.settings.estimator != "tpd" or photons < 2 * FEWEST_PHOTONS:
        return Foreseen(np.ones(1, np.int64), np.zeros(1), 1)
    clock = Clock()
    counts = candidates(photons)
    totals, looks, cut = np.zeros(len(counts)), 0, False
    share = 0.0
    for loaded in _loaded_stills(tracer):
        if loaded.requirements.extended_lights and loaded.requirements.caustics:
            share = max(share, _share_of_photons(tracer.plan(min(photons, PILOT_PHOTONS), clock), loaded))
            cut = cut or bool(cut_lights(loaded.scene))
            if not cut:
                totals, looks = totals + _errors(tracer, loaded, counts, clock), looks + 1
    most = share * photons / FEWEST_PHOTONS
    if cut:
        most = max(min(most, PARTS_OF_CUT), share * photons / FEWEST_OF_CUT)
    counts = counts[counts <= max(1.0, most)]
    if cut:
        return Foreseen(counts, CHANGED_ERROR / np.sqrt(counts), int(counts[-1]))
    errors = totals[: len(counts)] / max(1, looks)
    if errors[0] <= ENOUGH:
        return Foreseen(counts, errors, 1)
    wanted = max((1.0 + LEAST_GAIN) * errors.min(), ENOUGH_OF_PARTS)
    return Foreseen(counts, errors, int(counts[np.argmax(errors <= wanted)]))


def _share_of_photons(plan: EmissionPlan, loaded: LoadedScene) -> float:
    """The part of all photons that a light with extent has, on average over theirs; 0 where none of them shines."""
    cells: dict[str, int] = {}
    for lattice, patch in plan.patches(loaded.scene):
        cells[lattice.light] = cells.get(lattice.light, 0) + patch.count_u * patch.count_v
    extended = [cells.get(light.path, 0) for light in loaded.scene.lights if light.extent is not None]
    return sum(n * n for n in extended) / max(1, sum(extended) * sum(cells.values()))


def candidates(photons: int) -> np.ndarray:
    """Numbers of pieces that discs are cut into (1, 7, 19, …), of those that leave each part enough photons."""
    rings = np.arange(MOST_RINGS + 1)
    numbers = 1 + 3 * rings * (rings + 1)
    return numbers[numbers <= max(1, photons // FEWEST_PHOTONS)]


def _errors(tracer: PhotonTracer, loaded: LoadedScene, counts: np.ndarray, clock: Clock) -> np.ndarray:
    """The error of the light in one still, up to a factor, for each number of parts."""
    photons = tracer.settings.photons
    plan = tracer.plan(min(photons, PILOT_PHOTONS), clock)
    tags = PathTags(loaded.scene, plan.photons).of(loaded.scene)
    # The lobes of rough surfaces take the columns of lights up, which tell what first order misses.
    rough = loaded.requirements.rough
    smooth = replace(loaded, requirements=replace(loaded.requirements, rough=False)) if rough else loaded
    middle, _ = tracer.trace(smooth, plan, clock, tags=tags, place=MIDDLE)
    blurred = np.zeros(len(middle))
    if rough:
        in_lobes, _ = tracer.trace(loaded, plan, clock, tags=tags, place=MIDDLE)
        blurred = _blurred_areas(middle, in_lobes)
    lit = _has_image(middle)
    uneven, blurred, middle = _unevenness(middle, plan)[lit], blurred[lit], middle.rows(lit)
    missed, changed = np.zeros(len(middle)), np.zeros(len(middle))
    from_rim_alone = []
    for place in RIM:
        rim, _ = tracer.trace(smooth, plan, clock, tags=tags, place=place)
        e, same, part = _missed(middle, rim, place)
        missed += np.where(same, e**2, 0.0) / len(RIM)
        changed += np.where(same, np.minimum(np.abs(part - 1.0), 1.0), 1.0) / len(RIM)
        from_rim_alone.append(_with_image(rim.rows(~np.isin(rim.ids, middle.ids))))
    # Where the rim by itself lights more than the middle does, as behind a prism that reflects all that comes straight,
    # what the middle does not light counts, as wrong as what the rim does not.
    by_rim = sum(float(photons.flux.sum()) for photons in from_rim_alone) / len(RIM)
    if by_rim <= float(middle.flux.sum()):
        from_rim_alone = []
    alone = sum(len(photons) for photons in from_rim_alone)
    if not len(middle) + alone:
        return np.zeros(len(counts))
    missed = np.append(missed, np.zeros(alone))
    changed = np.append(changed, np.full(alone, 1.0 / len(RIM)))
    uneven = np.append(uneven, np.full(alone, np.inf))
    blurred = np.append(blurred, np.zeros(alone))
    middle = together([middle, *from_rim_alone])
    image = _image_areas(middle)
    length = _length(middle, image + blurred, plan)
    cell = areas(middle.dxdu, middle.dxdv).astype(np.float64)
    # Of the length over which light changes, by that of a cell: as neighbours tell, and at least what L is.
    uneven = np.minimum(uneven, cell / length**2) * plan.photons / photons
    n = counts[:, None].astype(np.float64)
    narrowing = np.array([[narrowing_of(int(count))] for count in counts])
    first_order = np.minimum(0.5 * np.sqrt(missed) / length / n, 1.0)
    blur = np.minimum(BLUR_FACTOR * uneven * n * narrowing**2 / 8.0, 1.0)
    round_part = np.where(middle.image == int(LightImage.DISC), image / length**2, 0.0)
    outline = np.where(n > 1.0, OUTLINE_FACTOR * LEFT_OUT * n ** (LEFT_OUT_POWER - 0.5), 0.0) * round_part
    # In a band of the width of a part's image, of which a wider blur leaves less.
    seen = np.sqrt(image / np.maximum(image + n * blurred, np.finfo(float).tiny))
    error = first_order + CHANGED_ERROR * changed * seen / np.sqrt(n) + blur + outline
    return np.sqrt((error**2 * _squares(middle, float(np.median(length)))).sum(axis=1))


def _has_image(photons: PhotonMap) -> np.ndarray:
    """Which photons are of a light with extent, shape [n]; the lobes of rough surfaces are no images of lights."""
    return (photons.image > 0) & (photons.image < int(LightImage.LOBE))


def _with_image(photons: PhotonMap) -> PhotonMap:
    """Photons whose light has an extent."""
    return photons.rows(_has_image(photons))


def _unevenness(photons: PhotonMap, plan: EmissionPlan) -> np.ndarray:
    """|E_uu|/E + |E_vv|/E of the irradiance that photons carry, by differences from cell to cell, shape [n]; infinite
    where fewer than three lie in a row on the same path.

    With E = exp(g), E_uu/E = g_uu + g_u².
    """
    flux = photons.flux.sum(axis=1, dtype=np.float64)
    known = np.finfo(np.float32)
    level = np.log(np.maximum(flux, known.tiny))
    level -= np.log(np.clip(areas(photons.dxdu, photons.dxdv).astype(np.float64), known.tiny, known.max))
    total = np.zeros(len(photons))
    for pairs in neighbours(photons, plan):
        slope = differences(level[:, None], pairs)[:, 0]
        total += np.where(has_three(len(photons), pairs), np.abs(second_differences(level, pairs) + slope**2), np.inf)
    return total


def _squares(photons: PhotonMap, side: float) -> np.ndarray:
    """The part of the square of irradiance over all receivers that each photon stands for, shape [n].

    That is its flux times the irradiance where it lies: the flux in the cube of that side that holds it.
    """
    flux = photons.flux.sum(axis=1, dtype=np.float64)
    cubes = np.floor(photons.position.astype(np.float64) / side)
    _, cube = np.unique(cubes, axis=0, return_inverse=True)
    squares = flux * np.bincount(cube.ravel(), flux)[cube.ravel()]
    return squares / squares.sum()


def _missed(
    middle: PhotonMap, rim: PhotonMap, place: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """How far from where first order has them photons from a place on the light land, whether on the same path, and
    with which part of the flux: all of it, but for what shapes the light."""
    order = np.argsort(rim.ids)
    at = order[np.searchsorted(rim.ids[order], middle.ids).clip(max=len(order) - 1)] if len(order) else None
    if at is None:
        return np.zeros(len(middle)), np.zeros(len(middle), bool), np.ones(len(middle))
    same = (rim.ids[at] == middle.ids) & (rim.path[at] == middle.path) & (rim.receiver[at] == middle.receiver)
    expected = middle.position + place[0] * middle.dxda + place[1] * middle.dxdb
    part = rim.flux[at].sum(axis=1, dtype=np.float64) / middle.flux.sum(axis=1, dtype=np.float64)
    return lengths(rim.position[at] - expected), same, part


def _length(photons: PhotonMap, blurred: np.ndarray, plan: EmissionPlan) -> np.ndarray:
    """Over which length irradiance changes, at least: across the light's image with what blurs it, by their squares,
    and across a pilot's footprint."""
    typical = np.median(areas(photons.dxdu, photons.dxdv)) * plan.photons / PILOT_PHOTONS
    return np.sqrt(blurred + typical)


def _blurred_areas(smooth: PhotonMap, rough: PhotonMap) -> np.ndarray:
    """Squares of what the lobes of rough surfaces blur photons by, shape [n] float64, as of discs of their variance.

    The columns of lobes are deviations, with that of the light's image, of which the diameter of a disc is four.
    """
    of_lobes = np.where(rough.image == int(LightImage.LOBE), 4.0 * _image_areas(rough), 0.0)
    found = dict(zip(zip(rough.ids.tolist(), rough.path.tolist(), strict=True), of_lobes, strict=True))
    both = np.array([found.get(key, 0.0) for key in zip(smooth.ids.tolist(), smooth.path.tolist(), strict=True)])
    return np.maximum(both - _image_areas(smooth), 0.0)


def _image_areas(photons: PhotonMap) -> np.ndarray:
    """Squares of what images of lights are across, shape [n] float64: those of what grazes are beyond float32."""
    return 2.0 * sum(np.sum(column.astype(np.float64) ** 2, axis=1) for column in (photons.dxda, photons.dxdb))
