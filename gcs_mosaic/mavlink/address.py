"""Parses and validates every form of `--mavlink`, so that pymavlink never has to guess at or execute an address."""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import dataclass
from ipaddress import ip_address
from pathlib import Path, PurePath
from typing import Literal

from gcs_mosaic.errors import UsageError

Kind = Literal["udp", "udpout", "tcp", "tcpin", "serial", "file"]

DEFAULT_BAUD = 57600  # bits per second; the factory setting of telemetry radios
EVERY_INTERFACE = "0.0.0.0"  # a vehicle on the radio's network must reach us, like any ground station

_SCHEMES: dict[str, Kind] = {
    "udp": "udp",
    "udpin": "udp",
    "udpout": "udpout",
    "tcp": "tcp",
    "tcpout": "tcp",
    "tcpin": "tcpin",
    "serial": "serial",
}
_LOGS = (".bin", ".log", ".ulg")  # of autopilots, which `replay` reads
_CALLING: tuple[Kind, ...] = ("udpout", "tcp")
_HOST = re.compile(r"(?=.{1,253}$)[A-Za-z0-9]([A-Za-z0-9.-]*[A-Za-z0-9])?")
_PLAIN = re.compile(r"([0-9.]+|\[[^\]]*\]):[0-9]+", re.ASCII)
_DEVICE = re.compile(r"(/dev/(?!.*\.\.)[\w./+-]+|COM\d{1,3})", re.ASCII)


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkAddress:
    """Source of a MAVLink stream: `host` and `port` for sockets, `device` and `baud` for serial, `path` for a log."""

    kind: Kind
    host: str = ""
    port: int = 0
    device: str = ""
    baud: int = DEFAULT_BAUD
    path: Path | None = None


def parse_address(text: str) -> LinkAddress:
    """Parse an address.

    Accepts `udp:PORT`, `udp:HOST:PORT`, `udpin:…`, `udpout:HOST:PORT`, `tcp:HOST:PORT`, `tcpin:[HOST:]PORT`, the same with `://`,
    a plain `IP:PORT` (UDP), IPv6 in brackets (`[::1]:14550`), `serial:/dev/ttyACM0:57600`, a plain `/dev/tty…` or `COM3`,
    optionally with the baud rate after a comma as in MAVProxy, and `FILE.tlog`. Raises UsageError for anything else.
    """
    text = text.strip()
    if text.lower().endswith(".tlog"):
        return LinkAddress(kind="file", path=Path(text))
    if text.startswith("/dev/") or re.match(r"COM\d", text):
        return _serial(text, text)
    if _PLAIN.fullmatch(text):
        return _socket(text, "udp", text)
    scheme, colon, rest = text.partition(":")
    if PurePath(text).suffix.lower() in _LOGS:
        then = f"gcs-mosaic replay {text!r} --frames DIR maps the flight from it and its pictures"
        raise UsageError(f"--mavlink {text!r} is a log, and no link: {then}.")
    kind = _SCHEMES.get(scheme.lower())
    if kind is None or not colon:
        raise _malformed(text, "an address such as udp:14550, tcp:HOST:5760, serial:/dev/ttyACM0:57600 or FLIGHT.tlog")
    rest = rest.removeprefix("//")
    return _serial(text, rest) if kind == "serial" else _socket(text, kind, rest.removesuffix("/"))


def connection_string(address: LinkAddress) -> str:
    """The address in pymavlink's notation, which is also what the operator sees."""
    match address.kind:
        case "udp":
            return f"udpin:{host_and_port(address.host, address.port)}"
        case "udpout" | "tcp" | "tcpin":
            return f"{address.kind}:{host_and_port(address.host, address.port)}"
        case "serial":
            return address.device
        case "file":
            return str(address.path)


def host_and_port(host: str, port: int) -> str:
    """HOST:PORT, with an IPv6 address in brackets."""
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def _socket(text: str, kind: Kind, rest: str) -> LinkAddress:
    host, _, port = rest.rpartition(":")
    if not re.fullmatch(r"[0-9]{1,5}", port) or not 1 <= int(port) <= 65535:
        raise _malformed(text, f"a port from 1 to 65535 at the end, such as {kind}:{_example_host(kind)}14550")
    if not host and kind in _CALLING:
        raise _malformed(text, f"the host to call, such as {kind}:127.0.0.1:{port}")
    host = host or EVERY_INTERFACE
    if not _is_host(host):
        raise _malformed(text, f"a host name or an IP address before the port, such as {kind}:127.0.0.1:{port}")
    host = host.strip("[]")
    return LinkAddress(kind=kind, host=host, port=int(port))


def _serial(text: str, rest: str) -> LinkAddress:
    device, colon, baud = rest.replace(",", ":", 1).partition(":")
    if not _DEVICE.fullmatch(device):
        raise _malformed(text, "a serial device such as serial:/dev/ttyACM0:57600 or COM3")
    if colon and (not re.fullmatch(r"[0-9]{3,7}", baud) or not 300 <= int(baud) <= 4_000_000):
        raise _malformed(text, f"a speed in bits per second after the device, such as serial:{device}:57600")
    return LinkAddress(kind="serial", device=device, baud=int(baud) if colon else DEFAULT_BAUD)


def _is_host(host: str) -> bool:
    if re.fullmatch(r"[0-9.]+", host):
        with suppress(ValueError):
            return bool(ip_address(host))
        return False
    if host.startswith("[") and host.endswith("]"):
        with suppress(ValueError):
            return ip_address(host[1:-1]).version == 6
        return False
    return _HOST.fullmatch(host) is not None


def _example_host(kind: Kind) -> str:
    return "127.0.0.1:" if kind in _CALLING else ""


def _malformed(text: str, wanted: str) -> UsageError:
    return UsageError(f"--mavlink {text!r} is not understood: give {wanted}.")
