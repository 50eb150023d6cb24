"""Reading placements.jsonl, which placements.py writes: for the page's process, which need not load what writes it."""

from __future__ import annotations

import json
from pathlib import Path

from gcs_mosaic.store import inside
from gcs_mosaic.store.reading import LARGEST_DOCUMENT

JOURNAL_NAME = "placements.jsonl"


def told_after(journal: Path, revision: int) -> bytes:
    """The journal's head and its complete lines newer than `revision`."""
    head, *lines = inside.read(journal, journal.parent, LARGEST_DOCUMENT).splitlines(keepends=True)
    if lines and not lines[-1].endswith(b"\n"):
        del lines[-1]
    first = len(lines)
    while first and json.loads(lines[first - 1])["revision"] > revision:
        first -= 1
    return head + b"".join(lines[first:])
