"""Every answer of a server that a test starts is compared with the description that this server gives of itself."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from fnmatch import fnmatch
from typing import Any
from urllib.parse import unquote, urlsplit

import pytest
from aiohttp import web
from jsonschema import Draft202012Validator

from gcs_mosaic.web.api.openapi import description
from gcs_mosaic.web.api.operations import DECLARED, PARAMETER, Operation
from gcs_mosaic.web.api.routes import ROOMS
from gcs_mosaic.web.app import make_app
from gcs_mosaic.web.maps.routes import PROTOCOLS

MakeApp = Callable[..., web.Application]


class Described:
    """What may be answered."""

    def __init__(self, operations: list[Operation]) -> None:
        self._document = description(operations, closed=True)
        self._known: dict[str, Draft202012Validator] = {}

    def faults(self, method: str, path: str, status: int, media_type: str, body: bytes | None) -> list[str]:
        """How an answer to a path (as the description writes it) is other than that has it. `body`: None if unknown."""
        operation = self._operation(method, path)
        if operation is None:
            return []
        if str(status) not in operation["responses"]:
            return [f"{status} is not described"]
        content = operation["responses"][str(status)].get("content", {})
        if not content:
            return [f"{status} has a body"] if body else []
        kind = next((one for one in content if fnmatch(media_type, one)), None)
        if kind is None:
            return [f"{status} is {media_type}, not one of {', '.join(content)}"]
        if body is None or status == 206:
            return []
        if "x-itemSchema" in content[kind]:
            items = content[kind]["x-itemSchema"]
            return [fault for one in items_of(body) for fault in self.misfits(items, json.loads(one))]
        return self.misfits(content[kind]["schema"], json.loads(body)) if kind == "application/json" else []

    def misfits(self, schema: dict[str, Any], document: Any) -> list[str]:
        key = json.dumps(schema)
        if key not in self._known:
            self._known[key] = Draft202012Validator(schema | {"components": self._document["components"]})
        found = self._known[key].iter_errors(document)
        return [f"{'/'.join(map(str, one.absolute_path))}: {one.message[:300]}" for one in found]

    def unfit_question(self, method: str, path: str, sent: str) -> list[str]:
        """How something sent, which was taken, is other than the description has it."""
        body = (self._operation(method, path) or {}).get("requestBody")
        return [] if body is None else self.misfits(body["content"]["application/json"]["schema"], json.loads(sent))

    def _operation(self, method: str, path: str) -> dict[str, Any] | None:
        found: dict[str, Any] | None = self._document["paths"].get(path, {}).get(method.lower())
        return found


def judging(make: MakeApp, complaints: list[str]) -> MakeApp:
    """Applications whose answers are compared; what does not fit is added to `complaints`."""

    def made(*given: Any, **named: Any) -> web.Application:
        app = make(*given, **named)
        described = Described(app[DECLARED])

        async def judge(request: web.Request, response: web.StreamResponse) -> None:
            complaints.extend(await _faults(described, request, response))
            if response.content_type == "text/event-stream":
                write = response.write

                async def judged_write(data: bytes) -> None:
                    complaints.extend(described.faults("GET", request.path, 200, response.content_type, data))
                    await write(data)

                response.write = judged_write  # type: ignore[method-assign, assignment]

        app.on_response_prepare.append(judge)  # a file's status is known only then
        return app

    return made


async def _faults(described: Described, request: web.Request, response: web.StreamResponse) -> list[str]:
    resource = request.match_info.route.resource
    if resource is None or response.status == 500:  # a handler that has raised is no answer
        return []
    path, method = resource.canonical, "GET" if request.method == "HEAD" else request.method
    body = response.body if isinstance(response, web.Response) and isinstance(response.body, bytes) else None
    found = described.faults(method, path, response.status, response.content_type, body)
    if 200 <= response.status < 300 and method != "GET":
        found += described.unfit_question(method, path, await request.text())
    return [f"{method} {path}: {fault}" for fault in found]


def judged() -> Iterator[list[str]]:
    """As long as it is held, what servers of this process answer otherwise than they describe it."""
    found: list[str] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("gcs_mosaic.web.server.make_app", judging(make_app, found))
        yield found


def faults_at(url: str, status: int, media_type: str, body: bytes | None) -> list[str]:
    """Of an answer that another process has given to GET."""
    every = [one for room in (*ROOMS, *PROTOCOLS) for one in room.OPERATIONS]
    path = unquote(urlsplit(url).path)
    asked = (one for one in every if one.method == "GET" and re.fullmatch(_pattern(one), path))
    return [fault for one in asked for fault in Described(every).faults("GET", one.canonical, status, media_type, body)]


def items_of(body: bytes) -> list[bytes]:
    """The JSON in lines, or in server-sent events."""
    return [
        line.removeprefix(b"data: ") for line in body.splitlines() if line and not line.startswith((b":", b"event: "))
    ]


def _pattern(one: Operation) -> str:
    """Of its addresses."""
    texts = re.split(PARAMETER.pattern, one.path)
    return "".join(f"(?:{text})" if at % 3 == 2 else re.escape(text) for at, text in enumerate(texts) if at % 3 != 1)
