"""What is installed from a wheel: the package and nothing else at the top, all data in it, and a flight to try it with."""

import shlex
import sys
import zipfile
from pathlib import Path

import pytest

from tests import fresh
from tests.ports import free_port
from tests.test_readme import flies_and_shows_the_map

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    fresh.need_packages(folder)
    clone = fresh.clone(folder / "clone")
    words = ["--quiet", "--no-deps", "--no-build-isolation", "--wheel-dir", str(folder), str(clone)]
    fresh.run(sys.executable, "-m", "pip", "wheel", *words)
    (built,) = folder.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of its programs, in an environment of its own, in which what nobody imports is not compiled."""
    folder = tmp_path_factory.mktemp("installed") / "venv"
    fresh.run(sys.executable, "-m", "venv", "--without-pip", str(folder))
    where = ["--python", str(folder / "bin" / "python")]
    fresh.run(sys.executable, "-m", "pip", *where, "install", "--quiet", "--no-compile", str(wheel))
    return folder / "bin"


def test_nothing_but_the_package_is_at_the_top(wheel: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
    assert {name.split("/")[0] for name in names if ".dist-info/" not in name} == {"gcs_mosaic"}
    for needed in ("py.typed", "config/default.yaml", "web/viewer/index.html", "sitl/stream/server.py"):
        assert f"gcs_mosaic/{needed}" in names


def test_the_defaults_are_told(installed: Path, tmp_path: Path) -> None:
    told = fresh.run(str(installed / "gcs-mosaic"), "config", cwd=tmp_path)
    assert told == (fresh.ROOT / "config" / "default.yaml").read_text()


def test_a_simulated_flight_is_flown_and_shown(installed: Path, tmp_path: Path) -> None:
    """With what the package says that it needs, and nothing else: as the README's first command, but for its length."""
    words = f"demo --stay --count 5 --size 640x480 --speed 8 --http 127.0.0.1:{free_port()}"
    flies_and_shows_the_map(f"{shlex.quote(str(installed))}/gcs-mosaic {words}", tmp_path, tmp_path / "said")
