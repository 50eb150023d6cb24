"""`gcs-mosaic vehicle` beside a real flight: another aircraft is chosen, and its triggers so far have their frames."""

from __future__ import annotations

import json
from contextlib import closing
from pathlib import Path

import cv2
import numpy as np
import pytest

from gcs_mosaic.cli import main as cli
from gcs_mosaic.store.requests import REQUEST_NAME, ask_to_follow
from sitl.messages import Capture
from sitl.vehicle import Vehicle
from tests.running import events_of, flying, until


def jpeg(seed: int) -> bytes:
    picture = np.random.default_rng(seed).integers(0, 255, (48, 64, 3), np.uint8)
    return cv2.imencode(".jpg", picture)[1].tobytes()


@pytest.mark.long
def test_another_aircraft_is_chosen_while_flying(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def ask(*words: str) -> tuple[int, str]:
        code, told = cli.main(["vehicle", *words]), capfd.readouterr()
        return code, told.out + told.err

    monkeypatch.chdir(tmp_path)
    with flying(tmp_path) as flight:
        host, port = flight.vehicle.socket.getpeername()
        flight.take("a1.jpg", jpeg(1))
        flight.wait_for(lambda status: [link["followed"] for link in status["mavlink"]] == [1], "the first is followed")
        with closing(Vehicle(host, port, ["camera"])) as other:
            for voice in other.voices.values():
                voice.srcSystem = 7
            other.tick(None)
            other.capture(Capture(index=1, name="b1.jpg", state=None))
            flight.wait_for(lambda status: "7" in status["mavlink"][0]["other_triggers"], "the other is left out")
            flight.bring("b1.jpg", jpeg(2))
            flight.wait_for(lambda status: status["orphans"] == 1, "the frame of the other has no event")

            assert "300 is no MAVLink system id" in ask("300")[1]
            code, told = ask("9")
            assert (code, "system 9 has not been heard (heard: 1, 7)" in told) == (2, True)
            listed = ask(str(flight.out))[1].splitlines()
            assert listed[0].startswith("system 1: followed, ArduPilot, quadrotor, heard ")
            assert listed[1].startswith("system 7: ArduPilot, quadrotor, heard ")

            assert ask("7") == (0, "system 7 is followed from now on\n")
            flight.wait_for(lambda status: status["events"]["matched"] == 2, "its trigger has its frame")
            assert flight.status()["mavlink"][0]["followed"] == 7
            assert "system 7 is followed from now on, as asked" in flight.said

        (flight.out / REQUEST_NAME).write_text(json.dumps({"id": "x" * 99, "vehicle": 1}))
        until(lambda: "a request is left out: request.json has no id" in flight.said, "a bad request is told")
        (flight.out / REQUEST_NAME).mkdir()
        assert flight.end() == 0
    assert events_of(flight.out) == ["matched", "matched"]
    assert "no flight is under way" in ask("7")[1]


def test_a_flight_that_does_not_answer_is_asked_no_more(tmp_path: Path) -> None:
    assert ask_to_follow(tmp_path, 3, patience_s=0.1) is None
    assert list(tmp_path.iterdir()) == []
