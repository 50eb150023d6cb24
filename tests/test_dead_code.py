"""Nothing stands in the package that only tests call: what they need for themselves lies beside them.

By name alone, so that two things of one name hold each other up: what is found is dead for certain, what is not found may be.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from tests import fresh

# What nothing in the program names, and who uses it.
OTHERS = {
    "dask_setup": "Dask calls it in each worker that loads the module",
    "handleError": "logging calls it",
    "ReadFrames": "what an extension is to offer",
    "FindThings": "what an extension is to offer",
    "use_pause": "for programs that embed a flight",
}
TAKEN_BY = {"OPERATIONS"}  # decorators of these hand on what they decorate
DEFINED = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef


@cache
def sources(folder: str) -> dict[Path, ast.Module]:
    paths = sorted((fresh.ROOT / folder).rglob("*.py"))
    return {path: ast.parse(path.read_text(encoding="utf-8")) for path in paths}


def defined(body: list[ast.stmt], *, is_module: bool = True) -> Iterator[tuple[str, ast.AST]]:
    """Functions, classes and their methods, and a module's constants; not the fields of a class, which documents are made of."""
    for node in body:
        if isinstance(node, DEFINED):
            if not any(isinstance(part, ast.Name) and part.id in TAKEN_BY for part in parts(node.decorator_list)):
                yield node.name, node
            if isinstance(node, ast.ClassDef):
                yield from defined(node.body, is_module=False)
        elif isinstance(node, ast.If | ast.Try):
            yield from defined([part for part in ast.iter_child_nodes(node) if isinstance(part, ast.stmt)])
        elif is_module and isinstance(node, ast.Assign | ast.AnnAssign):
            for part in parts(node.targets if isinstance(node, ast.Assign) else [node.target]):
                if isinstance(part, ast.Name) and isinstance(part.ctx, ast.Store):
                    yield part.id, node


def parts(nodes: list[ast.expr]) -> Iterator[ast.AST]:
    for node in nodes:
        yield from ast.walk(node)


def used(node: ast.AST, inside: frozenset[str] = frozenset()) -> Iterator[str]:
    """Names that are read, but for what refers to itself: `inside` are the definitions around.

    A text that is one name may be given to getattr, or list what is offered.
    """
    match node:
        case ast.Name(name, ast.Load()) | ast.Attribute(ast.Name("self"), name, ast.Load()):
            yield from {name} - inside
        case ast.Attribute(_, name, ast.Load()) | ast.alias(name, str()):
            yield name
        case ast.Constant(str(text)) if text.isidentifier():
            yield text
    inside = inside | {node.name} if isinstance(node, DEFINED) else inside
    for part in ast.iter_child_nodes(node):
        yield from used(part, inside)


def only_defined(defining: dict[Path, ast.Module], using: dict[Path, ast.Module]) -> dict[str, str]:
    """What is defined and, but by itself, never used; by name, with its place."""
    uses = {name for tree in using.values() for name in used(tree)}
    return {
        name: f"{path.name}:{getattr(node, 'lineno', 0)}"
        for path, tree in defining.items()
        for name, node in defined(tree.body)
        if name not in uses and not (name.startswith("__") and name.endswith("__"))
    }


@pytest.mark.long
def test_nothing_is_there_for_tests_alone() -> None:
    found = only_defined(sources("gcs_mosaic"), sources("gcs_mosaic") | sources("sitl"))
    assert {name: place for name, place in found.items() if name not in OTHERS} == {}
    assert [name for name in OTHERS if name not in found] == [], "these are used by now, or gone"


def test_nothing_private_is_kept_that_nobody_reads() -> None:
    kept, read = dict[str, str](), set[str]()
    for path, tree in sources("gcs_mosaic").items():
        for node in ast.walk(tree):
            if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load):
                read.add(node.attr)
            elif isinstance(node, ast.Attribute) and node.attr.startswith("_"):
                kept[node.attr] = f"{path.name}:{node.lineno}"
    assert {name: place for name, place in kept.items() if name not in read} == {}


def test_what_is_dead_is_found() -> None:
    text = """
LEFT, USED = 1, 2

def again(n: int) -> int:
    return again(n - 1) + USED

class Thing(Base):
    def told(self) -> None:
        super().told()
    def asked(self) -> None: ...
    def named(self) -> None: ...
    def dead(self) -> None: ...

@OPERATIONS.add("GET")
def handler() -> None:
    getattr(Thing().asked(), "named")
"""
    tree = {Path("thing.py"): ast.parse(text)}
    assert set(only_defined(tree, tree)) == {"LEFT", "again", "dead"}
