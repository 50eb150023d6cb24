"""Inputs as files, for readers that want a path, and what a refusal is to be like."""

from __future__ import annotations

import atexit
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

from gcs_mosaic.errors import UsageError

LONGEST_SENTENCE = 1000  # characters of a refusal
MEMORY = Path("/dev/shm")  # Linux: a file system in memory


@cache
def folder() -> Path:
    """One of this process, in memory where systems have that; it goes with the process."""
    made = Path(tempfile.mkdtemp(prefix="fuzz-", dir=MEMORY if MEMORY.is_dir() else None))
    atexit.register(shutil.rmtree, made, ignore_errors=True)
    return made


def written(data: bytes, name: str) -> Path:
    """A file with these bytes in place of the last one of this name."""
    path = folder() / name
    path.write_bytes(data)
    return path


@contextmanager
def one_sentence() -> Iterator[None]:
    """What is refused is refused in one line that can be read."""
    try:
        yield
    except UsageError as error:
        said = str(error)
        assert "\n" not in said, "a refusal is one line"
        assert len(said) <= LONGEST_SENTENCE, f"a refusal of {len(said)} characters"
