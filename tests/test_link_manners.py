"""The live program as others on the link meet it: announced, asking, with a key, beside a second aircraft."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.vehicle import SYSTEM
from tests.running import LONGEST_WAIT_S, QUICK, Running, events_of, flying, run

PASSPHRASE = "a passphrase that nobody may see"
LINK = "link: {decide_after_s: 0, signing_key: key.txt, recover: true}\npairing: {missing_after_s: 1}\n"


class Ground:
    """What comes back on the vehicle's socket; refused if it is not signed with `key`."""

    def __init__(self, flight: Running, key: bytes) -> None:
        self.socket = flight.vehicle.socket
        self.socket.settimeout(0.1)
        self.protocol = mavlink.MAVLink(None)
        self.protocol.signing.secret_key = key

    def messages(self) -> Iterator[Any]:
        until = time.monotonic() + LONGEST_WAIT_S
        while time.monotonic() < until:
            with suppress(TimeoutError, ConnectionRefusedError):
                yield self.protocol.decode(bytearray(self.socket.recv(300)))


def image(index: int) -> Any:
    return mavlink.MAVLink_camera_image_captured_message(1000 * index, 0, 0, 0, 0, 0, 0, [1, 0, 0, 0], index, 1, b"")


def sign(flight: Running, key: bytes) -> None:
    for voice in flight.vehicle.voices.values():
        voice.signing.secret_key, voice.signing.sign_outgoing = key, True
        voice.signing.timestamp = 1000


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Running, dict[str, Any]]]:
    """A flight that lost a message, missed pictures, met a second aircraft and a forger; and what was heard of us."""
    home, key = tmp_path_factory.mktemp("manners"), sha256(PASSPHRASE.encode()).digest()
    (home / "key.txt").write_text(f"{PASSPHRASE}\n")
    (home / "key.txt").chmod(0o600)
    with flying(home, "--announce", config=QUICK + LINK) as flight:
        heard, ground = dict[str, Any](), Ground(flight, key)
        flight.vehicle.voices[1].send(image(90))  # not signed
        sign(flight, key)
        camera = flight.vehicle.voices[100]
        camera.send(image(4))
        camera.send(image(6))
        stranger = mavlink.MAVLink(flight.vehicle, 4, 100)
        stranger.signing.secret_key, stranger.signing.sign_outgoing, stranger.signing.timestamp = key, True, 5000
        stranger.send(image(1))
        stranger.send(image(2))
        for message in ground.messages():
            heard[message.get_type()] = message
            if message.get_type() == "COMMAND_LONG":
                camera.send(image(round(message.param2)))
            if {"HEARTBEAT", "COMMAND_LONG", "STATUSTEXT"} <= heard.keys():
                break
        heard["processes"] = Path(f"/proc/{flight.process.pid}/cmdline").read_text()
        flight.wait_for(lambda status: status["events"]["missing"] == 3, "missing")
        assert flight.end() == 0
        yield flight, heard


@pytest.mark.long
def test_it_is_heard_under_its_own_name(flown: tuple[Running, dict[str, Any]]) -> None:
    flight, heard = flown
    assert (heard["HEARTBEAT"].get_srcSystem(), heard["HEARTBEAT"].get_srcComponent()) == (191, 191)
    assert "announcing ourselves as system 191, component 191" in flight.said
    assert flight.status()["mavlink"][0]["sent"] >= 3


def test_a_lost_message_is_asked_for_and_its_shot_counts(flown: tuple[Running, dict[str, Any]]) -> None:
    flight, heard = flown
    assert (heard["COMMAND_LONG"].param1, heard["COMMAND_LONG"].param2) == (263, 5)
    assert events_of(flight.out) == ["missing"] * 3


def test_missing_pictures_are_told_to_the_ground_station(flown: tuple[Running, dict[str, Any]]) -> None:
    assert "without frame" in flown[1]["STATUSTEXT"].text


@pytest.mark.long
def test_another_aircraft_is_counted_and_named_and_not_mixed_in(flown: tuple[Running, dict[str, Any]]) -> None:
    flight, _ = flown
    link = flight.status()["mavlink"][0]
    assert (link["followed"], link["other_triggers"]) == (SYSTEM, {"4": 2})
    told = run("status", flight.out, cwd=flight.home).stdout
    assert "triggers left out, as system 1 is followed: 2 of system 4" in told
    assert "packets refused: 1 unsigned" in told


def test_the_key_is_nowhere(flown: tuple[Running, dict[str, Any]]) -> None:
    flight, heard = flown
    digest = sha256(PASSPHRASE.encode())
    secrets = [PASSPHRASE.encode(), digest.digest(), digest.hexdigest().encode(), repr(digest.digest())[2:-1].encode()]
    written = [path.read_bytes() for path in flight.out.rglob("*") if path.is_file()]
    written += [(flight.home / "said.txt").read_bytes(), heard["processes"].encode()]
    assert len(written) > 4
    assert not [secret for secret in secrets for text in written if secret in text]


def test_a_key_that_others_can_read_ends_the_start(tmp_path: Path) -> None:
    (tmp_path / "key.txt").write_text(PASSPHRASE)
    (tmp_path / "key.txt").chmod(0o644)
    (tmp_path / "config.yaml").write_text(LINK)
    done = run("--announce", "--no-http", "--config", "config.yaml", cwd=tmp_path)
    assert done.returncode == 2
    assert "can be read or changed by others (mode 644): chmod 600 key.txt" in done.stderr
    assert PASSPHRASE not in done.stderr
    assert not (tmp_path / "mosaic").exists()
