"""What tests of several rooms share."""

import atexit
import gc
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import Phase, settings

if TYPE_CHECKING:
    import numpy as np

# Whoever runs the tests may have settings of their own, which are not tried here; programs that tests start inherit this.
os.environ["XDG_CONFIG_HOME"] = tempfile.mkdtemp(prefix="no-settings-")
atexit.register(shutil.rmtree, os.environ["XDG_CONFIG_HOME"], ignore_errors=True)
for name in [name for name in os.environ if name.startswith("GCS_MOSAIC_")]:
    del os.environ[name]

# As the program does when it is started: sums of several threads differ in their last digits from those of one.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# A busy machine is no fault of what is tested.
settings.register_profile("patient", deadline=None)
settings.register_profile("first", deadline=None, phases=[Phase.explicit, Phase.generate])  # the first failure will do
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "patient"))

# Files that take minutes: begun first, so that at the end no core waits for one of them.
LONGEST = (
    *("test_lower_bounds.py", "test_readme.py", "test_soak.py", "test_style.py", "test_real_flights.py"),
    *("test_adversarial.py", "test_wheel.py", "test_ground_page.py", "test_looking_page.py"),
)

ALL_LONG = re.compile(r"^pytestmark(, \w+)? = (\[\s*)?(pytest\.mark\.long|THOROUGH)\b", re.MULTILINE)
SOME_LONG = re.compile(r"\b(long|thorough|THOROUGH)\b")


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Files whose tests are all of another tier need not be loaded to know it: that takes longer than many a test."""
    if not collection_path.name.startswith("test_"):
        return None
    text, asked = collection_path.read_text(encoding="utf-8"), config.option.markexpr
    is_left_out = bool(ALL_LONG.search(text)) if asked == "not long" else not SOME_LONG.search(text)
    return True if is_left_out and asked in ("not long", "long and not thorough", "thorough") else None


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """What is collected stays to the end: to look through it for garbage while it grows, and with each look afterwards, takes a
    third of the time of loading, and seconds at the end."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    marked = {item.path for item in items if item.get_closest_marker("long")}
    if unseen := sorted(str(path) for path in marked if not SOME_LONG.search(path.read_text(encoding="utf-8"))):
        raise pytest.UsageError(f"marked as long without the word, and never collected as such: {', '.join(unseen)}")
    items.sort(key=lambda item: item.path.name not in LONGEST)


@pytest.fixture(autouse=True)
def stays_here() -> Iterator[None]:
    """Whoever leaves the working folder lets later tests start other programs: `python -m` looks there first."""
    here = Path.cwd()
    yield
    if Path.cwd() != here:
        os.chdir(here)
        pytest.fail(f"the test has left {here}")


@pytest.fixture(scope="session")
def world_cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where painted worlds of the simulated flights are kept during one run of the tests: one folder for all its processes."""
    own = tmp_path_factory.getbasetemp()
    folder = (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "painted-worlds"
    folder.mkdir(exist_ok=True)
    return folder


@pytest.fixture(scope="session")
def pictures(world_cache: Path) -> list[bytes]:
    """JPEG files of six pictures that overlap."""
    from tests.running import six_pictures

    return six_pictures(world_cache)


@pytest.fixture(scope="session")
def complaints() -> Iterator[list[str]]:
    """What the page's servers in this process have answered otherwise than they describe it."""
    from tests.web.answers import judged

    yield from judged()


@pytest.fixture
def every_answer_is_as_described(complaints: list[str]) -> Iterator[None]:
    """For tests that ask such a server."""
    yield
    found, complaints[:] = sorted(set(complaints)), []
    if found:
        pytest.fail("\n".join(found))


@pytest.fixture
def tiny_disk(tmp_path: Path) -> Iterator[Path]:
    """A real file system of one megabyte."""
    if sys.platform != "linux":
        pytest.skip("a file system of its own is mounted on Linux only")
    place = tmp_path / "tiny"
    place.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", place], capture_output=True, text=True)
    if mounted.returncode != 0:
        pytest.skip(f"mounting a small file system is not permitted here: {mounted.stderr.strip()}")
    yield place
    subprocess.run(["umount", "--lazy", place], check=True)


@pytest.fixture(scope="session")
def ground() -> "np.ndarray":
    from stitch_ground import textured_ground  # it loads numpy, which reads the environment above

    return textured_ground(2400, seed=1)


@pytest.fixture(scope="session")
def other_ground() -> "np.ndarray":
    from stitch_ground import textured_ground

    return textured_ground(1200, seed=2)
