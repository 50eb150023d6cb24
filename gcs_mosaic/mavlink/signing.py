"""MAVLink 2 packet signing: the key, and packet verification. No I/O except reading the key file.

Source: the MAVLink guide on message signing. A signature is the first 48 bits of SHA-256 over key, packet, link id and
timestamp; the timestamp counts units of 10 µs since 2015 and must increase within a stream (link id, system id, component
id). pymavlink checks this too, but stores the timestamp before verifying the signature, so that one forged packet with a
future timestamp would block a stream.
"""

from __future__ import annotations

import hashlib
import hmac
import os
import re
import stat
import threading
from dataclasses import dataclass, field, replace
from pathlib import Path

from gcs_mosaic.errors import UsageError
from gcs_mosaic.messages import Refusals

KEY_BYTES = 32
_LARGEST_FILE = 1024  # bytes; a passphrase is a single line
_EPOCH_UTC = 1_420_070_400.0  # 2015-01-01
_TICKS_PER_S = 100_000
_NEW_STREAM_TICKS = 60 * _TICKS_PER_S  # how far a new stream may lag behind the newest timestamp (MAVLink: 1 minute)
_MARKER_V1, _SIGNED = 0xFE, 0x01
_LINK_ID, _SIGNATURE = -13, -6  # offsets in a signed packet


@dataclass(frozen=True, slots=True)
class SigningKey:
    """32 secret bytes, never shown or serialised."""

    secret: bytes = field(repr=False)

    def signature(self, signed: bytes) -> bytes:
        """The six-byte signature appended to `signed`."""
        return hashlib.sha256(self.secret + signed).digest()[:6]

    def __reduce__(self) -> str:
        raise TypeError("a signing key is not to be written anywhere")


def load_key(path: Path) -> SigningKey:
    """The key in a file that only its owner may read. Raises UsageError, which never shows the file's content."""
    try:
        with open(path, "rb", opener=_open_at_once) as file:
            state = os.fstat(file.fileno())
            content = file.read(_LARGEST_FILE + 1) if stat.S_ISREG(state.st_mode) else b""
    except OSError as error:
        raise UsageError(f"The signing key {path} cannot be read ({error.strerror}): give a file with a key.") from None
    if os.name == "posix" and state.st_mode & 0o077:
        mode = stat.S_IMODE(state.st_mode)
        raise UsageError(f"The signing key {path} can be read or changed by others (mode {mode:o}): chmod 600 {path}.")
    secret = secret_of(content)
    if secret is None:
        raise UsageError(
            f"The signing key {path} is none: give a file with 32 bytes, with 64 hexadecimal digits, or with one line "
            "that is the passphrase given to the ground station."
        )
    return SigningKey(secret)


def secret_of(content: bytes) -> bytes | None:
    """The 32-byte key in the content of a key file; None if there is none.

    A passphrase is hashed with SHA-256, as MAVProxy, Mission Planner and QGroundControl do.
    """
    try:
        line = content.decode().rstrip("\r\n")
    except UnicodeDecodeError:
        line = ""
    if re.fullmatch(r"[0-9A-Fa-f]{64}", line):
        secret = bytes.fromhex(line)
    elif line.strip() and line.isprintable() and len(content) <= _LARGEST_FILE:
        secret = hashlib.sha256(line.encode()).digest()
    else:
        secret = content
    # All zeros mean "no signing" in SETUP_SIGNING.
    return secret if len(secret) == KEY_BYTES and any(secret) else None


class HeardTimes:
    """The newest timestamp of each system, on whichever link: what was heard on one is not to be replayed on another.

    By system, because the clocks of two aircraft may be years apart. Thread-safe.
    """

    def __init__(self) -> None:
        self._newest: dict[int, int] = {}
        self._lock = threading.Lock()

    def newest(self, system: int) -> int:
        """In ticks; 0 if nothing of it was heard."""
        with self._lock:
            return self._newest.get(system, 0)

    def note(self, system: int, ticks: int) -> None:
        with self._lock:
            self._newest[system] = max(ticks, self._newest.get(system, 0))


class Signing:
    """One link's signing state: verifies incoming packets and timestamps outgoing ones. Links with one key share `heard`.

    Timestamps are not kept from one start of the program to the next: an aircraft whose clock is not set yet would be refused. So
    what was recorded in an earlier flight can be replayed until the aircraft itself is heard, and no longer.
    """

    def __init__(self, key: SigningKey, heard: HeardTimes | None = None) -> None:
        self.key = key
        self.refused = Refusals()
        self._heard = heard or HeardTimes()
        # Ticks. The first packet heard sets the start: an aircraft without a GPS fix, or a laptop, may be years off.
        self._newest, self._sent = 0, 0
        self._streams: dict[tuple[int, int, int], int] = {}  # newest timestamp by (link id, system id, component id)

    def admits(self, packet: bytes) -> bool:
        """Whether `packet`, whole and intact, is signed with our key and not replayed; counts refusals."""
        if packet[0] == _MARKER_V1 or not packet[2] & _SIGNED:
            self.refused = replace(self.refused, unsigned=self.refused.unsigned + 1)
            return False
        if not hmac.compare_digest(self.key.signature(packet[:_SIGNATURE]), packet[_SIGNATURE:]):
            self.refused = replace(self.refused, forged=self.refused.forged + 1)
            return False
        stream = (packet[_LINK_ID], packet[5], packet[6])
        ticks = int.from_bytes(packet[_LINK_ID + 1 : _SIGNATURE], "little")
        newest = max(self._newest, self._heard.newest(packet[5]))
        if ticks <= self._streams.get(stream, newest - _NEW_STREAM_TICKS):
            self.refused = replace(self.refused, replayed=self.refused.replayed + 1)
            return False
        self._streams[stream] = ticks
        self._newest = max(self._newest, ticks)
        self._heard.note(packet[5], ticks)
        return True

    def next_timestamp(self, utc: float) -> int:
        """Timestamp of a packet sent at `utc`: newer than all received and sent ones, or it would be rejected."""
        self._sent = max(self._sent + 1, self._newest + 1, round((utc - _EPOCH_UTC) * _TICKS_PER_S))
        return self._sent


def _open_at_once(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))  # else opening a pipe without a writer would block
