"""Frames as a watched folder gives them, of pictures that a test has made."""

from pathlib import Path

import cv2
import numpy as np

from gcs_mosaic.app.waiting.prefetch import DecodedFrame, prepare
from gcs_mosaic.messages import Frame, content_hash
from gcs_mosaic.stitch.features.extraction import FeatureSettings, extract


def written(path: Path, picture: np.ndarray) -> Frame:
    """Write a picture (h, w[, bands]) and take it for a frame of the file's name."""
    cv2.imwrite(str(path), picture)
    data = path.read_bytes()
    return Frame(name=path.name, path=path, content_hash=content_hash(data), size=len(data), received=0.0, modified=0.0)


def decoded(path: Path, picture: np.ndarray) -> DecodedFrame:
    """The same, with its features."""
    found = prepare(written(path, picture), lambda image, reduction: extract(image, FeatureSettings(), reduction))
    assert isinstance(found, DecodedFrame)
    return found
