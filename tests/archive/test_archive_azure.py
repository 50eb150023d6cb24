"""An archive in Azure Blob Storage, as Azurite serves it, which is Microsoft's own emulator: `npm install azurite`."""

from __future__ import annotations

import base64
import hashlib
import hmac
import shutil
import subprocess
from collections.abc import Iterator
from email.utils import formatdate
from pathlib import Path
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import pytest

from gcs_mosaic.archive.files import BucketFiles
from gcs_mosaic.archive.sources import sources_of
from gcs_mosaic.archive.target import checked_target
from gcs_mosaic.errors import UsageError
from gcs_mosaic.store.disk import CannotWrite
from tests.archive.archives import flight_in, run, tiles_of
from tests.ports import free_port
from tests.running import until

PROGRAM = "azurite-blob"
# Those of every Azurite, as Microsoft's own pages tell them.
ACCOUNT = "devstoreaccount1"
KEY = "Eby8vdM02xNOcqFlqUwJPLlmEtlCDXJ1OUzFT50uSRZ6IFsuFq2UVErCz4I6tq/K1SZFPTOtr/KBHBeksoGMGw=="
WRONG = base64.b64encode(b"another key").decode()

pytestmark = [
    pytest.mark.long,
    pytest.mark.thorough,
    pytest.mark.filterwarnings("default"),
    pytest.mark.skipif(shutil.which(PROGRAM) is None, reason=f"{PROGRAM} is missing: npm install --global azurite"),
]


@pytest.fixture(scope="module")
def azurite(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Its address; the containers `frames` and `maps` are there."""
    address = f"http://127.0.0.1:{(port := free_port())}"
    where = ("--blobHost", "127.0.0.1", "--blobPort", str(port), "--location", str(tmp_path_factory.mktemp("azurite")))
    server = subprocess.Popen([PROGRAM, *where, "--silent", "--disableTelemetry"], stdout=subprocess.DEVNULL)
    try:
        until(lambda: serves(address), "Azurite answers")
        for container in ("frames", "maps"):
            urlopen(with_key("PUT", address, f"{container}?restype=container"), timeout=10).close()
        yield address
    finally:
        server.terminate()
        server.wait()


@pytest.fixture(autouse=True)
def emulated(azurite: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The settings of the environment that lead to it."""
    monkeypatch.setenv("AZURE_STORAGE_USE_EMULATOR", "true")
    monkeypatch.setenv("AZURITE_BLOB_STORAGE_URL", azurite)


def serves(address: str) -> bool:
    try:
        urlopen(address, timeout=10).close()
    except HTTPError as refused:  # to a request without a key
        refused.close()
        return True
    except OSError:
        return False
    return True


def with_key(method: str, address: str, what: str) -> Request:
    """A request as Azure wants it signed (Shared Key)."""
    headers = {"x-ms-date": formatdate(usegmt=True), "x-ms-version": "2021-08-06"}
    path, _, asked = what.partition("?")
    lines = [method, *[""] * 11, *(f"{name}:{value}" for name, value in headers.items())]
    signed = "\n".join([*lines, f"/{ACCOUNT}/{ACCOUNT}/{path}", asked.replace("=", ":")]).encode()
    digest = base64.b64encode(hmac.digest(base64.b64decode(KEY), signed, hashlib.sha256)).decode()
    headers |= {"Authorization": f"SharedKey {ACCOUNT}:{digest}", "Content-Length": "0"}
    return Request(f"{address}/{ACCOUNT}/{what}", method=method, headers=headers)


def test_the_map_is_that_of_a_folder(tmp_path: Path, world_cache: Path) -> None:
    frames = flight_in(tmp_path / "frames", world_cache)
    given, made = BucketFiles("az://frames/DCIM"), BucketFiles("az://maps/one")
    for path in frames.iterdir():
        given.write(path.name, path.read_bytes())
    run(frames, out=tmp_path / "map")
    run("az://frames/DCIM", out="az://maps/one")
    names = [one.name for one in made.listed("")]
    tiles = {name: made.read(name) for name in names if name.startswith(("tiles/", "masks/"))}
    assert tiles == tiles_of(tmp_path / "map") != {}
    assert {"flight.sqlite", "mosaic.json", "placements.json"} < set(names)


def test_a_file_comes_back_whole_and_in_parts_and_goes() -> None:
    files = BucketFiles("az://maps/files")
    files.write("a/b", b"0123456789")
    assert (files.read("a/b"), files.read("a/b", 2, 3), files.read("a/b", 7)) == (b"0123456789", b"234", b"789")
    assert (files.read("a/b", 99, 5), files.read("a/c"), files.size("a/c")) == (b"", None, None)
    assert [(one.name, one.size) for one in files.listed("a")] == [("a/b", 10)]
    files.remove("a/b")
    files.remove("a/b")
    assert files.size("a/b") is None


def test_a_container_that_is_not_there_is_told() -> None:
    with pytest.raises(
        UsageError, match=r"^--out az://none/map: there is no such bucket; make it, or name another one$"
    ):
        checked_target("az://none/map").__enter__()
    with pytest.raises(CannotWrite, match=r"^az://none/DCIM: there is no such bucket; make it, or name another one$"):
        sources_of(["az://none/DCIM"])


@pytest.mark.parametrize("key", [WRONG, "no key at all!"])
def test_a_wrong_key_is_told(monkeypatch: pytest.MonkeyPatch, key: str) -> None:
    monkeypatch.setenv("AZURE_STORAGE_ACCOUNT_KEY", key)
    with pytest.raises(
        UsageError, match=r"^--out az://maps/x: these credentials may not read or write there; ask for the"
    ):
        checked_target("az://maps/x").__enter__()


def test_without_encryption_it_is_used_if_that_is_asked_for(azurite: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """As a server of one's own, not as the emulator."""
    monkeypatch.delenv("AZURE_STORAGE_USE_EMULATOR")
    monkeypatch.setenv("AZURE_STORAGE_ACCOUNT_NAME", ACCOUNT)
    monkeypatch.setenv("AZURE_STORAGE_ACCOUNT_KEY", KEY)
    monkeypatch.setenv("AZURE_STORAGE_ENDPOINT", f"{azurite}/{ACCOUNT}")
    with pytest.raises(CannotWrite, match=r"^az://maps: it cannot be reached"):
        BucketFiles("az://maps").write("plain", b"")
    monkeypatch.setenv("AZURE_ALLOW_HTTP", "true")
    BucketFiles("az://maps").write("plain", b"data")
    assert BucketFiles("az://maps").read("plain") == b"data"
