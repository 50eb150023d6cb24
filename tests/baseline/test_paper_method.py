"""`--method paper` from the command line to the files: the same folder as any flight, with homographies in place of poses."""

import json
import shutil
import sqlite3
import sys
from contextlib import closing
from pathlib import Path

import cv2
import numpy as np
import pytest

import sitl.flight
from gcs_mosaic.cli import main as cli
from gcs_mosaic.render.tile_grid import Tile, tiles_over
from gcs_mosaic.stitch.features.detectors import FeatureKind, is_available
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.schema import MIGRATIONS, VERSION
from gcs_mosaic.store.tiles import read_tile
from sitl.path import Plan
from tests.documents import document_at
from tests.running import flying, six_pictures


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory, world_cache: Path) -> Path:
    """Six frames that overlap, and one of nothing."""
    folder = tmp_path_factory.mktemp("frames")
    route = Plan(frames=6, height=60)
    sitl.flight.make("survey", folder, (640, 480), cache=world_cache, seed=3, world_size=2048, route=route)
    cv2.imwrite(str(folder / "DCIM" / "nothing.png"), np.full((480, 640, 3), 90, np.uint8))
    return folder / "DCIM"


@pytest.fixture(scope="module")
def out(frames: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("flown") / "mosaic"
    assert cli.main(["stitch", str(frames), "--out", str(out), "--method", "paper", "--scale", "0.5"]) == 0
    return out


@pytest.mark.long
def test_every_frame_is_accounted_for(out: Path) -> None:
    manifest, placements = (document_at(out / name) for name in ("mosaic.json", "placements.json"))
    assert (manifest["frames"]["placed"], manifest["frames"]["rejected"]) == (6, 1)
    assert [island["frames"] for island in manifest["islands"]] == [6]
    (rejected,) = placements["rejected"]
    assert rejected["name"] == "nothing.png"
    assert "matches with the region of interest" in rejected["reason"]
    assert [frame["hops"] for frame in placements["frames"]] == [0, 1, 2, 3, 4, 5]


def test_all_levels_have_their_tiles(out: Path) -> None:
    (island,) = document_at(out / "mosaic.json")["islands"]
    assert island["maxzoom"] == 15
    for level in range(island["minzoom"], 16):
        assert any(read_tile(out, 0, tile) is not None for tile in tiles_over(tuple(island["bounds"]), level))
    assert read_tile(out, 0, Tile(15, 2**14, 2**14)) is not None


def test_the_export_says_where_pixels_go_as_the_homography_does(out: Path, tmp_path: Path) -> None:
    assert cli.main(["export", str(out), "--format", "placements", "--to", str(tmp_path / "p.json")]) == 0
    entries = json.loads((tmp_path / "p.json").read_text())["frames"]
    turned = [abs(np.array(entry["canvas_from_frame"])[2, :2]).max() for entry in entries]
    assert max(turned) > 0  # homographies, not similarities
    for entry in entries:
        x, y = np.meshgrid(entry["warp"]["x"], entry["warp"]["y"])
        pixels = np.dstack([x, y]).reshape(1, -1, 2)
        there = cv2.perspectiveTransform(pixels, np.array(entry["canvas_from_frame"]))[0]
        assert np.allclose(there, np.array(entry["warp"]["canvas"]).reshape(-1, 2), atol=1e-3)


def test_the_ledger_gives_homographies_back_bit_by_bit(out: Path) -> None:
    with Ledger(out / LEDGER_NAME, read_only=True) as ledger:
        kept = {estimate.name: estimate.homography or () for estimate in ledger.estimates()}
    told = document_at(out / "placements.json")["frames"]
    assert {name: [list(row) for row in rows] for name, rows in kept.items()} == {
        frame["name"]: frame["canvas_from_frame"] for frame in told
    }


def test_the_map_is_exported_as_a_picture(out: Path, tmp_path: Path) -> None:
    assert cli.main(["export", str(out), "--format", "png", "--to", str(tmp_path / "p.png")]) == 0
    picture = cv2.imread(str(tmp_path / "p.png"), cv2.IMREAD_UNCHANGED)
    assert picture is not None
    assert (picture[..., 3] > 0).sum() > 320 * 240


def test_it_is_not_painted_again_with_all_bands(out: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["export", str(out), "--format", "tiff", "--to", str(tmp_path / "map.tif")]) == 2
    assert "is a map of --method paper" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.thorough
@pytest.mark.long
@pytest.mark.parametrize("method", ["paper", "adjusted"])
@pytest.mark.parametrize("kind", ["orb", "surf"])
def test_other_features_stitch_too(frames: Path, tmp_path: Path, method: str, kind: FeatureKind) -> None:
    if not is_available(kind):
        pytest.skip("mahotas is not installed")
    words = ["--out", str(tmp_path / "out"), "--method", method, "--features", kind]
    assert cli.main(["stitch", *map(str, sorted(frames.rglob("*.JPG"))[:4]), *words]) == 0
    assert json.loads((tmp_path / "out" / "mosaic.json").read_text())["frames"]["placed"] == 4


@pytest.mark.parametrize("method", [[], ["--method", "paper"]])
def test_surf_without_mahotas_is_told_in_one_sentence(
    frames: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, method: list[str]
) -> None:
    monkeypatch.setattr(sys, "path", [])
    monkeypatch.delitem(sys.modules, "mahotas", raising=False)
    out = tmp_path / "out"
    assert cli.main(["stitch", str(frames), "--out", str(out), "--features", "surf", *method]) == 2
    said = capsys.readouterr().err
    assert said == (
        "gcs-mosaic: SURF features need the package mahotas: pip install 'gcs-mosaic[surf]', or use sift or orb\n"
    )
    assert not out.exists()


@pytest.mark.thorough
@pytest.mark.long
def test_a_folder_that_has_grown_is_stitched_again(frames: Path, tmp_path: Path) -> None:
    """Nothing of the one picture is kept to go on with."""
    words = ["--out", str(tmp_path / "out"), "--method", "paper", "--scale", "0.5"]
    pictures = [str(path) for path in sorted(frames.rglob("*.JPG"))]
    assert cli.main(["stitch", *pictures[:2], *words]) == 0
    assert cli.main(["stitch", *pictures[:4], *words, "--resume"]) == 0
    assert json.loads((tmp_path / "out" / "mosaic.json").read_text())["frames"]["placed"] == 4


@pytest.mark.thorough
@pytest.mark.long
def test_flights_are_merged_so_too(out: Path, frames: Path, tmp_path: Path) -> None:
    other, settings = tmp_path / "other", tmp_path / "settings.yaml"
    settings.write_text("method: paper\nscale: 0.5\n")
    last = [str(path) for path in sorted(frames.rglob("*.JPG"))[4:]]
    assert cli.main(["stitch", *last, "--out", str(other), "--config", str(settings)]) == 0
    words = ["--out", str(tmp_path / "map"), "--config", str(settings)]
    assert cli.main(["merge", str(out), str(other), *words]) == 0
    assert json.loads((tmp_path / "map" / "mosaic.json").read_text())["frames"]["placed"] == 8


def test_debug_pictures_are_of_the_default_method(
    frames: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--out", str(tmp_path / "out"), "--method", "paper", "--debug", str(tmp_path / "debug")]
    assert cli.main(["stitch", str(frames), *words]) == 2
    assert "leave it out with --method paper" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_flight_of_an_earlier_version_is_still_exported(out: Path, tmp_path: Path) -> None:
    """Ledgers of version 1 know no homographies; the first step of their migration makes room for them."""
    earlier = tmp_path / "earlier"
    shutil.copytree(out, earlier)
    with closing(sqlite3.connect(earlier / LEDGER_NAME)) as old:
        old.executescript("ALTER TABLE estimates DROP homography; PRAGMA user_version = 1")
    assert cli.main(["export", str(earlier), "--format", "placements", "--to", str(tmp_path / "p.json")]) == 0
    assert len(json.loads((tmp_path / "p.json").read_text())["frames"]) == 6
    with closing(
        sqlite3.connect(earlier / LEDGER_NAME)
    ) as old:  # the other steps change what was not changed back here
        old.executescript(f"{MIGRATIONS[1]} PRAGMA user_version = {VERSION}")
    with Ledger(earlier / LEDGER_NAME) as ledger:
        assert [estimate.homography for estimate in ledger.estimates()] == [None] * 6
        ledger.record_estimates(ledger.estimates())


def test_the_blend_is_the_papers_own(frames: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--out", str(tmp_path / "out"), "--method", "paper", "--blend", "newest"]
    assert cli.main(["stitch", str(frames), *words]) == 2
    assert "leave out --blend" in capsys.readouterr().err


@pytest.mark.long
def test_a_live_flight_is_stitched_so_too(tmp_path: Path, world_cache: Path) -> None:
    with flying(tmp_path, "--method", "paper") as flight:
        for k, picture in enumerate(six_pictures(world_cache)[:3]):
            flight.take(f"IMG_{k}.JPG", picture)
        flight.wait_for_frames(placed=3)
        assert flight.end() == 0
    entries = flight.document("placements.json")["frames"]
    assert [entry["hops"] for entry in entries] == [0, 1, 2]
    assert flight.document("mosaic.json")["events"]["matched"] == 3
