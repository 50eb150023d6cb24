"""Who may look: this machine, and whoever has the token."""

from __future__ import annotations

import json
import os
import socket
import ssl
import stat
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from http.cookies import SimpleCookie
from pathlib import Path

import pytest

from gcs_mosaic.errors import UsageError
from gcs_mosaic.hints.settings import HintSettings
from gcs_mosaic.messages import SourceReport
from gcs_mosaic.store.records import NoticeRecord
from gcs_mosaic.web import access as module
from gcs_mosaic.web import invitation as invitations
from gcs_mosaic.web.address import HttpAddress, own_names
from gcs_mosaic.web.hidden_paths import without_paths
from gcs_mosaic.web.invitation import invitation, own_addresses, scannable
from gcs_mosaic.web.server import WebServer
from gcs_mosaic.web.serving import serve_until
from gcs_mosaic.web.settings import WebSettings
from gcs_mosaic.web.token import LENGTH, TOKEN, Access, access_to, kept_token
from tests.running import until
from tests.web.small_flight import SmallFlight
from tests.web.test_app import Client

TOKEN_OF_THE_FLIGHT = "abcdefgh23456789"
EVERYWHERE = HttpAddress("0.0.0.0", 0)
DATA = (
    "/",
    "/mosaic.json",
    "/placements.json",
    "/placements.jsonl",
    "/status.json",
    "/tiles/0/0/0/0",
    "/live",
    "/none",
)


@dataclass
class Served:
    client: Client
    port: int

    def status(self, path: str = "/mosaic.json", **headers: str) -> int:
        return self.client.status(path, **headers)

    def cookie(self, token: str = TOKEN_OF_THE_FLIGHT) -> str:
        return f"gcs-mosaic-{self.port}={token}"


@pytest.fixture
def flight(tmp_path: Path) -> SmallFlight:
    made = SmallFlight(tmp_path)
    made.write()
    made.status()
    return made


@pytest.fixture
def from_elsewhere(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody is taken for this machine."""
    monkeypatch.setattr(module, "is_loopback", lambda origin: False)


@pytest.fixture
def served(flight: SmallFlight) -> Iterator[Served]:
    server = WebServer(flight.root, EVERYWHERE, access=Access(token=TOKEN_OF_THE_FLIGHT))
    yield Served(Client(server.start()), server.port)
    server.stop()


@pytest.fixture
def stranger(served: Served, from_elsewhere: None) -> Served:
    return served


def lan_address() -> str:
    found = next(iter(own_addresses("0.0.0.0")), None)
    if found is None:
        pytest.skip("this machine is on no network")
    return found


def test_this_machine_needs_no_token(served: Served) -> None:
    assert served.status() == 200
    answer, _ = served.client.ask("/?token=whatever")
    assert (answer.status, answer.headers["Location"], answer.headers["Set-Cookie"]) == (303, "/", None)


def test_another_address_of_this_very_machine_needs_one(served: Served) -> None:
    client = Client(f"http://{lan_address()}:{served.port}/")
    assert client.status("/mosaic.json") == 401
    assert client.status("/mosaic.json", Cookie=served.cookie()) == 200


@pytest.mark.parametrize("path", [*DATA, "/viewer/viewer.js"])
def test_nothing_is_shown_without_it(stranger: Served, path: str) -> None:
    answer, body = stranger.client.ask(path)
    assert answer.status == 401
    assert b"This device may not look yet" in body
    assert answer.headers["X-Content-Type-Options"] == "nosniff"


def test_the_link_is_opened_once(stranger: Served) -> None:
    answer, _ = stranger.client.ask(f"/?token={TOKEN_OF_THE_FLIGHT}")
    assert (answer.status, answer.headers["Location"]) == (303, "/")
    (cookie,) = SimpleCookie(answer.headers["Set-Cookie"]).values()
    assert cookie["httponly"]
    assert not cookie["secure"]
    assert (cookie["samesite"], cookie["path"]) == ("Strict", "/")
    sent = f"{cookie.key}={cookie.value}"
    assert [stranger.status(path, Cookie=sent) for path in DATA[:2]] == [200, 200]
    assert stranger.status(Cookie=sent[:-1]) == 401


def test_a_browser_that_withholds_the_cookie_after_a_link_is_sent_once_more(stranger: Served) -> None:
    _, body = stranger.client.ask("/", **{"Sec-Fetch-Site": "cross-site"})
    assert b'http-equiv="refresh"' in body
    _, body = stranger.client.ask("/", **{"Sec-Fetch-Site": "same-origin"})
    assert b"refresh" not in body


def test_a_program_sends_it_as_a_bearer(stranger: Served) -> None:
    assert stranger.status(Authorization=f"Bearer {TOKEN_OF_THE_FLIGHT}") == 200
    assert stranger.status(Authorization="Bearer x") == 401
    assert stranger.status(Authorization=f"Basic {TOKEN_OF_THE_FLIGHT}") == 401


def test_guessing_is_stopped_but_not_for_who_is_let_in_already(stranger: Served) -> None:
    tried = [stranger.status(f"/?token={n:016}") for n in range(module.TRIES + 2)]
    assert tried == [401] * module.TRIES + [429] * 2
    assert stranger.status(f"/?token={TOKEN_OF_THE_FLIGHT}") == 429
    assert stranger.status(Authorization=f"Bearer {TOKEN_OF_THE_FLIGHT}") == 429
    assert stranger.status(Cookie=stranger.cookie()) == 200


def test_guesses_by_cookie_are_limited_in_rate_and_shut_nobody_out(
    stranger: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Links and bearers had a limit, cookies none: they could be guessed as fast as the server answers."""
    monkeypatch.setattr(module, "GUESS_S", 0.3)
    tried = [stranger.status(Cookie=stranger.cookie(f"{n:016}")) for n in range(module.TRIES - 1)]
    assert tried == [401] * (module.TRIES - 1)
    began = time.monotonic()
    assert [stranger.status(Cookie=stranger.cookie(f"x{n}")) for n in range(2)] == [429] * 2
    assert time.monotonic() - began > 0.6
    assert [stranger.status(Cookie=stranger.cookie()) for _ in range(3)] == [200] * 3
    assert stranger.status(Authorization="Bearer x") == 429


def test_a_tablet_with_the_cookie_of_an_earlier_flight_is_no_guesser(stranger: Served) -> None:
    old = stranger.cookie("zzzzzzzz99999999")
    assert [stranger.status(Cookie=old) for _ in range(3 * module.TRIES)] == [401] * 3 * module.TRIES
    assert stranger.status(f"/?token={TOKEN_OF_THE_FLIGHT}", Cookie=old) == 303


def test_wrong_tokens_are_forgotten_in_time_and_of_many_addresses() -> None:
    wrong = module.WrongTokens()
    for n in range(module.TRIES):
        wrong.note("a", 0.0, str(n))
    assert wrong.are_too_many("a", 1.0)
    assert not wrong.are_too_many("b", 1.0)
    assert not wrong.are_too_many("a", module.TRIES_S)
    for n in range(module.REMEMBERED):
        wrong.note(str(n), 1.0, "x")
    assert not wrong.are_too_many("a", 1.0)


def test_the_same_wrong_token_is_one_guess_however_often_it_comes() -> None:
    wrong = module.WrongTokens()
    for n in range(100):
        wrong.note("a", 0.1 * n, "of the last flight")
    assert not wrong.are_too_many("a", 10.0)


def test_everybody_may_look_only_if_the_settings_say_so(flight: SmallFlight, from_elsewhere: None) -> None:
    for access, status in ((Access(is_open=True), 200), (Access(), 401)):
        server = WebServer(flight.root, EVERYWHERE, access=access)
        assert Client(server.start()).status("/mosaic.json") == status
        server.stop()


def test_names_of_this_machine_are_its_own(served: Served) -> None:
    for name in own_names():
        assert served.status(Host=f"{name}:{served.port}") == 200
    assert served.status(Host="laptop.evil.example") == 403
    assert served.status(Host="8.8.8.8") == 200  # numbers cannot be rebound


def test_a_name_that_a_network_gives_this_machine_needs_the_token_even_here(
    flight: SmallFlight, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever runs the network could give it, for a moment, to a machine of their own."""
    monkeypatch.setattr(socket, "getfqdn", lambda: "Laptop.Field.Example")
    server = WebServer(flight.root, EVERYWHERE, access=Access(token=TOKEN_OF_THE_FLIGHT))
    served = Served(Client(server.start()), 0)
    assert served.status(Host="laptop.field.example") in (401, 403)  # the name is asked for in the background
    bearer = f"Bearer {TOKEN_OF_THE_FLIGHT}"
    until(lambda: served.status(Host="laptop.field.example", Authorization=bearer) == 200, "the name is known")
    server.stop()


def test_another_page_can_change_nothing(served: Served) -> None:
    assert served.client.status("/mosaic.json", "POST", Origin="http://evil.example") == 403
    own = f"http://{served.client.netloc}"
    assert served.client.status("/mosaic.json", "POST", Origin=own) == 405


def test_where_things_lie_is_told_to_this_machine_only(
    served: Served, flight: SmallFlight, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = "the folder /volumes/card/DCIM is gone, see '/opt/x/mosaic/flight.log'"
    watch = SourceReport(kind="folder", name="/volumes/some body/Card (100)/DCIM 1", state="watching")
    flight.status(watch=watch, notices=(NoticeRecord(utc=0, source="frames", level="info", text=text),))
    assert served.client.ask("/status.json")[1] == (flight.root / "status.json").read_bytes()
    monkeypatch.setattr(module, "is_loopback", lambda origin: False)
    answer, body = served.client.ask("/status.json", Cookie=served.cookie())
    assert answer.headers["Content-Type"].startswith("application/json")
    told = json.loads(body)
    assert told["watch"]["folder"] == "DCIM 1"
    assert "/volumes" not in body.decode()
    assert told["notices"][0]["text"] == "the folder DCIM is gone, see 'flight.log'"


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("/opt/a/b/DCIM", "DCIM"),
        ("frames come from /a/b/c; 3 were there", "frames come from c; 3 were there"),
        ("serial:/dev/ttyACM0:57600", "serial:ttyACM0:57600"),
        ("http://10.0.0.1:8470/", "http://10.0.0.1:8470/"),
        ("rtsp://10.0.0.1:554/main", "rtsp://10.0.0.1:554/main"),
        ("stream/2026/a.jpg", "stream/2026/a.jpg"),
        ("3 frames/s and/or 1/2", "3 frames/s and/or 1/2"),
        ("C:\\Users\\me\\DCIM is gone", "DCIM is gone"),
        ("udp:127.0.0.1:14550", "udp:127.0.0.1:14550"),
        ("a / b", "a / b"),
        ("/a", "a"),
        ("", ""),
    ],
)
def test_paths_are_shortened_and_nothing_else(text: str, shown: str) -> None:
    document = json.dumps({"a": text, "b": [text]})
    assert json.loads(without_paths(document)) == {"a": shown, "b": [shown]}


def test_the_token_survives_and_comes_along_to_the_next_flight(tmp_path: Path) -> None:
    first, second, third = (tmp_path / name for name in "abc")
    for folder in (first, second, third):
        folder.mkdir()
    token = kept_token(first)
    assert TOKEN.fullmatch(token)
    assert kept_token(first) == token
    if os.name == "posix":
        assert stat.S_IMODE((first / "page.token").stat().st_mode) == 0o600
    assert kept_token(second, [third, first]) == token
    assert kept_token(third) != token


@pytest.mark.parametrize("written", [b"", b"short", b"\xff" * LENGTH, b"a" * 10_000, b"../../../../../.."])
def test_a_token_that_we_did_not_make_is_replaced(tmp_path: Path, written: bytes) -> None:
    (tmp_path / "page.token").write_bytes(written)
    token = kept_token(tmp_path)
    assert TOKEN.fullmatch(token)
    assert kept_token(tmp_path) == token


def test_a_folder_that_cannot_be_written_keeps_no_token(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "page.token").mkdir()
    assert TOKEN.fullmatch(kept_token(tmp_path))
    assert "the token cannot be kept" in caplog.text


def test_on_loopback_there_is_no_token(tmp_path: Path) -> None:
    for host in ("127.0.0.1", "localhost", "::1"):
        assert access_to(HttpAddress(host, 0), WebSettings(), tmp_path) == Access()
    assert access_to(EVERYWHERE, WebSettings(open=True), tmp_path) == Access(is_open=True)
    assert not (tmp_path / "page.token").exists()
    assert access_to(EVERYWHERE, WebSettings(), tmp_path) == Access(token=kept_token(tmp_path))


def test_others_are_told_the_addresses_of_this_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(invitations, "own_addresses", lambda wildcard: iter(["10.0.0.5", "10.1.0.5"]))
    invited = invitation(EVERYWHERE, 8470, Access(token="t"), secure=False)
    assert invited is not None
    where = "http://10.0.0.5:8470/ or http://10.1.0.5:8470/"
    assert invited.notice == f"others on the network can look at {where} with the link on the terminal"
    assert invited.links == ("http://10.0.0.5:8470/?token=t", "http://10.1.0.5:8470/?token=t")
    assert "token=" not in invited.notice
    invited = invitation(HttpAddress("10.0.0.5", 1), 8470, Access(is_open=True), secure=True)
    assert invited is not None
    assert invited.links == ("https://10.0.0.5:8470/",)
    assert "everybody on the network can look" in invited.notice
    assert invitation(HttpAddress("127.0.0.1", 1), 8470, Access(), secure=False) is None
    monkeypatch.setattr(invitations, "own_addresses", lambda wildcard: iter([]))
    invited = invitation(EVERYWHERE, 8470, Access(token="t"), secure=False)
    assert invited is not None
    assert (invited.links, "is on no network" in invited.notice) == ((), True)


def test_a_served_flight_tells_how_others_get_in(flight: SmallFlight, capsys: pytest.CaptureFixture[str]) -> None:
    lan_address()
    stop = threading.Event()
    stop.set()
    serve_until(stop, flight.root, "0.0.0.0:0", WebSettings(qr="always"), HintSettings())
    first, notice, link, *rest = capsys.readouterr().out.splitlines()
    assert first.startswith("the map is at http://127.0.0.1:")
    assert notice.startswith("others on the network can look at http://")
    assert link.endswith(f"/?token={kept_token(flight.root)}")
    assert "▀" in "".join(rest)
    serve_until(stop, flight.root, "127.0.0.1:0", WebSettings(qr="always"), HintSettings())
    assert len(capsys.readouterr().out.splitlines()) == 1


def test_this_machine_knows_its_addresses() -> None:
    found = list(own_addresses("0.0.0.0"))
    assert not [address for address in found if address.startswith("127.")]
    for address in found:
        with socket.socket() as one:
            one.bind((address, 0))


def test_the_link_can_be_scanned() -> None:
    lines = scannable("http://192.168.100.200:8470/?token=abcdefgh23456789").splitlines()
    assert len(lines) < 22  # of a terminal of 24
    assert len({len(line) for line in lines}) == 1
    assert set("".join(lines)) <= set(" ▀▄█")


def test_cookies_over_https_are_secure(flight: SmallFlight, certificate: Path, from_elsewhere: None) -> None:
    settings = WebSettings(certificate=str(certificate))
    server = WebServer(flight.root, EVERYWHERE, access=Access(token=TOKEN_OF_THE_FLIGHT), settings=settings)
    assert server.start() == f"https://127.0.0.1:{server.port}/"
    context = ssl.create_default_context(cafile=str(certificate))
    one = socket.create_connection(("127.0.0.1", server.port))
    with context.wrap_socket(one, server_hostname="127.0.0.1") as secured:
        secured.sendall(f"GET /?token={TOKEN_OF_THE_FLIGHT} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode())
        said = secured.recv(65536).decode()
    assert said.startswith("HTTP/1.1 303")
    assert "; Secure" in said
    server.stop()


def test_files_that_are_no_certificate_are_refused_in_one_sentence(tmp_path: Path, certificate: Path) -> None:
    nonsense, locked = tmp_path / "nonsense.pem", tmp_path / "locked.pem"
    nonsense.write_text("nonsense")
    locked.write_text("-----BEGIN ENCRYPTED PRIVATE KEY-----\nMAAA\n-----END ENCRYPTED PRIVATE KEY-----\n")
    cases = ((tmp_path / "none.pem", None), (nonsense, None), (certificate, nonsense), (certificate, locked))
    for given, key in cases:
        settings = WebSettings(certificate=str(given), key=str(key) if key else None)
        with pytest.raises(UsageError, match="name PEM files of a certificate and its private key") as error:
            WebServer(tmp_path, HttpAddress("127.0.0.1", 0), settings=settings).start()
        assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"key": "k.pem"}, "key: expected a certificate with it"),
        ({"connections": 0}, "connections: expected more than 0"),
        ({"answer_s": -1.0}, "answer_s: expected more than 0"),
        ({"connections": 5}, "expected more than connections_per_address"),
    ],
)
def test_settings_that_cannot_be_are_refused(settings: dict[str, object], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        WebSettings(**settings)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("header", "value"), [("Authorization", "Bearer \xff"), ("Cookie", "gcs-mosaic=\xff"), ("Origin", "http://[")]
)
def test_headers_that_are_no_text_are_refused_and_nothing_raises(
    tmp_path: Path, header: str, value: str, caplog: pytest.LogCaptureFixture
) -> None:
    server = WebServer(tmp_path, HttpAddress("127.0.0.1", 0), access=Access(token="secret"))
    client = Client(server.start())
    assert client.status("/mosaic.json", "POST", Host=client.netloc, **{header: value}) < 500
    server.stop()
    assert "Traceback" not in caplog.text
    assert not module.same("\udcff", "secret")  # as other machines send it


def test_a_damaged_journal_leads_to_the_whole_list(tmp_path: Path) -> None:
    server = WebServer(tmp_path, HttpAddress("127.0.0.1", 0))
    client = Client(server.start())
    for damaged in (b"", b'{"since": 0}\n\0\0\0\0\n'):
        (tmp_path / "placements.jsonl").write_bytes(damaged)
        assert client.status("/placements.jsonl") == 404
    server.stop()
