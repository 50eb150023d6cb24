"""What MAVSDK makes of a .plan: the same items, all of them."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pytest

from gcs_mosaic.cli.main import main
from sitl.vehicle import Vehicle
from tests.handover.gapped import gapped_flight
from tests.peers.cameras import need_mavsdk, wait
from tests.ports import free_port


@contextmanager
def ground_station() -> Iterator[Any]:
    """MAVSDK's missions of an autopilot that says that it is there."""
    mavsdk, port, end = need_mavsdk(), free_port(), threading.Event()
    from mavsdk.plugins.mission_raw.mission_raw import MissionRaw

    def beat() -> None:
        with closing(Vehicle("127.0.0.1", port)) as vehicle:
            while not end.wait(0.2):
                vehicle.tick(None)

    sdk = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION))
    sdk.add_any_connection(f"udpin://127.0.0.1:{port}")
    beating = threading.Thread(target=beat)
    beating.start()
    try:
        wait(sdk.get_systems, "the ground station sees the aircraft")
        missions = MissionRaw(sdk.get_systems()[0])
        yield missions
        missions.destroy()
    finally:
        end.set()
        beating.join()
        sdk.destroy()


@pytest.mark.long
def test_mavsdk_imports_each_item_of_a_plan(tmp_path: Path) -> None:
    need_mavsdk()
    flight, target = gapped_flight(tmp_path / "flight"), tmp_path / "gaps.plan"
    assert main(["export", str(flight), "--format", "mission-plan", "--to", str(target)]) == 0
    ours = json.loads(target.read_text())["mission"]["items"]
    with ground_station() as missions:
        imported = missions.import_qgroundcontrol_mission(str(target))
    theirs = imported.mission_items
    assert [item.command for item in theirs] == [item["command"] for item in ours]
    assert [item.frame for item in theirs] == [item["frame"] for item in ours]
    assert (imported.geofence_items, imported.rally_items) == ([], [])
    for their, our in zip(theirs, ours, strict=True):
        if our["command"] == 16:
            assert (their.x, their.y) == tuple(round(degrees * 1e7) for degrees in our["params"][4:6])
            assert their.z == pytest.approx(our["params"][6], abs=0.01)
        else:
            assert their.param1 == pytest.approx(our["params"][0], abs=0.01)
