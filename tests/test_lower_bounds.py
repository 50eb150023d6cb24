"""The oldest versions that pyproject.toml allows will do.

The environment of these tests holds the newest ones; here one is made that holds the oldest, with the project installed
as a package and not found by its folder, and a few tests of each room that uses those libraries are run in it.
"""

import re
import sys
import tomllib
from pathlib import Path

import pytest

from tests import fresh
from tests.sure import sure

PROJECT = tomllib.loads((fresh.ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
NEEDED_TO_TEST = ("pytest", "pytest-timeout", "hypothesis", "av")
# A smoke set: each library where it is used.
TESTS = (
    *("test_config.py", "app/test_pipeline.py"),
    *(
        "frames/test_decode.py",
        "frames/test_integrity.py",
        "frames/test_exif.py",
        "frames/rtsp/test_stream_address.py",
    ),
    *("mavlink/test_mavlink_parser.py", "mavlink/test_signing.py", "mavlink/test_mavlink_messages.py"),
    *("stitch/features", "stitch/registration", "stitch/bundle/test_levenberg_marquardt.py"),
    *("render/test_canvas.py", "render/test_warp.py", "export/test_multiband_tiff.py"),
    *("store/test_ledger.py", "web/test_app.py", "web/test_feed.py"),
)
pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(sys.version_info >= (3, 12), reason="the oldest libraries are for the oldest Python"),
]


def oldest() -> list[str]:
    """Every dependency, and what the tests need themselves, at the lower end of its range."""
    development = PROJECT["optional-dependencies"]["dev"]
    wanted = PROJECT["dependencies"] + [
        one for one in development if sure(re.match(r"[\w-]+", one))[0] in NEEDED_TO_TEST
    ]
    return [re.sub(r"^([\w-]+)>=([\w.]+),.*$", r"\1==\2", one) for one in wanted]


def test_every_range_has_both_ends() -> None:
    assert all(re.fullmatch(r"[\w-]+==[\d.]+", one) for one in oldest())


@pytest.mark.timeout(900)
def test_the_oldest_versions_do(tmp_path: Path) -> None:
    fresh.need_packages(tmp_path)
    clone = fresh.clone(tmp_path / "clone")
    python = environment_of_the_oldest(tmp_path, clone)
    beside = tmp_path / "beside"  # what tests know by its folder, without the package
    beside.mkdir()
    for folder in ("sitl", "tests"):
        (beside / folder).symlink_to(clone / folder)
    apart = (
        "-o",
        f"pythonpath=tests tests/stitch tests/mavlink {beside}",
        "-o",
        "addopts=-q -rs -m 'not long'",
        "-p",
        "no:cacheprovider",
        "--basetemp",
        str(tmp_path / "temporary"),
    )
    fresh.run(python, "-P", "-m", "pytest", *apart, *TESTS, cwd=clone / "tests", minutes=10)


def environment_of_the_oldest(folder: Path, clone: Path) -> str:
    """Its Python."""
    python = str(folder / "oldest" / "bin" / "python")
    fresh.run(sys.executable, "-m", "venv", str(folder / "oldest"))
    fresh.run(python, "-m", "pip", "install", "--quiet", *oldest())
    fresh.run(python, "-m", "pip", "install", "--quiet", "--no-deps", str(clone))
    return python
