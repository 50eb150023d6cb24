"""Links between frames, of all the shapes that a flight may have and of some that it should not, and equations of such."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from scipy.spatial import cKDTree

from gcs_mosaic.stitch.arrays import Array, IndexPairsNx2, Matrix, PointsNx2
from gcs_mosaic.stitch.bundle.normal_equations import Normal, add_pairs, blank, layout_of
from gcs_mosaic.stitch.bundle.problem import COLUMNS, Problem
from gcs_mosaic.stitch.camera.projection import LENS_TERMS

NONE = np.empty((0, 2), np.intp)


def near(places: PointsNx2, links: int = 7) -> IndexPairsNx2:
    """Each frame with so many that are nearest."""
    _, found = cKDTree(places).query(places, k=links + 1)
    pairs = np.column_stack([np.arange(len(places)).repeat(links), found[:, 1:].ravel()])
    return np.unique(np.sort(pairs, axis=1), axis=0)


def all_of(frames: int) -> IndexPairsNx2:
    """Each two frames."""
    return np.array(list(combinations(range(frames), 2)), dtype=np.intp)


def chain_of(frames: int) -> IndexPairsNx2:
    return np.column_stack([np.arange(frames - 1), np.arange(1, frames)])


def shapes(frames: int = 600) -> dict[str, tuple[IndexPairsNx2, PointsNx2]]:
    """Links (m, 2) and places (n, 2), by what they are like."""
    rng = np.random.default_rng(5)
    places, elsewhere = rng.uniform(size=(frames, 2)), rng.uniform(size=(frames, 2))
    line = np.column_stack([np.arange(float(frames)), np.zeros(frames)])
    survey, few = near(places), all_of(60)
    return {
        "a survey": (survey, places),
        "a survey with wrong places": (survey, elsewhere),
        "a survey with one place for all": (survey, np.zeros((frames, 2))),
        "three surveys": (near(places + 10 * (np.arange(frames) % 3)[:, None]), places),
        "a survey and frames without links": (survey[(survey < 0.8 * frames).all(axis=1)], places),
        "a chain": (chain_of(frames), line),
        "a chain with wrong places": (chain_of(frames), elsewhere),
        "a star": (np.column_stack([np.zeros(frames - 1, np.intp), np.arange(1, frames)]), places),
        "frames that all overlap": (all_of(80), places[:80]),
        "two sets of such, with one link": (np.concatenate([few, few + 60, [[3, 99]]]), places[:120]),
        "links of no order": (all_of(80)[rng.random(3160) < 0.15], places[:80]),
        "frames without links": (NONE, places),
        "two frames": (chain_of(2), places[:2]),
        "one frame": (NONE, places[:1]),
        "no frame": (NONE, places[:0]),
    }


def problem_with(links: IndexPairsNx2, places: PointsNx2, cameras: int = 1) -> Problem:
    """A problem with these links and no matches yet."""
    n, p = len(places), len(links)
    return Problem(
        poses=np.column_stack([places, np.zeros((n, 4))]),
        lenses=np.zeros((cameras, LENS_TERMS)),
        camera=np.arange(n) % cameras,
        half_diagonal=np.ones(cameras),
        unit_px=np.ones(cameras),
        pairs=links,
        pixels_a=np.zeros((p, 1, 2)),
        pixels_b=np.zeros((p, 1, 2)),
        present=np.zeros((p, 1), bool),
        free=np.ones(n, bool),
    )


def contributions(problem: Problem, rows: int = 30) -> tuple[Array, Array]:
    """Blocks and slopes of pairs as random matches would make them."""
    rng = np.random.default_rng(7)
    derivatives = rng.normal(size=(len(problem.pairs), rows, COLUMNS)) * np.exp(rng.normal(size=COLUMNS))
    residuals = rng.normal(size=(len(problem.pairs), rows))
    return np.einsum("pri,prj->pij", derivatives, derivatives), np.einsum("pri,pr->pi", derivatives, residuals)


def equations_of(problem: Problem, rows: int = 30) -> tuple[Normal, Matrix]:
    normal, gradient = blank(layout_of(problem))
    add_pairs(normal, gradient, slice(None), *contributions(problem, rows))
    return normal, gradient
