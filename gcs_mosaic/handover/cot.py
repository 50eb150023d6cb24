"""A find as an event of Cursor on Target 2.0, as ATAK, WinTAK and TAK servers take it: a spot marker with its error as `ce`.

Sources: MITRE's "Cursor on Target Message Router User's Guide" (event, point, detail), and ATAK-CIV's marker type b-m-p-s-m.
"""

from __future__ import annotations

import hashlib
import ipaddress
import math
import socket
import time
from xml.sax.saxutils import quoteattr

from gcs_mosaic.errors import UsageError
from gcs_mosaic.handover.cot_address import CotAddress
from gcs_mosaic.notes.finds.exports import NO_ANCHOR, escape
from gcs_mosaic.notes.finds.finds import PlacedFind
from gcs_mosaic.notes.texts import iso, shown
from gcs_mosaic.views.taken import CaptureTime

SPOT = "b-m-p-s-m"  # a marker that somebody has set
BY_HAND = "h-e"  # how the place was found: a person's estimate, on a picture
UNKNOWN = "9999999.0"  # of heights and vertical errors, by the definition of Cursor on Target
STALE_S = 24 * 3600.0  # then receivers may let go of it: a day's search
YELLOW = "-256"  # ARGB as a signed number
LONGEST_NOTE = 800  # letters: with all else it goes into one datagram
SEND_S = 4.0
MULTICAST_HOPS = 1  # the local network, as ATAK's own


def as_cot(one: PlacedFind, flight: str, taken: CaptureTime | None, now_utc: float) -> str:
    """One event on one line; the same find has the same uid, so that a newer event replaces an older. Raises UsageError for a
    find that no anchor lays on earth."""
    find, geo = one.find, one.geo
    if geo is None:
        raise UsageError(f"Find {find.id} is not sent. {NO_ANCHOR}")
    name = shown(find.label or find.kind or f"find {find.id}")
    notes = [find.kind, find.note[:LONGEST_NOTE], "" if taken is None else taken.words(), f"marked by {find.who}"]
    remarks = "; ".join(shown(text) for text in notes if text)
    times = f'time="{iso(now_utc)}" start="{iso(now_utc)}" stale="{iso(now_utc + STALE_S)}"'
    point = (
        f'<point lat="{geo.latitude_deg:.7f}" lon="{geo.longitude_deg:.7f}" hae="{UNKNOWN}" '
        f'ce="{math.ceil(geo.error_m)}.0" le="{UNKNOWN}"/>'
    )
    return (
        '<?xml version="1.0" encoding="UTF-8" standalone="yes"?>'
        f'<event version="2.0" uid="{_uid(flight, find.id, find.created_utc)}" type="{SPOT}" how="{BY_HAND}" {times}>{point}'
        f'<detail><contact callsign={quoteattr(name)}/><remarks>{escape(remarks)}</remarks><color argb="{YELLOW}"/>'
        "<archive/></detail></event>\n"
    )


def send_cot(event: str, address: CotAddress, timeout_s: float = SEND_S) -> None:
    """Send an event. Raises UsageError if it cannot be; nothing is sent after the time, however long finding the name took."""
    kind = socket.SOCK_DGRAM if address.kind == "udp" else socket.SOCK_STREAM
    end = time.monotonic() + timeout_s
    try:
        family, _, _, _, where = socket.getaddrinfo(address.host, address.port, type=kind)[0]
        with socket.socket(family, kind) as one:
            one.settimeout(_left(end))
            if kind == socket.SOCK_DGRAM:
                if ipaddress.ip_address(where[0]).is_multicast and family == socket.AF_INET:
                    one.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, MULTICAST_HOPS)
                one.sendto(event.encode("utf-8"), where)
            else:
                one.connect(where)
                one.settimeout(_left(end))
                one.sendall(event.encode("utf-8"))
    except (OSError, ValueError) as error:
        raise not_sent(address, str(error)) from error


def not_sent(address: CotAddress, why: str) -> UsageError:
    """One sentence about it."""
    told = f"{address.kind}:{address.host}:{address.port}"
    return UsageError(f"The find cannot be sent to {told} ({why}): see whether it is right and reached.")


def _left(end: float) -> float:
    """Seconds until a monotonic time. Raises TimeoutError."""
    if (left := end - time.monotonic()) <= 0:
        raise TimeoutError("timed out")
    return left


def _uid(flight: str, number: int, created_utc: float) -> str:
    """Of this find alone, whoever flies another flight of that name."""
    mark = hashlib.blake2b(f"{flight}\0{number}\0{created_utc}".encode("utf-8", "replace"), digest_size=8).hexdigest()
    return f"gcs-mosaic-{mark}-{number}"
