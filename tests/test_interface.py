"""The Python interface: a flight without the program, what can be read of it, and an example that embeds it."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import cv2
import numpy as np
import pytest

import gcs_mosaic
from gcs_mosaic.errors import UsageError
from gcs_mosaic.store.records import FrameState
from sitl.messages import Capture
from sitl.vehicle import Vehicle
from tests import running
from tests.ports import free_port
from tests.sure import sure

WITHOUT_A_GUARD = """
import sys
import gcs_mosaic
print("begun", flush=True)
with gcs_mosaic.open_flight(sys.argv[1]) as flight:
    print(flight.add(sys.argv[2]).state.name)
"""
EXAMPLE = Path(__file__).parent / "examples" / "ground_station.py"


def array_of(data: bytes) -> np.ndarray:
    return np.asarray(sure(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)))


def test_paths_bytes_and_arrays_become_one_map(pictures: list[bytes], tmp_path: Path) -> None:
    file = tmp_path / "one.jpg"
    file.write_bytes(pictures[0])
    with gcs_mosaic.open_flight(tmp_path / "map") as flight:
        done = [flight.add(file), flight.add(pictures[1], "two.jpg"), flight.add(array_of(pictures[2]))]
        assert [one.name for one in done] == ["one.jpg", "two.jpg", "frame-00003.png"]
        assert {one.state for one in done} == {FrameState.PLACED}
        placed = flight.placements()
        assert [one.name for one in placed] == [one.name for one in done], "at once, not some seconds later"
        assert flight.add(file).state is FrameState.DUPLICATE
        assert flight.add(b"no picture", "two.jpg").state is FrameState.DAMAGED
    middle = np.nanmean(placed[1].outline, axis=0)
    seen = flight.sightings(placed[1].island, *middle)
    assert "two.jpg" in {one.name for one in seen}
    one = next(one for one in seen if one.name == "two.jpg")
    assert (one.x, one.y) == pytest.approx((319.5, 239.5), abs=10), "its own middle"
    assert all(flight.tile(*tile) is not None for tile in flight.tiles())
    assert flight.tile(placed[0].island, 16, 0, 0) is None
    assert [frame.name for frame in flight.frames()][-2:] == ["one.jpg#2", "two.jpg#2"]
    assert running.run("check", tmp_path / "map", cwd=tmp_path).returncode == 0, "a flight as every other one"


@pytest.mark.long
def test_it_is_gone_on_with(pictures: list[bytes], tmp_path: Path) -> None:
    with gcs_mosaic.open_flight(tmp_path / "map") as flight:
        flight.add(pictures[0], "a.jpg")
    with gcs_mosaic.open_flight(tmp_path / "map", resume="always") as flight:
        flight.use_pause(0.1)
        assert flight.add(pictures[0], "again.jpg").state is FrameState.DUPLICATE
        assert flight.add(pictures[1], "a.jpg").name == "a.jpg#2"
        assert [one.name for one in flight.placements()] == ["a.jpg", "a.jpg#2"]
    with gcs_mosaic.open_flight(tmp_path / "map") as flight:
        assert flight.folder.name == "map-2"
        assert flight.frames() == [], "beside the earlier one"


@pytest.mark.long
def test_what_raises_leaves_the_flight_as_it_is(pictures: list[bytes], tmp_path: Path) -> None:
    settings = {"stitch": {"cover": {"enabled": False}}}

    def breaks() -> None:
        with gcs_mosaic.open_flight(tmp_path / "map", settings) as flight:
            flight.add(pictures[0], "a.jpg")
            flight.add(np.zeros((4, 4), np.float64))

    with pytest.raises(ValueError, match="expected a picture"):
        breaks()
    assert [one.name for one in gcs_mosaic.read_flight(tmp_path / "map").placements()] == ["a.jpg"]
    with gcs_mosaic.open_flight(tmp_path / "map", settings, resume="always") as flight:
        with pytest.raises(FileNotFoundError):
            flight.add("nowhere.jpg")
        assert flight.add(pictures[1], "b.jpg").state is FrameState.PLACED
    with pytest.raises(UsageError, match="flown with other settings"):
        gcs_mosaic.open_flight(tmp_path / "map", resume="always")


def test_what_cannot_be_is_said(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"settings: 'scal' is not a setting"):
        gcs_mosaic.open_flight(tmp_path / "map", {"scal": 1})
    assert not (tmp_path / "map").exists()
    with pytest.raises(UsageError):
        gcs_mosaic.read_flight(tmp_path)


def test_no_settings_but_those_given_count(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GCS_MOSAIC_OUT", str(tmp_path / "elsewhere"))
    with gcs_mosaic.open_flight(tmp_path / "map") as flight:
        assert flight.folder == tmp_path / "map"


@pytest.mark.long
def test_a_main_module_is_run_once(pictures: list[bytes], tmp_path: Path) -> None:
    """Whatever stands in it, without a guard: the processes that decode do not import it."""
    (tmp_path / "one.jpg").write_bytes(pictures[0])
    (tmp_path / "plain.py").write_text(WITHOUT_A_GUARD)
    command = [sys.executable, "plain.py", str(tmp_path / "map"), str(tmp_path / "one.jpg")]
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])}
    told = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
    assert told.stdout.split() == ["begun", "PLACED"]


@pytest.mark.long
def test_a_small_ground_station_has_a_map(pictures: list[bytes], tmp_path: Path) -> None:
    port, camera = free_port(), tmp_path / "camera"
    camera.mkdir()
    command = [sys.executable, str(EXAMPLE), f"udpin:127.0.0.1:{port}", str(camera), str(tmp_path / "map")]
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[1]), "MAVLINK20": "1"}
    with (
        closing(Vehicle("127.0.0.1", port, ["camera"])) as vehicle,
        subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as station,
    ):
        try:
            assert station.stdout is not None
            running.until(lambda: sure(station.stdout).readline() == "listening\n", "listening")
            for number, data in enumerate(pictures[:3]):
                name = f"IMG_{number:04}.jpg"
                vehicle.tick(None)
                vehicle.capture(Capture(index=number, name=name, state=None))
                (tmp_path / name).write_bytes(data)
                (tmp_path / name).rename(camera / name)
            told = station.communicate(timeout=3 * running.LONGEST_WAIT_S)[0]
        finally:
            station.kill()
    assert station.returncode == 0
    assert "3 frames on the map" in told
    assert "3 events have their frames" in told
    assert "the middle was seen best by IMG_000" in told
