"""Which camera of an aircraft took a file, and in which shot, as its name tells: several files may be of one shot.

Names of DJI (_W, _T, _Z, _V, _D, _MS_NIR), Parrot Sequoia (_GRE, _RGB), MicaSense (IMG_0001_1 to _10), the Phantom 4
Multispectral (DJI_0010.JPG with DJI_0011.TIF to DJI_0015.TIF), Autel (MAX_, IRX_), FLIR (_R), and whoever uses words or
folders for it (thermal/, rgb_0001). Only names are looked at, so it is nothing but a hint: see `cameras`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Literal

TIFF = (".tif", ".tiff")
JPEG = (".jpg", ".jpeg", ".jpe", ".jfif")
Guess = Literal["bands", "tens"]
PLAIN_RANK = 0  # of a file whose name tells no camera; the lower, the better is it for a map
OTHER_KIND_RANK = 5  # beside a JPEG of the same name
SMALL_RANK = 9  # small copies
# Words for a camera, and how good its pictures are for a map: colour and wide first, then bands with much structure, then
# what zooms, then thermal ones.
WORDS = {
    **dict.fromkeys(("rgb", "vis", "visible", "visual", "wide", "color", "colour", "max", "eo"), 0),
    **dict.fromkeys(("green", "gre", "grn"), 1),
    **dict.fromkeys(("red",), 2),
    **dict.fromkeys(("blue", "blu"), 3),
    **dict.fromkeys(("nir",), 4),
    **dict.fromkeys(("rededge", "reg", "re", "pan"), 5),
    **dict.fromkeys(("zoom", "tele"), 6),
    **dict.fromkeys(("thermal", "thrm", "therm", "ir", "irx", "lwir", "tir", "flir"), 7),
    **dict.fromkeys(("mix", "msx", "fusion", "pip"), 8),
    **dict.fromkeys(("thumb", "thumbnail", "preview", "small", "proxy", "lowres", "lores", "screen"), SMALL_RANK),
}
LETTERS = {"w": 0, "v": 0, "d": 0, "s": 1, "g": 1, "r": 7, "z": 6, "t": 7}  # after a number only; _R is radiometric
MULTISPECTRAL = {"g": 1, "r": 2, "b": 3, "nir": 4, "re": 5}  # after _MS_
BANDS = {2: 1, 3: 2, 1: 3, 4: 4, 5: 5}  # of MicaSense: blue, green, red, near infrared, red edge; others after them
BAND_WORDS = frozenset({"green", "gre", "grn", "red", "blue", "blu", "nir", "rededge", "reg", "re"})
_LAST_WORD = re.compile(r"(?P<rest>.*[^_\-. ])[_\-. ]+(?P<word>[a-z]+)", re.DOTALL)
_FIRST_WORD = re.compile(r"(?P<word>[a-z]+)[_\-. ]*(?P<rest>\d.*)", re.DOTALL)
_BAND = re.compile(r"(?P<rest>.*[a-z][_\-]?\d{3,6})_(?P<band>[1-9]\d?)", re.DOTALL)
_TENS = re.compile(r"(?P<rest>dji_\d{3})(?P<band>[1-5])")
_SECONDS = re.compile(r"(?P<date>dji_\d{8})\d{6}(?P<count>_\d{4})$")


@dataclass(frozen=True, slots=True)
class ShotFile:
    """A file's shot (the same for all files of it) and its camera; `rank`: how good that is for a map, 0 best.

    `guess`: what looks like a camera may be a counter, for this reason; it is one only if other files of the shot say so, too.
    """

    shot: str
    camera: str
    rank: int
    guess: Guess | None = None


def shot_file(name: str) -> ShotFile:
    """Of a file's name (POSIX, with its folders)."""
    path = PurePosixPath(name.casefold())
    for folders, stem, camera, rank in _told(path):
        return ShotFile(_shot(folders, stem), camera, rank)
    parts, suffix = path.parent.parts, path.suffix
    if suffix in TIFF and (found := _BAND.fullmatch(path.stem)):
        rank = BANDS.get(int(found["band"]), 8)
        return ShotFile(_shot(parts, found["rest"]), f"_{found['band']}", rank, "bands")
    if suffix in TIFF and (found := _TENS.fullmatch(path.stem)):
        return ShotFile(_shot(parts, f"{found['rest']}0"), f"{found['band']}{suffix}", int(found["band"]), "tens")
    return without_guess(name)


def is_band(name: str, file: ShotFile) -> bool:
    """Whether a file, which is told to be of this camera and shot, holds one band of light, that others of the shot complete."""
    if PurePosixPath(name.casefold()).suffix not in TIFF:
        return False
    return file.guess == "bands" or file.camera.startswith("_ms_") or file.camera.strip("_/") in BAND_WORDS


def without_guess(name: str) -> ShotFile:
    """As `shot_file`, by the whole name: files of one name with other endings are of one shot."""
    path = PurePosixPath(name.casefold())
    shot = _shot(path.parent.parts, path.stem)
    return ShotFile(shot, "", PLAIN_RANK) if path.suffix in JPEG else ShotFile(shot, path.suffix, OTHER_KIND_RANK)


def _shot(folders: Sequence[str], stem: str) -> str:
    """DJI's cameras write their files of one shot up to a second apart, which is in their names."""
    return "/".join([*folders, _SECONDS.sub(r"\g<date>\g<count>", stem)])


def _told(path: PurePosixPath) -> Iterator[tuple[list[str], str, str, int]]:
    """Folders, stem, camera and rank, the first way being the right one; nothing if no word in the name tells a camera."""
    folders, stem = list(path.parent.parts), path.stem
    if (last := _LAST_WORD.fullmatch(stem)) is not None:
        rest, word = last["rest"], last["word"]
        if rest.endswith(("_ms", "-ms")) and word in MULTISPECTRAL:
            yield folders, rest[:-3], f"_ms_{word}", MULTISPECTRAL[word]
        if word in WORDS or (word in LETTERS and rest[-1].isdecimal()):
            yield folders, rest, f"_{word}", WORDS.get(word, LETTERS.get(word, 0))
    first = _FIRST_WORD.fullmatch(stem)
    if first is not None and first["word"] in WORDS:
        yield folders, first["rest"], f"{first['word']}_", WORDS[first["word"]]
    for at, folder in enumerate(folders):
        if folder in WORDS:
            yield [*folders[:at], *folders[at + 1 :]], stem, f"{folder}/", WORDS[folder]
