"""What the page asks of a flight, and what it answers."""

from __future__ import annotations

import json
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from gcs_mosaic.store import requests
from gcs_mosaic.store.requests import Answer, FollowRequest, answer, ask_to_follow, clear_requests, take_request


@pytest.mark.parametrize(
    ("written", "found"),
    [
        ({"id": "a1", "vehicle": 7}, FollowRequest(id="a1", vehicle=7)),
        ({"id": "a" * 64, "vehicle": 255}, FollowRequest(id="a" * 64, vehicle=255)),
        ({"id": "a" * 65, "vehicle": 7}, "has no id of letters and digits"),
        ({"id": "", "vehicle": 7}, "has no id of letters and digits"),
        ({"id": "a-1", "vehicle": 7}, "has no id of letters and digits"),
        ({"id": "ä", "vehicle": 7}, "has no id of letters and digits"),
        ({"id": 5, "vehicle": 7}, "has no id of letters and digits"),
        ({"id": "a1", "vehicle": 0}, "names no MAVLink system id from 1 to 255"),
        ({"id": "a1", "vehicle": 256}, "names no MAVLink system id from 1 to 255"),
        ({"id": "a1", "vehicle": True}, "names no MAVLink system id from 1 to 255"),
        ({"id": "a1", "vehicle": "7"}, "names no MAVLink system id from 1 to 255"),
        ({"id": "a1", "vehicle": 1}, FollowRequest(id="a1", vehicle=1)),
        ([1], "is no request"),
        ("x" * 5000, "is no small file"),
    ],
)
def test_a_request_is_taken_once_or_left_out_with_a_reason(tmp_path: Path, written: object, found: Any) -> None:
    (tmp_path / "request.json").write_text(json.dumps(written))
    taken = take_request(tmp_path)
    assert taken == found if isinstance(found, FollowRequest) else found in str(taken)
    assert take_request(tmp_path) is None


def test_what_is_no_json_is_no_request(tmp_path: Path) -> None:
    for text in ("{", "[" * 4000, ""):
        (tmp_path / "request.json").write_text(text)
        assert take_request(tmp_path) == "request.json is no JSON"


def answered(flight: Path, told: dict[str, Any]) -> None:
    """As a flight answers the request that it finds."""
    for _ in range(200):
        if isinstance(found := take_request(flight), FollowRequest):
            answer(flight, Answer(id=told.get("id", found.id), taken=told["taken"], text=told["text"]))
            return
        threading.Event().wait(0.005)


@pytest.mark.parametrize(
    ("told", "result"),
    [
        ({"taken": True, "text": "followed"}, (True, "followed")),
        ({"taken": False, "text": "not heard"}, (False, "not heard")),
        ({"taken": True, "text": "of another", "id": "other"}, None),
    ],
)
def test_a_request_is_answered_by_its_id(
    tmp_path: Path, told: dict[str, Any], result: tuple[bool, str] | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(requests, "_POLL_S", 0.01)
    flight = threading.Thread(target=answered, args=(tmp_path, told))
    flight.start()
    began = time.monotonic()
    found = ask_to_follow(tmp_path, 7, 0.2 if result is None else 30.0)
    assert time.monotonic() - began < 15  # it is not waited for longer than until it comes
    flight.join(5)
    assert (None if found is None else (found.taken, found.text)) == result
    clear_requests(tmp_path)
    assert [*tmp_path.iterdir()] == []


def test_a_request_that_nobody_answers_is_withdrawn(tmp_path: Path) -> None:
    (tmp_path / "answer.json").write_text("[")
    assert ask_to_follow(tmp_path, 7, 0.0) is None
    assert [path.name for path in tmp_path.iterdir()] == ["answer.json"]


def test_an_answer_in_the_last_moment_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gcs_mosaic.store.requests.secrets.token_hex", lambda size: "abcd")
    answer(tmp_path, Answer(id="abcd", taken=True, text="followed"))
    assert ask_to_follow(tmp_path, 7, 0.0) == Answer(id="abcd", taken=True, text="followed")
