from __future__ import annotations

import os
import socket

import pytest

from gcs_mosaic.errors import UsageError
from gcs_mosaic.mavlink.sockets import bind_udp, holder_of_udp_port, listen_tcp


@pytest.mark.parametrize("theirs", ["127.0.0.1", "0.0.0.0"])
@pytest.mark.parametrize("ours", ["127.0.0.1", "0.0.0.0"])
def test_a_port_that_pymavlink_would_share_is_refused(theirs: str, ours: str) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        station.bind((theirs, 0))
        port = station.getsockname()[1]
        with pytest.raises(UsageError, match=rf"UDP port {port} is taken by .*process {os.getpid()}.*14445"):
            bind_udp(ours, port, 1 << 16)


def test_nobody_can_take_packets_away_from_us() -> None:
    with bind_udp("127.0.0.1", 0, 1 << 16) as ours, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as late:
        late.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        with pytest.raises(OSError, match="in use"):
            late.bind(ours.getsockname())


def test_a_free_port_is_held_by_nobody() -> None:
    with bind_udp("127.0.0.1", 0, 1 << 16) as ours:
        port = ours.getsockname()[1]
    assert holder_of_udp_port(port) is None


def test_an_address_of_another_machine_is_refused() -> None:
    with pytest.raises(UsageError, match="give an address of this machine"):
        bind_udp("192.0.2.1", 14550, 1 << 16)


def test_a_taken_tcp_port_is_refused() -> None:
    with listen_tcp("127.0.0.1", 0, 1 << 16) as first, pytest.raises(UsageError, match="TCP port"):
        listen_tcp("127.0.0.1", first.getsockname()[1], 1 << 16)
