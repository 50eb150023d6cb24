"""The oldest versions that pyproject.toml allows will do.

The environment of these tests holds the newest ones; here one is made that holds the oldest, with the project installed
as a package and not found by its folder, and a few tests of each room that uses those libraries are run in it.
"""

import re
import sys
import tomllib
from pathlib import Path

import pytest

from gcs_mosaic.archive.files import BucketFiles
from tests import fresh
from tests.archive.archives import bucket_server, flight_in, tiles_of
from tests.sure import sure

PROJECT = tomllib.loads((fresh.ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
NEEDED_TO_TEST = ("pytest", "pytest-timeout", "hypothesis", "av", "jsonschema")
# A smoke set: each library where it is used.
TESTS = (
    *("test_config.py", "app/pipeline/test_pipeline.py"),
    *(
        "frames/test_decode.py",
        "frames/test_integrity.py",
        *("frames/test_jpeg.py", "frames/test_png.py", "frames/test_tiff.py"),
        "frames/test_exif.py",
        "frames/rtsp/test_stream_address.py",
        "frames/video/test_video_extraction.py",
    ),
    *(
        "mavlink/test_mavlink_parser.py",
        "mavlink/test_signing.py",
        "mavlink/test_mavlink_messages.py",
        "mavlink/test_flight_logs.py",
    ),
    *(
        "stitch/features/test_extraction.py",
        "stitch/features/test_matching.py",
        "stitch/registration",
        "stitch/bundle/test_levenberg_marquardt.py",
    ),
    *("render/test_warp.py", "export/test_multiband_tiff.py"),
    *("store/test_ledger.py", "web/test_app.py", "web/test_feed.py"),
)
FEW = 4  # frames of an archive
pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(sys.version_info >= (3, 12), reason="the oldest libraries are for the oldest Python"),
]


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("clone")
    fresh.need_packages(folder)
    return fresh.clone(folder / "clone")


@pytest.fixture(scope="module")
def python(clone: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    """That of an environment with the oldest versions."""
    python = str(tmp_path_factory.mktemp("environment") / "oldest" / "bin" / "python")
    fresh.run(sys.executable, "-m", "venv", str(Path(python).parents[1]))
    fresh.run(python, "-m", "pip", "install", "--quiet", *oldest())
    fresh.run(python, "-m", "pip", "install", "--quiet", "--no-deps", str(clone))
    return python


def oldest() -> list[str]:
    """Every dependency, a cluster's too, and what the tests need themselves, at the lower end of its range."""
    extras = PROJECT["optional-dependencies"]
    wanted = [*PROJECT["dependencies"], *extras["cluster"]]
    wanted += [one for one in extras["dev"] if sure(re.match(r"[\w-]+", one))[0] in NEEDED_TO_TEST]
    return [re.sub(r"^([\w-]+)>=([\w.]+),.*$", r"\1==\2", one) for one in wanted]


def test_every_range_has_both_ends() -> None:
    assert all(re.fullmatch(r"[\w-]+==[\d.]+", one) for one in oldest())


def test_the_newest_cluster_that_is_tested_is_of_the_same_range() -> None:
    extras = PROJECT["optional-dependencies"]
    assert set(extras["cluster"]) <= set(extras["dev"])


@pytest.mark.thorough
@pytest.mark.timeout(900)
def test_the_oldest_versions_do(python: str, clone: Path, tmp_path: Path) -> None:
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


@pytest.mark.thorough
@pytest.mark.timeout(900)
def test_an_archive_becomes_a_map_with_the_oldest_cluster_in_a_folder_and_in_a_bucket(
    python: str, world_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The server of the bucket is of the environment of these tests."""
    frames, out = flight_in(tmp_path / "frames", world_cache), tmp_path / "map"
    for path in sorted(frames.iterdir())[FEW:]:
        path.unlink()
    reprocess = (python, "-P", "-m", "gcs_mosaic", "reprocess", str(frames), "--workers", "1", "--out")
    fresh.run(*reprocess, str(out), cwd=tmp_path)
    with bucket_server(monkeypatch, "maps"):
        fresh.run(*reprocess, "s3://maps/one", cwd=tmp_path)
        files = BucketFiles("s3://maps/one")
        names = [one.name for folder in ("tiles/", "masks/") for one in files.listed(folder)]
        made = {name: files.read(name) for name in names}
    assert made == tiles_of(out) != {}
