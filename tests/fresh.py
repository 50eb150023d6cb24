"""A fresh clone of this project, as somebody has it who just got it, and what its environment needs."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
OURS = ("PYTHONPATH", "VIRTUAL_ENV", "PYTEST_ADDOPTS", "PYTEST_CURRENT_TEST")
MINUTE = 60.0


def environment(**more: str) -> dict[str, str]:
    """The environment of a new terminal, as far as the tests have changed it."""
    return {name: value for name, value in os.environ.items() if name not in OURS} | more


def clone(target: Path) -> Path:
    """What is committed, and on top of it what is not yet committed of the files that git knows."""
    if not (ROOT / ".git").exists():
        pytest.skip("this is no clone: a fresh one cannot be made of it")
    run("git", "clone", "--quiet", str(ROOT), str(target))
    changes = subprocess.run(["git", "diff", "--binary", "HEAD"], cwd=ROOT, capture_output=True, check=True).stdout
    if changes:
        subprocess.run(["git", "apply", "-"], cwd=target, input=changes, check=True, timeout=MINUTE)
    return target


def run(*command: str, cwd: Path = ROOT, minutes: float = 5) -> str:
    """What a command says; a test fails with it when the command fails."""
    done = subprocess.run(
        command,
        cwd=cwd,
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=minutes * MINUTE,
    )
    assert done.returncode == 0, f"{' '.join(command)} ended with {done.returncode}:\n{done.stdout}"
    return done.stdout


def need_packages(folder: Path) -> None:
    """Skip the test where pip reaches no package."""
    probe = ["download", "--quiet", "--no-deps", "--retries", "1", "--dest", str(folder / "probe"), "setuptools"]
    done = subprocess.run([sys.executable, "-m", "pip", *probe], env=environment(), capture_output=True, check=False)
    if done.returncode:
        pytest.skip("pip reaches no packages from here")
