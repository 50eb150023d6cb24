"""A flight that was cut off goes on as if nothing had been."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import sitl.flight
from gcs_mosaic.app.driver import Driver
from gcs_mosaic.app.pipeline import Pipeline
from gcs_mosaic.app.prefetch import prepare
from gcs_mosaic.app.resuming import checkpoints_of, files_taken, saved_flight
from gcs_mosaic.config.tree import Config
from gcs_mosaic.frames.directory import Taken
from gcs_mosaic.frames.files import frames_in
from gcs_mosaic.messages import Frame
from gcs_mosaic.store.checkpoint import NAME, Unusable
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from sitl.path import Plan
from tests.running import Running, events_of, flying, frames_of, run, six_pictures
from tests.sure import sure

CONFIG = Config()
MORE_CUTS = [(1, 0), (8, 5), (11, 0)]
CUTS = [(3, 2), (6, 0), *(pytest.param(*cut, marks=pytest.mark.long) for cut in MORE_CUTS)]


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory, world_cache: Path) -> list[Frame]:
    """Of two flight lines, with one that shows nothing and a stranger among them."""
    folder = tmp_path_factory.mktemp("frames")
    sitl.flight.make("survey", folder, (480, 360), cache=world_cache, route=Plan(frames=9, strangers=1))
    cv2.imwrite(str(next(folder.rglob("*0004.JPG")).with_name("IMG_0004_black.png")), np.zeros((360, 480, 3), np.uint8))
    return [frame for frame in frames_in(folder).frames if isinstance(frame, Frame)]


def pipeline(out: Path) -> Pipeline:
    out.mkdir(exist_ok=True)
    return Pipeline(out, CONFIG, lambda notice: None, punctual=True, checkpoints=checkpoints_of(out, CONFIG))


def saved_in(out: Path, config: Config) -> dict[str, Any] | Unusable:
    with closing(sure(checkpoints_of(out, config))) as checkpoints:
        return saved_flight(checkpoints, config)


def process(flight: Pipeline, frames: Sequence[Frame]) -> None:
    for frame in frames:
        Driver(flight).process(prepare(frame, flight.features_of, CONFIG.reduction, flight.feature_pixels))


def accepted(flight: Pipeline, frames: Sequence[Frame]) -> list[Frame]:
    return [sure(flight.accept(frame)) for frame in frames]


def finished(flight: Pipeline) -> Pipeline:
    for _ in Driver(flight).finish():
        pass
    return flight


def map_of(out: Path) -> dict[str, Any]:
    """All that a flight leaves for readers, but for when and how often it was written."""
    told = {name: json.loads((out / name).read_bytes()) for name in ("mosaic.json", "placements.json")}
    for document in told.values():
        for word in ("updated", "revision", "flight"):
            document.pop(word, None)
    told["placements.json"]["frames"].sort(key=lambda frame: frame["name"])
    told["placements.json"]["rejected"].sort(key=lambda frame: frame["name"])
    files = {p.relative_to(out): p.read_bytes() for folder in ("tiles", "masks") for p in out.glob(f"{folder}/**/*.*")}
    return {"documents": told, "files": files}


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory, frames: list[Frame]) -> dict[str, Any]:
    out = tmp_path_factory.mktemp("undisturbed") / "map"
    with closing(pipeline(out)) as flight:
        process(flight, accepted(flight, frames))
        finished(flight)
    return map_of(out)


@pytest.mark.parametrize(("cut", "lost"), CUTS)
def test_a_resumed_flight_gives_the_map_of_an_undisturbed_one(
    tmp_path: Path, frames: list[Frame], undisturbed: dict[str, Any], cut: int, lost: int
) -> None:
    """Cut off after `cut` frames, of which the last `lost` came after the last checkpoint; one more waits."""
    out = tmp_path / "map"
    with closing(pipeline(out)) as flight:
        came = accepted(flight, frames[: cut + 1])
        process(flight, came[: cut - lost])
        flight.checkpoint(at_once=True)
        process(flight, came[cut - lost : cut])
    saved = saved_in(out, CONFIG)
    assert not isinstance(saved, Unusable)
    with closing(pipeline(out)) as flight:
        again = flight.resume(saved["pipeline"])
        flight.save()
        assert [frame.name for frame in again] == [frame.name for frame in came[cut - lost :]]
        process(flight, again)
        process(flight, accepted(flight, frames[cut + 1 :]))
        finished(flight)
    assert map_of(out) == undisturbed


def test_other_settings_are_a_reason(tmp_path: Path, frames: list[Frame]) -> None:
    with closing(pipeline(tmp_path / "map")) as flight:
        process(flight, accepted(flight, frames[:1]))
        flight.checkpoint(at_once=True)
    half = replace(CONFIG, scale=0.5)
    found = saved_in(tmp_path / "map", half)
    assert isinstance(found, Unusable)
    assert "other settings" in found.reason


def test_the_newest_version_of_a_file_is_known(tmp_path: Path, frames: list[Frame]) -> None:
    with Ledger(tmp_path / LEDGER_NAME) as ledger:
        for name, size in (("a.jpg", 1), ("a.jpg#2", 2), ("b#2.jpg", 3), ("a.jpg#10", 4)):
            ledger.record_frame(replace(frames[0], name=name, size=size, modified=5.0))
        assert files_taken(ledger.frames()) == {"a.jpg": Taken(10, 4, 5.0), "b#2.jpg": Taken(1, 3, 5.0)}


def test_a_killed_flight_goes_on_with_what_came_meanwhile(tmp_path: Path, world_cache: Path) -> None:
    pictures = six_pictures(world_cache)
    with flying(tmp_path) as flight:
        for k in range(3):
            flight.take(f"IMG_{k}.JPG", pictures[k])
        flight.wait_for_frames(placed=3)
        flight.wait_for(lambda status: (flight.out / NAME).exists(), "there is a checkpoint")
        flight.process.kill()
        flight.process.wait()
    flight.bring("IMG_3.JPG", pictures[3])
    with flying(tmp_path, "--resume") as again:
        assert "going on with the flight in mosaic" in again.said
        again.wait_for_frames(placed=4)
        again.taken = flight.taken + 1
        again.take("IMG_4.JPG", pictures[4])
        again.wait_for_frames(placed=5)
        assert again.end() == 0
    assert_one_flight(again)


def assert_one_flight(flight: Running) -> None:
    assert [frame.state for frame in frames_of(flight.out).values()] == ["placed"] * 5
    assert events_of(flight.out) == ["matched"] * 4
    assert not flight.out.with_name("mosaic-2").exists()
    assert flight.document("mosaic.json")["frames"]["placed"] == 5


def test_what_cannot_be_resumed_is_refused_in_one_sentence_and_left_as_it_is(tmp_path: Path, world_cache: Path) -> None:
    pictures = six_pictures(world_cache)
    with flying(tmp_path) as flight:
        flight.take("IMG_0.JPG", pictures[0])
        flight.wait_for_frames(placed=1)
        assert flight.end() == 0
    (flight.out / NAME).write_bytes(b"nonsense")
    ledger = (flight.out / LEDGER_NAME).read_bytes()
    done = run("--mavlink", "udp:127.0.0.1:19999", "--no-http", "--resume", cwd=tmp_path)
    assert done.returncode == 2
    assert "cannot be gone on with: its checkpoint is none of ours" in done.stderr
    assert (flight.out / LEDGER_NAME).read_bytes() == ledger
