"""Small faults put into the program, and which of them no quick test notices.

    python -m tests.benchmarks.mutants gcs_mosaic/triggers [--sample 60] [--seed 1] [--jobs 1] [--minutes 60]

Each mutant is one change of a file (a comparison, a boundary, and/or, not, + - * /, a number by one, True/False, a result left
out, a call left out), tried in a copy of the project by the quick tests of its room, and those near by that import its module.
One run without a fault tells which tests execute which lines: a mutant is tried by those that execute its own, the quickest
first, and by those of the module if none does, as where another process does it. Mutants that change nothing anybody could see
are listed in mutants_equivalent.txt, with the reason, and left out. The copies, and whatever the tests write, lie in one folder
for temporary files, which is gone in the end.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from tests.benchmarks.mutant_tests import Reach, Watch, read
from tests.benchmarks.mutations import Mutant, mutants_of

ROOT = Path(__file__).parents[2]
COPIED = ("gcs_mosaic", "tests", "sitl", "config", "pyproject.toml", "README.md")
EQUIVALENT = Path(__file__).with_name("mutants_equivalent.txt")
LOADED = ("pytest", "coverage", "numpy", "cv2", "scipy.spatial", "sqlite3")  # once, for all that is forked
NEVER = "gcs_mosaic/processes"  # it signals processes, and a mutant of it others
REACH = "reach.json"  # in a copy: what its tests execute
MOST_BYTES = 6 << 30  # of address space of each process
LEAST_S, PATIENCE = 20.0, 4.0  # of time for a test, and for all; and as a multiple of what they take without a fault


@dataclass(slots=True)
class Trial:
    """One mutant that is being tried, by the process `pid`, in a copy."""

    mutant: Mutant
    pid: int
    copy: Path
    began: float
    until: float


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("paths", nargs="+", help="files or folders of the package")
    parser.add_argument("--sample", type=int, default=60, help="how many mutants are tried")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--minutes", type=float, default=60.0, help="after which no further one is begun")
    given = parser.parse_args()
    known = equivalents()
    every = [mutant for path in sources(given.paths) for mutant in mutants_of(path, ROOT)]
    some = [mutant for mutant in every if str(mutant) not in known]
    some = random.Random(given.seed).sample(some, min(given.sample, len(some)))
    print(
        f"{len(some)} of {len(every)} mutants, {len(every) - len(known & set(map(str, every)))} not known as equivalent"
    )
    signal.signal(signal.SIGTERM, asked_to_end)
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # a process with threads is not to be forked
    for module in LOADED:
        importlib.import_module(module)
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        outcomes = tried(some, Path(folder), given.jobs, time.monotonic() + 60 * given.minutes)
    noticed = len(outcomes) - outcomes.count("survived")
    print(f"{noticed} of {len(outcomes)} were noticed, {noticed / max(len(outcomes), 1):.0%}")


def asked_to_end(number: int, _frame: object) -> None:
    """Once; a second time would leave copies behind."""
    signal.signal(number, signal.SIG_IGN)
    sys.exit(1)


def sources(paths: list[str]) -> Iterator[Path]:
    for path in (ROOT / path for path in paths):
        found = sorted(path.rglob("*.py")) if path.is_dir() else [path]
        yield from (one for one in found if not one.is_relative_to(ROOT / NEVER))


def equivalents() -> set[str]:
    """Lines of what a mutant is, indented ones tell why it is no fault."""
    lines = EQUIVALENT.read_text(encoding="utf-8").splitlines()
    return {line for line in lines if line and not line[0].isspace() and line[0] != "#"}


def tried(mutants: list[Mutant], folder: Path, jobs: int, until: float) -> list[str]:
    """What becomes of those that are begun before `until`; each is told as soon as it is known."""
    copies, running, outcomes = [copy_into(folder / str(job)) for job in range(jobs)], list[Trial](), list[str]()
    waiting, reaches = mutants[::-1], dict[Path, Reach]()
    try:
        while running or (waiting and time.monotonic() < until):
            while waiting and copies and time.monotonic() < until:
                copy, mutant = copies.pop(), waiting.pop()
                room = mutant.path.parent
                if room not in reaches:
                    reaches[room] = reach_of({one.path for one in mutants if one.path.parent == room}, copy)
                running.append(begun(mutant, copy, reaches[room], len(waiting)))
            time.sleep(0.05)
            for trial in list(running):
                if (outcome := outcome_of(trial)) is not None:
                    running.remove(trial)
                    copies.append(trial.copy)
                    shutil.copyfile(ROOT / trial.mutant.path, trial.copy / trial.mutant.path)
                    outcomes.append(outcome)
                    took_s = time.monotonic() - trial.began
                    print(
                        f"{outcome:8} {took_s:4.0f} s {trial.mutant.path}:{trial.mutant.line}: {trial.mutant}",
                        flush=True,
                    )
    finally:
        for trial in running:
            stop(trial.pid)
            os.waitpid(trial.pid, 0)  # what it writes would be left behind
    return outcomes


def copy_into(folder: Path) -> Path:
    """No links: a mutant may write into what it should not."""
    folder.mkdir()
    (folder / "temporary").mkdir()
    for name in COPIED:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copyfile(ROOT / name, folder / name)
    return folder


def begun(mutant: Mutant, copy: Path, reach: Reach, number: int) -> Trial:
    path = copy / mutant.path
    path.write_text(mutant.text(), encoding="utf-8")
    later = time.time() + 2 * number  # bytecode of the mutant before is told from this one's by whole seconds
    os.utime(path, (later, later))
    module = ".".join(mutant.path.with_suffix("").parts)
    importing = [test for test in named_tests(mutant.path) if imports(ROOT / test, module)]
    tests = reach.tests(mutant.path, mutant.lines, importing)
    limit_s = max(LEAST_S, PATIENCE * (reach.seconds_of(tests) if tests else sum(reach.seconds.values())))
    longest_s = PATIENCE * max((reach.seconds[test] for test in tests or reach.seconds), default=0.0)
    now = time.monotonic()
    pid = forked(tests or named_tests(mutant.path), copy, most_s=max(LEAST_S, longest_s))
    return Trial(mutant, pid, copy, now, now + limit_s)


def reach_of(paths: set[Path], copy: Path) -> Reach:
    """Which tests execute which lines of a room's files. Raises SystemExit where they fail without a fault."""
    pid = forked(sorted({test for path in paths for test in named_tests(path)}), copy, sorted(paths))
    try:
        _, status = os.waitpid(pid, 0)
    except BaseException:
        stop(pid)
        os.waitpid(pid, 0)
        raise
    if status:
        said = (copy / "said").read_text(encoding="utf-8", errors="replace")
        sys.exit(f"the tests of {min(paths).parent} fail without a fault: {said[-2000:]}")
    found = read((copy / REACH).read_text(encoding="utf-8"))
    print(f"{min(paths).parent}: {len(found.seconds)} tests of {sum(found.seconds.values()):.0f} s", flush=True)
    return found


def outcome_of(trial: Trial) -> str | None:
    pid, status = os.waitpid(trial.pid, os.WNOHANG)
    if pid:
        stop(trial.pid)  # what it may have left running
        return "killed" if status else "survived"
    if time.monotonic() < trial.until:
        return None
    stop(trial.pid)
    os.waitpid(trial.pid, 0)
    return "too long"


def stop(pid: int) -> None:
    """A forked process leads a group of its own."""
    try:
        os.killpg(pid, signal.SIGKILL)
    except ProcessLookupError:
        return


def forked(tests: list[str], copy: Path, watched: list[Path] | None = None, most_s: float = 0.0) -> int:
    """A process that runs tests in a copy and ends with 0 if all pass, each in `most_s`; what they execute of `watched` files is
    written there."""
    pid = os.fork()
    if pid == 0:
        run_tests(tests, copy, watched or [], most_s)
    return pid


def run_tests(tests: list[str], copy: Path, watched: list[Path], most_s: float) -> NoReturn:
    status = 1
    try:
        os.setsid()
        resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, resource.getrlimit(resource.RLIMIT_AS)[1]))
        said = os.open(copy / "said", os.O_RDWR | os.O_CREAT | os.O_TRUNC)
        for stream in range(3):
            os.dup2(said, stream)
        os.chdir(copy)
        tempfile.tempdir = None
        os.environ |= {"PYTHONPATH": str(copy), "HOME": str(copy), "TMPDIR": str(copy / "temporary")}
        os.environ["HYPOTHESIS_PROFILE"] = "first"
        ours = [name for name in sys.modules if name.partition(".")[0] in ("tests", "gcs_mosaic", "sitl")]
        for name in ours:
            del sys.modules[name]
        sys.path[:] = [str(copy), *(entry for entry in sys.path if Path(entry or ".").resolve() not in (ROOT, copy))]
        importlib.invalidate_caches()
        found = importlib.util.find_spec("gcs_mosaic")
        if found is not None and Path(found.origin or "").is_relative_to(copy):
            import pytest

            watch = Watch(copy, watched)
            if watched:
                watch.begin()
            options = ["-x", "-q", "-n0", "-p", "no:cacheprovider", f"--rootdir={copy}"]
            options += [f"--timeout={most_s:.0f}"] if most_s else []
            status = pytest.main([*options, *tests], plugins=[watch] if watched else [])
            if watched:
                (copy / REACH).write_text(watch.reach().kept(), encoding="utf-8")
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(int(status))


def named_tests(path: Path) -> list[str]:
    """Test files of a module: of its name, those of its room that import it, others that do, and the room's others."""
    module, room = ".".join(path.with_suffix("").parts), ROOT / "tests" / Path(*path.parts[1:-1])
    while not room.is_dir():
        room = room.parent
    of_room = set(room.rglob("test_*.py")) if room != ROOT / "tests" else set()

    def rank(test: Path) -> tuple[bool, bool, bool, str]:
        return not test.stem.endswith(path.stem), test not in importing, test not in of_room, str(test)

    importing = {test for test in (ROOT / "tests").rglob("test_*.py") if imports(test, module)}
    near = {test for test in importing if test.relative_to(ROOT).parts[1] == path.parts[1]}
    return [str(test.relative_to(ROOT)) for test in sorted(of_room | near, key=rank)]


def imports(test: Path, module: str) -> bool:
    package, _, name = module.rpartition(".")
    text = test.read_text(encoding="utf-8")
    return module in text or re.search(rf"from {package} import [^\n]*\b{name}\b", text) is not None


if __name__ == "__main__":
    subprocess.run(["renice", "-n", "15", "-p", str(os.getpid())], capture_output=True, check=False)
    main()
