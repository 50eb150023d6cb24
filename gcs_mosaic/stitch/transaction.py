"""All or nothing: state kept between frames changes as a whole or not at all.

Whatever outlives a frame is an attribute of a `Kept` object and consists of immutable values or of containers of such values.
So a shallow copy of the containers is a full snapshot, and restoring it undoes any change: there is no undo list that could be
incomplete. An attribute that could not be restored is refused when the first snapshot is taken.
"""

from __future__ import annotations

import copy
import dataclasses
import enum
import logging
from array import array
from collections import Counter, OrderedDict, deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import PurePath
from types import BuiltinFunctionType, FunctionType, MethodType, TracebackType
from typing import Any, ClassVar, TypeVar

import numpy as np

logger = logging.getLogger(__name__)

T = TypeVar("T")

CONTAINERS = (dict, list, set, OrderedDict, Counter, deque, np.ndarray, array)
CALLBACKS = (FunctionType, BuiltinFunctionType, MethodType)
VALUES = (
    *(type(None), bool, int, float, str, bytes, tuple, frozenset, np.generic, enum.Enum, PurePath, type),
    *CALLBACKS,
)

Snapshot = dict[str, Any]


class Kept:
    """Base class of everything that keeps state between frames.

    `FIXED` names attributes that no frame changes: settings, stateless helpers, threads, files.
    """

    FIXED: ClassVar[frozenset[str]] = frozenset()

    def snapshot(self) -> Snapshot:
        """The present state, for one `restore`. TypeError for an attribute that could not be restored."""
        return {name: _copied(name, value) for name, value in vars(self).items() if name not in self.FIXED}

    def restore(self, before: Snapshot) -> None:
        """Return to the snapshot. An attribute that raises does not keep the others from being restored."""
        for name in vars(self).keys() - before.keys() - self.FIXED:
            delattr(self, name)
        _restore_all(partial(_put_back, self, name, value) for name, value in before.items())

    def saved(self) -> Snapshot:
        """What is kept, to be written to a file: no callbacks, nothing FIXED, and of parts what they have saved."""
        kept = {name: value for name, value in vars(self).items() if name not in self.FIXED}
        return {name: _saved(value) for name, value in kept.items() if not isinstance(value, CALLBACKS)}

    def load(self, saved: Snapshot) -> None:
        """Be as when this was saved. Made for an object that has just been made in the same way as that one."""
        for name, value in saved.items():
            part = getattr(self, name)
            if isinstance(part, Kept):
                part.load(value)
            else:
                setattr(self, name, value.array() if isinstance(value, Numbers) else value)


@dataclasses.dataclass(frozen=True, slots=True)
class Numbers:
    """An array that may change where it is kept, or is soon replaced, as it was; all others never change, and stay."""

    kind: str
    shape: tuple[int, ...]
    data: bytes

    @staticmethod
    def of(array: np.ndarray[Any, Any]) -> Numbers:
        return Numbers(array.dtype.str, array.shape, array.tobytes())

    def array(self) -> np.ndarray[Any, Any]:
        return np.frombuffer(self.data, np.dtype(self.kind)).reshape(self.shape).copy()


def _saved(value: object) -> object:
    if isinstance(value, Kept):
        return value.saved()
    if isinstance(value, np.ndarray):
        return Numbers.of(value)
    return value


@dataclasses.dataclass(frozen=True, slots=True)
class _Part:
    """A `Kept` object inside another one, and its snapshot."""

    owner: Kept
    before: Snapshot


def _put_back(owner: Kept, name: str, value: object) -> None:
    if isinstance(value, _Part):
        setattr(owner, name, value.owner)
        value.owner.restore(value.before)
    else:
        setattr(owner, name, value)


def _restore_all(steps: Iterable[Callable[[], None]]) -> None:
    """Run every step even if others raise; the first error is raised afterwards. A partial restore is worse than either state."""
    first: BaseException | None = None
    for step in steps:
        try:
            step()
        except BaseException as error:
            logger.exception("a part could not be put back as it was")
            first = first or error
    if first is not None:
        raise first


def _copied(name: str, value: object) -> object:
    if isinstance(value, Kept):
        return _Part(value, value.snapshot())
    if isinstance(value, CONTAINERS):
        return copy.copy(value)
    if isinstance(value, VALUES) or _is_frozen(value):
        return value
    raise TypeError(f"{name} is a {type(value).__name__}, which cannot be put back as it was")


def _is_frozen(value: object) -> bool:
    return dataclasses.is_dataclass(value) and bool(getattr(type(value), "__dataclass_params__").frozen)  # noqa: B009


class Attempt:
    """A trial change: undone at its end unless `keep` was called."""

    def __init__(self) -> None:
        self.kept = False

    def keep(self) -> None:
        self.kept = True


@contextmanager
def attempt(*parts: Kept) -> Iterator[Attempt]:
    """Try a change of these parts; they are restored unless it is kept, and whenever anything raises."""
    before = [part.snapshot() for part in parts]
    trial, raised = Attempt(), True
    try:
        yield trial
        raised = False
    finally:
        if raised or not trial.kept:
            _restore_all(partial(part.restore, snapshot) for part, snapshot in zip(parts, before, strict=True))


@contextmanager
def transaction(*parts: Kept) -> Iterator[None]:
    """Change these parts; if anything raises, they are restored."""
    with attempt(*parts) as trial:
        yield
        trial.keep()


class EachWhole:
    """Context for several steps that change these parts, each atomically.

    A step that raises is undone and logged as `otherwise`, and the others still run; the first error is raised at the end.
    """

    def __init__(self, *parts: Kept, otherwise: str) -> None:
        self._parts = parts
        self._otherwise = otherwise
        self._first: Exception | None = None

    def __enter__(self) -> EachWhole:
        return self

    def tried(self, step: Callable[[], T]) -> T | None:
        """The step's result, or None if it raised."""
        try:
            with transaction(*self._parts):
                return step()
        except Exception as error:
            # The first error is re-raised: whoever catches it decides whether to log its traceback.
            logger.warning("%s (%r)", self._otherwise, error, exc_info=self._first is not None)
            self._first = self._first or error
            return None

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        if error is None and self._first is not None:
            raise self._first
