"""Steps of a thermal camera's counts: by how much, and in which scale, those of a frame differ from the camera's usual ones.

Its gain mode, its shutter (a flat-field correction) and its own warmth move all counts of a frame by hundreds, or stretch them.
What two frames see of the same ground tells both: the difference of the means is the offset, the ratio of what they span the
scale. Most frames have none, so frames are held at their own counts, but by a prior (Cauchy's) that lets go of those for which
the overlaps tell otherwise. A scale counts only where it is certain: it would add up along a flight.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, diags
from scipy.sparse.linalg import spsolve

from gcs_mosaic.stitch.arrays import FloatImage, Vector

INNER = (0.1, 0.9)  # quantiles; what moves, or is far hotter than all around, lies beyond them in either frame
FULL_TRUST = 200  # thumbnail px of overlap that have half the weight of an infinite overlap
PX_PER_SAMPLE = 30  # thumbnail px that are as good as one independent one
LEAST_ALIKE = 0.7  # correlation of the two pictures; less is noise, or heights
LEAST_SCALE = 0.15  # log; less is not seen
SURE = 5.0  # deviations by which a scale must differ from 1
OFFSET_SIGMA = 0.02  # of what a frame spans: deviation between the means of an overlap, of either's counts
SCALE_SIGMA = 0.001  # log; small, for what is not certain counts as none and adds up to nothing
SCALE_PRIOR = 0.1  # log, deviation of most frames' scales
TURNS = 8  # of the reweighting; each moves less than the one before


@dataclass(frozen=True, slots=True)
class CountsInOverlap:
    """What two frames i and j see in common, by band: mean counts, log of what j's counts span relative to i's, 0 where it is not
    certain; and the size in thumbnail pixels."""

    mean_i: tuple[float, ...]
    mean_j: tuple[float, ...]
    log_scale: tuple[float, ...]
    count: int


@dataclass(frozen=True, slots=True)
class CountStep:
    """What a frame's counts are multiplied by, and what is added, to be the camera's usual ones; by band."""

    scale: tuple[float, ...]
    offset: tuple[float, ...]


def no_step(bands: int) -> CountStep:
    return CountStep((1.0,) * bands, (0.0,) * bands)


def counts_in_overlap(pixels_i: FloatImage, pixels_j: FloatImage) -> CountsInOverlap | None:
    """From the counts (n, bands) of the pixels that two frames share; None with too few."""
    if len(pixels_i) < 2 * PX_PER_SAMPLE:
        return None
    both = [_of_band(pixels_i[:, band], pixels_j[:, band]) for band in range(pixels_i.shape[1])]
    mean_i, mean_j, log_scale = zip(*both, strict=True)
    return CountsInOverlap(mean_i, mean_j, log_scale, len(pixels_i))


def _of_band(i: FloatImage, j: FloatImage) -> tuple[float, float, float]:
    (low_i, high_i), (low_j, high_j) = np.quantile(i, INNER), np.quantile(j, INNER)
    inner = (i >= low_i) & (i <= high_i) & (j >= low_j) & (j <= high_j)
    if not inner.any():
        inner[:] = True
    means = float(i[inner].mean()), float(j[inner].mean())
    span_i, span_j = float(high_i - low_i), float(high_j - low_j)
    if min(span_i, span_j, float(i.std()), float(j.std())) <= 0:
        return *means, 0.0
    alike = float(np.corrcoef(i, j)[0, 1])
    log_scale = float(np.log(span_j / span_i))
    deviation = np.sqrt(max(1 - alike**2, 1e-3) * PX_PER_SAMPLE / len(i))
    sure = alike > LEAST_ALIKE and abs(log_scale) > max(LEAST_SCALE, SURE * deviation)
    return *means, log_scale if sure else 0.0


def step_beside(seen: Sequence[tuple[CountsInOverlap, CountStep]], bands: int) -> CountStep:
    """The step of a new frame i beside frames j with known ones; none without overlaps."""
    if not seen:
        return no_step(bands)
    trust = np.array([_trust(one.count) for one, _ in seen])
    known = np.log([step.scale for _, step in seen])
    scale = np.exp(trust @ (known + [one.log_scale for one, _ in seen]) / trust.sum())
    wanted = [
        np.array(step.scale) * one.mean_j + np.array(step.offset) - scale * np.array(one.mean_i) for one, step in seen
    ]
    return CountStep(tuple(scale.tolist()), tuple((trust @ np.array(wanted) / trust.sum()).tolist()))


def agreed_steps(
    spans: Mapping[str, Sequence[float]],
    seen: Sequence[tuple[str, str, CountsInOverlap]],
    present: Mapping[str, CountStep] | None = None,
) -> dict[str, CountStep]:
    """The step of each frame of a camera from all overlaps between them; `spans`: what each frame's counts span, by band.
    `present`: the steps known so far, which stay as far as all of them together can."""
    names = {name: number for number, name in enumerate(spans)}
    at = np.array([(names[i], names[j]) for i, j, _ in seen], np.intp).reshape(-1, 2)
    usual = np.median(list(spans.values()), axis=0).tolist()
    before = [(present or {}).get(name, no_step(len(usual))) for name in names]
    scales, offsets = np.ones((len(names), len(usual))), np.zeros((len(names), len(usual)))
    trust = np.array([_trust(one.count) for _, _, one in seen])
    for band, span in enumerate(usual):
        means = np.array([(one.mean_i[band], one.mean_j[band]) for _, _, one in seen]).reshape(-1, 2)
        logs = np.array([one.log_scale[band] for _, _, one in seen])
        if logs.any():
            log_scale = _held(at, logs, trust / SCALE_SIGMA**2, len(names), SCALE_PRIOR)
            scales[:, band] = np.exp(_as_before(log_scale, np.log([one.scale[band] for one in before])))
        wanted = scales[at[:, 1], band] * means[:, 1] - scales[at[:, 0], band] * means[:, 0]
        offset = _held(at, wanted, trust / (OFFSET_SIGMA * max(span, 1.0)) ** 2, len(names), max(span, 1.0))
        offsets[:, band] = _as_before(offset, np.array([one.offset[band] for one in before]))
    return {name: CountStep(tuple(scales[k].tolist()), tuple(offsets[k].tolist())) for name, k in names.items()}


def _as_before(values: Vector, before: Vector) -> Vector:
    """Values of which only the differences are known, all shifted so that most are as before."""
    return np.asarray(values - np.median(values - before))


def _held(at: NDArray[np.intp], wanted: Vector, weight: Vector, count: int, prior: float) -> Vector:
    """Values (count,) whose differences between pairs `at` (n, 2) are as `wanted` (n,), each held at 0 by Cauchy's prior."""
    if not len(at):
        return np.zeros(count)
    rows, ones = np.arange(len(at)), np.ones(len(at))
    places = np.r_[rows, rows], np.r_[at[:, 0], at[:, 1]]
    differences = coo_matrix((np.r_[ones, -ones], places), (len(at), count)).tocsr()
    weighted = differences.T @ diags(weight)
    values = np.zeros(count)
    for turn in range(TURNS):
        held = 1 / (1 + (values / prior) ** 2) / prior**2 if turn else np.full(count, 1e-6 / prior**2)
        values = np.asarray(spsolve((weighted @ differences + diags(held)).tocsc(), weighted @ wanted))
    return values


def _trust(count: int) -> float:
    return count / (count + FULL_TRUST)
