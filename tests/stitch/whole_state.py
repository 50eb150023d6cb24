"""All that is kept in memory, as one digest: whoever keeps anything anywhere changes it.

Everything that can be reached from an object is told by its value, byte for byte, whether it belongs to a transaction or not;
and so is what modules and classes of the package keep.
"""

import hashlib
import itertools
import sys
from array import array
from collections import deque
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import PurePath
from types import BuiltinFunctionType, FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np

from gcs_mosaic.render.render_list import RenderList
from gcs_mosaic.render.tile_cache import Store, _Held
from gcs_mosaic.stitch.features.retrieval import PER_FRAME, RetrievalIndex
from gcs_mosaic.store.array_shelf import ArrayShelf, ShelvedArray

PLAIN = (type(None), bool, int, float, str, bytes, np.generic, PurePath, itertools.count)
CODE = (type, FunctionType, BuiltinFunctionType, MethodType, ModuleType)
# What goes on outside whatever is undone here: a worker is given its task again, files and threads are no memory, what looks
# on may be let go, and what is only kept at hand can be had again; what processes can decode belongs to the pictures.
OUTSIDE = {"_worker", "_worker_is_at", "_observer", "_observers", "ledger", "_pool", "_file", "_frame_cache", "_maker"}
OUTSIDE |= {"decoders"}
# Spare room, where an array is, and which of equal tiles stands for all: none says anything about what is kept.
NO_STATE: dict[type, set[str]] = {
    Store: {"_cached", "_holes", "_end", "_used", "problem"},
    ArrayShelf: {"_cached", "_used", "_numbers", "_gone", "problem"},
    RenderList: {"_tiles"},
}


def digest(*roots: object) -> str:
    """Of everything that can be reached from these objects, and of all that modules and classes keep."""
    teller = _Teller()
    for root in roots:
        teller.tell(root)
    for name in sorted(name for name in sys.modules if name.startswith("gcs_mosaic.")):
        abouts: list[ModuleType | type] = [sys.modules[name], *_classes_of(sys.modules[name])]
        for about in abouts:
            for key, value in sorted(vars(about).items()):
                if not key.startswith("__") and isinstance(value, (dict, list, set, deque, np.ndarray, *PLAIN)):
                    teller.tell((name, about.__name__, key, value))
    return teller.hash.hexdigest()


def _classes_of(module: ModuleType) -> list[type]:
    found = [value for value in vars(module).values() if isinstance(value, type)]
    return sorted((one for one in found if one.__module__ == module.__name__), key=lambda one: one.__qualname__)


def _is_frozen(value: object) -> bool:
    return is_dataclass(value) and bool(getattr(type(value), "__dataclass_params__").frozen)  # noqa: B009


class _Teller:
    def __init__(self) -> None:
        self.hash = hashlib.blake2b()
        self._met: dict[int, int] = {}  # objects that may hold each other, by id

    def tell(self, value: object) -> None:
        self._write(type(value).__qualname__)
        match value:
            case np.ndarray():
                self._write(f"{value.dtype}{value.shape}")
                self.hash.update(np.ascontiguousarray(value).tobytes())
            case array():
                self.hash.update(value.tobytes())
            case Mapping():
                self._all([part for item in value.items() for part in item])
            case set() | frozenset():
                self._all(sorted(value, key=repr))
            case tuple() | list() | deque():
                self._all(list(value))
            case _ if isinstance(value, PLAIN):
                self._write(repr(value))
            case _ if isinstance(value, CODE):
                pass
            case _ if type(value).__module__.startswith("gcs_mosaic."):
                self._tell_object(value)

    def _tell_object(self, value: Any) -> None:
        if id(value) in self._met and not _is_frozen(value):
            self._write(f"again {self._met[id(value)]}")
            return
        self._met[id(value)] = len(self._met)
        if isinstance(value, _Held):
            return  # told by the store
        if isinstance(value, ShelvedArray):
            self.tell(value.exact())
            return
        known = dict(vars(value)) if hasattr(value, "__dict__") else {}
        if is_dataclass(value):
            known |= {field.name: getattr(value, field.name) for field in fields(value)}
        for name in sorted(known.keys() - OUTSIDE - NO_STATE.get(type(value), set())):
            self._write(name)
            if isinstance(value, RetrievalIndex) and name == "_blocks":
                self.tell([value._stored(np.arange(value._count * PER_FRAME)) for _ in value._blocks[:1]])
            elif isinstance(value, Store) and name == "_held":
                self.tell({repr(key): _value(value, value._held[key]) for key in sorted(value._held, key=repr)})
            else:
                self.tell(known[name])

    def _all(self, values: list[Any]) -> None:
        self._write(str(len(values)))
        for value in values:
            self.tell(value)

    def _write(self, text: str) -> None:
        self.hash.update(text.encode() + b"\0")


def _value(store: Store, held: _Held) -> object:
    """A value, without the store's noticing that it was asked for."""
    return store._read(held) if held.value is None else held.value
