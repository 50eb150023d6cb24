"""The map in focus at the ground, as tiles: of what they are made, when they are made anew, and what stays transparent."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest

from gcs_mosaic.errors import UsageError
from gcs_mosaic.integral import ground_tiles
from gcs_mosaic.integral.forms import mean
from gcs_mosaic.integral.ground_lens import ground_lens
from gcs_mosaic.integral.ground_surface import GroundHeights, cell_size
from gcs_mosaic.integral.ground_tiles import GroundPart, GroundTiles, PartKey
from gcs_mosaic.integral.relief_plane import slopes_of
from gcs_mosaic.render.tile_grid import TILE_SIZE, Tile, level_from_canvas
from gcs_mosaic.stitch.camera.geometry import Camera
from gcs_mosaic.stitch.camera.relief import ReliefDisplacement
from gcs_mosaic.views.flight_view import FlightView, FrameTable, table_of
from tests.ended_flights import ended_flight
from tests.sure import sure

pytestmark = pytest.mark.long
LEVEL = 16


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory, world_cache: Path) -> Path:
    folder = tmp_path_factory.mktemp("ground")
    return ended_flight(folder / "flight", world_cache)


def keys_of(view: FlightView, height: float | None, z: int = LEVEL) -> list[PartKey]:
    """All parts of a level that the flight touches."""
    table = view.table()
    low, high = np.nanmin(table.boxes[:, :2], axis=0), np.nanmax(table.boxes[:, 2:], axis=0)
    first, last = ((level_from_canvas(z, one) // (TILE_SIZE * ground_tiles.SPAN)).astype(int) for one in (low, high))
    island = int(table.islands[0])
    return [
        PartKey(island, z, column, row, height)
        for column in range(int(first[0]), int(last[0]) + 1)
        for row in range(int(first[1]), int(last[1]) + 1)
    ]


def made(tiles: GroundTiles, keys: Sequence[PartKey]) -> list[GroundPart]:
    tiles.want(keys)
    while tiles.step():
        tiles.want(keys)
    return [part for _, part, _ in tiles.parts(keys) if part is not None]


def pixels(part: GroundPart) -> Iterator[tuple[Tile, np.ndarray]]:
    for tile, data in part.tiles.items():
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        assert image is not None
        if image.shape[2] == 3:  # without alpha where all of it is seen
            image = np.dstack([image, np.full(image.shape[:2], 255, np.uint8)])
        yield tile, np.asarray(image)


def counts_at(view: FlightView, places: np.ndarray) -> np.ndarray:
    """How many frames see canvas places (n, 2), clear of their borders; -1 near one."""
    inside = np.array(
        [
            [cv2.pointPolygonTest(outline.astype(np.float32), (float(x), float(y)), True) for x, y in places]
            for outline in view.table().outlines
        ]
    )
    return np.where((np.abs(inside) > 6).all(axis=0), (inside > 0).sum(axis=0), -1)


def test_what_fewer_than_two_frames_see_is_transparent(flown: Path) -> None:
    view = FlightView(flown)
    tiles = GroundTiles(view)
    seen = {0: 0, 1: 0, 2: 0}
    for part in made(tiles, keys_of(view, 0.0)):
        for tile, image in pixels(part):
            rows, columns = np.mgrid[8:256:16, 8:256:16]
            corner = np.array([tile.x, tile.y]) * TILE_SIZE - level_from_canvas(LEVEL, np.zeros(2))
            places = np.column_stack([columns.ravel(), rows.ravel()]) + 0.5 + corner
            alpha = image[..., 3][rows, columns].ravel()
            for count, opaque in zip(counts_at(view, places).tolist(), alpha.tolist(), strict=True):
                if count >= 0:
                    assert opaque == (255 if count >= 2 else 0), (tile, count)
                    seen[min(count, 2)] += 1
    assert seen[1] > 20
    assert seen[2] > 200


def test_a_part_shows_what_a_lens_over_it_shows(flown: Path) -> None:
    """Made frame by frame and cut into tiles, it is the mean of the looks as a lens has it."""
    view = FlightView(flown)
    tiles = GroundTiles(view)
    key = max(keys_of(view, 0.0), key=lambda one: len(view.table().near(one.island, one.box)))
    (part,) = made(tiles, [key])
    tile, image = max(pixels(part), key=lambda one: int((one[1][..., 3] > 0).sum()))
    left, top = (np.array([tile.x, tile.y]) * TILE_SIZE - level_from_canvas(LEVEL, np.zeros(2))).tolist()
    lens = ground_lens(view, key.island, (left + 128, top + 128), 256, 256.0)
    shown = mean(lens.stack(0.0))
    both = np.isfinite(shown[..., 0]) & (image[..., 3] > 0)
    apart = np.abs(shown[both].mean(axis=1) - image[..., :3][both].mean(axis=1))
    assert both.sum() > 2000
    assert np.median(apart) < 4  # levels: what WebP loses, and frames that see not the middle but a corner


def test_the_same_again_is_the_same_and_another_focus_is_not(flown: Path) -> None:
    keys = keys_of(FlightView(flown), 0.0)
    first, again = (made(GroundTiles(FlightView(flown)), keys) for _ in range(2))
    assert [one.tiles for one in first] == [one.tiles for one in again]
    off = made(GroundTiles(FlightView(flown)), keys_of(FlightView(flown), 0.2))
    assert [one.tiles for one in off] != [one.tiles for one in first]


def test_over_open_ground_the_focus_is_found_at_the_map(flown: Path) -> None:
    view = FlightView(flown)
    parts = made(GroundTiles(view), keys_of(view, None))
    assert sum(one.known for one in parts) >= 1
    still = made(GroundTiles(view), keys_of(view, 0.0))
    for one, other in zip(parts, still, strict=True):
        for (_, found), (_, mapped) in zip(pixels(one), pixels(other), strict=True):
            both = (found[..., 3] > 0) & (mapped[..., 3] > 0)
            if both.sum() > 2000:
                assert np.abs(found[both].astype(float) - mapped[both]).mean() < 8


def test_what_nobody_looks_at_is_not_made(flown: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    view = FlightView(flown)
    tiles, keys = GroundTiles(view), keys_of(view, 0.0)
    assert not tiles.step()
    tiles.want(keys[:1])
    assert tiles.step()
    monkeypatch.setattr(ground_tiles, "ASKED_S", -1.0)
    assert not tiles.step()


def test_a_part_is_made_anew_only_if_something_lies_otherwise(flown: Path, tmp_path: Path) -> None:
    root = shutil.copytree(flown, tmp_path / "again")
    view = FlightView(root)
    tiles, keys = GroundTiles(view), keys_of(FlightView(root), 0.0)
    before = made(tiles, keys)
    assert not any(is_old for *_, is_old in tiles.parts(keys))
    assert [one.version for one in made(tiles, keys)] == [one.version for one in before]


class Growing(FlightView):
    """A flight of which some frames have not come yet."""

    missing = 0

    def table(self, at_least: int = 0) -> FrameTable:
        whole = super().table(at_least)
        frames = whole.frames[: len(whole.frames) - self.missing]
        return table_of(whole.revision - self.missing, frames)


def test_a_new_look_renews_what_it_touches_and_leaves_the_rest(flown: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ground_tiles, "REST_S", 0.0)
    view = Growing(flown)
    tiles, keys = GroundTiles(view), keys_of(view, 0.0, 17)
    view.missing = 1
    before = dict(zip(keys, made(tiles, keys), strict=True))
    view.missing = 0
    newest = view.table().frames[-1].number
    touched = {
        key for key in keys if newest in {view.table().frames[at].number for at in view.table().near(0, key.box)}
    }
    assert 0 < len(touched) < len(keys)
    assert {key for key, _, is_old in tiles.parts(keys) if is_old} == touched
    after = dict(zip(keys, made(tiles, keys), strict=True))
    assert {key for key in keys if after[key].version != before[key].version} == touched
    fresh = dict(zip(keys, made(GroundTiles(FlightView(flown)), keys), strict=True))
    assert [after[key].tiles for key in keys] == [fresh[key].tiles for key in keys]


def test_originals_that_are_gone_are_counted_and_leave_nothing_to_see(flown: Path, tmp_path: Path) -> None:
    root = shutil.copytree(flown, tmp_path / "robbed")
    for original in (root / "frames").rglob("*.jpg"):
        original.unlink()
    view = FlightView(root)
    parts = made(GroundTiles(view), keys_of(view, 0.0))
    assert not any(one.tiles for one in parts)
    assert max(one.lost for one in parts) >= 2


def test_from_too_far_away_it_says_so(flown: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ground_tiles, "MOST_FRAMES", 3)
    view = FlightView(flown)
    parts = made(GroundTiles(view), keys_of(view, 0.0, 12))
    assert {one.trouble for one in parts if len(one.records) > 3} == {ground_tiles.FROM_AFAR}
    assert not any(one.tiles for one in parts if one.trouble)


def test_a_trouble_is_said_once_and_the_next_part_is_made(flown: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    view = FlightView(flown)
    tiles, table = GroundTiles(view), view.table()
    keys = [max(keys_of(view, 0.0), key=lambda one: len(table.near(one.island, one.box)))]

    def broken(*_: object) -> None:
        raise ValueError("broken")

    with monkeypatch.context() as patched:
        patched.setattr(ground_tiles, "read_look", broken)
        with pytest.raises(ValueError, match="broken"):
            made(tiles, keys)
    assert [one.trouble for one in made(tiles, keys)] == [ground_tiles.FAILED]
    assert not tiles.step()


def test_what_a_ledger_that_is_away_kept_from_being_made_is_made_once_it_is_back(
    flown: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ground_tiles, "REST_S", 0.0)
    view = FlightView(flown)
    tiles, keys = GroundTiles(view), keys_of(view, 0.0)[:1]

    def away(_: int) -> None:
        raise UsageError("The ledger is away.")

    with monkeypatch.context() as patch:
        patch.setattr(view, "painted", away)
        tiles.want(keys)
        assert tiles.step()
        assert tiles.step()
        ((_, part, waits),) = tiles.parts(keys)
        assert (sure(part).trouble, waits) == ("The ledger is away.", True)
    assert [one.trouble for one in made(tiles, keys)] == [""]


def test_cells_stay_while_an_island_grows(flown: Path) -> None:
    table = FlightView(flown).table()
    assert np.log2(cell_size(table, int(table.islands[0]))) % 1 == 0
    assert cell_size(table, 99) == 1


def test_heights_are_smooth_between_cells() -> None:
    heights = GroundHeights(10.0, 20.0, 4.0, np.array([[0.0, 4.0], [8.0, 12.0]]), 1, 4)
    at = heights.at(np.array([[10.0, 20.0], [12.0, 20.0], [10.0, 22.0], [14.0, 24.0], [99.0, 99.0]]))
    assert at.tolist() == [0, 2, 4, 12, 12]


def test_slopes_of_relief_are_kept_and_crowns_left_out() -> None:
    camera = Camera(640, 480)
    rng = np.random.default_rng(3)
    y, x = np.mgrid[0:12, 0:16] / 15.0
    slope = np.stack([0.02 * x, -0.01 * y], axis=-1).astype(np.float32)
    crowns = rng.normal(0, 0.003, slope.shape).astype(np.float32)
    (plain, rough) = (ReliefDisplacement(16, 12, one.tobytes()) for one in (slope, slope + crowns))
    kept, smoothed = (slopes_of(one, camera) for one in (plain, rough))
    assert kept is not None
    assert smoothed is not None
    assert np.abs(kept.grid - slope).max() < 0.001
    assert (smoothed.grid - slope).std() < 0.5 * crowns.std()
    assert slopes_of(None, camera) is None
