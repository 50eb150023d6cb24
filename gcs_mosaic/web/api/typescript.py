"""The types of what the API asks and answers, for the page's scripts: `python -m gcs_mosaic.web.api.typescript` prints them.

A namespace, so that `@type {Api.Find}` in a script is enough; `Api.Answers` and `Api.Bodies` are by method and address.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable

from gcs_mosaic.web.api.openapi import answers_of
from gcs_mosaic.web.api.operations import PARAMETER, JsonLines, Media, Operation
from gcs_mosaic.web.api.routes import ROOMS
from gcs_mosaic.web.api.schema import Schema, Schemas

NAMES = {"integer": "number", "number": "number", "string": "string", "boolean": "boolean", "null": "null"}
# What is not in the table is a mistake.
BY_ADDRESS = """\
  type AnswerTo<Method extends string, Path extends string> = `${Method} ${Path}` extends keyof Answers
    ? Answers[`${Method} ${Path}`] : never;
  type BodyOf<Method extends string, Path extends string> = `${Method} ${Path}` extends keyof Bodies
    ? Omit<Bodies[`${Method} ${Path}`], "who"> : {};
"""


def declarations(operations: Iterable[Operation]) -> str:
    """The text of a .d.ts file."""
    schemas, operations = Schemas(), list(operations)
    spoken = [one for one in operations if not isinstance(one.answer.content, Media)]
    answers = [line for one in spoken for line in _lines(one, _answer(one, schemas))]
    bodies = [line for one in spoken if one.body for line in _lines(one, type_of(schemas.of(one.body)))]
    lines = (one.answer.content for one in operations if isinstance(one.answer.content, JsonLines))
    for kind in (kind for content in lines for kind in content.kinds):
        schemas.of(kind)
    interfaces = [_interface(name, schema) for name, schema in sorted(schemas.named.items())]
    tables = [
        f"  interface {name} {{\n{''.join(lines)}  }}\n" for name, lines in (("Answers", answers), ("Bodies", bodies))
    ]
    return f"declare namespace Api {{\n{''.join(interfaces + tables)}{BY_ADDRESS}}}\n"


def type_of(schema: Schema) -> str:
    """A type in TypeScript."""
    if "$ref" in schema:
        return str(schema["$ref"]).rpartition("/")[2]
    if "anyOf" in schema:
        return " | ".join(map(type_of, schema["anyOf"]))
    if "enum" in schema:
        return " | ".join(map(json.dumps, schema["enum"]))
    kinds = schema["type"] if isinstance(schema["type"], list) else [schema["type"]]
    return " | ".join(_plain(kind, schema) for kind in kinds)


def _plain(kind: str, schema: Schema) -> str:
    if kind == "array":
        one, count = type_of(schema["items"]), schema.get("minItems")
        return f"Array<{one}>" if count is None else f"[{', '.join([one] * count)}]"
    if kind == "object":
        return f"Record<string, {type_of(inside) if (inside := schema.get('additionalProperties')) else 'any'}>"
    return NAMES[kind]


def _interface(name: str, schema: Schema) -> str:
    lines = [_said(schema, "  ") + f"  interface {name} {{\n"]
    for field, told in schema["properties"].items():
        mark = "" if field in schema["required"] else "?"
        lines.append(_said(told, "    ") + f"    {field}{mark}: {type_of(told)};\n")
    return "".join([*lines, "  }\n"])


def _said(schema: Schema, indent: str) -> str:
    return f"{indent}/** {schema['description']} */\n" if "description" in schema else ""


def _lines(one: Operation, kind: str) -> list[str]:
    """What belongs to a method and an address, without and with whatever query."""
    address = f"{one.method} {PARAMETER.sub('${string}', one.path)}"
    addresses = [address] if one.query is None else [address, f"{address}?${{string}}"]
    return [f"    {f'[address: `{key}`]' if '$' in key else json.dumps(key)}: {kind};\n" for key in addresses]


def _answer(one: Operation, schemas: Schemas) -> str:
    """The JSON of a success, and what else is answered as JSON."""
    spoken = [said.content for said in answers_of(one).values() if not isinstance(said.content, Media | None)]
    return " | ".join(dict.fromkeys(type_of(schemas.of(content)) for content in spoken))


if __name__ == "__main__":
    sys.stdout.write(declarations(one for room in ROOMS for one in room.OPERATIONS))
