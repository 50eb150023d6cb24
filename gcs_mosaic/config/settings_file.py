"""Builds nested settings dataclasses from YAML, validated."""

from __future__ import annotations

import dataclasses
import difflib
import math
import types
import typing
from pathlib import Path
from typing import Any

from gcs_mosaic.config import yaml_text
from gcs_mosaic.errors import UsageError
from gcs_mosaic.outside import outside

LONGEST_SHOWN = 80  # characters of a value that is refused


def documented_defaults() -> str:
    """Every setting with its default, unit and reason, as YAML."""
    return outside("config/default.yaml").read_text(encoding="utf-8")


def read_settings(path: Path) -> dict[str, Any]:
    """The mapping in a YAML file. Raises UsageError if it cannot be read or is not a mapping."""
    try:
        with path.open("rb") as file:
            document = yaml_text.parsed(file.read(yaml_text.MOST_BYTES + 1))
    except OSError as error:
        raise UsageError(
            f"The configuration {path} cannot be read ({error.strerror}); give an existing YAML file."
        ) from None
    except yaml_text.NotReadable as error:
        raise UsageError(f"The configuration {path} is not YAML with settings: {error}.") from None
    return as_mapping({} if document is None else document, str(path))


def as_mapping(values: object, where: str) -> dict[str, Any]:
    """The values as a mapping of settings. Raises UsageError if they are none."""
    if not isinstance(values, dict):
        raise UsageError(f"{where}: expected settings as 'name: value' lines, got {shown(values)}.")
    return values


def from_mapping(kind: type, values: object, where: str) -> Any:
    """A settings dataclass from a mapping of some or all of its fields, validated recursively."""
    names, values = fields_of(kind), as_mapping(values, where)
    hints = {name: hint for name, hint in typing.get_type_hints(kind).items() if name in names}
    for key in values:
        if key not in hints:
            raise UsageError(
                f"{where}: {shown(key)} is not a setting{nearest(str(key), hints)}; gcs-mosaic config shows all."
            )
    given = {key: value_of(hints[key], value, f"{where}: {key}") for key, value in values.items()}
    try:
        return kind(**given)
    except ValueError as error:
        raise UsageError(f"{where}: {error}.") from None


def shown(value: object) -> str:
    """What somebody has written, in so many characters and on one line."""
    try:
        text = repr(value)
    except ValueError:  # a whole number of more than 4,300 digits
        return "a very long number"
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}…"


def nearest(key: str, known: dict[str, Any]) -> str:
    """What may have been meant by a name that is no setting, for the end of a sentence."""
    deeper = [name for name, kind in known.items() if key in fields_of(kind)]
    if deeper:
        return " (did you mean " + " or ".join(f"'{name}: {{{key}: ...}}'" for name in deeper) + "?)"
    close = difflib.get_close_matches(key[:LONGEST_SHOWN], known, n=1, cutoff=0.5)
    return f" (did you mean {close[0]!r}?)" if close else f" (there are {', '.join(known)})"


def fields_of(kind: Any) -> list[str]:
    """The names of a dataclass's settings; none of what is no dataclass."""
    if not dataclasses.is_dataclass(kind):
        return []
    return [field.name for field in dataclasses.fields(kind) if field.metadata.get("setting", True)]


def value_of(kind: Any, value: object, where: str) -> Any:
    """The value converted to type `kind`. Raises UsageError."""
    if dataclasses.is_dataclass(kind):
        return from_mapping(typing.cast(type, kind), value, where)
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin in (types.UnionType, typing.Union):
        if value is None and type(None) in arguments:
            return None
        wanted = [argument for argument in arguments if argument is not type(None)]
        return value_of(next((kind for kind in wanted if type(value) is kind), wanted[-1]), value, where)
    if origin is typing.Literal:
        if value not in arguments:
            raise UsageError(f"{where}: expected one of {', '.join(map(str, arguments))}, got {shown(value)}.")
        return value
    if origin is tuple:
        items = value if isinstance(value, list) else [value]
        return tuple(value_of(arguments[0], item, where) for item in items)
    return _plain(kind, value, where)


def _plain(kind: type, value: object, where: str) -> Any:
    names = {int: "a whole number", float: "a number", bool: "true or false", str: "text"}
    fits = isinstance(value, kind) or (kind is float and isinstance(value, int))
    if isinstance(value, bool) and kind is not bool:
        fits = False
    if not fits or (isinstance(value, float) and not math.isfinite(value)):
        raise UsageError(f"{where}: expected {names.get(kind, kind.__name__)}, got {shown(value)}.")
    try:
        return kind(value)
    except OverflowError:
        raise UsageError(f"{where}: expected {names[kind]}, got {shown(value)}, which is too large.") from None
