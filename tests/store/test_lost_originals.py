"""Originals that are not there are sought in turn."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from gcs_mosaic.messages import Frame, content_hash
from gcs_mosaic.store.lost_originals import AGAIN_S, LostOriginals
from gcs_mosaic.store.originals import KeptOriginal, NotKept, Originals, OriginalsSettings
from tests.factories import taken


class Kept(Originals):
    """Originals that are kept or not, as told."""

    def __init__(self, out: Path, outcomes: Sequence[KeptOriginal | NotKept]) -> None:
        super().__init__(out, OriginalsSettings())
        self.outcomes = list(outcomes)

    def keep(self, frame: Frame) -> KeptOriginal | NotKept:
        return self.outcomes.pop(0)


KEPT = KeptOriginal(path="frames/x", linked=False, notice=None)


ILL, NO_ROOM = NotKept(reason="x", notice=None), NotKept(reason="x", notice=None, for_lack_of_room=True)


def lost(folder: Path, *outcomes: KeptOriginal | NotKept, where: Callable[[str], Path | None]) -> LostOriginals:
    sought = LostOriginals(Kept(folder, outcomes), where)
    assert not sought.is_due(1e9)
    sought.add([taken(folder, name) for name in ("a", "b", "c")])
    sought.add([taken(folder, "a")])
    assert sought.names == ["a", "b", "c"]
    assert len(sought) == 3
    return sought


def test_lost_originals_are_tried_in_turn_and_then_a_while_later(tmp_path: Path) -> None:
    sought = lost(tmp_path, where=lambda name: None)
    for name in "abc":
        assert sought.is_due(100.0)
        assert sought.next(100.0)[0].name == name
    assert not sought.is_due(100.0 + AGAIN_S - 0.1)
    assert sought.is_due(100.0 + AGAIN_S)
    sought.forget("b")
    assert sought.names == ["a", "c"]
    sought.seek_now()
    assert sought.is_due(0.0)


def test_one_that_is_found_begins_the_round_anew(tmp_path: Path) -> None:
    sought = lost(tmp_path, ILL, KEPT, ILL, ILL, where=lambda name: tmp_path / name)
    assert [sought.next(5.0)[1] for _ in range(2)] == [ILL, KEPT]
    assert sought.names == ["c", "a"]
    assert sought.next(5.0)[1] == ILL
    assert sought.is_due(5.0)
    assert sought.next(5.0)[1] == ILL
    assert not sought.is_due(5.0)


def test_while_there_is_no_room_no_other_is_tried(tmp_path: Path) -> None:
    sought = lost(tmp_path, NO_ROOM, where=lambda name: tmp_path / name)
    assert sought.next(5.0)[1] == NO_ROOM
    assert not sought.is_due(5.0 + AGAIN_S - 0.1)


def test_a_file_of_that_name_that_has_changed_is_not_the_one(tmp_path: Path) -> None:
    sought = lost(tmp_path, where=lambda name: tmp_path / name)
    (tmp_path / "a").write_bytes(b"changed")
    (tmp_path / "b").unlink()
    assert [sought.next(5.0)[1] for _ in range(2)] == [None, None]
    assert sought.read("a", content_hash(b"a")) is None
    assert sought.read("b", content_hash(b"b")) is None
    assert sought.read("c", content_hash(b"c")) == b"c"
