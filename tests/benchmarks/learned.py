"""Learned features beside SIFT: python -m tests.benchmarks.learned MODEL.onnx [brighton deer cmac]

Of consecutive frames of recorded flights, and of frames half a flight apart, of which next to none show the same ground: matches,
inliers of one homography, the share of the overlap that these confirm, and how many pairs `register` accepts as they are. Faint
frames are freed of the mean of all frames of the flight for both; *still*: pairs of which most inliers have not moved, which are
that pattern, or an aircraft that hovers. CPU seconds a frame, on one thread, of finding alone.

How to make MODEL.onnx: export_xfeat.py.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from gcs_mosaic.stitch.arrays import FloatImage, ImageBGR, Mask, Matrix3x3, PointsNx2, Vector2
from gcs_mosaic.stitch.features.detectors import Found, detect
from gcs_mosaic.stitch.features.extraction import Features, FeatureSettings, extract, reduced_grey
from gcs_mosaic.stitch.features.faint import HALF, detect_faint, equalised
from gcs_mosaic.stitch.features.fixed_pattern import STILL_PX, clipped, freed, picture_without
from gcs_mosaic.stitch.features.learned import FINE_BLUR, RATIO, LearnedDetector, read_detector
from gcs_mosaic.stitch.features.matching import match
from gcs_mosaic.stitch.registration.a_contrario import confirmed
from gcs_mosaic.stitch.registration.homography import robust_homography
from gcs_mosaic.stitch.registration.outcome import Registration
from gcs_mosaic.stitch.registration.registration import register
from gcs_mosaic.stitch.registration.settings import RegistrationSettings
from tests.benchmarks.recorded import photographs, picture_of

SETTINGS = FeatureSettings()
REGISTRATION = RegistrationSettings()


@dataclass(frozen=True)
class Way:
    """Features of all frames of a flight, found one way; seconds of CPU for a frame."""

    frames: Sequence[Features]
    ratio: float
    seconds: float


@dataclass(frozen=True)
class Compared:
    """Two frames; `share`: of their overlap, that is confirmed."""

    matches: int
    inliers: int
    share: float
    registered: bool
    still: bool


def ways_of(flight: str, detector: LearnedDetector, most: int, ratio: float) -> dict[str, Way]:
    paths = photographs(flight)[:most]
    sift = [extract(picture_of(path), SETTINGS) for path in paths]
    faint = [clipped(one.faint) for one in sift if one.faint is not None]
    pattern = np.asarray(np.mean(faint, axis=0), np.float32) if len(faint) == len(sift) else None
    timed = [_timed(picture_of(path), one, pattern, detector) for path, one in zip(paths, sift, strict=True)]
    if pattern is not None:
        sift = [freed(one, pattern, SETTINGS) for one in sift]
    learned = [one for one, _, _ in timed]
    of_sift, of_model = (float(np.median([one[k] for one in timed])) for k in (1, 2))
    return {"SIFT": Way(sift, REGISTRATION.ratio, of_sift), "learned": Way(learned, ratio, of_model)}


def _timed(
    image: ImageBGR, sift: Features, pattern: FloatImage | None, detector: LearnedDetector
) -> tuple[Features, float, float]:
    """A frame's learned features, and the CPU seconds of SIFT's detection and of the model's in the same picture."""
    if pattern is None or sift.faint is None:
        grey, scale = reduced_grey(image, SETTINGS.megapixels), sift.scale
        found, of_model = _cpu(lambda: detector.find(grey, SETTINGS.count))
        _, of_sift = _cpu(lambda: detect(grey, "sift", SETTINGS.count, SETTINGS.contrast))
    else:
        levels, scale = picture_without(sift.faint, pattern), sift.scale * HALF
        found, of_model = _cpu(lambda: detector.find(equalised(levels, FINE_BLUR), SETTINGS.count))
        _, of_sift = _cpu(lambda: detect_faint(levels, "sift", SETTINGS.count, SETTINGS.contrast))
    points = ((found.points + 0.5) * scale - 0.5).astype(np.float32)
    learned = replace(sift, kept_points=points, kept_descriptors=found.descriptors, kept_faint=None, ordinary=0)
    return learned, of_sift, of_model


def _cpu(find: Callable[[], Found]) -> tuple[Found, float]:
    began = time.process_time()
    found = find()
    return found, time.process_time() - began


def compared(a: Features, b: Features, ratio: float) -> Compared:
    pairs = match(a.descriptors, b.descriptors, ratio)
    points_a, points_b = (one.points.astype(np.float64) / one.scale for one in (a, b))
    matched_a, matched_b = points_a[pairs[:, 0]], points_b[pairs[:, 1]]
    found = register(a, b, replace(REGISTRATION, ratio=ratio))
    if len(pairs) <= 4:
        return Compared(len(pairs), 0, 0.0, registered=False, still=False)
    homography, inlier = robust_homography(matched_a, matched_b, REGISTRATION.threshold_px)
    if homography is None or not inlier.any():
        return Compared(len(pairs), 0, 0.0, registered=False, still=False)
    moved = np.linalg.norm(matched_a[inlier] - matched_b[inlier], axis=1)
    size = np.array([a.width, a.height]) / a.scale
    there, back = _mapped(homography, points_a), _mapped(np.asarray(np.linalg.inv(homography), np.float64), points_b)
    return Compared(
        matches=len(pairs),
        inliers=int(inlier.sum()),
        share=confirmed(points_a[_inside(there, size)], back[_inside(back, size)], matched_a[inlier]).share,
        registered=isinstance(found, Registration),
        still=bool(np.median(moved) < STILL_PX),
    )


def _mapped(homography: Matrix3x3, points: PointsNx2) -> PointsNx2:
    return np.asarray(cv2.perspectiveTransform(points[None], homography)[0], np.float64)


def _inside(points: PointsNx2, size: Vector2) -> Mask:
    return np.asarray(((points >= 0) & (points < size)).all(axis=1))


def row(flight: str, name: str, way: Way) -> str:
    """Of the table: medians and, in brackets, the lowest and the highest tenth."""
    count = len(way.frames)
    near = [compared(way.frames[k], way.frames[k + 1], way.ratio) for k in range(count - 1)]
    far = [compared(way.frames[k], way.frames[k + count // 2], way.ratio) for k in range(count - count // 2)]
    low, middle, high = np.quantile([one.inliers for one in near], (0.1, 0.5, 0.9))
    cells = [
        f"{flight}, {len(near)} pairs",
        name,
        f"{np.median([one.matches for one in near]):.0f}",
        f"{middle:.0f} ({low:.0f}, {high:.0f})",
        f"{np.median([one.share for one in near]):.0%}",
        f"{sum(one.registered for one in near)}",
        f"{sum(one.still for one in near)}",
        f"{np.median([one.inliers for one in far]):.0f}, {sum(one.registered for one in far)}",
        f"{way.seconds:.3f} s",
    ]
    return f"| {' | '.join(cells)} |"


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.learned")
    parser.add_argument("model", type=Path)
    parser.add_argument("flights", nargs="*", default=["brighton", "deer", "cmac"])
    parser.add_argument("--most", type=int, default=100, help="frames of a flight")
    parser.add_argument("--ratio", type=float, default=RATIO, help="of the model's matches")
    parser.add_argument("--pairs", action="store_true", help="tell the inliers of each pair of consecutive frames too")
    given = parser.parse_args()
    cv2.setNumThreads(1)
    detector = read_detector(given.model)
    print(
        "| flight | features | matches | inliers | confirmed | registered | still | far apart: inliers, registered | CPU |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for flight in given.flights:
        for name, way in ways_of(flight, detector, given.most, given.ratio).items():
            print(row(flight, name, way), flush=True)
            if given.pairs:
                pairs = zip(way.frames, way.frames[1:], strict=False)
                print(" ".join(str(compared(a, b, way.ratio).inliers) for a, b in pairs))
    return 0


if __name__ == "__main__":
    sys.exit(main())
