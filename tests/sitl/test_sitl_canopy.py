"""Leaves hide as much as was asked for, each look sees through other gaps, and wind moves them and not the ground."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from sitl.canopy import LEAVES, Canopy
from sitl.conifers import Conifers
from sitl.geometry import CameraState, Lens, rays_of_picture
from tests.tiers import thorough

LENS = Lens(width=200, height=160)
RAYS = rays_of_picture(LENS)
ABOVE = CameraState(time=0.0, x=3.0, y=-2.0, height=50.0)


@cache
def grown(hidden: float, sway: float = 0.2) -> Canopy:
    """Leaves take more than a second to grow; nothing here changes them."""
    return Canopy(hidden, sway=sway)


@pytest.mark.parametrize("hidden", [0.5, 0.7, 0.9])
def test_leaves_hide_as_much_of_the_ground_as_was_asked_for(hidden: float) -> None:
    canopy = grown(hidden)
    shares = [canopy.hides(replace(ABOVE, x=x, y=y), RAYS).mean() for x in (-60.0, 0.0, 60.0) for y in (-60.0, 60.0)]
    assert np.mean(shares) == pytest.approx(hidden, abs=0.05)  # outwards rays are longer in the leaves


@pytest.mark.long
@pytest.mark.parametrize("hidden", [thorough(0.5), 0.7])
def test_conifers_hide_as_much_as_was_asked_for_and_have_surfaces(hidden: float) -> None:
    """Leaves beside each other that a camera above sees lie as high, mostly to a metre."""
    trees = Conifers(hidden, lowest=3.0, highest=17.0)
    shares = [trees.hides(replace(ABOVE, x=x, y=y), RAYS).mean() for x in (-60.0, 0.0, 60.0) for y in (-60.0, 60.0)]
    assert np.mean(shares) == pytest.approx(hidden, abs=0.07)
    covers = np.asarray(np.stack([one for _, one in trees.levels]) > 0)
    is_leaf, level = np.asarray(covers.any(axis=0)), np.asarray(covers.argmax(axis=0))
    both = is_leaf[:, :-1] & is_leaf[:, 1:]
    assert np.median(np.abs(np.diff(level, axis=1))[both]) <= 1  # metres between texels beside each other


def test_what_is_hidden_is_leaves_and_what_is_open_is_ground() -> None:
    canopy, light = grown(0.7), np.full((160, 200, 3), 200, np.float32)
    canopy.cover(light, ABOVE, RAYS)
    hides = canopy.hides(ABOVE, RAYS)
    assert light[hides < 0.01].mean() > 195
    assert light[hides > 0.99].mean() < LEAVES.max()


def test_another_look_sees_through_other_gaps() -> None:
    canopy, there = grown(0.7), replace(ABOVE, x=15.0)
    ground = 50.0 / LENS.focal_px  # metres per pixel on the ground: 12 m are so many columns
    columns = round(12.0 / ground)
    one, other = canopy.hides(ABOVE, RAYS)[:, columns:], canopy.hides(there, RAYS)[:, :-columns]
    assert abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) < 0.3


def test_wind_moves_leaves() -> None:
    later = replace(ABOVE, time=1.3)
    still, moved = (grown(0.7, sway).hides(later, RAYS) for sway in (0.0, 0.2))
    assert np.abs(still - grown(0.7, 0.0).hides(ABOVE, RAYS)).max() == 0
    assert np.abs(still - moved).mean() > 0.01
