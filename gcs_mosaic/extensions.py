"""Frame sources, detectors and exports of other packages, found by entry points and loaded only when they are asked for.

A package names them in its metadata, and settings or options name them to the program:

    [project.entry-points."gcs_mosaic.exports"]
    my-format = "my_package:write"

* `gcs_mosaic.frame_sources`: a `ReadFrames`, beside the watched folder; `source: NAME` or `source: NAME:ADDRESS`
* `gcs_mosaic.detectors`: called with a confidence, gives a `FindThings`; `hints: {detector: NAME}`
* `gcs_mosaic.exports`: called with a `gcs_mosaic.FlightReader` and a path, writes there and returns what to say;
  `gcs-mosaic export DIR --format NAME`

They run with the program's rights. One that is missing or fails is one sentence, and never the end of a flight.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterator, Sequence
from importlib.metadata import EntryPoint, entry_points
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeAlias

from gcs_mosaic.errors import UsageError

if TYPE_CHECKING:
    import numpy as np

logger = logging.getLogger(__name__)

Kind: TypeAlias = Literal["frame_sources", "detectors", "exports"]
SINGULAR = {"frame_sources": "frame source", "detectors": "detector", "exports": "export format"}


class ReadFrames(Protocol):
    """A frame source."""

    def __call__(self, address: str, stop: threading.Event) -> Iterator[tuple[str, bytes]]:
        """Name and bytes (JPEG, PNG or TIFF) of each frame, until there are no more or `stop` is set; runs on a thread of its
        own. `address` is what stands behind the colon in the settings, or empty."""


class FindThings(Protocol):
    """A detector, as a group's object makes it of the least confidence (0 to 1) that is wanted."""

    def find(self, picture: np.ndarray) -> Sequence[tuple[float, float, float, float, float, int]]:
        """What is in a picture (h, w, 3), 8 bits, blue first: left, top, width, height in pixels, confidence, class."""


def names(kind: Kind) -> list[str]:
    """What is installed of a kind."""
    return sorted({one.name for one in entry_points(group=f"gcs_mosaic.{kind}")})


def load(kind: Kind, name: str) -> Any:
    """The object of that name. Raises UsageError, in a sentence, whatever goes wrong in the other package."""
    what, found = SINGULAR[kind], list(entry_points(group=f"gcs_mosaic.{kind}", name=name))
    if not found:
        known = ", ".join(names(kind)) or "none"
        raise UsageError(f"no {what} {name!r} is installed (there are: {known}): install the package that brings it")
    try:
        loaded = found[0].load()
    except Exception as error:
        logger.debug("%s cannot be loaded", found[0], exc_info=True)
        raise UsageError(trouble(kind, name, "cannot be loaded", error)) from error
    if not callable(loaded):
        raise UsageError(
            f"the {what} {name!r} of {_package_of(found[0])} cannot be used: {found[0].value} is no function"
        )
    return loaded


def trouble(kind: Kind, name: str, what: str, error: BaseException) -> str:
    """What to say of an extension that has raised something: who is to be asked, and about what."""
    package = next((_package_of(one) for one in entry_points(group=f"gcs_mosaic.{kind}", name=name)), "?")
    told = " ".join(str(error).split())[:200]
    return f"the {SINGULAR[kind]} {name!r} of {package} {what} ({type(error).__name__}: {told})"


def _package_of(entry: EntryPoint) -> str:
    return f"{entry.dist.name} {entry.dist.version}" if entry.dist else entry.module
