"""Which tests can notice a fault: those that execute it, as one run without any fault has shown."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import coverage
import pytest

IMPORTING = ""  # what is executed before the first test


@dataclass(slots=True)
class Reach:
    """What each test took, in seconds, and which tests have executed a line: `lines` by file, the tests `in_setup` for all that
    come after them in their file, which get what a fixture has made once."""

    seconds: dict[str, float] = field(default_factory=dict)
    lines: dict[str, dict[int, list[str]]] = field(default_factory=dict)
    in_setup: dict[str, dict[int, list[str]]] = field(default_factory=dict)

    def tests(self, path: Path, lines: range, importing: Collection[str] = ()) -> list[str]:
        """The tests that execute any of these lines, the quickest first. What is executed where the module is loaded concerns all
        that use it, and those of the files that are `importing` it."""
        of_file = self.lines.get(str(path), {})
        found = {test for line in lines for test in of_file.get(line, ())}
        if IMPORTING in found:
            found = {test for tests in of_file.values() for test in tests}
            found |= {test for test in self.seconds if test.partition("::")[0] in importing}
        once = {test.partition("::")[0] for line in lines for test in self.in_setup.get(str(path), {}).get(line, ())}
        found |= {test for test in self.seconds if test.partition("::")[0] in once}
        return sorted(found - {IMPORTING}, key=lambda test: (self.seconds.get(test, 0.0), test))

    def seconds_of(self, tests: list[str]) -> float:
        """What these take."""
        return sum(self.seconds.get(test, 0.0) for test in tests)

    def kept(self) -> str:
        """As JSON."""
        return json.dumps([self.seconds, self.lines, self.in_setup])


def read(text: str) -> Reach:
    """What `kept` has written."""
    seconds, *both = json.loads(text)
    lines, in_setup = ({path: {int(n): tests for n, tests in of.items()} for path, of in one.items()} for one in both)
    return Reach(seconds, lines, in_setup)


class Watch:
    """A plugin of pytest that notes which test executes which lines of these folders or files, below `root`."""

    def __init__(self, root: Path, watched: list[Path]) -> None:
        self._root = root
        include = [str(root / path / "*" if (root / path).is_dir() else root / path) for path in watched]
        self._coverage = coverage.Coverage(data_file=None, config_file=False, include=include)
        self._seconds: dict[str, float] = {}

    def begin(self) -> None:
        self._coverage.start()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_setup(self, item: pytest.Item) -> Iterator[None]:
        self._coverage.switch_context(f"{item.nodeid}|setup")
        return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Iterator[None]:
        self._coverage.switch_context(f"{item.nodeid}|run")
        return (yield)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self._seconds[report.nodeid] = self._seconds.get(report.nodeid, 0.0) + report.duration

    def reach(self) -> Reach:
        """What has been seen so far."""
        self._coverage.stop()
        data, found = self._coverage.get_data(), Reach(self._seconds)
        for name in data.measured_files():
            path = str(Path(name).relative_to(self._root))
            for line, contexts in data.contexts_by_lineno(name).items():
                found.lines.setdefault(path, {})[line] = sorted({one.rpartition("|")[0] for one in contexts})
                if made := sorted({one.removesuffix("|setup") for one in contexts if one.endswith("|setup")}):
                    found.in_setup.setdefault(path, {})[line] = made
        return found
