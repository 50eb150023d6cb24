"""A task: a pure function of artefacts and numbers that makes one artefact, and what runs it on a worker."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from distributed import get_worker

from gcs_mosaic.archive.artefacts import Artefacts, Lost
from gcs_mosaic.archive.decoding import core_s
from gcs_mosaic.archive.files import files_at
from gcs_mosaic.archive.versions import OtherVersions, made_with, one_thread, versions

Summary = Any  # numbers and names: all of a result that travels
Parts = Mapping[str, object]  # of an artefact; "summary" is one of them
SUMMARY = "summary"


@dataclass(frozen=True, slots=True)
class StageTask:
    """`work(artefacts, *arguments)` makes the parts of the artefact `key`. `hints` are further arguments that change nothing of
    the result, such as where a file lies."""

    work: Callable[..., Parts]
    key: str
    arguments: tuple[Any, ...]
    hints: tuple[Any, ...] = ()


@dataclass(frozen=True, slots=True)
class Made:
    """A task's summary; `seconds` of a core, 0 if the artefact was there."""

    summary: Summary
    seconds: float


@dataclass(frozen=True, slots=True)
class Unmade:
    """Why a task brought nothing; `lost`: the artefact that it missed; `damaged`: the picture is to blame."""

    reason: str
    lost: str | None = None
    damaged: bool = False


class Passing(Exception):  # noqa: N818 - names a state
    """Why a task brings nothing this time, in words: what lies with the machine or the moment, not with what the artefact is made
    from, is never stored. `damaged`: a picture that cannot be decoded within its limits."""

    def __init__(self, reason: str, *, damaged: bool = False) -> None:
        super().__init__(reason, damaged)
        self.reason, self.damaged = reason, damaged

    def __str__(self) -> str:
        return self.reason


@dataclass(frozen=True, slots=True)
class Batch:
    """Tasks that one worker runs one after another."""

    store: str
    tasks: tuple[StageTask, ...]
    versions: Mapping[str, str]  # of the client
    anew: bool = False  # although their artefacts seem to be there


def task(work: Callable[..., Parts], *arguments: Any, hints: tuple[Any, ...] = ()) -> StageTask:
    """A task with its key: a hash of the function, program and libraries, and the arguments: numbers, texts and settings."""
    name = work.__name__
    told = repr((work.__module__, name, made_with(), arguments))
    return StageTask(work, f"{name}/{hashed(told)}", arguments, hints)


def hashed(text: str) -> str:
    """A short name for a text."""
    digest = hashlib.blake2b(text.encode(), digest_size=16).hexdigest()
    return f"{digest[:2]}/{digest[2:]}"


def listed(artefacts: Artefacts, values: Sequence[Any]) -> str:
    """Put a list into the store that would be too long to travel with each task; returns its key."""
    key = f"lists/{hashed(repr((made_with(), tuple(values))))}"
    try:
        artefacts.whole(key, "list")
    except Lost:
        artefacts.put(key, {"list": list(values)})
    return key


def run_batch(batch: Batch) -> list[Made | Unmade]:
    """On a worker: make the artefacts of these tasks that are not there. Raises OtherVersions."""
    if versions() != batch.versions:
        raise OtherVersions(f"a worker has {versions()}, here it is {dict(batch.versions)}")
    one_thread()
    artefacts = artefacts_at(batch.store)
    return [_run(artefacts, one, anew=batch.anew) for one in batch.tasks]


def _run(artefacts: Artefacts, one: StageTask, *, anew: bool) -> Made | Unmade:
    try:
        if not anew:
            return Made(artefacts.whole(one.key, SUMMARY), 0.0)
    except Lost:
        pass
    start = core_s()
    try:
        parts = one.work(artefacts, *one.arguments, *one.hints)
    except Lost as error:
        return Unmade(f"the store has lost {error.key}", error.key)
    except Passing as error:
        return Unmade(error.reason, damaged=error.damaged)
    except MemoryError:
        return Unmade("the worker has not enough memory for it")
    artefacts.put(one.key, parts)
    return Made(parts.get(SUMMARY), core_s() - start)


def scratch_folder() -> str | None:
    """The worker's own folder for what a task needs for a while, removed with the worker; None outside of one."""
    try:
        return str(get_worker().local_directory)
    except ValueError:
        return None


@lru_cache(4)
def artefacts_at(place: str) -> Artefacts:
    """The artefacts of a store; one object in each process."""
    return Artefacts(files_at(place))
