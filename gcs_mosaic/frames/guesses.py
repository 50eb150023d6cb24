"""Whether numbers at the ends of names are bands of one shot (IMG_0001_1.tif), or count pictures. Pure but for EXIF times."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import TypeAlias

from gcs_mosaic.frames.exif import capture_time
from gcs_mosaic.frames.shot_names import Guess, ShotFile

Files: TypeAlias = Sequence[tuple[ShotFile, Path]]

AT_ONCE_S = 1.0  # bands of one shot are taken within this
MOST_BANDS = 10  # of a camera; numbers beyond count pictures
ENOUGH = 4  # bands of one shot, of a camera that writes no time


def are_bands(files: Files, *, more_to_come: bool) -> bool:
    """Whether files that are guessed to be `bands` are. `more_to_come`: these are the first, and came at once."""
    shots: dict[str, dict[str, Path]] = {}
    for file, path in files:
        shots.setdefault(file.shot, {})[file.camera] = path
    if any(is_beyond_bands(file) for file, _ in files):
        return False
    several = [bands for bands in shots.values() if len(bands) > 1]
    times = [sorted(filter(None, map(capture_time, bands.values()))) for bands in several[:3]]
    if any(len(taken) > 1 for taken in times):
        return all(_at_once(taken) for taken in times if len(taken) > 1)
    if more_to_come:
        return any(len(bands) >= ENOUGH for bands in several)
    return any(len(one.keys() & other.keys()) > 1 for one, other in pairwise(several))


def is_beyond_bands(file: ShotFile) -> bool:
    """Whether what is guessed to be a band has a number that no camera's band has."""
    return file.guess == "bands" and int(file.camera[1:]) > MOST_BANDS


def are_tens(files: Iterable[ShotFile], cameras_of: Callable[[str], frozenset[str]]) -> bool:
    """Whether files that are guessed to be the bands beside a JPEG of a round number are: it is there, and none of their own."""
    guessed = list(files)
    own = [file.shot[:-1] + file.camera[0] for file in guessed]
    return any("" in cameras_of(file.shot) for file in guessed) and not any("" in cameras_of(shot) for shot in own)


def proved(guess: Guess, files: Files, cameras_of: Callable[[str], frozenset[str]], *, more: bool) -> bool:
    """Whether this guess is right of these files; `more` are to come."""
    own = [(file, path) for file, path in files if file.guess == guess]
    return are_bands(own, more_to_come=more) if guess == "bands" else are_tens((file for file, _ in own), cameras_of)


def _at_once(times: Sequence[datetime]) -> bool:
    """Two pictures a second apart may be two of one camera; of three, bands are as far apart where a second begins."""
    span_s = (times[-1] - times[0]).total_seconds()
    return span_s < AT_ONCE_S or (span_s == AT_ONCE_S and len(times) >= ENOUGH)
