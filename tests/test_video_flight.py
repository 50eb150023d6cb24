"""A recorded video as an operator gives it: `gcs-mosaic stitch FLIGHT.MP4`, and in a watched folder."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

from gcs_mosaic.frames.files import looks_in
from gcs_mosaic.frames.rtsp.settings import StreamSettings
from gcs_mosaic.frames.video.names import video_and_ms
from gcs_mosaic.frames.video.reading import VideoReading
from gcs_mosaic.messages import Frame, Notice
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.records import FrameState
from tests.documents import document_at
from tests.frames.video.films import (
    HEIGHT,
    MOST_PIXELS,
    WIDTH,
    flight,
    reading,
    sound,
    survey_place,
    write_film,
    write_survey,
)
from tests.rebuilt import assert_explained
from tests.running import PROGRAM, flying, run, until
from tests.tiers import thorough

MB = 1 << 20


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_survey(tmp_path_factory.mktemp("survey") / "FLIGHT.MP4")


def states(out: Path) -> dict[str, str]:
    with closing(Ledger(out / "flight.sqlite", read_only=True)) as ledger:
        return {frame.name: str(frame.state) for frame in ledger.frames()}


def placements(out: Path) -> list[dict[str, Any]]:
    return list(document_at(out / "placements.json")["frames"])


@pytest.mark.thorough
@pytest.mark.long
def test_a_video_becomes_a_map(tmp_path: Path) -> None:
    write_film(tmp_path / "FLIGHT.MP4", flight(3.0))
    done = run("stitch", "FLIGHT.MP4", "--out", "map", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "4 frames are taken of it" in done.stdout
    found = states(tmp_path / "map")
    assert set(found.values()) == {FrameState.PLACED}
    assert all((tmp_path / "map" / "frames" / name).is_file() for name in found)


@pytest.mark.long
@pytest.mark.parametrize("is_folder", [thorough(True), False])
def test_what_is_no_video_is_said_before_anything_is_written(tmp_path: Path, is_folder: bool) -> None:
    (tmp_path / "card").mkdir()
    sound(tmp_path / "card" / "FLIGHT.MP4")
    done = run("stitch", "card" if is_folder else "card/FLIGHT.MP4", "--out", "map", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "sound only" in done.stderr
    assert not (tmp_path / "map").exists()


@pytest.mark.long
@pytest.mark.parametrize("command", ["reprocess", thorough("benchmark")])
def test_other_commands_say_who_takes_videos(tmp_path: Path, command: str) -> None:
    (tmp_path / "FLIGHT.MP4").write_bytes(b"any")
    done = run(command, "FLIGHT.MP4", *(["--out", "map"] if command == "reprocess" else []), cwd=tmp_path)
    assert done.returncode == 2
    assert "gcs-mosaic stitch takes those" in done.stderr


@pytest.mark.long
def test_a_flight_of_a_video_is_right_whole_and_laid_by_its_subtitles(film: Path, tmp_path: Path) -> None:
    """The map agrees with the flown path, every tile is explained by originals and ledger, DJI's positions lay it on earth, and
    what other commands do with flights they do with it."""
    done = run("stitch", film, "--out", "map", "--anchor", "positions", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    out = tmp_path / "map"
    assert set(states(out).values()) == {FrameState.PLACED}
    assert len(states(out)) >= 12
    _agrees_with_the_path(placements(out))
    assert_explained(out, tmp_path / "scratch", fewest=12)
    laid = run("anchor", "map", cwd=tmp_path)
    assert "positions" in laid.stdout, laid.stdout + laid.stderr
    exported = run("export", "map", "--format", "geojson", "--to", "map.geojson", cwd=tmp_path)
    assert exported.returncode == 0, exported.stderr
    places = np.array(_coordinates(json.loads((tmp_path / "map.geojson").read_bytes())))
    assert np.abs(places.mean(axis=0) - (8.2045, 47.0977)).max() < 0.003
    assert run("check", "map", "--tiles", cwd=tmp_path).returncode == 0
    again = run("stitch", "map/frames", "--out", "again", cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    assert states(tmp_path / "again") == states(out)


def _coordinates(found: object) -> list[list[float]]:
    """All pairs of numbers in a document."""
    if isinstance(found, dict):
        return [pair for value in found.values() for pair in _coordinates(value)]
    if isinstance(found, list):
        if len(found) == 2 and all(isinstance(one, float) for one in found):
            return [found]
        return [pair for value in found for pair in _coordinates(value)]
    return []


def _agrees_with_the_path(frames: list[dict[str, Any]]) -> None:
    """Where the middles of the frames lie, but for one similarity."""
    true, found = [], []
    for frame in frames:
        named = video_and_ms(frame["name"])
        assert named is not None
        true.append(complex(*survey_place(named[1] / 1000)))
        x, y, scale = np.array(frame["canvas_from_frame"]) @ (WIDTH / 2, HEIGHT / 2, 1)
        found.append(complex(x / scale, y / scale))
    a, b = np.array(true), np.array(found)
    turn = np.vdot(b - b.mean(), a - a.mean()) / np.vdot(b - b.mean(), b - b.mean())
    assert np.abs(turn * (b - b.mean()) - (a - a.mean())).max() < 25  # px: a frame is up to 0.15 s off its name


@pytest.mark.thorough
@pytest.mark.long
@pytest.mark.parametrize("after", [pytest.param(1, marks=pytest.mark.thorough), 5])
def test_a_stitch_that_is_killed_goes_on_with_no_frame_twice_and_none_lost(
    film: Path, tmp_path: Path, after: int
) -> None:
    assert run("stitch", film, "--out", "whole", cwd=tmp_path).returncode == 0
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])}
    process = subprocess.Popen(
        [*PROGRAM, "stitch", str(film), "--out", "map"], cwd=tmp_path, env=environment, stdout=subprocess.DEVNULL
    )
    with_frames = tmp_path / "map" / "frames" / film.name
    until(lambda: with_frames.is_dir() and len(list(with_frames.iterdir())) > after, "some frames were taken")
    process.send_signal(signal.SIGKILL)
    process.wait()
    before = set(states(tmp_path / "map"))
    assert 0 < len(before) < len(states(tmp_path / "whole"))
    done = run("stitch", film, "--out", "map", "--resume", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert states(tmp_path / "map") == states(tmp_path / "whole")
    assert not (tmp_path / "map-2").exists()
    assert run("check", "map", "--tiles", cwd=tmp_path).returncode == 0


@pytest.mark.thorough
@pytest.mark.long
def test_images_that_were_given_are_gone_on_with_too(film: Path, tmp_path: Path) -> None:
    frames = [item for item in _read(reading(film)) if isinstance(item, Frame)]
    (tmp_path / "some").mkdir()
    for at, frame in enumerate(frames[:6]):
        (tmp_path / "some" / f"{at}.jpg").write_bytes(frame.data or b"")
    assert run("stitch", "some", "--out", "map", cwd=tmp_path).returncode == 0
    for at, frame in enumerate(frames[6:], 6):
        (tmp_path / "some" / f"{at}.jpg").write_bytes(frame.data or b"")
    done = run("stitch", "some", film, "--out", "map", "--resume", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    placed = [name for name, state in states(tmp_path / "map").items() if state == FrameState.PLACED]
    assert sorted(placed) == sorted(
        f"{at}.jpg" for at in range(len(frames))
    )  # those of the video are the same pictures


def _read(one: VideoReading) -> list[object]:
    items: list[object] = []
    while not one.is_over:
        items += one.items(1.0)
    return items


@pytest.mark.thorough
@pytest.mark.long
def test_a_video_in_a_watched_folder_is_mapped_and_gone_on_with(film: Path, tmp_path: Path) -> None:
    """A card is put in with a video and pictures of the same flight; the program is killed while it reads."""
    home = tmp_path / "home"
    with flying(home, "--out", str(tmp_path / "map"), out=None, config="finish_s: 30\n") as live:
        live.out = tmp_path / "map"
        shutil.copy(film, home / "frames" / film.name)
        live.wait_for(lambda status: status["frames"]["placed"] >= 2, "some frames are placed")
        live.process.kill()
    with flying(home, "--resume", "--out", str(tmp_path / "map"), config="finish_s: 30\n") as live:
        live.out = tmp_path / "map"
        until(lambda: "are read" in live.said, "the rest is read")
        live.wait_for(lambda status: not status["frames"]["pending"], "all is mapped")
        assert live.end() == 0
    found = states(tmp_path / "map")
    assert run("stitch", film, "--out", "whole", cwd=tmp_path).returncode == 0
    assert set(found) == set(states(tmp_path / "whole"))
    assert set(found.values()) <= {FrameState.PLACED, FrameState.COVERED}


@pytest.mark.thorough
@pytest.mark.long
def test_the_memory_of_reading_does_not_grow_with_the_video(tmp_path: Path) -> None:
    """Four minutes, of which the first half fills caches."""
    path = write_film(tmp_path / "FLIGHT.MKV", (picture for _ in range(60) for picture in flight(4.0)))
    one = VideoReading(looks_in(path, videos_too=True)[0][0], StreamSettings(), MOST_PIXELS, {})
    sizes: list[tuple[float, int]] = []
    frames, said = 0, list[str]()
    while not one.is_over:
        for item in one.items(0.5):
            frames += isinstance(item, Frame)
            said += [item.text] if isinstance(item, Notice) else []
        children = [child for child in psutil.Process().children() if one._process is not None]
        sizes += [(one.at_s, max(child.memory_info().rss for child in children))] if children else []
    assert frames > 200, said
    early = max(size for at, size in sizes if at < 120)
    late = max(size for at, size in sizes if at > 180)
    assert late - early < 20 * MB
