"""Requests that no browser sends: refused in a sentence, and nothing raises."""

from __future__ import annotations

import gzip
import http.client
import zlib
from collections.abc import Iterator

import pytest

from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.api.common import LARGEST_BODY
from gcs_mosaic.web.server import WebServer
from tests.notes.mapped import MappedFlight
from tests.web.test_app import Client

FINDS = "/api/v1/finds"
JSON = "application/json"
WHOLE = b'{"island": 0, "x": 20, "y": 30, "who": "Kim", "kind": "tent", "label": "a", "note": "\xc3\xbc"}'


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Client]:
    root = tmp_path_factory.mktemp("odd") / "flight"
    root.mkdir()
    MappedFlight(root)
    server = WebServer(root, HttpAddress("127.0.0.1", 0))
    yield Client(server.start())
    server.stop()


def posted(client: Client, body: bytes, **headers: str) -> tuple[int, str]:
    connection = http.client.HTTPConnection(client.netloc, timeout=5)
    try:
        connection.request("POST", FINDS, body, {name.replace("_", "-"): value for name, value in headers.items()})
        answer = connection.getresponse()
        return answer.status, answer.read().decode()
    finally:
        connection.close()


CHARSETS = ("zzz", "zlib", "rot13", "undefined", "idna", "base64", "punycode", "x" * 300)


@pytest.mark.parametrize("charset", CHARSETS)
def test_a_charset_that_nobody_knows_is_the_sender_s_fault(client: Client, charset: str) -> None:
    """It was answered as a fault of the server."""
    status, said = posted(client, WHOLE, Content_Type=f"{JSON}; charset={charset}")
    assert 400 <= status < 500
    assert said.count("\n") == 1


BROKEN = [
    ("gzip", b"\x1f\x8b\x08\x00aaaa"),
    ("gzip", gzip.compress(WHOLE, mtime=0)[:40]),
    ("gzip", WHOLE),
    ("deflate", b"\xff" * 40),
    ("br", b"\xff" * 40),
    ("zstd", b"\xff" * 40),
    ("nonsense", WHOLE[:-4]),
    ("gzip, gzip", WHOLE[:-4]),
]


@pytest.mark.parametrize(("encoding", "body"), BROKEN)
def test_a_body_that_cannot_be_unpacked_is_the_sender_s_fault(client: Client, encoding: str, body: bytes) -> None:
    status, said = posted(client, body, Content_Type=JSON, Content_Encoding=encoding)
    assert 400 <= status < 500, said


def test_a_small_body_that_unpacks_to_a_large_one_is_too_large(client: Client) -> None:
    bomb = gzip.compress(b"[" + b" " * (100 * LARGEST_BODY) + b"]")
    assert len(bomb) < LARGEST_BODY
    assert posted(client, bomb, Content_Type=JSON, Content_Encoding="gzip")[0] == 413


@pytest.mark.parametrize("charset", ["utf-8", "UTF8", "iso-8859-1", "utf-16"])
def test_what_could_be_sent_can_be_sent(client: Client, charset: str) -> None:
    body = WHOLE.decode().encode(charset)
    assert posted(client, body, Content_Type=f"{JSON}; charset={charset}")[0] == 201
    packed = zlib.compress(body)
    assert posted(client, packed, Content_Type=f"{JSON}; charset={charset}", Content_Encoding="deflate")[0] == 201


ODD = [
    ("If-Modified-Since", "Mon, 99999999999999999999 Jan 2020 00:00:00 GMT"),
    ("If-Modified-Since", "Mon, 01 Jan 99999 99:99:99 GMT"),
    ("If-Unmodified-Since", "Mon, 01 Jan -1 00:00:00 +99999999999999999999"),
    ("If-Range", "x" * 4000),
    ("If-None-Match", 'W/"' + '"' * 4000),
    ("Range", "bytes=99999999999999999999999-"),
    ("Range", "bytes=" + ",".join("0-1" for _ in range(500))),
    ("Range", "bytes=-0"),
    ("Accept-Encoding", ",".join("gzip;q=0" for _ in range(500))),
    ("Cookie", ";".join(f"a{n}=" for n in range(800))),
    ("Cookie", "=" * 4000 + '"' * 100),
    ("Content-Type", "; ; ;=;" * 100),
    ("Content-Type", "application/json; charset*=x'y'%00"),
    ("Authorization", "Bearer " + "x" * 7000),
    ("Sec-Fetch-Site", "\xff"),
    ("X-Forwarded-For", "'; drop table finds"),
]


@pytest.mark.parametrize(("name", "value"), ODD, ids=str)
@pytest.mark.parametrize("path", ["/", "/mosaic.json", "/viewer/viewer.js", FINDS, "/tiles/0/16/32768/32768"])
def test_odd_headers_raise_nothing(
    client: Client, path: str, name: str, value: str, caplog: pytest.LogCaptureFixture
) -> None:
    assert client.status(path, **{name: value}) < 500
    assert "Traceback" not in caplog.text
