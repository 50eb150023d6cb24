from __future__ import annotations

import re

import pytest

from gcs_mosaic.frames.rtsp.packet_loss import DamageWatch, tells_of_damage


def judged(row: str) -> str:
    """K a key frame, P one that follows, with ! after a fault; returns x for damaged and . for whole."""
    watch = DamageWatch()
    told = [watch.is_damaged(fault="!" in one, key="K" in one) for one in re.findall("[KP]!?", row)]
    return "".join("x" if damaged else "." for damaged in told)


@pytest.mark.parametrize(
    ("row", "damaged"),
    [
        ("KPPKPP", "......"),
        ("PPKPP", "xx..."),  # joined between two key frames
        ("KPP!PPKPP", "..xxx..."),  # all that is made from a damaged picture is damaged
        ("KPPK!PPKPP", "...xxx..."),  # a damaged key frame is no rescue
        ("KPP!KPPKPP", "..xxxx..."),  # what went wrong just before a key frame may have been its own first packet
    ],
)
def test_damage_lasts_until_a_whole_key_frame(row: str, damaged: str) -> None:
    assert judged(row) == damaged


@pytest.mark.parametrize(
    ("name", "text", "damage"),
    [
        ("rtsp", "RTP: missed 3 packets", True),
        ("rtsp", "max delay reached. need to consume packet", False),
        ("hevc", "Could not find ref with POC 36", True),
        ("h264", "concealing 1200 DC, 1200 AC, 1200 MV errors in P frame", True),
        ("swscaler", "deprecated pixel format used", False),
    ],
)
def test_what_the_libraries_say_is_understood(name: str, text: str, damage: bool) -> None:
    assert tells_of_damage([(24, name, text)]) == damage
