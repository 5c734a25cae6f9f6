"""All products of a stage's render settings, each under its own name; those of the same shutter share one trace."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

from tpdwarp.errors import InputError
from tpdwarp.jobs.frame_work import LazyContext
from tpdwarp.jobs.opening import FilePath, open_scene
from tpdwarp.jobs.plan import SequencePlan
from tpdwarp.jobs.results import SequenceResult
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.shared_trace import SharedTrace, may_share
from tpdwarp.scene.description import Shutter
from tpdwarp.settings import Settings
from tpdwarp.usd.read.render_settings import EACH_PRODUCT
from tpdwarp.usd.read.stage import StageLike, StageScene


@dataclass(frozen=True)
class Product:
    """A product that is rendered.

    Attributes:
        scene: The stage, as the product shows it where it is one of several.
        settings: Settings that name it.
        files: What is written, by argument.
    """

    scene: StageLike | StageScene
    settings: Settings
    files: Mapping[str, FilePath | None]


def products_of(
    scene: StageLike,
    files: Mapping[str, FilePath | None],
    settings: Settings,
    default_time: bool,
    max_memory: float | None,
) -> list[Product]:
    """The products of a stage's render settings, or those whose path or name the settings name.

    Args:
        scene: The stage.
        files: What is written, by argument: ``out`` and others, with :data:`EACH_PRODUCT` in their names.
        settings: The settings.
        default_time: Whether the stage is read at its default time.
        max_memory: Bytes that rendering may take; None for three quarters of the machine.

    Raises:
        InputError: There are no products, or they would be written to the same file.
    """
    source = open_scene(scene, replace(settings, product=EACH_PRODUCT), default_time, max_memory)
    chosen = [found for found in source.products if not settings.product or settings.product in found]
    if not chosen:
        out = os.fspath(files["out"])
        raise InputError(f"names {EACH_PRODUCT}, and the stage has no such products in its render settings", out)
    for file in files.values():
        if file is not None and EACH_PRODUCT not in os.fspath(file) and len(chosen) > 1:
            raise InputError(f"{len(chosen)} products need a place for their names ({EACH_PRODUCT})", os.fspath(file))
    found = []
    for path, name in chosen:
        own = {key: file and os.fspath(file).replace(EACH_PRODUCT, name) for key, file in files.items()}
        found.append(Product(source.with_product(path), replace(settings, product=path), own))
    return found


def contexts_of(plans: Sequence[SequencePlan]) -> list[Callable[[Shutter], RenderContext]]:
    """What gives each of several sequences its context: one scene and one trace serve all that may share them.

    A light that stands at the camera is another one for each.
    """
    regions = [math.prod(plan.source.region().size) for plan in plans]
    if len(plans) == 1 or plans[0].source.lit_by_camera:
        return [LazyContext(plan, pixels) for plan, pixels in zip(plans, regions, strict=True)]
    first, shared = plans[0], SharedTrace()
    whole = LazyContext(first, max(regions), shared=True)

    def seen(plan: SequencePlan) -> Callable[[Shutter], RenderContext]:
        # What is found out of an animation is found out once.
        through_camera = cache(lambda context: context.seen_by(plan.source, plan.settings, shared))
        return lambda shutter: through_camera(whole(shutter))

    return [
        seen(plan) if may_share(plan.settings, first.settings) else LazyContext(plan, pixels)
        for plan, pixels in zip(plans, regions, strict=True)
    ]


def joined(results: Iterable[SequenceResult]) -> SequenceResult:
    """What became of several sequences, as one."""
    results = tuple(results)
    return SequenceResult(
        tuple(outcome for result in results for outcome in result.outcomes),
        sum(result.seconds for result in results),
        tuple(problem for result in results for problem in result.problems),
        results[0].target,
        sum((Counter(result.anew) for result in results), Counter()),
    )
