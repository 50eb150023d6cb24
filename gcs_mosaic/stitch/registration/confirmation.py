"""Whether the overlap bears a registration out: what both frames should show there was found in both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gcs_mosaic.stitch.arrays import Mask, Matrix3x3, PointsNx2
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.registration.a_contrario import Confirmed, confirmed, log_odds
from gcs_mosaic.stitch.registration.frame_pair import FramePair, MatchPart, frame_pair
from gcs_mosaic.stitch.registration.homography import area_scale, inside, mapped
from gcs_mosaic.stitch.registration.outcome import NO_MATCHES, NotRegistered, Registration
from gcs_mosaic.stitch.registration.settings import RegistrationSettings

ANY = np.True_
MOST_BEYOND = 1.0  # decades that pixels can speak against a look-alike: whole blocks of one make do exist
ENOUGH_CELLS = 3
EXPECTED_SHARE = 0.8  # of the cells with features matched before, that a true overlap confirms: 0.75 to 1 in woods
NOTHING = Confirmed(1.0, 0)
# Where the rest of the overlap is ground that is never found again, keypoints must prove by themselves what two look-alikes
# rarely do, and most of the other cells, which must be so many, agree.
PROVED, MOSTLY, TELLING_CELLS = 20.0, 0.5, 6


def borne_out(
    found: Registration, a: Features, b: Features, settings: RegistrationSettings, part_a: MatchPart, part_b: MatchPart
) -> Registration | NotRegistered:
    """A registration made before it was known what of the frames was matched before, contradicted or not, if the overlap bears
    it out; neither frame's descriptors are needed."""
    pair = frame_pair(a, b, part_a, part_b, NO_MATCHES)
    doubt = why_contradicted(pair, pair.reduced(found.b_from_a), found.agreeing_a / a.scale, settings, found.beyond)
    return NotRegistered(doubt, found.independent_inliers, found.pixels_a, found.pixels_b) if doubt else found


def borne_out_where_telling(
    doubted: NotRegistered,
    a: Features,
    b: Features,
    settings: RegistrationSettings,
    parts: tuple[MatchPart, MatchPart],
    telling: Callable[[], tuple[Mask, Mask]],
) -> Registration | NotRegistered:
    """What nothing but the rest of the overlap contradicts, if most of that agrees whose features are `telling` (n,), (m,): not
    on ground that is never found again."""
    found = doubted.contradicted
    if found is None or found.evidence < PROVED:
        return doubted
    pair = frame_pair(a, b, *parts, NO_MATCHES)
    overlap = _Overlap.of(pair, pair.reduced(found.b_from_a), found.agreeing_a / a.scale)
    if log_odds(overlap.confirmed_again(pair), EXPECTED_SHARE) < settings.least_odds_again:
        return doubted
    of_a, of_b = (one[part.chosen(of)] for one, part, of in zip(telling(), parts, (a, b), strict=True))
    most = overlap.confirmed(of_a, of_b)
    return found if most.cells >= TELLING_CELLS and most.share >= MOSTLY else doubted


def why_contradicted(
    pair: FramePair, homography: Matrix3x3, agreeing: PointsNx2, settings: RegistrationSettings, beyond: float = 0.0
) -> str:
    """Evidence against the overlap, or "": from features matched before if they suffice, else from all. `agreeing`: points
    (k, 2) of a that were matched; `beyond`: what the pixels say for it."""
    overlap = _Overlap.of(pair, homography, agreeing)
    again = overlap.confirmed_again(pair)
    odds = log_odds(again, EXPECTED_SHARE) + min(beyond, MOST_BEYOND)
    if odds < settings.least_odds_again:
        return f"only {again.share:.0%} of what was matched before agrees"
    share = overlap.confirmed(ANY, ANY).share
    if share < settings.least_confirmed and odds < settings.enough_odds_again:
        return f"only {share:.0%} of the overlap agrees"
    return ""


@dataclass(frozen=True, slots=True)
class _Overlap:
    """Features of both frames that the other should see, in pixels of a: `a` (n, 2) and a mask of them, `b` likewise."""

    a: PointsNx2
    b: PointsNx2
    inside_a: Mask
    inside_b: Mask
    agreeing: PointsNx2  # (k, 2)

    @classmethod
    def of(cls, pair: FramePair, homography: Matrix3x3, agreeing: PointsNx2) -> _Overlap:
        a_from_b = np.asarray(np.linalg.inv(homography), dtype=np.float64)
        places_b = mapped(a_from_b, pair.all_b)
        in_b = inside(mapped(homography, pair.all_a), pair.size_b) & (area_scale(homography, pair.all_a) > 0)
        in_a = inside(places_b, pair.size_a) & (area_scale(a_from_b, pair.all_b) > 0)
        return cls(pair.all_a, places_b, in_b, in_a, agreeing)

    def confirmed_again(self, pair: FramePair) -> Confirmed:
        """Confirmation among features matched before in both frames, or in one of them; no cells if there are too few."""
        for of_a, of_b in ((pair.again_a, pair.again_b), (ANY, pair.again_b), (pair.again_a, ANY)):
            again = self.confirmed(of_a, of_b)
            if again.cells >= ENOUGH_CELLS:
                return again
        return NOTHING

    def confirmed(self, of_a: Mask | np.bool_, of_b: Mask | np.bool_) -> Confirmed:
        """Confirmation of the overlap by matches, among these features."""
        return confirmed(self.a[self.inside_a & of_a], self.b[self.inside_b & of_b], self.agreeing)
