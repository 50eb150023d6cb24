"""A detector that the operator brings: an ONNX file, run by onnxruntime on one core.

Of the models that are common two outputs are understood: (1, n, 6) or (n, 6) of left, top, right, bottom, confidence and class,
with doubles suppressed; and (1, 4 + classes, n) of middle, size and a confidence per class (YOLOv8 and later).
The input is (1, 3, height, width) float32, red first, 0 to 1; a picture is cut into overlapping pieces of the model's own size.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from gcs_mosaic.errors import UsageError
from gcs_mosaic.extensions import load, trouble
from gcs_mosaic.hints.settings import HintSettings
from gcs_mosaic.stitch.arrays import AnyImage, Array, ImageBGR
from gcs_mosaic.stitch.features.onnx_check import read_model, trouble_of

FREE_SIDE = 640  # px of a piece where the model takes any size
MOST_SIDE = 4096  # px
OVERLAP = 0.2  # of a piece: what lies across a border is whole in the next
SAME = 0.5  # share of their common area from which two boxes are one thing
MOST_BOXES = 300  # of a picture
MOST_ASKED = 10_000  # boxes of a piece of which doubles are sought


@dataclass(frozen=True, slots=True, kw_only=True)
class Detection:
    """Pixels of the analysed picture."""

    left: float
    top: float
    width: float
    height: float
    confidence: float
    label: int


class Detector:
    """Raises UsageError for a file that cannot be used."""

    def __init__(self, path: Path, confidence: float) -> None:
        self._confidence, self._path = confidence, path
        self._session = _session(path)
        (given,) = self._session.get_inputs()[:1]
        self._name = given.name
        self._height, self._width = (
            side if isinstance(side, int) and side > 0 else FREE_SIDE for side in given.shape[2:4]
        )

    def find(self, picture: ImageBGR) -> list[Detection]:
        """What it finds in a picture (h, w, 3), the surest first. Raises UsageError for an output that is not understood."""
        found = [
            one for piece in _pieces(picture, self._width, self._height) for one in self._in_piece(picture, *piece)
        ]
        if not found:
            return []
        boxes = [(one.left, one.top, one.width, one.height) for one in found]
        kept = cv2.dnn.NMSBoxes(boxes, [one.confidence for one in found], self._confidence, SAME)
        return sorted((found[index] for index in np.array(kept).ravel()), key=lambda one: -one.confidence)[:MOST_BOXES]

    def _in_piece(self, picture: ImageBGR, left: int, top: int) -> Iterator[Detection]:
        piece = picture[top : top + self._height, left : left + self._width]
        padded = np.zeros((self._height, self._width, 3), np.uint8)
        padded[: piece.shape[0], : piece.shape[1]] = piece
        given = np.ascontiguousarray(padded[..., ::-1].transpose(2, 0, 1)[None], np.float32) / np.float32(255)
        for x0, y0, x1, y1, confidence, label in self._sure(given):
            if np.isfinite([x0, y0, x1, y1]).all() and x1 > x0 and y1 > y0:
                yield Detection(
                    left=left + float(x0),
                    top=top + float(y0),
                    width=float(x1 - x0),
                    height=float(y1 - y0),
                    confidence=min(float(confidence), 1.0),
                    label=int(label),
                )

    def _sure(self, given: AnyImage) -> Array:
        """(n, 6) boxes of a piece, the surest first.

        Raises UsageError if the model cannot be run, for want of memory, or of sense.
        """
        try:
            output = np.asarray(self._session.run(None, {self._name: given})[0], np.float64)
        except Exception as error:  # its own errors have no common base
            raise UsageError(f"hints: the model {self._path} cannot be run ({_told(error)})") from error
        boxes = _boxes(output)
        sure = boxes[boxes[:, 4] >= self._confidence]
        return sure[np.argsort(-sure[:, 4], kind="stable")[:MOST_ASKED]]


class ExtensionDetector:
    """A detector of another package. Raises UsageError for whatever it raises itself, and for what is no answer."""

    def __init__(self, name: str, confidence: float) -> None:
        self._name = name
        make = load("detectors", name)
        self._detector = self._tried(lambda: make(confidence), "cannot be made")

    def find(self, picture: ImageBGR) -> list[Detection]:
        """What it finds in a picture (h, w, 3), the surest first."""
        found = self._tried(lambda: [_detection(*one) for one in self._detector.find(picture)], "has failed")
        return sorted(found, key=lambda one: -one.confidence)[:MOST_BOXES]

    def _tried(self, attempt: Callable[[], Any], what: str) -> Any:
        try:
            return attempt()
        except Exception as error:
            raise UsageError(f"hints: {trouble('detectors', self._name, what, error)}") from error


def detector_of(settings: HintSettings) -> Detector | ExtensionDetector | None:
    """The detector that the settings name. Raises UsageError for one that cannot be used."""
    if settings.detector is not None:
        return ExtensionDetector(settings.detector, settings.confidence)
    return Detector(Path(settings.model), settings.confidence) if settings.model else None


def _detection(left: float, top: float, width: float, height: float, confidence: float, label: int) -> Detection:
    if not np.isfinite([left, top, width, height, confidence]).all() or width <= 0 or height <= 0:
        raise ValueError(f"{left, top, width, height, confidence} is no box with a confidence")
    sure = min(float(confidence), 1.0)
    return Detection(
        left=float(left), top=float(top), width=float(width), height=float(height), confidence=sure, label=int(label)
    )


def _session(path: Path) -> Any:
    try:
        import onnxruntime
    except ImportError as error:
        raise UsageError(f"hints: the model {path} needs onnxruntime: pip install 'gcs-mosaic[detector]'") from error
    _check(path)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    try:
        session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # its own errors have no common base
        raise UsageError(f"hints: {path} is no model that onnxruntime can load ({_told(error)})") from error
    shape = next((one.shape for one in session.get_inputs()), None) or []
    if len(shape) != 4 or (shape[1] not in (3, "3") and isinstance(shape[1], int)):
        raise UsageError(f"hints: the model {path} takes {str(shape)[:80]}, wanted is (1, 3, height, width)")
    if any(isinstance(side, int) and side > MOST_SIDE for side in shape[2:]):
        raise UsageError(f"hints: the model {path} takes {shape}, and at most {MOST_SIDE} px a side are given")
    return session


def _check(path: Path) -> None:
    """Raises UsageError for a file that is not even loaded."""
    try:
        trouble = trouble_of(read_model(path), path.parent)
    except OSError as error:
        raise UsageError(f"hints: {path} is no model that can be read ({error.strerror})") from error
    except ValueError as error:
        raise UsageError(f"hints: {path} is no model that can be loaded ({error})") from error
    if trouble is not None:
        raise UsageError(f"hints: the model {path} is not loaded, because it {trouble}")


def _told(error: Exception) -> str:
    """On one line that can be read."""
    return " ".join(str(error).split())[:300]


def _boxes(output: Array) -> Array:
    """(n, 6): left, top, right, bottom, confidence, class."""
    if output.ndim == 3 and output.shape[0] == 1:
        output = output[0]
    if output.ndim == 2 and output.shape[1] == 6:
        return output
    if output.ndim == 2 and output.shape[0] > 4:
        middle, half, classes = output[:2].T, output[2:4].T / 2, output[4:]
        best = classes.argmax(axis=0)
        surest = classes.max(axis=0)
        return np.column_stack([middle - half, middle + half, surest, best])
    raise UsageError(f"hints: the model's output {output.shape} is neither (n, 6) nor (1, 4 + classes, n)")


def _pieces(picture: ImageBGR, width: int, height: int) -> Iterator[tuple[int, int]]:
    """Left and top of pieces that cover a picture."""
    for top in _starts(picture.shape[0], height):
        for left in _starts(picture.shape[1], width):
            yield left, top


def _starts(length: int, piece: int) -> list[int]:
    if length <= piece:
        return [0]
    count = int(np.ceil((length - piece) / (piece * (1 - OVERLAP)))) + 1
    return [round(start) for start in np.linspace(0, length - piece, count)]
