"""The process that seeks hints, kept up beside the page for as long as somebody wants hints."""

from __future__ import annotations

import asyncio
import json
import logging
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Literal

from gcs_mosaic.hints.settings import HintSettings
from gcs_mosaic.notes.hint_wishes import PickedColour

logger = logging.getLogger(__name__)

# -P: nothing is imported from the working directory
PROGRAM = (sys.executable, "-P", "-m", "gcs_mosaic.hints.hint_process")
FIRST_PAUSE_S, LONGEST_PAUSE_S = 1.0, 60.0  # before another is started; doubles while none lives
LIVED_S = 60.0  # then what ended it is not the start itself
END_S = 3.0  # to end by itself
LONGEST_LINE = 1 << 16

State = Literal["off", "starting", "seeking", "refused"]


class HintKeeper:
    """Use it from one event loop. `state` and `trouble` are for whoever looks."""

    def __init__(self, root: Path, settings: HintSettings) -> None:
        self.state: State = "off"
        self.trouble = ""  # a sentence, if hints cannot be sought
        self._root, self._settings = root, settings
        self._asked: bool | None = None
        self._colours: Sequence[PickedColour] = ()
        self._news = asyncio.Event()

    @property
    def is_asked(self) -> bool:
        """Whether hints are to be sought: as somebody has said on the page, else by the settings."""
        return self._settings.enabled if self._asked is None else self._asked

    def wish(self, asked: bool | None, colours: Sequence[PickedColour]) -> None:
        """What is wanted now; `asked` None: as the settings say."""
        if (asked, list(colours)) != (self._asked, list(self._colours)):
            self._asked, self._colours = asked, list(colours)
            self._news.set()

    async def keep_for_ever(self) -> None:
        """Have the process while it is wanted."""
        pause = FIRST_PAUSE_S
        while True:
            if not self.is_asked:
                self.state, self.trouble = "off", ""
                await self._changed()
                continue
            began = asyncio.get_running_loop().time()
            await self._seek()
            if self.is_asked:
                lived = asyncio.get_running_loop().time() - began
                pause = FIRST_PAUSE_S if lived > LIVED_S else min(2 * pause, LONGEST_PAUSE_S)
                with suppress(TimeoutError):
                    await asyncio.wait_for(self._changed(), pause)

    async def _seek(self) -> None:
        """One process, from its start to its end."""
        self.state = "starting"
        try:
            process = await asyncio.create_subprocess_exec(
                *PROGRAM,
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                stderr=asyncio.subprocess.STDOUT,
                limit=LONGEST_LINE,
                env=os.environ | {"PYTHONPATH": os.pathsep.join(place or str(Path.cwd()) for place in sys.path)},
            )
        except OSError:
            logger.warning("hints cannot be sought: their process does not start", exc_info=True)
            self.trouble = "The process that seeks hints cannot be started now; it is tried again."
            return
        reader = asyncio.create_task(self._read(process))
        try:
            await self._tell_it(process, reader)
        finally:
            await _end(process)
            reader.cancel()
            with suppress(asyncio.CancelledError):
                await reader

    async def _tell_it(self, process: asyncio.subprocess.Process, reader: asyncio.Task[None]) -> None:
        """Tell what is wanted, until nothing is or the process has ended."""
        task = {"root": str(self._root.absolute()), "settings": asdict(self._settings)}
        with suppress(ConnectionError):
            await _write(process, task)
            while self.is_asked and not reader.done():
                told = [{"number": one.id, "bgr": one.bgr, "tolerance": one.tolerance} for one in self._colours]
                await _write(process, {"colours": told})
                news = asyncio.create_task(self._changed())
                await asyncio.wait([news, reader], return_when=asyncio.FIRST_COMPLETED)
                news.cancel()
        if self.is_asked and self.state != "refused":
            logger.warning("the process that seeks hints has ended; it is started again")
            self.state, self.trouble = "starting", "The process that seeks hints has ended; it is started again."

    async def _read(self, process: asyncio.subprocess.Process) -> None:
        """Take in what it tells, until it ends."""
        assert process.stdout is not None, "a pipe"
        with suppress(ValueError):  # a line that is too long
            while line := await process.stdout.readline():
                self._hear(line)

    def _hear(self, line: bytes) -> None:
        try:
            told = dict(json.loads(line))
        except (ValueError, TypeError):
            logger.warning("the process that seeks hints: %s", line.decode("utf-8", "replace").rstrip())
            return
        if "ready" in told:
            self.state, self.trouble = "seeking", ""
        elif "refused" in told:
            self.state, self.trouble = "refused", str(told["refused"])

    async def _changed(self) -> None:
        await self._news.wait()
        self._news.clear()


async def _write(process: asyncio.subprocess.Process, told: object) -> None:
    """Raises ConnectionError when it has ended."""
    assert process.stdin is not None, "a pipe"
    process.stdin.write(f"{json.dumps(told)}\n".encode())
    await process.stdin.drain()


async def _end(process: asyncio.subprocess.Process) -> None:
    """Close its input and wait for its end, which is brought about if need be."""
    assert process.stdin is not None, "a pipe"
    process.stdin.close()
    try:
        await asyncio.wait_for(process.wait(), END_S)
    except TimeoutError:
        with suppress(ProcessLookupError):
            process.kill()
        await process.wait()
