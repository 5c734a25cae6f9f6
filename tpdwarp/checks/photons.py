"""Comparing debug layers: photons matched by identity."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from tpdwarp.checks.findings import Finding, FrameComparison
from tpdwarp.checks.frames import not_compared
from tpdwarp.checks.limits import Limits, PhotonLimits
from tpdwarp.checks.measures import relative_difference
from tpdwarp.checks.metadata import metadata_findings
from tpdwarp.checks.sequences import LAYER_EXTENSIONS, FrameFile, files_of
from tpdwarp.errors import InputError
from tpdwarp.photons.record import PhotonRecord
from tpdwarp.usd.read.debug_layer import DebugLayerReader

_VECTORS = {"position": "positions", "dxdu": "dxdu", "dxdv": "dxdv", "dxdt": "dxdt"}
_NAMES = {"position": "position", "dxdu": "D_u x", "dxdv": "D_v x", "dxdt": "D_t x", "flux": "flux"}


def layer_pairs(frames: str, baseline: str) -> list[tuple[str, str]]:
    """Debug layers of two places, paired by name, or where each has one, whatever they are called.

    A layer that has no partner has an empty path in its place.
    """
    mine, theirs = ([file.path for file in _layers(place)] for place in (frames, baseline))
    if len(mine) == len(theirs) == 1:
        return [(mine[0], theirs[0])]
    by_name = [{Path(path).stem: path for path in side} for side in (mine, theirs)]
    return [(by_name[0].get(name, ""), by_name[1].get(name, "")) for name in sorted({*by_name[0], *by_name[1]})]


def compare_layers(path: str, baseline: str, limits: Limits) -> Iterator[FrameComparison]:
    """Compares two debug layers; gives one comparison a frame.

    Args:
        path, baseline: The layers; empty where there is none.
        limits: What is allowed.
    """
    label = f"photons {Path(path or baseline).name}"
    if not path or not baseline:
        kind, rule, message = (
            ("extra frame", limits.sequence.extra_frames, "the baseline has no such layer")
            if path
            else ("missing frame", limits.sequence.missing_frames, "there is no such layer")
        )
        if rule != "ignore":
            finding = Finding("fail" if rule == "fail" else "warn", kind, message)
            yield FrameComparison(label, None, path, baseline, (finding,))
        return
    about: list[Finding] = []
    frames: list[float] = []
    try:
        mine, theirs = DebugLayerReader(path), DebugLayerReader(baseline)
        about += metadata_findings(_metadata(mine), _metadata(theirs), limits.metadata)
        if mine.up_axis_and_unit != theirs.up_axis_and_unit:
            message = f"up axis and unit are {mine.up_axis_and_unit}, the baseline's {theirs.up_axis_and_unit}"
            about.append(Finding("fail", "metadata", message))
        frames += sorted({*mine.frames, *theirs.frames})
    except InputError as error:
        about.append(Finding("fail", "unreadable", str(error)))
    except Exception as error:
        # A layer may hold anything; the other layers and all images are compared all the same.
        about.append(not_compared(error))
    if about:
        yield FrameComparison(label, None, path, baseline, tuple(about))
    for frame in frames:
        started = time.perf_counter()
        identical = False
        if frame not in theirs.frames:
            findings = [Finding("fail", "extra frame", "the baseline has no photons at this frame")]
        elif frame not in mine.frames:
            findings = [Finding("fail", "missing frame", "there are no photons at this frame")]
        else:
            try:
                records = mine.at(frame), theirs.at(frame)
                findings = list(photon_findings(*records, limits.photons))
                identical = all(
                    np.array_equal(value, getattr(records[1], name))
                    for name, value in vars(records[0]).items()
                    if name != "receiver_paths"
                )
            except InputError as error:
                findings = [Finding("fail", "unreadable", str(error))]
            except Exception as error:
                findings = [not_compared(error)]
        yield FrameComparison(
            f"photons {frame:.12g}",
            frame,
            path,
            baseline,
            tuple(findings),
            identical=identical,
            seconds=time.perf_counter() - started,
        )


def photon_findings(record: PhotonRecord, baseline: PhotonRecord, limits: PhotonLimits) -> Iterator[Finding]:
    """Differences between the photons of one frame.

    Args:
        record, baseline: The photons.
        limits: What is allowed.
    """
    for name, photons in (("frame", record), ("baseline", baseline)):
        repeated = len(photons.ids) - len(np.unique(photons.ids))
        if repeated:
            message = f"{repeated} photons of the {name} share an id with another"
            yield Finding("fail", "repeated ids", message, of_baseline=name == "baseline")
    finite = np.isfinite(np.column_stack([record.positions, record.dxdu, record.dxdv, record.dxdt, record.flux]))
    if not finite.all():
        worst = record.ids[np.argmin(finite.all(axis=1))]
        yield Finding("fail", "not finite", f"photon {worst} has a value that is no number")
        return
    _, here, there = np.intersect1d(record.ids, baseline.ids, return_indices=True)
    unmatched = len(np.unique(record.ids)) + len(np.unique(baseline.ids)) - 2 * len(here)
    share = 100 * unmatched / max(1, len(baseline))
    if share > limits.percent:
        message = f"{share:.3g} % of photons are in one layer only, {limits.percent:.3g} % may ({unmatched} photons)"
        yield Finding("fail", "photon ids", message, value=share, limit=limits.percent)
    totals = float(record.flux.sum()), float(baseline.flux.sum())
    energy = relative_difference(*totals)
    if abs(energy) > limits.total_flux:
        message = f"relative difference of the summed flux {energy:.4g}, limit {limits.total_flux:.4g}"
        yield Finding("fail", "total flux", message, value=energy, limit=limits.total_flux)
    if not len(here):
        return
    areas = np.linalg.norm(np.cross(baseline.dxdu, baseline.dxdv), axis=-1)
    footprint = float(np.sqrt(np.median(areas))) or 1.0
    for name, column in _VECTORS.items():
        mine, theirs = getattr(record, column)[here], getattr(baseline, column)[there]
        lengths = np.full(len(here), footprint)
        if name != "position":
            lengths = np.maximum(lengths, np.linalg.norm(theirs, axis=-1))
        yield from _beyond(name, np.linalg.norm(mine - theirs, axis=-1) / lengths, record.ids[here], limits)
    mine, theirs = record.flux[here].sum(axis=-1), baseline.flux[there].sum(axis=-1)
    typical = float(np.median(np.abs(theirs))) or 1.0
    yield from _beyond("flux", np.abs(mine - theirs) / np.maximum(np.abs(theirs), typical), record.ids[here], limits)
    receivers = [np.array([*photons.receiver_paths, "none"])[photons.receivers] for photons in (record, baseline)]
    moved = receivers[0][here] != receivers[1][there]
    share = 100 * np.count_nonzero(moved) / len(here)
    if share > limits.percent:
        first = int(np.argmax(moved))
        message = (
            f"{share:.3g} % of photons lie on another mesh, {limits.percent:.3g} % may; photon "
            f"{record.ids[here][first]} on {receivers[0][here][first]}, not {receivers[1][there][first]}"
        )
        yield Finding("fail", "receiver", message, value=share, limit=limits.percent)


def _metadata(reader: DebugLayerReader) -> dict[str, Any]:
    """What a layer says of its making, by the names that frames use."""
    names = {"settings": "tpdwarp:settings", "exposure": "tpdwarp:shutterExposure", "version": "tpdwarp:version"}
    provenance = reader.provenance
    return {name: provenance[key] for key, name in names.items() if key in provenance}


def _beyond(name: str, differences: np.ndarray, ids: np.ndarray, limits: PhotonLimits) -> Iterator[Finding]:
    limit = getattr(limits, name)
    share = 100 * np.count_nonzero(differences > limit) / len(differences)
    if share > limits.percent:
        worst = int(np.argmax(differences))
        message = (
            f"{_NAMES[name]} of {share:.3g} % of photons is off by more than {limit:g}, {limits.percent:.3g} % may; "
            f"worst is photon {ids[worst]}, off by {differences[worst]:.4g}"
        )
        yield Finding("fail", name, message, value=float(differences[worst]), limit=limit)


def _layers(place: str) -> Iterator[FrameFile]:
    for file in files_of(place, LAYER_EXTENSIONS) if Path(place).exists() else ():
        # View layers only point at the debug layer beside them.
        if not file.path.endswith(".view.usda"):
            yield file
