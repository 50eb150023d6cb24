"""What is released: the same bytes each time, with every licence and a version; a bill of materials; a Debian package."""

from __future__ import annotations

import io
import json
import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from collections.abc import Iterator
from email import message_from_bytes
from pathlib import Path

import pytest
import yaml

from tests import fresh

DATE = "1700000000"
INSIDE = (
    "set -e; dpkg -i /srv/gcs-mosaic.deb; cd /srv; gcs-mosaic --version; gcs-mosaic config > config.yaml; "
    "{fly}; dpkg --purge gcs-mosaic"
)
FLY = "gcs-mosaic demo --count 4 --size 640x480 --speed 8 --no-http"
NEWEST = (14, 13, 12)


def built(clone: Path, out: Path, **more: str) -> dict[str, bytes]:
    """Wheel and source archive of a clone, by name."""
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(out), str(clone)]
    environment = fresh.environment(SOURCE_DATE_EPOCH=DATE, **more)
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    return {path.name: path.read_bytes() for path in out.iterdir()}


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("hatch_vcs")
    pytest.importorskip("build")
    return fresh.clone(tmp_path_factory.mktemp("clone") / "clone")


@pytest.fixture(scope="module")
def tagged(clone: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clone of what is committed, as it is released."""
    tagged = tmp_path_factory.mktemp("tagged") / "clone"
    fresh.run("git", "clone", "--quiet", str(clone), str(tagged))
    fresh.run("git", "-c", "user.name=a", "-c", "user.email=a@b", "tag", "-a", "-m", "", "v7.8.9", cwd=tagged)
    return tagged


@pytest.fixture(scope="module")
def release(tagged: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    return built(tagged, tmp_path_factory.mktemp("release"))


@pytest.mark.long
@pytest.mark.thorough
def test_two_builds_are_the_same_bytes(tagged: Path, release: dict[str, bytes], tmp_path: Path) -> None:
    other = tmp_path / "other"
    shutil.copytree(tagged, other, symlinks=True)
    for path in other.rglob("*.py"):
        os.utime(path, (1, 1))
    assert {Path(name).suffix for name in release} == {".whl", ".gz"}
    assert built(other, tmp_path / "again", TZ="Asia/Tokyo") == release


@pytest.mark.long
def test_what_is_built_tells_its_version_and_brings_every_licence(release: dict[str, bytes]) -> None:
    assert release.keys() == {"gcs_mosaic-7.8.9-py3-none-any.whl", "gcs_mosaic-7.8.9.tar.gz"}
    wheel = zipfile.ZipFile(io.BytesIO(release["gcs_mosaic-7.8.9-py3-none-any.whl"]))
    told = message_from_bytes(wheel.read("gcs_mosaic-7.8.9.dist-info/METADATA"))
    assert told["License-Expression"] == "Apache-2.0 AND BSD-2-Clause"
    vendored = [name for name in wheel.namelist() if name.startswith("gcs_mosaic/web/viewer/vendor/")]
    brought = {name.split("vendor/")[1].split("/")[0] for name in vendored}
    licensed = {name for name in told.get_all("License-File", []) if "/vendor/" in name}
    assert licensed == {f"gcs_mosaic/web/viewer/vendor/{name}/LICENSE" for name in brought}
    assert all(f"gcs_mosaic-7.8.9.dist-info/licenses/{name}" in wheel.namelist() for name in licensed)


@pytest.mark.thorough
@pytest.mark.long
def test_a_tree_without_git_or_tags_is_built_all_the_same(clone: Path, tmp_path: Path) -> None:
    plain = tmp_path / "plain"
    shutil.copytree(clone, plain, ignore=shutil.ignore_patterns(".git"))
    assert "gcs_mosaic-0.1.dev0-py3-none-any.whl" in built(plain, tmp_path / "out")
    with tarfile.open(tmp_path / "out" / "gcs_mosaic-0.1.dev0.tar.gz") as source:
        source.extractall(tmp_path / "source", filter="data")
    (unpacked,) = (tmp_path / "source").iterdir()
    assert "gcs_mosaic-0.1.dev0-py3-none-any.whl" in built(unpacked, tmp_path / "again"), "as PKG-INFO says"
    fresh.run("git", "init", "--quiet", cwd=plain)
    fresh.run("git", "-c", "user.name=a", "-c", "user.email=a@b", "commit", "--allow-empty", "-qm", "a", cwd=plain)
    assert any(name.startswith("gcs_mosaic-0.1.dev1+g") for name in built(plain, tmp_path / "untagged"))


@pytest.mark.long
def test_the_bill_of_materials_names_all_that_is_needed(tmp_path: Path) -> None:
    bill_of = [sys.executable, str(fresh.ROOT / ".ci" / "sbom.py")]
    environment = os.environ | {"SOURCE_DATE_EPOCH": DATE, "PYTHONPATH": str(fresh.ROOT)}
    for name in ("one.json", "two.json"):
        subprocess.run([*bill_of, str(tmp_path / name)], env=environment, check=True, timeout=60)
    assert (tmp_path / "one.json").read_bytes() == (tmp_path / "two.json").read_bytes()
    bill = json.loads((tmp_path / "one.json").read_text())
    parts = {one["name"]: one for one in bill["components"]}
    assert {"numpy", "pymavlink", "multidict", "leaflet"} <= parts.keys(), "and what those need in turn"
    assert "pytest" not in parts
    assert parts["leaflet"]["licenses"] == [{"expression": "BSD-2-Clause"}]
    assert bill["metadata"]["timestamp"] == "2023-11-14T22:13:20+00:00"
    refs = {one["bom-ref"] for one in [*bill["components"], bill["metadata"]["component"]]}
    assert {one["ref"] for one in bill["dependencies"]} == refs
    assert all(set(one["dependsOn"]) <= refs for one in bill["dependencies"])


def test_every_version_of_the_changelog_has_a_date() -> None:
    headings = [
        line[3:] for line in (fresh.ROOT / ".github/CHANGELOG.md").read_text().splitlines() if line.startswith("## ")
    ]
    assert headings[0] == "Unreleased"
    assert all(one.partition(" (")[2].rstrip(")").replace("-", "").isdecimal() for one in headings[1:])
    assert len(headings) > 1


def test_the_container_is_made_as_containers_should_be() -> None:
    """What hadolint would say first, as far as it applies: a pinned base, no cache in a layer, words as a list."""
    lines = _instructions((fresh.ROOT / "config" / "Containerfile").read_text())
    assert {word for word, _ in lines} <= {"FROM", "ARG", "COPY", "RUN", "ENV", "WORKDIR", "ENTRYPOINT"}
    bases = [rest.split()[0] for word, rest in lines if word == "FROM"]
    assert all(":" in base and not base.endswith(":latest") for base in bases)
    assert len({base.partition("@")[0] for base in bases}) == 1, "what is built with one Python runs with it"
    assert all("--no-cache-dir" in rest for word, rest in lines if word == "RUN" and "pip " in rest)
    assert all(yaml.safe_load(rest) for word, rest in lines if word == "ENTRYPOINT")
    assert all(rest.startswith("/") for word, rest in lines if word == "WORKDIR")
    ignored = (fresh.ROOT / "config" / "Containerfile.dockerignore").read_text().split()
    copied = [rest.split()[0] for word, rest in lines if word == "COPY" and "--from" not in rest]
    assert all((fresh.ROOT / one).exists() and one not in ignored for one in copied)
    needed = ("gcs_mosaic", "sitl", "config", "pyproject.toml", "LICENSE", "README.md")
    assert not set(ignored) & set(needed)


def _instructions(text: str) -> list[tuple[str, str]]:
    joined = text.replace("\\\n", " ").splitlines()
    found = [line.strip().partition(" ") for line in joined if line.strip() and not line.startswith("#")]
    return [(word, rest.strip()) for word, _, rest in found]


@pytest.fixture(scope="module")
def clean_system(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The root of a Debian as this one, with nothing but Python in it."""
    missing = [name for name in ("debootstrap", "dpkg-deb", "chroot") if shutil.which(name) is None]
    if missing or not hasattr(os, "geteuid") or os.geteuid() != 0:
        pytest.skip(f"a clean Debian needs root and {', '.join(missing) or 'root'}")
    if not Path("/usr/bin/python3").exists():
        pytest.skip("Debian's own Python is missing, for which the package would be")
    told = dict(line.split("=", 1) for line in Path("/etc/os-release").read_text().splitlines() if "=" in line)
    root = tmp_path_factory.mktemp("debian") / "root"
    make = ["debootstrap", "--variant=minbase", "--include=python3", told["VERSION_CODENAME"].strip('"'), str(root)]
    done = subprocess.run(make, capture_output=True, text=True, timeout=900)
    if done.returncode:
        pytest.skip(f"debootstrap makes no Debian here: {done.stdout.splitlines()[-1:]}")
    subprocess.run(["mount", "-t", "proc", "proc", root / "proc"], check=True)
    subprocess.run(["mount", "-t", "tmpfs", "tmpfs", root / "dev" / "shm"], check=True)
    yield root
    subprocess.run(["umount", root / "dev" / "shm", root / "proc"], check=True)


@pytest.mark.long
@pytest.mark.thorough
@pytest.mark.timeout(3600)
def test_the_debian_package_is_installed_flies_and_leaves_nothing(
    clean_system: Path, clone: Path, tmp_path: Path
) -> None:
    fresh.need_packages(tmp_path)
    environment = fresh.environment(TOOLS=sys.executable)
    subprocess.run([clone / ".ci" / "deb", tmp_path], env=environment, check=True, timeout=1800)
    (package,) = tmp_path.glob("*.deb")
    listed = fresh.run("dpkg-deb", "--contents", str(package))
    for path in (
        "/usr/bin/gcs-mosaic",
        "/usr/lib/systemd/user/gcs-mosaic.service",
        "/usr/share/doc/gcs-mosaic/copyright",
    ):
        assert f" .{path}" in listed
    shutil.copy(package, clean_system / "srv" / "gcs-mosaic.deb")
    said = fresh.run("chroot", str(clean_system), "sh", "-c", INSIDE.format(fly=FLY), minutes=20)
    assert "placed 4/4" in said
    assert not (clean_system / "opt" / "gcs-mosaic").exists()
    assert not (clean_system / "usr" / "bin" / "gcs-mosaic").exists()


@pytest.mark.long
@pytest.mark.thorough
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("minor", [11, *NEWEST])
def test_the_wheel_flies_under_each_python_that_is_at_hand(minor: int, clone: Path, tmp_path: Path) -> None:
    python = shutil.which(f"python3.{minor}")
    works = python and subprocess.run([python, "-c", "import ensurepip, ssl"], capture_output=True).returncode == 0
    if not python or not works:
        pytest.skip(f"no Python 3.{minor} is here")
    fresh.need_packages(tmp_path)
    fresh.run(python, "-m", "venv", str(tmp_path / "venv"))
    built(clone, tmp_path / "out")
    (wheel,) = (tmp_path / "out").glob("*.whl")
    fresh.run(str(tmp_path / "venv" / "bin" / "pip"), "install", "--quiet", str(wheel), minutes=15)
    said = fresh.run(str(tmp_path / "venv" / "bin" / FLY.split()[0]), *FLY.split()[1:], cwd=tmp_path, minutes=10)
    assert "placed 4/4" in said
