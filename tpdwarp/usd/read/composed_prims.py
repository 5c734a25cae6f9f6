"""How many prims a stage will be composed of, counted from its layers.

Prims that reference each other ten at a time, ten deep, are a few kilobytes on disk, and more than any machine holds
once USD has composed them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from pxr import Ar, Sdf

# Looking at a prim takes 10 µs; stages with more of their own are not made to be small and grow.
MOST_LOOKED_AT = 100_000

_Place = tuple[Sdf.Layer, Sdf.Path]


def composed_prims(layers: Sequence[Sdf.Layer]) -> int:
    """Prims that references, payloads, inherits and specializes stand for, those of instances counted once.

    Variants are not followed, and a target may lie in any of the layers, so that it is no more than a sign.

    Args:
        layers: Those of a stage, its root first.

    Returns:
        Their number; 0 where the layers themselves hold too many to be looked at.
    """
    by_name = {layer.realPath: layer for layer in layers}
    below: dict[_Place, list[tuple[_Place, bool]]] = {}
    sizes: dict[_Place, int] = {}
    roots = [(layers[0], spec.path) for spec in layers[0].rootPrims] if layers else []
    left = list(roots)
    while left:
        place = left[-1]
        if place in sizes:
            left.pop()
        elif place in below:
            # What holds itself is refused by USD, and counts as nothing here.
            sizes[place] = 1 + sum(sizes.get(other, merged) - merged for other, merged in below[place])
            left.pop()
        elif len(below) >= MOST_LOOKED_AT:
            return 0
        else:
            below[place] = list(_below(*place, layers, by_name))
            left += [other for other, _ in below[place] if other not in below]
    return sum(sizes[place] for place in roots)


def _below(
    layer: Sdf.Layer, path: Sdf.Path, layers: Sequence[Sdf.Layer], by_name: dict[str, Sdf.Layer]
) -> Iterator[tuple[_Place, bool]]:
    """What a prim is composed of beside itself: its children, and what it names, which is merged into it."""
    spec = layer.GetPrimAtPath(path)
    yield from (((layer, child.path), False) for child in spec.nameChildren)
    # What is shared is counted by the stage itself.
    if spec.instanceable:
        return
    arcs: list[tuple[str, Sdf.Path]] = []
    for of in (spec.referenceList, spec.payloadList):
        arcs += [(arc.assetPath, arc.primPath) for arc in of.GetAddedOrExplicitItems()]
    for of in (spec.inheritPathList, spec.specializesList):
        arcs += [("", target) for target in of.GetAddedOrExplicitItems()]
    for asset, target in arcs:
        there = layer
        if asset:
            name = str(Ar.GetResolver().Resolve(Sdf.ComputeAssetPathRelativeToLayer(layer, asset)))
            if name not in by_name:
                continue
            there = by_name[name]
        if not target:
            target = Sdf.Path.absoluteRootPath.AppendChild(there.defaultPrim) if there.defaultPrim else Sdf.Path()
        for candidate in (there, *layers):
            if target and candidate.GetPrimAtPath(target):
                yield (candidate, target), True
                break
