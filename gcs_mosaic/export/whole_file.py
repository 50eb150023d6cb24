"""Files and folders that are whole or not there, whatever ends the program meanwhile, and whoever else writes the same."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from gcs_mosaic.errors import UsageError
from gcs_mosaic.export.export import telling_where
from gcs_mosaic.store import inside
from gcs_mosaic.store.disk import sync_file
from gcs_mosaic.store.lock import is_still_there, lock_file


@contextmanager
def whole_file(target: Path) -> Iterator[Path]:
    """A path beside the target to write to, which takes its place in the end. Raises UsageError if that cannot be."""
    if target.is_dir():
        raise UsageError(f"{target} is a folder; give a file.")
    beside = target.with_name(f".{target.name}.part")
    with telling_where(target):
        _make_way(beside, inside.is_file)
        beside.touch()
        with _held(beside, target):
            try:
                os.truncate(beside, 0)  # what a program that was killed has left
                yield beside
                sync_file(beside)
                beside.replace(target)
            except BaseException:
                beside.unlink(missing_ok=True)
                raise


@contextmanager
def whole_folder(target: Path) -> Iterator[Path]:
    """The same for a folder, which must not be there, or be empty. Raises UsageError."""
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        raise UsageError(f"{target} is there already, and is left as it is; give another folder.")
    beside = target.with_name(f".{target.name}.part")
    with telling_where(target):
        _make_way(beside, inside.is_folder)
        beside.mkdir(exist_ok=True)
        with _held(beside, target):
            try:
                for left in beside.iterdir():
                    shutil.rmtree(left) if inside.is_folder(left, beside) else inside.remove(left, beside)
                yield beside
                beside.replace(target)
            except BaseException:
                shutil.rmtree(beside, ignore_errors=True)
                raise


def _make_way(beside: Path, is_ours: Callable[[Path, Path], bool]) -> None:
    """Remove a link, or whatever else is in the place of what a killed export has left, and would lead elsewhere."""
    if not is_ours(beside, beside.parent):
        inside.remove(beside, beside.parent)


@contextmanager
def _held(beside: Path, target: Path) -> Iterator[None]:
    """Until what is beside the target has taken its place, or is gone: of two exports at once neither moves what the other has
    half written. Raises UsageError."""
    if os.name != "posix":  # an open file cannot be moved there
        yield
        return
    descriptor = os.open(beside, os.O_RDONLY)
    try:
        try:
            lock_file(descriptor)
            is_ours = is_still_there(descriptor, beside)
        except BlockingIOError:
            is_ours = False
        except OSError:  # some network file systems have no locks
            is_ours = True
        if not is_ours:
            raise UsageError(f"{target} is being written by another export: wait for it, or give another file.")
        yield
    finally:
        os.close(descriptor)
