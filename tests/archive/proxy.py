"""A tiny proxy before the server of S3 of the tests: keeps count of what is asked, and answers as buckets in trouble do."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.client import HTTPConnection
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import urlsplit

import pytest

from gcs_mosaic.archive.files import files_at

Answer = tuple[int, str]  # status, and S3's name of the error
Trouble = Callable[[str, str], Answer | None]  # by method and path; None: the server answers

DENIED, SLOW_DOWN, NO_KEY = (403, "AccessDenied"), (503, "SlowDown"), (404, "NoSuchKey")
PASSED_ON = ("Content-Type", "ETag", "Last-Modified", "Content-Range", "Accept-Ranges")


@contextmanager
def troubled(address: str, trouble: Trouble = lambda method, path: None) -> Iterator[list[str]]:
    """Buckets are asked through a proxy from now on; yields methods and paths of all requests."""
    asked: list[str] = []
    server = ThreadingHTTPServer(("127.0.0.1", 0), proxy(address, trouble, asked))
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, daemon=True).start()
    files_at.cache_clear()
    try:
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{server.server_port}")
            yield asked
    finally:
        server.shutdown()
        server.server_close()
        files_at.cache_clear()


def proxy(address: str, trouble: Trouble, asked: list[str]) -> type[BaseHTTPRequestHandler]:
    """What answers, and notes what was asked."""

    class Proxy(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def answer(self) -> None:
            body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
            asked.append(f"{self.command} {self.path}")
            told = trouble(self.command, self.path)
            if told is not None:
                return self.say(told[0], f"<Error><Code>{told[1]}</Code><Message>no</Message></Error>".encode(), {})
            behind = HTTPConnection(urlsplit(address).netloc, timeout=30)
            behind.request(self.command, self.path, body, dict(self.headers))
            found = behind.getresponse()
            data, length = found.read(), found.headers.get("Content-Length")
            headers = {name: found.headers[name] for name in PASSED_ON if name in found.headers}
            behind.close()
            return self.say(found.status, data, headers, length if self.command == "HEAD" else None)

        def say(self, status: int, data: bytes, headers: dict[str, str], length: str | None = None) -> None:
            self.send_response(status)
            for name, value in headers.items():
                self.send_header(name, value)
            self.send_header("Content-Length", length or str(len(data)))
            self.end_headers()
            if self.command != "HEAD":
                self.wfile.write(data)

        do_GET = do_PUT = do_POST = do_HEAD = do_DELETE = answer  # noqa: N815 - names of the library

        def log_message(self, format: str, *words: object) -> None: ...

    return Proxy
