"""`gcs-mosaic export --format NAME` for the formats of installed extensions."""

from __future__ import annotations

import argparse
from pathlib import Path

from gcs_mosaic.errors import FlightFailed, UsageError
from gcs_mosaic.export.formats import OPTIONS
from gcs_mosaic.export.target import refuse_our_own
from gcs_mosaic.extensions import load, trouble
from gcs_mosaic.interface import read_flight


def export_by_extension(given: argparse.Namespace) -> str:
    """Returns a message. Raises UsageError, and FlightFailed with a sentence for whatever the extension raises."""
    name: str = given.format
    for option, word in OPTIONS.items():
        if getattr(given, option):
            raise UsageError(f"--format {name} is an extension's and knows no {word}: leave it out")
    write = load("exports", name)
    flight = read_flight(given.flight)
    target: Path = given.to or flight.folder / f"mosaic.{name}"
    refuse_our_own(target)
    try:
        return str(write(flight, target) or f"{target} is written")
    except Exception as error:
        raise FlightFailed(trouble("exports", name, "has failed", error)) from error
