"""The benchmark of all flights says what is true: of reasons, changes and flights that fail."""

import multiprocessing
import os
import signal
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from gcs_mosaic.frames.directory import frames_in
from gcs_mosaic.stitch.features.extraction import FeatureSettings
from tests.benchmarks import feature_cache, flight_run, flight_table, flights
from tests.benchmarks.feature_cache import FeatureFinder, source_hash, sources_of
from tests.benchmarks.flight_run import Run, Task
from tests.benchmarks.pair_report import pairs, reported
from tests.benchmarks.refusals import grouped
from tests.benchmarks.side_by_side import Failed, each

pytestmark = pytest.mark.long


GOOD = Run(
    name="meadow",
    frames=20,
    islands=(12, 6),
    ortho_px=10.0,
    tracks_median_px=2.0,
    gps_rms_m=1.5,
    refused={"only N % of the overlap agrees": 7},
    cpu_s={"place": 10.0},
    memory_mb=300,
)


# Reasons


@pytest.mark.parametrize(
    ("reason", "group"),
    [
        ("only 31% of the overlap agrees", "only N % of the overlap agrees"),
        ("evidence -2.5, 8.0 needed", "evidence N, N needed"),
        ("change of scale 0.12 to 1e-05", "change of scale N to N"),
        ("misses its matches by nan px, 4.0 allowed", "misses its matches by N px, N allowed"),
        ("it could not be processed (KeyError('k1'))", "it could not be processed (KeyError('k1'))"),
    ],
)
def test_reasons_are_grouped_without_their_numbers(reason: str, group: str) -> None:
    assert grouped(reason) == group


def test_pairs_are_counted_by_what_became_of_them() -> None:
    report = reported([(True, ""), (True, "tilted by 85 degrees"), (False, "evidence 1.0"), (False, "evidence 2.0")])
    assert (report.pairs, report.registered, report.placed) == (4, 2, 1)
    assert report.why == {"evidence N": 2, "tilted by N degrees": 1}


# Comparison


@pytest.mark.parametrize(
    ("now", "said"),
    [
        ({}, ""),
        ({"ortho_px": 10.1, "cpu_s": {"place": 12.0}}, ""),
        ({"islands": (19,)}, "better"),
        ({"islands": (12, 5)}, "WORSE"),
        ({"islands": (12, 7), "gps_rms_m": 4.0}, "both"),
        ({"ortho_px": None}, "WORSE"),
        ({"held_out_median_px": 1.0}, ""),
        ({"cpu_s": {"place": 30.0}, "memory_mb": 600}, ""),
        ({"error": "it broke"}, "WORSE"),
    ],
)
def test_what_has_changed_is_marked(now: dict[str, Any], said: str) -> None:
    assert flight_table.mark(replace(GOOD, **now), GOOD) == said
    assert flight_table.mark(replace(GOOD, **now), None) == "new"


def test_a_row_tells_figures_reasons_and_changes() -> None:
    now = replace(GOOD, islands=(12, 5), refused={"only N % of the overlap agrees": 9}, cpu_s={"place": 20.0})
    said = "\n".join(flight_table.row("meadow at 1", now, GOOD))
    for part in ("17/20", "2 (12 5)", "9 (was 7)  x only N %", "WORSE: placed 18 -> 17", "costs: place CPU s 10 -> 20"):
        assert part in said


def test_faults_of_adjusting_are_no_frames_that_are_lost() -> None:
    said = flight_table.row("meadow at 1", replace(GOOD, covered=3, troubles={"MemoryError()": 2}), GOOD)
    columns = dict(zip(flight_table.HEADER.split()[:4], said[0].split()[2:], strict=False))
    assert (columns["flight"], columns["placed"], columns["alone"], columns["covered"]) == ("1", "18/20", "0", "3")
    assert any(line.split() == ["adjusting", "raised", "2", "(was", "0)", "x", "MemoryError()"] for line in said)
    assert not any("not on the map" in line for line in said)


def test_runs_are_kept_as_they_were_and_beside_others(tmp_path: Path) -> None:
    kept = tmp_path / "kept.json"
    assert flight_table.read(kept) == {}
    flight_table.write(kept, {"meadow at 1": GOOD})
    flight_table.write(kept, {"wood at 1": GOOD, "lake at 1": Run(name="lake", error="it broke")})
    assert flight_table.read(kept) == {"meadow at 1": GOOD, "wood at 1": GOOD}


def test_the_runs_in_the_repository_can_be_read() -> None:
    kept = flight_table.read(flight_table.KEPT)
    assert len(kept) >= 12
    assert all(run.placed for run in kept.values())
    assert all(key == flight_table.key(run.name, float(key.split()[-1]), full=False) for key, run in kept.items())


# Features


def test_features_come_out_of_the_cache_as_they_were(tmp_path: Path) -> None:
    made_flight(tmp_path / "flight", 1)
    (frame,) = frames_in([tmp_path / "flight"]).frames
    for settings, found in ((FeatureSettings(), 1), (FeatureSettings(), 0), (FeatureSettings(count=100), 1)):
        finder = FeatureFinder(settings, 1, tmp_path / "cache")
        features = finder.features_of(frame)  # type: ignore[arg-type]
        direct = FeatureFinder(settings, 1).features_of(frame)  # type: ignore[arg-type]
        assert finder.found == found
        assert not isinstance(features, str)
        assert not isinstance(direct, str)
        assert np.array_equal(features.points, direct.points)


def test_the_cache_knows_the_source_that_finds_features() -> None:
    modules = set(sources_of(feature_cache.FINDERS))
    assert {
        "gcs_mosaic.stitch.features.detectors",
        "gcs_mosaic.stitch.camera.bands",
        "gcs_mosaic.frames.jpeg",
    } <= modules
    assert not {name for name in modules if name.startswith("gcs_mosaic.stitch.bundle")}
    assert source_hash(feature_cache.FINDERS) != source_hash(("gcs_mosaic.frames.decode",))


# Flights


def made_flight(folder: Path, frames: int) -> Path:
    """Pictures cut side by side out of one of noise, each overlapping the next by half."""
    folder.mkdir()
    rng = np.random.default_rng(1)
    ground = cv2.resize(rng.integers(0, 255, (120, 320, 3), dtype=np.uint8), None, fx=4, fy=4)
    for k in range(frames):
        cv2.imwrite(str(folder / f"{k}.png"), ground[:, 160 * k : 160 * k + 320])
    return folder


def test_a_flight_is_run_and_judged(tmp_path: Path) -> None:
    task = Task(made_flight(tmp_path / "flight", 4), scale=1)
    (tmp_path / "flight" / "again.png").write_bytes((tmp_path / "flight" / "0.png").read_bytes())
    found = flight_run.run(task)
    assert (found.frames, found.islands, found.alone) == (5, (4,), 0)
    assert (found.unplaced, found.covered) == ({"the same picture as an earlier one": 1}, 0)
    assert set(found.cpu_s) == {"features", "place", "adjust"}
    assert found.gps_rms_m is None
    assert found.ortho_px is None
    assert found.memory_mb


@pytest.mark.thorough
def test_the_whole_program_makes_the_same_of_it(tmp_path: Path) -> None:
    task = Task(made_flight(tmp_path / "flight", 4), scale=1)
    core, full = flight_run.run(task), flight_run.run(replace(task, full=True))
    assert (full.frames, full.islands, full.unplaced) == (core.frames, core.islands, core.unplaced)
    assert full.covered == core.covered == 0
    assert {"decode", "features", "place", "paint", "write", "all"} <= set(full.wall_s)


def test_consecutive_pairs_match(tmp_path: Path) -> None:
    report = pairs(Task(made_flight(tmp_path / "flight", 3), scale=1))
    assert (report.pairs, report.registered, report.placed, report.why) == (2, 2, 2, {})


def divided(by: int) -> float:
    if by < 0:
        os._exit(3)
    return 6 / by


@pytest.mark.thorough
def test_work_that_fails_is_told_and_the_rest_goes_on() -> None:
    outcomes = dict(each(divided, [2, 0, -1, 3], jobs=2))
    assert (outcomes[2], outcomes[3]) == (3.0, 2.0)
    assert outcomes[0] == Failed("ZeroDivisionError: division by zero")
    assert outcomes[-1] == Failed("the process ended with 3")


def test_nothing_goes_on_after_ctrl_c() -> None:
    start = time.monotonic()
    threading.Timer(1.0, os.kill, (os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        list(each(time.sleep, [60.0, 60.0], jobs=2))
    assert time.monotonic() - start < 30
    assert not multiprocessing.active_children()


def test_flights_are_found_by_name_and_path(tmp_path: Path) -> None:
    assert flights.folders([str(made_flight(tmp_path / "flight", 1))]) == [tmp_path / "flight"]
    with pytest.raises(SystemExit):
        flights.folders(["no such flight"])
    (tmp_path / "other").mkdir()
    with pytest.raises(SystemExit, match="have one name"):
        flights.folders([str(tmp_path / "flight"), str(made_flight(tmp_path / "other" / "flight", 1))])
    assert flights.scales("0.25,1") == (0.25, 1.0)
    with pytest.raises(ValueError, match="expected 1"):
        flights.scales("0.3")
