"""placements.json, which lists every frame, and placements.jsonl, a journal of changes since then.

Listing all frames takes longer as a flight grows, so it is done every few seconds; each revision only appends a
line to the journal: a document like placements.json, limited to the changed frames.
"""

from __future__ import annotations

import os
import time
from pathlib import Path

from gcs_mosaic.store import inside
from gcs_mosaic.store.disk import telling_disk_full, write_beside
from gcs_mosaic.store.documents import compact
from gcs_mosaic.store.journal import JOURNAL_NAME
from gcs_mosaic.store.listing import FrameNews, Listing
from gcs_mosaic.store.told_documents import FORMAT, JournalHead

WHOLE_NAME = "placements.json"
WHOLE_EACH_S = 5.0  # maximum age of placements.json while frames arrive,
WHOLE_SHARE = 0.02  # unless writing it would take more than this share of the time
JOURNAL_BYTES = 1 << 18  # a longer journal is restarted, to limit what a newly opened page must read


class Placements:
    """Writes both files of one output folder."""

    def __init__(self, out: Path) -> None:
        self._whole, self._journal = out / WHOLE_NAME, out / JOURNAL_NAME
        self._listing = Listing()
        self._listed = self._told = 0  # revisions: of placements.json, of the journal's last line
        self._lost = False
        self._due = 0.0  # monotonic seconds: earliest next write of placements.json

    def write(self, revision: int, news: FrameNews, *, everything: bool) -> None:
        """Append the news; list every frame too if requested or due. Raises DiskFull.

        placements.json is written first: a reader of the journal and then placements.json misses nothing.
        """
        line = self._listing.text(revision, self._listing.tell(news))
        begin_anew = self._lost or not self._journal.exists()
        if everything or begin_anew or time.monotonic() >= self._due:
            self._list(revision)
            begin_anew |= self._journal.exists() and self._journal.stat().st_size > JOURNAL_BYTES
        self._lost = True  # until it is done: a line may be torn
        if begin_anew:
            since = compact(JournalHead(format=FORMAT, since=revision - 1))
            write_beside(self._journal, f"{since}\n{line}\n".encode("ascii"))
        else:
            append(self._journal, f"{line}\n".encode("ascii"))
        self._told, self._lost = revision, False

    def begin_anew(self) -> None:
        """Both files may be gone, or older than what was written: write them whole next time."""
        self._lost = True

    def catch_up(self) -> None:
        """List every frame, if the journal is ahead of placements.json. Raises DiskFull."""
        if self._listed < self._told:
            self._list(self._told)

    def close(self) -> None:
        """Leave no journal unless it is ahead of placements.json."""
        if self._listed >= self._told:
            inside.remove(self._journal, self._journal.parent)

    def _list(self, revision: int) -> None:
        start = time.monotonic()
        write_beside(self._whole, self._listing.text(revision).encode("ascii"))
        self._listed, now = revision, time.monotonic()
        self._due = now + max(WHOLE_EACH_S, (now - start) / WHOLE_SHARE)


def append(path: Path, data: bytes) -> None:
    """Append a line to a file. A partial write on a full disk is undone. Raises DiskFull."""
    opened = inside.descriptor(path, path.parent, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    with telling_disk_full(path), os.fdopen(opened, "ab", buffering=0) as file:
        size = file.seek(0, os.SEEK_END)
        try:
            rest = memoryview(data)
            while rest:
                rest = rest[file.write(rest) :]
        except BaseException:
            file.truncate(size)
            raise
