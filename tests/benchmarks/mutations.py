"""Small faults that can be put into a file, one at a time."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

COMPARED: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
CALCULATED: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
}
# What no test of behaviour can notice: types, and what is said to who reads the log.
UNSEEN = ("annotation", "returns", "decorator_list", "type_params")
LOGGED = ("logger", "logging", "warnings")


@dataclass(frozen=True, slots=True)
class Mutant:
    """A fault: in the tree of a file the node at `field` (and `index`) of `parent` becomes another one."""

    path: Path
    line: int
    where: str  # the function
    old: str
    new: str
    tree: ast.Module
    parent: ast.AST
    field: str
    index: int | None
    node: ast.AST
    lines: range  # of the statement

    def __str__(self) -> str:
        """The same as long as the code is, wherever it stands."""
        return f"{self.path} {self.where}: {self.old}  ->  {self.new}"

    def text(self) -> str:
        """The file with this fault."""
        before = self._put(self.node)
        text = ast.unparse(ast.fix_missing_locations(self.tree))
        self._put(before)
        return text

    def _put(self, node: ast.AST) -> ast.AST:
        if self.index is None:
            before: ast.AST = getattr(self.parent, self.field)
            setattr(self.parent, self.field, node)
            return before
        items: list[ast.AST] = getattr(self.parent, self.field)
        before, items[self.index] = items[self.index], node
        return before


def mutants_of(path: Path, root: Path) -> Iterator[Mutant]:
    """Every fault that can be put into a file."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for where, lines, parent, field, index, node in _places(tree, "module", range(0)):
        for new in _others(node, parent):
            old, text = ast.unparse(node), ast.unparse(ast.fix_missing_locations(ast.Module([_as_statement(new)], [])))
            line = getattr(node, "lineno", 0)
            first, changed = (text.splitlines()[0] for text in (old, text))
            yield Mutant(path.relative_to(root), line, where, first, changed, tree, parent, field, index, new, lines)


def _as_statement(node: ast.AST) -> ast.stmt:
    return node if isinstance(node, ast.stmt) else ast.Expr(node)  # type: ignore[arg-type]


Place = tuple[str, range, ast.AST, str, int | None, ast.AST]


def _places(parent: ast.AST, where: str, lines: range) -> Iterator[Place]:
    """All statements and expressions, but for those that only readers see."""
    if isinstance(parent, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
        where = parent.name if where == "module" else f"{where}.{parent.name}"
    for field, value in ast.iter_fields(parent):
        if field in UNSEEN:
            continue
        several = isinstance(value, list)
        for index, node in enumerate(value if several else [value]):
            if isinstance(node, ast.AST) and not _is_for_readers(node):
                spans = _lines_of(node) if isinstance(node, ast.stmt) else lines
                yield where, spans, parent, field, index if several else None, node
                yield from _places(node, where, spans)


def _lines_of(node: ast.stmt) -> range:
    """Those of a statement, without what it holds if that is other statements."""
    body = getattr(node, "body", None)
    last = max(body[0].lineno - 1, node.lineno) if isinstance(body, list) and body else node.end_lineno or node.lineno
    return range(node.lineno, last + 1)


def _is_for_readers(node: ast.AST) -> bool:
    if isinstance(node, ast.Assert | ast.Raise | ast.Import | ast.ImportFrom | ast.JoinedStr):
        return True
    call = node.value if isinstance(node, ast.Expr) else None
    return isinstance(call, ast.Constant) or (isinstance(call, ast.Call) and ast.unparse(call).startswith(LOGGED))


def _others(node: ast.AST, parent: ast.AST) -> Iterator[ast.AST]:
    """What this node becomes in each of its faults."""
    match node:
        case ast.Compare(left, [op], right):
            yield from (ast.Compare(left, [other()], right) for other in COMPARED[type(op)])
        case ast.BoolOp(op, values):
            yield ast.BoolOp(ast.Or() if isinstance(op, ast.And) else ast.And(), values)
            yield values[0] if len(values) == 2 else ast.BoolOp(op, values[:-1])
        case ast.UnaryOp(ast.Not(), operand):
            yield operand
        case ast.BinOp(_, _, ast.Constant(str()) | ast.JoinedStr()) | ast.BinOp(ast.Constant(str()) | ast.JoinedStr()):
            return  # a path or a text: whoever runs it notices
        case ast.BinOp(left, op, right) if type(op) in CALCULATED:
            yield ast.BinOp(left, CALCULATED[type(op)](), right)
        case ast.Constant(bool(value)):
            yield ast.Constant(not value)
        case ast.Constant(int() | float() as value):
            yield ast.Constant(value + 1)
        case ast.Return(value) if value is not None and not isinstance(value, ast.Constant):
            yield ast.Return(ast.Constant(None))
        case ast.Expr(ast.Call() | ast.YieldFrom()):
            yield ast.Pass()
        case ast.If(_, body, orelse) if not isinstance(parent, ast.Module):
            yield ast.If(ast.Constant(False), body, orelse)
