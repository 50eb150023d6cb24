"""Reading the JSON documents of a flight, whoever has written them: within limits of size and nesting, and no link followed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from gcs_mosaic.store import inside
from gcs_mosaic.store.inside import MB

MOSAIC_NAME = "mosaic.json"
# In memory JSON takes up to 20 times its bytes. Documents that grow with the flight are given a limit of their own.
LARGEST_DOCUMENT = 16 * MB  # mosaic.json of some 50,000 islands


def read_document(path: Path, most: int = LARGEST_DOCUMENT) -> dict[str, Any]:
    """A document of an object, in the flight's folder itself. Raises OSError, and ValueError for what is none."""
    try:
        document = json.loads(inside.read(path, path.parent, most))
    except RecursionError:
        raise ValueError("nested too deeply") from None
    if not isinstance(document, dict):
        raise ValueError("not an object")
    return document
