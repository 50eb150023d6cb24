"""Coefficients of the stated probability, fitted to looks, and how far what is stated is from what was found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize

from gcs_mosaic.detection.model import Coefficients, of_look, open_to_view, through_leaves, together
from tests.benchmarks.detection_reader import Looks
from tests.benchmarks.detection_scene import Floats

PER_LOOK = ("most", "offset", "contrast", "blur", "leaves_offset", "leaves", "leaves_share")
FLIGHT = 100_000  # numbers of people of a flight


def opened(looks: Looks, fitted: Coefficients) -> Floats:
    """As of `open_to_view`; where that is not known as of the same place's other looks, else as of the flight's."""
    found = open_to_view(looks.disagreement, looks.texture, fitted)
    known = np.isfinite(found)
    for whose in (looks.person, looks.person // FLIGHT):
        _, group = np.unique(whose, return_inverse=True)
        count = np.bincount(group, known)
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = np.bincount(group, np.where(known, found, 0)) / count
        found, known = np.where(known, found, mean[group]), known | (count[group] > 0)
    return np.where(known, found, 1.0)


def stated(looks: Looks, fitted: Coefficients) -> tuple[Floats, Floats]:
    """Of each person: the stated probability of all looks together, and whether the reader found it in any."""
    single = 0.5 * sum(of_look(one, looks.kept, fitted) for one in (looks.in_sun, looks.in_shade))
    is_open = opened(looks, fitted)
    _, whose = np.unique(looks.person, return_inverse=True)
    count = whose.max() + 1
    best, missed, found = np.zeros(count), np.zeros(count), np.zeros(count)
    np.maximum.at(best, whose, single)
    np.add.at(missed, whose, np.log1p(-np.minimum(single, 1 - 1e-9)))
    np.maximum.at(found, whose, looks.found)
    mean_open = np.bincount(whose, is_open) / np.bincount(whose)
    pairs = np.unique(np.stack([whose, looks.direction], axis=-1), axis=0)
    directions = np.bincount(pairs[:, 0].astype(int), minlength=count)
    seen = through_leaves(mean_open, np.asarray(directions, np.float64), fitted)
    return np.asarray(together(best, missed, fitted) * seen), found


def fit(looks: Looks) -> Coefficients:
    """By maximum likelihood: first each look by itself, then how they come together."""
    start = np.array([0.9, -1.5, 2.5, 2.5, 4.0, -1.5, -0.7])

    def of_one(values: Floats) -> Coefficients:
        return Coefficients(**dict(zip(PER_LOOK, values.tolist(), strict=True)), again=0.5, through=0.5)

    def single_cost(values: Floats) -> float:
        one = of_one(values)
        if not 0 < one.most <= 1:
            return 1e3
        chance = 0.5 * sum(of_look(each, looks.kept, one) for each in (looks.in_sun, looks.in_shade))
        chance = chance * opened(looks, one)
        return _cost(chance, looks.found) + 1e-4 * float((values - start) @ (values - start))

    one = of_one(minimize(single_cost, start, method="Nelder-Mead", options={"maxiter": 4000, "maxfev": 4000}).x)

    def joint_cost(values: Floats) -> float:
        again, through = 1 / (1 + np.exp(-values))
        return _cost(*stated(looks, replace(one, again=float(again), through=float(through))))

    again, through = 1 / (1 + np.exp(-minimize(joint_cost, np.zeros(2), method="Nelder-Mead").x))
    return replace(one, again=float(again), through=float(through))


def _cost(chance: Floats, found: Floats) -> float:
    chance = np.clip(chance, 1e-3, 1 - 1e-3)
    return -float(np.mean(found * np.log(chance) + (1 - found) * np.log(1 - chance)))


def reliability(chance: Floats, found: Floats) -> list[tuple[float, float, int]]:
    """For each tenth: stated, found, how many."""
    tenth = np.minimum((chance * 10).astype(int), 9)
    return [
        (float(chance[tenth == k].mean()), float(found[tenth == k].mean()), int((tenth == k).sum()))
        for k in range(10)
        if (tenth == k).any()
    ]


def error_of(rows: Sequence[tuple[float, float, int]]) -> float:
    """The mean distance of stated and found, each person counting once (expected calibration error)."""
    return sum(count * abs(one - other) for one, other, count in rows) / sum(count for *_, count in rows)


def told(name: str, looks: Looks, fitted: Coefficients) -> str:
    chance, found = stated(looks, fitted)
    rows = reliability(chance, found)
    lines = [f"{name}: {len(chance)} people, stated {chance.mean():.0%}, found {found.mean():.0%}"]
    lines += [f"  stated {one:4.0%} found {other:4.0%}, of {count}" for one, other, count in rows]
    return "\n".join([*lines, f"  error {100 * error_of(rows):.1f} points"])


def by_flight(looks: Looks, fitted: Coefficients) -> list[tuple[float, float]]:
    """Stated and found, means over the people of each flight."""
    chance, found = stated(looks, fitted)
    flight = np.unique(looks.person) // FLIGHT
    return [(float(chance[flight == one].mean()), float(found[flight == one].mean())) for one in np.unique(flight)]
