"""Where a map goes: a folder or a bucket that can be written, tried before anything is begun."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gcs_mosaic.archive.files import files_at, is_bucket
from gcs_mosaic.errors import UsageError
from gcs_mosaic.store.disk import CannotWrite
from gcs_mosaic.store.folder import occupied
from gcs_mosaic.store.lock import try_lock

TRIAL = "archive/trial"
OURS = "archive"  # a folder with it holds what an earlier run has made of an archive


@contextmanager
def checked_target(place: str) -> Iterator[str]:
    """The target, written as workers of any folder understand it. Raises UsageError."""
    if is_bucket(place):
        yield _checked_bucket(place.rstrip("/"))
        return
    path = Path(place).resolve()
    with _locked(path):
        yield str(path)


def _checked_bucket(place: str) -> str:
    try:
        files, said = files_at(place), os.urandom(8)
        files.write(TRIAL, said)
        if files.read(TRIAL) != said:
            raise CannotWrite(f"{place}: it does not keep what it is given; name another bucket")
        files.remove(TRIAL)
    except CannotWrite as error:
        raise UsageError(f"--out {error}") from None
    return place


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Raises UsageError if the folder cannot be written, is being written, or holds what is not ours."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        if not (path / OURS).is_dir() and (obstacle := occupied(path)):
            raise UsageError(f"--out {obstacle}: choose another one")
        (path / OURS).mkdir(exist_ok=True)
        lock = try_lock(path)
    except OSError as error:
        raise UsageError(f"--out {path} cannot be written ({error.strerror}): choose another one") from None
    if lock is None:
        raise UsageError(f"--out {path} is being written by another gcs-mosaic: end that one first")
    try:
        yield
    finally:
        lock.release()
