from __future__ import annotations

import random
from collections.abc import Callable

import pytest

from gcs_mosaic.triggers.delay import UsualDelay


def line(shot: int) -> float:
    """When a shot is taken: each 2 s, with a turn of 10 s after every twelfth."""
    return 2.0 * shot + 10.0 * (shot // 12)


def learnt(delay_s: float, lost: frozenset[int] = frozenset(), untold: frozenset[int] = frozenset()) -> UsualDelay:
    """After 60 shots whose files come late by `delay_s` and up to 0.3 s more."""
    dice, usual = random.Random(3), UsualDelay(early_s=2.0, window_s=15.0, widest_s=4.0)
    happened: list[tuple[float, Callable[[float], None]]] = [
        (line(n), usual.shot) for n in range(60) if n not in untold
    ]
    happened += [(line(n) + delay_s + 0.3 * dice.random(), usual.file) for n in range(60) if n not in lost]
    for moment, tell in sorted(happened, key=lambda item: item[0]):
        tell(moment)
    return usual


@pytest.mark.parametrize("delay_s", [-1.0, 0.1, 1.0, 1.9, 2.1, 5.0, 11.0])
def test_the_delay_is_found(delay_s: float) -> None:
    assert learnt(delay_s).value == pytest.approx(delay_s + 0.15, abs=0.2)


@pytest.mark.parametrize("delay_s", [0.5, 1.0, 3.5])
def test_files_and_shots_that_are_lost_do_not_mislead(delay_s: float) -> None:
    usual = learnt(delay_s, lost=frozenset({0, 1, 17, 30, 31}), untold=frozenset({5, 22, 40}))
    assert usual.value == pytest.approx(delay_s + 0.15, abs=0.2)


def test_a_delay_that_grows_slowly_is_followed() -> None:
    usual = UsualDelay(early_s=2.0, window_s=15.0, widest_s=4.0)
    for n in range(200):
        usual.shot(2.0 * n)
        usual.file(2.0 * n + 0.5 + 0.01 * n)
    assert usual.value == pytest.approx(2.49, abs=0.3)


def test_half_the_time_between_shots_is_too_far() -> None:
    assert learnt(1.0).tolerance_s == pytest.approx(1.0)


def test_cameras_that_are_triggered_at_once_leave_the_time_between_shots_as_it_is() -> None:
    """Each shot is told once for each of them, a moment apart, and each brings a file."""
    usual = UsualDelay(early_s=2.0, window_s=15.0, widest_s=4.0)
    for n in range(20):
        for camera in range(2):
            usual.shot(2.0 * n + 0.004 * camera)
        for camera in range(2):
            usual.file(2.0 * n + 0.5 + 0.02 * camera)
    assert usual.usual_gap_s == pytest.approx(2.0, abs=0.01)
    assert usual.tolerance_s == pytest.approx(1.0, abs=0.01)
