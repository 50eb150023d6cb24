"""How two frames may lie, worth a look at their pictures: by few or rough matches, or by what else is known."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from gcs_mosaic.stitch.arrays import Matrix3x3, PointsNx2
from gcs_mosaic.stitch.registration.a_contrario import SAMPLE_OF_SIMILARITY, chance_of_agreement, log_evidence
from gcs_mosaic.stitch.registration.frame_pair import FramePair, independent_count
from gcs_mosaic.stitch.registration.homography import area_scale, mapped
from gcs_mosaic.stitch.registration.settings import RegistrationSettings

SIMILARITIES = 3  # tried; of few and rough matches two determine one, where four wrong ones make a homography
SIMILARITY_PX = 2.0  # tolerance of its inliers, in those of a homography: relief, tilt and lens are in it
# Decades of evidence below which a proposal is chance: it is not worth a look. Of 190 that proved right one had less, -4.8.
LEAST_PROPOSED = -4.0
# Ratio of magnifications of two corners in a proposal: a frame 55 degrees up against one straight down.
MOST_SLANT = 4.5


@dataclass(frozen=True, slots=True)
class Proposal:
    """How two frames may lie: b_from_a (3x3, full resolution), and the evidence for it, in decades; negative is against it."""

    b_from_a: Matrix3x3
    evidence: float

    @classmethod
    def of_matches(cls, b_from_a: Matrix3x3, evidence: float) -> list[Proposal]:
        """One that so much speaks for, if it is worth a look; that few agree with it does not speak against it."""
        return [cls(b_from_a, max(evidence, 0.0))] if evidence >= LEAST_PROPOSED else []


def is_plausible(b_from_a: Matrix3x3, outline: PointsNx2, scale: float, settings: RegistrationSettings) -> bool:
    """Whether two frames, `scale` times apart in resolution, may look at one ground so: no corner of the first is seen from
    below, and none is magnified by much more than another."""
    area = area_scale(b_from_a, outline) * scale**2
    if not np.isfinite(area).all() or (area <= 0).any():
        return False
    zoom = np.sqrt(area)
    is_within = zoom.max() <= settings.largest_zoom and zoom.min() >= 1 / settings.largest_zoom
    return bool(is_within and zoom.max() / zoom.min() <= MOST_SLANT)


def similarities(pair: FramePair, settings: RegistrationSettings) -> list[Proposal]:
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
        chance = chance_of_agreement(mapped(similarity, pair.a), pair.b, tolerance, area)
        evidence = log_evidence(matches, independent, chance, SAMPLE_OF_SIMILARITY)
        found += Proposal.of_matches(pair.enlarged(similarity), evidence)
        left = left[~agrees]
    return found


def why_impossible(homography: Matrix3x3, agreeing: PointsNx2, evidence: float, settings: RegistrationSettings) -> str:
    """Reason why this homography cannot be two views of the same ground, or "". `agreeing`: points (k, 2) of a that agree."""
    if evidence < settings.least_evidence:
        return f"evidence {evidence:.1f}, {settings.least_evidence:.1f} needed"
    area = area_scale(homography, agreeing)
    if (area <= 0).any():
        return "the ground would be seen from below"
    zoom = np.sqrt(area)
    if zoom.max() > settings.largest_zoom or zoom.min() < 1 / settings.largest_zoom:
        return f"change of scale {zoom.min():.2f} to {zoom.max():.2f}"
    return ""
