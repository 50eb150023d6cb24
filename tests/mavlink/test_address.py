from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_mosaic.errors import UsageError
from gcs_mosaic.mavlink.address import LinkAddress, connection_string, parse_address

UDP = LinkAddress(kind="udp", host="0.0.0.0", port=14550)
LOCAL = LinkAddress(kind="udp", host="127.0.0.1", port=14445)


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("udp:14550", UDP),
        (" udpin:14550 ", UDP),
        ("udp::14550", UDP),
        ("udp://:14550", UDP),
        ("udpin://0.0.0.0:14550/", UDP),
        ("udp:127.0.0.1:14445", LOCAL),
        ("UDP://127.0.0.1:14445", LOCAL),
        ("udpout:10.0.0.1:14550", LinkAddress(kind="udpout", host="10.0.0.1", port=14550)),
        ("tcp:sitl.local:5760", LinkAddress(kind="tcp", host="sitl.local", port=5760)),
        ("tcpout://10.0.0.1:5760", LinkAddress(kind="tcp", host="10.0.0.1", port=5760)),
        ("tcpin:5760", LinkAddress(kind="tcpin", host="0.0.0.0", port=5760)),
        ("serial:/dev/ttyACM0:115200", LinkAddress(kind="serial", device="/dev/ttyACM0", baud=115200)),
        ("serial:///dev/ttyUSB0", LinkAddress(kind="serial", device="/dev/ttyUSB0", baud=57600)),
        ("/dev/serial/by-id/usb-3D_Robotics:57600", LinkAddress(kind="serial", device="/dev/serial/by-id/usb-3D_Robotics")),
        ("/dev/ttyACM0,115200", LinkAddress(kind="serial", device="/dev/ttyACM0", baud=115200)),
        ("serial:/dev/ttyACM0,115200", LinkAddress(kind="serial", device="/dev/ttyACM0", baud=115200)),
        ("COM3,57600", LinkAddress(kind="serial", device="COM3", baud=57600)),
        ("127.0.0.1:14445", LOCAL),
        ("[::1]:14550", LinkAddress(kind="udp", host="::1", port=14550)),
        ("udp:[::]:14550", LinkAddress(kind="udp", host="::", port=14550)),
        ("tcp:[fe80::1]:5760", LinkAddress(kind="tcp", host="fe80::1", port=5760)),
        ("COM3", LinkAddress(kind="serial", device="COM3")),
        (r"C:\flights\Monday.TLOG", LinkAddress(kind="file", path=Path(r"C:\flights\Monday.TLOG"))),
        ("udp:14550.tlog", LinkAddress(kind="file", path=Path("udp:14550.tlog"))),
    ],
)  # fmt: skip
def test_every_form_is_understood(text: str, address: LinkAddress) -> None:
    assert parse_address(text) == address


@pytest.mark.parametrize(
    "text",
    [
        "", "udp", "udp:", "udp:host", "udp:0", "udp:65536", "udp:-1", "udp:14550:14551", "udp:١٤٥٥٠", "udp:a b:14550",
        "udp:[::g]:14550", "udp:::1:14550", "[127.0.0.1]:14550", "[]:14550", "1.2.3:14550", "COM3,", "COM3,fast",
        "udpout:14550", "udpout::14550", "udpbcast:14550",
        "tcp:5760", "tcp::5760", "tcp:host", "serial:", "serial:/etc/passwd", "/dev/../etc/passwd",
        "serial:/dev/ttyACM0:fast", "serial:/dev/ttyACM0:9", "/bin/ls", "vehicle.elf", "csv:x", "14550",
        "mcast:", "ws:1.2.3.4:80", "udp:-o.Proxy:14550",
    ],
)  # fmt: skip
def test_a_malformed_address_is_shown_with_what_was_wanted(text: str) -> None:
    with pytest.raises(UsageError) as caught:
        parse_address(text)
    assert repr(text) in str(caught.value)
    assert "such as" in str(caught.value)


@pytest.mark.long
@given(st.text(max_size=40) | st.from_regex(r"(udp|udpout|tcp|tcpin|serial):(//)?[\w./:-]*", fullmatch=True))
def test_anything_else_is_an_address_or_a_usage_error(text: str) -> None:
    try:
        address = parse_address(text)
    except UsageError:
        return
    if address.kind in ("udp", "udpout", "tcp", "tcpin"):
        assert parse_address(connection_string(address)) == address
        assert 1 <= address.port <= 65535


def test_an_address_is_parsed_without_pymavlink() -> None:
    code = "import sys, gcs_mosaic.mavlink.address; sys.exit('pymavlink' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], timeout=30, check=False).returncode == 0


@pytest.mark.parametrize("log", ["flight.bin", "logs/00000012.BIN", "00000012.log", r"C:\logs\a flight.ulg"])
def test_of_an_autopilot_s_log_it_is_told_what_maps_it(log: str) -> None:
    with pytest.raises(UsageError, match="is a log, and no link") as caught:
        parse_address(log)
    assert f"gcs-mosaic replay {log!r} --frames DIR" in str(caught.value)
