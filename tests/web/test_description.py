"""The description that is served: whole, valid, and what the answers are compared with."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
from jsonschema import Draft202012Validator
from openapi_spec_validator import validate

from gcs_mosaic.notes.storage.checked import Unfit
from gcs_mosaic.store.documents import Limits, compact
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.api.asked import read
from gcs_mosaic.web.api.openapi import description
from gcs_mosaic.web.api.operations import DECLARED, Operation
from gcs_mosaic.web.api.schema import Schemas
from gcs_mosaic.web.app import make_app
from tests.web.answers import Described, faults_at

ABSENT: dict[str, Any] = {"name": "a.jpg", "state": "waiting", "reason": "", "island": 0, "place": [1.5, 2]}
SENT: dict[str, Any] = {"from": [1, 2], "share": 0.5, "who": "Kim"}


@dataclass(frozen=True, slots=True, kw_only=True)
class SampleBody:
    """What a test sends."""

    from_: tuple[int, int]
    share: Annotated[float, Limits(least=0, most=1), "of one"]
    who: Annotated[str, Limits(shortest=1, longest=5)]
    size: Literal[1, 2] = 1
    note: Annotated[str, Limits(longest=9)] | None = None
    is_on: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class SampleEntry:
    """What a test tells."""

    vehicle: int | None = None
    place: int | None


@pytest.fixture(scope="module")
def operations() -> list[Operation]:
    return make_app(Path(), HttpAddress("127.0.0.1", 0))[DECLARED]


def test_every_route_but_those_of_the_page_itself_is_described(operations: list[Operation]) -> None:
    app = make_app(Path(), HttpAddress("127.0.0.1", 0))
    served = {
        (route.resource.canonical, route.method.lower())
        for route in app.router.routes()
        if route.resource is not None
        and route.resource.canonical not in ("/", "/sw.js", "/viewer", "/viewer/page.js", "/vehicle/{system}")
        and route.method != "HEAD"
    }
    document = description(operations)
    told = {(path, method) for path, item in document["paths"].items() for method in item if method != "parameters"}
    assert told == served
    assert [one.canonical for one in operations if not one.summary] == []


@pytest.mark.long
def test_it_is_valid_and_tells_no_type_that_nothing_uses(operations: list[Operation]) -> None:
    document = description(operations)
    validate(document)
    used = set(re.findall(r"#/components/schemas/(\w+)", json.dumps(document)))
    assert used == document["components"]["schemas"].keys()
    assert {"Find", "NewFind", "Pin", "NewPin", "Hint", "Sighting", "Reviewed", "MapsForOthers"} <= used


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({}, ""),
        ({"state": "lost"}, "is not one of"),
        ({"place": [1]}, "too short"),
        ({"place": None}, ""),
        ({"island": "0"}, "is not of type"),
        ({"more": 1}, "Additional properties"),
    ],
)
def test_a_body_that_drifts_is_found(operations: list[Operation], change: dict[str, Any], fault: str) -> None:
    body = json.dumps({"map_revision": 1, "absent": [{**ABSENT, **change}]}).encode()
    found = Described(operations).faults("GET", "/api/v1/absent", 200, "application/json", body)
    assert len(found) == bool(fault)
    assert all(fault in one for one in found)


def test_a_field_that_is_missing_and_other_kinds_and_states_are_found(operations: list[Operation]) -> None:
    described = Described(operations)
    less = json.dumps(
        {"map_revision": 1, "absent": [{name: ABSENT[name] for name in ("name", "state", "reason", "place")}]}
    ).encode()
    assert described.faults("GET", "/api/v1/absent", 200, "application/json", less) == [
        "absent/0: 'island' is a required property"
    ]
    assert described.faults("GET", "/api/v1/absent", 200, "text/plain", b"") != []
    assert described.faults("GET", "/api/v1/absent", 418, "application/json", b"") == ["418 is not described"]


@pytest.mark.parametrize(
    ("path", "media_type", "body", "faults"),
    [
        (
            "/live",
            "text/event-stream",
            b'event: notes\ndata: {"revision":3}\n\nevent: alive\ndata: {}\n\nevent: ended\ndata: {}\n\n',
            0,
        ),
        ("/live", "text/event-stream", b'data: {"revision":3,"tiles":[[0,16,1,2]]}\n\n', 0),
        ("/live", "text/event-stream", b'data: {"revision":3,"tiles":[[0,16,1]]}\n\n', 1),
        ("/live", "text/event-stream", b'event: notes\ndata: {"revision":-1}\n\n', 1),
        ("/placements.jsonl", "application/x-ndjson", b'{"format":1,"since":0}\n{"format":1,"since":0}\n', 0),
        ("/placements.jsonl", "application/x-ndjson", b'{"format":1,"since":0}\n{"format":1}\n', 1),
    ],
)
def test_each_line_and_event_is_compared(
    operations: list[Operation], path: str, media_type: str, body: bytes, faults: int
) -> None:
    assert len(Described(operations).faults("GET", path, 200, media_type, body)) == faults


def test_what_has_none_as_its_default_may_be_left_out() -> None:
    schemas = Schemas(closed=True)
    whole = schemas.of(SampleEntry) | {"components": {"schemas": schemas.named}}
    for entry in (SampleEntry(place=None), SampleEntry(place=1, vehicle=2)):
        assert Draft202012Validator(whole).is_valid(json.loads(compact(entry)))
    assert compact(SampleEntry(place=None)) == '{"place":null}'
    assert not Draft202012Validator(whole).is_valid({"vehicle": 2})


def test_an_answer_of_another_process_is_found_by_its_address() -> None:
    page = "http://127.0.0.1:1"
    assert faults_at(f"{page}/api/v1/finds.csv", 200, "text/csv", b"") == []
    assert len(faults_at(f"{page}/api/v1/frames/7/crop.jpg?x=1", 200, "image/png", b"")) == 1
    assert len(faults_at(f"{page}/api/v1/hints/", 200, "image/png", b"")) == 0  # there is no such address


@pytest.mark.parametrize(
    "change",
    [
        *({"from": [1]}, {"from": [1.5, 2]}, {"from": None}, {"share": 1.5}, {"share": True}, {"share": "1"}),
        *({"who": ""}, {"who": None}, {"who": "Kimber"}, {"size": 3}, {"note": 7}, {"note": "x" * 10}, {"is_on": 1}),
    ],
)
def test_what_is_refused_is_what_the_description_excludes(change: dict[str, Any]) -> None:
    schemas = Schemas()
    whole = schemas.of(SampleBody) | {"components": {"schemas": schemas.named}}
    assert Draft202012Validator(whole).is_valid(SENT)
    assert not Draft202012Validator(whole).is_valid(SENT | change)
    with pytest.raises(Unfit, match=next(iter(change))):
        read(SampleBody, SENT | change)


def test_what_fits_is_read() -> None:
    assert read(SampleBody, SENT) == SampleBody(from_=(1, 2), share=0.5, who="Kim")
    sent = SENT | {"note": "a\n", "is_on": True, "size": 2, "more": 1}
    assert read(SampleBody, sent) == SampleBody(from_=(1, 2), share=0.5, who="Kim", size=2, note="a", is_on=True)
