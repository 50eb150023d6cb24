"""What changed between two flights: what was laid down or taken away, and neither light nor a pixel's misplacement."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.stitch.arrays import ImageBGR
from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.store.folder import PROGRESS_NAME
from gcs_mosaic.views.changes import Compared, FlightChanges, merged_flights
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.views.layers import UNKNOWN, LayerTiles
from tests.sure import sure
from tests.views.drawn_flight import Drawn, Things, as_merged, drawn_flight, laid_at

ADDED, GONE, STILL = (240.0, 250.0), (330.0, 250.0), (290.0, 280.0)


def nothing(_: ImageBGR) -> None:
    pass


def flights(root: Path, before: Things, after: Things, off: float = 1.0) -> FlightView:
    first = [Drawn(f"monday/{n}.png", Pose(180.0 + 60 * n, 250.0), 1.0, before, 1e9) for n in range(4)]
    later = [Drawn(f"friday/{n}.png", Pose(360.0 - 55 * n, 255.0, yaw=0.5), 0.6, after, 2e9) for n in range(4)]
    return FlightView(as_merged(drawn_flight(root / "map", [*first, *later], off)))


def whole(changes: FlightChanges) -> Compared:
    found = changes.ask(0)
    while found.strength is None:
        found = changes.ask(0)
    return found


def things(*, before: bool) -> Things:
    still, other = laid_at(*STILL, 6), laid_at(*(GONE if before else ADDED), 5)

    def lay(ground: ImageBGR) -> None:
        still(ground)
        other(ground)

    return lay


@pytest.mark.long
def test_what_came_and_what_went_is_found(tmp_path: Path) -> None:
    found = whole(FlightChanges(flights(tmp_path, things(before=True), things(before=False))))
    assert len(found.areas) == 2
    for place, sign in ((ADDED, 1), (GONE, -1)):
        one = min(found.areas, key=lambda area: np.hypot(area.x - place[0], area.y - place[1]))
        assert np.hypot(one.x - place[0], one.y - place[1]) < 5
        assert one.contrast * sign > 0


@pytest.mark.long
def test_light_and_a_pixel_beside_are_no_change(tmp_path: Path) -> None:
    assert whole(FlightChanges(flights(tmp_path, nothing, nothing, off=1.5))).areas == []


def test_who_asks_meanwhile_is_answered_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    changes, meanwhile = FlightChanges(flights(tmp_path, nothing, nothing)), list[Compared]()

    def ask(*_: object) -> None:
        with ThreadPoolExecutor(1) as other:
            meanwhile.append(other.submit(changes.ask, 0).result(5))

    monkeypatch.setattr(FlightChanges, "_add", ask)
    found = whole(changes)
    assert found.done == found.frames == 8
    assert [one.done for one in meanwhile] == list(range(8))
    assert {(one.frames, one.strength is None) for one in meanwhile} == {(8, True)}


def test_two_who_look_at_two_islands_keep_both(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    view, added = flights(tmp_path, nothing, nothing), list[int]()
    table = view.table()
    islands = table.islands.copy()
    islands[::2] = 1
    monkeypatch.setattr(FlightView, "table", lambda self, at_least=0: replace(table, islands=islands))
    monkeypatch.setattr(FlightChanges, "_add", lambda self, one, flight, number: added.append(number))
    changes = FlightChanges(view)
    for _ in range(4):
        for island in (0, 1):
            changes.ask(island, work_s=1e-6)
    for island in (0, 1):
        assert changes.ask(island).done == 4
    assert sorted(added) == list(range(1, 9))


def test_flights_are_told_in_order_of_time(tmp_path: Path) -> None:
    view = flights(tmp_path, nothing, nothing)
    names, of = merged_flights(view, view.table())
    assert names == ["monday", "friday"]
    assert of == {n: int(n > 4) for n in range(1, 9)}


def test_a_map_of_one_flight_has_no_such_layer(tmp_path: Path) -> None:
    view = flights(tmp_path, nothing, nothing)
    (view.root / "progress.json").unlink()
    assert merged_flights(view, view.table()) == ([], {})
    assert FlightChanges(view).ask(0) == Compared(view.table().revision, 0, 0)


@pytest.mark.parametrize("text", ["", "[]", "{", '{"command": 3}', "[" * 5000])
def test_a_strange_file_is_no_merged_flight(tmp_path: Path, text: str) -> None:
    view = flights(tmp_path, nothing, nothing)
    (view.root / "progress.json").write_text(text)
    assert merged_flights(view, view.table())[0] == []


@pytest.mark.long
def test_tiles_show_it_at_any_level(tmp_path: Path) -> None:
    tiles = LayerTiles(flights(tmp_path, nothing, laid_at(*ADDED, 5)))
    middle = 1 << 15
    assert tiles.changed(0, Tile(16, middle, middle)) is None  # nothing is known yet
    whole(tiles.changes)
    for level in (16, 14, 12):
        tile = Tile(level, middle >> (16 - level), middle >> (16 - level))
        data = np.frombuffer(sure(tiles.changed(0, tile)), np.uint8)
        picture = sure(cv2.imdecode(data, cv2.IMREAD_UNCHANGED))
        changed = (picture[..., 3] > 0) & (picture[..., :3] != UNKNOWN).any(axis=2)
        assert 0 < changed.mean() < 0.1
    assert tiles.changed(0, Tile(16, middle - 9, middle)) is None


@pytest.mark.parametrize(("written", "logged"), [(None, 0), (b"{", 1), (b"[" * 5000, 1), (b'{"command": "stitch"}', 0)])
def test_what_does_not_tell_is_not_merged_and_trouble_is_logged(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, written: bytes | None, logged: int
) -> None:
    """A file that is not there is no trouble."""
    view = FlightView(drawn_flight(tmp_path / "map", [Drawn("a/0.png", Pose(180.0, 250.0))]))
    if written is not None:
        (view.root / PROGRESS_NAME).write_bytes(written)
    assert merged_flights(view, view.table()) == ([], {})
    assert [PROGRESS_NAME in one.getMessage() for one in caplog.records] == [True] * logged
