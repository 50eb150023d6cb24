"""A package's module with a frame source, a detector and an export, as the three groups of entry points want them.

What its pyproject.toml says of it:

    [project.entry-points."gcs_mosaic.frame_sources"]
    example-folder = "example_extension:frames"
    [project.entry-points."gcs_mosaic.detectors"]
    example-bright = "example_extension:BrightestSpot"
    [project.entry-points."gcs_mosaic.exports"]
    example-csv = "example_extension:write_csv"
"""

import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import gcs_mosaic


def frames(address: str, stop: threading.Event) -> Iterator[tuple[str, bytes]]:
    """A frame source: the files of the folder `address`, in the order of their names. One of a real camera waits for the next."""
    for path in sorted(Path(address).iterdir()):
        if stop.is_set():
            return
        yield path.name, path.read_bytes()


class BrightestSpot:
    """A detector: the brightest pixel, with its brightness as confidence."""

    def __init__(self, confidence: float) -> None:
        self._least = confidence

    def find(self, picture: np.ndarray) -> list[tuple[float, float, float, float, float, int]]:
        grey = picture.max(axis=2)
        y, x = np.unravel_index(int(grey.argmax()), grey.shape)
        confidence = float(grey[y, x]) / 255
        return [(float(x), float(y), 1.0, 1.0, confidence, 0)] if confidence >= self._least else []


def write_csv(flight: gcs_mosaic.FlightReader, target: Path) -> str:
    """An export: a line for each painted frame, with the middle of its outline on the canvas."""
    lines = ["name,island,x,y"]
    for placed in flight.placements():
        x, y = np.nanmean(placed.outline, axis=0)
        lines.append(f"{placed.name},{placed.island},{x:.1f},{y:.1f}")
    target.write_text("\n".join([*lines, ""]))
    return f"{target}: {len(lines) - 1} frames"
