"""Sequences of all products of a stage's render settings, each under its own name."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

from tpdwarp.errors import InputError
from tpdwarp.jobs.opening import FilePath, chosen_settings, open_scene
from tpdwarp.jobs.results import SequenceResult
from tpdwarp.usd.read.stage import StageLike

# Where the name of a product of the render settings goes in that of an image.
PRODUCT = "<product>"


def each_product(
    rendered: Callable[..., SequenceResult],
    scene: StageLike,
    files: Mapping[str, FilePath | None],
    options: Mapping[str, Any],
    settings: Mapping[str, Any],
) -> SequenceResult:
    """Renders the products of a stage's render settings one after the other.

    Args:
        rendered: Renders one of them, as :func:`tpdwarp.render` does; it is given ``files`` and ``options``.
        scene: The stage.
        files: What is written, by argument.
        options: Other arguments.
        settings: Fields of :class:`tpdwarp.settings.Settings`.

    Raises:
        InputError: There are no products, or they would be written to the same file.
    """
    whole = {name: value for name, value in settings.items() if name != "product"}
    products = open_scene(scene, chosen_settings(whole), options["default_time"], options["max_memory"]).products
    if wanted := settings.get("product"):
        products = tuple(found for found in products if wanted in found)
    out = os.fspath(files["out"])
    if not products:
        raise InputError(f"names {PRODUCT}, and the stage has no such products in its render settings", out)
    for file in files.values():
        if file is not None and PRODUCT not in os.fspath(file) and len(products) > 1:
            raise InputError(f"{len(products)} products need a place for their names ({PRODUCT})", os.fspath(file))
    results = []
    for path, product in products:
        own = {name: os.fspath(file).replace(PRODUCT, product) for name, file in files.items() if file is not None}
        results.append(rendered(scene, **own, **options, **{**settings, "product": path}))
    return SequenceResult(
        tuple(outcome for result in results for outcome in result.outcomes),
        sum(result.seconds for result in results),
        tuple(problem for result in results for problem in result.problems),
        results[0].target,
        sum((Counter(result.anew) for result in results), Counter()),
    )
