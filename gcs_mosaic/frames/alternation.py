"""Cameras that only their pictures' sizes tell apart: of one counter, two sizes in turn (a visible and a thermal picture of each
shot, as some cameras with two sensors write them). Pure."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import PurePosixPath

from gcs_mosaic.frames.shot_names import ShotFile

PAIRS = 2  # without a gap, until it is believed; a camera whose size is changed by hand goes on with the new one
_COUNTED = re.compile(r"(?P<series>.*?)(?P<count>\d+)(?:_r)?", re.DOTALL)
CAMERAS = ("", "_r")  # whose files may be counted together: DJI's XT2 writes DJI_0001_R.JPG and DJI_0002.JPG
_SMALLER_RANK = 7  # as of a thermal camera

PictureSize = tuple[int, int]


@dataclass(slots=True)
class _Series:
    newest: list[tuple[int, PictureSize, str]]  # counts, sizes and names without a gap
    sizes: tuple[PictureSize, PictureSize] | None = None  # of the first and of the second picture of each shot
    parity: int = 0  # of the count of the first


class Alternation:
    """Of one folder."""

    def __init__(self) -> None:
        self._series: dict[str, _Series] = {}

    def note(self, name: str, size: PictureSize) -> list[tuple[str, PictureSize, ShotFile]]:
        """A picture has come whose name tells no camera. Returns those that are of two cameras in turn, as far as that is news:
        none; the first ones, once it shows; then this one alone."""
        path = PurePosixPath(name.casefold())
        found = _COUNTED.fullmatch(path.stem)
        if found is None:
            return []
        key = f"{path.parent.as_posix()}/{found['series']}"
        series, count = self._series.setdefault(key, _Series([])), int(found["count"])
        if series.sizes is not None:
            return [(name, size, _file(key, series, count, size))] if size in series.sizes else []
        if series.newest and count != series.newest[-1][0] + 1:
            series.newest.clear()
        series.newest.append((count, size, name))
        del series.newest[: -2 * PAIRS]
        if len(series.newest) < 2 * PAIRS or not _in_turn([one for _, one, _ in series.newest]):
            return []
        first = series.newest[0]
        series.sizes, series.parity = (first[1], series.newest[1][1]), first[0] % 2
        return [(called, one, _file(key, series, number, one)) for number, one, called in series.newest]


def _in_turn(sizes: list[PictureSize]) -> bool:
    """One sensor's pictures that are turned, or cropped to another shape, have a side in common: they are one camera's."""
    one, other = sizes[:2]
    return not {*one} & {*other} and sizes == [one, other] * (len(sizes) // 2)


def _file(key: str, series: _Series, count: int, size: PictureSize) -> ShotFile:
    assert series.sizes is not None, "it is known by now"
    shot = count - (count % 2 != series.parity)
    largest = max(series.sizes, key=lambda one: one[0] * one[1])
    return ShotFile(f"{key}{shot} in turn", f"{size[0]}x{size[1]}", 0 if size == largest else _SMALLER_RANK)
