"""From what is known of a look to the probability that a person is found: a cumulative normal of two physical quantities (of
logs, as in psychophysics), times the chance that no leaves are before it; and what several looks come to together.

Fitted to simulated flights (`python -m tests.benchmarks.detection --fit`), with a reader of fixed rule: what `clutter.scores`
tells above a threshold that ground without people exceeds once in `EACH` places.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path

import numpy as np

from gcs_mosaic.stitch.arrays import Array

TABLE = Path(__file__).parent / "coefficients.json"
EACH = 2000  # places of a person's size, of which the reader takes one for a person
DIRECTION_DEG = 4.0  # looks from one such square of directions see through the same gaps between leaves
LEAST_SHARE = 0.01  # of the texture that looks do not have in common: less, or all but so much, cannot be told
WHOLE_PX = 1.5  # a person who is smaller fills no pixel
LEAST_DISAGREEMENT = 0.5  # of L*: less is noise


@dataclass(frozen=True, slots=True, kw_only=True)
class Coefficients:
    """`most`, `offset`, `contrast`, `blur`: of a look; `leaves`: of disagreement between looks, and of the odds of its share of
    the texture; `again`: how much another look in the open counts beside the best one, `through`: another direction through
    leaves, 0 to 1."""

    most: float
    offset: float
    contrast: float
    blur: float
    leaves_offset: float
    leaves: float
    leaves_share: float
    again: float
    through: float


@cache
def coefficients() -> Coefficients:
    """As they were fitted."""
    return Coefficients(**json.loads(TABLE.read_text(encoding="utf-8")))


def written(fitted: Coefficients) -> str:
    """The text of the table."""
    return json.dumps({name: round(value, 3) for name, value in asdict(fitted).items()}, indent=2) + "\n"


def kept_contrast(side_px: Array, sharpness: Array) -> Array:
    """Natural log of the share of a person's contrast that blur leaves. A picture that is half as sharp is smeared over about two
    pixels; `side_px` of the person, `sharpness` as a share of the pictures around."""
    side = np.maximum(side_px, 0.1)
    smeared = 1 / (np.maximum(sharpness, 0.05) * side)
    mixed = 2 * np.log(np.minimum(side / WHOLE_PX, 1.0))  # the share of the fullest pixel
    return np.asarray(mixed - 0.5 * np.log1p(smeared**2))


def of_look(to_clutter: Array, kept: Array, fitted: Coefficients) -> Array:
    """That a look in the open finds a person. `to_clutter`: its contrast beside what the ground shows by itself; `kept`: as of
    `kept_contrast`."""
    value = fitted.offset + fitted.contrast * np.log(np.maximum(to_clutter, 1e-3)) + fitted.blur * kept
    return np.asarray(fitted.most * _normal(value))


def open_to_view(disagreement: Array, texture: Array, fitted: Coefficients) -> Array:
    """That nothing is before a person, by how much two looks differ there, and how much the ground does from place to place
    (deviations of L*); NaN where that is not known."""
    differs = np.maximum(disagreement, LEAST_DISAGREEMENT)
    share = np.clip(differs**2 / (2 * texture**2 + LEAST_DISAGREEMENT**2), LEAST_SHARE, 1 - LEAST_SHARE)
    odds = np.log(share / (1 - share))
    return _logistic(fitted.leaves_offset + fitted.leaves * np.log(differs) + fitted.leaves_share * odds)


def together(best: Array, log_missed: Array, fitted: Coefficients) -> Array:
    """That any of several looks in the open finds it. They look at the same clothes on the same ground: what one misses the next
    often misses, too. `best`: the highest probability of one; `log_missed`: sum of log(1 - probability) of all."""
    alone = np.log1p(-np.minimum(best, 1 - 1e-9))
    return np.asarray(-np.expm1(alone + fitted.again * (log_missed - alone)))


def through_leaves(is_open: Array, directions: Array, fitted: Coefficients) -> Array:
    """That a place is seen through leaves from any of several directions."""
    return np.asarray(1 - (1 - is_open) ** (1 + fitted.through * (np.maximum(directions, 1) - 1)))


def _logistic(value: Array) -> Array:
    return np.asarray(1 / (1 + np.exp(-np.clip(value, -40, 40))))


def _normal(value: Array) -> Array:
    """The cumulative normal, exact to 2e-4 (E. Page, Applied Statistics 26(1), 1977)."""
    return _logistic(1.5976 * value + 0.070566 * value**3)
