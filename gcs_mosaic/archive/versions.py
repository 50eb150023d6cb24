"""What a process computes with: two that differ in it may bring different tiles."""

from __future__ import annotations

import platform
from functools import cache
from importlib.metadata import PackageNotFoundError, version

import cv2
import distributed
import numpy as np
import scipy

from gcs_mosaic.store.checkpoint import program_digest


@cache
def versions() -> dict[str, str]:
    """Versions by name, of this process."""
    decoding = {name: _installed(name) for name in ("tifffile", "imagecodecs")}
    return decoding | {
        "gcs-mosaic": program_digest().hex()[:12],
        "Python": ".".join(platform.python_version_tuple()[:2]),
        "mahotas": _installed("mahotas"),  # finds features, if asked for
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "OpenCV": cv2.__version__,
        "distributed": distributed.__version__,
    }


@cache
def made_with() -> str:
    """All of it that an artefact may depend on."""
    return repr(sorted((name, found) for name, found in versions().items() if name != "distributed"))


def _installed(package: str) -> str:
    """Its version; packages that may be missing change by that what can be read."""
    try:
        return version(package)
    except PackageNotFoundError:
        return "none"


class OtherVersions(Exception):  # noqa: N818 - names a state
    """A worker that joined later has other versions than the client."""


@cache
def one_thread() -> None:
    """A worker has one core: let no library take more."""
    cv2.setNumThreads(1)
