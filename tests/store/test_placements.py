"""placements.json is rewritten now and then; what the journal tells in between makes it whole at every revision."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.store import placements as module
from gcs_mosaic.store.disk import write_beside
from gcs_mosaic.store.journal import told_after
from gcs_mosaic.store.listing import FrameNews
from gcs_mosaic.store.placements import Placements
from gcs_mosaic.store.records import CoveredRecord
from tests.documents import document_at, journal_lines, placements
from tests.store.ledger_parts import NEARLY_THE_SAME, an_estimate

SHIFTED = replace(an_estimate(Pose(7, 8)), camera=Camera(40, 30, 1.3))


def news(number: int) -> FrameNews:
    """One more frame, and a.jpg lies elsewhere."""
    moved = an_estimate(Pose(number, 2 * number))
    return FrameNews(estimates=[moved, replace(SHIFTED, name=f"{number}.jpg")], newest=f"{number}.jpg")


def revision_of_whole(out: Path) -> int:
    return int(document_at(out / "placements.json")["revision"])


def test_journal_and_whole_say_at_every_revision_what_the_whole_alone_would(tmp_path: Path) -> None:
    told, every = tmp_path / "told", tmp_path / "every"
    for out in (told, every):
        out.mkdir()
    few, all_of_it = Placements(told), Placements(every)
    covered = CoveredRecord(name="c.jpg", by="a.jpg", by_from_frame=NEARLY_THE_SAME, width=4, height=3)
    changes = [
        *(news(1), FrameNews(covered=[covered], newest="c.jpg"), news(2), FrameNews(waiting=["w.jpg"], newest="2.jpg")),
        *(news(3), FrameNews(rejected={"w.jpg": "grey"}, newest="3.jpg"), news(4)),
    ]
    for revision, change in enumerate(changes, start=1):
        few.write(revision, change, everything=False)
        all_of_it.write(revision, change, everything=True)
        by_line, at_once = placements(told), document_at(every / "placements.json")
        for document in (by_line, at_once):
            cameras = document.pop("cameras")
            document["frames"] = [frame | {"camera": cameras[frame["camera"]]} for frame in document["frames"]]
        for one, other in zip(by_line.pop("covered"), at_once.pop("covered"), strict=True):
            assert np.allclose(one.pop("canvas_from_frame"), other.pop("canvas_from_frame"), rtol=1e-9)
            assert one == other
        assert by_line == at_once
    assert revision_of_whole(told) == 1


def test_the_whole_is_written_when_due(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: now[0]))
    files = Placements(tmp_path)
    files.write(1, news(1), everything=False)
    files.write(2, news(2), everything=False)
    assert revision_of_whole(tmp_path) == 1
    now[0] += module.WHOLE_EACH_S
    files.write(3, news(3), everything=False)
    assert revision_of_whole(tmp_path) == 3
    assert [json.loads(line).get("since") for line in journal_lines(tmp_path)] == [0, None, None, None]


def test_a_long_flight_writes_the_whole_more_seldom(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    now, files = [0.0], Placements(tmp_path)
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: now[0]))

    def slowly(path: Path, data: bytes) -> None:
        now[0] += 1.0
        write_beside(path, data)

    monkeypatch.setattr(module, "write_beside", slowly)
    files.write(1, news(1), everything=True)
    now[0] += 0.9 / module.WHOLE_SHARE
    files.write(2, news(2), everything=False)
    assert revision_of_whole(tmp_path) == 1
    now[0] += 0.2 / module.WHOLE_SHARE
    files.write(3, news(3), everything=False)
    assert revision_of_whole(tmp_path) == 3


def test_a_long_journal_is_begun_anew_and_nobody_misses_anything(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "JOURNAL_BYTES", 2000)
    files, sinces = Placements(tmp_path), set()
    for revision in range(1, 30):
        files.write(revision, news(revision), everything=revision % 5 == 0)
        head, *lines = map(json.loads, journal_lines(tmp_path))
        sinces.add(head["since"])
        assert [line["revision"] for line in lines] == list(range(head["since"] + 1, revision + 1))
        assert [frame["name"] for frame in placements(tmp_path)["frames"][1:]] == [
            f"{n}.jpg" for n in range(1, revision + 1)
        ]
    assert len(sinces) > 2


def test_catching_up_and_closing_leave_one_file(tmp_path: Path) -> None:
    files = Placements(tmp_path)
    files.write(1, news(1), everything=True)
    files.write(2, news(2), everything=False)
    files.close()
    assert (tmp_path / "placements.jsonl").exists(), "what only it tells must not be lost"
    files.catch_up()
    assert revision_of_whole(tmp_path) == 2
    files.close()
    assert [path.name for path in tmp_path.iterdir()] == ["placements.json"]


def test_a_journal_that_somebody_took_away_is_begun_anew(tmp_path: Path) -> None:
    files = Placements(tmp_path)
    files.write(1, news(1), everything=True)
    (tmp_path / "placements.jsonl").unlink()
    files.write(2, news(2), everything=False)
    assert revision_of_whole(tmp_path) == 2
    assert json.loads(journal_lines(tmp_path)[0])["since"] == 1


def test_only_newer_and_whole_lines_are_asked_for(tmp_path: Path) -> None:
    files = Placements(tmp_path)
    for revision in (1, 2, 3):
        files.write(revision, news(revision), everything=False)
    journal = tmp_path / "placements.jsonl"
    with journal.open("ab") as file:
        file.write(b'{"format":1,"revi')
    asked = [[json.loads(line) for line in told_after(journal, after).splitlines()] for after in (0, 2, 3, 9)]
    assert [[line["revision"] for line in lines[1:]] for lines in asked] == [[1, 2, 3], [3], [], []]
    assert all(lines[0] == {"format": 1, "since": 0} for lines in asked)
