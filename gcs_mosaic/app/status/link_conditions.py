"""Conditions of MAVLink links: what is not heard, or heard and refused, why, and what to do."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import asdict

from gcs_mosaic.app.status.folder_conditions import SoNow
from gcs_mosaic.messages import LinkReport, Refusals

SILENT_S = 10.0  # ten heartbeats of an aircraft, as `silent_after_s` of a link
HELD_S = 10.0  # how long something must have been so that passes by itself as messages and files arrive
GIVE_KEY = "give the autopilot the key of link: {signing_key: FILE}"
WHY_REFUSED = {
    "unsigned": f"they are not signed (a radio's own reports never are): {GIVE_KEY}, or start without a key",
    "forged": f"they are signed with another key, or were changed on the way: {GIVE_KEY}",
    "replayed": "they are older than what was heard before: see that the autopilot's clock is right, then start again",
}


class Refusing:
    """Which links refuse packets now, by the growth of their counts. Not thread-safe."""

    def __init__(self) -> None:
        self._grew: dict[str, tuple[int, float]] = {}  # by address: packets refused, and when that number last grew

    def lately(self, links: Sequence[LinkReport], utc: float) -> frozenset[str]:
        """Addresses on which packets without the key were refused in the last seconds before `utc`."""
        for link in links:
            count = link.refused.unsigned + link.refused.forged
            if count > self._grew.get(link.address, (0, 0.0))[0]:
                self._grew[link.address] = count, utc
        return frozenset(address for address, (_, when) in self._grew.items() if utc - when < SILENT_S)


def of_links(
    links: Sequence[LinkReport], utc: float, started_utc: float, refusing: Collection[str], *, stays: str = ""
) -> Iterator[SoNow]:
    """`refusing`: addresses of `Refusing.lately`; `stays`: what is true of an ended flight of which no aircraft was heard."""
    for link in links:
        if link.is_crowded:
            text = (
                f"More sources trigger cameras on {link.address} than an aircraft has: if somebody forges triggers, pictures may "
                "be given to the wrong ones. Only signing keeps them out: give the autopilot a key, and here "
                "link: {signing_key: FILE}"
            )
            yield SoNow(f"crowd {link.address}", "warning", text, said=False)
        yield from _of_link(link, utc - started_utc, is_refusing=link.address in refusing)
    if hears_only_ground_stations(links):
        address = next(link.address for link in links if link.hears_ground_station)
        text = (
            f"Only a ground station is heard on {address}, no aircraft: see that the autopilot is on, and that its packets are "
            "forwarded to this address, too. Pictures are mapped meanwhile"
        )
        yield SoNow("aircraft", "warning", text, held_s=HELD_S, stays=stays)


def hears_only_ground_stations(links: Sequence[LinkReport]) -> bool:
    """Whether a ground station is heard, and no aircraft on any link."""
    return any(link.hears_ground_station for link in links) and not any(link.aircraft for link in links)


def _of_link(link: LinkReport, since_start_s: float, *, is_refusing: bool) -> Iterator[SoNow]:
    key, never = f"link {link.address}", link.last_heard_utc is None
    if link.state == "failed":
        yield SoNow(
            key,
            "error",
            f"The link {link.address} has failed: it is opened again as soon as it can be",
            said=False,
            hoped=True,
        )
    elif (never and link.refused != Refusals()) or (link.state == "silent" and is_refusing):
        text = f"All packets on {link.address} are refused, because {_why_refused(link)}. Pictures are mapped meanwhile"
        stays = f"All packets on {link.address} were refused, because {_why_refused(link)}" if never else ""
        yield SoNow(f"refused {link.address}", "warning", text, said=False, stays=stays)
    elif never and since_start_s >= HELD_S:
        text = (
            f"Nothing was ever heard on {link.address}: see that the autopilot or the ground station sends to this "
            "address. Pictures are mapped meanwhile"
        )
        yield SoNow(key, "warning", text, said=False, hoped=True)
    elif link.state == "silent":
        text = f"The link {link.address} is silent: see whether the aircraft is out of reach. Pictures are mapped meanwhile"
        yield SoNow(key, "warning", text, said=False, hoped=True)
    elif is_refusing:
        text = (
            f"Packets on {link.address} that are not signed with the key are refused, beside those that are: a radio's own "
            "reports never are signed; if it is an aircraft of yours, give it the key"
        )
        yield SoNow(f"refused {link.address}", "info", text, said=False, held_s=HELD_S)


def _why_refused(link: LinkReport) -> str:
    """Of most of them, and what to do."""
    counts = asdict(link.refused)
    return WHY_REFUSED[max(counts, key=lambda kind: int(counts[kind]))]


def of_silent_aircraft(links: Sequence[LinkReport]) -> Iterator[SoNow]:
    """Those of several whose links go on without them; of one with a link of its own the link is called silent.

    Times of a link are compared with each other alone, for the computer's clock may be set during the flight.
    """
    silent: dict[int, bool] = {}
    for link in links:
        for one in link.aircraft:
            if one.system in link.counted and one.last_heard_utc is not None:
                gone = (link.last_heard_utc or 0.0) - one.last_heard_utc >= SILENT_S
                silent[one.system] = gone and silent.get(one.system, True)
    for system in sorted(system for system, gone in silent.items() if gone):
        text = (
            f"Aircraft {system} is silent while others are heard: see whether it is out of reach. "
            "Its pictures are mapped meanwhile"
        )
        yield SoNow(f"silence of aircraft {system}", "warning", text, hoped=True)
