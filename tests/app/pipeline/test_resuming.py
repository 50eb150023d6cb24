"""A flight that was cut off goes on as if nothing had been."""

from __future__ import annotations

import json
import os
import re
import time
from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from itertools import starmap
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import sitl.flight
from gcs_mosaic.app.pipeline.driver import Driver
from gcs_mosaic.app.pipeline.pipeline import Pipeline
from gcs_mosaic.app.pipeline.resuming import (
    Run,
    boot_id,
    checkpoints_of,
    files_taken,
    open_flight,
    open_stitch,
    saved_flight,
    told_again,
    utc_of_zero,
)
from gcs_mosaic.app.waiting.prefetch import prepare
from gcs_mosaic.config.tree import Config
from gcs_mosaic.errors import UsageError
from gcs_mosaic.frames.directory import Taken
from gcs_mosaic.frames.files import frames_in
from gcs_mosaic.messages import Frame, Notice
from gcs_mosaic.store.checkpoint import NAME, Unusable
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.records import FrameRecord
from sitl.path import Plan
from tests import factories
from tests.documents import document_at
from tests.rebuilt import assert_explained
from tests.running import Running, events_of, flying, frames_of, six_pictures
from tests.settings import FEW_FEATURES
from tests.sure import sure
from tests.tiers import thorough

CONFIG = FEW_FEATURES
MORE_CUTS = [(1, 0), (6, 0), (8, 5), (11, 0)]
CUTS = [(3, 2), *starmap(thorough, MORE_CUTS)]


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory, world_cache: Path) -> list[Frame]:
    """Of two flight lines, with one that shows nothing and a stranger among them."""
    folder = tmp_path_factory.mktemp("frames")
    sitl.flight.make("survey", folder, (480, 360), cache=world_cache, route=Plan(frames=9, strangers=1))
    cv2.imwrite(str(next(folder.rglob("*0004.JPG")).with_name("IMG_0004_black.png")), np.zeros((360, 480, 3), np.uint8))
    return [frame for frame in frames_in(folder).frames if isinstance(frame, Frame)]


def pipeline(out: Path, config: Config = CONFIG) -> Pipeline:
    out.mkdir(exist_ok=True)
    return Pipeline(out, config, lambda notice: None, punctual=True, checkpoints=checkpoints_of(out, config))


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
    told = {name: document_at(out / name) for name in ("mosaic.json", "placements.json")}
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


@pytest.mark.long
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
        again = flight.resume(saved)
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


@pytest.mark.long
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
    with flying(tmp_path) as again:
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


@pytest.mark.long
def test_a_damaged_checkpoint_costs_time_but_no_frame(tmp_path: Path, world_cache: Path) -> None:
    pictures = six_pictures(world_cache)
    with flying(tmp_path) as flight:
        for k in range(2):
            flight.take(f"IMG_{k}.JPG", pictures[k])
        flight.wait_for_frames(placed=2)
        assert flight.end() == 0
    (flight.out / NAME).write_bytes(b"nonsense")
    with flying(tmp_path) as again:
        assert "its checkpoint is none of ours, so its frames are stitched again" in again.said
        again.wait_for_frames(placed=2)
        assert again.end() == 0
    assert events_of(flight.out) == ["matched"] * 2
    assert_explained(again.out, tmp_path / "rebuilt")


def flown(tmp_path: Path, config: Config = CONFIG) -> Config:
    """The settings of a flight that has just ended in tmp_path/mosaic."""
    config = replace(config, out=str(tmp_path / "mosaic"), watch=str(tmp_path / "frames"))
    with closing(open_flight(config)) as opened, closing(pipeline(opened.folder.path, config)) as flight:
        flight.checkpoint(at_once=True)
    return config


def test_a_start_goes_on_with_the_flight_that_has_just_ended(tmp_path: Path) -> None:
    config = flown(tmp_path)
    with closing(open_flight(config)) as opened:
        assert opened.folder.resumed
        assert opened.saved is not None
        assert opened.folder.said == f"going on with the flight in {config.out}"


@pytest.mark.parametrize(
    ("now", "why"),
    [
        ({"resume": "never"}, "holds an earlier flight"),
        ({"scale": 0.5}, "it was flown with other settings"),
        ({"watch": "elsewhere"}, "its frames came from "),
        ({"resume_h": 1.0}, "over 1 h ago: it is left as it is, and --resume goes on with it"),
        ({"method": "paper"}, "a map of the paper's recipe is in memory only"),
    ],
)
def test_another_flight_is_begun_beside(tmp_path: Path, now: dict[str, Any], why: str) -> None:
    config = flown(tmp_path)
    if "resume_h" in now:
        for file in (tmp_path / "mosaic").glob(f"{LEDGER_NAME}*"):
            os.utime(file, (time.time() - 2 * 3600,) * 2)
    with closing(open_flight(replace(config, **now))) as opened:
        assert not opened.folder.resumed
        assert opened.folder.path == tmp_path / "mosaic-2"
        assert why in opened.folder.said


def test_a_flight_that_somebody_writes_is_not_gone_on_with(tmp_path: Path) -> None:
    config = flown(tmp_path)
    with closing(open_flight(config)), closing(open_flight(config)) as beside:
        assert beside.folder.path == tmp_path / "mosaic-2"
        assert beside.folder.said == (
            f"{config.out} is being written by another gcs-mosaic; this flight is written to {config.out}-2"
        )


def test_a_folder_that_is_mapped_a_second_time_is_told(tmp_path: Path) -> None:
    config = flown(tmp_path)
    status = {"watch": {"kind": "folder", "folder": config.watch}}
    (tmp_path / "mosaic" / "status.json").write_text(json.dumps(status))
    again = f", so {config.watch} is mapped a second time (gcs-mosaic serve {config.out} shows that map, too); "
    with closing(open_flight(config)):
        with closing(open_flight(config)) as beside:
            assert again in beside.folder.said
        with closing(open_flight(replace(config, watch=str(tmp_path / "other")))) as beside:
            assert "a second time" not in beside.folder.said
        with pytest.raises(UsageError, match=r"^--resume: .* is being written by another gcs-mosaic: end"):
            open_flight(replace(config, resume="always"))


@pytest.mark.parametrize("page", [0, 3], ids=["its head", "its rows"])
def test_a_damaged_ledger_stops_no_start(tmp_path: Path, page: int) -> None:
    """Another flight is begun beside it; only who asks for that flight is refused."""
    config = flown(tmp_path)
    ledger = tmp_path / "mosaic" / LEDGER_NAME
    data = bytearray(ledger.read_bytes())
    data[4096 * page : 4096 * (page + 12)] = os.urandom(4096 * 12)
    ledger.write_bytes(data)
    before = ledger.read_bytes()
    repair = f"is damaged, and left as it is: gcs-mosaic check {config.out} --repair may bring it back"
    with closing(open_flight(config)) as opened:
        assert opened.folder.path == tmp_path / "mosaic-2"
        assert opened.folder.said == (
            f"the ledger of the flight in {config.out} {repair}; this flight is written to {config.out}-2"
        )
    with pytest.raises(UsageError, match=re.escape(f"{repair}, or begin another flight with --new")):
        open_flight(replace(config, resume="always"))
    with pytest.raises(UsageError, match=re.escape(f"{repair}, or begin another flight with another --out")):
        open_stitch(config)
    assert ledger.read_bytes() == before


def test_of_two_aircraft_each_finds_its_own_flight_again(tmp_path: Path) -> None:
    first = flown(tmp_path)
    second = replace(first, watch=str(tmp_path / "of another"))
    for _ in range(2):
        with closing(open_flight(second)) as opened, closing(pipeline(opened.folder.path, second)) as flight:
            flight.checkpoint(at_once=True)
            assert opened.folder.path == tmp_path / "mosaic-2"
    with closing(open_flight(first)) as opened:
        assert opened.folder.path == tmp_path / "mosaic"


def test_an_asked_for_flight_is_gone_on_with_however_old(tmp_path: Path) -> None:
    config = replace(flown(tmp_path), resume="always")
    os.utime(tmp_path / "mosaic" / LEDGER_NAME, (1e9, 1e9))
    with closing(open_flight(replace(config, watch="elsewhere"))) as opened:
        assert opened.folder.resumed
    with pytest.raises(UsageError, match="cannot be gone on with: it was flown with other settings"):
        open_flight(replace(config, scale=0.5))


def test_a_checkpoint_that_does_not_fit_is_as_none(tmp_path: Path, frames: list[Frame]) -> None:
    with closing(pipeline(tmp_path / "map")) as flight:
        process(flight, accepted(flight, frames[:3]))
        flight.checkpoint(at_once=True)
    said: list[Notice] = []
    with closing(Pipeline(tmp_path / "map", CONFIG, said.append, punctual=True)) as flight:
        again = flight.resume({"pipeline": {"mosaic": {"no such part": 1}, "_processed": {"frame": None}}})
        assert [frame.name for frame in again] == [frame.name for frame in frames[:3]]
        assert "does not fit" in said[0].text
        process(flight, again)
        assert flight.accounts().frames.placed == 3


@pytest.mark.parametrize("set_by_s", [-30e6, 300.0])
def test_a_clock_that_was_set_between_two_runs_moves_no_record(tmp_path: Path, set_by_s: float) -> None:
    """The machine went on, and with it the clock by which they came."""
    runs = [Run(0, 0, utc_of_zero() + set_by_s, boot_id()), Run(1, 1, utc_of_zero(), boot_id())]
    with Ledger(tmp_path / LEDGER_NAME) as ledger:
        for k in range(2):
            ledger.record_event(factories.trigger_event(k, 10.0 * k))
            ledger.record_frame(factories.frame(f"{k}.jpg", 10.0 * k + 1))
        told = told_again(ledger.events(), ledger.frames(), runs)
    came = [record.received if isinstance(record, FrameRecord) else record.event.received for record in told]
    assert came == [0.0, 1.0, 10.0, 11.0]


def test_records_keep_their_order_when_the_machine_was_started_again_twice(tmp_path: Path) -> None:
    """Its clock began at zero each time."""
    with Ledger(tmp_path / LEDGER_NAME) as ledger:
        runs = []
        for run, began in enumerate((5000.0, 3000.0, 400.0)):  # seconds ago
            runs.append(Run(2 * run, run, utc_of_zero() + time.monotonic() - began))
            ledger.record_event(factories.trigger_event(2 * run, 10.0))
            ledger.record_frame(factories.frame(f"{run}.jpg", 20.0 - run))
            ledger.record_event(factories.trigger_event(2 * run + 1, 30.0))
        told = told_again(ledger.events(), ledger.frames(), runs)
    order = [record.name if isinstance(record, FrameRecord) else record.event.sequence for record in told]
    assert order == [0, "0.jpg", 1, 2, "1.jpg", 3, 4, "2.jpg", 5]
