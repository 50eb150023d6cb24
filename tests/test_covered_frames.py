"""A hover in the middle of a flight, through the whole program: kept, accounted and told of, but not painted."""

import json
from dataclasses import asdict, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from rich.console import Console

import sitl.flight
from gcs_mosaic.app.commands.batch import stitch
from gcs_mosaic.export.export import export_placements
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.records import FrameState
from sitl.path import Plan
from tests.documents import document_at
from tests.settings import FEW_FEATURES, load_config
from tests.sure import sure

pytestmark = pytest.mark.long


QUIET = Console(quiet=True)
HOVER = [(10, 10), (12, 9), (7, 11), (11, 14)]  # px: where the camera's frame is cut from a larger one
STILL = 3  # the frame of the flight over which the aircraft hovers


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory, world_cache: Path) -> Path:
    """Six frames, one of them taken four times with a pixel or two and fresh noise between them."""
    larger, folder = tmp_path_factory.mktemp("larger"), tmp_path_factory.mktemp("frames")
    sitl.flight.make("survey", larger, (660, 500), cache=world_cache, route=Plan(frames=6))
    rng = np.random.default_rng(1)
    for number, path in enumerate(sorted(larger.rglob("*.JPG"))):
        picture = sure(cv2.imread(str(path))).astype(np.float32)
        for again, (x, y) in enumerate(HOVER if number == STILL else HOVER[:1]):
            seen = picture[y : y + 480, x : x + 640] + rng.normal(0, 2, (480, 640, 3))
            cv2.imwrite(str(folder / f"{number}{again}.png"), np.clip(seen, 0, 255).astype(np.uint8))
    return folder


@pytest.fixture(scope="module")
def stitched(frames: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return stitch([frames], tmp_path_factory.mktemp("out") / "flight", FEW_FEATURES, QUIET)


@pytest.mark.thorough
def test_the_accounts_close_and_the_originals_are_kept(stitched: Path) -> None:
    with Ledger(stitched / LEDGER_NAME, read_only=True) as ledger:
        account = ledger.accounts().frames
        covered = ledger.frames(FrameState.COVERED)
        painted = {one.name for one in ledger.painted(0)}
    assert (account.placed, account.covered, sum(asdict(account).values())) == (6, 3, 9)
    assert document_at(stitched / "mosaic.json")["frames"]["covered"] == 3
    assert [frame.name for frame in covered] == ["31.png", "32.png", "33.png"]
    assert all((stitched / sure(frame.original)).stat().st_size == frame.size for frame in covered)
    assert painted == {f"{number}0.png" for number in range(6)}


def test_covered_frames_are_listed_where_they_lie(stitched: Path) -> None:
    document = document_at(stitched / "placements.json")
    keyframe = next(frame for frame in document["frames"] if frame["name"] == "30.png")
    assert len(document["frames"]) == 6
    assert [entry["name"] for entry in document["covered"]] == ["31.png", "32.png", "33.png"]
    for entry, (x, y) in zip(document["covered"], HOVER[1:], strict=True):
        assert (entry["covered_by"], entry["island"]) == ("30.png", keyframe["island"])
        in_key = np.linalg.inv(keyframe["canvas_from_frame"]) @ entry["canvas_from_frame"] @ [320, 240, 1]
        assert np.allclose(in_key[:2] / in_key[2], [320 + x - HOVER[0][0], 240 + y - HOVER[0][1]], atol=0.3)
    assert document["newest"] == "50.png"
    assert not (stitched / "placements.jsonl").exists(), "nothing is left to be told"


def test_an_export_lists_them_too(stitched: Path, tmp_path: Path) -> None:
    export_placements(stitched, tmp_path / "placements.json")
    document = json.loads((tmp_path / "placements.json").read_bytes())
    assert (len(document["frames"]), len(document["covered"])) == (6, 3)


def test_the_map_is_that_of_the_flight_without_the_hover(stitched: Path, frames: Path, tmp_path: Path) -> None:
    """Nothing of the map knows of the covered frames, to the bit."""
    once = [frames / f"{number}0.png" for number in range(6)]
    without = stitch(once, tmp_path / "without", FEW_FEATURES, QUIET)
    poses = []
    for flight in (stitched, without):
        with Ledger(flight / LEDGER_NAME, read_only=True) as ledger:
            poses.append([(one.name, one.pose) for one in ledger.estimates()])
    tiles = [{p.relative_to(f): p.read_bytes() for p in f.rglob("tiles/**/*.jpg")} for f in (stitched, without)]
    assert poses[0] == poses[1]
    assert tiles[0] == tiles[1]


@pytest.mark.thorough
def test_the_configuration_switches_covering_off(frames: Path, tmp_path: Path) -> None:
    (tmp_path / "off.yaml").write_text("stitch: {cover: {enabled: false}}")
    config = replace(load_config(tmp_path / "off.yaml"), scale=0.5)
    out = stitch([frames], tmp_path / "flight", config, QUIET)
    with Ledger(out / LEDGER_NAME, read_only=True) as ledger:
        account = ledger.accounts().frames
    assert (account.placed, account.covered) == (9, 0)
