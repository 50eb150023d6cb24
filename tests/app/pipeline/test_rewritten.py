"""A file that is written again with the same picture is the same frame, and its new bytes are the original.

In the field: exiftool -overwrite_original writes positions into files 1.5 s after the camera.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from gcs_mosaic.app.pipeline.rewritten import as_whole_of_damaged, taken_as_rewritten
from gcs_mosaic.frames.picture_hash import picture_hash
from gcs_mosaic.messages import Frame, OtherFile, content_hash
from gcs_mosaic.render.compositor import TileCompositor
from gcs_mosaic.store.flight_store import FlightStore
from gcs_mosaic.store.records import FrameState
from tests.frames.image_files import encoded, picture, turned, with_thumbnail
from tests.sure import sure

JPEG = encoded(".jpg")


def came(home: Path, data: bytes, name: str = "a.jpg", earlier: str | None = None) -> Frame:
    """A file as a watched folder brings it."""
    path = home / "card" / name.partition("#")[0]
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(data)
    digest, same = content_hash(data), picture_hash(data)
    told = {"content_hash": digest, "size": len(data), "picture": same, "earlier": earlier}
    return Frame(name=name, path=path, received=1.0, modified=2.0, data=data, **told)  # type: ignore[arg-type]


@pytest.fixture
def store(tmp_path: Path) -> Iterator[FlightStore]:
    (tmp_path / "map").mkdir()
    with closing(FlightStore(tmp_path / "map")) as store:
        yield store


def originals(store: FlightStore) -> dict[str, bytes]:
    return {frame.name: (store.out / sure(frame.original)).read_bytes() for frame in store.ledger.frames()}


def saved(store: FlightStore) -> None:
    with TileCompositor(lambda name: None) as canvas:
        store.save(canvas, [], {})


@pytest.mark.parametrize("ahead", [False, True])
def test_tags_make_no_frame_and_their_bytes_are_the_original(tmp_path: Path, store: FlightStore, ahead: bool) -> None:
    assert store.accept(came(tmp_path, JPEG))[0]
    for number, data in ((2, with_thumbnail(JPEG)), (3, turned(JPEG))):
        again = came(tmp_path, data, f"a.jpg#{number}", f"a.jpg#{number - 1}" if number > 2 else "a.jpg")
        assert taken_as_rewritten(store, store.keep_ahead(again) if ahead else again)
    (frame,) = store.ledger.frames()
    assert (frame.name, frame.content_hash) == ("a.jpg", content_hash(turned(JPEG)))
    assert originals(store) == {"a.jpg": turned(JPEG)}
    assert store.original("a.jpg") == turned(JPEG)


def test_old_originals_stay_until_the_frame_is_decoded(tmp_path: Path, store: FlightStore) -> None:
    kept = sure(store.accept(came(tmp_path, JPEG))[0])
    assert taken_as_rewritten(store, came(tmp_path, turned(JPEG), "a.jpg#2", "a.jpg"))
    saved(store)
    assert kept.path.read_bytes() == JPEG
    store.settle("a.jpg", FrameState.REJECTED, "too little to see")
    saved(store)
    saved(store)
    assert not kept.path.exists()
    assert originals(store) == {"a.jpg": turned(JPEG)}


def test_another_picture_in_the_same_file_is_another_frame(tmp_path: Path, store: FlightStore) -> None:
    store.accept(came(tmp_path, JPEG))
    other = came(tmp_path, encoded(".jpg", picture(seed=1)), "a.jpg#2", "a.jpg")
    assert not taken_as_rewritten(store, other)
    assert store.accept(other)[0]


def test_after_a_restart_the_picture_is_known_by_its_original(tmp_path: Path, store: FlightStore) -> None:
    store.accept(came(tmp_path, JPEG))
    with closing(FlightStore(store.out)) as resumed:
        resumed.resume([], [])
        for _ in range(2):
            assert taken_as_rewritten(resumed, came(tmp_path, turned(JPEG), "a.jpg#2", "a.jpg"))
        assert originals(resumed) == {"a.jpg": turned(JPEG)}


def test_a_tagged_copy_under_another_name_is_a_duplicate(tmp_path: Path, store: FlightStore) -> None:
    store.accept(came(tmp_path, JPEG))
    copy = store.keep_ahead(came(tmp_path, turned(JPEG), "tagged_a.jpg"))
    assert store.accept(copy) == (None, [])
    assert [(frame.state, frame.original) for frame in store.ledger.frames()][1] == (FrameState.DUPLICATE, None)


def test_what_follows_a_file_that_could_not_be_decoded_is_of_its_shot(tmp_path: Path, store: FlightStore) -> None:
    first = came(tmp_path, JPEG)
    store.accept(first)
    rest = came(tmp_path, encoded(".jpg", picture(seed=1)), "a.jpg#2", "a.jpg")
    assert not as_whole_of_damaged(store, rest).is_whole_of_earlier
    store.may_come_again(first)
    assert as_whole_of_damaged(store, rest).is_whole_of_earlier


def test_files_of_other_cameras_are_in_the_ledger_until_they_are_mapped(tmp_path: Path, store: FlightStore) -> None:
    thermal = came(tmp_path, JPEG, "a_t.jpg")
    store.accept_other(OtherFile(frame=replace(thermal, data=None), camera="_t", mapped="_w"))
    assert store.ledger.other_files() == [("a_t.jpg", "_t")]
    assert store.accounts().orphans == 0
    store.accept(thermal)
    assert store.ledger.other_files() == []


def test_a_preview_is_no_orphan(tmp_path: Path, store: FlightStore) -> None:
    store.accept(came(tmp_path, JPEG))
    assert store.accounts().orphans == 1
    store.note_beside("a.jpg", "preview")
    assert store.accounts().orphans == 0
