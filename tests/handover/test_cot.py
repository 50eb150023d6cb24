"""A find as an event of Cursor on Target: read by another implementation, and sent over real sockets."""

from __future__ import annotations

import http.client
import re
import socket
import threading
import time
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import pytest

from gcs_mosaic.errors import UsageError
from gcs_mosaic.handover import cot
from gcs_mosaic.handover.cot import as_cot, send_cot
from gcs_mosaic.handover.cot_address import CotAddress, cot_address
from gcs_mosaic.notes.anchors.anchoring import anchor_of
from gcs_mosaic.notes.anchors.stored_anchors import anchors_of
from gcs_mosaic.notes.finds.finds import Finds, NewFind, PlacedFind, placed
from gcs_mosaic.notes.ground.binding import GroundFollower
from gcs_mosaic.notes.storage.book import NotesBook
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.views.taken import CaptureTime
from gcs_mosaic.web.api import handed_over
from gcs_mosaic.web.settings import WebSettings
from tests.handover.gapped import gapped_flight
from tests.web.served import served
from tests.web.test_app import Client

GROUP = "239.2.3.1"  # ATAK's own
NASTY = 'tent "<&>\x00\u2028 red'


def found(root: Path, label: str = "tent") -> PlacedFind:
    with closing(NotesBook(root)) as book:
        follower = GroundFollower(FlightView(root))
        finds = Finds(book)
        new = NewFind(
            kind="tent",
            label=label,
            note="by the brook",
            who="Kim",
            in_original=False,
            binding=follower.bound(0, 30.0, 20.0),
        )
        finds.create(new)
        return placed(finds.all(), follower, anchor_of(anchors_of(FlightView(root))))[0]


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return gapped_flight(tmp_path / "flight")


def test_an_event_tells_where_how_exactly_and_what(root: Path) -> None:
    one = found(root)
    event = ET.fromstring(as_cot(one, "flight", CaptureTime(1.7e9, "message"), 1.8e9))
    assert (event.tag, event.get("version"), event.get("type"), event.get("how")) == (
        "event",
        "2.0",
        "b-m-p-s-m",
        "h-e",
    )
    assert (event.get("time"), event.get("stale")) == ("2027-01-15T08:00:00Z", "2027-01-16T08:00:00Z")
    point = event.find("point")
    assert point is not None
    assert one.geo is not None
    assert float(point.get("lat", "")) == pytest.approx(one.geo.latitude_deg, abs=1e-6)
    assert float(point.get("lon", "")) == pytest.approx(one.geo.longitude_deg, abs=1e-6)
    assert float(point.get("ce", "")) >= one.geo.error_m
    assert event.findtext("detail/remarks") == "tent; by the brook; taken 2023-11-14T22:13:20Z; marked by Kim"


def test_a_find_keeps_its_uid_and_another_flight_s_find_has_another(root: Path) -> None:
    one = found(root)
    uids = [ET.fromstring(as_cot(one, name, None, at)).get("uid") for name, at in (("a", 1.0), ("a", 2.0), ("b", 1.0))]
    assert uids[0] == uids[1] != uids[2]


def test_what_somebody_typed_spoils_no_event(root: Path) -> None:
    event = ET.fromstring(as_cot(found(root, NASTY), "flight", None, 1.8e9))
    contact = event.find("detail/contact")
    assert contact is not None
    assert contact.get("callsign") == 'tent "<&>\ufffd\ufffd red'


def test_a_second_implementation_reads_it(root: Path) -> None:
    import takproto

    read = takproto.parse_proto(bytes(takproto.xml2proto(as_cot(found(root), "flight", None, time.time()))))
    assert read.cotEvent.type == "b-m-p-s-m"
    assert read.cotEvent.detail.contact.callsign == "tent"
    assert read.cotEvent.lat == pytest.approx(47.4, abs=0.1)


def test_it_keeps_the_rules_of_the_schema(root: Path) -> None:
    """MITRE's Event schema 2.0: what is required, in which shape and range; nothing else stands in the event or its point."""
    event = ET.fromstring(as_cot(found(root, NASTY), "flight", None, 1.8e9))
    required = {"version", "uid", "type", "time", "start", "stale", "how"}
    assert set(event.keys()) == required
    assert float(event.get("version", "")) >= 2
    assert re.fullmatch(r"\w+(-\w+)*(;[^;]*)?", event.get("type", ""))
    assert re.fullmatch(r"\w(-\w+)*", event.get("how", ""))
    times = [event.get(name, "") for name in ("start", "time", "stale")]
    assert all(re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d+)?Z", one) for one in times)
    assert times == sorted(times)
    assert [child.tag for child in event] == ["point", "detail"]
    point = event[0]
    assert set(point.keys()) == {"lat", "lon", "hae", "ce", "le"}
    assert all(re.fullmatch(r"-?\d+(\.\d+)?", value) for value in point.attrib.values()), "decimals, never 1e-05"
    assert abs(float(point.get("lat", ""))) <= 90
    assert abs(float(point.get("lon", ""))) <= 180


def test_without_an_anchor_nothing_is_made(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no anchor"):
        as_cot(found(gapped_flight(tmp_path / "flight", pinned=False)), "flight", None, 1.0)


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("udp:239.2.3.1:6969", CotAddress("udp", "239.2.3.1", 6969)),
        ("tcp://tak.example:8087", CotAddress("tcp", "tak.example", 8087)),
        ("udp:[ff05::1]:6969", CotAddress("udp", "ff05::1", 6969)),
    ],
)
def test_addresses(text: str, address: CotAddress) -> None:
    assert cot_address(text) == address


@pytest.mark.parametrize(
    "text", ["", "239.2.3.1:6969", "udp:239.2.3.1", "udp:a:0", "tcp:a b:1", "http://a:1", "udp:a:99999"]
)
def test_what_is_no_address_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="such as udp:239"):
        cot_address(text)
    with pytest.raises(ValueError, match=r"^cot: "):
        WebSettings(cot=text)


@pytest.fixture
def listener() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        one.settimeout(5)
        yield one


def test_it_goes_out_as_one_datagram(listener: socket.socket) -> None:
    send_cot("<event/>", CotAddress("udp", *listener.getsockname()))
    assert listener.recv(65536) == b"<event/>"


@pytest.fixture
def member() -> Iterator[socket.socket]:
    """A member of ATAK's group, on a machine that is shown to carry datagrams to it."""
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other,
    ):
        one.bind(("", 0))
        one.settimeout(5)
        try:
            group = socket.inet_aton(GROUP) + socket.inet_aton("0.0.0.0")
            one.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
            other.sendto(b"carried", (GROUP, one.getsockname()[1]))
            assert one.recv(100) == b"carried"
        except OSError as error:  # before anything of ours is asked
            pytest.skip(f"this machine carries no multicast: {error}")
        yield one


def test_it_goes_to_a_multicast_group(member: socket.socket) -> None:
    send_cot("<event/>", CotAddress("udp", GROUP, member.getsockname()[1]))
    assert member.recv(100) == b"<event/>"


def test_it_goes_over_tcp_and_nobody_there_is_said() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(5)  # of a test that fails no thread is left
        address = CotAddress("tcp", *server.getsockname())
        heard = list[bytes]()

        def hear() -> None:
            with server.accept()[0] as caller:
                caller.settimeout(5)
                heard.append(caller.recv(100))

        thread = threading.Thread(target=hear)
        thread.start()
        send_cot("<event/>", address)
        thread.join(5)
    assert heard == [b"<event/>"]
    with pytest.raises(UsageError, match="cannot be sent to tcp:127"):
        send_cot("<event/>", address)


def test_a_name_that_is_found_too_late_has_nothing_sent(
    listener: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    find = socket.getaddrinfo

    def find_slowly(*given: Any, **named: Any) -> Any:
        time.sleep(0.2)
        return find(*given, **named)

    monkeypatch.setattr(socket, "getaddrinfo", find_slowly)
    listener.settimeout(0.2)
    with pytest.raises(UsageError, match="timed out"):
        send_cot("<event/>", CotAddress("udp", *listener.getsockname()), timeout_s=0.1)
    with pytest.raises(TimeoutError):
        listener.recv(65536)


def posted(client: Client, path: str) -> tuple[http.client.HTTPResponse, bytes]:
    with closing(http.client.HTTPConnection(client.netloc, timeout=5)) as connection:
        connection.request("POST", path, b'{"who": "Kim"}', {"Content-Type": "application/json"})
        answer = connection.getresponse()
        return answer, answer.read()


def test_the_page_sends_only_where_the_settings_say(root: Path, listener: socket.socket) -> None:
    found(root)
    host, port = listener.getsockname()
    for settings, status in ((None, 409), (WebSettings(cot=f"udp:{host}:{port}"), 200)):
        with served(root, settings=settings) as url:
            client = Client(url)
            answer, body = posted(client, "/api/v1/finds/1/cot")
            assert (answer.status, b"web: {cot" in body) == (status, status == 409)
            assert client.ask("/api/v1/finds/1/event.cot")[1].startswith(b"<?xml")
            assert client.ask("/api/v1/finds/7/event.cot")[0].status == 404
    assert b'callsign="tent"' in listener.recv(65536)


@pytest.mark.long
def test_while_a_name_is_not_found_others_are_refused(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found(root)
    begun, may_end, find = threading.Event(), threading.Event(), socket.getaddrinfo

    def find_slowly(host: str, *given: Any, **named: Any) -> Any:
        if host == "nobody.example":
            begun.set()
            may_end.wait(10)
            raise socket.gaierror("nobody knows it")
        return find(host, *given, **named)

    monkeypatch.setattr(socket, "getaddrinfo", find_slowly)
    monkeypatch.setattr(cot, "SEND_S", 0.3)
    monkeypatch.setattr(handed_over, "FINDING_NAMES_S", 0.2)
    with served(root, settings=WebSettings(cot="udp:nobody.example:6969")) as url, ExitStack() as stack:
        stack.callback(may_end.set)
        client = Client(url)
        answer, body = posted(client, "/api/v1/finds/1/cot")  # in less than the client's 5 s
        assert (answer.status, b"its name is not found" in body) == (409, True)
        assert begun.is_set()
        answer, body = posted(client, "/api/v1/finds/1/cot")
        assert (answer.status, b"Another find is being sent" in body) == (409, True)
        may_end.set()
        deadline = time.monotonic() + 5
        while b"Another find" in body and time.monotonic() < deadline:
            answer, body = posted(client, "/api/v1/finds/1/cot")
        assert (answer.status, b"nobody knows it" in body) == (409, True)


@pytest.mark.long
def test_an_event_without_a_readable_ledger_is_refused_in_a_sentence(root: Path) -> None:
    found(root)
    with served(root) as url:
        client = Client(url)
        assert client.ask("/api/v1/finds/1/event.cot")[0].status == 200
        (root / LEDGER_NAME).rename(root / "away.sqlite")
        answer, body = client.ask("/api/v1/finds/1/event.cot")
    assert answer.status == 409
    assert re.fullmatch(rb"[^\n]*flight.sqlite[^\n]*\n", body), body
