"""JSON schemas of what is asked and answered, made of dataclasses: their annotations tell units, meanings and limits.

`Annotated[float, Limits(least=0, most=10), "seconds"]` is a number from 0 to 10 that is described as "seconds".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from gcs_mosaic.store.documents import Limits

Schema = dict[str, Any]
NAMES = {int: "integer", float: "number", str: "string", bool: "boolean", NoneType: "null"}
WORDS = {"least": "minimum", "most": "maximum", "shortest": "minLength", "longest": "maxLength", "pattern": "pattern"}
SUFFIXES = ("Answer", "Body", "Document", "Entry")  # of classes that others of the program share a name with but for it
ASKED = (
    "Body",
    "Query",
)  # what has a default need not be sent; of what is told only None is left out, where it is the default


class Schemas:
    """Schemas of types. `named`: those of the dataclasses that were met, by their names in the API.

    `closed` ones take no property that is not told, for tests; a client must not mind one that is new.
    """

    def __init__(self, *, closed: bool = False) -> None:
        self.named: dict[str, Schema] = {}
        self._kinds: dict[str, Any] = {}
        self._closed = closed

    def of(self, kind: Any) -> Schema:
        """The schema of a type. Raises TypeError for one that no JSON is made of."""
        origin, inside = get_origin(kind), get_args(kind)
        if origin is Annotated:
            return self.of(inside[0]) | _told(inside[1:])
        if kind in NAMES:
            return {"type": NAMES[kind]}
        if kind is dict:
            return {"type": "object"}
        if origin is Literal:
            return {"type": NAMES[type(inside[0])], "enum": list(inside)}
        if origin in (Union, UnionType):
            return self._either([self.of(one) for one in inside])
        if origin is tuple and inside[-1] is not Ellipsis:
            return {**self._several(inside[0]), "minItems": len(inside), "maxItems": len(inside)}
        if origin in (tuple, list, Sequence):
            return self._several(inside[0])
        if origin in (dict, Mapping):
            return {"type": "object", "additionalProperties": self.of(inside[1])}
        if is_dataclass(kind):
            return {"$ref": f"#/components/schemas/{self._named(kind)}"}
        raise TypeError(f"there is no JSON schema of {kind!r}")

    def _several(self, kind: Any) -> Schema:
        return {"type": "array", "items": self.of(kind)}

    def _either(self, schemas: Sequence[Schema]) -> Schema:
        first, last = schemas[0], schemas[-1]
        if len(schemas) == 2 and last == {"type": "null"} and "type" in first and "enum" not in first:
            return first | {"type": [first["type"], "null"]}
        return {"anyOf": list(schemas)}

    def _named(self, kind: Any) -> str:
        name = name_of(kind)
        if self._kinds.setdefault(name, kind) is not kind:
            raise TypeError(f"{kind!r} and {self._kinds[name]!r} would have one name in the API")
        if name not in self.named:
            self.named[name] = {}  # it may hold itself
            asked = kind.__name__.endswith(ASKED)
            told = {
                one: self.of(hint) | (_default(field) if asked else {})
                for one, (field, hint) in fields_of(kind).items()
            }
            needed = [
                one
                for one, (field, _) in fields_of(kind).items()
                if (field.default is MISSING if asked else field.default is not None)
            ]
            about = {"description": said} if (said := doc_of(kind)) else {}
            closed = {"additionalProperties": False} if self._closed else {}
            self.named[name] = {"type": "object", "properties": told, "required": needed, **about, **closed}
        return name


def name_of(kind: type) -> str:
    """A dataclass' name in the API."""
    for suffix in SUFFIXES:
        if kind.__name__.endswith(suffix):
            return kind.__name__.removesuffix(suffix)
    return kind.__name__


def doc_of(kind: type) -> str:
    """A docstring in one line; empty if a dataclass has none of its own."""
    said = kind.__doc__ or ""
    return "" if said.startswith(f"{kind.__name__}(") else " ".join(said.split())


def fields_of(kind: Any) -> dict[str, tuple[Field[Any], Any]]:
    """A dataclass' fields with their annotations, by their names in JSON: `from_` is `from`."""
    return _fields_of(kind)


@cache
def _fields_of(kind: Any) -> dict[str, tuple[Field[Any], Any]]:
    hints = get_type_hints(kind, include_extras=True)
    return {one.name.rstrip("_"): (one, hints[one.name]) for one in fields(kind)}


def _default(field: Field[Any]) -> Schema:
    return {} if field.default is MISSING or field.default is None else {"default": field.default}


def _told(extras: Sequence[Any]) -> Schema:
    """What limits and texts beside a type add to its schema."""
    told: Schema = {}
    for extra in extras:
        if isinstance(extra, Limits):
            told |= {word: value for name, word in WORDS.items() if (value := getattr(extra, name)) is not None}
        elif isinstance(extra, str):
            told["description"] = extra
    return told
