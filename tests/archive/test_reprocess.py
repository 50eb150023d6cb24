"""An archive becomes the same map, byte for byte, however many workers there are and whatever becomes of them."""

from __future__ import annotations

import io
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import dask
import numpy as np
import pytest
import tifffile
from rich.console import Console

from gcs_mosaic.archive.files import BucketFiles
from gcs_mosaic.archive.progress import StageCost
from gcs_mosaic.check import table
from gcs_mosaic.errors import FlightFailed
from gcs_mosaic.export.multiband_tiff import export_tiff
from gcs_mosaic.store.records import FrameState
from tests.archive import saboteur
from tests.archive.archives import FRAMES, Heard, bucket_server, flight_in, run, tiles_of
from tests.documents import document_at
from tests.ports import free_port
from tests.rebuilt import assert_explained
from tests.running import PROGRAM, frames_of

pytestmark = [pytest.mark.long, pytest.mark.filterwarnings("default")]

STAGES = (
    "ground_sum",
    "still_mask",
    *("arrivals", "features", "display", "dead_border", "vocabulary", "inverted", "alike", "pair_group", "stretch"),
    *("joined", "islands", "adjustment", "relief", "torn_apart", "blend_maps_of", "overlaps_of", "looks", "footprints"),
    "super_tile",
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


def test_its_quality_is_measured_as_that_of_a_flight(frames: Path, alone: Path, tmp_path: Path) -> None:
    subprocess.run([*PROGRAM, "stitch", frames, "--out", tmp_path / "flight"], check=True, capture_output=True)
    of_flight, of_archive = (
        document_at(out / "mosaic.json")["islands"][0]["held_out_px"] for out in (tmp_path / "flight", alone)
    )
    assert of_archive["matches"] == pytest.approx(of_flight["matches"], rel=0.3)
    assert of_archive["median"] == pytest.approx(of_flight["median"], rel=0.2)
    assert of_archive["p95"] == pytest.approx(of_flight["p95"], rel=0.2)


@pytest.mark.thorough
def test_two_workers_of_which_one_dies_in_each_stage_make_the_same_map(
    frames: Path, alone: Path, sabotage: Path, tmp_path: Path
) -> None:
    (sabotage / "stages").touch()
    sabotaged(frames, out=tmp_path / "map")
    assert {path.name for path in sabotage.iterdir()} == {"stages", *STAGES}
    assert tiles_of(tmp_path / "map") == tiles_of(alone)


@pytest.mark.thorough
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


@pytest.mark.thorough
def test_what_is_damaged_on_the_disk_is_made_again(frames: Path, alone: Path, tmp_path: Path) -> None:
    out = copied(alone, tmp_path)
    for path in (out / "archive").rglob("*"):
        if path.is_file() and path.stat().st_size:
            data = bytearray(path.read_bytes())
            data[-1] ^= 1  # of its last part: the summary before it seems to be whole
            path.write_bytes(data)
    run(frames, out=out)
    assert tiles_of(out) == tiles_of(alone)


@pytest.mark.thorough
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


class Ending(Heard):
    """Ends a process when a stage begins."""

    def __init__(self, stage: str, victim: subprocess.Popen[bytes]) -> None:
        super().__init__()
        self._stage, self._victim = stage, victim

    def begin(self, cost: StageCost) -> None:
        super().begin(cost)
        if cost.stage == self._stage:
            self._victim.kill()
            self._victim.wait()


def dask_program(*words: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "dask", *words]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


@contextmanager
def cluster(port: int) -> Iterator[subprocess.Popen[bytes]]:
    """A scheduler with one worker, as an operator starts them; yields the scheduler."""
    address = f"tcp://127.0.0.1:{port}"
    scheduler = dask_program("scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard")
    worker = dask_program("worker", address, "--nthreads", "1", "--no-dashboard")
    try:
        yield scheduler
    finally:
        for process in (worker, scheduler):
            process.terminate()
            process.wait(20)


@pytest.mark.thorough
def test_after_the_scheduler_was_killed_the_command_goes_on(
    frames: Path, alone: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gcs_mosaic.archive.cluster.CONNECT_S", 5.0)  # for so long a scheduler is sought, too
    out, port = copied(alone, tmp_path), free_port()
    (out / "mosaic.json").unlink()
    for stage in ("pair_group", *STAGES[STAGES.index("islands") :]):
        shutil.rmtree(out / "archive" / stage)
    address = f"tcp://127.0.0.1:{port}"
    with cluster(port) as scheduler, pytest.raises(FlightFailed, match="the scheduler is gone"):
        run(frames, out=out, cluster=address, heard=Ending("pairs", scheduler))
    assert not (out / "mosaic.json").exists()
    with cluster(port):
        heard = run(frames, out=out, cluster=address)
    assert {cost.stage: cost.there for cost in heard.costs}["features"] == FRAMES
    assert tiles_of(out) == tiles_of(alone)


@pytest.mark.thorough
def test_four_bands_of_sixteen_bits_in_a_bucket_become_a_map_in_a_bucket(
    frames: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with bucket_server(monkeypatch, "frames", "maps"):
        given, made = BucketFiles("s3://frames"), BucketFiles("s3://maps/one")
        for path in sorted(frames.iterdir())[:5]:
            given.write(f"{path.stem}.tif", with_four_bands(path.read_bytes()))
        run("s3://frames", out="s3://maps/one")
        for name in [one.name for one in made.listed("")]:
            if not name.startswith("archive/"):
                (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
                (tmp_path / name).write_bytes(made.read(name) or b"")
    assert table.run(tmp_path, Console(quiet=True), mend=False, every_tile=True, sources=[], as_json=False) == 0
    assert {frame.state for frame in frames_of(tmp_path).values()} == {FrameState.PLACED}
    export_tiff(tmp_path, tmp_path / "bands.tif")
    bands = tifffile.imread(tmp_path / "bands.tif")
    assert (bands.dtype, min(bands.shape)) == (np.dtype(np.uint16), 4 + 1)  # and where there is something
    assert bands.max() > 255


def with_four_bands(jpeg: bytes) -> bytes:
    """A picture as a camera with four bands of twelve bits has it."""
    colour = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert colour is not None
    bands = np.dstack([colour, cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY)]).astype(np.uint16) * 16
    file = io.BytesIO()
    tifffile.imwrite(file, bands, photometric="minisblack", planarconfig="contig")
    return file.getvalue()
