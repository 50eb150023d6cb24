"""The chain is what it says: exact where frames match, broken where they do not."""

import numpy as np
import pytest

from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.registration.settings import RegistrationSettings
from tests.benchmarks.chained import chained
from tests.benchmarks.known_flights import Named

pytestmark = pytest.mark.long


def frames(shifts: list[float], seed: int) -> list[Named]:
    """Frames of 400 x 300 px that see the same marks, each so far to the right of the first."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(0, [800, 300], (600, 2))
    descriptors = rng.integers(0, 255, (600, 128)).astype(np.uint8)
    found = []
    for number, shift in enumerate(shifts):
        pixels = places - [shift, 0]
        seen = ((pixels >= 0) & (pixels < [400, 300])).all(axis=1)
        found.append((f"{seed}-{number}", Features(pixels[seen].astype(np.float32), descriptors[seen], 400, 300, 1.0)))
    return found


def test_frames_are_laid_on_the_one_before() -> None:
    entries = chained(frames([0, 100, 250], seed=1), RegistrationSettings())["frames"]
    assert [entry["island"] for entry in entries] == [0, 0, 0]
    for entry, shift in zip(entries, [0, 100, 250], strict=True):
        assert np.array(entry["canvas_from_frame"])[:2, 2] == pytest.approx([shift, 0], abs=0.01)


def test_another_island_begins_where_a_frame_does_not_match() -> None:
    entries = chained([*frames([0, 100], seed=1), *frames([0, 50], seed=2)], RegistrationSettings())["frames"]
    assert [entry["island"] for entry in entries] == [0, 0, 1, 1]
    assert np.array(entries[3]["canvas_from_frame"])[:2, 2] == pytest.approx([50, 0], abs=0.01)
