"""Noise without end on a serial line: a wrong speed, a broken radio, or somebody who wants the program to be busy."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
import threading
import time

import pytest

from gcs_mosaic.mavlink import streams
from gcs_mosaic.mavlink.address import parse_address
from gcs_mosaic.mavlink.link import triggers
from gcs_mosaic.mavlink.settings import LinkSettings
from gcs_mosaic.mavlink.streams import NoisePace
from gcs_mosaic.messages import Notice, TriggerEvent
from tests.mavlink.mavlink_peer import packet, trigger

WRITER = """
import os, random, sys
noise = random.Random(7).randbytes(1 << 20)
while True:
    for at in range(0, len(noise), 4096):
        os.write(int(sys.argv[1]), noise[at : at + 4096])
"""
QUICK = LinkSettings(decide_after_s=0, poll_s=0.02, silent_after_s=0.5)
LASTS_S = 0.6


@pytest.mark.long
def test_noise_at_full_rate_costs_little_and_says_little(monkeypatch: pytest.MonkeyPatch) -> None:
    """As fast as a pseudo terminal takes it: the link's thread was busy all the time."""
    monkeypatch.setattr(streams, "_NOISE_AT_ONCE", 1 << 17)
    ours, theirs = pty.openpty()
    stop, heard = threading.Event(), list[object]()
    link = triggers(parse_address(os.ttyname(theirs)), stop, QUICK)
    listening = threading.Thread(target=lambda: heard.extend(link))
    listening.start()
    writer = subprocess.Popen([sys.executable, "-c", WRITER, str(ours)], pass_fds=[ours])
    try:
        time.sleep(LASTS_S)  # the burst that is read at once
        before = time.process_time()
        time.sleep(LASTS_S)
        busy = (time.process_time() - before) / LASTS_S
    finally:
        writer.kill()
        writer.wait()
    for seq in range(78):  # what looks like the start of a packet is waited for
        os.write(ours, packet(trigger(seq)))
    end = time.monotonic() + 10
    while not any(isinstance(item, TriggerEvent) and item.sequence == 77 for item in heard) and time.monotonic() < end:
        time.sleep(0.05)
    stop.set()
    listening.join()
    os.close(ours)
    os.close(theirs)
    assert busy < 0.3
    assert len([item for item in heard if isinstance(item, Notice)]) < 10
    assert any(isinstance(item, TriggerEvent) and item.sequence == 77 for item in heard)


def test_a_stream_with_little_noise_is_never_left_alone() -> None:
    pace, skipped = NoisePace(0.0), 0
    for second in range(100):
        skipped += 300_000  # the fastest serial line, at a wrong speed
        assert pace.pause_s(skipped, float(second + 1)) == 0


def test_noise_without_end_is_left_alone_for_moments() -> None:
    pace = NoisePace(0.0)
    assert pace.pause_s(streams._NOISE_AT_ONCE, 0.0) == 0
    assert 0 < pace.pause_s(3 * streams._NOISE_AT_ONCE, 0.1) <= streams._LONGEST_PAUSE_S
    assert pace.pause_s(3 * streams._NOISE_AT_ONCE, 20.0) == 0
