"""How far each frame lies from its true place, against its number: before (frame on frame) and after (this program).

    python -m tests.benchmarks.error_plot FLIGHT... --to FILE.png [--also LABEL=PLACEMENTS.json]

FLIGHT: a folder of frames whose truth is known (known_flights.py), or a number of frames of a simulated survey over hills,
houses and trees, with wind, tilts and climbs. `--also`: another map of the first flight, such as
`gcs-mosaic export --format placements` of an earlier version wrote it.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from pathlib import Path

import cv2
import numpy as np

import sitl.flight
from gcs_mosaic.stitch.arrays import ImageBGR
from gcs_mosaic.stitch.mosaic import StitchSettings
from sitl.camera import Camera
from tests.benchmarks.chained import chained
from tests.benchmarks.error_chart import Curve, Panel, draw_errors
from tests.benchmarks.known_flights import (
    Document,
    KnownFlight,
    Named,
    base_name,
    document,
    features_in,
    known_flight,
    read_document,
    stitched,
)
from tests.benchmarks.long_flights import LENS, SIZE, long_route


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.error_plot", allow_abbrev=False)
    parser.add_argument("flights", nargs="+", metavar="FLIGHT", help="folder of frames, or a number of simulated ones")
    parser.add_argument("--to", type=Path, required=True, metavar="FILE.png")
    parser.add_argument(
        "--also", action="append", default=[], metavar="LABEL=FILE", help="placements of the first flight"
    )
    given = parser.parse_args()
    also = {label: read_document(Path(path)) for label, _, path in (words.partition("=") for words in given.also)}
    panels = [_panel(flight, {} if number else also) for number, flight in enumerate(given.flights)]
    given.to.write_bytes(png(draw_errors(panels)))


def _panel(flight: str, also: dict[str, Document]) -> Panel:
    if not flight.isdigit():
        return panel(known_flight(Path(flight)), features_in(Path(flight), StitchSettings().features), also)
    with tempfile.TemporaryDirectory() as folder:
        simulate(int(flight), Path(folder))
        return panel(known_flight(Path(folder)), features_in(Path(folder), StitchSettings().features), also)


def panel(flight: KnownFlight, frames: list[Named], also: dict[str, Document]) -> Panel:
    """Both ways of placing these frames, and maps that others made of them."""
    settings = StitchSettings()
    ways = {
        "frame on frame": chained(frames, settings.registration),
        "gcs-mosaic": document(stitched(frames, settings)),
        **also,
    }
    names = [base_name(name) for name, _ in frames]
    curves = []
    for label, placements in ways.items():
        found = flight.judge(placements)
        errors = {base_name(name): error for name, error in found.frames_px.items()}
        print(
            f"{flight.name}, {label}: {found.placed} of {len(frames)} placed, {found.islands} islands, {found.ortho_px:.1f} px"
        )
        curves.append(Curve(label, np.array([errors.get(name, math.nan) for name in names])))
    return Panel(f"{flight.name}, {len(frames)} frames", curves)


def simulate(frames: int, folder: Path) -> None:
    """Render a long survey over hills, houses and trees."""
    sitl.flight.make("survey", folder, SIZE, camera=Camera(lens=LENS), relief=1.0, route=long_route(frames))


def png(picture: ImageBGR) -> bytes:
    """Compressed as well as it goes."""
    return cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 9])[1].tobytes()


if __name__ == "__main__":
    main()
