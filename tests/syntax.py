"""The syntax of the project's files, for tests of its manners."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path


def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_bytes())


def statements(node: ast.AST) -> Iterator[ast.AST]:
    """All statements within, at any depth: expressions, which are nine nodes of ten, hold none and are passed over."""
    for part in ast.iter_child_nodes(node):
        if not isinstance(part, ast.expr):
            yield part
            yield from statements(part)
