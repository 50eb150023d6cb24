"""What the search has found, as small inputs."""

from __future__ import annotations

import contextlib
import struct

import pytest

from gcs_mosaic.frames.bands import decode_bands, needs_bands
from gcs_mosaic.frames.integrity import is_whole
from gcs_mosaic.frames.structure import StructureError, Whole
from tests.fuzz.seeds import tiffs


@pytest.mark.parametrize("count", [2, 101])
def test_a_tiff_with_more_extra_samples_than_samples_has_none(count: int) -> None:
    """A negative index was left out of the bands: an IndexError where a reason was promised."""
    data = tiffs()[1]
    entry = struct.pack("<HHI", 338, 3, 1)  # ExtraSamples: one short number
    at = data.index(entry)
    forged = data[:at] + struct.pack("<HHII", 338, 3, count, 0x00010001 if count == 2 else 8) + data[at + 12 :]
    whole = is_whole(forged)
    assert isinstance(whole, Whole)
    assert whole.bands == 2
    assert needs_bands(forged)
    with contextlib.suppress(StructureError):
        assert decode_bands(forged).shape == (16, 24, 2)
