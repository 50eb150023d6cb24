"""Scores a placements.json against the truth of a simulated flight.

An island is free in position, heading and scale, so each is first aligned to the truth by its best similarity transform.
Errors are in pixels of the median frame.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .geometry import Lens, pixels_from_ground
from .similarity import lengths, robust_similarity, similarity
from .truth import TrueFrame, Truth
from .warp import Floats, Placed, placed_frame

BEYOND = 1e5  # pixels; error assigned to a point mapped beyond the horizon


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """frames: all; placed: those on an island of two or more; alone: those on an island of their own.

    ortho_*: distance of a frame's grid points from their true ground position; pair_*: distance between the positions that
    two overlapping frames of one island give to one ground point; scale_*: a frame's scale relative to the truth (1 is
    correct). NaN where there is nothing to measure.
    """

    frames: int
    placed: int
    alone: int
    islands: int
    largest: int
    ortho_rmse: float
    ortho_median: float
    ortho_worst_frame: float  # RMSE of the worst placed frame
    pairs: int
    pair_median: float
    pair_p95: float
    scale_p5: float
    scale_p95: float
    unknown: tuple[str, ...]  # placed names missing in the truth

    def __str__(self) -> str:
        return (
            f"placed {self.placed}/{self.frames} alone {self.alone} islands {self.islands} largest {self.largest}"
            f" | ortho rmse {self.ortho_rmse:.2f} median {self.ortho_median:.2f} worst frame {self.ortho_worst_frame:.2f} px"
            f" | pair median {self.pair_median:.2f} p95 {self.pair_p95:.2f} px n={self.pairs}"
            f" | scale p5-95 {self.scale_p5:.4f}-{self.scale_p95:.4f}"
            + (f" | unknown names {len(self.unknown)}" if self.unknown else "")
        )


@dataclass(frozen=True, slots=True)
class Laid:
    """A placed frame with the alignment of its island to the truth."""

    true: TrueFrame
    placed: Placed
    ground_from_canvas: Floats  # 3x3 similarity

    def ground(self, pixels: Floats) -> Floats:
        canvas = self.placed.canvas(pixels)
        return np.asarray(canvas @ self.ground_from_canvas[:2, :2].T + self.ground_from_canvas[:2, 2])

    def distances(self) -> Floats:
        """Errors in metres of the used grid points."""
        used = self.true.grid_used
        return lengths(self.ground(self.true.grid_px[used]) - self.true.grid_ground[used])


def score(truth: Truth, placements: dict[str, Any]) -> Score:
    """placements: a parsed placements.json; frames are matched by full name, else by base name."""
    by_island, unknown = islands_of(truth, placements)
    groups = [lay(group) for group in by_island.values() if len(group) > 1]
    laid = [frame for group in groups for frame in group]
    gsd = truth.gsd  # a median over all frames
    errors = [capped(frame.distances() / gsd) for frame in laid]
    ortho = np.concatenate([*errors, np.empty(0)])
    pairs = np.concatenate(
        [*(capped(gaps / gsd) for group in groups for gaps in gaps_of(group, truth.lens)), np.empty(0)]
    )
    scales = np.array([relative_scale(frame) for frame in laid])
    return Score(
        frames=len(truth.frames),
        placed=len(laid),
        alone=sum(len(group) == 1 for group in by_island.values()),
        islands=len(groups),
        largest=max(map(len, groups), default=0),
        ortho_rmse=root_mean_square(ortho),
        ortho_median=quantile(ortho, 0.5),
        ortho_worst_frame=max((root_mean_square(error) for error in errors), default=float("nan")),
        pairs=len(pairs),
        pair_median=quantile(pairs, 0.5),
        pair_p95=quantile(pairs, 0.95),
        scale_p5=quantile(scales, 0.05),
        scale_p95=quantile(scales, 0.95),
        unknown=unknown,
    )


def islands_of(
    truth: Truth, placements: dict[str, Any]
) -> tuple[dict[int, list[tuple[TrueFrame, Placed]]], tuple[str, ...]]:
    """The known frames by island, and the names missing in the truth."""
    whole = {frame.name: frame for frame in truth.frames}
    counts = Counter(PurePosixPath(name).name for name in whole)
    base = {PurePosixPath(name).name: frame for name, frame in whole.items() if counts[PurePosixPath(name).name] == 1}
    islands: dict[int, list[tuple[TrueFrame, Placed]]] = {}
    unknown = []
    for entry in placements["frames"]:
        true = whole.get(entry["name"]) or base.get(PurePosixPath(entry["name"]).name)
        if true is None:
            unknown.append(entry["name"])
            continue
        placed = placed_frame(entry, np.array(truth.lens.centre))
        islands.setdefault(placed.island, []).append((true, placed))
    return islands, tuple(unknown)


def lay(group: list[tuple[TrueFrame, Placed]]) -> list[Laid]:
    """Align an island to the truth by the similarity that best fits its grid points."""
    canvas = np.concatenate([placed.canvas(true.grid_px[true.grid_used]) for true, placed in group])
    ground = np.concatenate([true.grid_ground[true.grid_used] for true, _ in group])
    known = np.isfinite(canvas).all(1)
    ground_from_canvas = robust_similarity(canvas[known], ground[known])
    return [Laid(true, placed, ground_from_canvas) for true, placed in group]


def gaps_of(group: list[Laid], lens: Lens) -> list[Floats]:
    """For every pair of overlapping frames: metres between the positions they give to the grid points of either."""
    return [gap(group[i], group[j], lens) for i, j in np.argwhere(meeting([frame.true for frame in group]))]


def meeting(frames: list[TrueFrame]) -> NDArray[np.bool_]:
    """(n, n): whether the bounding boxes of the ground seen by two different frames intersect."""
    seen = [frame.grid_ground[frame.grid_used] for frame in frames]
    low = np.array([ground.min(0, initial=np.inf) for ground in seen])
    high = np.array([ground.max(0, initial=-np.inf) for ground in seen])
    meets = ((low[:, None] < high[None]) & (low[None] < high[:, None])).all(-1)
    return np.asarray(meets & ~np.eye(len(frames), dtype=bool))


def gap(one: Laid, other: Laid, lens: Lens) -> Floats:
    """Metres between the positions given to those grid points of `one` that `other` also sees at a useful resolution."""
    used = one.true.grid_used
    ground, height = one.true.grid_ground[used], one.true.grid_height[used]
    seen = np.asarray(pixels_from_ground(lens, other.true.state, ground, height), np.float64)
    with np.errstate(invalid="ignore"):
        within = ((seen >= 0) & (seen <= [lens.width - 1, lens.height - 1])).all(1)
    inside = np.logical_and(within, counts_in(other.true, lens, seen))
    return lengths(one.ground(one.true.grid_px[used][inside]) - other.ground(seen[inside]))


def counts_in(true: TrueFrame, lens: Lens, pixels: Floats) -> NDArray[np.bool_]:
    """Mask of pixels (n, 2) whose nearest grid point of the frame is used."""
    if true.grid_used.all():
        return np.ones(len(pixels), np.bool_)
    reach = np.array([lens.width, lens.height]) / [8, 6]
    away = np.abs(np.nan_to_num(pixels, nan=1e9)[:, None] - true.grid_px[None]) / reach
    nearest = np.argmin(away.sum(-1), axis=1)
    return np.asarray(true.grid_used[nearest])


def relative_scale(frame: Laid) -> float:
    """Scale of the placed frame relative to the truth."""
    used = frame.true.grid_used
    ground = frame.ground(frame.true.grid_px[used])
    known = np.isfinite(ground).all(1)
    if known.sum() < 2:
        return float("nan")
    truth_from_laid = similarity(ground[known], frame.true.grid_ground[used][known], np.ones(int(known.sum())))
    return float(1 / np.hypot(truth_from_laid[0, 0], truth_from_laid[1, 0]))


def capped(errors: Floats) -> Floats:
    return np.minimum(np.nan_to_num(errors, nan=BEYOND), BEYOND)


def root_mean_square(values: Floats) -> float:
    return float(np.sqrt((values**2).mean())) if len(values) else float("nan")


def quantile(values: Floats, share: float) -> float:
    values = values[np.isfinite(values)]
    return float(np.quantile(values, share)) if len(values) else float("nan")
