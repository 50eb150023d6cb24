"""Registration by pixels: what keypoints, or anything else, propose and the pictures prove.

Few keypoints match again in woods, snow and thermal frames. A homography that some of them propose is tried on the pictures
(`agreement`), which must also look alike beyond what matched; patches then say where the ground lies.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gcs_mosaic.stitch.arrays import Mask, Matrix3x3, PointsNx2
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.registration.a_contrario import SAMPLE
from gcs_mosaic.stitch.registration.agreement import MOST, Agreement, PixelPair
from gcs_mosaic.stitch.registration.confirmation import why_contradicted
from gcs_mosaic.stitch.registration.frame_pair import FramePair, in_full_resolution, independent_count
from gcs_mosaic.stitch.registration.homography import mapped, robust_homography
from gcs_mosaic.stitch.registration.outcome import Registration
from gcs_mosaic.stitch.registration.parallax import displaced_by_height
from gcs_mosaic.stitch.registration.patches import Patches, patches
from gcs_mosaic.stitch.registration.proposals import Proposal, is_plausible, why_impossible
from gcs_mosaic.stitch.registration.settings import RegistrationSettings

# Correlation of the finest details above which keypoints, which are made of them, would match again: over woods and cold fields,
# where few do, it is 0.12 and less; blocks of one make and their neighbours, whose keypoints differ, have 0.18 to 0.40.
MOST_FINEST = 0.16
ALIKE = 0.7  # the same of coarse textures: woods that agree so well have 60 independent inliers and more
DETAILED = 1300  # features per megapixel of a feature picture with details everywhere
BLURRED = 1.5  # ratio of `sharpness`: a picture that is less sharp by so much has lost the other's details
# The same of pairs of one place that lack details or lose them by blur: 0.64 and less of seven flights, blurred ones among them.
# Graves and panels that differ by less than the noise have 0.79 and more, and other shifts that are about as good.
WHOLLY_ALIKE, CLEARLY_ALONE = 0.7, 6.0
# Decades of keypoints' evidence that need no pictures: on such rows false ones had up to 27, eleven of thirteen less than 20;
# true ones of a quarter of a frame and more have 23 and more.
PLAINLY = 20.0
# Of the diagonal: as far as crowns are displaced that stand a quarter of the flying height tall, at 50 % overlap.
SAME_PLACE = 0.12
SAME_PROPOSAL = 0.05  # of the diagonal: nearer ones are drawn to the same peak of the pixels
NEAR_BY_PIXELS = 3.0  # tolerances by which a match may be off a homography that coarse pictures have told
FEWEST = 8  # matches and patches in distinct cells that lay one frame on another


def looked_at(
    found: Registration | None,
    pair: FramePair,
    pictures: PixelPair,
    a: Features,
    b: Features,
    settings: RegistrationSettings,
) -> Registration | None:
    """A registration whose keypoints are no accident but confirm little of the overlap, if the pictures do."""
    seen = None if found is None else pictures.agreement(found.b_from_a)
    if found is None or seen is None or seen.alone < settings.least_alone:
        return None
    if not _is_same(seen.b_from_a, found.b_from_a, a, b) or should_have_matched(seen, pictures, a, b):
        return None
    beyond = pictures.evidence_beyond(seen, found.pixels_a)
    if beyond < settings.least_beyond:
        return None
    return _unless_contradicted(
        replace(with_patches(found, pictures, a, b, settings, always=True), beyond=beyond), pair, settings
    )


def _unless_contradicted(found: Registration, pair: FramePair, settings: RegistrationSettings) -> Registration | None:
    """A registration that pixels speak for, unless features that were matched before speak against it more."""
    agreeing = found.agreeing_a / pair.scale_a
    return None if why_contradicted(pair, pair.reduced(found.b_from_a), agreeing, settings, found.beyond) else found


def should_have_matched(seen: Agreement, pictures: PixelPair, a: Features, b: Features) -> bool:
    """Whether two pictures agree so well that keypoints, of which few do, would if they showed one place: blocks of one make
    agree as wholes and differ in details. Not so where pictures have few details, or noise for them, or lose them by blur; but
    what agrees to its finest details, and at another shift nearly as well, has lost none."""
    finest = pictures.finest(seen)
    if finest > WHOLLY_ALIKE and seen.alone < CLEARLY_ALONE:
        return True
    if a.is_faint or b.is_faint or min(map(_per_megapixel, (a, b))) < DETAILED:
        return False
    if max(a.sharpness, b.sharpness) > BLURRED * min(a.sharpness, b.sharpness):
        return False
    return seen.correlation > ALIKE or finest > MOST_FINEST


def is_one_of_many(found: Registration, pictures: PixelPair, settings: RegistrationSettings) -> bool:
    """Whether keypoints that prove little lie on rows of one make: the pictures agree to their finest details, of which keypoints
    are made and of which far more would match, and at another shift they agree as well."""
    if found.evidence >= PLAINLY or not pictures.known:
        return False
    seen = pictures.agreement(found.b_from_a)
    return seen is not None and seen.alone < settings.least_alone and pictures.finest(seen) > WHOLLY_ALIKE


def _per_megapixel(frame: Features) -> float:
    """Features per megapixel of the feature picture."""
    return len(frame) * frame.scale**2 / (frame.width * frame.height * 1e-6)


def _is_same(one: Matrix3x3, other: Matrix3x3, a: Features, b: Features) -> bool:
    """Whether two homographies lay the middle of a frame in about the same place: one of the ground and one of the crowns do."""
    middle = np.array([[a.width / 2, a.height / 2]])
    apart = np.linalg.norm(mapped(one, middle) - mapped(other, middle))
    return bool(apart < SAME_PLACE * math.hypot(b.width, b.height))


def proved_by_pixels(
    pair: FramePair,
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
        is_possible = proposal.evidence + MOST >= settings.least_evidence
        if not is_possible or not is_plausible(proposal.b_from_a, outline, a.scale / b.scale, settings):
            continue
        places = mapped(proposal.b_from_a, outline)
        if any(np.linalg.norm(places - other, axis=1).max() < near for other in tried):
            continue
        tried.append(places)
        seen = pictures.agreement(proposal.b_from_a)
        if seen is None or proposal.evidence + seen.evidence < settings.least_evidence:
            continue
        if seen.alone < settings.least_alone or should_have_matched(seen, pictures, a, b):
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
    seen: Agreement, proposal: Proposal, pair: FramePair, a: Features, b: Features, settings: RegistrationSettings
) -> Registration | None:
    """The matches and patches that agree with what the pictures show; None if they are too few to tell a pose."""
    off = np.linalg.norm(mapped(pair.reduced(seen.b_from_a), pair.a) - pair.b, axis=1)
    near = np.flatnonzero(off < NEAR_BY_PIXELS * settings.threshold_px)
    some = patches(a, b, seen.b_from_a)
    of_a = np.concatenate([pair.a[near], some.pixels_a / a.scale])
    of_b = np.concatenate([pair.b[near], some.pixels_b / b.scale])
    if len(of_a) <= SAMPLE:
        return None
    refined, agrees = robust_homography(of_a, of_b, settings.threshold_px)
    independent = independent_count(of_a[agrees], of_b[agrees], settings.cell_px) if agrees.any() else 0
    if refined is None or independent < FEWEST or why_impossible(refined, of_a[agrees], math.inf, settings):
        return None
    inlier = np.zeros(len(pair.matches), bool)
    inlier[near[agrees[: len(near)]]] = True
    diagonal = float(np.linalg.norm(pair.size_b))
    displaced = displaced_by_height(mapped(refined, pair.a), pair.b, inlier, diagonal)
    evidence = proposal.evidence + seen.evidence
    found = in_full_resolution(pair, refined, inlier, displaced, independent, evidence)
    return _joined(found, some, agrees[len(near) :])


def with_patches(
    found: Registration,
    pictures: PixelPair,
    a: Features,
    b: Features,
    settings: RegistrationSettings,
    always: bool = False,
) -> Registration:
    """A registration with patches, where its inliers are few: those that agree with it; `always`: all of them, always."""
    if not pictures.known or (found.independent_inliers >= settings.enough_matches and not always):
        return found
    some = patches(a, b, found.b_from_a)
    agrees = (
        np.linalg.norm(mapped(found.b_from_a, some.pixels_a) - some.pixels_b, axis=1) < settings.threshold_px * b.scale
    )
    return _joined(found, some, agrees, off_the_plane=always)


def _joined(found: Registration, some: Patches, agrees: Mask, off_the_plane: bool = True) -> Registration:
    """With these patches (p,): those that agree with its homography as matches, the others as displaced by their height."""
    displaced = ~agrees & off_the_plane
    return replace(
        found,
        pixels_a=np.concatenate([found.pixels_a, some.pixels_a[agrees]]),
        pixels_b=np.concatenate([found.pixels_b, some.pixels_b[agrees]]),
        displaced_a=np.concatenate([found.displaced_a, some.pixels_a[displaced]]),
        displaced_b=np.concatenate([found.displaced_b, some.pixels_b[displaced]]),
    )
