"""Keypoints and descriptors of a learned model: an ONNX file that the operator brings, run by cv2.dnn. None is shipped.

What a file must be like, whatever it was trained for:

* input (1, 1, 480, 640) float32, grey from 0 to 1. What the model wants besides (mean, deviation) it does itself.
* outputs in any order and under any names, told apart by their shape; one cell is 8 x 8 pixels of the input:
  (1, d, 60, 80) descriptors of the cells, d neither 1 nor 65, of any length;
  (1, 65, 60, 80) logits of where in a cell the keypoint is, row by row, the last one for none (SuperPoint: DeTone et al.,
  CVPRW 2018);
  (1, 1, 60, 80) reliability of a cell from 0 to 1, if the model has one.

So maps and no points: choosing points needs operators (NonZero, TopK, GridSample) that OpenCV 4.10 does not run, and their
number would change from picture to picture. The size is fixed, because a file's shapes are, and 4:3 is that of most frames.
XFeat (Potje et al., CVPR 2024) has just these maps; what is done with them here is what its authors do.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from threading import Lock

import cv2
import numpy as np

from gcs_mosaic.stitch.arrays import FloatImage, FloatPlanes, FloatRows, ImageGrey, IndexRows, PointsNx2
from gcs_mosaic.stitch.features.detectors import Found, rounded
from gcs_mosaic.stitch.features.onnx_check import declared_inputs, fits, read_model, trouble_of

WIDTH, HEIGHT = 640, 480  # px of the input
CELL = 8  # px
INPUT = (1, 1, HEIGHT, WIDTH)
CELLS = (HEIGHT // CELL, WIDTH // CELL)
LOGITS = CELL * CELL + 1
MOST = 1e6  # what outputs may be; damaged weights bring more
LEAST_PROBABILITY = 0.05  # of a keypoint, in its cell; XFeat's own
APART = 5  # px, side of the square in which a keypoint is the likeliest
BORDER = 4  # px inside a picture's border, where all frames of a camera have the same corners: its own
FORM = (
    f"(1, d, {CELLS[0]}, {CELLS[1]}), (1, {LOGITS}, {CELLS[0]}, {CELLS[1]}) and perhaps (1, 1, {CELLS[0]}, {CELLS[1]})"
)
# Of a small picture: faint ones of 320 x 256 had 65 inliers (median) as they are, 94 at this, 85 at twice the size.
MOST_ENLARGED = 1.5
# Ratio of the distances to the best and second-best match: XFeat's authors ask for mutual neighbours alone. At 0.95 a quarter to
# a half of the inliers of faint pictures was lost.
RATIO = 1.0
FINE_BLUR = 0.8  # px of a faint picture, see `faint.equalised`: a model bears more noise than SIFT
REMEDY = "export one as tests/benchmarks/export_xfeat.py does, or leave the setting `model` out"


class UnusableModel(ValueError):  # noqa: N818 - names a state
    """A file that is no model for this. The message is one sentence: what came, what was wanted, what to do."""


class LearnedDetector:
    """A model. For any thread, one at a time. A file may crash OpenCV: try it in another process first (`config.model_trial`).

    `length`: d of the descriptors; `digest`: hex, of the file. Raises UnusableModel.
    """

    def __init__(self, model: bytes, name: str) -> None:
        self.digest = hashlib.blake2b(model, digest_size=16).hexdigest()
        self._lock = Lock()  # a net holds what it computes
        _check_input(model, name)
        try:
            self._net = cv2.dnn.readNetFromONNX(np.frombuffer(model, np.uint8))
            self._outputs = self._net.getUnconnectedOutLayersNames()
        except cv2.error as error:
            raise UnusableModel(
                f"{name} is no ONNX model that OpenCV {cv2.__version__} can load ({_told(error)}); {REMEDY}"
            ) from None
        self.length = self._tried(name)

    def find(self, grey: ImageGrey, count: int) -> Found:
        """Features of a grey picture (h, w) of any size, the strongest first, at most `count`.

        Points (n, 2) in its pixels; descriptors (n, d) int8, unit length times 127.
        """
        small = _fitting(grey)
        descriptors, logits, reliability = self._maps(_padded(small))
        likely = _probability(logits)
        pixels = _peaks(likely, small.shape[1], small.shape[0])
        strength = likely[pixels[:, 1], pixels[:, 0]] * _sampled(reliability, pixels)[:, 0]
        strongest = np.argsort(-strength, kind="stable")[:count]
        pixels = pixels[strongest]
        within = pixels + _offsets(likely, pixels)
        of_picture = np.array([grey.shape[1] / small.shape[1], grey.shape[0] / small.shape[0]])
        points: PointsNx2 = (within + 0.5) * of_picture - 0.5
        return Found(points, rounded(_unit(_sampled(_unit(descriptors), pixels))))

    def _maps(self, padded: ImageGrey) -> tuple[FloatImage, FloatPlanes, FloatImage]:
        """Descriptors (60, 80, d), logits (65, 60, 80) and reliability (60, 80, 1) of a picture (480, 640)."""
        by_channels = {planes.shape[1]: planes[0] for planes in self._run(padded)}
        logits = by_channels.pop(LOGITS)
        reliability = by_channels.pop(1, np.ones((1, *CELLS), np.float32))
        (descriptors,) = by_channels.values()
        return descriptors.transpose(1, 2, 0), logits, reliability.transpose(1, 2, 0)

    def _run(self, padded: ImageGrey) -> list[FloatPlanes]:
        with self._lock:
            self._net.setInput(padded.astype(np.float32).reshape(INPUT) / np.float32(255))
            return [np.array(one, np.float32) for one in self._net.forward(self._outputs)]

    def _tried(self, name: str) -> int:
        """d, of a picture of noise. Raises UnusableModel."""
        noise = np.random.default_rng(1).integers(0, 256, (HEIGHT, WIDTH), dtype=np.uint8)
        try:
            maps = self._run(noise)
        except (cv2.error, ValueError) as error:
            raise UnusableModel(f"{name} cannot be run with an input of {INPUT} ({_told(error)}); {REMEDY}") from None
        if not _has_form([one.shape for one in maps]):
            raise UnusableModel(
                f"{name} gives {', '.join(str(one.shape) for one in maps)}, wanted are {FORM}; {REMEDY}"
            )
        if not all((np.abs(one) < MOST).all() for one in maps):
            raise UnusableModel(f"{name} gives numbers beyond {MOST:,.0f}, or none; {REMEDY}")
        return next(int(one.shape[1]) for one in maps if one.shape[1] not in (1, LOGITS))


def read_detector(path: Path) -> LearnedDetector:
    """The model in a file. Raises UnusableModel."""
    return LearnedDetector(model_bytes(path), str(path))


def model_bytes(path: Path) -> bytes:
    """Raises UnusableModel if the file cannot be read."""
    try:
        return read_model(path)
    except ValueError as error:
        raise UnusableModel(f"{path} cannot be read ({error}); {REMEDY}") from None
    except OSError as error:
        raise UnusableModel(f"{path} cannot be read ({error.strerror}); {REMEDY}") from None


def _check_input(model: bytes, name: str) -> None:
    """Raises UnusableModel if the file declares another input, would not be good to load, or is no ONNX file."""
    try:
        trouble, declared = trouble_of(model), declared_inputs(model)
    except ValueError as error:
        raise UnusableModel(f"{name} is no ONNX model ({error}); {REMEDY}") from None
    if trouble is not None:
        raise UnusableModel(f"{name} is not loaded, because it {trouble}; {REMEDY}")
    if len(declared) != 1 or not fits(declared[0], INPUT):
        given = ", ".join(f"({', '.join('any' if one is None else str(one) for one in shape)})" for shape in declared)
        raise UnusableModel(f"{name} takes {given or 'nothing'}, wanted is {INPUT}; {REMEDY}")


def _has_form(shapes: Sequence[tuple[int, ...]]) -> bool:
    """Whether outputs of these shapes are those that are wanted."""
    if any(len(shape) != 4 or (shape[0], *shape[2:]) != (1, *CELLS) for shape in shapes):
        return False
    known = sorted(shape[1] for shape in shapes if shape[1] in (1, LOGITS))
    return known in ([LOGITS], [1, LOGITS]) and len(shapes) == len(known) + 1


def _told(error: Exception) -> str:
    """The last of OpenCV's lines, which says what, without where in its source."""
    return " ".join(str(error).split("error: ")[-1].split())[:200]


def _fitting(grey: ImageGrey) -> ImageGrey:
    """A picture that fits into the input, enlarged as far as that helps."""
    factor = min(MOST_ENLARGED, WIDTH / grey.shape[1], HEIGHT / grey.shape[0])
    size = max(1, round(grey.shape[1] * factor)), max(1, round(grey.shape[0] * factor))
    way = cv2.INTER_AREA if factor < 1 else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(grey, size, interpolation=way), np.uint8)


def _padded(small: ImageGrey) -> ImageGrey:
    """The picture at the top left of the input, mirrored into the rest: that has its mean and deviation, by which models
    normalise, and no edges of its own."""
    below, beside = HEIGHT - small.shape[0], WIDTH - small.shape[1]
    return np.pad(small, ((0, below), (0, beside)), mode="symmetric")


def _probability(logits: FloatPlanes) -> FloatImage:
    """That there is a keypoint, of each pixel (480, 640), from logits (65, 60, 80)."""
    odds = np.exp(logits - logits.max(axis=0))
    cells = (odds[:-1] / odds.sum(axis=0)).reshape(CELL, CELL, *CELLS)
    return np.asarray(cells.transpose(2, 0, 3, 1).reshape(HEIGHT, WIDTH), np.float32)


def _peaks(likely: FloatImage, width: int, height: int) -> IndexRows:
    """Pixels (n, 2) that are likelier keypoints than all around, within a picture of this size and off its border."""
    highest = cv2.dilate(likely, np.ones((APART, APART), np.uint8))
    peak = (likely == highest) & (likely > LEAST_PROBABILITY)
    rows, columns = np.nonzero(peak[BORDER : max(height - BORDER, BORDER), BORDER : max(width - BORDER, BORDER)])
    return np.column_stack([columns, rows]) + BORDER


def _offsets(likely: FloatImage, pixels: IndexRows) -> PointsNx2:
    """From pixels (n, 2) to the centroid of the probability around each, which is finer than a pixel."""
    beside = np.array([[-1, 0, 1]] * 3, np.float32)
    kernels = beside, np.ascontiguousarray(beside.T), np.ones((3, 3), np.float32)
    across, down, total = (cv2.filter2D(likely, -1, one)[pixels[:, 1], pixels[:, 0]] for one in kernels)
    return np.asarray(np.column_stack([across, down]) / total[:, None], np.float64)


def _sampled(cells: FloatImage, pixels: IndexRows) -> FloatRows:
    """Values (n, k) of cells (60, 80, k) at pixels (n, 2) of the input, interpolated linearly between the cells' middles."""
    at = np.clip((pixels + 0.5) / CELL - 0.5, 0, [CELLS[1] - 1, CELLS[0] - 1])
    first = np.minimum(at.astype(np.intp), [CELLS[1] - 2, CELLS[0] - 2])
    (x, y), (right, below) = first.T, (at - first).astype(np.float32).T[..., None]
    above = cells[y, x] * (1 - right) + cells[y, x + 1] * right
    return np.asarray(above * (1 - below) + (cells[y + 1, x] * (1 - right) + cells[y + 1, x + 1] * right) * below)


def _unit(rows: FloatRows) -> FloatRows:
    """Vectors along the last axis at unit length."""
    length = np.linalg.norm(rows, axis=-1, keepdims=True)
    return np.asarray(rows / np.maximum(length, 1e-9), np.float32)
