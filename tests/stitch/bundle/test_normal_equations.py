"""The step of an adjustment is that of a general solver, wherever and beside how many others its parts are found."""

from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context

import numpy as np
import pytest
from linked_frames import contributions, equations_of, problem_with, shapes

from gcs_mosaic.stitch.arrays import Matrix
from gcs_mosaic.stitch.bundle import elimination, levenberg_marquardt
from gcs_mosaic.stitch.bundle.elimination import BLOCK
from gcs_mosaic.stitch.bundle.levenberg_marquardt import AdjustmentSettings, _first_state, adjust
from gcs_mosaic.stitch.bundle.normal_equations import Normal, Run, solve
from gcs_mosaic.stitch.bundle.problem import Problem
from gcs_mosaic.stitch.bundle.uncertainty import island_certainty
from tests.benchmarks.superlu import superlu_step
from tests.benchmarks.survey_of_matches import CAMERA, rms_error_px, survey

SHAPES = shapes(300)
SETTINGS = AdjustmentSettings()
CLOSE = 1e-9  # relative to the largest part of a step, in the scale in which the equations are solved


def distance(normal: Normal, step: Matrix | None, expected: Matrix) -> float:
    assert step is not None
    scale = np.sqrt(np.maximum(normal.diagonal, 1e-12))
    return float(abs((step - expected) * scale).max(initial=0) / max(abs(expected * scale).max(initial=0), 1e-300))


@pytest.mark.parametrize("cameras", [1, 3])
@pytest.mark.parametrize("shape", SHAPES)
def test_the_step_is_that_of_superlu(shape: str, cameras: int) -> None:
    problem = problem_with(*SHAPES[shape], cameras)
    for some in (problem, replace(problem, lens_free=False)):
        if len(problem.poses) or some.lens_free:
            normal, gradient = equations_of(some)
            assert distance(normal, solve(normal, gradient, 1e-4), superlu_step(normal, gradient, 1e-4)) < CLOSE


@pytest.mark.parametrize("damping", [1e-4, 1e-5, 1e-6, 1e-9])
def test_the_step_of_a_flight_is_that_of_superlu(damping: float) -> None:
    state = _first_state(survey(500).problem, SETTINGS)
    expected = superlu_step(state.normal, state.gradient, damping)
    assert distance(state.normal, solve(state.normal, state.gradient, damping), expected) < CLOSE


@pytest.mark.thorough
@pytest.mark.long
def test_the_step_of_a_long_flight_is_that_of_superlu() -> None:
    state = _first_state(survey(3000).problem, SETTINGS)
    for damping in (1e-4, 1e-6, 1e-9):
        expected = superlu_step(state.normal, state.gradient, damping)
        assert distance(state.normal, solve(state.normal, state.gradient, damping), expected) < CLOSE


@pytest.mark.parametrize("lens_free", [True, False])
def test_equations_are_the_sums_over_the_pairs(lens_free: bool) -> None:
    """Some frames fixed, two cameras, and a pair that is there twice."""
    links, places = SHAPES["links of no order"]
    problem = problem_with(np.concatenate([links, links[:1], links[5:9, ::-1]]), places, cameras=2)
    problem = replace(problem, free=np.arange(len(places)) % 5 > 0, lens_free=lens_free)
    normal, gradient = equations_of(problem)
    n, layout = len(places), normal.layout
    whole, slope = np.zeros((6 * n + 12, 6 * n + 12)), np.zeros(6 * n + 12)
    for (a, b), block, slopes in zip(problem.pairs, *contributions(problem), strict=True):
        lenses = [6 * n + 6 * problem.camera[frame] + np.arange(5) for frame in (a, b)]
        index = np.concatenate([6 * a + np.arange(6), 6 * b + np.arange(6), *lenses])
        np.add.at(whole, (index[:, None], index), block)
        np.add.at(slope, index, slopes)
    vertices = np.concatenate([layout.frames, layout.lenses])
    unknowns = (BLOCK * vertices[:, None] + np.arange(6))[vertices >= 0]
    places_of = np.arange(6 * n + 12).reshape(-1, 6)[vertices >= 0]
    terms = np.array([[k < 5 or row < 6 * n for k, row in enumerate(rows)] for rows in places_of])
    at, of = unknowns[terms], places_of[terms]
    assert np.allclose(normal.dense()[np.ix_(at, at)], whole[np.ix_(of, of)], rtol=1e-12, atol=1e-9)
    assert np.allclose(gradient.ravel()[at], slope[of], rtol=1e-12, atol=1e-9)
    assert layout.unknowns == len(at)


def test_unknowns_without_matches_stay_where_they_are() -> None:
    normal, gradient = equations_of(problem_with(*SHAPES["a survey and frames without links"]))
    step = solve(normal, gradient, 1e-4)
    assert step is not None
    alone = normal.layout.frames[240:]
    assert (step[alone] == 0).all()
    assert (step[normal.layout.frames[:240]] != 0).all()


def test_a_matrix_that_is_not_positive_definite_has_no_step_until_it_is_damped() -> None:
    normal, gradient = equations_of(problem_with(*SHAPES["a survey"]))
    normal.blocks[7] = abs(normal.blocks[7]).max() * (3 * np.ones((BLOCK, BLOCK)) - 2 * np.eye(BLOCK))
    assert solve(normal, gradient, 1e-4) is None
    assert distance(normal, solve(normal, gradient, 10.0), superlu_step(normal, gradient, 10.0)) < CLOSE


def test_what_is_no_number_has_no_step() -> None:
    normal, gradient = equations_of(problem_with(*SHAPES["a survey"]))
    normal.blocks[7, 0, 0] = np.nan
    assert solve(normal, gradient, 1e-4) is None


def test_an_adjustment_goes_on_with_more_damping_where_there_is_no_step(monkeypatch: pytest.MonkeyPatch) -> None:
    dampings, flight = list[float](), survey(60)

    def after_two(normal: Normal, gradient: Matrix, damping: float, run: Run) -> Matrix | None:
        dampings.append(damping)
        return None if len(dampings) <= 2 else solve(normal, gradient, damping, run)

    usual = adjust(flight.problem, SETTINGS)
    monkeypatch.setattr(levenberg_marquardt, "solve", after_two)
    found = adjust(flight.problem, SETTINGS)
    assert dampings[0] < dampings[1] < dampings[2]
    errors = [rms_error_px(one.poses, one.lenses, flight.truth) for one in (usual, found)]
    assert errors[1] == pytest.approx(errors[0], abs=0.1)


@pytest.fixture
def small_tasks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(elimination, "WHOLE_VERTICES", 60)
    monkeypatch.setattr(elimination, "TASK_VERTICES", 60)


@pytest.mark.usefixtures("small_tasks")
@pytest.mark.parametrize("shape", SHAPES)
def test_tasks_change_nothing(shape: str, monkeypatch: pytest.MonkeyPatch) -> None:
    problem = problem_with(*SHAPES[shape])
    apart = solve(*equations_of(problem), 1e-4)
    monkeypatch.setattr(elimination, "WHOLE_VERTICES", 1000)
    together = solve(*equations_of(problem), 1e-4)
    assert apart is not None
    assert together is not None
    assert apart.tobytes() == together.tobytes()


@pytest.mark.long
@pytest.mark.usefixtures("small_tasks")
def test_an_adjustment_is_the_same_bytes_however_many_processes_work_on_it() -> None:
    flight = survey(200)
    here = outcome(flight.problem, map)
    with ProcessPoolExecutor(3, mp_context=get_context("spawn")) as pool:
        assert outcome(flight.problem, pool.map) == here


def outcome(problem: Problem, run: Run) -> list[bytes]:
    """What an adjustment brings about, all of whose tasks are given to `run`."""
    tasks = list[int]()

    def counted(function: Callable[[object], object], arguments: Iterable[object]) -> Iterable[object]:
        waiting = list(arguments)
        tasks.append(len(waiting))
        return run(function, waiting)

    solution = adjust(problem, SETTINGS, counted)
    certainty = island_certainty(problem, solution, [CAMERA], 0, SETTINGS.loss_px, counted)
    assert min(tasks) > 2
    return [found.tobytes() for found in (solution.poses, solution.lenses, certainty.deviations_px)]
