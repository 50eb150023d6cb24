"""Small files of a flight that somebody else reads or writes: requests, status, tiles by their headers."""

from __future__ import annotations

import json
import math
import struct
import sys
import threading
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from gcs_mosaic.errors import UsageError
from gcs_mosaic.stitch.graph.tearing import HeldOut
from gcs_mosaic.store import aircraft, durability, requests
from gcs_mosaic.store.aircraft import aircraft_lines, follow, heard_aircraft, running_flight
from gcs_mosaic.store.array_shelf import ArrayShelf
from gcs_mosaic.store.checkpoint import Checkpoints, Unusable, decoded, encoded
from gcs_mosaic.store.documents import finite, iso_utc
from gcs_mosaic.store.foreign_file import refuse_strange_files
from gcs_mosaic.store.held_out import held_out_lines, largest
from gcs_mosaic.store.journal import told_after
from gcs_mosaic.store.pickle_bounds import Budget, Unbounded
from gcs_mosaic.store.placements import append
from gcs_mosaic.store.reading import read_document
from gcs_mosaic.store.requests import Answer, FollowRequest, answer, ask_to_follow, clear_requests, take_request
from gcs_mosaic.store.revision import last_revision
from gcs_mosaic.store.status import behind_words, counted, harmless, latency_words, link_words, watch_words
from gcs_mosaic.store.stored_text import restored, stored
from gcs_mosaic.store.tile_header import is_tile_sized


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


def heard(system: int, described: str, last_heard: str | None) -> dict[str, Any]:
    return {"system": system, "described": described, "last_heard": last_heard}


def status(folder: Path, state: str, *links: dict[str, Any], updated: str = "2024-05-01T12:00:00.000Z") -> Path:
    folder.mkdir(exist_ok=True)
    document = {"state": state, "updated": updated, "mavlink": [*links]}
    (folder / "status.json").write_text(json.dumps(document))
    (folder / "mosaic.json").write_text("{}")
    return folder


NOW = 1714564800.0  # 2024-05-01T12:00:00Z
LINKS: list[dict[str, Any]] = [
    {"followed": 1, "aircraft": [heard(1, "ArduPilot", "2024-05-01T11:59:50.000Z"), heard(9, "", None)]},
    {"followed": None, "aircraft": [heard(1, "older", "2024-05-01T11:00:00.000Z"), heard(7, "PX4", "2024-05-01T12:00:05.000Z")]},
]  # fmt: skip


def test_each_aircraft_is_told_of_as_it_was_heard_last(tmp_path: Path) -> None:
    flight = status(tmp_path / "f", "flying", *LINKS)
    assert heard_aircraft(flight, NOW).splitlines() == [
        "system 1: followed, ArduPilot, heard 10 s ago",
        "system 7: PX4, heard 0 s ago",
        "system 9: of unknown kind, triggers a camera without a heartbeat",
    ]
    assert [*aircraft_lines({"mavlink": LINKS[::-1]}, NOW)] == heard_aircraft(flight, NOW).splitlines()
    assert "no aircraft has been heard" in heard_aircraft(status(tmp_path / "g", "flying"), NOW)


def test_the_flight_under_way_is_found_among_the_numbered_ones(tmp_path: Path) -> None:
    ended = status(tmp_path / "f", "stopped", updated="2024-05-01T13:00:00.000Z")
    with pytest.raises(UsageError, match="no flight is under way"):
        running_flight(ended)
    assert running_flight(ended, ended_too=True) == ended
    first = status(tmp_path / "f-2", "idle")
    later = status(tmp_path / "f-4", "flying", updated="2024-05-01T12:30:00.000Z")
    assert running_flight(ended) == later
    (first / "status.json").write_text("{")
    assert running_flight(ended) == later
    with pytest.raises(UsageError):
        running_flight(tmp_path / "none", ended_too=True)
    (tmp_path / "bare").mkdir()
    (tmp_path / "bare/mosaic.json").write_text("{}")
    with pytest.raises(UsageError, match="has no status that can be read"):
        heard_aircraft(tmp_path / "bare")


@pytest.mark.parametrize(
    ("told", "error"),
    [
        (None, "does not answer, so nothing was changed"),
        (
            Answer(id="x", taken=False, text="system 9 has not been heard"),
            "system 9 has not been heard: gcs-mosaic vehicle",
        ),
        (Answer(id="x", taken=True, text="system 9 is followed"), ""),
    ],
)
def test_what_a_flight_answers_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, told: Answer | None, error: str
) -> None:
    monkeypatch.setattr(aircraft, "ask_to_follow", lambda flight, vehicle, patience_s: told)
    flight = status(tmp_path / "f", "flying")
    if not error:
        assert follow(flight, 9) == "system 9 is followed"
        return
    with pytest.raises(UsageError, match=error):
        follow(flight, 9)


def jpeg(size: int, quality: int = 90) -> bytes:
    return cv2.imencode(".jpg", np.full((size, size, 3), 90, np.uint8), [cv2.IMWRITE_JPEG_QUALITY, quality])[
        1
    ].tobytes()


def png(width: int, height: int) -> bytes:
    return cv2.imencode(".png", np.full((height, width), 90, np.uint8))[1].tobytes()


@pytest.mark.parametrize(
    ("data", "is_one"),
    [
        (jpeg(256), True),
        (jpeg(255), False),
        (png(256, 256), True),
        (png(256, 255), False),
        (png(255, 256), False),
        (jpeg(256)[:2], False),
        (jpeg(256)[:20], False),
        (png(256, 256)[:20], False),
        (b"GIF89a" + bytes(30), False),
        (b"", False),
        (b"\xff\xd8\xff\xe0\x00\x00\xff\xc0\x00\x11\x08" + struct.pack(">HH", 256, 256), True),
        (b"\xff\xd8\xff\xc4\x00\x04\x00\x00\xff\xc2\x00\x11\x08" + struct.pack(">HH", 256, 256), True),
        (b"\xff\xd8\xff\xc2\x00\x11\x08" + struct.pack(">HH", 256, 257), False),
        (b"\xff\xd8\xfe\xc0\x00\x11\x08" + struct.pack(">HH", 256, 256), False),
    ],
)
def test_a_tile_is_known_by_its_header(data: bytes, is_one: bool) -> None:
    assert is_tile_sized(data) is is_one


def test_a_document_is_an_object_of_some_size(tmp_path: Path) -> None:
    path = tmp_path / "mosaic.json"
    path.write_text('{"revision": 7}')
    assert read_document(path) == {"revision": 7}
    assert read_document(path, 15) == {"revision": 7}
    with pytest.raises(OSError, match=r"."):
        read_document(path, 14)
    assert last_revision(tmp_path) == 7
    for text in ("[1]", "[" * 100_000, '{"revision": null}', '{"revision": 1e400}', "{}"):
        path.write_text(text)
        assert last_revision(tmp_path) == 0
    path.unlink()
    assert last_revision(tmp_path) == 0


def test_what_was_told_after_a_revision(tmp_path: Path) -> None:
    path = tmp_path / "placements.jsonl"
    lines = [b'{"since":3}\n', *(b'{"revision":%d}\n' % one for one in (4, 5, 6))]
    path.write_bytes(b"".join(lines) + b'{"revision":')
    assert told_after(path, 3) == b"".join(lines)
    assert told_after(path, 5) == lines[0] + lines[3]
    assert told_after(path, 6) == lines[0]
    path.write_bytes(lines[0])
    assert told_after(path, 0) == lines[0]


def test_a_line_is_appended_at_the_end(tmp_path: Path) -> None:
    path = tmp_path / "file"
    for line in (b"one\n", b"two\n"):
        append(path, line)
    assert path.read_bytes() == b"one\ntwo\n"


@pytest.mark.parametrize("text", ["plain", "Grüße", "half\udce4byte", None])
def test_any_name_is_stored_and_restored(text: str | None) -> None:
    assert restored(stored(text)) == text
    assert isinstance(stored(text), bytes) is (text is not None and "\udce4" in text)


def test_times_and_numbers_of_documents() -> None:
    assert iso_utc(1714564800.25) == "2024-05-01T12:00:00.250Z"
    assert [finite(one) for one in (1.5, float("nan"), float("inf"))] == [1.5, None, None]


def test_the_islands_with_most_matches_are_told() -> None:
    figures = {3: HeldOut(1.0, 2.0, 50), 1: HeldOut(1.0, 2.0, 9), 2: HeldOut(1.0, float("inf"), 1400)}
    assert [*largest(figures, 2)] == [2, 3]
    assert held_out_lines(largest(figures, 1)) == [
        "held-out matches: 1.0 px median, endless 95 % (island 2, 1,400 matches)"
    ]


LINK: dict[str, Any] = {
    "state": "heard",
    "silences": 0,
    "other_triggers": {},
    "refused": {"crc": 0},
    "sent": 0,
    "followed": 1,
}


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({}, "heard"),
        ({"silences": 2}, "heard; 2 silences"),
        ({"other_triggers": {"7": 3}}, "heard; triggers left out, as system 1 is followed: 3 of system 7"),
        (
            {"other_triggers": {"7": 3}, "counted": [1, 2]},
            "heard; triggers left out, as systems 1, 2 count: 3 of system 7",
        ),
        ({"refused": {"crc": 5, "sign": 0}}, "heard; packets refused: 5 crc"),
        ({"sent": 4}, "heard; 4 packets sent"),
    ],
)
def test_a_link_is_told_of_with_what_is_unusual(more: dict[str, Any], words: str) -> None:
    assert "; ".join(link_words(LINK | more)) == words


def test_words_of_a_status() -> None:
    assert counted({"placed": 3, "pending": 0, "damaged": 1}) == "3 placed, 1 damaged"
    assert counted({"placed": 0}) == "none yet"
    assert behind_words({"frames_in_queue": 0}) == "none waits"
    assert latency_words({"seconds_to_tile": 2.04}) == ", on the map 2.0 s after it came"
    assert latency_words({"seconds_to_tile": None}) == ""
    assert harmless("a\x1b[31m b\u202e") == "a?[31m b?"
    watch = {"state": "watching", "since": None, "seen": 4, "taken": 3, "damaged": 1, "gaps": 0}
    assert "; ".join(watch_words(watch)) == "watching; 4 seen, 3 taken, 1 damaged"
    assert next(watch_words(watch | {"since": "noon"})) == "watching since noon"


@pytest.mark.parametrize(
    "array",
    [
        np.arange(6.0).reshape(2, 3),
        np.asfortranarray(np.arange(6.0).reshape(2, 3)),
        np.arange(12.0).reshape(3, 4)[:, ::2],
        np.float32(1.5),
        np.array([True, False]),
    ],
)
def test_what_is_encoded_is_decoded_with_its_layout(array: np.ndarray) -> None:
    (found,) = decoded(encoded((array,)))
    assert np.array_equal(found, array)
    assert found.dtype == array.dtype
    wants_f = array.ndim > 1 and array.flags.f_contiguous
    assert bool(found.ndim > 1 and found.flags.f_contiguous) is wants_f


def test_a_budget_is_spent_to_its_end() -> None:
    budget = Budget(1)
    budget.spend((64 << 20) + 32)
    with pytest.raises(Unbounded):
        budget.spend(1)


def test_an_answer_in_the_last_moment_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gcs_mosaic.store.requests.secrets.token_hex", lambda size: "abcd")
    answer(tmp_path, Answer(id="abcd", taken=True, text="followed"))
    assert ask_to_follow(tmp_path, 7, 0.0) == Answer(id="abcd", taken=True, text="followed")


def nested(deep: int) -> tuple[Any, ...]:
    found: tuple[Any, ...] = ()
    for _ in range(deep - 1):
        found = (found,)
    return found


def test_values_are_a_hundred_deep_and_no_deeper() -> None:
    assert decoded(encoded(nested(100))) == nested(100)
    with pytest.raises(Unbounded, match="too deep"):
        decoded(encoded(nested(101)))


def test_a_sync_that_fails_is_said_once_until_one_succeeds(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    outcomes, done = [False, False, True, False, False], threading.Event()
    calls: list[bool] = []

    def sync() -> None:
        calls.append(outcomes[min(len(calls), 4)])
        if len(calls) == 5:
            done.set()
        if not calls[-1]:
            raise OSError("no disk")

    monkeypatch.setattr(durability, "EACH_S", 0.001)
    synced = durability.Durability(sync)
    assert done.wait(10)
    synced.close()
    assert len([one for one in caplog.records if "cannot be brought to the disk" in one.message]) == 2


def test_features_that_are_lost_are_said_to_be_once(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    shelf = ArrayShelf(0, tmp_path)
    for _ in range(2):
        shelf.note_lost(OSError("gone"))
    assert shelf.problem == "the scratch file of the features cannot be read: gone"
    assert [one.message for one in caplog.records] == ["features cannot be read back"]
    shelf.close()


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda data: b"something else", "is none of ours"),
        (lambda data: data[:40], "is none of ours"),
        (lambda data: data[:22] + b"\x09" + data[23:], "was written by another version of the program"),
        (lambda data: data[:30] + bytes([data[30] ^ 1]) + data[31:], "was written by another version of the program"),
        (lambda data: data[:-1] + bytes([data[-1] ^ 1]), "is damaged"),
    ],
)
def test_a_checkpoint_that_is_none_asks_to_stitch_again(
    tmp_path: Path, change: Callable[[bytes], bytes], reason: str
) -> None:
    """Where there is none at all, the ledger tells what became of its flight."""
    with closing(Checkpoints(tmp_path)) as none:
        assert none.load() == Unusable("it has no checkpoint", stitch_again=False)
        none.write(lambda: (1, 2, 3), lambda: None, at_once=True)
    with closing(Checkpoints(tmp_path)) as whole:
        assert whole.load() == (1, 2, 3)
    path = tmp_path / "checkpoint"
    path.write_bytes(change(path.read_bytes()))
    with closing(Checkpoints(tmp_path)) as broken:
        assert broken.load() == Unusable(f"its checkpoint {reason}", stitch_again=True)


def test_a_checkpoint_is_written_when_it_is_due_or_at_once(tmp_path: Path) -> None:
    def last() -> object:
        with closing(Checkpoints(tmp_path, read_only=True)) as reader:
            return reader.load()

    with closing(Checkpoints(tmp_path)) as written:
        written.write(lambda: (1,), lambda: None)
        written._wait()
        assert last() == (1,)
        written._due = math.inf
        written.write(lambda: (2,), lambda: None)
        written._wait()
        assert last() == (1,)
        written.write(lambda: (3,), lambda: None, at_once=True)
        assert last() == (3,)


@pytest.mark.skipif(sys.platform != "linux", reason="whether a file has holes is not told everywhere")
@pytest.mark.parametrize(("size", "refused"), [(64_000_000, False), (64_000_001, True)])
@pytest.mark.parametrize("end", ["", "-wal"])
def test_a_file_of_holes_is_no_ledger(tmp_path: Path, size: int, refused: bool, end: str) -> None:
    path = tmp_path / "flight.sqlite"
    with path.with_name(f"{path.name}{end}").open("wb") as file:
        file.truncate(size)
    if not refused:
        refuse_strange_files(path)
        return
    with pytest.raises(UsageError, match=r"has 0\.1 GB, which no file of gcs-mosaic has"):
        refuse_strange_files(path)
