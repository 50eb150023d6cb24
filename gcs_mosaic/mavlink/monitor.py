"""Link monitor: vehicle selection, heartbeat and silence tracking, operator notices. No I/O; time is passed in."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Literal

from gcs_mosaic.mavlink.address import LinkAddress, connection_string
from gcs_mosaic.mavlink.flood import FloodGate, TriggerSource, Verdict
from gcs_mosaic.mavlink.messages import MavMessage, decode, decode_offer
from gcs_mosaic.mavlink.settings import LinkSettings
from gcs_mosaic.mavlink.vehicle_time import VehicleTimes
from gcs_mosaic.messages import LinkReport, Notice, Refusals, StreamOffer, TriggerEvent

LinkState = Literal["listening", "heard", "silent", "failed"]

REPORT_EVERY_S = 1.0
MOST_NAMED = 8  # other aircraft listed; system ids can be forged, and the status must stay small
NO_REFUSALS = Refusals()
_REFUSED = {
    "unsigned": "has the aircraft been given the signing key? (a radio's own reports on itself never are signed)",
    "forged": "they are signed with another key, or somebody has changed them",
    "replayed": "they are older than what was heard before; two ways by which the same packets come do that, too",
}
MAV_TYPE_GCS = 6
LOOPBACK = ("127.0.0.1", "::1", "localhost")
GROUND_STATION_PORT = 14550  # the default port of every ground station
_AUTOPILOTS = {3: "ArduPilot", 12: "PX4"}
_VEHICLES = {1: "fixed-wing aircraft", 2: "quadrotor", 4: "helicopter", 13: "hexarotor", 14: "octorotor", 30: "camera"}


class VehicleChoice:
    """The one aircraft whose triggers are used; shared by all links, so that they agree on it."""

    def __init__(self, wanted: int | None = None) -> None:
        self.wanted = wanted
        self._chosen: dict[str, int] = {} if wanted is None else {"id": wanted}

    @property
    def followed(self) -> int | None:
        """System id of the followed aircraft; None until one triggers."""
        return self._chosen.get("id")

    def follows(self, event: TriggerEvent) -> bool:
        """Whether `event` comes from the followed aircraft; without a configured one, the first asked about is chosen."""
        # A single, hence atomic, dictionary call: links on several threads may ask at once.
        return self._chosen.setdefault("id", event.vehicle) == event.vehicle


class Listener:
    """Turns messages into events and notices. Call `tick` periodically, so that silence is detected too."""

    def __init__(
        self, address: LinkAddress, settings: LinkSettings, choice: VehicleChoice, started: float, utc_of_zero: float
    ) -> None:
        """`started` is on the monotonic clock; `utc_of_zero` is UTC at that clock's zero."""
        self._address, self._settings, self._choice = address, settings, choice
        self._name = connection_string(address)
        self._last_heard, self._ever_heard = started, False
        self._utc_of_zero = utc_of_zero
        self._noise, self._noise_at = 0, started  # non-MAVLink bytes as of the last message
        self._reported: tuple[LinkReport, float] | None = None
        self._silent, self._silences = False, 0
        self._others: Counter[int] = Counter()  # triggers of other aircraft by system id
        self._times = VehicleTimes()
        self._refusals_said: set[str] = set()
        self._gate = FloodGate(settings.most_triggers_per_s, settings.most_triggers_at_once)
        self._first_vehicle: float | None = None
        self._systems: set[int] = set()
        self._ground_station: Literal["unknown", "missing", "heard"] = "unknown"

    def greeting(self, identity: str | None = None) -> Notice:
        """The opening notice; `identity` is ours on the link, if we announce ourselves."""
        manner = f"announcing ourselves as {identity}" if identity else "nothing is ever sent"
        return self._notice("info", f"listening on {self._name}; {manner}")

    def farewell(self) -> Notice:
        """The closing notice."""
        flood = f"; {self._gate.left_out} triggers of a flood were left out" if self._gate.left_out else ""
        return self._notice("info", f"{self._name} is closed{flood}")

    def hear(
        self, message: MavMessage, received: float, sender: str = ""
    ) -> Iterator[TriggerEvent | StreamOffer | Notice]:
        """Events and notices from a message; most yield none. `sender` is the peer's address, where the link knows it."""
        yield from self._back_again(received)
        if message.get_type() == "HEARTBEAT":
            yield from self._heartbeat(message, received)
        self._times.hear(message, received)
        if event := decode(message, received):
            source = TriggerSource(sender, event.vehicle, event.component, message.get_type())
            yield from self._trigger(self._times.dated(event), source)
        if offer := decode_offer(message):
            yield offer

    def tick(
        self, now: float, *, working: bool = True, noise: int = 0, refused: Refusals = NO_REFUSALS, sent: int = 0
    ) -> Iterator[Notice | LinkReport]:
        """Time-driven notices and reports.

        `working` is false while the link cannot be opened; `noise` is the number of non-MAVLink bytes so far, `refused` and
        `sent` count packets.
        """
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
            yield self._notice("warning", f"{self._name} is silent: nothing for {seconds}{but}")
        waited = now - self._first_vehicle if self._first_vehicle is not None else 0.0
        is_late = waited > self._settings.ground_station_after_s
        if self._ground_station == "unknown" and is_late and not self._is_forwarded_to_us():
            self._ground_station = "missing"
            # A ground station that forwards keeps its own heartbeats to itself; on its default port we block it.
            level: Literal["info", "warning"] = "warning" if self._address.port == GROUND_STATION_PORT else "info"
            yield self._notice(level, _no_ground_station(self._name))

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
        heard_utc = self._last_heard + self._utc_of_zero if self._ever_heard else None
        heard: LinkState = "silent" if self._silent else "heard"
        state: LinkState = "failed" if not working else heard if self._ever_heard else "listening"
        return LinkReport(
            address=self._name,
            state=state,
            last_heard_utc=heard_utc,
            silences=self._silences,
            followed=self._choice.followed,
            others=tuple(self._others.most_common(MOST_NAMED)),
            refused=refused,
            sent=sent,
        )

    def _is_news(self, report: LinkReport, now: float) -> bool:
        if self._reported is None or report.state != self._reported[0].state:
            return True
        return report != self._reported[0] and now - self._reported[1] >= REPORT_EVERY_S

    def _back_again(self, received: float) -> Iterator[Notice]:
        gap = received - self._last_heard
        self._last_heard, self._ever_heard = received, True
        if self._silent:
            self._silent = False
            yield self._notice("info", f"{self._name} is heard again after {gap:.0f} s")

    def _trigger(self, event: TriggerEvent, source: TriggerSource) -> Iterator[TriggerEvent | Notice]:
        if self._choice.follows(event):
            verdict = self._gate.ask(source, event.received)
            yield from self._about_flood(verdict, source)
            if verdict in ("admitted", "opened"):
                yield event
            return
        self._others[event.vehicle] += 1
        if self._others[event.vehicle] == 1:
            yield self._notice("warning", _not_followed(event.vehicle, self._choice))

    def _about_flood(self, verdict: Verdict, source: TriggerSource) -> Iterator[Notice]:
        if verdict == "closed":
            most = f"more than {self._settings.most_triggers_per_s:g} times a second"
            text = f"{source} comes {most}, as from no camera: it is left out until it is quieter"
            yield self._notice("warning", text)
        elif verdict == "opened":
            text = f"{source} is quieter again: it is listened to; {self._gate.left_out} triggers were left out so far"
            yield self._notice("info", text)

    def _heartbeat(self, message: MavMessage, received: float) -> Iterator[Notice]:
        system = message.get_srcSystem()
        if message.type == MAV_TYPE_GCS:
            if self._ground_station == "missing":
                yield self._notice("info", f"a ground station (system {system}) is heard on {self._name}")
            self._ground_station = "heard"
        elif system not in self._systems:
            self._systems.add(system)
            self._first_vehicle = received if self._first_vehicle is None else self._first_vehicle
            yield self._notice("info", f"first heartbeat on {self._name}: system {system}{_described(message)}")

    def _notice(self, level: Literal["info", "warning"], text: str) -> Notice:
        return Notice(source=self._name, level=level, text=text)


def _described(heartbeat: MavMessage) -> str:
    names = (_AUTOPILOTS.get(heartbeat.autopilot), _VEHICLES.get(heartbeat.type))
    described = ", ".join(name for name in names if name)
    return f" ({described})" if described else ""


def _not_followed(vehicle: int, choice: VehicleChoice) -> str:
    why = "as asked" if choice.wanted is not None else "the first to trigger a camera"
    return (
        f"system {vehicle} triggers a camera too and is left out, because system {choice.followed} is followed "
        f"({why}): use --vehicle {vehicle} to follow it instead"
    )


def _no_ground_station(name: str) -> str:
    return (
        f"no ground station is heard on {name}: if one should have this link, start it first and let it forward to "
        "another port (QGroundControl forwards to 14445), because only one program can listen on a port"
    )
