"""What a program and all that it starts take of the machine while it runs. Linux only, as it reads /proc."""

from __future__ import annotations

import os
import threading
from contextlib import suppress
from pathlib import Path
from types import TracebackType

LOOK_S = 0.2
TICKS = os.sysconf("SC_CLK_TCK")
PAGE = os.sysconf("SC_PAGE_SIZE")


class Watched:
    """Looks at a process and its children until the block ends. `cpu_s`: seconds of all cores that all of them have used;
    `resident_mb`: the largest sum of their resident sizes, pages that they share counted for each; `largest_mb`: of one."""

    def __init__(self, process: int) -> None:
        self._process = process
        self._used: dict[int, float] = {}
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._look_on, name="watched", daemon=True)
        self.resident_mb = self.largest_mb = 0.0

    def __enter__(self) -> Watched:
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        self._stop.set()
        self._thread.join()

    @property
    def cpu_s(self) -> float:
        return sum(self._used.values())

    def _look_on(self) -> None:
        while not self._stop.wait(LOOK_S):
            self._look()

    def _look(self) -> None:
        resident = [0.0]
        for process in family(self._process):
            with suppress(OSError, IndexError):
                self._used[process] = cpu_of(process)
                resident.append(int(Path(f"/proc/{process}/statm").read_text().split()[1]) * PAGE / 2**20)
        self.resident_mb, self.largest_mb = max(self.resident_mb, sum(resident)), max(self.largest_mb, *resident)


def cpu_of(process: int) -> float:
    """CPU seconds that a process and its threads have used, its children aside. Raises OSError when it has gone."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


def family(process: int) -> list[int]:
    """A process and all below it that run now."""
    parents: dict[int, int] = {}
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            with suppress(OSError, IndexError):
                parents[int(folder.name)] = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
    found = [process]
    for one in found:
        found += [child for child, parent in parents.items() if parent == one]
    return found
