"""What the product's blending modes are compared with: the mean of all frames, and the paper's alpha blend as it stands.

Portakal, Kındıroğlu, Uluyağmur Öztürk, "Real Time Incremental Image Mosaicking Without Use of Any Camera Parameter", section
III.D: a weighted sum in which a pixel weighs more the farther it is from its frame's border; where edges are dense the new
frame's weight is raised. The paper gives no number for that; the product's own factor is taken.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.render.blending import LEAST_WEIGHT
from gcs_mosaic.render.edges import BOOST
from tests.benchmarks.painted_flights import Seen

Colours = NDArray[np.float32]
Reference = Callable[[Sequence[Seen]], Colours]


def average(frames: Sequence[Seen]) -> Colours:
    """(h, w, 3): the mean of all frames that see a place; 0 where none does."""
    total = np.sum([frame.colour * frame.covered[..., None].astype(np.float32) for frame in frames], axis=0)
    count = np.sum([frame.covered for frame in frames], axis=0)[..., None]
    return np.asarray(total / np.maximum(count, 1), np.float32)


def alpha(frames: Sequence[Seen]) -> Colours:
    """(h, w, 3): the paper's blend of these frames in capture order."""
    height, width = frames[0].covered.shape
    shown, weight = np.zeros((height, width, 3), np.float32), np.zeros((height, width), np.float32)
    covered = np.zeros((height, width), np.bool_)
    for frame in frames:
        raised = np.maximum(frame.weight, LEAST_WEIGHT) * (1 + (BOOST - 1) * frame.density)
        share = np.where(covered, raised / (raised + np.maximum(weight, LEAST_WEIGHT)), 1)
        share = np.where(frame.covered, share, 0)[..., None]
        shown += np.float32(share) * (frame.colour - shown)
        weight = np.where(frame.covered, np.maximum(weight, frame.weight), weight)
        covered |= frame.covered
    return shown


REFERENCES: dict[str, Reference] = {"average": average, "alpha (paper)": alpha}
