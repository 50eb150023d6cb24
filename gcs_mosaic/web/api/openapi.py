"""The description that is served, OpenAPI 3.1, made of the operations and the types of what they ask and answer."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

from gcs_mosaic.web.api.common import LARGEST_BODY
from gcs_mosaic.web.api.operations import PARAMETER, Failures, JsonLines, Media, Operation, Reply
from gcs_mosaic.web.api.schema import Schema, Schemas

ABOUT = (
    "Canvas places are those of an island. Whoever asks from another machine brings the token, as `Authorization: Bearer` "
    "or as the page's cookie."
)
ALWAYS: Failures = {
    400: "What was sent is unfit, in a sentence.",
    401: Reply("Whoever asks has not brought the token.", Media(("text/html",))),
    403: "The Host header names another server.",
    429: "Too many wrong tokens have come from this address.",
}
WRITING = {403: "Who may only look, or another site's page, may not write."}
SENDING = {
    413: f"The body is too large ({LARGEST_BODY >> 10} KiB at most).",
    415: "The body's charset is not known.",
}
PARTS: Failures = {
    412: Reply("The file is another by now, by If-Match or If-Unmodified-Since.", None),
    416: Reply("The file has no such part.", None),
}
DIGITS = re.compile(r"\[0-9\]\{1,(\d+)\}")
CHOICE = re.compile(r"\(([\w|]+)\)")


def description(operations: Iterable[Operation], *, closed: bool = False) -> dict[str, Any]:
    """The document; `closed` as in `Schemas`."""
    schemas = Schemas(closed=closed)
    paths: dict[str, dict[str, Any]] = {}
    for one in operations:
        item = paths.setdefault(one.canonical, {"parameters": _in_path(one)})
        item[one.method.lower()] = _operation(one, schemas)
    return {
        "openapi": "3.1.0",
        "info": {"title": "gcs-mosaic", "version": "1", "description": ABOUT},
        "servers": [{"url": "/"}],
        "paths": paths,
        "components": {"schemas": schemas.named},
    }


def _operation(one: Operation, schemas: Schemas) -> dict[str, Any]:
    told: dict[str, Any] = {"summary": one.summary}
    asked = [*_in_query(one, schemas), *_in_headers(one)]
    if asked:
        told["parameters"] = asked
    if one.body is not None:
        told["requestBody"] = {"required": True, "content": _content(one.body, schemas)}
    return told | {"responses": {str(status): _response(told, schemas) for status, told in answers_of(one).items()}}


def answers_of(one: Operation) -> dict[int, Reply]:
    """All that may be answered, by status."""
    said: Failures = {
        **ALWAYS,
        **(WRITING if one.changes_something else {}),
        **(SENDING if one.body is not None else {}),
        **({304: Reply("Known already, by If-None-Match.", None)} if one.answer.tagged else {}),
        **(_parts(one.answer) if one.answer.ranged else {}),
        **one.failures,
        one.answer.status: one.answer,
    }
    return {status: Reply(told) if isinstance(told, str) else told for status, told in sorted(said.items())}


def _parts(whole: Reply) -> Failures:
    types = whole.content.types if isinstance(whole.content, Media) else ("application/json",)
    return {206: Reply("The part that Range asks for.", Media(types)), **PARTS}


def _response(answer: Reply, schemas: Schemas) -> dict[str, Any]:
    told: dict[str, Any] = {"description": answer.about}
    if answer.content is not None:
        told["content"] = _content(answer.content, schemas)
    if answer.tagged:
        told["headers"] = {"ETag": {"schema": {"type": "string"}}}
    return told


def _content(content: Any, schemas: Schemas) -> dict[str, Any]:
    if not isinstance(content, Media):
        return {"application/json": {"schema": schemas.of(content)}}
    text = {"type": "string"} if content.is_text else {"type": "string", "format": "binary"}
    each = {"x-itemSchema": {"anyOf": [*map(schemas.of, content.kinds)]}} if isinstance(content, JsonLines) else {}
    return {kind: {"schema": text, **each} for kind in content.types}


def _in_path(one: Operation) -> list[dict[str, Any]]:
    return [
        {"name": name, "in": "path", "required": True, "schema": _matching(pattern), **_about(one.about.get(name))}
        for name, pattern in PARAMETER.findall(one.path)
    ]


def _matching(pattern: str) -> Schema:
    """The schema of what matches a pattern."""
    if digits := DIGITS.fullmatch(pattern):
        return {"type": "integer", "minimum": 0, "maximum": 10 ** int(digits[1]) - 1}
    if choice := CHOICE.fullmatch(pattern):
        return {"type": "string", "enum": choice[1].split("|")}
    return {"type": "string", "pattern": f"^{pattern}$"}


def _in_query(one: Operation, schemas: Schemas) -> list[dict[str, Any]]:
    if one.query is None:
        return []
    told = Schemas()
    told.of(one.query)
    (whole,) = told.named.values()
    return [
        {
            "name": name,
            "in": "query",
            "required": name in whole["required"],
            **_about(schema.get("description")),
            "schema": _not_null({key: value for key, value in schema.items() if key != "description"}),
        }
        for name, schema in whole["properties"].items()
    ]


def _not_null(schema: Schema) -> Schema:
    """Of what is left out, rather than sent as null."""
    if "anyOf" in schema:
        return dict(schema["anyOf"][0])
    return schema | {"type": schema["type"][0]} if isinstance(schema["type"], list) else schema


def _in_headers(one: Operation) -> list[dict[str, Any]]:
    text = {"type": "string"}
    return [
        {"name": name, "in": "header", "required": False, "description": about, "schema": text}
        for name, about in one.headers.items()
    ]


def _about(text: str | None) -> dict[str, str]:
    return {} if text is None else {"description": text}
