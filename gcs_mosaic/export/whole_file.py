"""Files and folders that are whole or not there, whatever ends the program meanwhile."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gcs_mosaic.errors import UsageError
from gcs_mosaic.export.export import telling_where


@contextmanager
def whole_file(target: Path) -> Iterator[Path]:
    """A path beside the target to write to, which takes its place in the end. Raises UsageError if that cannot be."""
    if target.is_dir():
        raise UsageError(f"{target} is a folder; give a file with --to.")
    beside = target.with_name(f".{target.name}.part")
    with telling_where(target):
        beside.unlink(missing_ok=True)
        try:
            yield beside
            beside.replace(target)
        finally:
            beside.unlink(missing_ok=True)


@contextmanager
def whole_folder(target: Path) -> Iterator[Path]:
    """The same for a folder, which must not be there, or be empty. Raises UsageError."""
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        raise UsageError(f"{target} is there already, and is left as it is; give another folder with --to.")
    beside = target.with_name(f".{target.name}.part")
    with telling_where(target):
        if beside.exists():
            shutil.rmtree(beside)
        beside.mkdir()
        try:
            yield beside
            beside.replace(target)
        finally:
            shutil.rmtree(beside, ignore_errors=True)
