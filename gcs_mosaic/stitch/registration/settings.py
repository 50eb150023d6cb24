"""When two frames are accepted as overlapping."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class RegistrationSettings:
    """When two frames are accepted as overlapping."""

    # ratio of the distances to the best and second-best match; RANSAC follows, so a loose test loses nothing
    ratio: float = 0.85
    threshold_px: float = 4.0  # tolerance of an inlier to relief and lens distortion, in pixels of the feature picture
    # -log10 of chance agreements expected per pair: one in 3,000 flights of 1,000 frames (30 pairs each)
    least_evidence: float = 8.0
    # share of the overlap that inliers confirm; true pairs 0.3 and more, copies of one house 0.2 and less
    least_confirmed: float = 0.25
    # log10 likelihood ratio of a true overlap, from features matched before: below this it is refused,
    least_odds_again: float = -0.5
    # from this on no other confirmation is needed: in woods a tenth of the overlap agrees, but nearly all features matched
    # before
    enough_odds_again: float = 1.0
    cell_px: float = 16.0  # inliers closer than this, in pixels of the feature picture, count as one
    largest_zoom: float = 5.0  # largest accepted change of scale between two frames
    # -log10 of the chance that pixels beyond the matches look as alike as they do: what no look-alike has
    least_beyond: float = 2.0
    # -log10 of the chance that another shift than the matches' is the right one, as pixels see it
    least_alone: float = 1.0
    enough_matches: int = 24  # inliers below which patches are sought as well; what an adjustment uses of a pair
