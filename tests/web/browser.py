"""A real browser for tests: headless chromium, spoken to over its DevTools protocol."""

from __future__ import annotations

import asyncio
import base64
import json
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import aiohttp

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
QUIET = [
    "--headless=new",
    "--no-sandbox",  # which needs rights that containers do not give
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--disable-quic",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-default-apps",
    "--disable-extensions",
    "--disable-sync",
    "--no-first-run",
    "--hide-scrollbars",
    "--remote-debugging-port=0",
]
START_S = 20.0
ANSWER_S = 15.0


class Page:
    """One open page. Events that come while an answer is waited for are kept in `requests` and `complaints`."""

    def __init__(self, runner: asyncio.Runner, socket: aiohttp.ClientWebSocketResponse) -> None:
        self._runner, self._socket, self._last_id = runner, socket, 0
        self.requests: list[str] = []
        self.complaints: list[str] = []
        self.received = 0  # bytes that have come over the network, headers included
        for domain in ("Page", "Network", "Runtime", "Log"):
            self.command(f"{domain}.enable")
        self.keep_nothing()

    def command(self, method: str, **parameters: object) -> dict[str, Any]:
        return self._runner.run(asyncio.wait_for(self._command(method, parameters), ANSWER_S))

    async def _command(self, method: str, parameters: dict[str, object]) -> dict[str, Any]:
        self._last_id += 1
        await self._socket.send_json({"id": self._last_id, "method": method, "params": parameters})
        while (message := await self._socket.receive_json()).get("id") != self._last_id:
            self._note(message)
        if "error" in message:
            raise RuntimeError(f"{method}: {message['error']}")
        result: dict[str, Any] = message["result"]
        return result

    def _note(self, message: dict[str, Any]) -> None:
        match message["method"]:
            case "Network.requestWillBeSent":
                self.requests.append(message["params"]["request"]["url"])
            case "Network.dataReceived":
                self.received += message["params"]["encodedDataLength"]
            case "Network.responseReceived":
                self.received += message["params"]["response"].get("encodedDataLength", 0)
            case "Runtime.exceptionThrown":
                self.complaints.append(str(message["params"]["exceptionDetails"]))
            case "Log.entryAdded" if message["params"]["entry"]["source"] == "security":
                self.complaints.append(message["params"]["entry"]["text"])

    def keep_nothing(self, *, nothing: bool = True) -> None:
        """Whether the page is without its service worker, which answers for a server that is away."""
        self.command("Network.setBypassServiceWorker", bypass=nothing)

    def open(self, url: str) -> None:
        """Go to `url` and wait until the document is there."""
        self.command("Page.navigate", url=url)
        self.wait_for("document.readyState === 'complete' && location.href === " + json.dumps(url))

    def resize(self, width: int, height: int, *, touch: bool = False) -> None:
        self.command(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=touch
        )

    def evaluate(self, expression: str) -> Any:
        """The value of a JavaScript expression (a promise is waited for)."""
        answer = self.command("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            raise RuntimeError(answer["exceptionDetails"])
        return answer["result"].get("value")

    def wait_for(self, expression: str, timeout_s: float = 10.0) -> None:
        """Until the expression is true."""
        end = time.monotonic() + timeout_s
        while not self.evaluate(expression):
            assert time.monotonic() < end, f"never true: {expression}\n{self.evaluate('document.body?.innerText')}"
            time.sleep(0.05)

    def hosts(self) -> set[str]:
        """Every host that the page asked anything of."""
        urls = [urlsplit(url) for url in self.requests]
        return {url.netloc for url in urls if url.scheme not in ("data", "blob", "about")}

    def screenshot(self, path: Path) -> None:
        path.write_bytes(base64.b64decode(self.command("Page.captureScreenshot", format="png")["data"]))


@contextmanager
def open_browser(profile: Path) -> Iterator[Page]:
    """A browser with one empty page; it is ended with the block."""
    assert CHROMIUM is not None
    command = [CHROMIUM, *QUIET, f"--user-data-dir={profile}", "about:blank"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            with asyncio.Runner() as runner:
                port = devtools_port(profile / "DevToolsActivePort")
                session, socket = runner.run(connect(port))
                try:
                    yield Page(runner, socket)
                finally:
                    runner.run(close(session, socket))
        finally:
            process.terminate()
            process.wait(10)


def devtools_port(file: Path) -> int:
    end = time.monotonic() + START_S
    while not file.exists() or "\n" not in file.read_text():
        assert time.monotonic() < end, "the browser did not start"
        time.sleep(0.05)
    return int(file.read_text().split("\n")[0])


async def connect(port: int) -> tuple[aiohttp.ClientSession, aiohttp.ClientWebSocketResponse]:
    session = aiohttp.ClientSession()
    async with session.get(f"http://127.0.0.1:{port}/json/list") as answer:
        targets = await answer.json()
    url = next(target["webSocketDebuggerUrl"] for target in targets if target["type"] == "page")
    return session, await session.ws_connect(url, max_msg_size=0)


async def close(session: aiohttp.ClientSession, socket: aiohttp.ClientWebSocketResponse) -> None:
    await socket.close()
    await session.close()
