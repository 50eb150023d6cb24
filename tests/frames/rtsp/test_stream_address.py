from __future__ import annotations

import pytest

from gcs_mosaic.errors import UsageError
from gcs_mosaic.frames.rtsp.address import check_allowed, is_allowed, parse_stream

SECRET = "s3cr3t"


@pytest.mark.parametrize(
    ("url", "host", "shown"),
    [
        ("rtsp://192.168.1.20/main", "192.168.1.20", "rtsp://192.168.1.20/main"),
        (f"rtsp://admin:{SECRET}@camera.local:554/h264/ch1", "camera.local", "rtsp://camera.local:554/h264/ch1"),
        (f"rtsps://{SECRET}@[fd00::7]:322/x", "fd00::7", "rtsps://[fd00::7]:322/x"),
        (f"rtsp://10.0.0.7/live?user=admin&password={SECRET}", "10.0.0.7", "rtsp://10.0.0.7/live"),
        (f"rtsp://10.0.0.7/user=admin_password={SECRET}_channel=1", "10.0.0.7", "rtsp://10.0.0.7/…"),
        ("rtsp://10.0.0.7", "10.0.0.7", "rtsp://10.0.0.7"),
    ],
)
def test_an_address_is_shown_without_what_may_be_a_password(url: str, host: str, shown: str) -> None:
    address = parse_stream(url)
    assert (address.url, address.host, address.shown) == (url, host, shown)
    assert SECRET not in repr(address)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "rtsp:",
        "rtsp://",
        "rtsp:///main",
        f"http://a:{SECRET}@camera/x",
        f"rtsp://a:{SECRET}@cam era/x",
        f"rtsp://a:{SECRET}@camera:port/x",
        f"rtsp://a:{SECRET}@camera:99999/x",
        f"rtsp://a:{SECRET}@-camera/x",
        f"file:///etc/{SECRET}",
        f"rtsp://a:{SECRET}@cam\x1bera/x",
    ],
)
def test_anything_else_is_refused_and_not_quoted(text: str) -> None:
    with pytest.raises(UsageError, match=r"such as rtsp://192\.168") as caught:
        parse_stream(text)
    assert SECRET not in str(caught.value)


@pytest.mark.parametrize(
    ("host", "allowed"),
    [
        ("192.168.1.20", True),
        ("192.168.2.20", False),
        ("camera.local", True),
        ("CAMERA.local", True),
        ("camera.local.example.org", False),
        ("fd00::7", True),
        ("fd01::7", False),
    ],
)
def test_only_hosts_on_the_list_are_allowed(host: str, allowed: bool) -> None:
    assert is_allowed(host, ["192.168.1.0/24", "camera.local", "fd00::/16"]) == allowed


def test_a_list_is_needed_and_must_be_understood() -> None:
    check_allowed(["10.0.0.7", "camera.local", "192.168.1.0/24"])
    with pytest.raises(UsageError, match="name the hosts that are allowed"):
        check_allowed([])
    with pytest.raises(UsageError, match=r"192\.168\.1\.0/99"):
        check_allowed(["192.168.1.0/99"])
