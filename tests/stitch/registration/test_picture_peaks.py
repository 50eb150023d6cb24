"""How two pictures are laid on each other, and what of it is evidence."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from gcs_mosaic.stitch.arrays import AnyArray, FloatImage, Matrix3x3, PointsNx2
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.registration import agreement as module
from gcs_mosaic.stitch.registration.agreement import LEAST_OVERLAP, LEAST_TOGETHER, MOST, REACH, Agreement, PixelPair

WIDTH, HEIGHT, MARGIN = 240, 180, 120


def ground(seed: int = 0) -> FloatImage:
    noise = np.random.default_rng(seed).normal(0, 1, (HEIGHT + 2 * MARGIN, WIDTH + 2 * MARGIN)).astype(np.float32)
    soft = cv2.GaussianBlur(noise, (0, 0), 3)
    return np.asarray(30 * soft / soft.std(), np.float32)


GROUND = ground()
NONE = np.empty((0, 2))


def frame(picture: AnyArray) -> Features:
    texture = np.clip(np.rint(picture), -127, 127).astype(np.int8)
    height, width = picture.shape
    return Features(NONE.astype(np.float32), np.empty((0, 128), np.uint8), width, height, 1.0, kept_texture=texture)


def cut(x: int, y: int, *, noise: float = 0.0, seed: int = 1, size: tuple[int, int] = (HEIGHT, WIDTH)) -> Features:
    seen = GROUND[MARGIN + y : MARGIN + y + size[0], MARGIN + x : MARGIN + x + size[1]]
    return frame(seen + noise * cv2.GaussianBlur(np.random.default_rng(seed).normal(0, 30, seen.shape), (0, 0), 1.5))


def moved(x: float, y: float = 0.0) -> Matrix3x3:
    return np.array([[1, 0, x], [0, 1, y], [0, 0, 1.0]])


def laid(a: Features, b: Features, b_from_a: Matrix3x3) -> Agreement | None:
    return PixelPair(a, b).agreement(b_from_a)


def test_ground_that_noise_hides_by_half_is_found_all_the_same() -> None:
    """It has moved, so that no more need agree than for any ground."""
    found = laid(cut(0, 0, noise=5), cut(40, 20, noise=5, seed=2), moved(-40, -20))
    assert found is not None
    assert found.correlation < 0.8
    assert found.evidence > 4
    assert np.abs(found.b_from_a @ [120, 90, 1] - [80, 70, 1]).max() < 2


def test_what_stands_still_agrees_in_frames_of_one_size_alone() -> None:
    """A sensor's pattern has no other size; what is cut from a picture may lie on it without having moved."""
    whole, again = cut(0, 0, noise=5), cut(0, 0, noise=5, seed=2)
    part = cut(0, 0, noise=5, seed=2, size=(HEIGHT - 20, WIDTH - 20))
    assert laid(whole, again, np.eye(3)) is None
    assert laid(whole, part, np.eye(3)) is not None


@pytest.mark.parametrize(("astray", "believed"), [(0.0, True), (2.0, True), (4.0, False), (-4.0, False)])
def test_refinement_that_ends_beside_the_peak_is_not_believed(
    monkeypatch: pytest.MonkeyPatch, astray: float, believed: bool
) -> None:
    """A pixel of the coarse texture, two of these, may be left."""
    a, b = cut(0, 0), cut(40, 20)
    half = astray / 2
    for off in (moved(half, 0), moved(0, half)):
        monkeypatch.setattr(PixelPair, "_refined", lambda self, b_from_a, off=off: off @ b_from_a)
        assert (laid(a, b, moved(-40, -20)) is not None) is believed


def test_where_refinement_comes_to_nothing_nothing_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(PixelPair, "_refined", lambda self, b_from_a: None)
    assert laid(cut(0, 0), cut(40, 20), moved(-40, -20)) is None


@pytest.mark.parametrize(("x", "found"), [(120, True), (215, False), (300, False)])
def test_an_overlap_of_few_pixels_tells_nothing(x: int, found: bool) -> None:
    """1,500 of the coarse texture, which has 120 x 90."""
    a, b = frame(GROUND[:HEIGHT, :WIDTH]), frame(GROUND[:HEIGHT, x : x + WIDTH])
    assert (laid(a, b, moved(-x)) is not None) is found


@pytest.mark.parametrize(("astray", "found"), [(0, True), (40, True), (62, True), (80, False)])
def test_a_proposal_is_drawn_by_so_much_and_no_further(astray: int, found: bool) -> None:
    """32 px of the coarse texture, 64 of these."""
    for off in ((astray, 0), (-astray, 0), (0, -astray)):
        there = laid(cut(0, 0), cut(40, 20), moved(off[0] - 40, off[1] - 20))
        assert (there is not None) is found
        if there is not None:
            assert np.abs(there.b_from_a @ [120, 90, 1] - [80, 70, 1]).max() < 1


def test_the_further_a_proposal_is_drawn_the_less_it_proves(monkeypatch: pytest.MonkeyPatch) -> None:
    """As many places lie as near, each of which might have agreed by chance; where nothing else is as like."""
    a, b = cut(0, 0, noise=10), cut(40, 20, noise=10, seed=2)
    both = laid(a, b, moved(-40, -20))
    monkeypatch.setattr(module, "_log_odds_of_peak", lambda found, together: math.inf)
    near, far = (laid(a, b, moved(x - 40, -20)) for x in (0, 40))
    assert near is not None
    assert far is not None
    assert both is not None
    assert both.evidence < near.evidence
    assert near.evidence - far.evidence == pytest.approx(math.log10(1 + math.pi * 20**2 / LEAST_TOGETHER), abs=0.6)


def test_what_agrees_entirely_is_worth_the_most() -> None:
    found = laid(cut(0, 0), cut(40, 20), moved(-40, -20))
    assert found is not None
    assert found.evidence == MOST
    assert found.correlation == pytest.approx(1.0, abs=0.02)
    assert found.runner_up < 0.5
    assert found.pixels == pytest.approx(100 * 80, rel=0.05)
    assert found.together >= LEAST_TOGETHER


@pytest.mark.parametrize(("x", "y"), [(60, 40), (-60, 40), (60, -40), (-60, -40)])
def test_the_best_of_all_shifts_is_where_the_ground_is(x: int, y: int) -> None:
    straight, _ = PixelPair(cut(0, 0), cut(x, y)).best_shifts()
    assert np.abs(straight - moved(-x, -y)).max() < 1.5


@pytest.mark.parametrize(("x", "y"), [(60, 40), (-60, -40)])
def test_the_best_of_all_shifts_of_a_picture_turned_round(x: int, y: int) -> None:
    """As on a flight to and fro."""
    seen = GROUND[MARGIN + y : MARGIN + y + HEIGHT, MARGIN + x : MARGIN + x + WIDTH]
    _, turned = PixelPair(cut(0, 0), frame(seen[::-1, ::-1])).best_shifts()
    there = turned @ [120, 90, 1]
    assert np.abs(there[:2] - [WIDTH - 1 - (120 - x), HEIGHT - 1 - (90 - y)]).max() < 2.5


def everywhere(step: int) -> PointsNx2:
    return np.stack(np.meshgrid(np.arange(0, WIDTH, step), np.arange(0, HEIGHT, step)), -1).reshape(-1, 2).astype(float)


def test_pixels_beyond_what_matched_are_those_that_are_not_around_it() -> None:
    pair = PixelPair(cut(0, 0), cut(40, 20))
    found = pair.agreement(moved(-40, -20))
    assert found is not None
    whole = pair.evidence_beyond(found, NONE)
    corner = pair.evidence_beyond(found, everywhere(20)[:3] + np.array([100.0, 60.0]))
    assert whole == MOST
    assert corner == MOST
    assert pair.evidence_beyond(found, everywhere(10)) == 0.0
    nowhere = np.array([[math.nan, 3.0], [1e9, -1e9]])
    assert pair.evidence_beyond(found, nowhere) == whole


def test_beyond_a_look_alike_nothing_agrees() -> None:
    """Half of the picture is the same, the other half is of another place."""
    other = ground(5)[:HEIGHT, :WIDTH]
    half = GROUND[MARGIN : MARGIN + HEIGHT, MARGIN : MARGIN + WIDTH].copy()
    half[:, WIDTH // 2 :] = other[:, WIDTH // 2 :]
    pair = PixelPair(cut(0, 0), frame(half))
    found = Agreement(np.eye(3), 0.5, 5000, 0.1, LEAST_TOGETHER, 9.0, 3.0)
    matched = everywhere(10)
    assert pair.evidence_beyond(found, matched[matched[:, 0] < WIDTH / 2 + 10]) < 2
    assert pair.evidence_beyond(found, matched[matched[:, 0] > WIDTH / 2 - 10]) > 6


def test_the_finest_details_are_those_of_one_place_or_not() -> None:
    fine = np.random.default_rng(3).normal(0, 20, (HEIGHT, WIDTH))
    other = np.random.default_rng(4).normal(0, 20, (HEIGHT, WIDTH))
    wide = GROUND[MARGIN : MARGIN + HEIGHT, MARGIN : MARGIN + WIDTH]
    found = Agreement(np.eye(3), 0.9, 5000, 0.1, LEAST_TOGETHER, 9.0, 3.0)
    assert PixelPair(frame(wide + fine), frame(wide + fine)).finest(found) == pytest.approx(1.0, abs=0.01)
    assert abs(PixelPair(frame(wide / 4 + fine), frame(wide / 4 + other)).finest(found)) < 0.12


@pytest.mark.parametrize(("kept", "counted"), [(LEAST_OVERLAP - 1, 0), (LEAST_OVERLAP, LEAST_OVERLAP)])
def test_a_correlation_is_that_of_what_both_show(kept: int, counted: int) -> None:
    one = np.random.default_rng(0).normal(5, 1, (40, 50)).astype(np.float32)
    mask = np.zeros(one.shape, np.float32)
    mask.ravel()[:kept] = 1
    spoilt = np.where(mask > 0, one, 99.0).astype(np.float32)
    sign = 1.0 if counted else 0.0
    for other, expected in ((3 * spoilt + 7, sign), (-spoilt, -sign)):
        correlation, pixels = module._correlation(one, other, mask)
        assert correlation == pytest.approx(expected, abs=1e-5)
        assert pixels == counted
    assert module._correlation(one * 0, spoilt, mask)[0] == 0.0


def peak(correlation: float, runner_up: float, pixels: float = 3000.0) -> module._Peak:
    return module._Peak(np.zeros(2), 9.0, correlation, runner_up, pixels, 30.0)


def by_fisher(highest: float, second: float, independent: float) -> float:
    apart = (math.atanh(highest) - math.atanh(second)) / math.sqrt(2 / (independent - 3))
    return -math.log10(math.erfc(apart / math.sqrt(2)) / 2)


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        (peak(0.5, 0.1), by_fisher(0.5, 0.1, 100)),
        (peak(0.5, 0.5), math.log10(2)),
        (peak(0.5, -0.3), by_fisher(0.5, 0.0, 100)),
        (peak(0.5, 0.1, pixels=30.0), by_fisher(0.5, 0.1, 4)),
        (peak(1.0, 0.9), by_fisher(0.99, 0.9, 100)),
    ],
)
def test_the_odds_of_a_peak_are_those_of_two_correlations(found: module._Peak, expected: float) -> None:
    assert module._log_odds_of_peak(found, 30.0) == pytest.approx(expected)


def test_refinement_goes_on_until_the_corners_lie_right() -> None:
    """A proposal that is three per cent too large lays them four pixels off."""
    a, b = cut(0, 0), cut(40, 20)
    middle = moved(80, 70) @ np.diag([1.03, 1.03, 1.0]) @ moved(-80, -70)
    found = laid(a, b, middle @ moved(-40, -20))
    assert found is not None
    corners = np.array([[50.0, 30], [230, 30], [50, 170], [230, 170]])
    there = cv2.perspectiveTransform(corners[None], found.b_from_a)[0]
    assert np.abs(there - corners + [40, 20]).max() < 0.5


def test_sums_of_products_are_those_of_each_shift() -> None:
    """Of b with a shifted by so many pixels, 64 at most to any side."""
    pair = PixelPair(cut(0, 0), cut(40, 20))
    a, b = pair._a.image, pair._b.image
    found = pair._shifted_products(pair._b.spectrum, a)
    assert found.shape == (2 * REACH + 1, 2 * REACH + 1)
    for down, across in ((0, 0), (-5, 9), (30, -64)):
        moved_a = np.zeros_like(a)
        height, width = a.shape
        moved_a[max(down, 0) : height + min(down, 0), max(across, 0) : width + min(across, 0)] = a[
            max(-down, 0) : height - max(down, 0), max(-across, 0) : width - max(across, 0)
        ]
        assert found[down + REACH, across + REACH] == pytest.approx(float((moved_a * b).sum()), rel=1e-3, abs=50)
