"""Pictures of frames: pairs with their matches, and panels with relief displacements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath

import cv2
import numpy as np

from gcs_mosaic.debug.sheet import BAD, GOOD, INK, Sheet, nice_length, rainbow
from gcs_mosaic.stitch.arrays import ImageBGR, PointsNx2, Vector
from gcs_mosaic.stitch.graph.placement import Placement

FRAME_WIDTH = 800  # px of either frame of a pair
GAP, HEAD = 12, 44
PANEL_WIDTH, PANELS_ACROSS = 380, 4
ARROW_GRID = (13, 10)  # arrows across and down a frame
PALE = 0.45  # remaining contrast of a frame under arrows


@dataclass(frozen=True, slots=True)
class PairSeen:
    """Two frames that were compared: a selection of the `agreeing` pixels (m, 2), full resolution, and why they are rejected."""

    a: str
    b: str
    pixels_a: PointsNx2
    pixels_b: PointsNx2
    agreeing: int
    inliers: int  # independent ones
    doubt: str  # empty if accepted


def draw_matches(pair: PairSeen, image_a: ImageBGR, image_b: ImageBGR) -> ImageBGR:
    """Two frames (h, w, 3) side by side, matches connected; coloured by y in the first one, to tell lines apart."""
    left, right = _at_width(image_a, FRAME_WIDTH), _at_width(image_b, FRAME_WIDTH)
    sheet = Sheet(2 * FRAME_WIDTH + GAP, HEAD + max(left.shape[0], right.shape[0]))
    said = f"refused: {pair.doubt}" if pair.doubt else "believed"
    title = f"{_stem(pair.a)} and {_stem(pair.b)}: {pair.agreeing} matches agree, {pair.inliers} of them independent"
    sheet.words((8, 28), title, size=16)
    sheet.words((sheet.width - 8, 28), said, BAD if pair.doubt else GOOD, 16, "right")
    for image, x in ((left, 0), (right, FRAME_WIDTH + GAP)):
        sheet.paste(image, x, HEAD)
    starts = _on_sheet(pair.pixels_a, image_a, 0)
    ends = _on_sheet(pair.pixels_b, image_b, FRAME_WIDTH + GAP)
    for start, end, colour in zip(starts, ends, rainbow(_ranks(pair.pixels_a[:, 1])), strict=True):
        sheet.lines(np.array([start, end]), colour, 0.6)
        sheet.dot(start, 2.2, colour)
        sheet.dot(end, 2.2, colour)
    return sheet.picture()


def draw_relief(frames: Sequence[tuple[Placement, ImageBGR]]) -> ImageBGR:
    """Frames with arrows for relief displacements (and other smooth model errors), all to one scale."""
    panels = [(placement, _at_width(image, PANEL_WIDTH)) for placement, image in frames]
    height = max(image.shape[0] for _, image in panels)
    down = -(-len(panels) // PANELS_ACROSS)
    across = min(PANELS_ACROSS, len(panels))
    sheet = Sheet(across * (PANEL_WIDTH + GAP) + GAP, HEAD + 30 + down * (height + 34))
    shifts = [_shifts(placement) for placement, _ in panels]
    scales = [PANEL_WIDTH / placement.camera.width for placement, _ in panels]
    drawn = [np.linalg.norm(shift, axis=1) * scale for (_, shift), scale in zip(shifts, scales, strict=True)]
    largest = max(float(np.quantile(np.concatenate(drawn), 0.98)), 1e-6)
    magnified = nice_length(max(PANEL_WIDTH / ARROW_GRID[0] * 1.2 / largest, 1.0))
    median_px = float(np.median(np.concatenate([np.linalg.norm(shift, axis=1) for _, shift in shifts])))
    sheet.words(
        (GAP, 30), "Relief displacement: where a camera over a plane would have seen what a pixel shows", size=17
    )
    sheet.words((GAP, 56), f"arrows magnified {magnified:g} times; median {median_px:.1f} px of the frame", size=14)
    for number, ((placement, image), (pixels, shift)) in enumerate(zip(panels, shifts, strict=True)):
        x = GAP + number % PANELS_ACROSS * (PANEL_WIDTH + GAP)
        y = HEAD + 30 + number // PANELS_ACROSS * (height + 34)
        _draw_panel(sheet, placement, image, (x, y), pixels, shift * magnified, largest * magnified)
    return sheet.picture()


def _draw_panel(sheet: Sheet, placement: Placement, image: ImageBGR, corner: tuple[int, int], pixels: PointsNx2,
                shifts: PointsNx2, longest: float) -> None:  # fmt: skip
    x, y = corner
    sheet.paste(_pale(image), x, y)
    scale = PANEL_WIDTH / placement.camera.width
    starts = (pixels + 0.5) * scale - 0.5 + [x, y]
    colours = rainbow(np.linalg.norm(shifts * scale, axis=1) / longest)
    for start, shift, colour in zip(starts, shifts * scale, colours, strict=True):
        sheet.arrow(start, start + shift, colour, 1.0)
    size_px = float(np.median(np.linalg.norm(_shifts(placement)[1], axis=1)))
    sheet.words((x, y + image.shape[0] + 20), f"{_stem(placement.name)}: {size_px:.1f} px", INK, 13)


def _shifts(placement: Placement) -> tuple[PointsNx2, PointsNx2]:
    """Pixels (n, 2) over a frame and their relief shifts (n, 2)."""
    columns, rows = ARROW_GRID
    camera = placement.camera
    x, y = np.meshgrid(
        (np.arange(columns) + 0.5) / columns * camera.width, (np.arange(rows) + 0.5) / rows * camera.height
    )
    pixels = np.column_stack([x.ravel(), y.ravel()]) - 0.5
    return pixels, placement.relief.at(camera, pixels) if placement.relief else np.zeros_like(pixels)


def _ranks(values: Vector) -> Vector:
    """Ranks (n,) of the values (n,), scaled from 0 for the smallest to 1 for the largest."""
    return np.asarray(np.argsort(np.argsort(values)) / max(len(values) - 1, 1))


def _on_sheet(pixels: PointsNx2, image: ImageBGR, left: int) -> PointsNx2:
    return np.asarray((pixels + 0.5) * FRAME_WIDTH / image.shape[1] - 0.5 + [left, HEAD])


def _at_width(image: ImageBGR, width: int) -> ImageBGR:
    height = max(1, round(image.shape[0] * width / image.shape[1]))
    return np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


def _pale(image: ImageBGR) -> ImageBGR:
    grey = cv2.cvtColor(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), cv2.COLOR_GRAY2BGR)
    return np.asarray(255 - (255 - grey.astype(np.float32)) * PALE, np.uint8)


def _stem(name: str) -> str:
    return PurePosixPath(name).stem
