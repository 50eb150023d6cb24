"""What a pickle may cost, found before anything of it is made.

A few bytes of a crafted pickle can ask for gigabytes (a memo of a billion places), for hours (tuples of tuples of the same tuple,
hashed), for an end of the process (tuples a million deep) or for a change of the program itself (the state of a class). So its
instructions are followed first, with numbers in the place of values. Only what this program's own pickles have is allowed: no
memo but the next place, nothing that is changed after it was referred to, and so no cycles. Then of each value it is known how
deep it is, and how much it holds, where it is used.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable
from enum import IntEnum
from functools import partial

LEAST_BYTES, FOLD = 64 << 20, 32  # that may be made, estimated from above: so many times the pickle's size more
DEEPEST = 100
LONGEST_NUMBER = 16  # bytes of an integer: its decimal digits cost the square


class Unbounded(ValueError):  # noqa: N818 - names a state
    """A pickle asks for what none of this program's own does."""


class Budget:
    """What may be made of some pickles together; `size`: theirs, bytes."""

    def __init__(self, size: int) -> None:
        self._left = LEAST_BYTES + FOLD * size

    def spend(self, size: int) -> None:
        """Raises Unbounded."""
        self._left -= size
        if self._left < 0:
            raise Unbounded("it makes far more than it holds")


class Kind(IntEnum):
    """Of a value, as far as it tells what may be done with it."""

    PLAIN = 0
    LIST = 1
    DICT = 2
    SET = 3
    GLOBAL = 4
    MADE = 5  # by a class or a function


class _Value:
    """`weight`: values in it, counted as often as it holds them."""

    __slots__ = ("depth", "is_shared", "kind", "weight")

    def __init__(self, kind: Kind) -> None:
        self.kind, self.weight, self.depth, self.is_shared = kind, 1, 1, False

    def hold(self, items: list[_Value]) -> None:
        for one in items:
            self.weight += one.weight
            self.depth = max(self.depth, one.depth + 1)
        if self.depth > DEEPEST:
            raise Unbounded("it is too deep")


LEAF = _Value(Kind.PLAIN)  # that holds nothing
# Bytes of the argument of what makes one, by instruction. A number costs less than FOLD times its bytes, the others nothing.
LEAVES = {code[0]: 0 for code in (pickle.NONE, pickle.NEWTRUE, pickle.NEWFALSE)}
LEAVES |= {pickle.BININT1[0]: 1, pickle.BININT2[0]: 2, pickle.BININT[0]: 4, pickle.BINFLOAT[0]: 8}
STOP = pickle.STOP[0]
# Bytes of the length of an argument.
COUNTED = {pickle.SHORT_BINUNICODE: 1, pickle.SHORT_BINBYTES: 1, pickle.BINUNICODE: 4, pickle.BINBYTES: 4}
COUNTED |= {pickle.BINUNICODE8: 8, pickle.BINBYTES8: 8, pickle.BYTEARRAY8: 8, pickle.LONG1: 1}
TEXTS = (pickle.SHORT_BINUNICODE, pickle.BINUNICODE, pickle.BINUNICODE8)
EMPTY = {pickle.EMPTY_TUPLE: Kind.PLAIN, pickle.EMPTY_LIST: Kind.LIST}
EMPTY |= {pickle.EMPTY_DICT: Kind.DICT, pickle.EMPTY_SET: Kind.SET}
COST = {Kind.PLAIN: 64, Kind.LIST: 64, Kind.DICT: 64, Kind.SET: 216, Kind.GLOBAL: 0, Kind.MADE: 640}  # bytes
PER_ITEM = {Kind.PLAIN: 8, Kind.LIST: 9, Kind.DICT: 60, Kind.SET: 80, Kind.GLOBAL: 0, Kind.MADE: 100}
PER_VALUE = 60  # that is hashed, or given to what copies it


def refuse_unbounded(data: bytes, budget: Budget | None = None) -> None:
    """Raises Unbounded if reading this pickle might cost much more than it holds, or do anything but make values. `budget`: that
    of several together."""
    _Followed(data, budget or Budget(len(data))).follow()


class _Followed:
    def __init__(self, data: bytes, budget: Budget) -> None:
        self._data, self._at, self._spend = data, 0, budget.spend
        self._stack: list[_Value] = []
        self._marks: list[int] = []
        self._memo: list[_Value] = []
        self._does = self._instructions()

    def follow(self) -> None:
        data, does, leaves, push, end = self._data, self._does, LEAVES, self._stack.append, len(self._data)
        while self._at < end:
            instruction = data[self._at]
            if (size := leaves.get(instruction)) is not None:
                self._at += 1 + size
                push(LEAF)
                continue
            self._at += 1
            if instruction == STOP:
                return self._end()
            do = does.get(instruction)
            if do is None:
                raise Unbounded(f"it has the instruction {instruction:#04x}")
            do()
        raise Unbounded("it has no end")

    def _end(self) -> None:
        if self._at != len(self._data) or len(self._stack) != 1 or self._marks:
            raise Unbounded("it has a part that nothing needs")

    def _instructions(self) -> dict[int, Callable[[], None]]:
        does: dict[bytes, Callable[[], None]] = {
            pickle.PROTO: partial(self._skip, 1),
            pickle.FRAME: self._frame,
            pickle.MARK: lambda: self._marks.append(len(self._stack)),
            pickle.MEMOIZE: lambda: self._memo.append(self._top()),
            pickle.BINGET: partial(self._get, 1),
            pickle.LONG_BINGET: partial(self._get, 4),
            pickle.TUPLE: lambda: self._tuple(self._since_mark()),
            pickle.TUPLE1: lambda: self._tuple(self._pop(1)),
            pickle.TUPLE2: lambda: self._tuple(self._pop(2)),
            pickle.TUPLE3: lambda: self._tuple(self._pop(3)),
            pickle.APPEND: lambda: self._add(self._pop(1), Kind.LIST),
            pickle.APPENDS: lambda: self._add(self._since_mark(), Kind.LIST),
            pickle.SETITEM: lambda: self._set_items(self._pop(2)),
            pickle.SETITEMS: lambda: self._set_items(self._since_mark()),
            pickle.ADDITEMS: lambda: self._add(self._weigh(self._since_mark()), Kind.SET),
            pickle.FROZENSET: lambda: self._tuple(self._weigh(self._since_mark())),
            pickle.STACK_GLOBAL: lambda: self._made_of(self._pop(2), Kind.GLOBAL),
            pickle.REDUCE: lambda: self._called(self._pop(2)),
            pickle.NEWOBJ: lambda: self._called(self._pop(2)),
            pickle.NEWOBJ_EX: lambda: self._called(self._pop(3)),
            pickle.BUILD: lambda: self._add(self._pop(1), Kind.MADE),
        }
        does |= {code: partial(self._counted, code, size) for code, size in COUNTED.items()}
        does |= {code: partial(self._empty, kind) for code, kind in EMPTY.items()}
        return {code[0]: do for code, do in does.items()}

    def _empty(self, kind: Kind) -> None:
        self._push(_Value(kind))

    def _push(self, value: _Value) -> None:
        self._spend(COST[value.kind])
        self._stack.append(value)

    def _skip(self, size: int) -> None:
        if size > len(self._data) - self._at:
            raise Unbounded("it is cut off")
        self._at += size

    def _number(self, size: int) -> int:
        self._skip(size)
        return int.from_bytes(self._data[self._at - size : self._at], "little")

    def _frame(self) -> None:
        if self._number(8) > len(self._data) - self._at:
            raise Unbounded("it is cut off")

    def _counted(self, code: bytes, size: int) -> None:
        length = self._number(size)
        self._skip(length)
        if code == pickle.LONG1 and length > LONGEST_NUMBER:
            raise Unbounded("it has a number of too many digits")
        self._spend(
            COST[Kind.PLAIN] + length * (4 if code in TEXTS else 1)
        )  # a text may take four bytes for each letter
        self._stack.append(LEAF)

    def _top(self) -> _Value:
        if len(self._stack) <= (self._marks[-1] if self._marks else 0):
            raise Unbounded("it takes what is not there")
        return self._stack[-1]

    def _pop(self, count: int) -> list[_Value]:
        start = len(self._stack) - count
        if start < (self._marks[-1] if self._marks else 0):
            raise Unbounded("it takes what is not there")
        taken = self._stack[start:]
        del self._stack[start:]
        return taken

    def _since_mark(self) -> list[_Value]:
        if not self._marks:
            raise Unbounded("it takes what is not there")
        start = self._marks.pop()
        taken = self._stack[start:]
        del self._stack[start:]
        return taken

    def _get(self, size: int) -> None:
        place = self._number(size)
        if place >= len(self._memo):
            raise Unbounded("it refers to what is not there")
        value = self._memo[place]
        value.is_shared = True
        self._stack.append(value)

    def _made_of(self, parts: list[_Value], kind: Kind) -> None:
        self._spend(PER_ITEM[kind] * len(parts))
        value = _Value(kind)
        value.hold(parts)
        self._push(value)

    def _tuple(self, items: list[_Value]) -> None:
        self._made_of(items, Kind.PLAIN)

    def _called(self, parts: list[_Value]) -> None:
        if parts[0].kind != Kind.GLOBAL:
            raise Unbounded("it calls a value")
        self._weigh(parts[1:])
        self._made_of(parts, Kind.MADE)

    def _add(self, items: list[_Value], kind: Kind) -> None:
        """To a value that nothing refers to yet: nobody has taken note of what it holds."""
        value = self._top()
        if value.is_shared or value.kind not in (kind, Kind.MADE):
            raise Unbounded("it changes a value that is in use")
        value.hold(items)
        self._spend(PER_ITEM[value.kind] * len(items))

    def _set_items(self, items: list[_Value]) -> None:
        self._weigh(items[::2])
        self._add(items, Kind.DICT)

    def _weigh(self, items: list[_Value]) -> list[_Value]:
        self._spend(PER_VALUE * sum(one.weight for one in items))
        return items
