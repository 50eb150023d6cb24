"""Nothing stands in the package that only tests call: what they need for themselves lies beside them.

By name alone, so that two things of one name hold each other up: what is found is dead for certain, what is not found may be.
"""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from tests import fresh

# What nothing in the program names, and who uses it.
OTHERS = {
    "dask_setup": "Dask calls it in each worker that loads the module",
    "handleError": "logging calls it",
    "ReadFrames": "what an extension is to offer",
    "FindThings": "what an extension is to offer",
    "use_pause": "for programs that embed a flight",
}
OWN_USES = 4  # nothing refers more often to itself
TAKEN_BY = {"OPERATIONS"}  # decorators of these hand on what they decorate
DEFINED = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef


@cache
def sources(*folders: str) -> dict[Path, ast.Module]:
    paths = [path for folder in folders for path in sorted((fresh.ROOT / folder).rglob("*.py"))]
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


def used(tree: ast.AST) -> Counter[str]:
    """Names that are read; a text that is one name may be given to getattr, or list what is offered."""
    names = Counter[str]()
    for node in ast.walk(tree):
        match node:
            case ast.Name(name, ast.Load()) | ast.Attribute(_, name, ast.Load()) | ast.alias(name, str()):
                names[name] += 1
            case ast.Constant(str(text)) if text.isidentifier():
                names[text] += 1
    return names


def overriding(node: ast.AST, name: str) -> int:
    """How often the one of this name in a base class is called: whoever calls that one calls this one."""
    calls = (part for part in ast.walk(node) if isinstance(part, ast.Attribute) and part.attr == name)
    return sum(isinstance(part.value, ast.Call) and ast.unparse(part.value) == "super()" for part in calls)


def only_defined(defining: dict[Path, ast.Module], using: dict[Path, ast.Module]) -> dict[str, str]:
    """What is defined and, but by itself, never used; by name, with its place."""
    uses = Counter[str]()
    for tree in using.values():
        uses.update(used(tree))
    return {
        name: f"{path.name}:{getattr(node, 'lineno', 0)}"
        for path, tree in defining.items()
        for name, node in defined(tree.body)
        if not (name.startswith("__") and name.endswith("__"))
        if uses[name] <= OWN_USES and uses[name] <= used(node)[name] - overriding(node, name)
    }


def test_nothing_is_there_for_tests_alone() -> None:
    found = only_defined(sources("gcs_mosaic"), sources("gcs_mosaic", "sitl"))
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
