from __future__ import annotations

import copy
import hashlib
import os
import pickle
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_mosaic.errors import UsageError
from gcs_mosaic.mavlink.parser import PacketReader
from gcs_mosaic.mavlink.signing import HeardTimes, Signing, SigningKey, load_key, secret_of
from gcs_mosaic.messages import Refusals
from tests.mavlink.mavlink_peer import packet, signed, trigger

SECRET = bytes(range(200, 232))
OTHER = bytes(range(1, 33))
MINUTE = 60 * 100_000  # ticks of 10 µs


def kept(path: Path, content: bytes, mode: int = 0o600) -> Path:
    path.write_bytes(content)
    path.chmod(mode)
    return path


@pytest.mark.parametrize(
    ("content", "secret"),
    [
        (SECRET, SECRET),
        (SECRET.hex().encode(), SECRET),
        (SECRET.hex().upper().encode() + b"\r\n", SECRET),
        (b"correct horse\n", hashlib.sha256(b"correct horse").digest()),
        ("Zürich 8".encode(), hashlib.sha256("Zürich 8".encode()).digest()),
        (b"a passphrase of 32 characters ok", hashlib.sha256(b"a passphrase of 32 characters ok").digest()),
        (b"a passphrase of 31 characters!!\n", hashlib.sha256(b"a passphrase of 31 characters!!").digest()),
    ],
)
def test_a_key_is_bytes_or_digits_or_a_passphrase(tmp_path: Path, content: bytes, secret: bytes) -> None:
    assert load_key(kept(tmp_path / "key", content)).secret == secret


@pytest.mark.parametrize(
    "content", [b"", b"\n", b"  \n", bytes(32), b"0" * 64, SECRET[:31], SECRET + b"\x00", b"two\nlines", b"x" * 1025]
)
def test_what_is_no_key_is_refused_and_not_shown(tmp_path: Path, content: bytes) -> None:
    with pytest.raises(UsageError, match="32 bytes, with 64 hexadecimal digits, or") as caught:
        load_key(kept(tmp_path / "key", content))
    assert not content.strip() or repr(content)[2:20] not in str(caught.value)


@pytest.mark.parametrize("mode", [0o644, 0o640, 0o604, 0o660, 0o602])
def test_a_key_that_others_can_read_or_change_is_refused_with_what_to_do(tmp_path: Path, mode: int) -> None:
    path = kept(tmp_path / "key", SECRET, mode)
    with pytest.raises(UsageError, match=f"mode {mode:o}.*chmod 600 {path}"):
        load_key(path)


def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe", 0o600)
    for path in (tmp_path / "none", tmp_path, tmp_path / "pipe"):
        with pytest.raises(UsageError, match="signing key"):
            load_key(path)


def test_a_key_shows_itself_nowhere() -> None:
    key = SigningKey(SECRET)
    shown = f"{key!r} {key} {[key]} {Signing(key)!r}"
    assert SECRET.hex() not in shown
    assert repr(SECRET)[2:-1] not in shown
    for write_down in (pickle.dumps, copy.copy):
        with pytest.raises(TypeError, match="not to be written"):
            write_down(key)


@given(st.binary(max_size=80))
def test_a_key_has_32_bytes_or_is_none(content: bytes) -> None:
    assert len(secret_of(content) or bytes(32)) == 32


def test_what_pymavlink_signs_is_admitted() -> None:
    ours = Signing(SigningKey(SECRET))
    assert [ours.admits(signed(trigger(seq), SECRET, 1000 + seq)) for seq in range(3)] == [True] * 3
    assert ours.refused == Refusals()


def test_what_is_not_signed_is_refused_and_counted() -> None:
    ours = Signing(SigningKey(SECRET))
    assert not ours.admits(packet(trigger(1)))
    assert not ours.admits(b"\xfe" + packet(trigger(1))[1:])
    assert ours.refused == Refusals(unsigned=2)


def test_another_key_is_refused_and_counted() -> None:
    ours = Signing(SigningKey(SECRET))
    assert not ours.admits(signed(trigger(1), OTHER, 1000))
    assert ours.refused == Refusals(forged=1)


@given(st.data())
def test_a_signed_packet_that_was_changed_is_refused(data: st.DataObject) -> None:
    whole = bytearray(signed(trigger(1), SECRET, 1000))
    place, bit = data.draw(st.integers(3, len(whole) - 1)), data.draw(st.integers(0, 7))
    whole[place] ^= 1 << bit
    assert not Signing(SigningKey(SECRET)).admits(bytes(whole))


def test_a_replay_is_refused_and_counted() -> None:
    ours = Signing(SigningKey(SECRET))
    packets = [signed(trigger(seq), SECRET, 1000 + seq) for seq in range(3)]
    assert all(map(ours.admits, packets))
    assert not any(map(ours.admits, packets))
    assert ours.refused == Refusals(replayed=3)


def test_each_stream_has_its_own_time_but_none_begins_long_ago() -> None:
    ours = Signing(SigningKey(SECRET))
    assert ours.admits(signed(trigger(1), SECRET, 2 * MINUTE))
    assert ours.admits(signed(trigger(1), SECRET, MINUTE + 5, component=100))
    assert ours.admits(signed(trigger(1), SECRET, MINUTE + 5, link_id=3))
    assert not ours.admits(signed(trigger(1), SECRET, MINUTE - 5, component=101))
    assert ours.refused == Refusals(replayed=1)


def test_what_was_heard_on_one_link_is_not_replayed_on_another() -> None:
    """A link of which nothing was heard yet took packets of any age."""
    heard = HeardTimes()
    one, other, third = (Signing(SigningKey(SECRET), heard) for _ in range(3))
    assert one.admits(signed(trigger(1), SECRET, 5 * MINUTE))
    assert one.admits(signed(trigger(2), SECRET, 10 * MINUTE))
    assert not other.admits(signed(trigger(1), SECRET, 5 * MINUTE))
    assert other.refused == Refusals(replayed=1)
    assert other.admits(signed(trigger(2), SECRET, 10 * MINUTE))  # a second way by which the aircraft is heard
    assert third.admits(signed(trigger(1), SECRET, 3, system=2))  # another aircraft, whose clock is not set


def test_a_forged_packet_from_the_future_does_not_silence_the_aircraft() -> None:
    ours = Signing(SigningKey(SECRET))
    assert ours.admits(signed(trigger(1), SECRET, 1000))
    assert not ours.admits(signed(trigger(2), OTHER, 2**47))
    assert ours.admits(signed(trigger(2), SECRET, 1001))


@pytest.mark.parametrize("first", [5, 10**13])
def test_an_aircraft_whose_clock_is_years_off_is_heard(first: int) -> None:
    assert Signing(SigningKey(SECRET)).admits(signed(trigger(1), SECRET, first))


def test_our_timestamps_are_newer_than_all_that_was_heard_and_grow() -> None:
    ours = Signing(SigningKey(SECRET))
    utc = 1_750_000_000.0
    first = ours.next_timestamp(utc)
    assert first == round((utc - 1_420_070_400) * 1e5)
    assert ours.next_timestamp(utc - 60) == first + 1
    ours.admits(signed(trigger(1), SECRET, first + 5 * MINUTE))
    assert ours.next_timestamp(utc) == first + 5 * MINUTE + 1


def test_our_own_clock_decides_nothing_about_what_is_believed() -> None:
    ours = Signing(SigningKey(SECRET))
    ours.next_timestamp(1_750_000_000.0)
    assert ours.admits(signed(trigger(1), SECRET, 5))


def test_a_refused_packet_is_not_noise_and_hides_none_behind_it() -> None:
    ours = Signing(SigningKey(SECRET))
    reader = PacketReader(datagrams=False, admits=ours.admits)
    stream = packet(trigger(1)) + signed(trigger(2), OTHER, 7) + signed(trigger(3), SECRET, 7)
    assert [message.seq for message in reader.feed(stream)] == [3]
    assert reader.skipped_bytes == 0
    assert ours.refused == Refusals(unsigned=1, forged=1)
