"""A real browser for tests: Debian's Chromium, driven by Playwright."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from playwright.sync_api import Error, sync_playwright
from playwright.sync_api import Page as OpenPage

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
QUIET = [
    "--no-sandbox",  # which needs rights that containers do not give
    "--disable-gpu",
    "--disable-quic",
    "--disable-background-networking",
    "--hide-scrollbars",
]
ANSWER_MS = 15_000


class Page:
    """One open page. `requests` are the URLs that it asked for, `complaints` what went wrong on it."""

    def __init__(self, page: OpenPage) -> None:
        self._page = page
        self.requests: list[str] = []
        self.complaints: list[str] = []
        self.received = 0  # bytes that have come over the network, headers included
        page.set_default_timeout(ANSWER_MS)
        page.on("request", lambda request: self.requests.append(request.url))
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self._devtools = page.context.new_cdp_session(page)
        self._devtools.on("Network.dataReceived", self._note_bytes)
        self._devtools.on("Network.responseReceived", lambda told: self._note_bytes(told["response"]))
        self._devtools.on("Log.entryAdded", lambda told: self._note_entry(told["entry"]))
        # Without these bounds the tab keeps up to 200 MB of what it was sent, for developers to look at.
        self.command("Network.enable", maxTotalBufferSize=1, maxResourceBufferSize=1)
        self.command("Log.enable")
        self.keep_nothing()

    def _note_bytes(self, told: dict[str, Any]) -> None:
        self.received += told.get("encodedDataLength", 0)

    def _note_entry(self, entry: dict[str, Any]) -> None:
        if entry["source"] == "security":
            self.complaints.append(entry["text"])

    def command(self, method: str, **parameters: object) -> dict[str, Any]:
        """A command of the DevTools protocol. Raises RuntimeError."""
        try:
            answer: dict[str, Any] = self._devtools.send(method, parameters)
        except Error as error:
            raise RuntimeError(f"{method}: {error}") from error
        return answer

    def keep_nothing(self, *, nothing: bool = True) -> None:
        """Whether the page is without its service worker, which answers for a server that is away."""
        self.command("Network.setBypassServiceWorker", bypass=nothing)

    def open(self, url: str) -> None:
        """Go to `url` and wait until the document is there."""
        self._page.goto(url)

    def another(self) -> Page:
        """Another tab of the same browser."""
        return Page(self._page.context.new_page())

    def close(self) -> None:
        """Close the tab as somebody does."""
        self._page.close(run_before_unload=True)

    def key(self, name: str) -> None:
        """Press and release a key."""
        self._page.keyboard.press(name)

    def resize(self, width: int, height: int, *, touch: bool = False) -> None:
        self.command(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=touch
        )

    def evaluate(self, expression: str) -> Any:
        """The value of a JavaScript expression (a promise is waited for). Raises RuntimeError."""
        try:
            return self._page.evaluate(expression)
        except Error as error:
            raise RuntimeError(str(error)) from error

    def wait_for(self, expression: str, timeout_s: float = 30.0) -> None:
        """Until the expression is true; on a page that goes elsewhere meanwhile, of the one it goes to."""
        end = time.monotonic() + timeout_s
        while not self._is_true(expression):
            assert time.monotonic() < end, f"never true: {expression}\n{self.evaluate('document.body?.innerText')}"
            self._page.wait_for_timeout(50)

    def _is_true(self, expression: str) -> bool:
        try:
            return bool(self.evaluate(expression))
        except RuntimeError as error:
            if "Execution context was destroyed" not in str(error):
                raise
            return False

    def hosts(self) -> set[str]:
        """Every host that the page asked anything of."""
        urls = [urlsplit(url) for url in self.requests]
        return {url.netloc for url in urls if url.scheme not in ("data", "blob", "about")}

    def screenshot(self, path: Path) -> None:
        self._page.screenshot(path=path)


@contextmanager
def open_browser(profile: Path, options: Sequence[str] = ()) -> Iterator[Page]:
    """A browser with one empty page; it is ended with the block."""
    assert CHROMIUM is not None
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch_persistent_context(
            profile, executable_path=CHROMIUM, headless=True, args=[*QUIET, *options], no_viewport=True
        )
        try:
            yield Page(browser.pages[0])
        finally:
            browser.close()
