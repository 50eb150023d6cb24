"""Collects the files of each shot's bands, and makes one frame of them, or leaves one band as it was.

The first shots wait, a few and for seconds, until it is known how the bands lie on each other; if that does not show, one band is
mapped for the whole flight, so that its frames are of one kind. Later a shot waits for its last file alone.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypeVar

from gcs_mosaic.frames.pending_file import file_and_version
from gcs_mosaic.frames.picture_hash import picture_hash
from gcs_mosaic.frames.shot_names import ShotFile
from gcs_mosaic.messages import CameraCount, Frame, Notice, OtherFile, content_hash

if TYPE_CHECKING:
    from gcs_mosaic.frames.decode import Unreadable
    from gcs_mosaic.frames.multiband.composition import Composer
    from gcs_mosaic.stitch.arrays import Bands

logger = logging.getLogger(__name__)

Item: TypeAlias = Frame | OtherFile | Notice
Load: TypeAlias = "Callable[[Frame], Bands | Unreadable]"
"""A file's pixels, from the bytes that were found."""

QUIET_S = (
    3.0  # without a file of it, until one of the first shots is taken to be whole: files come over seconds by radio
)
MISSING_S = 10.0  # ... of a later shot, until what has not come is missing
LONGEST_S = 20.0  # that the first shots wait
FIRST_SHOTS = 8  # at most
CLEAR_TIMES = 3  # a band is found in the first shots
LEAST_TIMES = 2  # ... when they are over; once may be chance, as of pictures that a counter numbers like bands
FORGET_S = 60.0  # names of files without their reference band
ONE_SHOT_S = 3.0  # between the capture times of its files
HELD_DATA = 8  # reference bands whose bytes are held, too
MOST_SAMPLES = 150_000_000  # of a frame: ten bands of 12 megapixels are 120 million
MOST_REMEMBERED = 20_000

T = TypeVar("T")

_State = Literal["learning", "together", "apart"]


@dataclass(slots=True)
class _Shot:
    began: float
    newest: float  # when its newest file came
    files: dict[str, Frame] = field(default_factory=dict)  # by camera
    reference: str = ""  # camera
    learned: bool = False
    is_whole: bool = False  # no other file is to come


class BandShots:
    """Of one folder. `band_of(name)`: camera and shot of a file that is one of several bands, None of any other. Time is passed
    in."""

    def __init__(self, load: Load, band_of: Callable[[str], ShotFile | None]) -> None:
        self._load, self._band_of = load, band_of
        self._state: _State = "learning"
        self._shots: dict[str, _Shot] = {}
        self._composer: Composer | None = None
        self._bands: tuple[str, ...] = ()  # that are put together, in their order
        self._left_out: dict[str, str] = {}  # cameras of this flight, and why
        self._kinds: tuple[object, ...] | None = None  # size and depth of the reference
        self._done: dict[str, str | None] = {}  # hash of the reference's picture, by the name of its file
        self._said: set[str] = set()
        self._tried = 0  # shots
        self._is_passing = False  # why a file could not be read the last time: it is being written again

    def take(self, item: Frame | OtherFile, now: float) -> Iterator[Item]:
        """A file that has been sorted by `cameras`."""
        frame = item if isinstance(item, Frame) else item.frame
        file = None if self._state == "apart" else self._band_of(frame.name)
        if isinstance(item, OtherFile):
            yield item
        if file is None or file.camera in self._left_out:
            if isinstance(item, Frame):
                yield item
            return
        if isinstance(item, Frame) and self._is_known(item):
            logger.info("%s was written again with the same picture", item.name)
            return
        yield from self._refuted()
        self._add(frame, file, now, is_reference=isinstance(item, Frame))
        yield from self._advance(file.shot, now)

    def take_whole(self, files: Mapping[str, Frame], reference: str, now: float) -> Iterator[Item]:
        """All files of one shot, by camera."""
        frame = files[reference]
        if self._state == "apart":
            yield frame
            return
        self._shots[frame.name] = _Shot(now, now, dict(files), reference, is_whole=True)
        yield from self._advance(frame.name, now)

    def due(self, now: float) -> Iterator[Item]:
        """What has waited long enough."""
        yield from self._refuted()
        if self._state == "learning":
            yield from self._learn(now)
        elif self._state == "together":
            for name in [
                name for name, shot in self._shots.items() if shot.reference and now >= shot.newest + MISSING_S
            ]:
                yield from self._finish(name, now)
        for name in [
            name for name, shot in self._shots.items() if not shot.reference and now >= shot.newest + FORGET_S
        ]:
            del self._shots[name]

    def all_there(self) -> Iterator[Item]:
        """No other file is to come."""
        for shot in self._shots.values():
            shot.is_whole = True
        if self._state == "learning":
            yield from self._learn(0.0, is_last=True)

    def rest(self) -> Iterator[Frame]:
        """The reference bands of all that waits, as there is no time to wait any longer."""
        for name, shot in list(self._shots.items()):
            del self._shots[name]
            if shot.reference:
                yield shot.files[shot.reference]

    def counted(self, cameras: Sequence[CameraCount]) -> tuple[CameraCount, ...]:
        """The same cameras; those whose bands are in the frames are mapped, or will be, for all that is known so far."""
        waiting = {camera for shot in self._shots.values() if shot.reference for camera in shot.files}
        together = set(self._bands) or waiting - self._left_out.keys()
        return tuple(one._replace(mapped=one.mapped or one.name in together) for one in cameras)

    def _is_known(self, frame: Frame) -> bool:
        name, version = file_and_version(frame.name)
        return version > 1 and frame.picture is not None and self._done.get(name) == frame.picture

    def _add(self, frame: Frame, file: ShotFile, now: float, *, is_reference: bool) -> None:
        shot = self._shots.setdefault(file.shot, _Shot(now, now))
        shot.newest = now
        if is_reference:
            shot.reference = file.camera
        is_held = is_reference and sum(bool(one.reference) for one in self._shots.values()) <= HELD_DATA
        shot.files[file.camera] = frame if is_held else replace(frame, data=None)

    def _refuted(self) -> Iterator[Frame]:
        """Pictures whose numbers have shown in the meantime that they are no bands; their like come by themselves."""
        for name, shot in list(self._shots.items()):
            reference = shot.files.get(shot.reference)
            if reference is not None and not shot.is_whole and self._band_of(reference.name) is None:
                del self._shots[name]
                yield reference

    def _advance(self, name: str, now: float) -> Iterator[Item]:
        if self._state == "learning":
            yield from self._learn(now)
            return
        shot = self._shots[name]
        if shot.reference and (shot.is_whole or shot.files.keys() >= set(self._bands)):
            yield from self._finish(name, now)

    # The first shots

    def _learn(self, now: float, *, is_last: bool = False) -> Iterator[Item]:
        shots = [shot for shot in self._shots.values() if shot.reference]
        is_full = len(shots) > FIRST_SHOTS
        for shot in shots[:FIRST_SHOTS]:
            if not shot.learned and (shot.is_whole or is_full or now >= shot.newest + QUIET_S):
                self._learn_of(shot)
                if self._is_enough(CLEAR_TIMES):
                    break
        is_late = bool(shots) and now >= shots[0].began + LONGEST_S
        if self._is_enough(CLEAR_TIMES):
            yield from self._begin(CLEAR_TIMES, now)
        elif is_late and not (is_last or is_full or self._is_enough(LEAST_TIMES)) and self._tried < CLEAR_TIMES:
            yield from self._let_go()
        elif is_last or is_full or is_late:
            yield from self._begin(LEAST_TIMES, now)

    def _let_go(self) -> Iterator[Frame]:
        """Of too few shots to tell, as of one at take-off, the reference is mapped; the next ones go on."""
        for name, shot in list(self._shots.items()):
            if shot.reference and shot.learned:
                del self._shots[name]
                yield shot.files[shot.reference]

    def _learn_of(self, shot: _Shot) -> None:
        shot.learned = True
        self._tried += 1
        images = self._attempt(lambda: self._pixels(shot, list(shot.files)))
        if images is None or len(images) < 2:
            return
        reference = images[shot.reference]
        if self._composer is None or self._composer.reference != shot.reference or self._kinds != _kind(reference):
            self._begin_anew(shot.reference, reference)
        if (composer := self._composer) is not None:
            self._attempt(lambda: composer.learn(images))

    def _begin_anew(self, reference: str, image: Any) -> None:
        from gcs_mosaic.frames.multiband.composition import Composer  # loads what most flights do not need

        self._kinds = _kind(image)
        self._composer = Composer(reference, image.shape[1], image.shape[0])

    def _found(self, times: int) -> list[str]:
        """Bands whose places are known, in their order, with the reference."""
        if self._composer is None:
            return []
        rig, reference = self._composer.rig, self._composer.reference
        return sorted(
            (camera for camera in self._usual() if camera == reference or rig.times(camera) >= times), key=_band_order
        )

    def _usual(self) -> set[str]:
        """Bands that most of the shots have that were looked at."""
        learned = [shot for shot in self._shots.values() if shot.learned]
        counts = Counter(camera for shot in learned for camera in shot.files if camera not in self._left_out)
        return {camera for camera, count in counts.items() if 2 * count > len(learned)}

    def _is_enough(self, times: int) -> bool:
        usual = self._usual()
        return len(usual) > 1 and len(self._found(times)) == len(usual)

    def _begin(self, times: int, now: float) -> Iterator[Item]:
        """The first shots are over."""
        found, held = self._found(times), list(self._shots.items())
        if len(found) < 2:
            self._state = "apart"
            tried = sum(shot.learned for _, shot in held)
            if any(len(shot.files) > 1 for _, shot in held):
                yield _notice("warning", self._apart_in_words(tried))
            yield from self.rest()
            return
        self._state, self._bands = "together", tuple(found)
        for camera in sorted(self._usual() - set(found), key=_band_order):
            self._left_out[camera] = "it cannot be registered to the others by its pixels"
        yield _notice("info", self._together_in_words())
        for name, shot in held:
            if shot.reference and (shot.learned or shot.is_whole or shot.files.keys() >= set(self._bands)):
                yield from self._finish(name, now)

    # Each shot

    def _finish(self, name: str, now: float) -> Iterator[Item]:
        """One frame of it, of several bands if that can be; nothing yet if one is being written again."""
        shot, self._is_passing = self._shots[name], False
        reference = shot.files[shot.reference]
        lacking = [camera for camera in self._bands if camera not in shot.files]
        made, why = (None, f"{_words(lacking)} has not come") if lacking else self._made(shot)
        if made is None and self._is_passing and not shot.is_whole and now < shot.newest + MISSING_S:
            return
        if made is None:
            yield from self._say_alone(reference, why)
        elif len(self._done) < MOST_REMEMBERED:
            self._done[file_and_version(reference.name)[0]] = reference.picture
        del self._shots[name]  # not before: who listens may have stopped, and then takes the rest
        yield made or reference

    def _made(self, shot: _Shot) -> tuple[Frame | None, str]:
        return self._attempt(lambda: self._composed(shot)) or (None, "that failed, the log tells why")

    def _composed(self, shot: _Shot) -> tuple[Frame | None, str]:
        composer = self._composer
        if composer is None or shot.reference != composer.reference:
            return None, "it is of another camera than the first"
        images = self._pixels(shot, self._bands)
        if images is None or _kind(images[shot.reference]) != self._kinds:
            return None, "its reference band cannot be read, or has another size than the first"
        if lacking := [camera for camera in self._bands if camera not in images]:
            return None, f"{_words(lacking)} cannot be read, or has another size, or was taken at another time"
        ordered = {camera: images[camera] for camera in self._bands}
        image = composer.composed(ordered, learned=shot.learned)
        if image is None:
            return None, "its bands do not lie on each other"
        return _frame_of(shot, image, self._bands), ""

    def _attempt(self, make: Callable[[], T]) -> T | None:
        """What fails for one shot, for lack of memory for instance, costs its bands alone."""
        try:
            return make()
        except Exception:
            logger.exception("the bands of a shot could not be put together")
            return None

    def _pixels(self, shot: _Shot, cameras: Sequence[str]) -> dict[str, Any] | None:
        """(h, w) of the reference and of those that are like it; None without the reference."""
        reference = shot.files[shot.reference]
        image = self._band(reference)
        if image is None or image.size * len(cameras) > MOST_SAMPLES:
            return None
        images = {shot.reference: image}
        for camera in cameras:
            frame = shot.files[camera]
            if camera == shot.reference or _are_apart(frame, reference):
                continue
            band = self._band(frame)
            if band is not None and _kind(band) == _kind(image):
                images[camera] = band
            elif band is not None and self._state == "learning":
                self._left_out[camera] = "it has another size"
        return images

    def _band(self, frame: Frame) -> Any:
        from gcs_mosaic.frames.decode import Unreadable

        image = self._load(frame)
        if isinstance(image, Unreadable):
            self._is_passing |= image.passing
            logger.info("%s: its band is not put to the others: %s", frame.name, image)
            return None
        return image[..., 0] if image.shape[2] == 1 else None

    # What is said

    def _say_alone(self, reference: Frame, why: str) -> Iterator[Notice]:
        logger.info("%s: its bands are not put together: %s", reference.name, why)
        if why not in self._said:
            self._said.add(why)
            text = f"{reference.name} is mapped without the other bands of its shot: {why}. So it is done with all such shots"
            yield _notice("warning", text)

    def _together_in_words(self) -> str:
        reference = self._composer.reference if self._composer else ""
        left = "".join(f"; {_words([camera])} is left out: {why}" for camera, why in sorted(self._left_out.items()))
        return (
            f"the {len(self._bands)} bands of each shot are one frame ({_words(self._bands)}), registered by their pixels to "
            f"{_words([reference])}{left}. To map that one alone, set bands: one under frames: in the settings"
        )

    def _apart_in_words(self, tried: int) -> str:
        return (
            f"the bands of each shot are in files of their own, and it does not show in the first {tried} shots how they lie on "
            "each other (water, or ground without structure?): one of them is mapped. To try again, start anew over other ground"
        )


def _frame_of(shot: _Shot, image: Bands, bands: Sequence[str]) -> Frame:
    from gcs_mosaic.frames.multiband.composition import as_tiff

    names = [PurePosixPath(shot.files[camera].name).name for camera in bands]
    data, reference = as_tiff(image, names), shot.files[shot.reference]
    return replace(
        reference,
        path=reference.path / reference.path.name,  # nothing can be there
        data=data,
        content_hash=content_hash(data),
        size=len(data),
        picture=picture_hash(data),
    )


def _kind(image: Any) -> tuple[object, ...]:
    return *image.shape, image.dtype.name


def _are_apart(one: Frame, other: Frame) -> bool:
    return one.captured is not None and other.captured is not None and abs(one.captured - other.captured) > ONE_SHOT_S


def _band_order(camera: str) -> tuple[int, str]:
    digits = "".join(letter for letter in camera if letter.isdecimal())
    return int(digits or 0), camera


def _words(cameras: Sequence[str]) -> str:
    return ", ".join(camera.upper() for camera in cameras)


def _notice(level: Literal["info", "warning"], text: str) -> Notice:
    return Notice(source="frames", level=level, text=text)
