"""What this program is measured against: each frame laid on the one before it by a free homography, and nothing more."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gcs_mosaic.stitch.registration.outcome import Registration
from gcs_mosaic.stitch.registration.registration import register
from gcs_mosaic.stitch.registration.settings import RegistrationSettings
from tests.benchmarks.known_flights import Document, Named


def chained(frames: Sequence[Named], settings: RegistrationSettings) -> Document:
    """A parsed placements.json of the chain; where two frames that follow each other do not match, another island begins."""
    island, canvas_from_frame, entries = 0, np.eye(3), []
    for number, (name, features) in enumerate(frames):
        if number:
            found = register(features, frames[number - 1][1], settings)
            if isinstance(found, Registration):
                canvas_from_frame = canvas_from_frame @ found.b_from_a
                canvas_from_frame /= canvas_from_frame[2, 2]
            else:
                island, canvas_from_frame = island + 1, np.eye(3)
        entries.append({"name": name, "island": island, "canvas_from_frame": canvas_from_frame.tolist()})
    return {"frames": entries}
