"""Pairwise registration: what may lay one frame on the other, and the evidence that it is neither accident nor look-alike.

Two witnesses are heard. Keypoints: how many agree with one homography or similarity (`a_contrario`), and whether the rest of the
overlap confirms it. Pixels: whether the two pictures look alike there (`agreement`), and look alike beyond what matched. Their
evidence is added, in decades; the pixels are only asked where keypoints alone do not suffice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gcs_mosaic.stitch.arrays import Mask, Matrix3x3
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.features.learned import RATIO
from gcs_mosaic.stitch.registration.a_contrario import chance_of_agreement, log_evidence
from gcs_mosaic.stitch.registration.agreement import PixelPair
from gcs_mosaic.stitch.registration.by_pixels import is_one_of_many, looked_at, proved_by_pixels, with_patches
from gcs_mosaic.stitch.registration.confirmation import why_contradicted
from gcs_mosaic.stitch.registration.frame_pair import (
    ALL,
    FramePair,
    MatchPart,
    in_full_resolution,
    independent_count,
    matched,
    robust_homography_among,
)
from gcs_mosaic.stitch.registration.homography import mapped
from gcs_mosaic.stitch.registration.outcome import NotRegistered, Registration
from gcs_mosaic.stitch.registration.parallax import displaced_by_height
from gcs_mosaic.stitch.registration.proposals import Proposal, similarities, why_impossible
from gcs_mosaic.stitch.registration.settings import RegistrationSettings

HYPOTHESES = 3  # homographies tried: a look-alike elsewhere, or burnt-in text, can outnumber the ground's inliers
# Decades for the best of all shifts: some ten thousand are tried, but frames in sequence overlap a hundred times more often.
ANYWHERE = -2.0


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
    pair = matched(a, b, part_a, part_b, settings.ratio)
    pictures = PixelPair(a, b)
    found, proposals = _by_keypoints(pair, pictures, a, b, settings)
    if isinstance(found, Registration) or not pictures.known:
        return found
    borne_out_by_pixels = looked_at(found.contradicted, pair, pictures, a, b, settings)
    if borne_out_by_pixels is not None:
        return borne_out_by_pixels
    proposals += [*similarities(pair, settings), *expected]
    found_by_pixels = proved_by_pixels(pair, pictures, a, b, proposals, settings)
    if found_by_pixels is None and a.learned is not None and b.learned is not None:
        learned = similarities(matched(a.learned, b.learned, ALL, ALL, RATIO), settings)
        found_by_pixels = proved_by_pixels(pair, pictures, a, b, learned, settings)
    if found_by_pixels is None and in_sequence:
        anywhere = [Proposal(b_from_a, ANYWHERE) for b_from_a in pictures.best_shifts()]
        found_by_pixels = proved_by_pixels(pair, pictures, a, b, anywhere, settings)
    return found_by_pixels or found


def _by_keypoints(
    pair: FramePair, pictures: PixelPair, a: Features, b: Features, settings: RegistrationSettings
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
            displaced = displaced_by_height(mapped(homography, pair.a), pair.b, inlier, diagonal)
        found = in_full_resolution(pair, homography, inlier, displaced, independent, evidence)
        impossible = why_impossible(homography, pair.a[inlier], evidence, settings)
        doubt = impossible or why_contradicted(pair, homography, pair.a[inlier | displaced], settings)
        if not doubt and is_one_of_many(found, pictures, settings):
            doubt = "it lies as well at other places of rows of one make"
        if not doubt:
            return with_patches(found, pictures, a, b, settings), proposals
        first_doubt = first_doubt or NotRegistered(doubt, independent, found.pixels_a, found.pixels_b)
        contradicted = contradicted or (None if impossible else found)
        proposals += Proposal.of_matches(found.b_from_a, evidence)
        if evidence < settings.least_evidence:
            break  # the best agreement is chance: the remaining matches will not do better
        left &= ~inlier
    doubted = first_doubt or NotRegistered("no common homography", 0, np.empty((0, 2)), np.empty((0, 2)))
    return replace(doubted, contradicted=contradicted), proposals


def _evidence(
    pair: FramePair, homography: Matrix3x3, inlier: Mask, independent: int, settings: RegistrationSettings
) -> float:
    matches = max(independent, independent_count(pair.a, pair.b, settings.cell_px))
    area = float(pair.size_b.prod())
    chance = chance_of_agreement(mapped(homography, pair.a), pair.b, settings.threshold_px, area)
    return log_evidence(matches, independent, chance)
