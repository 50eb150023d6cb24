"""Packs outgoing messages under a system id and component id of our own, signed if there is a key."""

from __future__ import annotations

from gcs_mosaic.errors import UsageError
from gcs_mosaic.mavlink.messages import MavMessage
from gcs_mosaic.mavlink.parser import dialect
from gcs_mosaic.mavlink.settings import LinkSettings
from gcs_mosaic.mavlink.signing import Signing

OWN_COMPONENT = dialect.MAV_COMP_ID_ONBOARD_COMPUTER  # 191
GROUND_STATION = 255  # system id; its heartbeat keeps an autopilot's ground station failsafe from triggering
_HIGHEST = 254


def check_identity(settings: LinkSettings) -> None:
    """Raises UsageError for a system id that belongs to someone else, or `recover` without `announce`."""
    own = settings.announce
    if own is None:
        if settings.recover:
            raise UsageError("--recover asks the camera, which needs a name to ask by: add --announce.")
        return
    if own == GROUND_STATION:
        raise UsageError(
            "--announce 255 is the ground station's own number: as long as it is heard, the aircraft would not notice "
            "that the ground station is lost. Give another one, such as --announce 191."
        )
    if not 1 <= own <= _HIGHEST:
        raise UsageError(f"--announce {own} is no MAVLink system id: give one from 1 to {_HIGHEST}, such as 191.")
    if own in settings.vehicles:
        raise UsageError(
            f"--announce {own} is the number of an aircraft of this flight: give one that nobody else has, such as 191."
        )
    if own == settings.vehicle:
        raise UsageError(
            f"--announce {own} is the number of the aircraft that is followed: give one that nobody else has, such as "
            f"--announce {191 if own != 191 else 192}."
        )


class Transmitter:
    """Turns messages into packets of system `system`, component 191."""

    def __init__(self, system: int, utc_of_zero: float, signing: Signing | None = None, link_id: int = 0) -> None:
        """`utc_of_zero` is UTC at the monotonic clock's zero; `link_id` is unique to each link."""
        self.system = system
        self._utc_of_zero, self._signing = utc_of_zero, signing
        self._protocol = dialect.MAVLink(None, srcSystem=system, srcComponent=OWN_COMPONENT)
        if signing:
            self._protocol.signing.secret_key = signing.key.secret
            self._protocol.signing.sign_outgoing = True
            self._protocol.signing.link_id = link_id

    def packet(self, message: MavMessage, now: float) -> bytes:
        """The packet of `message`, sent at `now` (monotonic seconds)."""
        if self._signing:
            self._protocol.signing.timestamp = self._signing.next_timestamp(now + self._utc_of_zero)
        packed = bytes(message.pack(self._protocol))
        self._protocol.seq = (self._protocol.seq + 1) % 256
        return packed
