"""Pairwise registration: what may lay one frame on the other, and the evidence that it is neither accident nor look-alike.

Two witnesses are heard. Keypoints: how many agree with one homography or similarity (`a_contrario`), and whether the rest of the
overlap confirms it. Pixels: whether the two pictures look alike there (`agreement`), and look alike beyond what matched. Their
evidence is added, in decades; the pixels are only asked where keypoints alone do not suffice.

MAGSAC++: Barath et al., CVPR 2020 (in OpenCV as USAC_MAGSAC).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from gcs_mosaic.stitch.arrays import IndexPairsNx2, Indices, Mask, Matrix3x3, PointsNx2, Vector, Vector2
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.features.fixed_pattern import moving
from gcs_mosaic.stitch.features.learned import RATIO
from gcs_mosaic.stitch.features.matching import match
from gcs_mosaic.stitch.registration.a_contrario import (
    SAMPLE,
    SAMPLE_OF_SIMILARITY,
    Confirmed,
    cell_numbers,
    chance_of_agreement,
    confirmed,
    log_evidence,
    log_odds,
)
from gcs_mosaic.stitch.registration.agreement import Agreement, PixelPair
from gcs_mosaic.stitch.registration.parallax import displaced_by_height
from gcs_mosaic.stitch.registration.patches import Patches, patches

HYPOTHESES = 3  # homographies tried: a look-alike elsewhere, or burnt-in text, can outnumber the ground's inliers
SIMILARITIES = 3  # tried; of few and rough matches two determine one, where four wrong ones make a homography
SIMILARITY_PX = 2.0  # tolerance of its inliers, in those of a homography: relief, tilt and lens are in it
# Correlation of the finest details above which keypoints, which are made of them, would match again: over woods and cold fields,
# where few do, it is 0.12 and less; blocks of one make and their neighbours, whose keypoints differ, have 0.18 to 0.40.
MOST_FINEST = 0.16
ALIKE = 0.7  # the same of coarse textures: woods that agree so well have 60 independent inliers and more
DETAILED = 1300  # features per megapixel of a feature picture with details everywhere
BLURRED = 1.5  # ratio of `sharpness`: a picture that is less sharp by so much has lost the other's details
# Of the diagonal: as far as crowns are displaced that stand a quarter of the flying height tall, at 50 % overlap.
SAME_PLACE = 0.12
# Decades of evidence below which a proposal is chance: it is not worth a look. Of 190 that proved right one had less, -4.8.
LEAST_PROPOSED = -4.0
SAME_PROPOSAL = 0.05  # of the diagonal: nearer ones are drawn to the same peak of the pixels
# Ratio of magnifications of two corners in a proposal: a frame 55 degrees up against one straight down.
MOST_SLANT = 4.5
NEAR_BY_PIXELS = 3.0  # tolerances by which a match may be off a homography that coarse pictures have told
# Decades for the best of all shifts: some ten thousand are tried, but frames in sequence overlap a hundred times more often.
ANYWHERE = -2.0
FEWEST = 8  # matches and patches in distinct cells that lay one frame on another
NO_MATCHES = np.empty((0, 2), np.intp)
NO_PIXELS: PointsNx2 = np.empty((0, 2))


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


@dataclass(frozen=True, slots=True)
class Registration:
    """Two overlapping frames: pixels of each that show the same ground, (m + p, 2) in full resolution, and b_from_a (3x3).

    The first m are inliers, with their `features`; the others are patches of the pictures.
    """

    pixels_a: PointsNx2
    pixels_b: PointsNx2
    features: IndexPairsNx2  # (m, 2) feature indices of the inliers in a and b
    b_from_a: Matrix3x3
    independent_inliers: int
    evidence: float  # -log10 of the expected number of equally good chance agreements
    displaced_a: PointsNx2 = field(default_factory=lambda: NO_PIXELS)  # matches off the plane, explained by parallax
    displaced_b: PointsNx2 = field(default_factory=lambda: NO_PIXELS)
    tentative: IndexPairsNx2 = field(default_factory=lambda: NO_MATCHES)  # (k, 2) feature indices, inliers or not
    beyond: float = 0.0  # evidence of the pixels that are not around matches; 0 where they were not asked

    def turned(self) -> Registration:
        """The same registration with the frames exchanged."""
        a_from_b = np.asarray(np.linalg.inv(self.b_from_a), dtype=np.float64)
        turned = replace(self, features=self.features[:, ::-1], tentative=self.tentative[:, ::-1])
        turned = replace(turned, displaced_a=self.displaced_b, displaced_b=self.displaced_a)
        return replace(turned, pixels_a=self.pixels_b, pixels_b=self.pixels_a, b_from_a=a_from_b)

    @property
    def agreeing_a(self) -> PointsNx2:
        """Pixels (m + p + k, 2) of frame a that were found in b, on the plane or off it."""
        return np.concatenate([self.pixels_a, self.displaced_a])


@dataclass(frozen=True, slots=True)
class NotRegistered:
    """Two frames not shown to overlap, and why; the pixels (m, 2) each that agreed nevertheless. `contradicted`: the overlap with
    most agreement, if nothing but what the frames show besides speaks against it."""

    reason: str
    inliers: int
    pixels_a: PointsNx2
    pixels_b: PointsNx2
    contradicted: Registration | None = None


@dataclass(frozen=True, slots=True)
class _Pair:
    """Two frames in pixels of their feature pictures: all their features (n, 2), (m, 2), and the matches (k, 2)."""

    all_a: PointsNx2
    all_b: PointsNx2
    size_a: Vector2
    size_b: Vector2
    scale_a: float  # full-resolution pixels per pixel of the feature picture
    scale_b: float
    matches: IndexPairsNx2
    features: IndexPairsNx2  # (k, 2) the matches as indices into all features of either frame
    again_a: Mask  # (n,) features matched before, see `register`
    again_b: Mask  # (m,)

    @property
    def a(self) -> PointsNx2:
        return self.all_a[self.matches[:, 0]]

    @property
    def b(self) -> PointsNx2:
        return self.all_b[self.matches[:, 1]]

    def reduced(self, b_from_a: Matrix3x3) -> Matrix3x3:
        """A homography between full-resolution pixels as one between pixels of the feature pictures."""
        return np.diag([1 / self.scale_b, 1 / self.scale_b, 1]) @ b_from_a @ np.diag([self.scale_a, self.scale_a, 1])

    def enlarged(self, b_from_a: Matrix3x3) -> Matrix3x3:
        """The inverse of `reduced`."""
        return np.diag([self.scale_b, self.scale_b, 1]) @ b_from_a @ np.diag([1 / self.scale_a, 1 / self.scale_a, 1])


@dataclass(frozen=True, slots=True)
class MatchPart:
    """Which of a frame's n features take part; each (n,), None means all or none.

    `seen`: those the other frame should see, as far as poses are known. `again`: those matched before, with other frames. In
    woods few features are ever matched again, over fields nearly all: features matched before must match again where the frames
    overlap; features never matched carry no evidence.
    """

    seen: Mask | None = None
    again: Mask | None = None

    def chosen(self, features: Features) -> Indices:
        return np.arange(len(features)) if self.seen is None else np.flatnonzero(self.seen)


ALL = MatchPart()


@dataclass(frozen=True, slots=True)
class Proposal:
    """How two frames may lie: b_from_a (3x3, full resolution), and the evidence for it, in decades; negative is against it."""

    b_from_a: Matrix3x3
    evidence: float

    @classmethod
    def of_matches(cls, b_from_a: Matrix3x3, evidence: float) -> list[Proposal]:
        """One that so much speaks for, if it is worth a look; that few agree with it does not speak against it."""
        return [cls(b_from_a, max(evidence, 0.0))] if evidence >= LEAST_PROPOSED else []


def register(
    a: Features,
    b: Features,
    settings: RegistrationSettings,
    part_a: MatchPart = ALL,
    part_b: MatchPart = ALL,
    expected: Sequence[Proposal] = (),
    *,
    in_sequence: bool = False,
) -> Registration | NotRegistered:
    """Find the overlap of two frames. `expected`: where it may be by what else is known. `in_sequence`: they were taken one after
    the other, so that it is worth while to lay their pictures on each other wherever they may."""
    pair = _matched(a, b, part_a, part_b, settings.ratio)
    pictures = PixelPair(a, b)
    found, proposals = _by_keypoints(pair, pictures, a, b, settings)
    if isinstance(found, Registration) or not pictures.known:
        return found
    borne_out_by_pixels = _looked_at(found.contradicted, pair, pictures, a, b, settings)
    if borne_out_by_pixels is not None:
        return borne_out_by_pixels
    proposals += [*similarities(pair, settings), *expected]
    by_pixels = _by_pixels(pair, pictures, a, b, proposals, settings)
    if by_pixels is None and a.learned is not None and b.learned is not None:
        learned = similarities(_matched(a.learned, b.learned, ALL, ALL, RATIO), settings)
        by_pixels = _by_pixels(pair, pictures, a, b, learned, settings)
    if by_pixels is None and in_sequence:
        anywhere = [Proposal(b_from_a, ANYWHERE) for b_from_a in pictures.best_shifts()]
        by_pixels = _by_pixels(pair, pictures, a, b, anywhere, settings)
    return by_pixels or found


def _looked_at(
    found: Registration | None,
    pair: _Pair,
    pictures: PixelPair,
    a: Features,
    b: Features,
    settings: RegistrationSettings,
) -> Registration | None:
    """A registration whose keypoints are no accident but confirm little of the overlap, if the pictures do."""
    seen = None if found is None else pictures.agreement(found.b_from_a)
    if found is None or seen is None or seen.alone < settings.least_alone:
        return None
    if not _is_same(seen.b_from_a, found.b_from_a, a, b) or _should_have_matched(seen, pictures, a, b):
        return None
    beyond = pictures.evidence_beyond(seen, found.pixels_a)
    if beyond < settings.least_beyond:
        return None
    return _unless_contradicted(
        replace(_with_patches(found, pictures, a, b, settings, always=True), beyond=beyond), pair, settings
    )


def _unless_contradicted(found: Registration, pair: _Pair, settings: RegistrationSettings) -> Registration | None:
    """A registration that pixels speak for, unless features that were matched before speak against it more."""
    agreeing = found.agreeing_a / pair.scale_a
    return None if _contradicted(pair, pair.reduced(found.b_from_a), agreeing, settings, found.beyond) else found


def _should_have_matched(seen: Agreement, pictures: PixelPair, a: Features, b: Features) -> bool:
    """Whether two pictures agree so well that keypoints, of which few do, would if they showed one place: blocks of one make
    agree as wholes and differ in details. Not so where pictures have few details, or noise for them, or lose them by blur."""
    if a.is_faint or b.is_faint or min(map(_per_megapixel, (a, b))) < DETAILED:
        return False
    if max(a.sharpness, b.sharpness) > BLURRED * min(a.sharpness, b.sharpness):
        return False
    return seen.correlation > ALIKE or pictures.finest(seen) > MOST_FINEST


def _per_megapixel(frame: Features) -> float:
    """Features per megapixel of the feature picture."""
    return len(frame) * frame.scale**2 / (frame.width * frame.height * 1e-6)


def _is_same(one: Matrix3x3, other: Matrix3x3, a: Features, b: Features) -> bool:
    """Whether two homographies lay the middle of a frame in about the same place: one of the ground and one of the crowns do."""
    middle = np.array([[a.width / 2, a.height / 2]])
    apart = np.linalg.norm(_mapped(one, middle) - _mapped(other, middle))
    return bool(apart < SAME_PLACE * math.hypot(b.width, b.height))


def _by_keypoints(
    pair: _Pair, pictures: PixelPair, a: Features, b: Features, settings: RegistrationSettings
) -> tuple[Registration | NotRegistered, list[Proposal]]:
    """The overlap that the matches prove, or else why there is none, and the homographies tried."""
    left = np.ones(len(pair.matches), bool)
    first_doubt: NotRegistered | None = None
    contradicted: Registration | None = None
    proposals: list[Proposal] = []
    for _ in range(HYPOTHESES):
        homography, inlier = robust_homography_among(pair, left, settings.threshold_px)
        if homography is None:
            break
        independent = independent_count(pair.a[inlier], pair.b[inlier], settings.cell_px)
        evidence = _evidence(pair, homography, inlier, independent, settings)
        displaced = np.zeros(len(left), bool)
        if evidence >= settings.least_evidence:
            diagonal = float(np.linalg.norm(pair.size_b))
            displaced = displaced_by_height(_mapped(homography, pair.a), pair.b, inlier, diagonal)
        found = _in_full_resolution(pair, homography, inlier, displaced, independent, evidence)
        impossible = _impossible(homography, pair.a[inlier], evidence, settings)
        doubt = impossible or _contradicted(pair, homography, pair.a[inlier | displaced], settings)
        if not doubt:
            return _with_patches(found, pictures, a, b, settings), proposals
        first_doubt = first_doubt or NotRegistered(doubt, independent, found.pixels_a, found.pixels_b)
        contradicted = contradicted or (None if impossible else found)
        proposals += Proposal.of_matches(found.b_from_a, evidence)
        if evidence < settings.least_evidence:
            break  # the best agreement is chance: the remaining matches will not do better
        left &= ~inlier
    doubted = first_doubt or NotRegistered("no common homography", 0, np.empty((0, 2)), np.empty((0, 2)))
    return replace(doubted, contradicted=contradicted), proposals


def _by_pixels(
    pair: _Pair,
    pictures: PixelPair,
    a: Features,
    b: Features,
    proposals: Sequence[Proposal],
    settings: RegistrationSettings,
) -> Registration | None:
    """The overlap that keypoints, or what else is known, propose and the pictures prove."""
    outline = np.array([[0.0, 0.0], [a.width, 0], [0, a.height], [a.width, a.height], [a.width / 2, a.height / 2]])
    near = SAME_PROPOSAL * math.hypot(b.width, b.height)
    tried: list[PointsNx2] = []
    for proposal in sorted(proposals, key=lambda one: -one.evidence):
        if not _is_plausible(proposal.b_from_a, outline, a.scale / b.scale, settings):
            continue
        places = _mapped(proposal.b_from_a, outline)
        if any(np.linalg.norm(places - other, axis=1).max() < near for other in tried):
            continue
        tried.append(places)
        seen = pictures.agreement(proposal.b_from_a)
        if seen is None or proposal.evidence + seen.evidence < settings.least_evidence:
            continue
        if seen.alone < settings.least_alone or _should_have_matched(seen, pictures, a, b):
            continue
        found = _laid_by(seen, proposal, pair, a, b, settings)
        if found is None:
            continue
        beyond = pictures.evidence_beyond(seen, found.pixels_a[: len(found.features)])
        if beyond < settings.least_beyond:
            continue
        kept = _unless_contradicted(replace(found, beyond=beyond), pair, settings)
        if kept is not None:
            return kept
    return None


def _laid_by(
    seen: Agreement, proposal: Proposal, pair: _Pair, a: Features, b: Features, settings: RegistrationSettings
) -> Registration | None:
    """The matches and patches that agree with what the pictures show; None if they are too few to tell a pose."""
    off = np.linalg.norm(_mapped(pair.reduced(seen.b_from_a), pair.a) - pair.b, axis=1)
    near = np.flatnonzero(off < NEAR_BY_PIXELS * settings.threshold_px)
    some = patches(a, b, seen.b_from_a)
    of_a = np.concatenate([pair.a[near], some.pixels_a / a.scale])
    of_b = np.concatenate([pair.b[near], some.pixels_b / b.scale])
    if len(of_a) <= SAMPLE:
        return None
    refined, agrees = robust_homography(of_a, of_b, settings.threshold_px)
    independent = independent_count(of_a[agrees], of_b[agrees], settings.cell_px) if agrees.any() else 0
    if refined is None or independent < FEWEST or _impossible(refined, of_a[agrees], math.inf, settings):
        return None
    inlier = np.zeros(len(pair.matches), bool)
    inlier[near[agrees[: len(near)]]] = True
    diagonal = float(np.linalg.norm(pair.size_b))
    displaced = displaced_by_height(_mapped(refined, pair.a), pair.b, inlier, diagonal)
    evidence = proposal.evidence + seen.evidence
    found = _in_full_resolution(pair, refined, inlier, displaced, independent, evidence)
    return _joined(found, some, agrees[len(near) :])


def _with_patches(
    found: Registration,
    pictures: PixelPair,
    a: Features,
    b: Features,
    settings: RegistrationSettings,
    always: bool = False,
) -> Registration:
    """A registration with patches that agree with it, where its inliers are few."""
    if not pictures.known or (found.independent_inliers >= settings.enough_matches and not always):
        return found
    some = patches(a, b, found.b_from_a)
    off = np.linalg.norm(_mapped(found.b_from_a, some.pixels_a) - some.pixels_b, axis=1)
    return _joined(found, some, off < settings.threshold_px * b.scale)


def _joined(found: Registration, some: Patches, agrees: Mask) -> Registration:
    """With these patches (p,): those that agree with its homography as matches, the others as displaced by their height."""
    return replace(
        found,
        pixels_a=np.concatenate([found.pixels_a, some.pixels_a[agrees]]),
        pixels_b=np.concatenate([found.pixels_b, some.pixels_b[agrees]]),
        displaced_a=np.concatenate([found.displaced_a, some.pixels_a[~agrees]]),
        displaced_b=np.concatenate([found.displaced_b, some.pixels_b[~agrees]]),
    )


def _is_plausible(b_from_a: Matrix3x3, outline: PointsNx2, scale: float, settings: RegistrationSettings) -> bool:
    """Whether two frames, `scale` times apart in resolution, may look at one ground so: no corner of the first is seen from
    below, and none is magnified by much more than another."""
    area = _area_scale(b_from_a, outline) * scale**2
    if not np.isfinite(area).all() or (area <= 0).any():
        return False
    zoom = np.sqrt(area)
    is_within = zoom.max() <= settings.largest_zoom and zoom.min() >= 1 / settings.largest_zoom
    return bool(is_within and zoom.max() / zoom.min() <= MOST_SLANT)


def borne_out(
    found: Registration, a: Features, b: Features, settings: RegistrationSettings, part_a: MatchPart, part_b: MatchPart
) -> Registration | NotRegistered:
    """A registration made before it was known what of the frames was matched before, contradicted or not, if the overlap bears
    it out; neither frame's descriptors are needed."""
    pair = _pair(a, b, part_a, part_b, NO_MATCHES)
    doubt = _contradicted(pair, pair.reduced(found.b_from_a), found.agreeing_a / a.scale, settings, found.beyond)
    return NotRegistered(doubt, found.independent_inliers, found.pixels_a, found.pixels_b) if doubt else found


def _matched(a: Features, b: Features, part_a: MatchPart, part_b: MatchPart, ratio: float) -> _Pair:
    chosen_a, chosen_b = part_a.chosen(a), part_b.chosen(b)
    matches = match(a.descriptors[chosen_a], b.descriptors[chosen_b], ratio)
    matches = matches[moving(a, b, np.stack([chosen_a[matches[:, 0]], chosen_b[matches[:, 1]]], axis=1))]
    return _pair(a, b, part_a, part_b, matches)


def _pair(a: Features, b: Features, part_a: MatchPart, part_b: MatchPart, matches: IndexPairsNx2) -> _Pair:
    """Two frames with these matches (k, 2) of the features that take part."""
    chosen_a, chosen_b = part_a.chosen(a), part_b.chosen(b)
    return _Pair(
        all_a=a.points[chosen_a].astype(np.float64) / a.scale,
        all_b=b.points[chosen_b].astype(np.float64) / b.scale,
        size_a=np.array([a.width, a.height]) / a.scale,
        size_b=np.array([b.width, b.height]) / b.scale,
        scale_a=a.scale,
        scale_b=b.scale,
        matches=matches,
        features=np.stack([chosen_a[matches[:, 0]], chosen_b[matches[:, 1]]], axis=1),
        again_a=np.zeros(len(chosen_a), bool) if part_a.again is None else part_a.again[chosen_a],
        again_b=np.zeros(len(chosen_b), bool) if part_b.again is None else part_b.again[chosen_b],
    )


def robust_homography_among(pair: _Pair, left: Mask, threshold: float) -> tuple[Matrix3x3 | None, Mask]:
    """b_from_a (3x3) of the remaining matches, and its inliers among all matches (k,); or None."""
    inlier = np.zeros(len(left), bool)
    if left.sum() <= SAMPLE:
        return None, inlier
    homography, inlier[left] = robust_homography(pair.a[left], pair.b[left], threshold)
    return homography, inlier


def robust_homography(a: PointsNx2, b: PointsNx2, threshold: float) -> tuple[Matrix3x3 | None, Mask]:
    """b_from_a (3x3) and the inliers (m,) of matched points (m, 2), or None."""
    homography, inlier = cv2.findHomography(
        a, b, cv2.USAC_MAGSAC, threshold, maxIters=2000, confidence=0.9995
    )  # fmt: skip
    if homography is None or not np.isfinite(homography).all():
        return None, np.zeros(len(a), bool)
    return np.asarray(homography, dtype=np.float64), inlier.ravel().astype(bool)


def similarities(pair: _Pair, settings: RegistrationSettings) -> list[Proposal]:
    """Similarities that matches agree with, those of the most first, each without the inliers of those before."""
    left, found = np.arange(len(pair.matches)), list[Proposal]()
    tolerance = SIMILARITY_PX * settings.threshold_px
    for _ in range(SIMILARITIES):
        if len(left) <= SAMPLE_OF_SIMILARITY:
            break
        affine, inlier = cv2.estimateAffinePartial2D(
            pair.a[left], pair.b[left], method=cv2.RANSAC, ransacReprojThreshold=tolerance, confidence=0.999
        )  # fmt: skip
        if affine is None or not np.isfinite(affine).all():
            break
        similarity, agrees = np.vstack([affine, [0.0, 0.0, 1.0]]), inlier.ravel().astype(bool)
        independent = independent_count(pair.a[left[agrees]], pair.b[left[agrees]], settings.cell_px)
        matches = max(independent, independent_count(pair.a, pair.b, settings.cell_px))
        area = float(pair.size_b.prod())
        chance = chance_of_agreement(_mapped(similarity, pair.a), pair.b, tolerance, area)
        evidence = log_evidence(matches, independent, chance, SAMPLE_OF_SIMILARITY)
        found += Proposal.of_matches(pair.enlarged(similarity), evidence)
        left = left[~agrees]
    return found


def independent_count(a: PointsNx2, b: PointsNx2, cell: float) -> int:
    """Number of inliers in distinct cells, the smaller of the two frames: features pile up on one spot."""
    return min(len(np.unique(cell_numbers(points, cell))) for points in (a, b))


def _evidence(
    pair: _Pair, homography: Matrix3x3, inlier: Mask, independent: int, settings: RegistrationSettings
) -> float:
    matches = max(independent, independent_count(pair.a, pair.b, settings.cell_px))
    area = float(pair.size_b.prod())
    chance = chance_of_agreement(_mapped(homography, pair.a), pair.b, settings.threshold_px, area)
    return log_evidence(matches, independent, chance)


def _impossible(homography: Matrix3x3, agreeing: PointsNx2, evidence: float, settings: RegistrationSettings) -> str:
    """Reason why this homography cannot be two views of the same ground, or "". `agreeing`: points (k, 2) of a that agree."""
    if evidence < settings.least_evidence:
        return f"evidence {evidence:.1f}, {settings.least_evidence:.1f} needed"
    area = _area_scale(homography, agreeing)
    if (area <= 0).any():
        return "the ground would be seen from below"
    zoom = np.sqrt(area)
    if zoom.max() > settings.largest_zoom or zoom.min() < 1 / settings.largest_zoom:
        return f"change of scale {zoom.min():.2f} to {zoom.max():.2f}"
    return ""


def _contradicted(
    pair: _Pair, homography: Matrix3x3, agreeing: PointsNx2, settings: RegistrationSettings, beyond: float = 0.0
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


ANY = np.True_
MOST_BEYOND = 1.0  # decades that pixels can speak against a look-alike: whole blocks of one make do exist
ENOUGH_CELLS = 3
EXPECTED_SHARE = 0.8  # of the cells with features matched before, that a true overlap confirms: 0.75 to 1 in woods
NOTHING = Confirmed(1.0, 0)


@dataclass(frozen=True, slots=True)
class _Overlap:
    """Features of both frames that the other should see, in pixels of a: `a` (n, 2) and a mask of them, `b` likewise."""

    a: PointsNx2
    b: PointsNx2
    inside_a: Mask
    inside_b: Mask
    agreeing: PointsNx2  # (k, 2)

    @classmethod
    def of(cls, pair: _Pair, homography: Matrix3x3, agreeing: PointsNx2) -> _Overlap:
        a_from_b = np.asarray(np.linalg.inv(homography), dtype=np.float64)
        places_b = _mapped(a_from_b, pair.all_b)
        in_b = _inside(_mapped(homography, pair.all_a), pair.size_b) & (_area_scale(homography, pair.all_a) > 0)
        in_a = _inside(places_b, pair.size_a) & (_area_scale(a_from_b, pair.all_b) > 0)
        return cls(pair.all_a, places_b, in_b, in_a, agreeing)

    def confirmed_again(self, pair: _Pair) -> Confirmed:
        """Confirmation among features matched before in both frames, or in one of them; no cells if there are too few."""
        for of_a, of_b in ((pair.again_a, pair.again_b), (ANY, pair.again_b), (pair.again_a, ANY)):
            again = self.confirmed(of_a, of_b)
            if again.cells >= ENOUGH_CELLS:
                return again
        return NOTHING

    def confirmed(self, of_a: Mask | np.bool_, of_b: Mask | np.bool_) -> Confirmed:
        """Confirmation of the overlap by matches, among these features."""
        return confirmed(self.a[self.inside_a & of_a], self.b[self.inside_b & of_b], self.agreeing)


def _area_scale(homography: Matrix3x3, points: PointsNx2) -> Vector:
    """Factor (n,) by which areas around the points (n, 2) grow; not positive behind the camera or seen from below."""
    depth = points @ homography[2, :2] + homography[2, 2]
    with np.errstate(divide="ignore"):
        return np.asarray(np.linalg.det(homography) / depth**3)


def _in_full_resolution(
    pair: _Pair,
    homography: Matrix3x3,
    inlier: Mask,
    displaced: Mask,
    independent: int,
    evidence: float,
) -> Registration:
    return Registration(
        pixels_a=pair.a[inlier] * pair.scale_a,
        pixels_b=pair.b[inlier] * pair.scale_b,
        features=pair.features[inlier],
        b_from_a=pair.enlarged(homography),
        independent_inliers=independent,
        evidence=evidence,
        displaced_a=pair.a[displaced] * pair.scale_a,
        displaced_b=pair.b[displaced] * pair.scale_b,
        tentative=pair.features,
    )


def _mapped(homography: Matrix3x3, points: PointsNx2) -> PointsNx2:
    return np.asarray(cv2.perspectiveTransform(points[None], homography)[0]) if len(points) else points


def _inside(points: PointsNx2, size: Vector2) -> Mask:
    return np.asarray(((points >= 0) & (points < size)).all(axis=1))


def well_spread(points: PointsNx2, count: int) -> Indices:
    """Indices of at most `count` of the points (n, 2), by farthest-point sampling."""
    if len(points) <= count:
        return np.arange(len(points))
    chosen = [int(((points - points.mean(axis=0)) ** 2).sum(axis=1).argmax())]
    distance = ((points - points[chosen[0]]) ** 2).sum(axis=1)
    for _ in range(count - 1):
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, ((points - points[chosen[-1]]) ** 2).sum(axis=1))
    return np.array(chosen)
