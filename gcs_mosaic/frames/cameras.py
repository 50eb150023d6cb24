"""Several files of one shot (wide, thermal and zoom; bands; a preview beside the picture): one camera is mapped, the others are
told. A map of several cameras at once would show the same ground twice, and an event would find the wrong one's file."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC
from fnmatch import fnmatchcase
from pathlib import Path, PurePosixPath

from gcs_mosaic.frames.alternation import CAMERAS as COUNTED_TOGETHER
from gcs_mosaic.frames.alternation import Alternation
from gcs_mosaic.frames.exif import capture_time
from gcs_mosaic.frames.guesses import AT_ONCE_S, is_beyond_bands, proved
from gcs_mosaic.frames.pending_file import file_and_version
from gcs_mosaic.frames.picture_size import picture_size
from gcs_mosaic.frames.scan import Look
from gcs_mosaic.frames.shot_names import Guess, ShotFile, is_band, shot_file, without_guess
from gcs_mosaic.frames.shot_register import ShotRegister, Size
from gcs_mosaic.frames.small_copies import SizedFile, SmallCopies
from gcs_mosaic.frames.unlike_files import UnlikeFiles, unlike_in
from gcs_mosaic.messages import CameraCount, Frame, OtherFile

HOLD_S = 2.0  # the first files of a camera, until those of others of the same shot are there
HOLD_KIND_S = 1.0  # ... of a TIFF that no more than its ending would tell apart: most have no others beside them
HELD_DATA = 8  # files whose bytes are held, too
ENOUGH_MAPPED = 2  # files of one number, by which a resumed flight knows a band
MOST_TRIES = 3  # of a guess that is not borne out
COPY = "small copy"  # of a frame of the same name, in the place of its camera
CHOSEN = "*"  # name of all that patterns leave out
LOOKED_AT = 16  # first files of a folder that are opened to see whether they are of two sizes in turn
SHARED_AT_LEAST = 0.5  # of all files
_SIZE = re.compile(r"\d+x\d+", re.IGNORECASE)
MOST_ASIDE = 5000  # files of other cameras that can still be taken, should their camera be mapped after all


@dataclass(slots=True)
class _Held:
    frame: Frame
    size: Size
    until: float


class Cameras:
    """Sorts the files of one folder as they come. Pure; time is passed in.

    `patterns` of file names (without regard to case) choose what is mapped; without them one of the cameras is chosen
    that take their shots together. A choice may be corrected: then the files of the other camera come as frames after all.
    """

    def __init__(self, patterns: Sequence[str] = ()) -> None:
        self._patterns = tuple(patterns)
        self._register, self._by_pattern = ShotRegister(), Counter[bool]()
        self._alternation, self._copies, self._copied = Alternation(), SmallCopies(), 0
        self._unlike = UnlikeFiles()
        self._held: list[_Held] = []
        self._settled: set[str] = {"", ".png"}  # cameras whose files are not held any more
        self._proved: set[Guess] = set()
        self._tries = Counter[Guess]()
        self._aside: dict[str, list[Frame]] = {}  # by camera

    def take(self, frame: Frame, size: Size, now: float) -> Iterator[Frame | OtherFile]:
        """A file has come; yields what is decided by it."""
        if self._patterns:
            chosen = is_chosen(frame.name, self._patterns, size)
            self._by_pattern[chosen] += 1
            yield frame if chosen else OtherFile(frame=replace(frame, data=None), camera="", mapped="")
            return
        file = self._file(frame.name)
        if size is not None and self._copies.is_one(SizedFile(frame.name, frame.path, size, frame.modified)):
            self._copied += 1
            yield OtherFile(frame=replace(frame, data=None), camera=COPY, mapped=file.camera)
            return
        if file.camera in COUNTED_TOGETHER and size is not None and (told := self._alternation.note(frame.name, size)):
            yield from self._add_in_turn(frame, told)
            return
        if size is not None:
            self._unlike.note(frame.name, size)
        if file.guess == "bands" and self._is_counter(file, frame):
            yield from self._refuse_bands()
            file = self._file(frame.name)
        if self._held and file.shot not in {self._file(one.frame.name).shot for one in self._held}:
            yield from self._decide()
        if file.guess in self._proved or (file.guess is None and file.camera in self._settled):
            yield from self._add(frame, file, size)
            return
        until = now + (HOLD_KIND_S if file.camera.startswith(".") else HOLD_S)
        self._held.append(_Held(frame if len(self._held) < HELD_DATA else replace(frame, data=None), size, until))

    def resume(self, names: Iterable[str]) -> None:
        """Files of these names were mapped before a restart."""
        told = [] if self._patterns else [(name, shot_file(name)) for name in names]
        self._prove_bands([file for _, file in told if file.guess == "bands"])
        for name, guessed in told:
            file = without_guess(name) if guessed.guess and guessed.guess not in self._proved else guessed
            self._register.add(file)
            self._register.mapped(file.camera)
            self._settled |= {file.camera} if file.guess is None else set()

    def _prove_bands(self, mapped: Sequence[ShotFile]) -> None:
        """Of shots that were mapped by one and the same number, this is a band: a counter would have had others, too."""
        if len(mapped) >= ENOUGH_MAPPED and len({file.camera for file in mapped}) == 1:
            self._proved.add("bands")

    def band_of(self, name: str) -> ShotFile | None:
        """Shot and camera of a file that is one of several bands; None of any other."""
        file = self._file(name)
        if (
            self._patterns
            or not is_band(file_and_version(name)[0], file)
            or (file.guess is not None and file.guess not in self._proved)
        ):
            return None
        return file if len(self._register.group(file.camera)) > 1 else None

    def due(self, now: float) -> Iterator[Frame | OtherFile]:
        """What has been held long enough."""
        if self._held and now >= self._held[0].until:
            yield from self._decide()

    def all_held(self) -> Iterator[Frame | OtherFile]:
        """Everything that is held, as no other file of these shots is to come."""
        if self._held:
            yield from self._decide()

    @property
    def left_out(self) -> int:
        """Files of cameras that are not mapped."""
        return self._by_pattern[False] + self._copied + sum(map(len, self._aside.values()))

    @property
    def counts(self) -> tuple[CameraCount, ...]:
        """The cameras, if there are several; all are mapped if nothing tells which of their files are of one shot."""
        if not self._patterns:
            return self._register.counts() or self._unlike.counts()
        words, left = " or ".join(self._patterns), self._by_pattern[False]
        mapped = CameraCount(words, self._by_pattern[True], mapped=True)
        return (mapped, CameraCount(CHOSEN, left, mapped=False)) if left else ()

    def _file(self, name: str) -> ShotFile:
        name, _ = file_and_version(name)
        file = shot_file(name)
        refused = file.guess is not None and file.guess not in self._proved and self._tries[file.guess] >= MOST_TRIES
        return without_guess(name) if refused else file

    def _decide(self) -> Iterator[Frame | OtherFile]:
        held, self._held = self._held, []
        files = [(self._file(one.frame.name), one.frame.path) for one in held]
        for guess in {file.guess for file, _ in files if file.guess is not None}:
            if proved(guess, files, self._register.cameras_of, more=True):
                self._proved.add(guess)
            self._tries[guess] += 1
        told = [self._believed(one.frame.name, file) for one, (file, _) in zip(held, files, strict=True)]
        for one, file in zip(held, told, strict=True):
            self._register.add(file, one.size, one.frame.captured)
            self._settled.add(file.camera)
        for one, file in zip(held, told, strict=True):
            yield from self._sorted(one.frame, file)

    def _is_counter(self, file: ShotFile, frame: Frame) -> bool:
        """Whether what was believed to be bands is shown by this file to count pictures."""
        if file.guess not in self._proved:
            return False
        return is_beyond_bands(file) or self._register.is_of_another_moment(file, frame.captured, AT_ONCE_S)

    def _refuse_bands(self) -> Iterator[Frame]:
        """All of those left out are frames after all."""
        self._proved.discard("bands")
        self._tries["bands"] = MOST_TRIES
        self._register = ShotRegister()
        cameras = [camera for camera, files in self._aside.items() if shot_file(files[0].name).guess == "bands"]
        frames = [frame for camera in cameras for frame in self._aside.pop(camera)]
        yield from sorted(frames, key=lambda one: one.received)

    def _believed(self, name: str, file: ShotFile) -> ShotFile:
        return file if file.guess is None or file.guess in self._proved else without_guess(name)

    def _add_in_turn(self, frame: Frame, told: Sequence[tuple[str, Size, ShotFile]]) -> Iterator[Frame | OtherFile]:
        """Those of them that came before it showed are frames already."""
        for name, size, file in told:
            self._register.add(file, size, frame.captured if name == frame.name else None)
        yield from self._sorted(frame, told[-1][2])

    def _add(self, frame: Frame, file: ShotFile, size: Size) -> Iterator[Frame | OtherFile]:
        self._register.add(file, size, frame.captured)
        yield from self._sorted(frame, file)

    def _sorted(self, frame: Frame, file: ShotFile) -> Iterator[Frame | OtherFile]:
        mapped = self._register.mapped(file.camera)
        yield from self._aside.pop(mapped, [])
        if mapped == file.camera:
            yield frame
            return
        aside, without = self._aside.setdefault(file.camera, []), replace(frame, data=None)
        if len(aside) < MOST_ASIDE:
            aside.append(without)
        yield OtherFile(frame=without, camera=file.camera, mapped=mapped)


@dataclass(frozen=True, slots=True)
class Chosen:
    """The files that are mapped, in the order given, and what is to be said of the others; empty if there are none.

    `bands`: the files of one shot's bands by camera, by the path of that which is mapped."""

    looks: list[Look]
    said: str = ""
    bands: Mapping[Path, ShotBands] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class ShotBands:
    """Files of the bands of one shot, by camera; `reference` is the camera that is mapped."""

    reference: str
    looks: Mapping[str, Look]


def chosen_of(looks: Sequence[Look], patterns: Sequence[str] = (), *, together: bool = False) -> Chosen:
    """Of files that are all there: those of one camera, where several take each shot. `together`: the bands of each shot are to
    become one frame."""
    if patterns:
        by_size = any(_SIZE.fullmatch(pattern) for pattern in patterns)
        mapped = [
            look for look in looks if is_chosen(look.name, patterns, picture_size(look.path) if by_size else None)
        ]
        left = len(looks) - len(mapped)
        return Chosen(mapped, f"{left} files are left out that are not called {' or '.join(patterns)}" if left else "")
    copies = _small_copies(looks)
    looks = [look for look in looks if look.name not in copies]
    files = _told(looks)
    register, shots = ShotRegister(), Counter(file.shot for file in files)
    for look, file in zip(looks, files, strict=True):
        when = capture_time(look.path) if shots[file.shot] > 1 else None
        register.add(file, captured=None if when is None else when.replace(tzinfo=UTC).timestamp())
    pairs = list(zip(looks, files, strict=True))
    kept = [(look, file) for look, file in pairs if register.mapped(file.camera) == file.camera]
    bands = _bands_of(pairs, kept, register) if together else {}
    cameras = {camera for shot in bands.values() for camera in shot.looks}
    told = f"{len(copies)} small copies of other images are left out, {min(copies)} for one" if copies else ""
    counts = [one._replace(mapped=one.mapped or one.name in cameras) for one in register.counts() or unlike_in(looks)]
    return Chosen([look for look, _ in kept], "; ".join(filter(None, [in_words(counts), told])), bands)


def _bands_of(
    files: Sequence[tuple[Look, ShotFile]], kept: Sequence[tuple[Look, ShotFile]], register: ShotRegister
) -> dict[Path, ShotBands]:
    """Those of shots that have several."""
    shots: dict[str, dict[str, Look]] = {}
    for look, file in files:
        if is_band(look.name, file):
            shots.setdefault(file.shot, {})[file.camera] = look
    found: dict[Path, ShotBands] = {}
    for look, file in kept:
        group, bands = register.group(file.camera), shots.get(file.shot, {})
        mine = {camera: band for camera, band in bands.items() if camera in group}
        if len(group) > 1 and mine.get(file.camera) is look:
            found[look.path] = ShotBands(file.camera, mine)
    return found if any(len(shot.looks) > 1 for shot in found.values()) else {}


def _small_copies(looks: Sequence[Look]) -> set[str]:
    """Names of those; only files whose last name is another's, too, are opened."""
    alike: dict[str, list[Look]] = {}
    for look in looks:
        alike.setdefault(look.path.name.casefold(), []).append(look)
    found = set[str]()
    for several in alike.values():
        sized = [(look, size) for look in several if len(several) > 1 and (size := picture_size(look.path)) is not None]
        copies = SmallCopies()
        for look, size in sorted(sized, key=lambda one: -one[1][0] * one[1][1]):
            if copies.is_one(SizedFile(look.name, look.path, size, look.modified_ns / 1e9)):
                found.add(look.name)
    return found


def _told(looks: Sequence[Look]) -> list[ShotFile]:
    files = [shot_file(look.name) for look in looks]
    register = ShotRegister()
    for file in files:
        register.add(file)
    if len(in_turn := _in_turn(looks, files)) >= SHARED_AT_LEAST * len(looks):
        return [in_turn.get(look.name, file) for look, file in zip(looks, files, strict=True)]
    paths = [(file, look.path) for file, look in zip(files, looks, strict=True)]
    guesses = {file.guess for file in files if file.guess is not None}
    believed = {guess for guess in guesses if proved(guess, paths, register.cameras_of, more=False)}
    return [
        file if file.guess is None or file.guess in believed else without_guess(look.name)
        for file, look in zip(files, looks, strict=True)
    ]


def _in_turn(looks: Sequence[Look], files: Sequence[ShotFile]) -> dict[str, ShotFile]:
    """Files that only their sizes tell apart, by name; none unless the first few already show it, for each is opened."""
    alternation, found = Alternation(), dict[str, ShotFile]()
    for number, (look, file) in enumerate(zip(looks, files, strict=True)):
        if number >= LOOKED_AT and not found:
            return {}
        if file.camera in COUNTED_TOGETHER and (size := picture_size(look.path)) is not None:
            found |= {name: one for name, _, one in alternation.note(look.name, size)}
    return found


def is_chosen(name: str, patterns: Sequence[str], size: Size = None) -> bool:
    """Whether a file of this name (POSIX, with its folders) fits one of the patterns: by its last part, or as a whole; or its
    picture by its size, such as 640x512."""
    whole = file_and_version(name)[0].casefold()
    names = [whole, PurePosixPath(whole).name, *([] if size is None else [f"{size[0]}x{size[1]}"])]
    return any(fnmatchcase(one, pattern.casefold()) for pattern in patterns for one in names)


def in_words(cameras: Sequence[CameraCount]) -> str:
    """What is mapped and what is left out, with what to do; empty if there is one camera."""
    mapped, left = [one for one in cameras if one.mapped], [one for one in cameras if not one.mapped]
    if len(mapped) > 1 and all(_SIZE.fullmatch(one.name) for one in cameras):
        counted = " and ".join(f"{one.name} ({one.files})" for one in mapped)
        return (
            f"Pictures of two cameras come in turn, {counted}, and are mapped together: where one aircraft carries both, map one "
            f"of them, --cameras '{mapped[0].name}' (or cameras: under frames: in the settings)"
        )
    if not mapped or not left:
        return ""
    if left[0].name == CHOSEN:
        return (
            f"{left[0].files} files are left out, for only those called {mapped[0].name} are mapped ({mapped[0].files} so far), "
            "as asked for by --cameras or the settings"
        )
    verb = "is" if len(mapped) == 1 else "are"
    others = ", ".join(f"{_called(one.name)} ({one.files})" for one in left[:8])
    return (
        f"Each shot has several files: {', '.join(_called(one.name) for one in mapped)} {verb} mapped, {others} left out. To map "
        f"another instead, give --cameras '{pattern_of(left[0].name)}' (or cameras: under frames: in the settings), '*' for all"
    )


def _called(camera: str) -> str:
    return (camera if _SIZE.fullmatch(camera) else camera.upper()) or "the plain JPEG"


def pattern_of(camera: str) -> str:
    """A pattern for the names of a camera's files."""
    if _SIZE.fullmatch(camera):
        return camera
    camera = camera.upper()
    if camera.endswith("/"):
        return f"*{camera}*"
    if "." in camera:
        return f"*{camera}"
    return f"*{camera}.*" if camera.startswith("_") else f"{camera}*" if camera else "*.JPG"
