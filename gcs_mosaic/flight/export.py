"""A flight for other programs: where every pixel of every frame lies, and the map as one picture."""

from __future__ import annotations

from pathlib import Path
from typing import cast

import cv2
import numpy as np

from gcs_mosaic.errors import UsageError
from gcs_mosaic.flight.disk import write_beside
from gcs_mosaic.flight.documents import Document, write_json
from gcs_mosaic.flight.folder import LEDGER_NAME, find_flight
from gcs_mosaic.flight.ledger import Ledger
from gcs_mosaic.flight.manifest import Contents, last_revision, placements_document
from gcs_mosaic.flight.pyramid import picture
from gcs_mosaic.flight.records import Estimate, FrameState
from gcs_mosaic.stitch.geometry import canvas_from_pixels, pixel_grid

WARP_COLUMNS, WARP_ROWS = 65, 49  # between these points a lens is straight to a hundredth of a pixel
LARGEST_PICTURE = 100_000_000  # pixels; more than most programs open


def export_placements(flight: Path, target: Path) -> str:
    """Write the placements of a flight's ledger with the exact place of a grid of pixels; returns what was done."""
    with Ledger(find_flight(flight) / LEDGER_NAME, read_only=True) as ledger:
        estimates = ledger.estimates()
        unplaced = [*ledger.frames(FrameState.REJECTED), *ledger.frames(FrameState.WAITING)]
        contents = Contents(
            flight="", updated_utc=0, islands=(), accounts=ledger.accounts(), estimates=estimates, unplaced=unplaced
        )
    document = placements_document(contents, last_revision(flight))
    for entry, estimate in zip(cast("list[Document]", document["frames"]), estimates, strict=True):
        entry["warp"] = warp(estimate)
    write_json(target, document)
    return f"{len(estimates)} placements written to {target}"


def warp(estimate: Estimate) -> Document:
    """Where a grid of a frame's pixels lies on the canvas, lens and all; null above the horizon."""
    grid = pixel_grid(estimate.camera, WARP_COLUMNS, WARP_ROWS)
    places = canvas_from_pixels(estimate.pose, estimate.camera, grid).round(3)
    rows = np.where(np.isfinite(places), places, None).reshape(WARP_ROWS, WARP_COLUMNS, 2)
    return {
        "x": grid[:WARP_COLUMNS, 0].tolist(),
        "y": grid[::WARP_COLUMNS, 1].tolist(),
        "canvas": rows.tolist(),
    }
