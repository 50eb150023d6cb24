"""What lasts and wants to be known: each a sentence in operator's words with what to do, for as long as it is true.

Notices tell what happened; a condition is what is so now. The page shows them all (`conditions` in status.json); on the terminal
each is said as it begins, unless another notice says it already. Of an ended flight those are left that are still true of it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, field, replace

from gcs_mosaic.app.status.folder_conditions import SoNow, of_folders
from gcs_mosaic.app.status.link_conditions import (
    HELD_S,
    Refusing,
    hears_only_ground_stations,
    of_links,
    of_silent_aircraft,
)
from gcs_mosaic.frames.rtsp.address import AUTO
from gcs_mosaic.messages import LinkReport, Notice, SourceReport
from gcs_mosaic.store.held_out import Figures, torn_lines
from gcs_mosaic.store.records import Accounts, FrameState
from gcs_mosaic.store.status import AircraftStatus, Behind, Condition, frames_words

Aircraft = int | None  # None: of a source for all

UNMATCHED = 2  # frames in a row: a single one may be blurred
FRAMES_WITHOUT_TRIGGER = 5  # before any: the first message may follow its file by seconds
BEHIND_S = 10.0  # less is a burst of the camera
OLD_RANGE = (
    "The range of brightness that a camera's counts are shown in was fitted again, because frames lay beyond it: parts of the "
    "map are too dark or too bright until they are painted anew, in pauses and at the end"
)
OLD_RANGE_LEFT = (
    "Parts of the map are too dark or too bright, there was no time to paint them in the camera's new range: gcs-mosaic --resume "
    "does it"
)
NOT_MAPPED = "Not on the map: {n} of {all} frames, refused or without a match; flight.log tells why of each"
NOT_READ = "Not on the map: {n} of {all} frames, damaged or dropped; flight.log tells why of each"
SOURCE_AWAY = {
    "missing": "The folder {name} is missing: it is waited for; see that the card or the share is there",
    "silent": "The stream {name} is silent: see that the camera is on and in reach",
    "lost": "The stream {name} is lost: it is opened again as soon as it can be",
}
SEE_TO_STREAM = (
    "see that the camera is on and in reach, and that address and password are right; it is tried until it comes"
)
NONE_ANNOUNCED = "The aircraft tells of no stream (rtsp: auto): give its address, --rtsp rtsp://HOST:554/NAME"
UNASKED = (
    "The stream {name} {come}, but not one camera trigger: nothing of it {was} mapped. See that the autopilot announces its "
    "pictures, or start with --every overlap, which needs no triggers"
)
FROZEN = (
    "The stream {name} has shown the same picture for {s:.0f} s: if the aircraft moves, the camera or its encoder is frozen and "
    "nothing new comes on the map. Start the camera's video again; its shots may still be on its card"
)
NO_PICTURE_OF_STREAM = (
    "{shots} no picture: the stream brought none of that time; if the camera's card has it, gcs-mosaic stitch maps it"
)

OF_OTHER_CAMERAS = (
    "Shots of cameras that are not mapped: {n}. Their files have come and are left out; nothing is to be done"
)
NOT_PAIRED = (
    "Shots without a picture: {shots}, pictures without a trigger: {pictures}. Which belong together is decided when the flight "
    "ends; a picture that is still on the camera's card is taken once it is copied into the watched folder"
)


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
    held_out: Figures = field(default_factory=dict)
    of_other_cameras: int = 0  # missing shots whose files have come, of cameras that are not mapped


class Conditions:
    """Of one flight. Not thread-safe."""

    def __init__(self) -> None:
        self.disk: str | None = None  # what is wrong with it, as long as it is
        self.old_range = False  # whether parts of the map show a range of counts that was fitted anew since
        self.pairing: str | None = None  # which triggers and pictures may as well belong together otherwise
        self.left: dict[str, str] = {}  # what the flight ends without, and what to do
        self._refusing = Refusing()
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

    def so_now(self, facts: Facts, *, ending: bool = False) -> tuple[Condition, ...]:
        """All that is so now, the worst first; what began or ended since the last call is told by `fresh`.

        `ending`: nothing is listened for any more, the map is being finished.
        """
        found = list(self._found(facts))
        self._since = {one.key: self._since.get(one.key, facts.utc) for one in found}
        lasting = [one for one in found if facts.utc - self._since[one.key] >= one.held_s]
        self._tell(lasting)
        return self._worst_first(one for one in lasting if not (ending and one.hoped))

    def at_the_end(self, facts: Facts) -> tuple[Condition, ...]:
        """All that stays true of the ended flight, the worst first; what was never told is told by `fresh`."""
        stays = [
            replace(one, text=one.stays) for one in (*self._found(facts), *_of_the_map_for_good(facts)) if one.stays
        ]
        left = [*stays, *(SoNow(key, "warning", text, said=False) for key, text in self.left.items())]
        self._since = {one.key: self._since.get(one.key, facts.utc) for one in left}
        told = {*self._told, "pairing"}  # of which the daemon has the last words
        new = [one for one in left if one.said and one.key not in told]
        self._fresh += [Notice(source="daemon", level=one.level, text=one.text) for one in new]
        self._told = {one.key for one in left}
        return self._worst_first(left)

    def _worst_first(self, found: Iterable[SoNow]) -> tuple[Condition, ...]:
        order = ("error", "warning", "info")
        return tuple(
            Condition(key=one.key, level=one.level, text=one.text, since_utc=self._since[one.key])
            for one in sorted(found, key=lambda one: order.index(one.level))
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
        refused = self._refusing.lately(facts.links, facts.utc)
        yield from of_links(facts.links, facts.utc, facts.started_utc, refused, stays=_without_triggers(facts))
        yield from of_silent_aircraft(facts.links)
        yield from _of_the_source(facts)
        yield from _of_streams(facts)
        yield from of_folders([one for one in (facts.source, *facts.sources) if one], announced=_announced(facts))
        yield from _of_shots(facts)
        if self.pairing is not None:
            yield SoNow("pairing", "warning", self.pairing, held_s=HELD_S, stays=self.pairing)

    def _of_the_map(self, facts: Facts) -> Iterator[SoNow]:
        for vehicle, count in self._unmatched.items():
            if facts.accounts.frames.placed and count >= UNMATCHED:
                whose = "" if vehicle is None else f" of aircraft {vehicle}"
                text = f"The last {count} frames{whose} match nothing on the map: fly back over ground that is on it"
                yield SoNow(f"overlap{whose}", "warning", text)
        if self.old_range:
            yield SoNow("range", "warning", OLD_RANGE, stays=OLD_RANGE_LEFT)
        if facts.islands > 1:
            text = (
                f"The map is in {facts.islands} parts, and how they lie to each other is not known: "
                "fly over the ground between them"
            )
            yield SoNow("islands", "warning", text, held_s=HELD_S, stays=f"{text} with gcs-mosaic --resume")
        if facts.behind.seconds >= BEHIND_S:
            frames, seconds = facts.behind.frames, facts.behind.seconds
            text = f"The map is {frames_words(frames)}, {seconds:.0f} s behind the camera: the newest are shown first"
            yield SoNow("behind", "warning", text, said=False)


def _of_the_map_for_good(facts: Facts) -> Iterator[SoNow]:
    """What is certain once no frame comes any more: before, one that waits may find its place, a damaged one be mended."""
    frames = facts.accounts.frames
    total = sum(asdict(frames).values()) - frames.duplicate
    for key, count, words in (
        ("not mapped", frames.rejected + frames.waiting, NOT_MAPPED),
        ("not read", frames.damaged + frames.dropped, NOT_READ),
    ):
        if count:
            text = words.format(n=count, all=total)
            yield SoNow(key, "warning", text, stays=text)
    for text in torn_lines(facts.held_out):
        yield SoNow(f"torn {text.partition(' is torn')[0]}", "warning", text, said=False, stays=text)


def _of_streams(facts: Facts) -> Iterator[SoNow]:
    """Streams of which nothing is mapped: none has come yet, nobody asks for pictures, or they show nothing new."""
    for source in (facts.source, *facts.sources):
        if source is None or source.kind != "stream":
            continue
        whose = "" if source.vehicle is None else f" of aircraft {source.vehicle}"
        if source.same_since_utc is not None and source.state == "connected":
            text = FROZEN.format(name=source.name, s=facts.utc - source.same_since_utc)
            yield SoNow(f"frozen{whose}", "warning", text)
        if source.taken:
            continue
        if source.state == "connecting":
            text = (
                NONE_ANNOUNCED if source.name == AUTO else f"No stream has come from {source.name} yet: {SEE_TO_STREAM}"
            )
            yield SoNow(f"source{whose}", "warning", text, said=False, held_s=HELD_S)
        elif source.seen and not _announced(facts):
            stays = UNASKED.format(name=source.name, come="came", was="was")
            now = UNASKED.format(name=source.name, come="comes", was="is")
            yield SoNow(f"unasked{whose}", "warning", now, held_s=HELD_S, stays=stays)


def _over(key: str) -> str | None:
    """What to say once this is so no more, if anything."""
    what, _, system = key.partition(" of aircraft ")
    if what == "range":
        return "the whole map is shown in its camera's new range"
    if what == "overlap":
        return f"frames{key.removeprefix('overlap')} match the map again"
    if what == "frozen":
        if system:
            return f"the stream of aircraft {system} does not show the same picture any more"
        return "the stream does not show the same picture any more"
    return f"aircraft {system} is heard again" if what == "silence" else None


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
                f"Pictures of aircraft {one.system} {{come}}, but not one camera trigger: they are mapped, but one that is lost "
                "would not be missed. See that this is its number, and that its autopilot announces its pictures"
            )
            key, now, then = f"triggers of aircraft {one.system}", text.format(come="come"), text.format(come="came")
            yield SoNow(key, "warning", now, held_s=HELD_S, stays=then)


def _announced(facts: Facts) -> int:
    return sum(asdict(facts.accounts.events).values())


def _without_triggers(facts: Facts, come: str = "came") -> str:
    """What to say if pictures come, or came, and triggers do not; empty if they do."""
    frames = facts.accounts.frames
    mapped = frames.placed + frames.covered + frames.waiting + frames.rejected
    if _announced(facts) or mapped < FRAMES_WITHOUT_TRIGGER:
        return ""
    return (
        f"Pictures {come}, but not one camera trigger: they are mapped, but one that is lost would not be missed. "
        "See that the autopilot announces its pictures (CAMERA_FEEDBACK or CAMERA_IMAGE_CAPTURED) on this link"
    )


def _of_shots(facts: Facts) -> Iterator[SoNow]:
    events = facts.accounts.events
    heard = any(link.last_heard_utc is not None for link in facts.links)
    if heard and (text := _without_triggers(facts, "come")):
        if not hears_only_ground_stations(facts.links):  # else that is the reason, and told of the link
            yield SoNow("triggers", "warning", text, held_s=HELD_S, stays=_without_triggers(facts))
        return
    yield from _of_aircraft_without_triggers(facts)
    unannounced = facts.accounts.orphans - events.pending  # triggers that wait may be of some of them
    if unannounced > 0 and events.matched:
        pictures = "1 picture" if unannounced == 1 else f"{unannounced} pictures"
        text = f"{pictures} came without a trigger: mapped as any other"
        yield SoNow("orphans", "info", text, said=False, held_s=HELD_S, stays=text)
    if facts.of_other_cameras:
        text = OF_OTHER_CAMERAS.format(n=facts.of_other_cameras)
        yield SoNow("shots of other cameras", "info", text, said=False, stays=text)
    if events.missing > facts.of_other_cameras:
        yield _of_missing(facts, events.missing - facts.of_other_cameras, unannounced)


def _of_missing(facts: Facts, missing: int, unannounced: int) -> SoNow:
    """Shots whose pictures have not come, or are not known among `unannounced` ones: of files that are copied after landing
    neither counters nor times tell that before all are there."""
    shots = "1 shot has" if missing == 1 else f"{missing} shots have"
    if {one.kind for one in (facts.source, *facts.sources) if one} == {"stream"}:
        text = NO_PICTURE_OF_STREAM.format(shots=shots)
        return SoNow("missing", "warning", text, said=False, stays=text)
    what = f"{shots} no picture: see whether it is on the camera's card; copied into the watched folder, "
    stays = f"{what}gcs-mosaic --resume still takes it"
    if unannounced > 0:
        text = NOT_PAIRED.format(shots=missing, pictures=unannounced)
        return SoNow("missing", "info" if unannounced >= missing else "warning", text, said=False, stays=stays)
    return SoNow("missing", "warning", f"{what}it is still taken", said=False, stays=stays)
