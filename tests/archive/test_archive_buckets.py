"""What buckets may answer: each trouble is told in one sentence, and nothing half-written is taken for whole."""

from __future__ import annotations

import json
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread

import pytest

from gcs_mosaic.archive.artefacts import Artefacts
from gcs_mosaic.archive.cluster import workers_at
from gcs_mosaic.archive.engine import Engine
from gcs_mosaic.archive.files import BucketFiles
from gcs_mosaic.archive.packing import upload
from gcs_mosaic.archive.sources import sources_of
from gcs_mosaic.archive.target import MARKER, checked_target
from gcs_mosaic.archive.tasks import Made, Parts, task
from gcs_mosaic.errors import FlightFailed, UsageError
from gcs_mosaic.store.disk import CannotWrite
from gcs_mosaic.store.folder import LEDGER_NAME
from tests.archive.archives import Heard, bucket_server
from tests.archive.proxy import DENIED, NO_KEY, SLOW_DOWN, Answer, troubled

pytestmark = pytest.mark.filterwarnings("default")


@pytest.fixture(scope="module")
def server() -> Iterator[str]:
    with pytest.MonkeyPatch.context() as patch, bucket_server(patch, "there") as address:
        yield address


def names(prefix: str) -> set[str]:
    return {one.name for one in BucketFiles(f"s3://there/{prefix}").listed("")}


@pytest.mark.long
def test_a_listing_tells_sizes_and_what_has_changed_at_one_go(server: str) -> None:
    files = BucketFiles("s3://there/listed")
    for number in range(5):
        files.write(f"{number}.jpg", b"x" * number)
    with troubled(server) as asked:
        before = sources_of(["s3://there/listed"]).files
        assert len(asked) == 1
        files.write("3.jpg", b"yyy")
        after = sources_of(["s3://there/listed"]).files
    assert [(one.name, one.size) for one in before] == [(f"{number}.jpg", number) for number in range(5)]
    assert all(one.modified_ns > 0 for one in before)
    assert [one.tag == other.tag for one, other in zip(before, after, strict=True)] == [True, True, True, False, True]


@pytest.mark.long
def test_credentials_that_may_not_write_are_told_before_anything_is_begun(server: str) -> None:
    def read_only(method: str, path: str) -> Answer | None:
        return DENIED if method in ("PUT", "POST", "DELETE") else None

    with troubled(server, read_only), pytest.raises(UsageError) as error:
        checked_target("s3://there/read-only").__enter__()
    assert str(error.value) == (
        "--out s3://there/read-only: these credentials may not read or write there; ask for the right to, "
        "or name another bucket"
    )
    assert names("read-only") == set()


@pytest.mark.parametrize("told", ["InvalidAccessKeyId", "SignatureDoesNotMatch"])
def test_wrong_credentials_are_told(server: str, told: str) -> None:
    with (
        troubled(server, lambda method, path: (403, told)),
        pytest.raises(CannotWrite, match=r"^s3://there/frames: these credentials may not read or write there"),
    ):
        sources_of(["s3://there/frames"])


def test_a_bucket_that_wants_to_be_asked_slower_is_asked_again(server: str) -> None:
    answers: list[Answer | None] = [SLOW_DOWN, None]
    with troubled(server, lambda method, path: answers.pop(0)) as asked:
        BucketFiles("s3://there").write("slow/a", b"whole")
    assert asked == ["PUT /there/slow/a"] * 2
    assert BucketFiles("s3://there").read("slow/a") == b"whole"


def test_a_bucket_that_never_has_time_is_told(server: str) -> None:
    with (
        troubled(server, lambda method, path: SLOW_DOWN) as asked,
        pytest.raises(CannotWrite, match=r"^s3://there: it has too much to do; give the command again later$"),
    ):
        BucketFiles("s3://there").write("slow/b", b"whole")
    assert len(asked) == 4


def made(folder: Path, *more: str) -> Path:
    """A flight's folder, as far as it matters here."""
    for name in (LEDGER_NAME, "mosaic.json", "frames/a.jpg", *more):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(name.encode())
    return folder


@pytest.mark.long
def test_an_upload_that_breaks_off_leaves_no_map(server: str, tmp_path: Path) -> None:
    upload(made(tmp_path), "s3://there/broken")
    with (
        troubled(server, lambda method, path: DENIED if path.endswith("a.jpg") else None),
        pytest.raises(CannotWrite, match=r"^s3://there/broken: these credentials may not"),
    ):
        upload(tmp_path, "s3://there/broken")
    assert not names("broken") & {LEDGER_NAME, "mosaic.json"}


def test_a_map_that_is_made_again_leaves_nothing_of_the_earlier_one(server: str, tmp_path: Path) -> None:
    upload(made(tmp_path / "one", "tiles/0/16/1/1.jpg", "masks/0/16/1/1.png", f"{LEDGER_NAME}-wal"), "s3://there/again")
    for name in ("notes.sqlite", "archive/features/aa/bb", "tiles.txt"):
        BucketFiles("s3://there/again").write(name, b"theirs")
    upload(made(tmp_path / "two", "tiles/0/16/2/2.jpg"), "s3://there/again")
    assert names("again") == {
        *(LEDGER_NAME, "mosaic.json", "frames/a.jpg", "tiles/0/16/2/2.jpg"),
        *("notes.sqlite", "archive/features/aa/bb", "tiles.txt"),
    }


@pytest.mark.parametrize("name", ["mosaic.json", "frames/DCIM/a.jpg", "archive/1999/a.jpg"])
def test_a_bucket_that_holds_what_is_not_ours_is_left_alone(server: str, name: str) -> None:
    place = f"their-{len(name)}"
    BucketFiles(f"s3://there/{place}").write(name, b"theirs")
    with pytest.raises(UsageError, match=f"has its own {name.partition('/')[0]}, which is left as it is"):
        checked_target(f"s3://there/{place}").__enter__()
    assert names(place) == {name}


def test_a_run_that_has_made_nothing_leaves_nothing_in_a_bucket(server: str) -> None:
    with checked_target("s3://there/nothing"):
        assert names("nothing") == {MARKER}
    assert names("nothing") == set()
    with checked_target("s3://there/some"):
        BucketFiles("s3://there/some").write("archive/features/a", b"made")
        BucketFiles("s3://there/some").write("mosaic.json", b"{}")
    with checked_target("s3://there/some"):
        pass
    assert names("some") == {MARKER, "archive/features/a", "mosaic.json"}


def test_what_is_not_there_is_no_trouble_to_remove_for_google_either_but_to_write_into(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    class Google(BaseHTTPRequestHandler):
        def do_DELETE(self) -> None:
            self.send_response(404)
            self.send_header("Content-Length", "0")
            self.end_headers()

        do_PUT = do_DELETE  # noqa: N815 - names of the library

        def log_message(self, format: str, *words: object) -> None: ...

    google = ThreadingHTTPServer(("127.0.0.1", 0), Google)
    Thread(target=google.serve_forever, daemon=True).start()
    account = {"gcs_base_url": f"http://127.0.0.1:{google.server_port}", "disable_oauth": True}
    (tmp_path / "account.json").write_text(
        json.dumps(account | {"client_email": "", "private_key": "", "private_key_id": ""})
    )
    monkeypatch.setenv("GOOGLE_SERVICE_ACCOUNT", str(tmp_path / "account.json"))
    monkeypatch.setenv("GOOGLE_ALLOW_HTTP", "true")
    try:
        BucketFiles("gs://there").remove("archive/trial")
        with pytest.raises(CannotWrite, match=r"^gs://there: there is no such bucket; make it, or name another one$"):
            BucketFiles("gs://there").write("archive/trial", b"")
    finally:
        google.shutdown()
        google.server_close()


def number(artefacts: Artefacts, value: int) -> Parts:
    return {"summary": value, "value": value}


def double(artefacts: Artefacts, key: str) -> Parts:
    return {"summary": 2 * artefacts.part(key, "value")}


@pytest.mark.long
def test_what_a_store_loses_is_made_again_until_it_goes_on_losing_it(server: str) -> None:
    losing: list[Answer | None] = []

    def trouble(method: str, path: str) -> Answer | None:
        return losing.pop() if losing and method == "GET" and "/number/" in path else None

    with troubled(server, trouble), workers_at(None, 1) as client:
        engine = Engine(client, "s3://there/losing/archive", Heard())
        first = task(number, 21)
        assert engine.made("numbers", [first]) == [21]
        losing.append(NO_KEY)
        outcome = engine.run("doubles", [task(double, first.key)])
        assert isinstance(outcome[0], Made)
        assert (outcome[0].summary, losing) == (42, [])
        other = task(number, 22)
        engine.made("numbers", [other])
        losing.extend([NO_KEY] * 100)
        with pytest.raises(FlightFailed, match=f"the store s3://there/losing/archive has lost {other.key}: see that"):
            engine.made("doubles", [task(double, other.key)])
