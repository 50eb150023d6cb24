"""What changed between two flights: what was laid down or taken away, and neither light nor a pixel's misplacement."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from gcs_mosaic.errors import UsageError
from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.stitch.arrays import ImageBGR
from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.store.folder import PROGRESS_NAME
from gcs_mosaic.views import changes as module
from gcs_mosaic.views.changes import Compared, FlightChanges, merged_flights
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.views.layers import UNKNOWN, LayerTiles
from gcs_mosaic.views.pictures import NoPicture
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


class TestWhatIsNotKnown:
    """Ground of one flight alone, and frames that cannot be shown, are not ground that has not changed."""

    def test_ground_of_one_flight_alone_is_told_of(self, tmp_path: Path) -> None:
        first = [Drawn(f"monday/{n}.png", Pose(180.0 + 60 * n, 250.0), modified=1e9) for n in range(2)]
        later = [Drawn(f"friday/{n}.png", Pose(240.0 + 60 * n, 250.0), modified=2e9) for n in range(4)]
        view = FlightView(as_merged(drawn_flight(tmp_path / "map", [*first, *later])))
        tiles = LayerTiles(view)
        found = whole(tiles.changes)
        unknown, window = sure(found.unknown), sure(found.window)
        places = {"of both": (240.0, 250.0), "of one": (500.0, 250.0), "of none": (240.0, 900.0)}
        cells = {
            name: (int((y - window.top) / window.cell), int((x - window.left) / window.cell))
            for name, (x, y) in places.items()
        }
        assert cells["of none"][0] >= window.rows
        assert not unknown[cells["of both"]]
        assert unknown[cells["of one"]]
        # Canvas units: of 560 x 240 both flights see 320 x 240, less a rim of 3 / 16 of a frame's 277 at each side.
        rim = 3 / 16 * 277
        assert found.share == pytest.approx((320 - 2 * rim) * (240 - 2 * rim) / (560 * 240), rel=0.1)
        greys = {
            name: grey_of(tiles.changed(0, Tile(16, (1 << 15) + int(x // 256), (1 << 15) + int(y // 256))), x, y)
            for name, (x, y) in places.items()
        }
        assert greys == {"of both": False, "of one": True, "of none": False}

    def test_a_wide_map_is_compared_too(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """However few cells a frame has."""
        shares = []
        for cells in (600, 60):
            monkeypatch.setattr(module, "LONGER_SIDE", cells)
            shares.append(whole(FlightChanges(flights(tmp_path / str(cells), nothing, nothing))).share)
        assert min(shares) > 0.2
        assert shares[1] > 0.7 * shares[0]

    def test_a_frame_that_cannot_be_shown_for_a_moment_is_compared_later(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        changes, tried = FlightChanges(flights(tmp_path, nothing, nothing)), list[int]()

        def add(_self: object, _island: object, _flight: int, number: int) -> bool:
            tried.append(number)
            if number == 3 and tried.count(3) < 3:
                raise NoPicture("The share is away.", passing=True)
            return True

        monkeypatch.setattr(FlightChanges, "_add", add)
        assert changes.ask(0).strength is None
        assert (tried, changes.ask(0).done) == ([1, 2, 3, 4, 5, 6, 7, 8], 7)
        monkeypatch.setattr(module, "RETRY_S", 0.0)
        sure(changes._islands[0]).again.clear()
        found = changes.ask(0)
        assert (tried[8:], found.done, found.unshown) == ([3, 3], 8, 0)

    def test_what_cannot_be_shown_is_counted(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """Never, or by a fault of ours; while the ledger is away nothing is left out."""
        changes = FlightChanges(flights(tmp_path, nothing, nothing))

        def away(*_: object) -> None:
            raise UsageError("The flight's ledger cannot be read.")

        def add(_self: object, _island: object, _flight: int, number: int) -> bool:
            if number == 5:
                raise ZeroDivisionError
            return number != 6

        with monkeypatch.context() as patched:
            patched.setattr(FlightChanges, "_add", away)
            with pytest.raises(UsageError):
                changes.ask(0)
        monkeypatch.setattr(FlightChanges, "_add", add)
        found = changes.ask(0)
        assert (found.done, found.frames, found.unshown) == (8, 8, 2)


def grey_of(data: bytes | None, x: float, y: float) -> bool:
    """Whether a tile of level 16 is grey at a canvas place."""
    if data is None:
        return False
    blue, green, red, alpha = sure(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED))[
        int(y) % 256, int(x) % 256
    ]
    return bool(alpha) and blue == green == red == UNKNOWN


def test_one_picture_without_a_time_does_not_make_a_flight_the_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    view = flights(tmp_path, nothing, nothing)
    times = np.array([np.nan, 1e9, 1e9, 1e9, np.nan, 2e9, 2e9, 2e9])
    monkeypatch.setattr(FlightView, "taken", lambda *_: times)
    assert merged_flights(view, view.table())[0] == ["monday", "friday"]
    times[:] = [1e9] * 4 + [np.nan, 2e9, 2e9, 2e9]
    assert merged_flights(view, view.table())[0] == ["monday", "friday"]


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
