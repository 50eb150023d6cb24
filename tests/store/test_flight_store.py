"""What is not written yet, and when the documents tell of it."""

from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from gcs_mosaic.messages import DamagedFile, Frame, content_hash
from gcs_mosaic.render.compositor import TileCompositor
from gcs_mosaic.store.flight_store import FlightStore
from gcs_mosaic.store.records import FrameState, IslandRecord
from tests.documents import document_at
from tests.factories import frame
from tests.sure import sure


@pytest.mark.parametrize("damaged", [1, 2])
def test_the_documents_tell_of_a_damaged_file_at_once(tmp_path: Path, damaged: int) -> None:
    with closing(FlightStore(tmp_path)) as store, TileCompositor(lambda name: None) as canvas:
        store.save(canvas, [], {})
        for number in range(damaged):
            store.accept_damaged(DamagedFile(name=f"{number}.jpg", reason="truncated"))
        store.save(canvas, [], {})
    assert document_at(tmp_path / "mosaic.json")["frames"]["damaged"] == damaged


def made(folder: Path, number: int) -> Frame:
    path = folder / f"{number}.jpg"
    path.write_bytes(bytes([number]))
    return replace(frame(path.name), path=path, content_hash=content_hash(path.read_bytes()))


def island(number: int, into: int | None = None) -> IslandRecord:
    return IslandRecord(id=number, merged_into=into)


def test_islands_of_after_the_checkpoint_are_found_again(tmp_path: Path) -> None:
    with closing(FlightStore(tmp_path)) as store, TileCompositor(lambda name: None) as canvas:
        store.save(canvas, [island(0), island(1, into=0), island(2)], {})
    with closing(FlightStore(tmp_path)) as store, TileCompositor(lambda name: None) as canvas:
        store.resume([], [])
        store.save(canvas, [island(0), island(1)], {})
        assert store.ledger.islands() == [island(0), island(1), island(2)]
        store.settle(sure(store.accept(made(tmp_path, 0))[0]).name, FrameState.WAITING, None)
        store.save(canvas, [island(0), island(1), island(2), island(3)], {})
        assert len(store.ledger.islands()) == 4


def test_frames_keep_their_order_when_a_flight_is_resumed(tmp_path: Path) -> None:
    """Also beside one that could not be decoded, and one that was whole only at the second look."""
    with closing(FlightStore(tmp_path)) as store, TileCompositor(lambda name: None) as canvas:
        store.accept_damaged(DamagedFile(name="3.jpg", reason="truncated"))
        came = [sure(store.accept(made(tmp_path, number))[0]).name for number in range(4)]
        store.settle("1.jpg", FrameState.DAMAGED, "no picture")
        store.save(canvas, [], {})
        saved, orders = store.saved(), [store.order_of(name) for name in came]
        late = sure(store.accept(made(tmp_path, 4))[0]).name
    with closing(FlightStore(tmp_path)) as store:
        store.load(saved)
        again = store.resume(came[:2], [])
        assert [frame.name for frame in again] == [*came[2:], late]
        assert [store.order_of(name) for name in (*came, late)] == [*orders, 4]
