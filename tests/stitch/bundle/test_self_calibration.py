"""What is found of a lens over flat ground seen straight down: all that the matches determine, and no more is stated."""

from __future__ import annotations

import logging
import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from _pytest.mark import ParameterSet

from gcs_mosaic.stitch.bundle import lens
from gcs_mosaic.stitch.bundle.flat_ground import along_flat_ground
from gcs_mosaic.stitch.bundle.island import _tell_refused
from gcs_mosaic.stitch.bundle.levenberg_marquardt import AdjustmentSettings, Solution
from gcs_mosaic.stitch.camera.geometry import Camera
from gcs_mosaic.stitch.graph.view_graph import Lens, ViewGraph
from tests.benchmarks.lenses import FOCALS, TILTS, NadirFlight, adjusted, error_and_deviation, flown, village
from tests.tiers import thorough

DETERMINED = 2.0  # degrees: spread of tilts from which on a hundred frames over flat ground determine a focal length
CLOSE = 0.05  # error of the log of a focal length
ENDS = (FOCALS[0], 1.1, FOCALS[-1])  # of them, and of the tilts, those that are flown where all are too many
COVERED = 3.0  # stated deviations: what lies farther off was not covered by them
LARGEST_SHIFT = 0.04  # of a principal point that is believed, half-diagonals: two deviations of its prior
SETTINGS = AdjustmentSettings()
PRIOR = math.log(SETTINGS.focal_prior)

# A lens that flat ground does not determine, and what pulls at it. With the cost alone these ended with 0.50 (the limit), with
# 2.50, and with a principal point 0.43 from the middle.
HILLS = NadirFlight(
    focal=1.108, tilt=0.07, seed=1, hills=0.1, houses=0.5, k1=-0.012, readout=0.006, tangential=(0.0014, -0.0016)
)
CROSSED = NadirFlight(
    focal=1.108, tilt=0.08, seed=1, crossed=True, houses=0.5, k1=-0.012, readout=0.006, shaking=0.003, wrong=0.05
)
ASTRAY = (HILLS, CROSSED, replace(CROSSED, seed=2))


def off(solution: Solution) -> float:
    """From the focal length that is expected of any lens, log."""
    return abs(float(solution.lenses[0, 0]) - PRIOR)


@pytest.mark.long
@pytest.mark.parametrize("focal", [thorough(0.6), 1.1, thorough(4.0)])
def test_tilts_tell_the_focal_length(focal: float) -> None:
    error, deviation = error_and_deviation(adjusted(flown(NadirFlight(focal=focal, tilt=4.0, frames=50))), focal)
    assert abs(error) < CLOSE
    assert abs(error) < COVERED * deviation < 2 * CLOSE


@pytest.mark.parametrize("focal", [0.6, 1.1, 4.0])
def test_without_tilts_an_ordinary_lens_is_kept_and_stated_as_uncertain(focal: float) -> None:
    solution = adjusted(flown(NadirFlight(focal=focal, frames=50)))
    error, deviation = error_and_deviation(solution, focal)
    assert off(solution) < 0.1 * SETTINGS.focal_prior_log_sigma
    assert abs(error) < 2 * deviation


@pytest.mark.long
@pytest.mark.parametrize(
    "flight", [ASTRAY[0], *map(thorough, ASTRAY[1:])], ids=["hills", "shutter", "shutter and principal point"]
)
def test_what_is_no_lens_does_not_pull_at_it(flight: NadirFlight) -> None:
    solution = adjusted(flown(flight))
    error, deviation = error_and_deviation(solution, flight.focal)
    assert off(solution) < 2 * SETTINGS.focal_prior_log_sigma
    assert abs(error) < COVERED * deviation
    assert np.abs(solution.lenses[0, 3:]).max() < LARGEST_SHIFT


@pytest.mark.long
def test_a_lens_at_a_limit_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """The matches determine the focal length, but nothing so short is made."""
    monkeypatch.setattr(lens, "SHORTEST_FOCAL", 1.3)
    solution = adjusted(flown(NadirFlight(focal=1.108, tilt=4.0, frames=40)))
    assert solution.refused.tolist() == [True]
    assert off(solution) < 0.01


def test_an_ordinary_lens_is_not_refused() -> None:
    assert not adjusted(flown(NadirFlight(focal=1.108, tilt=4.0, frames=40))).refused.any()


def test_a_refused_lens_is_told_once(caplog: pytest.LogCaptureFixture) -> None:
    graph = ViewGraph(SETTINGS.focal_prior, SETTINGS.matches_per_pair)
    refused = {0: Lens(Camera(640, 480), np.eye(5), refused=True)}
    with caplog.at_level(logging.WARNING):
        _tell_refused(graph, 3, refused)
        graph.lenses[3, 0] = refused[0]
        _tell_refused(graph, 3, refused)
    (told,) = caplog.messages
    assert told.startswith("island 3: the matches do not determine the lens of its frames of 640 x 480 px")
    assert "refused" in told


def test_steps_along_flat_ground_are_the_same_to_first_order() -> None:
    rng = np.random.default_rng(4)
    poses = rng.normal(0, 1, (50, 6)) * [1000, 1000, 0.1, 1, 0.2, 0.2]
    step = rng.normal(0, 1, (50, 6)) * [50, 50, 0.05, 0.05, 0.05, 0.05]
    focal, change, half = np.full(50, 0.3), rng.normal(0, 0.2, 50), np.full(50, 1000.0)
    whole, half_way = (
        np.abs(along_flat_ground(poses, share * step, focal, focal + share * change, half)).max(axis=0)
        for share in (1e-2, 0.5e-2)
    )
    changed = [0, 1, 4, 5]
    assert whole[changed] == pytest.approx(4 * half_way[changed], rel=0.1)
    assert (whole[[2, 3]] == 0).all()


def test_a_longer_focal_length_alone_tilts_level_frames_not_at_all() -> None:
    poses, still = np.zeros((3, 6)), np.zeros((3, 6))
    assert not along_flat_ground(poses, still, np.zeros(3), np.full(3, 0.5), np.full(3, 1000.0)).any()


def _lenses() -> list[ParameterSet]:
    """Every kind of ground, lens and tilts; the ends and the ordinary lens where all are too many."""
    return [
        pytest.param(kind, focal, tilt, marks=[] if focal in ENDS and tilt in (0, DETERMINED) else pytest.mark.thorough)
        for kind, focal, tilt in product(["flat", "village"], FOCALS, TILTS)
    ]


@pytest.mark.thorough
@pytest.mark.long
@pytest.mark.parametrize(("kind", "focal", "tilt"), _lenses())
def test_every_lens(kind: str, focal: float, tilt: float) -> None:
    """The median error is small where the tilts' spread determines the lens; else what is stated covers it."""
    flights = (
        village(focal, tilt, seed) if kind == "village" else NadirFlight(focal=focal, tilt=tilt, seed=seed)
        for seed in range(3)
    )
    error, deviation = np.array([error_and_deviation(adjusted(flown(one)), focal) for one in flights]).T
    close = np.median(abs(error)) <= CLOSE
    if kind == "flat" and tilt >= DETERMINED:
        assert close
    assert close or np.median(abs(error) / deviation) < COVERED
