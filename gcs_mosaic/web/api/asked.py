"""What somebody asks, read into the dataclass that describes it: the limits that are checked are those that are told."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import MISSING, Field
from types import UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, cast, get_args, get_origin

from aiohttp import web

from gcs_mosaic.notes.storage.checked import Unfit, number_of, text_of, whole_of
from gcs_mosaic.store.documents import Limits
from gcs_mosaic.web.api.common import body_of
from gcs_mosaic.web.api.schema import fields_of

Asked = TypeVar("Asked")
COUNTS = {2: "two", 3: "three", 4: "four"}
MOST, LONGEST = 1e9, 1000  # where nothing else is told
FREE = Limits()


async def asked_body(request: web.Request, kind: type[Asked]) -> Asked:
    """The JSON that was sent. Raises Unfit, and what `body_of` raises."""
    return read(kind, await body_of(request))


def asked_query(request: web.Request, kind: type[Asked]) -> Asked:
    """The parameters of the address. Raises Unfit."""
    hints = {name: hint for name, (_, hint) in fields_of(kind).items()}
    return read(kind, {name: _of_text(text, hints[name]) for name, text in request.query.items() if name in hints})


def read(kind: type[Asked], told: Mapping[str, Any]) -> Asked:
    """A dataclass of what was sent; what is not known is passed over. Raises Unfit."""
    values = {
        field.name: value_of(told.get(name), name, hint)
        for name, (field, hint) in fields_of(kind).items()
        if name in told or not _has_default(field)
    }
    return cast("Any", kind)(**values)  # type: ignore[no-any-return]


def value_of(told: Any, name: str, kind: Any, limits: Limits = FREE) -> Any:
    """What was sent as `name`, checked by its annotation. Raises Unfit."""
    origin, inside = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return value_of(told, name, inside[0], next((one for one in inside[1:] if isinstance(one, Limits)), limits))
    if origin in (Union, UnionType):
        return None if told is None and plain(kind) is not str else value_of(told, name, inside[0], limits)
    if origin is Literal and told not in inside:
        raise Unfit(f"{name} is to be {' or '.join(map(str, inside))}.")
    if origin is tuple:
        return _several(told, name, inside, limits)
    if kind is bool and not isinstance(told, bool):
        raise Unfit(f"{name} is to be true or false.")
    return _bounded(told, name, kind, limits)


def plain(kind: Any) -> Any:
    """A type without what is said of it, and without None."""
    while get_origin(kind) in (Annotated, Union, UnionType):
        kind = get_args(kind)[0]
    return kind


def _bounded(told: Any, name: str, kind: Any, limits: Limits) -> Any:
    least = -MOST if limits.least is None else limits.least
    most = MOST if limits.most is None else limits.most
    if kind is str:
        return text_of(told, name, limits.longest or LONGEST, lines=limits.lines, needed=bool(limits.shortest))
    if kind is int:
        return whole_of(told, name, math.ceil(least), math.floor(most))
    if kind is float:
        return number_of(told, name, least, most)
    if kind is bool or get_origin(kind) is Literal:
        return told
    raise TypeError(f"{name}: nobody knows how to check {kind!r}")


def _several(told: Any, name: str, kinds: tuple[Any, ...], limits: Limits) -> tuple[Any, ...]:
    if not isinstance(told, list | tuple) or len(told) != len(kinds):
        raise Unfit(f"{name} is to be {COUNTS[len(kinds)]} {'whole numbers' if plain(kinds[0]) is int else 'numbers'}.")
    return tuple(value_of(one, name, kind, limits) for one, kind in zip(told, kinds, strict=True))


def _of_text(text: str, kind: Any) -> Any:
    """A parameter as JSON would have it; what is no number stays a text, which is refused."""
    kind = plain(kind)
    kind = type(get_args(kind)[0]) if get_origin(kind) is Literal else kind
    if kind not in (int, float):
        return text
    try:
        value = float(text)
    except ValueError:
        return text
    return int(value) if kind is not float and value.is_integer() else value


def _has_default(field: Field[Any]) -> bool:
    return field.default is not MISSING
