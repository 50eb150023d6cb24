"""Positions that recordings tell: subtitles of DJI's cameras, metadata in transport streams."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_mosaic.frames.video.klv import KEY, read_klv
from gcs_mosaic.frames.video.srt import read_subtitles, subtitles_beside
from gcs_mosaic.frames.video.track import Track
from gcs_mosaic.messages import Position
from tests.frames.video.films import chosen, flight, klv_packet, place, write_film

OLD = """1
00:00:00,000 --> 00:00:01,000
HOME(14.6050,50.0780) 2017.08.05 14:11:51
GPS(14.6060,50.0790,16) BAROMETER:1.9
ISO:100 Shutter:60 EV: Fnum:F2.8

2
00:00:01,000 --> 00:00:02,000
F/2.8, SS 206.14, ISO 150, EV 0, GPS (-14.6061, -50.0791, 15), D 24.26m, H 6.00m, H.S 3.02m/s, V.S 0.00m/s
"""
NEW = """1
00:00:00,000 --> 00:00:00,033
<font size="28">SrtCnt : 1, DiffTime : 33ms
2020-01-01 12:00:00,000,000
[iso : 100] [fnum : 280] [latitude: 50.0790] [longitude: 14.6060] [rel_alt: 1.300 abs_alt: 208.713] [ct : 5500] </font>

2
00:00:00,033 --> 00:00:00,066
<font size="36">[latitude : -50.0791] [longtitude : -14.6061] [altitude: 6.000000] </font>
"""
PLACES = ((50.0790, 14.6060), (-50.0791, -14.6061))


@pytest.mark.parametrize(
    ("text", "times", "heights"), [(OLD, (0.0, 1.0), (1.9, None)), (NEW, (0, 0.033), (208.713, 6.0))]
)
def test_both_forms_of_subtitles_are_read(
    tmp_path: Path, text: str, times: tuple[float, ...], heights: tuple[float | None, ...]
) -> None:
    (tmp_path / "a.SRT").write_text(text, encoding="utf-8")
    track = read_subtitles(tmp_path / "a.SRT")
    told = [track.at(seconds) for seconds in times]
    assert [(one.latitude_deg, one.longitude_deg) for one in told if one] == list(PLACES)
    assert [one.altitude_m for one in told if one] == list(heights)


def test_no_fix_is_no_place(tmp_path: Path) -> None:
    """Indoors and before the first fix, cameras write zeros."""
    text = NEW.replace("50.0790", "0.000000").replace("14.6060", "0.000000").replace("-50.0791", "-150.0")
    (tmp_path / "a.srt").write_text(text, encoding="utf-8")
    assert len(read_subtitles(tmp_path / "a.srt")) == 0


@pytest.mark.parametrize(
    "data", [b"", b"\xff\xfe\x00", b"1\n00:00:00,000 --> \n" * 999, b"GPS(" * 100_000, b"x" * 10**6]
)
def test_subtitles_of_anything_are_read_to_their_end(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "a.srt").write_bytes(data)
    assert len(read_subtitles(tmp_path / "a.srt")) == 0


def test_subtitles_lie_beside_their_video(tmp_path: Path) -> None:
    (tmp_path / "FLIGHT.SRT").write_text(NEW, encoding="utf-8")
    assert subtitles_beside(tmp_path / "FLIGHT.MP4") == tmp_path / "FLIGHT.SRT"
    (tmp_path / "other.srt").symlink_to("/etc/hostname")
    assert subtitles_beside(tmp_path / "other.MP4") is None


def test_a_position_far_in_time_is_none() -> None:
    track = Track()
    track.add(5.0, Position(latitude_deg=1, longitude_deg=2, altitude_m=None))
    assert track.at(5.9) is not None
    assert track.at(6.1) is track.at(3.9) is None


def test_metadata_are_read_from_a_transport_stream(tmp_path: Path) -> None:
    """A sensor ball's or an encoder's TS (STANAG 4609): video and KLV in one."""
    klv = [(k / 5, klv_packet(1.7e9 + k / 5, *place(k / 5), 320.0)) for k in range(15)]
    found = chosen(write_film(tmp_path / "a.ts", flight(3.0), klv=klv))
    assert len(found) >= 4
    for one in found:
        assert one.told_by == "KLV"
        assert one.position is not None
        assert (one.position.latitude_deg, one.position.longitude_deg) == pytest.approx(place(one.ms / 1000), abs=2e-4)
        assert one.position.altitude_m == pytest.approx(320, abs=0.5)


def test_subtitles_go_before_metadata_within(tmp_path: Path) -> None:
    path = write_film(tmp_path / "a.ts", flight(0.6), klv=[(0.0, klv_packet(1.7e9, 1.0, 2.0, 0.0))])
    (tmp_path / "a.SRT").write_text(NEW, encoding="utf-8")
    assert chosen(path)[0].position == Position(latitude_deg=50.079, longitude_deg=14.606, altitude_m=208.713)


def test_the_picture_does_not_depend_on_what_is_told(tmp_path: Path) -> None:
    plain = chosen(write_film(tmp_path / "a.ts", flight(2.0)))
    told = chosen(write_film(tmp_path / "b.ts", flight(2.0), klv=[(0.0, klv_packet(1.7e9, 1.0, 2.0, 0.0))]))
    assert [(one.ms, one.jpeg) for one in told] == [(one.ms, one.jpeg) for one in plain]


def test_a_wrong_checksum_tells_nothing() -> None:
    packet = klv_packet(1.7e9, 47.0, 8.0, 500.0)
    assert len(list(read_klv(b"junk" + packet + packet))) == 2
    for at in range(len(KEY) + 2, len(packet)):
        broken = packet[:at] + bytes([packet[at] ^ 0x10]) + packet[at + 1 :]
        assert all(report.position is None or at < 0 for report in read_klv(broken)) or not list(read_klv(broken))


def test_an_angle_that_is_out_of_range_is_none() -> None:
    packet = klv_packet(1.7e9, 0.0, 0.0, 0.0)
    (report,) = read_klv(packet)
    assert report.position is None
    assert report.utc == pytest.approx(1.7e9)


@given(st.binary(max_size=200))
def test_any_bytes_are_read(data: bytes) -> None:
    for tail in (data, KEY + data, KEY + bytes([len(data) % 128]) + data):
        assert isinstance(list(read_klv(tail)), list)


def test_lengths_that_reach_beyond_are_left() -> None:
    for length in (b"\x84\xff\xff\xff\xff", b"\x80", b"\x7f", b"\x81"):
        assert list(read_klv(KEY + length + np.random.default_rng(0).bytes(40))) == []
