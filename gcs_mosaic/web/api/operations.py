"""What the API answers, declared beside each handler: the routes, their description and the page's types are made of it."""

from __future__ import annotations

import re
from collections.abc import Awaitable, Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypedDict, Unpack

from aiohttp import web

from gcs_mosaic.notes.storage.book import NoSuchNote
from gcs_mosaic.notes.storage.checked import Unfit
from gcs_mosaic.web.access import is_local
from gcs_mosaic.web.api.common import bad, missing
from gcs_mosaic.web.choosing import ACCESS

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]
PARAMETER = re.compile(r"\{(\w+):((?:[^{}]|\{[^{}]*\})*)\}")  # name and pattern, in a path
NO_NUMBER = {404: "There is nothing of that number."}
NO_NOTES = {503: "The notes cannot be kept now; nothing was changed."}


@dataclass(frozen=True, slots=True)
class Media:
    """An answer that is no JSON."""

    types: tuple[str, ...]

    @property
    def is_text(self) -> bool:
        return all(one.startswith("text/") or one.endswith(("xml", "json", "project")) for one in self.types)


@dataclass(frozen=True, slots=True)
class JsonLines(Media):
    """Several JSON documents, of `kinds`: one on each line, or as the data of each server-sent event."""

    kinds: tuple[Any, ...]

    @property
    def is_endless(self) -> bool:
        return "text/event-stream" in self.types


@dataclass(frozen=True, slots=True)
class Reply:
    """`content`: the type of the JSON, or Media; None for nothing. `tagged`: with an ETag, and 304 to whom knows it.

    `ranged`: parts can be asked for by Range (a large file; what is small is answered whole).
    """

    about: str
    content: Any = Media(("text/plain",))
    status: int = 200
    tagged: bool = False
    ranged: bool = False


Failures = Mapping[int, str | Reply]


@dataclass(frozen=True, slots=True, kw_only=True)
class Operation:
    """One method of one path (patterns included), and who answers it.

    `query`, `body`: dataclasses of what is asked. `failures`: what is answered instead, beside what every operation may say.
    `headers`, `about`: what headers, and parameters in the path, mean.
    """

    method: str
    path: str
    handler: Handler
    answer: Reply
    query: type | None = None
    body: type | None = None
    failures: Failures = field(default_factory=dict)
    headers: Mapping[str, str] = field(default_factory=dict)
    about: Mapping[str, str] = field(default_factory=dict)

    @property
    def canonical(self) -> str:
        """The path without patterns."""
        return PARAMETER.sub(r"{\1}", self.path)

    @property
    def summary(self) -> str:
        """The handler's docstring in one line."""
        return " ".join((self.handler.__doc__ or "").split()).removesuffix(".")

    @property
    def changes_something(self) -> bool:
        return self.method != "GET"


class Told(TypedDict, total=False):
    """What else is told of an operation."""

    query: type | None
    body: type | None
    failures: Failures
    headers: Mapping[str, str]
    about: Mapping[str, str]


class Operations(list[Operation]):
    """Those of a module."""

    def add(self, method: str, path: str, answer: Reply, **told: Unpack[Told]) -> Callable[[Handler], Handler]:
        """Declare what the handler answers; `told` as in `Operation`."""

        def declare(handler: Handler) -> Handler:
            self.append(Operation(method=method, path=path, handler=handler, answer=answer, **told))
            return handler

        return declare


DECLARED = web.AppKey("declared", list[Operation])  # all of the application


def add_operations(app: web.Application, operations: Iterable[Operation]) -> None:
    """Answer them."""
    known = app.setdefault(DECLARED, [])
    for one in operations:
        known.append(one)
        if one.changes_something:
            app.router.add_route(one.method, one.path, writing(one.handler))
        else:
            endless = isinstance(one.answer.content, JsonLines) and one.answer.content.is_endless
            app.router.add_get(one.path, reading(one.handler), allow_head=not endless)


def writing(handler: Handler) -> Handler:
    """A handler that changes something: where everybody may look, only this machine may."""

    async def checked(request: web.Request) -> web.StreamResponse:
        if request.app[ACCESS].is_open and not is_local(request):
            raise web.HTTPForbidden(text="Where everybody may look, only the machine that runs gcs-mosaic may write.\n")
        return await reading(handler)(request)

    return checked


def reading(handler: Handler) -> Handler:
    """A handler whose refusals are told: 400 for what is unfit, 404 for what is not there."""

    async def checked(request: web.Request) -> web.StreamResponse:
        try:
            return await handler(request)
        except Unfit as error:
            raise bad(str(error)) from error
        except NoSuchNote as error:
            raise missing(NO_NUMBER[404]) from error

    return checked
