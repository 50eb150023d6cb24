from __future__ import annotations

import pytest

from gcs_mosaic.errors import UsageError
from gcs_mosaic.mavlink.announcements import heartbeat
from gcs_mosaic.mavlink.parser import PacketReader, dialect
from gcs_mosaic.mavlink.settings import LinkSettings
from gcs_mosaic.mavlink.signing import Signing, SigningKey
from gcs_mosaic.mavlink.transmitter import Transmitter, check_identity
from tests.mavlink.mavlink_peer import signed, trigger

SECRET = bytes(range(200, 232))


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"announce": 255}, "255 is the ground station's own number"),
        ({"announce": 0}, "1 to 254"),
        ({"announce": 256}, "1 to 254"),
        ({"announce": -1}, "1 to 254"),
        ({"announce": 7, "vehicle": 7}, "7 is the number of the aircraft that is followed.*--announce 191"),
        ({"announce": 191, "vehicle": 191}, "--announce 192"),
        ({"recover": True}, "add --announce"),
    ],
)
def test_an_identity_that_is_anothers_is_refused_with_a_sentence(settings: dict[str, int], said: str) -> None:
    with pytest.raises(UsageError, match=said):
        check_identity(LinkSettings(**settings))  # type: ignore[arg-type]


@pytest.mark.parametrize("settings", [{}, {"announce": 191}, {"announce": 7, "vehicle": 8, "recover": True}])
def test_an_identity_of_our_own_is_fine(settings: dict[str, int]) -> None:
    check_identity(LinkSettings(**settings))  # type: ignore[arg-type]


def test_packets_come_from_our_own_system_and_component_and_are_counted() -> None:
    transmitter, reader = Transmitter(77, 1.75e9), PacketReader(datagrams=True)
    for count in range(300):
        (message,) = reader.feed(transmitter.packet(heartbeat(), float(count)))
        assert (message.get_srcSystem(), message.get_srcComponent(), message.get_seq()) == (77, 191, count % 256)


def test_what_we_say_is_signed_so_that_others_believe_it() -> None:
    signing = Signing(SigningKey(SECRET))
    transmitter, other = Transmitter(77, 1.75e9, signing, link_id=2), dialect.MAVLink(None)
    other.signing.secret_key = SECRET
    for second in (0.0, 0.0, 1.0, 0.5):
        packet = transmitter.packet(heartbeat(), second)
        assert packet[-13] == 2
        assert other.decode(bytearray(packet)).get_srcSystem() == 77  # raises if the signature is not right
    ahead = 1 << 46
    signing.admits(signed(trigger(1), SECRET, ahead))
    assert int.from_bytes(transmitter.packet(heartbeat(), 2.0)[-12:-6], "little") == ahead + 1
