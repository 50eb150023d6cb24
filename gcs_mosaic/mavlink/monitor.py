"""Link monitor: heartbeat and silence tracking, operator notices. No I/O; time is passed in."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Literal

from gcs_mosaic.mavlink.address import LinkAddress, connection_string
from gcs_mosaic.mavlink.flood import FloodGate, Trust, Verdict
from gcs_mosaic.mavlink.messages import MavMessage, decode, decode_offer
from gcs_mosaic.mavlink.settings import LinkSettings
from gcs_mosaic.mavlink.vehicle_choice import MOST_AIRCRAFT, LeftOut, VehicleChoice
from gcs_mosaic.mavlink.vehicle_time import VehicleTimes
from gcs_mosaic.messages import Aircraft, LinkReport, Notice, Refusals, StreamOffer, Teller, TriggerEvent

LinkState = Literal["listening", "heard", "silent", "failed"]

REPORT_EVERY_S = 1.0
MOST_FLOODS_NAMED = 2
HELD_AT_MOST_S = 10.0  # the time in which a full bucket of 200 leaks at 20 a second
MOST_NAMED = 8  # other aircraft listed; system ids can be forged, and the status must stay small
NO_REFUSALS = Refusals()
_REFUSED = {
    "unsigned": "has the aircraft been given the signing key? (a radio's own reports on itself never are signed)",
    "forged": "they are signed with another key, or somebody has changed them",
    "replayed": "they are older than what was heard before; two ways by which the same packets come do that, too",
}
MAV_TYPE_GCS = 6
MAV_AUTOPILOT_INVALID = 8  # a camera, a companion computer
LOOPBACK = ("127.0.0.1", "::1", "localhost")
GROUND_STATION_PORT = 14550  # the default port of every ground station
_AUTOPILOTS = {3: "ArduPilot", 12: "PX4"}
_VEHICLES = {1: "fixed-wing aircraft", 2: "quadrotor", 4: "helicopter", 13: "hexarotor", 14: "octorotor", 30: "camera"}


class Listener:
    """Turns messages into events and notices. Call `tick` periodically, so that silence is detected too."""

    def __init__(
        self,
        address: LinkAddress,
        settings: LinkSettings,
        choice: VehicleChoice,
        started: float,
        utc_of_zero: Callable[[], float],
        trust: Trust | None = None,
    ) -> None:
        """`started` is on the monotonic clock; `utc_of_zero()` is UTC at that clock's zero, and goes on evenly: times of
        several aircraft are compared."""
        self._address, self._settings, self._choice = address, settings, choice
        self._name = connection_string(address)
        self._last_heard, self._ever_heard = started, False
        self._last_heard_utc: float | None = None
        self._utc_of_zero = utc_of_zero
        self._noise, self._noise_at = 0, started  # non-MAVLink bytes as of the last message
        self._reported: tuple[LinkReport, float] | None = None
        self._silent, self._silences = False, 0
        self._left_out = LeftOut()  # triggers of other aircraft
        self._others_said: set[int] = set()
        self._greeted: set[int] = set()  # systems whose first heartbeat was told of
        self._changes = choice.changes
        self._times = VehicleTimes()
        self._refusals_said: set[str] = set()
        self._gate = FloodGate(settings.most_triggers_per_s, settings.most_triggers_at_once, trust)
        self._floods: set[Teller] = set()  # reported, as long as they are few
        self._said_crowded = False
        self._first_vehicle: float | None = None
        self._aircraft: dict[int, Aircraft] = {}  # by system id
        self._ground_station: Literal["unknown", "missing", "heard"] = "unknown"

    def greeting(self, identity: str | None = None) -> Notice:
        """The opening notice; `identity` is ours on the link, if we announce ourselves."""
        manner = f"announcing ourselves as {identity}" if identity else "nothing is ever sent"
        return self._notice("info", f"listening on {self._name}; {manner}")

    def farewell(self, now: float) -> Iterator[TriggerEvent | Notice]:
        """What was still held, and the closing notice."""
        self._choice.look(now, at_once=True)
        yield from self._follow_choice(now)
        yield from self._gate.ripe(now + HELD_AT_MOST_S)
        flood = f"; {self._gate.left_out} triggers of a flood were left out" if self._gate.left_out else ""
        yield self._notice("info", f"{self._name} is closed{flood}")

    def hear(
        self, message: MavMessage, received: float, sender: str = "", latest: float | None = None
    ) -> Iterator[TriggerEvent | StreamOffer | Notice]:
        """Events and notices from a message; most yield none. `sender` is the peer's address, where the link knows it.

        `latest`: when it was read, if `received` is an estimate.
        """
        yield from self._back_again(received)
        self._choice.heard(message.get_srcSystem(), received, autopilot=_is_of_autopilot(message))
        if message.get_type() == "HEARTBEAT":
            yield from self._heartbeat(message, received)
        self._times.hear(message, received)
        if event := decode(message, received):
            yield from self._trigger(replace(self._times.dated(event), latest=latest, sender=sender))
        if offer := decode_offer(message):
            yield offer

    def skips(self, sender: str, data: bytes, now: float) -> bool:
        """Whether to drop a datagram undecoded, as one of a flood that goes on."""
        return self._gate.skips(sender, data, now)

    def tick(
        self, now: float, *, working: bool = True, noise: int = 0, refused: Refusals = NO_REFUSALS, sent: int = 0
    ) -> Iterator[TriggerEvent | Notice | LinkReport]:
        """Time-driven notices and reports.

        `working` is false while the link cannot be opened; `noise` is the number of non-MAVLink bytes so far, `refused` and
        `sent` count packets.
        """
        self._choice.look(now)
        yield from self._follow_choice(now)
        yield from self._gate.ripe(now)
        if self._noise_at != self._last_heard:
            self._noise, self._noise_at = noise, self._last_heard
        report = self._report(working, refused, sent)
        if self._is_news(report, now):
            self._reported = (report, now)
            yield report
        yield from self._refusals(refused)
        if not self._silent and now - self._last_heard > self._settings.silent_after_s:
            self._silent, self._silences = True, self._silences + 1
            but = " but bytes that are not MAVLink (is the speed right?)" if noise > self._noise else ""
            seconds = f"{self._settings.silent_after_s:g} s"
            what = (
                f"{self._name} is silent: nothing for {seconds}"
                if self._ever_heard
                else self._never_heard(seconds, refused)
            )
            yield self._notice("warning", f"{what}{but}")
        waited = now - self._first_vehicle if self._first_vehicle is not None else 0.0
        is_late = waited > self._settings.ground_station_after_s
        may_forward = self._address.kind != "file" and not self._is_forwarded_to_us()
        if self._ground_station == "unknown" and is_late and may_forward:
            self._ground_station = "missing"
            # A ground station that forwards keeps its own heartbeats to itself; on its default port we block it.
            level: Literal["info", "warning"] = "warning" if self._address.port == GROUND_STATION_PORT else "info"
            yield self._notice(level, _no_ground_station(self._name))

    def _never_heard(self, seconds: str, refused: Refusals) -> str:
        if refused == NO_REFUSALS:
            return f"nothing was heard on {self._name} since it was opened, {seconds} ago"
        return f"nothing that is signed with the key was heard on {self._name} since it was opened, {seconds} ago"

    def _is_forwarded_to_us(self) -> bool:
        """Only programs on this machine can reach us there, and no ground station listens there."""
        return self._address.host in LOOPBACK and self._address.port != GROUND_STATION_PORT

    def _refusals(self, refused: Refusals) -> Iterator[Notice]:
        """One warning per reason."""
        for reason, advice in _REFUSED.items():
            if getattr(refused, reason) and reason not in self._refusals_said:
                self._refusals_said.add(reason)
                yield self._notice("warning", f"{reason} packets are refused on {self._name}: {advice}")

    def _report(self, working: bool, refused: Refusals, sent: int) -> LinkReport:
        heard: LinkState = "silent" if self._silent else "heard"
        state: LinkState = "failed" if not working else heard if self._ever_heard else "listening"
        return LinkReport(
            address=self._name,
            state=state,
            last_heard_utc=self._last_heard_utc,
            silences=self._silences,
            followed=self._choice.followed,
            others=self._others(),
            counted=self._choice.counted,
            aircraft=self._aircraft_heard(),
            refused=refused,
            sent=sent,
            is_crowded=self._gate.is_crowded,
            hears_ground_station=self._ground_station == "heard",
        )

    def _is_news(self, report: LinkReport, now: float) -> bool:
        if self._reported is None or report.state != self._reported[0].state:
            return True
        return report != self._reported[0] and now - self._reported[1] >= REPORT_EVERY_S

    def _back_again(self, received: float) -> Iterator[Notice]:
        gap, before = received - self._last_heard, self._ever_heard
        self._last_heard, self._ever_heard = received, True
        self._last_heard_utc = received + self._utc_of_zero()
        if self._silent:
            self._silent = False
            how = f"again after {gap:.0f} s" if before else f"for the first time, {gap:.0f} s after it was opened"
            yield self._notice("info", f"{self._name} is heard {how}")

    def _trigger(self, event: TriggerEvent) -> Iterator[TriggerEvent | Notice]:
        self._aircraft.setdefault(event.vehicle, Aircraft(system=event.vehicle))
        if self._choice.triggered(event.vehicle, event.received):
            yield from self._follow_choice(event.received)
            yield from self._admit(event)
            return
        self._left_out.keep(event)
        yield from self._follow_choice(event.received)
        yield from self._not_followed(event.vehicle)

    def _follow_choice(self, now: float) -> Iterator[TriggerEvent | Notice]:
        """If another aircraft is followed now: let in its triggers that were left out."""
        if self._changes == self._choice.changes:
            return
        self._changes, followed = self._choice.changes, self._choice.followed
        for text in self._choice.news():
            yield self._notice("warning" if self._changes > 1 else "info", text)
        if followed is not None:
            for event in self._left_out.take(followed, now):
                yield from self._admit(event)
        for system in list(self._left_out.counts):
            yield from self._not_followed(system)

    def _not_followed(self, system: int) -> Iterator[Notice]:
        """One warning per system, as long as they are as few as aircraft."""
        followed, counted = self._choice.followed, self._choice.counted
        undecided = followed is None and not counted
        if undecided or system in self._others_said or len(self._others_said) > MOST_NAMED:
            return
        self._others_said.add(system)
        if len(self._others_said) > MOST_NAMED:
            yield self._notice("warning", f"more than {MOST_NAMED} other systems trigger a camera and are left out")
            return
        recorded = self._address.kind == "file"  # whose aircraft cannot be changed meanwhile
        text = _left_out_text(system, followed, self._choice.why, counted, recorded=recorded)
        yield self._notice("warning", text)

    def _others(self) -> tuple[tuple[int, int], ...]:
        """The busiest of the other aircraft, with the number of triggers left out; while none is followed, none is left out."""
        decided = self._choice.followed is not None or self._choice.counted
        others = self._left_out.counts.most_common(MOST_NAMED + 1) if decided else []
        return tuple((system, count) for system, count in others if not self._choice.counts(system))[:MOST_NAMED]

    def _aircraft_heard(self) -> tuple[Aircraft, ...]:
        """Heard last first; system ids can be forged, so not all."""
        newest = sorted(self._aircraft.values(), key=lambda one: -(one.last_heard_utc or 0.0))
        followed = [one for one in newest if self._choice.counts(one.system)]
        return (*followed, *(one for one in newest if one not in followed))[:MOST_NAMED]

    def _admit(self, event: TriggerEvent) -> Iterator[TriggerEvent | Notice]:
        verdict, admitted = self._gate.ask(event)
        yield from self._about_flood(verdict, event.teller)
        yield from admitted

    def _about_flood(self, verdict: Verdict, source: Teller) -> Iterator[Notice]:
        """Each flood once, and its end; where there are more than sources of an aircraft, that there are many."""
        if self._gate.is_crowded and not self._said_crowded:
            self._said_crowded = True
            text = (
                f"more sources trigger cameras on {self._name} than an aircraft has: of those whose pictures were never "
                "found, some are left out (a signing key keeps forgers out)"
            )
            yield self._notice("warning", text)
        if verdict == "closed" and source not in self._floods and len(self._floods) < MOST_FLOODS_NAMED:
            self._floods.add(source)
            most = f"more than {self._settings.most_triggers_per_s:g} times a second"
            also = "; so may others, which are not named" if len(self._floods) == MOST_FLOODS_NAMED else ""
            yield self._notice("warning", f"{source} comes {most}, as from no camera: left out until quieter{also}")
        elif verdict == "opened" and source in self._floods:
            self._floods.discard(source)
            text = f"{source} is quieter again: it is listened to; {self._gate.left_out} triggers were left out so far"
            yield self._notice("info", text)

    def _heartbeat(self, message: MavMessage, received: float) -> Iterator[Notice]:
        system = message.get_srcSystem()
        if message.type == MAV_TYPE_GCS:
            if self._ground_station == "missing":
                yield self._notice("info", f"a ground station (system {system}) is heard on {self._name}")
            self._ground_station = "heard"
            return
        known = self._aircraft.get(system)
        if known is None or known.last_heard_utc is None:
            self._first_vehicle = received if self._first_vehicle is None else self._first_vehicle
            yield from self._greet(system, _described(message))
        if known is None or known.last_heard_utc is None or _is_of_autopilot(message):
            described = _described(message)
        else:
            described = known.described
        heard_utc = received + self._utc_of_zero()
        self._aircraft[system] = Aircraft(system=system, described=described, last_heard_utc=heard_utc)

    def _greet(self, system: int, described: str) -> Iterator[Notice]:
        """A first heartbeat, of whom the operator has named, and as long as those who send one are as few as aircraft."""
        most = MOST_AIRCRAFT if self._choice.is_of_several else MOST_NAMED
        if self._choice.counts(system) or len(self._greeted) < most:
            shown = f" ({described})" if described else ""
            yield self._notice("info", f"first heartbeat on {self._name}: system {system}{shown}")
        elif len(self._greeted) == most:
            text = f"more than {most} systems are heard on {self._name}; further ones are not named"
            yield self._notice("warning", f"{text} (a signing key keeps forgers out)")
        self._greeted.add(system)

    def _notice(self, level: Literal["info", "warning"], text: str) -> Notice:
        return Notice(source=self._name, level=level, text=text)


def _left_out_text(
    system: int, followed: int | None, why: str, counted: tuple[int, ...], *, recorded: bool = False
) -> str:
    left_out = f"system {system} triggers a camera too and is left out, because"
    if counted:
        named = ", ".join(map(str, counted))
        return f"{left_out} this flight is of systems {named}: start with --vehicle {system} too to count it"
    instead = f"start with --vehicle {system} to follow" if recorded else f"gcs-mosaic vehicle {system} follows"
    return f"{left_out} system {followed} is followed ({why}): {instead} it instead"


def _is_of_autopilot(message: MavMessage) -> bool:
    is_heartbeat = message.get_type() == "HEARTBEAT" and message.type != MAV_TYPE_GCS
    return bool(is_heartbeat and message.autopilot != MAV_AUTOPILOT_INVALID)


def _described(heartbeat: MavMessage) -> str:
    names = (_AUTOPILOTS.get(heartbeat.autopilot), _VEHICLES.get(heartbeat.type))
    return ", ".join(name for name in names if name)


def _no_ground_station(name: str) -> str:
    return (
        f"no ground station is heard on {name}: if one should have this link, start it first and let it forward to "
        "another port (QGroundControl forwards to 14445), because only one program can listen on a port"
    )
