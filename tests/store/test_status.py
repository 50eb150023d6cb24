from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from gcs_mosaic.errors import UsageError
from gcs_mosaic.messages import LinkReport, Refusals, SourceReport
from gcs_mosaic.stitch.graph.tearing import HeldOut
from gcs_mosaic.store.documents import compact, write_json
from gcs_mosaic.store.records import Accounts, NoticeRecord
from gcs_mosaic.store.status import (
    Behind,
    LastFrame,
    Status,
    behind_words,
    counted,
    harmless,
    latency_words,
    link_words,
    read_status,
    status_document,
    status_lines,
    watch_words,
)
from gcs_mosaic.store.told_documents import EventAccount, FrameAccount, StatusDocument
from tests.documents import misfits

STATUS = Status(
    flight="today",
    state="flying",
    updated_utc=1714564800.0,
    started_utc=1714564000.0,
    mavlink=(LinkReport(address="udp:14550", state="heard", last_heard_utc=1714564799.5),),
    watch=SourceReport(kind="folder", name="frames", state="watching"),
    last_frame=LastFrame(name="a.jpg", outcome="placed", island=0, utc=1714564799.0, seconds_to_tile=float("nan")),
    accounts=Accounts(events=EventAccount(missing=1)),
    notices=(NoticeRecord(utc=1714564799.0, source="link", level="info", text="heard"),),
)


def told(status: Status) -> dict[str, Any]:
    """The document, as a reader has it."""
    document: dict[str, Any] = json.loads(compact(status_document(status)))
    assert misfits(StatusDocument, document) == []
    return document


def test_document_holds_moments_and_no_nan() -> None:
    document = told(STATUS)
    assert (document["format"], document["state"]) == (1, "flying")
    assert document["mavlink"][0]["last_heard"] == "2024-05-01T11:59:59.500Z"
    assert document["last_frame"]["seconds_to_tile"] is None
    assert document["events"]["missing"] == 1
    assert document["notices"][0]["time"] == "2024-05-01T11:59:59.000Z"


def test_daemon_that_has_seen_nothing_has_a_document() -> None:
    document = told(Status(flight="f", state="listening", updated_utc=0.0, started_utc=0.0))
    assert document["last_frame"] is None
    assert document["watch"] is None


def written(folder: Path, status: Status) -> Path:
    (folder / "mosaic.json").write_text("{}")
    write_json(folder / "status.json", status_document(status))
    return folder


def test_status_is_read_for_people(tmp_path: Path) -> None:
    text = read_status(written(tmp_path, STATUS), now_utc=STATUS.updated_utc + 1)
    assert text.startswith("today: flying, revision 0")
    assert "triggers: 1 missing" in text
    assert "MAVLink udp:14550: heard" in text
    assert "killed" not in text


def test_how_far_behind_the_map_is_is_told() -> None:
    document = told(replace(STATUS, behind=Behind(frames=12, seconds=40.25)))
    assert (document["frames_in_queue"], document["seconds_behind"]) == (12, 40.2)
    assert any("the map is 12 frames, 40 s behind" in line for line in status_lines(document, STATUS.updated_utc))
    del document["seconds_behind"]  # as an older program wrote it
    assert any("the map is 12 frames behind" in line for line in status_lines(document, STATUS.updated_utc))


def test_how_good_the_map_is_is_told() -> None:
    document = told(replace(STATUS, held_out={0: HeldOut(1.9, 9.12, 3120), 2: HeldOut(3.0, math.inf, 40)}))
    assert document["held_out_px"]["0"] == {
        "median": 1.9,
        "p95": 9.12,
        "matches": 3120,
    }
    lines = status_lines(document, 0)
    assert "held-out matches: 1.9 px median, 9.1 px 95 % (island 0, 3,120 matches)" in lines
    assert "held-out matches: 3.0 px median, endless 95 % (island 2, 40 matches)" in lines


def test_status_of_an_earlier_program_is_still_read() -> None:
    document = told(STATUS)
    del document["held_out_px"]
    assert not any("held-out" in line for line in status_lines(document, 0))


def test_the_last_frame_may_be_covered() -> None:
    last = LastFrame(
        name="b.jpg", outcome="covered", island=None, utc=1714564799.0, seconds_to_tile=None, covered_by="a.jpg"
    )
    document = told(replace(STATUS, last_frame=last, accounts=Accounts(frames=FrameAccount(covered=3))))
    assert document["last_frame"]["covered_by"] == "a.jpg"
    assert document["frames"]["covered"] == 3
    lines = status_lines(document, 0)
    assert any(line.startswith("last frame: b.jpg, covered by a.jpg at ") for line in lines)


def test_what_a_link_left_out_is_told(tmp_path: Path) -> None:
    link = LinkReport(
        address="udp:1",
        state="heard",
        silences=2,
        followed=3,
        others=((4, 20), (9, 1)),
        refused=Refusals(unsigned=5, replayed=1),
        sent=7,
    )
    whole = told(replace(STATUS, mavlink=(link,)))
    document = whole["mavlink"][0]
    assert (document["other_triggers"], document["followed"], document["sent"]) == ({"4": 20, "9": 1}, 3, 7)
    assert document["refused"] == {"unsigned": 5, "forged": 0, "replayed": 1}
    (line,) = (line for line in status_lines(whole, 0) if "MAVLink" in line)
    assert line == (
        "MAVLink udp:1: heard; 2 silences; triggers left out, as system 3 is followed: 20 of system 4, 1 of system 9; "
        "packets refused: 5 unsigned, 1 replayed; 7 packets sent"
    )


def test_killed_daemon_is_not_read_as_flying_on(tmp_path: Path) -> None:
    ended = replace(STATUS, state="stopped")
    assert "nothing was written for 100 s" in read_status(written(tmp_path, STATUS), now_utc=STATUS.updated_utc + 100)
    assert "nothing was" not in read_status(written(tmp_path, ended), now_utc=STATUS.updated_utc + 100)


def test_file_names_cannot_steer_the_terminal(tmp_path: Path) -> None:
    hostile = replace(STATUS, flight="a\x1b[2Jb\nfake line")
    assert "a?[2Jb?fake line" in read_status(written(tmp_path, hostile))


def test_status_as_json_is_the_document(tmp_path: Path) -> None:
    assert json.loads(read_status(written(tmp_path, STATUS), as_json=True)) == told(STATUS)


def test_status_that_cannot_be_read_is_a_clear_error(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="holds no flight"):
        read_status(tmp_path)
    (tmp_path / "mosaic.json").write_text('{"flight": 3}')
    with pytest.raises(UsageError, match="is not a status"):
        read_status(tmp_path)
    for nonsense in ("[", "[]", '{"updated": 5}'):
        (tmp_path / "status.json").write_text(nonsense)
        with pytest.raises(UsageError, match="is not a status"):
            read_status(tmp_path)


MOSAIC: dict[str, Any] = {
    "flight": "map",
    "updated": "2024-05-01T12:00:00.000Z",
    "frames": {"placed": 9, "waiting": 1},
    "events": {"matched": 0},
    "islands": [{"id": 3, "held_out_px": {"median": 1.0, "p95": 4.0, "matches": 70}}, {"id": 4, "held_out_px": None}],
}
PROGRESS: dict[str, Any] = {
    "format": 1,
    "command": "reprocess",
    "state": "running",
    "started": "2024-05-01T11:00:00.000Z",
    "updated": "2024-05-01T12:00:00.000Z",
    "doing": "features",
    "done": 12,
    "of": 95,
    "seconds_left": 100.0,
}


def test_a_flight_without_a_status_is_told_by_its_map(tmp_path: Path) -> None:
    write_json(tmp_path / "mosaic.json", MOSAIC)
    assert read_status(tmp_path).splitlines() == [
        "map: no run tells of itself; the map is of 2024-05-01T12:00:00.000Z",
        "frames: 9 placed, 1 waiting",
        "triggers: none yet",
        "held-out matches: 1.0 px median, 4.0 px 95 % (island 3, 70 matches)",
    ]
    assert json.loads(read_status(tmp_path, as_json=True)) == MOSAIC


def test_a_command_tells_of_itself_before_there_is_a_map_and_after(tmp_path: Path) -> None:
    write_json(tmp_path / "progress.json", PROGRESS)
    now = 1714564801.0
    lines = [
        "reprocess: running, begun 2024-05-01T11:00:00.000Z, 2024-05-01T12:00:00.000Z",
        "features: 12 of 95, 2 min left",
    ]
    assert read_status(tmp_path, now_utc=now).splitlines() == lines
    write_json(tmp_path / "mosaic.json", MOSAIC)
    assert read_status(tmp_path, now_utc=now).splitlines()[:3] == [*lines, "frames: 9 placed, 1 waiting"]
    assert json.loads(read_status(tmp_path, as_json=True))["frames"] == MOSAIC["frames"]


@pytest.mark.parametrize(("later_s", "first"), [(-1.0, "reprocess"), (1.0, "today")])
def test_of_a_command_and_a_live_flight_in_one_folder_the_later_tells(
    tmp_path: Path, later_s: float, first: str
) -> None:
    write_json(tmp_path / "progress.json", PROGRESS)
    write_json(tmp_path / "mosaic.json", MOSAIC)
    written(tmp_path, replace(STATUS, updated_utc=1714564800.0 + later_s))
    assert read_status(tmp_path).startswith(f"{first}: ")


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
