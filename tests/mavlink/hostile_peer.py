"""A peer that asks for everything that MAVLink programs answer, of everybody and of us by name."""

from __future__ import annotations

from collections.abc import Iterator

from gcs_mosaic.mavlink.parser import dialect
from tests.mavlink.mavlink_peer import Message, heartbeat

TARGETS = ((0, 0), (1, 1), (191, 191), (191, 0), (245, 190), (255, 190), (255, 0))
COMMANDS = (
    dialect.MAV_CMD_REQUEST_MESSAGE,
    dialect.MAV_CMD_SET_MESSAGE_INTERVAL,
    dialect.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES,
    dialect.MAV_CMD_REQUEST_CAMERA_INFORMATION,
    dialect.MAV_CMD_IMAGE_START_CAPTURE,
    dialect.MAV_CMD_COMPONENT_ARM_DISARM,
    dialect.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN,
)


def questions() -> Iterator[Message]:
    """One of each, for each target."""
    yield heartbeat(kind=dialect.MAV_TYPE_GCS, autopilot=dialect.MAV_AUTOPILOT_INVALID)
    yield dialect.MAVLink_timesync_message(0, 1)
    for system, component in TARGETS:
        yield dialect.MAVLink_ping_message(1, 1, system, component)
        yield dialect.MAVLink_param_request_list_message(system, component)
        yield dialect.MAVLink_param_request_read_message(system, component, b"SYSID_THISMAV", -1)
        yield dialect.MAVLink_param_set_message(system, component, b"SYSID_THISMAV", 1.0, 9)
        yield dialect.MAVLink_param_ext_request_list_message(system, component)
        yield dialect.MAVLink_mission_request_list_message(system, component)
        yield dialect.MAVLink_mission_request_int_message(system, component, 0)
        yield dialect.MAVLink_mission_count_message(system, component, 3)
        yield dialect.MAVLink_mission_clear_all_message(system, component)
        yield dialect.MAVLink_log_request_list_message(system, component, 0, 65535)
        yield dialect.MAVLink_request_data_stream_message(system, component, 0, 4, 1)
        yield dialect.MAVLink_file_transfer_protocol_message(0, system, component, bytes(251))
        yield dialect.MAVLink_change_operator_control_message(system, 0, 0, b"")
        yield dialect.MAVLink_setup_signing_message(system, component, bytes(32), 0)
        for command in COMMANDS:
            yield dialect.MAVLink_command_long_message(system, component, command, 0, 148, 0, 0, 0, 0, 0, 0)
            yield dialect.MAVLink_command_int_message(system, component, 0, command, 0, 0, 148, 0, 0, 0, 0, 0, 0)
