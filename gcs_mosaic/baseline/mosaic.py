"""The paper's mosaic: frames in, placements out.

A frame is matched with the region of interest of the painted mosaic, blended into it, and never moved again.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import cv2
import numpy as np

from gcs_mosaic.baseline.blending import blend, border_distance
from gcs_mosaic.baseline.features import frame_features, region_features
from gcs_mosaic.baseline.homography import Fit, fit_homography
from gcs_mosaic.baseline.matching import ratio_matches
from gcs_mosaic.baseline.raster import Raster, RasterBox
from gcs_mosaic.render.display import Display, display_of
from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.stitch.arrays import Bands, FloatImage, ImageBGR, Matrix3x3, Points32Nx2, PointsNx2
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.stitch.features.detectors import FeatureKind, Found
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.graph.neighbours import region_of_interest
from gcs_mosaic.stitch.graph.placement import Placement, Rejection
from gcs_mosaic.stitch.mapping.islands import Island
from gcs_mosaic.stitch.mosaic import Mosaic
from gcs_mosaic.stitch.transaction import transaction


@dataclass(frozen=True, slots=True, kw_only=True)
class PaperSettings:
    """Parameters of the paper's method, and its limits."""

    features: FeatureKind = "sift"  # sift (the paper's choice), orb or surf (needs mahotas)
    ratio: float = 0.75  # of the distances to the best and second-best match; the paper says: "manually selected"
    threshold_px: float = 3.0  # RANSAC inlier threshold, pixels of the mosaic; OpenCV's default
    least_inliers: int = 10  # with fewer the homography is rejected: some homography fits any few matches
    # Maximum area of a frame on the mosaic, in frames of its size: a flight at five times its first height.
    largest_growth: float = 25.0
    # Mosaic size beyond which a frame is refused: 4 bytes per pixel, and some 20 per pixel of a frame during blending.
    most_megapixels: float = 400.0


class PaperMosaic(Mosaic):
    """Places frames on one growing image. All frames are reduced by `reduction`, a power of two.

    The view graph stays empty: nothing waits, is covered, compared or adjusted.

    `seconds`: time spent on the last frame, by the stages of the paper's tables. A call that raises changes nothing else.
    """

    in_order = True

    def __init__(self, settings: PaperSettings | None = None, reduction: int = 1) -> None:
        super().__init__()
        self.recipe = settings or PaperSettings()
        self.raster = Raster(reduction)
        self.seconds: dict[str, float] = {}
        self._reduction = reduction
        self._placed: dict[str, Placement] = {}
        self._homographies: dict[str, Matrix3x3] = {}  # mosaic_from_frame, both reduced
        self._last: RasterBox | None = None  # box of the frame stitched last
        self._region: Found | None = None  # features of its region of interest, in pixels of the mosaic
        self._moved: list[Placement] = []
        self._displays: dict[tuple[int, str], Display] = {}  # by number of bands and depth

    # Processing a frame

    def add(self, image: Bands, name: str) -> Placement | Rejection:
        """Place a frame (h, w, bands) and paint it."""
        with transaction(self):
            outcome = self.place(self.features_of(image), name)
            if isinstance(outcome, Placement):
                self.paint(image, name)
            return outcome

    def features_of(self, image: Bands) -> Features:
        """A. Features of the frame."""
        return frame_features(image, self.recipe.features, self._reduction)

    def place(
        self, features: Features, name: str, order: int | None = None, aircraft: int | None = None
    ) -> Placement | Rejection:
        """Place a frame; call `paint` afterwards. `order` is ignored: the method uses the order of arrival only."""
        self.seconds = {}
        with transaction(self):
            return self._place(features, name)

    def _place(self, features: Features, name: str) -> Placement | Rejection:
        if self._last is None:
            return self._founder(features, name)
        with self._timed("features"):
            region = self._region_of_interest(self._last)
        with self._timed("matching"):
            matches = ratio_matches(features.descriptors, region.descriptors, self.recipe.ratio)
        with self._timed("stitching"):
            frame, mosaic = self._reduced(features.points[matches[:, 0]]), region.points[matches[:, 1]]
            fit = fit_homography(name, frame, mosaic, self.recipe.threshold_px, self.recipe.least_inliers)
        return fit if isinstance(fit, Rejection) else self._believed(features, name, fit)

    def paint(self, image: Bands, name: str) -> set[Tile]:
        """D. Blend a placed frame into the mosaic; returns the tiles that changed."""
        with transaction(self), self._timed("stitching"):
            height, width = image.shape[:2]
            box = footprint_window(self._homographies[name], width, height)
            assert box is not None, "a frame without a box is not placed"
            self._blend(self._shown(image), self._homographies[name], box)
            self._last, self._region = box, None
            return self.raster.tiles(box)

    def _founder(self, features: Features, name: str) -> Placement | Rejection:
        if len(features) < self.recipe.least_inliers:  # nothing could ever be matched with it
            return Rejection(name, f"too little to see: {len(features)} features")
        return self._settled(features, name, Fit(np.eye(3), 0, math.nan))

    def _region_of_interest(self, last: RasterBox) -> Found:
        """Features of the painted mosaic within the last frame's box, three times as large."""
        if self._region is None:
            wanted = region_of_interest(np.array(last, dtype=np.float64))
            window = RasterBox(*np.rint(wanted).astype(int).tolist()).cut(self.raster.window)
            found = region_features(*self.raster.part(window), self.recipe.features)
            self._region = Found(np.add(found.points, [window.left, window.top]), found.descriptors)
        return self._region

    def _believed(self, features: Features, name: str, fit: Fit) -> Placement | Rejection:
        """The placement, unless the frame is implausibly large or exceeds the size limit."""
        width, height = (round(side / self._reduction) for side in (features.width, features.height))
        box = footprint_window(fit.mosaic_from_frame, width, height)
        if box is None:
            return Rejection(name, "its homography puts a part of it beyond the horizon, or turns it over")
        growth = box.pixels / (width * height)
        if growth > self.recipe.largest_growth:
            return Rejection(
                name, f"it would cover {growth:.0f} times its own pixels, {self.recipe.largest_growth:g} allowed"
            )
        megapixels = self.raster.window_with(box).pixels / 1e6
        if megapixels > self.recipe.most_megapixels:
            text = f"the mosaic would have {megapixels:.3g} megapixels, {self.recipe.most_megapixels:g} allowed"
            return Rejection(name, text)
        return self._settled(features, name, fit)

    def _settled(self, features: Features, name: str, fit: Fit) -> Placement:
        self._homographies[name] = fit.mosaic_from_frame
        full = np.diag([self._reduction, self._reduction, 1.0])
        full[:2, 2] = (self._reduction - 1) / 2  # integer coordinates are pixel centres, not corners
        homography = full @ fit.mosaic_from_frame @ np.linalg.inv(full)
        camera = Camera(features.width, features.height)
        last = next(reversed(self._placed), None)
        placement = Placement(
            name=name,
            island=0,
            pose=level_pose(homography, camera),
            camera=camera,
            relief=None,
            inliers=fit.inliers,
            residual_px=fit.residual_px * self._reduction,
            neighbours=() if last is None else (last,),
            hops=len(self._placed),
            corner_deviation_px=math.inf if self._placed else 0.0,  # the method does not estimate it
            homography=tuple(tuple(row) for row in (homography / homography[2, 2]).tolist()),
        )
        self._placed[name] = placement
        self._moved.append(placement)
        return placement

    def _blend(self, image: ImageBGR, mosaic_from_frame: Matrix3x3, box: RasterBox) -> None:
        shown, coverage = self.raster.part(box)
        size = box.right - box.left, box.bottom - box.top
        box_from_frame = np.array([[1, 0, -box.left], [0, 1, -box.top], [0, 0, 1]]) @ mosaic_from_frame
        # The border is replicated, so that no edge pixel is mixed with black.
        new = cv2.warpPerspective(image, box_from_frame, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        everywhere = np.full(image.shape[:2], 255, np.uint8)
        covered = np.asarray(cv2.warpPerspective(everywhere, box_from_frame, size, flags=cv2.INTER_NEAREST), np.uint8)
        mixed = blend(shown, self._weight_shown(box), np.asarray(new, np.uint8), covered)
        self.raster.put(box, mixed, np.maximum(coverage, covered))

    def _shown(self, image: Bands) -> ImageBGR:
        """The frame as displayed, with the display of the first frame of its kind."""
        kind = image.shape[2], str(image.dtype)
        if kind not in self._displays:
            self._displays[kind] = display_of(image)
        return self._displays[kind].picture(image)

    def _weight_shown(self, box: RasterBox) -> FloatImage:
        """Distance of each pixel of a frame's box to the mosaic's border; exact up to half the box, a frame's maximum weight."""
        wide, high = (box.right - box.left) // 2, (box.bottom - box.top) // 2
        around = RasterBox(box.left - wide, box.top - high, box.right + wide, box.bottom + high).cut(
            self.raster.window_with(box)
        )
        distance = border_distance(self.raster.part(around)[1])
        top, left = box.top - around.top, box.left - around.left
        return distance[top : top + box.bottom - box.top, left : left + box.right - box.left]

    def _reduced(self, points: Points32Nx2) -> PointsNx2:
        return np.asarray((points.astype(np.float64) + 0.5) / self._reduction - 0.5)

    @contextmanager
    def _timed(self, stage: str) -> Iterator[None]:
        start = time.perf_counter()
        yield
        self.seconds[stage] = self.seconds.get(stage, 0.0) + time.perf_counter() - start

    # State over all frames

    @property
    def islands(self) -> list[Island]:
        """The one island, once it is founded."""
        return [Island(0)] if self._placed else []

    def placements(self) -> list[Placement]:
        """All placed frames, in order of arrival."""
        return list(self._placed.values())

    def frame_counts(self) -> dict[int, int]:
        """Number of placed frames by island."""
        return {0: len(self._placed)} if self._placed else {}

    def moved(self) -> list[Placement]:
        """All placements that are new since the last call."""
        moved, self._moved = self._moved, []
        return moved


def footprint_window(mosaic_from_frame: Matrix3x3, width: int, height: int) -> RasterBox | None:
    """The pixels of the mosaic that a frame touches; None if it extends beyond its horizon or is mirrored."""
    corners = np.array(
        [[-0.5, -0.5, 1], [width - 0.5, -0.5, 1], [width - 0.5, height - 0.5, 1], [-0.5, height - 0.5, 1]]
    )
    mapped = corners @ mosaic_from_frame.T
    depth = mapped[:, 2] * np.sign(mosaic_from_frame[2, 2])
    if not (depth > 0).all() or not np.linalg.det(mosaic_from_frame) * mosaic_from_frame[2, 2] > 0:
        return None
    places = mapped[:, :2] / mapped[:, 2:]
    if not (np.abs(places) < MOST_PIXELS_AWAY).all():
        return None
    (left, top), (right, bottom) = np.floor(places.min(axis=0) + 0.5), np.ceil(places.max(axis=0) + 0.5)
    return RasterBox(int(left), int(top), int(right), int(bottom))


MOST_PIXELS_AWAY = 2**20  # the tile grid ends at 2**21 for frames at a quarter of their size


def level_pose(homography: Matrix3x3, camera: Camera) -> Pose:
    """The level pose whose view at the frame's centre best matches the homography (full-resolution pixels)."""
    x, y, depth = homography @ [*camera.centre, 1]
    u, v = x / depth, y / depth
    jacobian = (homography[:2, :2] - np.outer([u, v], homography[2, :2])) / depth
    turned = math.atan2(jacobian[1, 0] - jacobian[0, 1], jacobian[0, 0] + jacobian[1, 1])
    return Pose(float(u), float(v), 0.5 * math.log(abs(float(np.linalg.det(jacobian)))), turned)
