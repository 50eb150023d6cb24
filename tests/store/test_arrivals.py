"""What becomes of the files of a flight as they come."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from gcs_mosaic.messages import DamagedFile, DroppedFrame
from gcs_mosaic.render.compositor import TileCompositor
from gcs_mosaic.store.changes import Changes
from gcs_mosaic.store.disk import CannotWrite
from gcs_mosaic.store.flight_store import FlightStore, StoreHooks
from gcs_mosaic.store.folder import flights_of, written_ns
from gcs_mosaic.store.lost_originals import AGAIN_S
from gcs_mosaic.store.records import FrameState, IslandRecord
from tests.documents import document_at
from tests.factories import taken
from tests.sure import sure


@pytest.fixture
def camera(tmp_path: Path) -> Path:
    folder = tmp_path / "camera"
    folder.mkdir()
    return folder


@pytest.fixture
def store(tmp_path: Path) -> Iterator[FlightStore]:
    (tmp_path / "out").mkdir()
    with closing(FlightStore(tmp_path / "out")) as store:
        yield store


def states(store: FlightStore) -> dict[str, tuple[FrameState, str | None]]:
    return {one.name: (one.state, one.reason) for one in store.ledger.frames()}


def test_the_same_picture_in_other_bytes_is_a_duplicate(store: FlightStore, camera: Path) -> None:
    first, again = taken(camera, "a.jpg", picture="p"), taken(camera, "b.jpg", picture="p")
    kept, said = store.accept(first)
    assert said == []
    assert sure(kept).path == store.out / "frames/a.jpg"
    assert store.accept(again) == (None, [])
    assert store.accept(replace(first, name="c.jpg", picture=None)) == (None, [])
    assert states(store) == {
        "a.jpg": (FrameState.PENDING, None),
        "b.jpg": (FrameState.DUPLICATE, "the same picture as a.jpg"),
        "c.jpg": (FrameState.DUPLICATE, "the same picture as a.jpg"),
    }
    assert store.taken_in == 3
    assert [store.has_picture("a.jpg", one) for one in ("p", "q")] == [True, False]
    assert store.has_picture("b.jpg", "p") is None


@pytest.mark.parametrize("picture", [None, "p"])
def test_what_could_not_be_read_may_come_again(store: FlightStore, camera: Path, picture: str | None) -> None:
    """As the same bytes, and as the same picture in others."""
    first = taken(camera, "a.jpg", picture=picture)
    store.accept(first)
    assert not store.was_unreadable("a.jpg")
    store.may_come_again(first)
    assert store.was_unreadable("a.jpg")
    kept, _ = store.accept(replace(first, name="b.jpg"))
    assert sure(kept).name == "b.jpg"
    if picture:
        store.may_come_again(replace(first, name="b.jpg"))
        kept, _ = store.accept(taken(camera, "c.jpg", picture=picture))
        assert sure(kept).name == "c.jpg"
    store.may_come_again(taken(camera, "never.jpg"))


def test_only_frames_of_this_flight_are_kept_ahead(store: FlightStore, camera: Path) -> None:
    first = taken(camera, "a.jpg", picture="p")
    store.accept(first)
    assert store.keep_ahead(replace(first, name="b.jpg")).path == first.path
    other_bytes = taken(camera, "c.jpg", picture="p")
    assert store.keep_ahead(other_bytes) == other_bytes
    rewritten = replace(taken(camera, "a.jpg", b"whole", picture="p"), name="a.jpg#2", earlier="a.jpg")
    ahead = store.keep_ahead(rewritten)
    assert ahead.name == "a.jpg#2"
    assert ahead.path.parent == store.out / "frames"
    assert ahead.path.read_bytes() == b"whole"
    new = store.keep_ahead(taken(camera, "d.jpg", picture="q"))
    assert new.path == store.out / "frames/d.jpg"


def test_nothing_is_kept_ahead_in_a_folder_that_is_not_ours_now(tmp_path: Path, camera: Path) -> None:
    with closing(FlightStore(tmp_path, around=StoreHooks(may_write=lambda: False))) as store:
        came = taken(camera, "a.jpg")
        assert store.keep_ahead(came) == came
        assert not (tmp_path / "frames").exists()


def test_new_bytes_of_a_picture_are_its_original_from_then_on(store: FlightStore, camera: Path) -> None:
    first = taken(camera, "a.jpg", b"preview", picture="p")
    store.accept(first)
    old = store.out / "frames/a.jpg"
    again = replace(taken(camera, "a.jpg", b"whole picture", picture="p"), name="a.jpg#2")
    store.take_new_bytes(again, "a.jpg")
    assert store.content_hash("a.jpg") == again.content_hash
    assert store.original("a.jpg") == b"whole picture"
    assert (store.known_as("a.jpg#2"), store.known_as("a.jpg"), store.known_as("b.jpg")) == ("a.jpg", "a.jpg", None)
    assert store.accept(replace(again, name="c.jpg"))[0] is None
    with TileCompositor(lambda name: None) as canvas:
        store.save(canvas, [], {})
        assert old.exists()  # it is still to be decoded
        store.settle("a.jpg", FrameState.REJECTED, "too dark")
        store.save(canvas, [], {})
    assert not old.exists()
    assert store.original("a.jpg") == b"whole picture"


def test_an_original_that_is_gone_is_read_from_where_it_came(tmp_path: Path, camera: Path) -> None:
    found: list[Path] = []
    may_write = [True]
    around = StoreHooks(elsewhere=lambda name: next(iter(found), None), may_write=lambda: may_write[0])
    with closing(FlightStore(tmp_path, around=around)) as store:
        came = taken(camera, "a.jpg")
        kept = sure(store.accept(came)[0])
        assert store.found_again(kept) == kept
        kept.path.unlink()
        assert store.original("a.jpg") is None
        assert store.found_again(kept) is None
        assert store.lacks_files()
        found.append(came.path)
        assert store.original("a.jpg") == b"a.jpg"
        assert sure(store.found_again(kept)).path == came.path
        found[0] = taken(camera, "other.jpg").path
        assert store.original("a.jpg") is None
        may_write[0] = False
        with pytest.raises(CannotWrite, match="is not there now"):
            store.original("a.jpg")


def test_originals_that_went_with_the_folder_are_sought_and_those_still_to_be_processed_first(
    tmp_path: Path, camera: Path
) -> None:
    around = StoreHooks(elsewhere=lambda name: camera / name if name != "lost.jpg" else None)
    with closing(FlightStore(tmp_path, around=around)) as store, TileCompositor(lambda name: None) as canvas:
        for name in ("done.jpg", "lost.jpg", "pending.jpg", "there.jpg"):
            store.accept(taken(camera, name))
        for name in ("done.jpg", "there.jpg"):
            store.settle(name, FrameState.WAITING, None)
        store.save(canvas, [], {})
        assert not store.lacks_files()
        for name in ("done.jpg", "lost.jpg", "pending.jpg"):
            (tmp_path / "frames" / name).unlink()
        assert store.lacks_files()
        assert store.write_again() == 3
        assert (tmp_path / "frames/pending.jpg").exists()
        assert store.not_kept() == ["done.jpg", "lost.jpg"]
        assert store.seeks_originals(0.0)
        assert store.keep_lost(0.0) == []
        assert (tmp_path / "frames/done.jpg").exists()
        assert store.take_regained() == ["done.jpg"]
        assert store.take_regained() == []
        store.keep_lost(0.0)
        assert not store.seeks_originals(AGAIN_S - 0.1)
        assert store.keep_lost(AGAIN_S - 0.1) == []
        assert store.seeks_originals(AGAIN_S)
        store.seek_originals_now()
        assert store.seeks_originals(0.0)
        kept = {one.name: one.original for one in store.ledger.frames()}
        assert (kept["done.jpg"], kept["lost.jpg"]) == ("frames/done.jpg", None)


def test_what_cannot_be_kept_is_said_and_sought(store: FlightStore, camera: Path) -> None:
    came = taken(camera, "a.jpg")
    came.path.write_bytes(b"other")
    kept, said = store.accept(came)
    assert sure(kept).path == came.path
    assert [notice.text for notice in said] == ["a.jpg is not kept: the file was written again before it could be kept"]
    assert store.not_kept() == ["a.jpg"]


def test_every_file_is_counted_and_has_its_outcome(store: FlightStore, camera: Path) -> None:
    store.accept_damaged(DamagedFile(name="d.jpg", reason="truncated"))
    store.accept_dropped(DroppedFrame(frame=taken(camera, "s.jpg"), reason="no room"))
    store.accept(taken(camera, "a.jpg"))
    assert store.taken_in == 3
    assert store.settle_unstitched() == 1
    assert states(store)["s.jpg"] == (FrameState.DROPPED, "no room")
    with TileCompositor(lambda name: None) as canvas:
        store.save(canvas, [], {})
    assert states(store)["a.jpg"] == (FrameState.UNSTITCHED, "the flight was ended before its turn")
    assert store.settle_unstitched() == 0


def test_an_outcome_is_told_once(store: FlightStore, camera: Path, caplog: pytest.LogCaptureFixture) -> None:
    store.accept(taken(camera, "a.jpg"))
    with caplog.at_level(logging.INFO):
        for _ in range(2):
            store.settle("a.jpg", FrameState.REJECTED, "too dark")
        store.settle("a.jpg", FrameState.PLACED, None)
    assert [one.message for one in caplog.records] == ["a.jpg: rejected, too dark", "a.jpg: placed"]


def revision(store: FlightStore) -> int:
    return int(document_at(store.out / "mosaic.json")["revision"])


def test_accounts_are_brought_up_to_the_ledgers_without_a_new_revision(store: FlightStore, camera: Path) -> None:
    store.tell_accounts()
    assert not (store.out / "mosaic.json").exists()
    with TileCompositor(lambda name: None) as canvas:
        store.save(canvas, [], {})
        before = revision(store)
        store.accept(taken(camera, "a.jpg"))
        store.tell_accounts()
        assert document_at(store.out / "mosaic.json")["frames"]["pending"] == 1
        assert revision(store) == before == store.revision
        store.save(canvas, [], {})
        assert revision(store) == before  # nothing has changed since


def test_a_change_that_no_document_tells_makes_no_revision(store: FlightStore, camera: Path) -> None:
    store.accept(taken(camera, "a.jpg"))
    with TileCompositor(lambda name: None) as canvas:
        store.save(canvas, [], {})
        before = revision(store)
        store.note_measured("a.jpg", (40, 30), 0.5)
        store.save(canvas, [], {})
        assert revision(store) == before
        (measured,) = store.ledger.frames()
        assert (measured.width, measured.height, measured.sharpness) == (40, 30, 0.5)


@pytest.mark.parametrize(
    ("changes", "any_at_all", "public"),
    [
        (Changes(), False, False),
        (Changes(sizes={"a": (1, 2)}), True, False),
        (Changes(painted={"a": sure}), True, False),  # type: ignore[dict-item]
        (Changes(states={"a": (FrameState.WAITING, None)}), True, True),
        (Changes(placements={"a": sure}), True, True),  # type: ignore[dict-item]
        (Changes(tiles=[frozenset()]), True, True),
    ],
)
def test_which_changes_the_documents_tell(changes: Changes, any_at_all: bool, public: bool) -> None:
    assert (bool(changes), changes.is_public) == (any_at_all, public)


def test_the_ledger_is_on_the_disk_before_any_document_tells_of_it(
    store: FlightStore, camera: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[bool] = []
    monkeypatch.setattr(store.ledger, "make_durable", lambda: told.append((store.out / "mosaic.json").exists()))
    store.accept(taken(camera, "a.jpg"))
    with TileCompositor(lambda name: None) as canvas:
        store.save(canvas, [], {})
    assert told == [False]
    assert (store.out / "mosaic.json").exists()


def test_the_ledger_tells_which_islands_were_merged(store: FlightStore) -> None:
    merged = [IslandRecord(id=0, merged_into=None), IslandRecord(id=1, merged_into=0)]
    with TileCompositor(lambda name: None) as canvas:
        store.note_tiles([])
        store.save(canvas, merged, {})
    assert store.ledger.islands() == merged


def test_a_flight_counts_as_written_since_the_moment_in_which_it_was(store: FlightStore) -> None:
    written = written_ns(store.out) / 1e9
    assert flights_of(store.out, written - 1) == flights_of(store.out, written) == [store.out]
    assert flights_of(store.out, written + 1) == []
