"""What is not known to have changed, and why: told apart from what has not."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from gcs_mosaic.errors import UsageError
from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.views import changes as module
from gcs_mosaic.views.changes import FlightChanges, merged_flights
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.views.layers import UNKNOWN, LayerTiles
from gcs_mosaic.views.pictures import NoPicture
from tests.sure import sure
from tests.views.drawn_flight import Drawn, as_merged, drawn_flight
from tests.views.test_changes import flights, nothing, whole


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

    @pytest.mark.long
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
