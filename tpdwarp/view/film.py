"""The film: samples summed to pixels, in double precision and in a fixed order."""

from __future__ import annotations

import numpy as np

from tpdwarp.footprints.irradiance import Irradiance
from tpdwarp.io.float32 import to_float32
from tpdwarp.scene.normalization import Normalization
from tpdwarp.view.cryptomatte import Mattes
from tpdwarp.view.object_ids import object_ids
from tpdwarp.view.visibility import VisiblePoints

# Depth [scene units] where nothing is seen: finite, so that depths can be compared and filtered. Chosen,
# not derived.
BACKGROUND_DEPTH = 1.0e10
# Pixels that are developed together: arrays of as many stay in caches. Chosen, not derived.
BAND = 1 << 14


class Film:
    """Sums of what camera samples saw.

    Args:
        width, height: Pixels.
        samples: Samples a pixel.
        normalization: Maps the tracer's units back to scene units.
        scale: Factor on radiance (the camera's exposure).
        aovs: Channel groups wanted beside the beauty.
        paths: Prim path of each object, which ``id`` numbers.
        groups: Light groups whose caustics are kept apart.
    """

    def __init__(
        self,
        width: int,
        height: int,
        samples: int,
        normalization: Normalization,
        scale: float,
        aovs: tuple[str, ...],
        paths: tuple[str, ...] = (),
        groups: tuple[str, ...] = (),
    ) -> None:
        self.width, self.height, self.samples = width, height, samples
        self._norm, self._scale, self._aovs, self._groups = normalization, scale, aovs, groups
        count = width * height
        self._sums: dict[str, np.ndarray] = {}
        # Samples that meet something, and what they see of nothing beyond surfaces that are there in part.
        self._coverage, self._beyond = np.zeros(count), np.zeros(count)
        self._diffuse = np.zeros(count)
        self._motion_weight = np.zeros(count)
        self._depth = np.full(count, np.inf)
        numbers = object_ids(paths) if "id" in aovs else {}
        self._numbers = np.array([numbers[path] for path in paths if numbers], np.float64)
        self._ids, self._id_depth = np.zeros(count), np.full(count, np.inf)
        self._mattes = Mattes(count, paths) if "cryptomatte" in aovs else None

    @property
    def wants_motion(self) -> bool:
        """Whether the photons' motion or number is wanted."""
        return bool({"motion", "photons"} & set(self._aovs))

    def add_view(self, points: VisiblePoints, pixels: np.ndarray, weight: np.ndarray | float) -> None:
        """Adds direct light and, for first paths, what geometry they met.

        Args:
            points: The camera paths of one pass.
            pixels: Pixel of each, shape [n].
            weight: Share of the exposure that they stand for, or that each of them does, shape [n].
        """
        weight = np.broadcast_to(np.float64(weight), pixels.shape)
        each = weight[:, None]
        self._add("direct", each * points.arrays.direct.numpy(), pixels)
        extras = points.extras
        if extras is not None and "shadow" in self._aovs:
            self._add("shadow", each * points.arrays.weight.numpy() * extras.shaded, pixels)
        if not points.first:
            return
        depth = points.arrays.first_depth.numpy()
        hit = depth >= 0.0
        _add_up(self._coverage, weight * hit, pixels)
        stays = points.queries.receiver.numpy() >= 0
        _add_up(self._diffuse, weight * stays, pixels)
        leaves = np.flatnonzero(hit & ~stays)
        if len(leaves):
            partly = points.arrays.weight.numpy()[leaves].mean(axis=1)
            _add_up(self._beyond, weight[leaves] * partly, pixels[leaves])
        if "N" in self._aovs:
            self._add("N", each * points.arrays.first_normal.numpy(), pixels)
        if "P" in self._aovs:
            self._add("P", each * points.arrays.first_position.numpy(), pixels)
        if "Z" in self._aovs:
            np.minimum.at(self._depth, pixels[hit], depth[hit])
        if extras is not None:
            if "albedo" in self._aovs:
                self._add("albedo", each * extras.albedo, pixels)
            if "vector" in self._aovs:
                self._add("vector", each * extras.vector, pixels)
            if self._mattes is not None:
                self._mattes.add(pixels[hit], extras.objects[hit], weight[hit])
            if "id" in self._aovs:
                self._name(pixels[hit], depth[hit], extras.objects[hit])

    def add_caustic(
        self, pixels: np.ndarray, weights: np.ndarray, first: np.ndarray, light: Irradiance, group: str = ""
    ) -> None:
        """Adds what photons left at visible points.

        Args:
            pixels: Pixel of each point, shape [n].
            weights: Irradiance times this is radiance at the camera, shape [n, 3].
            first: Samples whose first path ends at each point, shape [n].
            light: Irradiance there.
            group: The light group that it comes from; empty for all of them.
        """
        # What overflows is refused when the frame is written.
        with np.errstate(over="ignore"):
            radiance = weights * light.irradiance
        seen = np.flatnonzero(first)
        share = first[seen, None]
        kept = {"caustic": (radiance, pixels)}
        if "irradiance" in self._aovs:
            kept["irradiance"] = share * light.irradiance[seen], pixels[seen]
        for name, (values, at) in kept.items():
            self._add(name, values, at)
            if group:
                self._add(f"{name}_{group}", values, at)
        pixels = pixels[seen]
        if light.motion is not None:
            self._add("motion", share * light.motion[seen], pixels)
            _add_up(self._motion_weight, share[:, 0] * light.weight[seen], pixels)
            self._add("photons", (share * light.photons[seen, None]).astype(np.float64), pixels)

    def channels(self) -> dict[str, np.ndarray]:
        """Beauty and the asked AOVs, each [height, width] float32 (limited to its range), rows from the top."""
        count = self.width * self.height
        mattes = {} if self._mattes is None else self._mattes.channels(1.0 / self.samples)
        out: dict[str, np.ndarray] = {}
        for first in range(0, count, BAND):
            band = slice(first, min(first + BAND, count))
            for name, values in self._channels_in(band, mattes).items():
                out.setdefault(name, np.empty(count, np.float32))[band] = to_float32(values)
        return {name: values.reshape(self.height, self.width) for name, values in out.items()}

    def _channels_in(self, band: slice, mattes: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Those of a ``band`` of pixels, each [n].

        Args:
            mattes: Channels of all pixels that are known already.
        """
        per_sample = 1.0 / self.samples
        area = self._norm.scale**2 * self._norm.power
        coverage, depth = self._coverage[band], self._depth[band]

        def sums(name: str, width: int) -> np.ndarray:
            return self._sums[name][:, band] if name in self._sums else np.zeros((width, len(coverage)))

        direct = sums("direct", 3) * (per_sample * self._scale * area)
        caustic = sums("caustic", 3) * (per_sample * self._scale * area)
        beauty = direct + caustic
        out = {"R": beauty[0], "G": beauty[1], "B": beauty[2], "A": (coverage - self._beyond[band]) * per_sample}
        hits, diffuse = np.maximum(coverage, 1e-30), np.maximum(self._diffuse[band], 1e-30)
        for group in self._groups:
            for name, factor in (("caustic", per_sample * self._scale * area), ("irradiance", area / diffuse)):
                if name == "caustic" or name in self._aovs:
                    value = sums(f"{name}_{group}", 3) * factor
                    out.update({f"{name}_{group}.{c}": value[k] for k, c in enumerate("RGB")})
        for aov in self._aovs:
            if aov in ("caustic", "direct", "irradiance"):
                value = {"caustic": caustic, "direct": direct}.get(aov)
                if value is None:
                    value = sums("irradiance", 3) * (area / diffuse)
                out.update({f"{aov}.{c}": value[k] for k, c in enumerate("RGB")})
            elif aov == "Z":
                seen = np.isfinite(depth)
                out["Z"] = np.where(seen, np.where(seen, depth, 0.0) / self._norm.scale, BACKGROUND_DEPTH)
            elif aov == "photons":
                out["photons"] = sums("photons", 1)[0] / diffuse
            elif aov == "id":
                out["id"] = self._ids[band]
            elif aov == "cryptomatte":
                out.update({name: values[band] for name, values in mattes.items()})
            elif aov == "vector":
                value = sums("vector", 2) / hits
                out.update({f"vector.{c}": value[k] for k, c in enumerate("XY")})
            elif aov in ("albedo", "shadow"):
                factor = 1.0 / diffuse if aov == "albedo" else per_sample * self._scale * area
                value = sums(aov, 3) * factor
                out.update({f"{aov}.{c}": value[k] for k, c in enumerate("RGB")})
            else:
                value = sums(aov, 3)
                if aov == "motion":
                    value = value / (np.maximum(self._motion_weight[band], 1e-30) * self._norm.scale)
                elif aov == "P":
                    origin = np.asarray(self._norm.origin)[:, None]
                    value = np.where(coverage > 0, value / hits / self._norm.scale + origin, 0.0)
                else:
                    value = value / np.maximum(np.linalg.norm(value, axis=0), 1e-30)
                out.update({f"{aov}.{c}": value[k] for k, c in enumerate("XYZ")})
        return out

    def _name(self, pixels: np.ndarray, depths: np.ndarray, objects: np.ndarray) -> None:
        """Names pixels by the nearest object that a sample of theirs saw."""
        order = np.lexsort((depths, pixels))
        _, firsts = np.unique(pixels[order], return_index=True)
        chosen = order[firsts]
        chosen = chosen[depths[chosen] < self._id_depth[pixels[chosen]]]
        self._id_depth[pixels[chosen]] = depths[chosen]
        self._ids[pixels[chosen]] = self._numbers[objects[chosen]]

    def _add(self, name: str, values: np.ndarray, pixels: np.ndarray) -> None:
        sums = self._sums.setdefault(name, np.zeros((values.shape[1], self.width * self.height)))
        for k in range(values.shape[1]):
            _add_up(sums[k], values[:, k], pixels)


def _add_up(sums: np.ndarray, values: np.ndarray, pixels: np.ndarray) -> None:
    """Adds ``values`` [n] to the sums of their pixels, in order; only the rows that a batch covers are gone through."""
    if len(pixels):
        first = pixels.min()
        part = np.bincount(pixels - first, weights=values)
        sums[first : first + len(part)] += part
