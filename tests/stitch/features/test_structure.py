"""What shows nothing: shutters, covered lenses, noise. What shows little ground under much noise is none of these."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest
from faint_frames import fixed_pattern, frame, scene

from gcs_mosaic.stitch.features.extraction import FeatureSettings, extract
from tests import thermal
from tests.sure import sure

RNG = np.random.default_rng(0)


def jpeg(levels: np.ndarray) -> np.ndarray:
    coded = cv2.imencode(".jpg", np.clip(levels, 0, 255).astype(np.uint8))[1]
    picture: np.ndarray = sure(cv2.imdecode(coded, cv2.IMREAD_COLOR))
    return picture


def counts(picture: np.ndarray) -> np.ndarray:
    rounded: np.ndarray = np.rint(picture).astype(np.uint16)[..., None]
    return rounded


NOTHING: dict[str, Callable[[], np.ndarray]] = {
    "black": lambda: np.zeros((480, 640, 3), np.uint8),
    "one tone": lambda: np.full((480, 640, 1), 27_000, np.uint16),
    "a shutter": lambda: counts(thermal.shutter()),
    "a noisy shutter": lambda: counts(thermal.shutter(noise=60.0)),
    "a small sensor's shutter": lambda: counts(thermal.shutter()[:120, :160]),
    "a covered lens": lambda: np.clip(RNG.normal(3, 2, (480, 640, 3)), 0, 255).astype(np.uint8),
    "a covered lens after JPEG": lambda: jpeg(RNG.normal(4, 2, (1200, 1600, 3))),
    "noise in colour after JPEG": lambda: jpeg(RNG.normal(100, 12, (480, 640, 3))),
    "noise in grey": lambda: np.clip(RNG.normal(128, 12, (480, 640)), 0, 255).astype(np.uint8),
}


@pytest.mark.parametrize("name", NOTHING)
def test_it_shows_nothing(name: str) -> None:
    found = extract(NOTHING[name](), FeatureSettings())
    assert found.shows_nothing
    assert len(found) == 0


SOMETHING: dict[str, Callable[[], np.ndarray]] = {
    "cold ground": lambda: counts(thermal.flown(1)[0]),
    "cold ground of a small sensor": lambda: counts(thermal.flown(1)[0][:120, :160]),
    "ground under noise": lambda: frame(scene(), 100, 100, 1, contrast=1.0, noise=3.0),
    "ground under a fixed pattern": lambda: frame(scene(), 100, 100, 1, contrast=2.0, pattern=fixed_pattern(9.0)),
    "a night with a lamp": lambda: night(),
    "snow with a track": lambda: snow(),
    "plants in rows": lambda: rows(0.4),
    "plants in rows along a side": lambda: rows(0.0),
    "rows without gaps along a side": lambda: rows(0.0, gaps=0),
}


def night() -> np.ndarray:
    dark = RNG.normal(4, 2, (480, 640))
    dark[200:230, 300:330] = 200
    return np.clip(dark, 0, 255).astype(np.uint8)


def snow() -> np.ndarray:
    white = RNG.normal(225, 3, (480, 640)).astype(np.float32)
    cv2.polylines(white, [np.array([[0, 300], [200, 260], [420, 330], [639, 200]])], False, 205, 5)
    return np.clip(white, 0, 255).astype(np.uint8)


def rows(turned: float, gaps: int = 6) -> np.ndarray:
    """A field of plants that are all alike, 10 px from row to row, so many from plant to plant, under a sensor's noise."""
    down, across = np.mgrid[:480, :640].astype(np.float32)
    along, beside = across * np.cos(turned) + down * np.sin(turned), down * np.cos(turned) - across * np.sin(turned)
    plants = np.cos(2 * np.pi * beside / 10) * (1 + np.cos(2 * np.pi * along / gaps) if gaps else 1)
    field = 110 + 8 * plants[..., None] + RNG.normal(0, 7, (480, 640, 3))
    picture: np.ndarray = np.clip(field, 0, 255).astype(np.uint8)
    return picture


@pytest.mark.parametrize("name", SOMETHING)
def test_it_shows_something(name: str) -> None:
    assert not extract(SOMETHING[name](), FeatureSettings()).shows_nothing
