"""What lasts and wants to be known: each a sentence in operator's words with what to do, for as long as it is true.

Notices tell what happened; a condition is what is so now. The page shows them all (`conditions` in status.json); on the terminal
each is said as it begins, unless another notice says it already.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field

from gcs_mosaic.app.status.folder_conditions import SoNow, of_folders
from gcs_mosaic.messages import LinkReport, Notice, SourceReport
from gcs_mosaic.store.records import Accounts, FrameState
from gcs_mosaic.store.status import AircraftStatus, Behind, Condition

Aircraft = int | None  # None: of a source for all

UNMATCHED = 2  # frames in a row: a single one may be blurred
FRAMES_WITHOUT_TRIGGER = 5  # before any: the first message may follow its file by seconds
BEHIND_S = 10.0  # less is a burst of the camera
SILENT_S = 10.0  # ten heartbeats of an aircraft, as `silent_after_s` of a link
HELD_S = 10.0  # how long something must have been so that passes by itself as messages and files arrive
OLD_RANGE = (
    "The range of brightness that a camera's counts are shown in was fitted again, because frames lay beyond it: parts of the "
    "map are too dark or too bright until they are painted anew, in pauses and at the end"
)
SOURCE_AWAY = {
    "missing": "The folder {name} is missing: it is waited for; see that the card or the share is there",
    "silent": "The stream {name} is silent: see that the camera is on and in reach",
    "lost": "The stream {name} is lost: it is opened again as soon as it can be",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Facts:
    """What conditions follow from; times in seconds since 1970."""

    utc: float
    started_utc: float
    links: tuple[LinkReport, ...] = ()
    source: SourceReport | None = None
    sources: tuple[SourceReport, ...] = ()  # of several aircraft, each one's
    aircraft: tuple[AircraftStatus, ...] = ()  # of several
    behind: Behind = field(default_factory=Behind)
    accounts: Accounts = field(default_factory=Accounts)
    islands: int = 0


class Conditions:
    """Of one flight. Not thread-safe."""

    def __init__(self) -> None:
        self.disk: str | None = None  # what is wrong with it, as long as it is
        self.old_range = False  # whether parts of the map show a range of counts that was fitted anew since
        self.pairing: str | None = None  # which triggers and pictures may as well belong together otherwise
        self._unmatched = Counter[Aircraft]()  # frames in a row that matched nothing, of each aircraft
        self._since: dict[str, float] = {}
        self._told: set[str] = set()
        self._fresh: list[Notice] = []

    def frame(self, state: FrameState, vehicle: Aircraft = None) -> None:
        """A frame has had its turn; `vehicle`: whose it is."""
        if state in (FrameState.PLACED, FrameState.COVERED):
            self._unmatched[vehicle] = 0
        elif state in (FrameState.WAITING, FrameState.REJECTED):
            self._unmatched[vehicle] += 1

    def so_now(self, facts: Facts) -> tuple[Condition, ...]:
        """All that is so now, the worst first; what began or ended since the last call is told by `fresh`."""
        found = list(self._found(facts))
        self._since = {one.key: self._since.get(one.key, facts.utc) for one in found}
        lasting = [one for one in found if facts.utc - self._since[one.key] >= one.held_s]
        self._tell(lasting)
        order = ("error", "warning", "info")
        return tuple(
            Condition(key=one.key, level=one.level, text=one.text, since_utc=self._since[one.key])
            for one in sorted(lasting, key=lambda one: order.index(one.level))
        )

    def fresh(self) -> list[Notice]:
        """What is to be said since the last call."""
        fresh, self._fresh = self._fresh, []
        return fresh

    def _tell(self, lasting: list[SoNow]) -> None:
        for one in lasting:
            if one.said and one.key not in self._told:
                self._fresh.append(Notice(source="daemon", level=one.level, text=one.text))
        keys = {one.key for one in lasting}
        if "islands" in self._told - keys:
            text = "the parts of the map are joined: it is in one piece again"
            self._fresh.append(Notice(source="daemon", level="info", text=text))
        for key in sorted(self._told - keys):
            if over := _over(key):
                self._fresh.append(Notice(source="daemon", level="info", text=over))
        self._told = keys

    def _found(self, facts: Facts) -> Iterator[SoNow]:
        if self.disk is not None:
            yield SoNow("disk", "error", self.disk, said=False)
        yield from self._of_the_map(facts)
        yield from _of_links(facts)
        yield from _of_silent_aircraft(facts)
        yield from _of_the_source(facts)
        yield from of_folders([one for one in (facts.source, *facts.sources) if one], announced=_announced(facts))
        yield from _of_shots(facts)
        if self.pairing is not None:
            yield SoNow("pairing", "warning", self.pairing, held_s=HELD_S)

    def _of_the_map(self, facts: Facts) -> Iterator[SoNow]:
        for vehicle, count in self._unmatched.items():
            if facts.accounts.frames.placed and count >= UNMATCHED:
                whose = "" if vehicle is None else f" of aircraft {vehicle}"
                text = f"The last {count} frames{whose} match nothing on the map: fly back over ground that is on it"
                yield SoNow(f"overlap{whose}", "warning", text)
        if self.old_range:
            yield SoNow("range", "warning", OLD_RANGE)
        if facts.islands > 1:
            text = (
                f"The map is in {facts.islands} parts, and how they lie to each other is not known: "
                "fly over the ground between them"
            )
            yield SoNow("islands", "warning", text, held_s=HELD_S)
        if facts.behind.seconds >= BEHIND_S:
            frames, seconds = facts.behind.frames, facts.behind.seconds
            text = f"The map is {frames} frames, {seconds:.0f} s behind the camera: the newest are shown first"
            yield SoNow("behind", "warning", text, said=False)


def _over(key: str) -> str | None:
    """What to say once this is so no more, if anything."""
    what, _, system = key.partition(" of aircraft ")
    if what == "range":
        return "the whole map is shown in its camera's new range"
    if what == "overlap":
        return f"frames{key.removeprefix('overlap')} match the map again"
    return f"aircraft {system} is heard again" if what == "silence" else None


def _of_links(facts: Facts) -> Iterator[SoNow]:
    for link in facts.links:
        key = f"link {link.address}"
        if link.is_crowded:
            text = (
                f"More sources trigger cameras on {link.address} than an aircraft has: if somebody forges triggers, pictures may "
                "be given to the wrong ones. Only signing keeps them out: give the autopilot a key, and here "
                "link: {signing_key: FILE}"
            )
            yield SoNow(f"crowd {link.address}", "warning", text, said=False)
        if link.state == "failed":
            yield SoNow(
                key, "error", f"The link {link.address} has failed: it is opened again as soon as it can be", said=False
            )
        elif link.last_heard_utc is None and facts.utc - facts.started_utc >= HELD_S:
            text = (
                f"Nothing was ever heard on {link.address}: see that the autopilot or the ground station sends to this "
                "address. Pictures are mapped meanwhile"
            )
            yield SoNow(key, "warning", text, said=False)
        elif link.state == "silent":
            text = f"The link {link.address} is silent: see whether the aircraft is out of reach. Pictures are mapped meanwhile"
            yield SoNow(key, "warning", text, said=False)


def _of_silent_aircraft(facts: Facts) -> Iterator[SoNow]:
    """Those of several whose links go on without them; of one with a link of its own the link is called silent.

    Times of a link are compared with each other alone, for the computer's clock may be set during the flight.
    """
    silent: dict[int, bool] = {}
    for link in facts.links:
        for one in link.aircraft:
            if one.system in link.counted and one.last_heard_utc is not None:
                gone = (link.last_heard_utc or 0.0) - one.last_heard_utc >= SILENT_S
                silent[one.system] = gone and silent.get(one.system, True)
    for system in sorted(system for system, gone in silent.items() if gone):
        text = (
            f"Aircraft {system} is silent while others are heard: see whether it is out of reach. "
            "Its pictures are mapped meanwhile"
        )
        yield SoNow(f"silence of aircraft {system}", "warning", text)


def _of_the_source(facts: Facts) -> Iterator[SoNow]:
    for source in (facts.source, *facts.sources):
        if source is not None and source.state in SOURCE_AWAY:
            key = "source" if source.vehicle is None else f"source of aircraft {source.vehicle}"
            yield SoNow(key, "warning", SOURCE_AWAY[source.state].format(name=source.name), said=False)
        if source is not None and source.reading:
            key = "video" if source.vehicle is None else f"video of aircraft {source.vehicle}"
            text = f"A video is read ({source.reading}): nothing is to be done, its frames come as they are mapped"
            yield SoNow(key, "info", text, said=False)


def _of_aircraft_without_triggers(facts: Facts) -> Iterator[SoNow]:
    for one in facts.aircraft:
        frames, events = one.accounts.frames, one.accounts.events
        came = frames.placed + frames.covered + frames.waiting + frames.rejected
        if one.source is not None and came >= FRAMES_WITHOUT_TRIGGER and not any(asdict(events).values()):
            text = (
                f"Pictures of aircraft {one.system} come, but not one camera trigger: they are mapped, but one that is lost "
                "would not be missed. See that this is its number, and that its autopilot announces its pictures"
            )
            yield SoNow(f"triggers of aircraft {one.system}", "warning", text, held_s=HELD_S)


def _announced(facts: Facts) -> int:
    return sum(asdict(facts.accounts.events).values())


def _of_shots(facts: Facts) -> Iterator[SoNow]:
    events, frames = facts.accounts.events, facts.accounts.frames
    came = frames.placed + frames.covered + frames.waiting + frames.rejected
    heard = any(link.last_heard_utc is not None for link in facts.links)
    if heard and not _announced(facts) and came >= FRAMES_WITHOUT_TRIGGER:
        text = (
            "Pictures come, but not one camera trigger: they are mapped, but one that is lost would not be missed. "
            "See that the autopilot announces its pictures (CAMERA_FEEDBACK or CAMERA_IMAGE_CAPTURED) on this link"
        )
        yield SoNow("triggers", "warning", text, held_s=HELD_S)
        return
    yield from _of_aircraft_without_triggers(facts)
    unannounced = facts.accounts.orphans - events.pending  # triggers that wait may be of some of them
    if unannounced > 0 and events.matched:
        pictures = "1 picture" if unannounced == 1 else f"{unannounced} pictures"
        yield SoNow(
            "orphans", "info", f"{pictures} came without a trigger: mapped as any other", said=False, held_s=HELD_S
        )
    if events.missing:
        shots = "1 shot has" if events.missing == 1 else f"{events.missing} shots have"
        text = f"{shots} no picture: see whether it is on the camera's card; copied into the watched folder, it is still taken"
        yield SoNow("missing", "warning", text, said=False)
