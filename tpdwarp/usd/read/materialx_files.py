"""MaterialX files that a stage references: read as layers, which the USD package from PyPI does not do itself.

Each ``surfacematerial`` becomes a Material below ``/MaterialX/Materials``, as USD's own plug-in has it, with all the
nodes that it takes inside of it: node graphs, those of definitions too, are laid out flat. Looks are not read.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from xml.etree import ElementTree

from pxr import Ar, Gf, Sdf, Usd, UsdShade

from tpdwarp.errors import WarnOnce

Element = ElementTree.Element

SUFFIX = ".mtlx"
ROOT, MATERIALS = Sdf.Path("/MaterialX"), Sdf.Path("/MaterialX/Materials")
# Graphs and includes deeper than this count as circular, and networks of more nodes as endless: graphs in graphs may
# double with every level. Chosen, not derived: hand-made ones have some tens.
DEEPEST = 128
MOST_NODES = 10_000
TYPES = {
    "float": Sdf.ValueTypeNames.Float,
    "integer": Sdf.ValueTypeNames.Int,
    "boolean": Sdf.ValueTypeNames.Bool,
    "color3": Sdf.ValueTypeNames.Color3f,
    "color4": Sdf.ValueTypeNames.Color4f,
    "vector2": Sdf.ValueTypeNames.Float2,
    "vector3": Sdf.ValueTypeNames.Float3,
    "vector4": Sdf.ValueTypeNames.Float4,
    "string": Sdf.ValueTypeNames.String,
    "filename": Sdf.ValueTypeNames.Asset,
}
VECTORS = {2: Gf.Vec2f, 3: Gf.Vec3f, 4: Gf.Vec4f}
# What closures hand on has no value.
OTHERWISE = Sdf.ValueTypeNames.Token


def bring_in(stage: Usd.Stage, warnings: WarnOnce) -> list[Sdf.Layer]:
    """Lets the MaterialX files that a stage references take part in it, through its session layer.

    Args:
        stage: The stage, whose session layer may be written to.
        warnings: Takes what cannot be read; USD's own complaints of these files are dropped.

    Returns:
        Their layers, to be kept as long as the stage.
    """
    named = _named(stage)
    if not named:
        return []
    warnings.settled |= {os.path.basename(name) for name in named}
    layers: dict[str, Sdf.Layer | None] = {}
    arcs: list[tuple[Sdf.Path, Sdf.Layer, Sdf.Path]] = []
    for path, layer, asset, target in _referenced(stage):
        file = str(Ar.GetResolver().Resolve(Sdf.ComputeAssetPathRelativeToLayer(layer, asset)))
        if file not in layers:
            layers[file] = _layer_of(file, warnings, str(path))
        if (found := layers[file]) is not None:
            arcs.append((path, found, target))
    session = stage.GetSessionLayer()
    # One change, lest the stage is composed anew for each.
    with Sdf.ChangeBlock():
        for path, found, target in arcs:
            if path == Sdf.Path.absoluteRootPath:
                session.subLayerPaths.append(found.identifier)
            else:
                spec = Sdf.CreatePrimInLayer(session, path)
                spec.referenceList.Append(Sdf.Reference(found.identifier, target))
    return [layer for layer in layers.values() if layer is not None]


def references_materialx(stage: Usd.Stage) -> bool:
    """Whether a stage references a MaterialX file."""
    return bool(_named(stage))


def _named(stage: Usd.Stage) -> set[str]:
    """MaterialX files that the layers of a stage name."""
    layers = stage.GetUsedLayers()
    return {name for layer in layers for name in layer.GetCompositionAssetDependencies() if _is_one(name)}


def _referenced(stage: Usd.Stage) -> Iterator[tuple[Sdf.Path, Sdf.Layer, str, Sdf.Path]]:
    """Prims that reference MaterialX files, or the root for sublayers: the layer that says so, the asset and target."""
    for layer in stage.GetLayerStack():
        for name in filter(_is_one, layer.subLayerPaths):
            yield Sdf.Path.absoluteRootPath, layer, name, Sdf.Path()
    for prim in stage.TraverseAll():
        for spec in prim.GetPrimStack():
            for of in (spec.referenceList, spec.payloadList):
                for arc in of.GetAddedOrExplicitItems():
                    if _is_one(arc.assetPath):
                        yield prim.GetPath(), spec.layer, arc.assetPath, arc.primPath


def _is_one(name: str) -> bool:
    return name.lower().endswith(SUFFIX)


def _layer_of(file: str, warnings: WarnOnce, asking: str) -> Sdf.Layer | None:
    """The layer that stands for a MaterialX file; None (and a warning) where it cannot be read."""
    try:
        return _Document(file).layer()
    except (OSError, ElementTree.ParseError, ValueError) as error:
        name = os.path.basename(file)
        why = "no such file" if not file else f"{name} cannot be read: {' '.join(str(error).split())}"
        warnings(asking, f"references MaterialX: {why}", "references MaterialX")
        return None


@dataclass(frozen=True)
class _Scope:
    """Where elements are looked up by their names: a document or a graph, what feeds the graph's interface, and what
    files and colours are relative to."""

    elements: dict[str, Element]
    name: str = ""
    interface: dict[str, tuple[Element, _Scope]] | None = None
    prefix: str = ""
    color_space: str = ""


class _Document:
    """A MaterialX file.

    Raises:
        OSError: It cannot be opened.
        ElementTree.ParseError: It is no XML.
        ValueError: It is something else, or includes itself without end.
    """

    def __init__(self, file: str) -> None:
        self._folder = os.path.dirname(os.path.abspath(file))
        root = _parsed(file)
        if root.tag != "materialx":
            raise ValueError("it holds no MaterialX")
        self._elements: list[Element] = list(_with_includes(root, self._folder, 0))
        self._scope = _Scope(
            {element.get("name", ""): element for element in self._elements},
            prefix=root.get("fileprefix", ""),
            color_space=root.get("colorspace", ""),
        )
        self._graphs = {graph.get("nodedef", ""): graph for graph in self._elements if graph.tag == "nodegraph"}
        self._definitions: dict[tuple[str, str], str] = {}
        for element in self._elements:
            if element.tag == "nodedef":
                kind = element.get("type") or next((out.get("type", "") for out in element.findall("output")), "")
                self._definitions.setdefault((element.get("node", ""), kind), element.get("name", ""))
            if element.tag == "implementation" and element.get("nodegraph") in self._scope.elements:
                self._graphs[element.get("nodedef", "")] = self._scope.elements[element.get("nodegraph", "")]

    def layer(self) -> Sdf.Layer:
        """A layer with its materials."""
        layer = Sdf.Layer.CreateAnonymous(SUFFIX.lstrip(".") + ".usda")
        stage = Usd.Stage.Open(layer)
        stage.DefinePrim(ROOT, "Scope")
        stage.DefinePrim(MATERIALS, "Scope")
        layer.defaultPrim = ROOT.name
        for element in self._elements:
            if element.tag in ("surfacematerial", "material"):
                self._material(stage, element)
        return layer

    def _material(self, stage: Usd.Stage, element: Element) -> None:
        material = UsdShade.Material.Define(stage, MATERIALS.AppendChild(_identifier(element.get("name", "material"))))
        network = _Network(self, stage, material.GetPath())
        for given in element.findall("input"):
            if given.get("name") == "surfaceshader" and (found := network.source(given, self._scope, 0)):
                material.CreateSurfaceOutput("mtlx").ConnectToSource(*found)
        # Before 1.38 materials held the shaders themselves.
        for reference in element.findall("shaderref"):
            node = Element(reference.get("node", ""), {"name": reference.get("name", ""), "type": "surfaceshader"})
            for bound in reference.findall("bindinput"):
                node.append(Element("input", dict(bound.attrib)))
            if found := network.node(node, self._scope, "", 0):
                material.CreateSurfaceOutput("mtlx").ConnectToSource(*found)

    def graph_of(self, node: Element) -> Element | None:
        """The graph that defines what a node computes, if one does."""
        definition = node.get("nodedef") or self._definitions.get((node.tag, node.get("type", "")), "")
        return self._graphs.get(definition) if definition else None

    def asset(self, value: str, element: Element, scope: _Scope) -> Sdf.AssetPath:
        """A file that an input names."""
        path = element.get("fileprefix", scope.prefix) + value
        return Sdf.AssetPath(path if os.path.isabs(path) else os.path.join(self._folder, path))


class _Network:
    """The shaders of one material."""

    def __init__(self, document: _Document, stage: Usd.Stage, root: Sdf.Path) -> None:
        self._document, self._stage, self._root = document, stage, root
        self._made: dict[tuple[str, str], UsdShade.Shader] = {}

    def source(self, given: Element, scope: _Scope, depth: int) -> tuple[UsdShade.ConnectableAPI, str] | None:
        """What an input or output is connected to; None for a plain value."""
        if depth > DEEPEST:
            raise ValueError("its graphs are too deep, or circular")
        if (name := given.get("interfacename")) and scope.interface is not None:
            outer = scope.interface.get(name)
            return None if outer is None else self.source(*outer, depth + 1)
        if (graph := given.get("nodegraph")) and graph in scope.elements:
            return self._of_graph(scope.elements[graph], given.get("output", ""), scope, {}, depth)
        if (node := given.get("nodename")) and node in scope.elements:
            found = scope.elements[node]
            if found.tag == "nodegraph":
                return self._of_graph(found, given.get("output", ""), scope, {}, depth)
            return self.node(found, scope, given.get("output", ""), depth)
        if (output := given.get("output")) and output in scope.elements:
            return self.source(scope.elements[output], scope, depth + 1)
        return None

    def value(self, given: Element, scope: _Scope, depth: int = 0) -> tuple[Element, _Scope]:
        """The element that holds the value of an input, through interfaces, and where that is."""
        name = given.get("interfacename")
        if name and scope.interface and name in scope.interface and depth <= DEEPEST:
            return self.value(*scope.interface[name], depth + 1)
        return given, scope

    def node(
        self, element: Element, scope: _Scope, output: str, depth: int
    ) -> tuple[UsdShade.ConnectableAPI, str] | None:
        """A node's output; what a graph computes where that defines the node."""
        if depth > DEEPEST:
            raise ValueError("its graphs are too deep, or circular")
        graph = self._document.graph_of(element)
        if graph is not None:
            inputs = {given.get("name", ""): (given, scope) for given in element.findall("input")}
            inner = f"{scope.name}{element.get('name', '')}_"
            return self._of_graph(graph, output, scope, inputs, depth, inner)
        key = scope.name, element.get("name", "")
        if key not in self._made:
            if len(self._made) >= MOST_NODES:
                raise ValueError(f"a material of more than {MOST_NODES} nodes")
            path = self._root.AppendChild(_identifier(scope.name + (element.get("name") or element.tag)))
            shader = self._made[key] = UsdShade.Shader.Define(self._stage, path)
            shader.CreateIdAttr(element.get("nodedef") or f"ND_{element.tag}_{element.get('type', '')}")
            for given in element.findall("input"):
                self._input(shader, given, scope, depth)
        shader = self._made[key]
        name = output or "out"
        if not shader.GetOutput(name):
            shader.CreateOutput(name, TYPES.get(element.get("type", ""), OTHERWISE))
        return shader.ConnectableAPI(), name

    def _of_graph(
        self,
        graph: Element,
        output: str,
        scope: _Scope,
        inputs: dict[str, tuple[Element, _Scope]],
        depth: int,
        name: str = "",
    ) -> tuple[UsdShade.ConnectableAPI, str] | None:
        """What an output of a graph is connected to, with ``inputs`` in the place of its own."""
        own = {given.get("name", ""): (given, scope) for given in graph.findall("input")}
        inner = _Scope(
            {child.get("name", ""): child for child in graph},
            name or f"{graph.get('name', '')}_",
            own | inputs,
            graph.get("fileprefix", scope.prefix),
            graph.get("colorspace", scope.color_space),
        )
        outputs = graph.findall("output")
        chosen = next((out for out in outputs if out.get("name") == output), outputs[0] if outputs else None)
        return None if chosen is None else self.source(chosen, inner, depth + 1)

    def _input(self, shader: UsdShade.Shader, given: Element, scope: _Scope, depth: int) -> None:
        kind = TYPES.get(given.get("type", ""), OTHERWISE)
        source = self.source(given, scope, depth + 1)
        if source is not None:
            shader.CreateInput(given.get("name", ""), kind).ConnectToSource(*source)
            return
        holder, where = self.value(given, scope)
        text = holder.get("value")
        value = None if text is None else self._parsed(text, given.get("type", ""), holder, where)
        if value is None:
            return
        made = shader.CreateInput(given.get("name", ""), kind)
        made.Set(value)
        if space := holder.get("colorspace", where.color_space):
            made.GetAttr().SetColorSpace(space)

    def _parsed(self, text: str, kind: str, element: Element, scope: _Scope) -> object | None:
        """A value of a MaterialX type; None for one that it does not fit, or that no input has."""
        if kind == "filename":
            return self._document.asset(text, element, scope)
        if kind == "string":
            return text
        if kind == "boolean":
            return text.strip().lower() in ("true", "1")
        try:
            numbers = [float(part) for part in re.split(r"[,\s]+", text.strip()) if part]
        except ValueError:
            return None
        if kind == "integer":
            return int(numbers[0]) if numbers else None
        if kind == "float":
            return numbers[0] if numbers else None
        count = int(kind[-1]) if kind in TYPES else 0
        return VECTORS[count](*numbers) if count == len(numbers) else None


def _parsed(file: str) -> Element:
    """The root element of a file; a prefix of XInclude that was never declared, as people write it, is none."""
    with open(file, "rb") as opened:
        text = opened.read().strip()
    return ElementTree.fromstring(re.sub(rb"<(/?)xi:", rb"<\1", text))


def _with_includes(root: Element, folder: str, depth: int) -> Iterator[Element]:
    """The elements of a document and of those that it includes."""
    if depth > DEEPEST:
        raise ValueError("it includes itself")
    for element in root:
        if element.tag == "include" and (name := element.get("href")):
            file = os.path.join(folder, name)
            # Libraries that come with MaterialX are known without being read.
            if os.path.isfile(file):
                yield from _with_includes(_parsed(file), os.path.dirname(file), depth + 1)
        elif isinstance(element.tag, str):
            yield element


def _identifier(name: str) -> str:
    return re.sub(r"\W", "_", name, flags=re.ASCII) if name[:1].isalpha() or name[:1] == "_" else f"_{name}"
