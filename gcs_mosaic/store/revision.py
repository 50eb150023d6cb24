"""The revision of a flight's folder; a module of its own, so that the page's process need not load what writes it."""

from __future__ import annotations

import logging
from pathlib import Path

from gcs_mosaic.store.reading import MOSAIC_NAME, read_document

logger = logging.getLogger(__name__)


def last_revision(out: Path) -> int:
    """The revision of the folder's mosaic.json, 0 if there is no readable one."""
    try:
        return int(read_document(out / MOSAIC_NAME)["revision"])
    except FileNotFoundError:
        return 0
    except (OSError, ValueError, KeyError, TypeError, OverflowError):
        logger.warning("mosaic.json cannot be read: its revisions begin anew", exc_info=True)
        return 0
