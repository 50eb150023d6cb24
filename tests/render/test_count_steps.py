"""Steps of counts between overlapping frames: a gain mode, a shutter, a sensor that warms."""

from collections.abc import Sequence

import numpy as np
import pytest

from gcs_mosaic.render.count_steps import CountsInOverlap, CountStep, agreed_steps, counts_in_overlap, step_beside
from tests.sure import sure

GROUND = np.random.default_rng(0).normal(27_800, 60, (3000, 1))
FACTORS = {"offset": (1.0, 600.0), "scale": (1.5, 0.0), "both": (1.6, -15_700.0), "down": (0.6, 9000.0)}


def overlap(i: CountStep, j: CountStep, seed: int = 0) -> CountsInOverlap:
    """Of two frames whose counts differ from the ground's by these steps the other way."""
    rng = np.random.default_rng(1000 + seed)
    seen = [(GROUND + rng.normal(0, 8, GROUND.shape) - one.offset[0]) / one.scale[0] for one in (i, j)]
    return sure(counts_in_overlap(*(one.astype(np.float32) for one in seen)))


def steps(count: int, scale: float, offset: float) -> list[CountStep]:
    """None in the first half of the frames."""
    return [CountStep((1.0,), (0.0,)) if 2 * k < count else CountStep((scale,), (offset,)) for k in range(count)]


def chain(true: Sequence[CountStep]) -> list[tuple[str, str, CountsInOverlap]]:
    pairs = [(k, k - back) for k in range(len(true)) for back in (1, 2) if k >= back]
    return [(str(i), str(j), overlap(true[i], true[j], seed=i)) for i, j in pairs]


def usual(true: CountStep, found: CountStep) -> np.ndarray:
    """What becomes of the ground's counts."""
    return (GROUND - true.offset[0]) / true.scale[0] * found.scale[0] + found.offset[0]


@pytest.mark.parametrize("factors", FACTORS.values(), ids=FACTORS)
def test_a_new_frame_is_taken_to_the_counts_of_those_beside_it(factors: tuple[float, float]) -> None:
    before, after = steps(2, *factors)
    found = step_beside([(overlap(after, before), before)], 1)
    assert usual(after, found).mean() == pytest.approx(GROUND.mean(), abs=3)
    assert usual(after, found).std() == pytest.approx(GROUND.std(), rel=0.05)


@pytest.mark.parametrize("factors", FACTORS.values(), ids=FACTORS)
def test_all_frames_agree_at_the_end(factors: tuple[float, float]) -> None:
    true = steps(40, *factors)
    found = agreed_steps({str(k): [300.0] for k in range(len(true))}, chain(true))
    means = [float(usual(one, found[str(k)]).mean()) for k, one in enumerate(true)]
    spreads = [float(usual(one, found[str(k)]).std()) for k, one in enumerate(true)]
    assert np.ptp(means) < 15
    assert max(spreads) / min(spreads) < 1.05


def test_frames_without_steps_have_none() -> None:
    true = steps(30, 1.0, 0.0)
    found = agreed_steps({str(k): [300.0] for k in range(30)}, chain(true))
    assert {one.scale for one in found.values()} == {(1.0,)}
    assert max(abs(one.offset[0]) for one in found.values()) < 3


def test_what_is_known_stays_as_far_as_it_can() -> None:
    true = steps(10, 1.0, 600.0)
    known = {str(k): CountStep((1.0,), (one.offset[0] - 250,)) for k, one in enumerate(true)}
    found = agreed_steps({name: [300.0] for name in known}, chain(true), known)
    assert max(abs(found[name].offset[0] - known[name].offset[0]) for name in known) < 5


def test_a_thing_that_moves_is_no_step() -> None:
    here, there = GROUND.copy(), GROUND.copy()
    here[:90], there[200:290] = 33_000, 33_000
    found = sure(counts_in_overlap(here.astype(np.float32), there.astype(np.float32)))
    assert abs(found.mean_i[0] - found.mean_j[0]) < 3
    assert found.log_scale == (0.0,)


def test_frames_that_share_next_to_nothing_tell_nothing() -> None:
    assert counts_in_overlap(GROUND[:20].astype(np.float32), GROUND[:20].astype(np.float32)) is None
    assert agreed_steps({"alone": [300.0]}, []) == {"alone": CountStep((1.0,), (0.0,))}
