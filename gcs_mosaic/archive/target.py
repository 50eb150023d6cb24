"""Where a map goes: a folder or a bucket that can be written, tried before anything is begun.

It is ours if it holds nothing of a flight, or `MARKER`, which an earlier run of this command has left. A run that has made
nothing leaves nothing.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path, PurePath

from gcs_mosaic.archive.artefacts import Files
from gcs_mosaic.archive.files import UNFINISHED, files_at, is_bucket
from gcs_mosaic.errors import UsageError
from gcs_mosaic.store import inside
from gcs_mosaic.store.disk import CannotWrite
from gcs_mosaic.store.folder import ARTEFACTS, OUR_NAMES, occupied, refuse_strange_parts
from gcs_mosaic.store.lock import LOCK_NAME, try_lock

MARKER = f"{ARTEFACTS}/gcs-mosaic-reprocess"
TRIAL = f"{ARTEFACTS}/trial"
PACKING = "packing-"  # begins the name of a folder in which a map is put together


@contextmanager
def checked_target(place: str) -> Iterator[str]:
    """The target, written as workers of any folder understand it. Raises UsageError."""
    if is_bucket(place):
        bucket = place.rstrip("/")
        with _claimed_bucket(bucket):
            yield bucket
        return
    path = _whole_path(place)
    with _locked(path), _claimed(path):
        yield str(path)


def refuse_source_in_target(sources: Sequence[str], place: str) -> None:
    """Raises UsageError if a source is the target, whose pictures are no frames from then on, or in what is replaced there."""
    target = _parts(place)
    for source in sources:
        parts = _parts(source)
        if parts == target and (is_bucket(source) or Path(source).is_dir()):
            raise UsageError(
                f"--out {place} is the folder of frames itself: choose another one, such as {place.rstrip('/')}/map"
            )
        ours = [(*target, *PurePath(name).parts) for name in (*OUR_NAMES, ARTEFACTS)]
        if any(parts[: len(own)] == own for own in ours):
            raise UsageError(f"--out {place} holds {source}, which the map would take the place of: choose another one")


def _parts(place: str) -> tuple[str, ...]:
    """Of a path or a bucket, comparable."""
    if is_bucket(place):
        scheme, _, rest = place.partition("://")
        return scheme, *filter(None, rest.split("/"))
    return _whole_path(place).parts


def _whole_path(place: str) -> Path:
    try:
        return Path(place).resolve()
    except OSError as error:  # the folder in which we are is gone
        raise UsageError(f"{place} cannot be found ({error.strerror}): name a whole path") from None


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Raises UsageError if the folder cannot be written, or is being written. It goes again if nothing has come into it."""
    new = [folder for folder in (path, *path.parents) if not folder.exists()]
    had_lock = inside.exists(path / LOCK_NAME, path)
    try:
        path.mkdir(parents=True, exist_ok=True)
        lock = try_lock(path)
    except OSError as error:
        _remove_empty(new)
        raise UsageError(f"--out {path} cannot be written ({error.strerror}): choose another one") from None
    if lock is None:
        raise UsageError(f"--out {path} is being written by another gcs-mosaic: end that one first")
    try:
        yield
    finally:
        if not had_lock and not inside.exists(path / MARKER, path):
            with suppress(OSError):
                inside.remove(path / LOCK_NAME, path)
            _remove_empty(new)
        lock.release()


@contextmanager
def _claimed(path: Path) -> Iterator[None]:
    """A locked folder. Raises UsageError if it holds what is not ours."""
    archive, marker = path / ARTEFACTS, path / MARKER
    refuse_strange_parts(path)
    is_ours = inside.is_file(marker, path)
    if not is_ours and (obstacle := occupied(path)):
        raise UsageError(f"--out {obstacle}: choose another one")
    try:
        if not is_ours and archive.exists() and (not archive.is_dir() or any(archive.iterdir())):
            raise UsageError(f"--out {path} has its own {ARTEFACTS}, which is left as it is: choose another one")
        archive.mkdir(exist_ok=True)
        marker.touch()
        for left in (archive / UNFINISHED, *archive.glob(f"{PACKING}*")):  # by a run that was killed
            inside.remove_folder(left, path)
    except OSError as error:
        raise UsageError(f"--out {path} cannot be written ({error.strerror}): choose another one") from None
    try:
        yield
    finally:
        _remove_empty([archive / UNFINISHED])
        with suppress(OSError):
            if not is_ours and [one.name for one in archive.iterdir()] == [marker.name]:
                marker.unlink()
                archive.rmdir()


def _remove_empty(folders: list[Path]) -> None:
    """The innermost first."""
    with suppress(OSError):
        for folder in folders:
            folder.rmdir()


@contextmanager
def _claimed_bucket(place: str) -> Iterator[None]:
    """Raises UsageError if it cannot be written, or holds what is not ours."""
    try:
        files = files_at(place)
        is_ours = files.size(MARKER) is not None
        if not is_ours and (name := _held(files)):
            raise UsageError(f"--out {place} has its own {name}, which is left as it is: choose another one")
        _try_to_keep(files, place)
        files.write(MARKER, b"")
    except CannotWrite as error:
        raise UsageError(f"--out {error}") from None
    try:
        yield
    finally:
        if not is_ours:
            with suppress(CannotWrite):
                if all(one.name == MARKER for one in files.listed(ARTEFACTS)):
                    files.remove(MARKER)


def _held(files: Files) -> str | None:
    """What of a flight, or in the artefacts' place, there is already; None if nothing."""
    for name in (*OUR_NAMES, ARTEFACTS):
        if files.size(name) is not None or next(iter(files.listed(name)), None) is not None:
            return name
    return None


def _try_to_keep(files: Files, place: str) -> None:
    said = os.urandom(8)
    files.write(TRIAL, said)
    if files.read(TRIAL) != said:
        raise CannotWrite(f"{place}: it does not keep what it is given; name another bucket")
    files.remove(TRIAL)
