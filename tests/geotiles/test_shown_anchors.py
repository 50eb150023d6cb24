"""Which anchor other maps show: it stays while it is good, and moves when that is worth it."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from gcs_mosaic.geo.anchor import Anchor
from gcs_mosaic.geo.positions import PositionedMap, anchored_by_positions
from gcs_mosaic.geotiles import shown_anchors
from gcs_mosaic.geotiles.shown_anchors import AnchorFollower, FittedIsland, ShownAnchors, is_worth_it
from gcs_mosaic.render.tile_grid import Box
from tests.geo.test_positions import PLANE, Flight, Receiver, flight
from tests.geotiles.ground import anchor

BOX = (-1000.0, -1000.0, 1000.0, 1000.0)


def laid(moved_m: float = 0.0, variance: float = 4.0, given: object = "positions") -> FittedIsland:
    """Off to the east, with a stated error of some 4.9 m."""
    found = replace(
        anchor(middle=complex(moved_m)), covariance=tuple(map(tuple, np.diag([1e-12, 1e-12, variance, variance])))
    )
    return FittedIsland(found, BOX, str(given))


def test_a_fit_that_lies_a_little_elsewhere_changes_nothing() -> None:
    first = ShownAnchors().after({0: laid()})
    assert (first.revision, set(first.anchors)) == (1, {0})
    assert first.after({0: laid(1.5)}) is first
    assert first.after({0: laid(1.5)}).after({0: laid(1.7)}).revision == 2
    assert first.after({0: laid(-1.7)}).anchors[0].shift.real == pytest.approx(-1.7)


def test_one_whose_stated_error_is_another_replaces_it() -> None:
    first = ShownAnchors().after({0: laid()})
    for factor, revision in ((0.8, 1), (0.7, 2), (1.3, 1), (1.4, 2)):
        assert first.after({0: laid(variance=4.0 * factor**2)}).revision == revision


def test_what_people_change_is_shown_at_once() -> None:
    first = ShownAnchors().after({0: laid(given=(1, 2))})
    second = first.after({0: laid(0.1, given=(1, 2, 3))})
    assert second.revision == 2
    assert second.anchors[0].shift.real == pytest.approx(0.1)


def test_an_island_that_joins_another_vanishes_with_its_anchor() -> None:
    both = ShownAnchors().after({0: laid(), 1: laid()})
    joined = both.after({0: laid()})
    assert (joined.revision, set(joined.anchors)) == (2, {0})
    assert joined.after({}).anchors == {}


def test_small_steps_do_not_add_up_unseen() -> None:
    """Fits that creep in one direction are followed, each time what is shown has fallen behind by a third of the error."""
    shown, moves = ShownAnchors(), []
    for at in range(60):
        shown = shown.after({0: laid(0.2 * at)})
        moves.append(abs(shown.anchors[0].shift.real - 0.2 * at))
    assert max(moves) <= 4.9 / 3
    assert shown.revision == 1 + 60 // 9


def test_the_same_fits_lead_to_the_same_and_so_from_several_threads() -> None:
    fits = [{0: laid(0.4 * (at % 7)), 1: laid(0.9 * at)} for at in range(40)]
    ends = []
    for _ in range(2):
        shown = ShownAnchors()
        for fit in fits:
            shown = shown.after(fit)
        ends.append(shown)
    assert ends[0] == ends[1]
    follower = AnchorFollower()
    with ThreadPoolExecutor(8) as pool:
        revisions = [one.revision for one in pool.map(follower.follow, fits[:1] * 200)]
    assert set(revisions) == {1}


@cache
def fits_of(seed: int) -> tuple[Flight, list[tuple[Anchor, Box]]]:
    """A flight, and its anchors as they are fitted while it goes on, each with the box of the map at that time."""
    flown = flight(seed, Receiver(), 300.0, 200.0, 75)
    found = []
    for count in range(8, 76, 3):
        result = anchored_by_positions(flown.shots[:count])
        if isinstance(result, PositionedMap):
            places = np.array([[shot.x, shot.y] for shot in flown.shots[:count]])
            (left, top), (right, bottom) = places.min(axis=0).tolist(), places.max(axis=0).tolist()
            found.append((result.anchor, (left - 400, top - 400, right + 400, bottom + 400)))
    return flown, found


def worst_corner_m(flown: Flight, shown: Anchor, box: Box) -> float:
    """How far the frame that lies worst of those in a box is from where it truly is."""
    inside = [at for at, shot in enumerate(flown.shots) if box[0] < shot.x < box[2] and box[1] < shot.y < box[3]]
    places = np.array([[flown.shots[at].x, flown.shots[at].y] for at in inside])
    return float(np.linalg.norm(PLANE.spots(shown.places(places)) - flown.true_m[inside], axis=1).max())


def swept(share: float, monkeypatch: pytest.MonkeyPatch) -> tuple[float, float]:
    """Of some flights: the share of fits that moved the map, and its worst corner's error by that of the newest fit."""
    monkeypatch.setattr(shown_anchors, "MOVED_SHARE", share)
    moves, fits, behind = 0, 0, []
    for seed in range(4):
        flown, found = fits_of(seed)
        shown = found[0][0]
        for fit, box in found[1:]:
            is_new = is_worth_it(shown, fit, box)
            shown = fit if is_new else shown
            moves, fits = moves + is_new, fits + 1
            behind.append(worst_corner_m(flown, shown, box) / worst_corner_m(flown, fit, box))
    return moves / fits, math.exp(float(np.mean(np.log(behind))))


@pytest.mark.thorough
@pytest.mark.long
def test_a_third_of_the_stated_error_is_where_the_map_stands_still_and_loses_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Simulated flights whose receiver is off by 3 m for a minute. By less than a third the map moves more often, and its worst
    corner is no nearer to the truth; by more it moves as often, because stated errors fall."""
    always, twelfth, third, whole = (swept(share, monkeypatch) for share in (0.0, 1 / 12, 1 / 3, 1.0))
    assert always == (1.0, 1.0)
    assert third[0] < 0.2
    assert twelfth[0] > 1.5 * third[0]
    assert whole[0] > 0.6 * third[0]
    assert third[1] < 1.1
