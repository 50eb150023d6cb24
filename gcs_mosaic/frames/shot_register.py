"""Cameras of one aircraft that take each shot together, known by the files that have come so far; which of them is mapped."""

from __future__ import annotations

from collections import Counter, OrderedDict, deque
from collections.abc import Iterable
from statistics import median

from gcs_mosaic.frames.shot_names import ShotFile
from gcs_mosaic.messages import CameraCount

Size = tuple[int, int] | None  # width and height in px, where they are known

SHARED = 0.5  # of the files of the camera that has fewer: less may be chance, as of two cameras' counters
AS_MANY = 0.8  # of the most files: among cameras that have so many, the better one for a map is mapped
MANY_MORE, AT_LEAST = 1.5, 3  # times the files, and files beyond that, for which another camera is mapped instead
EARLY_SHOTS = 3  # up to which a better camera, whose files come later, is mapped instead
MOST_SHOTS = 20_000  # kept
ONE_SHOT_S = 3.0  # between the capture times of its files, by one clock
OWN_CLOCK = ("/", "_")  # ends of the names of cameras that are told by folders and prefixes
STEADY_S = 1.0  # ... by two clocks, about their usual difference; times of most cameras are whole seconds
AT_ONCE = 0.8  # of the shots with times: by less, two aircraft or two flights count their pictures alike
COMPARED = 64  # newest shots of two cameras whose capture times are compared


class ShotRegister:
    """Which cameras belong together is told by the shots of which several have a file."""

    def __init__(self) -> None:
        self._shots: OrderedDict[str, dict[str, float | None]] = OrderedDict()  # capture times in s by camera
        self._files: dict[str, Counter[Size]] = {}
        self._shared: dict[str, Counter[str]] = {}
        self._apart: dict[
            tuple[str, str], deque[float]
        ] = {}  # s between the files of two cameras, in the order of their names
        self._rank: dict[str, int] = {}
        self._mapped: set[str] = set()

    def add(self, file: ShotFile, size: Size = None, captured: float | None = None) -> None:
        """A file has come, with its capture time in s; one that is written again counts once."""
        self._rank[file.camera] = file.rank
        files = self._files.setdefault(file.camera, Counter())
        cameras = self._shots.setdefault(file.shot, {})
        if file.camera in cameras:
            if not _are_apart(captured, cameras[file.camera]):
                return
            cameras.clear()  # a counter has begun anew
        files[size] += 1
        for other, when in cameras.items():
            self._shared.setdefault(file.camera, Counter())[other] += 1
            self._shared.setdefault(other, Counter())[file.camera] += 1
            if captured is not None and when is not None:
                apart = captured - when if file.camera < other else when - captured
                self._apart.setdefault(_pair(file.camera, other), deque(maxlen=COMPARED)).append(apart)
        cameras[file.camera] = captured
        if len(self._shots) > MOST_SHOTS:
            self._shots.popitem(last=False)

    def is_of_another_moment(self, file: ShotFile, captured: float | None, most_s: float) -> bool:
        """Whether other files of this one's shot were taken more than so long before or after it, so that they are no shot."""
        return any(_are_apart(captured, when, most_s) for when in self._shots.get(file.shot, {}).values())

    def cameras_of(self, shot: str) -> frozenset[str]:
        """Of whose files one has come."""
        return frozenset(self._shots.get(shot, ()))

    def group(self, camera: str) -> frozenset[str]:
        """The cameras that take their shots together with this one, and itself."""
        found, left = {camera}, [camera]
        while left:
            one = left.pop()
            near = {other for other in self._shared.get(one, ()) if other not in found and self._share(one, other)}
            found |= near
            left += near
        return frozenset(found)

    def mapped(self, camera: str) -> str:
        """The camera that is mapped of this one's group; once chosen, it stays until another is clearly the right one."""
        group = self.group(camera)
        best = min(self._as_many(group), key=self._merit)
        so_far = sorted(group & self._mapped, key=self._merit)
        chosen = best if not so_far or self._is_clear(best, so_far[0]) else so_far[0]
        self._mapped = (self._mapped - group) | {chosen}
        return chosen

    def counts(self) -> tuple[CameraCount, ...]:
        """Of all cameras that share their shots with others; empty if none does."""
        found = [one for one in self._files if len(self.group(one)) > 1]
        counted = [CameraCount(one, self._files[one].total(), one in self._mapped) for one in found]
        return tuple(sorted(counted, key=lambda one: (not one.mapped, one.name)))

    def _share(self, one: str, other: str) -> bool:
        fewer = min(self._files[one].total(), self._files[other].total())
        return self._shared[one][other] >= SHARED * fewer and self._at_once(one, other) >= AT_ONCE

    def _at_once(self, one: str, other: str) -> float:
        """Share of their shots that both took together, as far as it is known. Cameras with folders or prefixes of their own may
        have clocks of their own."""
        apart = self._apart.get(_pair(one, other))
        if not apart:
            return 1.0
        has_own = one.endswith(OWN_CLOCK) or other.endswith(OWN_CLOCK)
        usual, most = (median(apart), STEADY_S) if has_own else (0.0, ONE_SHOT_S)
        return sum(abs(seconds - usual) <= most for seconds in apart) / len(apart)

    def _as_many(self, group: Iterable[str]) -> list[str]:
        most = max(map(self._most_alike, group))
        return [one for one in group if self._most_alike(one) >= AS_MANY * most]

    def _most_alike(self, camera: str) -> int:
        """Files of one size: a zoom that changes its size is not one camera."""
        return max(self._files[camera].values())

    def _merit(self, camera: str) -> tuple[int, int, str]:
        return self._rank[camera], -self._most_alike(camera), camera

    def _is_clear(self, best: str, so_far: str) -> bool:
        if self._most_alike(best) >= MANY_MORE * self._most_alike(so_far) + AT_LEAST:
            return True
        return self._rank[best] < self._rank[so_far] and self._files[so_far].total() <= EARLY_SHOTS


def _pair(one: str, other: str) -> tuple[str, str]:
    return (one, other) if one < other else (other, one)


def _are_apart(one: float | None, other: float | None, most_s: float = ONE_SHOT_S) -> bool:
    return one is not None and other is not None and abs(one - other) > most_s
