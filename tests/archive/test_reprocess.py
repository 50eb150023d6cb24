"""An archive becomes the same map, byte for byte, however many workers there are and whatever becomes of them."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import dask
import numpy as np
import pytest
from rich.console import Console

from gcs_mosaic.check import table
from gcs_mosaic.store.records import FrameState
from tests.archive import saboteur
from tests.archive.archives import FRAMES, flight_in, run, tiles_of
from tests.rebuilt import assert_explained
from tests.running import frames_of

pytestmark = [pytest.mark.long, pytest.mark.filterwarnings("default")]

STAGES = (
    *("arrivals", "features", "kind", "vocabulary", "inverted", "alike", "pair_group", "islands", "adjustment"),
    *("relief", "overlaps_of", "looks", "footprints", "super_tile"),
)


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory, world_cache: Path) -> Path:
    return flight_in(tmp_path_factory.mktemp("frames"), world_cache)


@pytest.fixture(scope="module")
def alone(frames: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The map that one worker makes."""
    out = tmp_path_factory.mktemp("alone") / "map"
    run(frames, out=out, workers=1)
    return out


@pytest.fixture
def sabotage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that tells workers what to suffer."""
    folder = tmp_path / "sabotage"
    folder.mkdir()
    monkeypatch.setenv("SABOTAGE", str(folder))
    return folder


def copied(alone: Path, folder: Path) -> Path:
    """The map, with all that its making has left."""
    return Path(shutil.copytree(alone, folder / "map", copy_function=shutil.copy))


def sabotaged(*sources: Path, out: Path) -> None:
    with dask.config.set({"distributed.worker.preload": [saboteur.__name__]}):
        run(*sources, out=out)


def test_the_map_is_whole_and_what_its_ledger_and_originals_say(alone: Path, tmp_path: Path) -> None:
    assert table.run(alone, Console(quiet=True), mend=False, every_tile=True, sources=[], as_json=False) == 0
    assert_explained(alone, tmp_path / "again", fewest=10)
    assert {frame.state for frame in frames_of(alone).values()} == {FrameState.PLACED}


def test_two_workers_of_which_one_dies_in_each_stage_make_the_same_map(
    frames: Path, alone: Path, sabotage: Path, tmp_path: Path
) -> None:
    (sabotage / "stages").touch()
    sabotaged(frames, out=tmp_path / "map")
    assert {path.name for path in sabotage.iterdir()} == {"stages", *STAGES}
    assert tiles_of(tmp_path / "map") == tiles_of(alone)


def test_half_of_all_artefacts_are_made_again(frames: Path, alone: Path, tmp_path: Path) -> None:
    out = copied(alone, tmp_path)
    for stage in (out / "archive").iterdir():
        there = sorted(path for path in stage.rglob("*") if path.is_file())
        for number, path in enumerate(there):
            if number % 4 == 0:
                path.unlink()
            elif number % 4 == 1:
                path.write_bytes(path.read_bytes()[:-1])
    heard = run(frames, out=out)
    assert tiles_of(out) == tiles_of(alone)
    again = {cost.stage: cost.tasks - cost.there for cost in heard.costs}
    assert 0 < again["features"] < FRAMES


def test_a_frame_that_kills_workers_is_rejected_with_that_reason(
    frames: Path, alone: Path, sabotage: Path, tmp_path: Path
) -> None:
    out, more = copied(alone, tmp_path), tmp_path / "more"
    more.mkdir()
    encoded = cv2.imencode(".png", np.zeros((300, 400, 3), np.uint8))[1]
    (more / "poison.png").write_bytes(encoded.tobytes())
    (sabotage / "poison").write_text("poison.png")
    sabotaged(frames, more, out=out)
    states = {name: (frame.state, frame.reason) for name, frame in frames_of(out).items()}
    assert states.pop("poison.png") == (FrameState.REJECTED, "its task has killed one worker after the other")
    assert set(states.values()) == {(FrameState.PLACED, None)}
    assert tiles_of(out) == tiles_of(alone)
