"""What is wrong with an archive, a bucket or a cluster is said in one sentence, and nothing half-made is taken for whole."""

from __future__ import annotations

import json
import os
import random
import re
import signal
import sys
from functools import partial
from pathlib import Path

import dask
import psutil
import pytest
from distributed import Client
from distributed.security import Security

from gcs_mosaic.archive.adjustment import on_workers
from gcs_mosaic.archive.arrivals import bytes_of_file
from gcs_mosaic.archive.artefacts import Artefacts, Lost
from gcs_mosaic.archive.cluster import _interrupts_held, check_versions, workers_at
from gcs_mosaic.archive.features import frame_at
from gcs_mosaic.archive.files import BucketFiles, FolderFiles
from gcs_mosaic.archive.sources import sources_of
from gcs_mosaic.archive.target import MARKER, checked_target, refuse_source_in_target
from gcs_mosaic.archive.tasks import Passing
from gcs_mosaic.cli import main as cli
from gcs_mosaic.errors import FlightFailed, UsageError
from gcs_mosaic.store.disk import CannotWrite
from gcs_mosaic.store.records import FrameState
from tests.archive.archives import bucket_server
from tests.frames.image_files import encoded
from tests.ports import free_port
from tests.running import frames_of

pytestmark = pytest.mark.filterwarnings("default")
PARTS = {"summary": [1, 2], "large": bytes(random.Random(1).randbytes(100_000)), "dull": b"x" * 100_000}


@pytest.fixture
def artefacts(tmp_path: Path) -> Artefacts:
    return Artefacts(FolderFiles(tmp_path))


def test_an_artefact_comes_back_part_by_part(artefacts: Artefacts) -> None:
    artefacts.put("a/b", PARTS)
    assert {name: artefacts.part("a/b", name) for name in PARTS} == PARTS
    assert artefacts.whole("a/b", "summary") == PARTS["summary"]
    assert 100_000 < (artefacts.files.size("a/b") or 0) < 110_000


@pytest.mark.parametrize("length", [0, 10, 60, 150, 5000, -1])
def test_what_was_cut_off_is_lost(artefacts: Artefacts, tmp_path: Path, length: int) -> None:
    artefacts.put("a/b", PARTS)
    path = tmp_path / "a/b"
    path.write_bytes(path.read_bytes()[:length])
    with pytest.raises(Lost):
        artefacts.whole("a/b", "summary")
    with pytest.raises(Lost):
        artefacts.part("a/b", "dull" if length < 0 else "large")


def test_what_has_changed_on_the_disk_is_lost(artefacts: Artefacts, tmp_path: Path) -> None:
    artefacts.put("a/b", PARTS)
    data = bytearray((tmp_path / "a/b").read_bytes())
    data[50_000] ^= 1
    (tmp_path / "a/b").write_bytes(data)
    assert artefacts.whole("a/b", "summary") == PARTS["summary"]
    with pytest.raises(Lost):
        artefacts.part("a/b", "large")


def test_another_artefact_in_its_place_is_lost(artefacts: Artefacts, tmp_path: Path) -> None:
    artefacts.put("a/b", PARTS)
    artefacts.put("a/c", {**PARTS, "summary": [3, 4]})
    (tmp_path / "a/c").replace(tmp_path / "a/b")
    with pytest.raises(Lost):
        artefacts.whole("a/b", "summary")


def test_a_pipe_that_was_given_is_told_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.jpg")
    (file,) = sources_of([str(tmp_path / "pipe.jpg")]).files
    with pytest.raises(Passing, match=r"^cannot be read \(not a regular file\)$"):
        bytes_of_file(file)


def test_a_frame_that_is_gone_is_told_by_its_name(tmp_path: Path) -> None:
    (tmp_path / "a.jpg").write_bytes(b"any")
    (file,) = sources_of([str(tmp_path)]).files
    (tmp_path / "a.jpg").unlink()
    with pytest.raises(Passing, match=r"^a.jpg cannot be read \(No such file or directory\)$"):
        frame_at(file, "digest")


def test_what_an_unfinished_map_holds_is_no_frame(tmp_path: Path) -> None:
    left = tmp_path / "map/archive/packing-1/made/tiles/0/1/0"
    left.mkdir(parents=True)
    for path in (tmp_path / "frame.jpg", left / "0.jpg", tmp_path / "map/.gcs-mosaic.lock"):
        path.write_bytes(b"any")
    assert [file.name for file in sources_of([str(tmp_path)]).files] == ["frame.jpg"]


def test_what_a_map_in_a_bucket_holds_is_no_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    with bucket_server(monkeypatch, "there"):
        files = BucketFiles("s3://there/dcim")
        for number, ours in enumerate(("flight.sqlite", ".gcs-mosaic.lock", MARKER)):
            for name in (ours, "tiles/0/1/0/0.jpg"):
                files.write(f"map{number}/{name}", b"any")
        for name in ("1.jpg", "more/2.jpg", "more/._2.jpg"):
            files.write(name, b"any")
        assert [file.name for file in sources_of(["s3://there/dcim"]).files] == ["1.jpg", "more/2.jpg"]


@pytest.mark.parametrize(
    ("source", "out", "said"),
    [
        ("", "", "is the folder of frames itself: choose another one, such as .*/map"),
        ("map/frames", "map", "holds .*map/frames, which the map would take the place of"),
        ("map/frames/1.jpg", "map", "holds .*map/frames/1.jpg, which the map would take the place of"),
        ("s3://one/dcim/", "s3://one/dcim", "is the folder of frames itself"),
        ("s3://one/map/frames", "s3://one/map", "holds s3://one/map/frames, which"),
    ],
)
def test_a_source_that_the_map_would_replace_is_refused(tmp_path: Path, source: str, out: str, said: str) -> None:
    source, out = (place if "://" in place else str(tmp_path / place) for place in (source, out))
    with pytest.raises(UsageError, match=f"^--out {re.escape(out)} {said}"):
        refuse_source_in_target([source], out)
    refuse_source_in_target([source, str(tmp_path / "dcim")], f"{out}/other/map")


def test_an_artefact_names_no_code(artefacts: Artefacts) -> None:
    class Bomb:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return print, ("gone off",)

    artefacts.put("a/b", {"summary": Bomb()})
    with pytest.raises(Lost):
        artefacts.part("a/b", "summary")


@pytest.mark.long
def test_a_bucket_keeps_artefacts_as_a_folder_does(monkeypatch: pytest.MonkeyPatch) -> None:
    with bucket_server(monkeypatch, "there"):
        files = BucketFiles("s3://there/part")
        artefacts = Artefacts(files)
        artefacts.put("a/b", PARTS)
        assert artefacts.part("a/b", "large") == PARTS["large"]
        assert artefacts.whole("a/b", "summary") == PARTS["summary"]
        assert [one.name for one in files.listed("a")] == ["a/b"]
        assert (files.read("a/b", 10**6, 5), files.read("a/c"), files.size("a/c")) == (b"", None, None)
        files.write("a/b", (files.read("a/b") or b"")[:200])
        with pytest.raises(Lost):
            artefacts.whole("a/b", "summary")
        files.remove("a/b")
        files.remove("a/b")
        with pytest.raises(CannotWrite, match="there is no such bucket"):
            BucketFiles("s3://nowhere").write("a", b"")
        with pytest.raises(UsageError, match="--out s3://nowhere/map: there is no such bucket"):
            checked_target("s3://nowhere/map").__enter__()
        with pytest.raises(UsageError, match="s3://there/empty holds no images"):
            sources_of(["s3://there/empty"])
        monkeypatch.delenv("AWS_ACCESS_KEY_ID")
        monkeypatch.delenv("AWS_SECRET_ACCESS_KEY")
        with pytest.raises(CannotWrite, match="credentials are missing"):
            BucketFiles("s3://there").write("a", b"")


def test_a_bucket_out_of_reach_is_told_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_REGION"):
        monkeypatch.setenv(name, "some")
    monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{free_port()}")
    monkeypatch.setenv("AWS_ALLOW_HTTP", "true")
    with pytest.raises(CannotWrite, match="s3://there: it cannot be reached") as error:
        BucketFiles("s3://there").write("a", b"")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("place", "said"),
    [
        (
            "az://there",
            r"credentials are missing; .*, such as AZURE_STORAGE_ACCOUNT_NAME and AZURE_STORAGE_ACCOUNT_KEY",
        ),
        ("az://", r"this names no bucket; give it as s3://BUCKET/PREFIX or az://CONTAINER/PREFIX"),
        ("az://a@b/c", r"this names no bucket; give it as s3://BUCKET/PREFIX or az://CONTAINER/PREFIX"),
    ],
)
def test_a_bucket_of_azure_that_cannot_be_opened_is_told(
    monkeypatch: pytest.MonkeyPatch, place: str, said: str
) -> None:
    for name in [name for name in os.environ if name.startswith("AZURE_")]:
        monkeypatch.delenv(name)
    with pytest.raises(CannotWrite, match=f"^{place}: {said}$"):
        BucketFiles(place)


@pytest.mark.long
@pytest.mark.usefixtures("soon_given_up")
def test_an_address_without_a_scheduler_is_told() -> None:
    with pytest.raises(UsageError, match=r"--cluster tcp://127.0.0.1:\d+: no scheduler answers there"):
        workers_at(f"tcp://127.0.0.1:{free_port()}").__enter__()


@pytest.mark.long
@pytest.mark.parametrize(
    ("address", "said"),
    [
        ("tls://127.0.0.1:1", r"its keys are missing; name them in Dask's own settings"),
        ("tcp://127.0.0.1:99999", "no scheduler answers there"),
        ("tcp://127.0.0.1:word", "give an address such as tcp://HOST:8786"),
        ("nonsense://here:1", "give an address such as tcp://HOST:8786"),
        ("tcp://no.such.host.invalid:8786", "no scheduler answers there"),
    ],
)
@pytest.mark.usefixtures("soon_given_up")
def test_an_address_that_is_none_is_told(address: str, said: str) -> None:
    with pytest.raises(UsageError, match=f"^--cluster {re.escape(address)}: .*{said}"):
        workers_at(address).__enter__()


@pytest.mark.long
def test_workers_that_cannot_be_started_are_told_in_one_sentence() -> None:
    with (
        dask.config.set({"distributed.worker.preload": ["no_such_module"]}),
        pytest.raises(FlightFailed, match=r"^1 workers cannot be started here \(.*\): try fewer by --workers"),
    ):
        workers_at(None, 1).__enter__()


@pytest.mark.long
@pytest.mark.parametrize(
    ("stranger", "said"),
    [
        ("older", r"the worker tls://\S+ has numpy 1\.0 \(here [\d.]+\); install the same there"),
        ("without the program", r"the worker tls://\S+ lacks this program .*; install gcs-mosaic\[cluster\] there"),
    ],
)
def test_a_worker_that_is_not_as_the_client_is_told(monkeypatch: pytest.MonkeyPatch, stranger: str, said: str) -> None:
    monkeypatch.setenv("STRANGER", stranger)
    preload = {"distributed.worker.preload": ["tests.archive.stranger"]}
    with dask.config.set(preload), workers_at(None, 1) as client, pytest.raises(UsageError, match=said):
        check_versions(client, "tcp://c")


@pytest.mark.long
@pytest.mark.usefixtures("soon_given_up")
def test_a_local_cluster_hears_this_machine_only_and_believes_its_own_client_alone() -> None:
    with workers_at(None, 1) as client:
        address = client.scheduler.address
        assert address.startswith("tls://127.0.0.1:")
        strangers = [(address.replace("tls", "tcp"), None), (address, None), (address, Security.temporary())]
        for place, security in strangers:
            with pytest.raises((OSError, TypeError)), Client(place, timeout=1, security=security):
                pass
        processes = [psutil.Process(), *psutil.Process().children(recursive=True)]
        listening = {one.laddr.ip for of in processes for one in of.net_connections() if one.status == "LISTEN"}
        assert listening == {"127.0.0.1"}


@pytest.mark.long
def test_a_task_gives_parts_of_its_work_to_other_workers() -> None:
    with workers_at(None, 1) as client:  # which does them itself, while the task waits
        assert client.submit(on_workers, abs, [-1, 2, -3]).result() == [1, 2, 3]
        assert client.submit(on_workers, abs, []).result() == []
        with pytest.raises(ZeroDivisionError):
            client.submit(on_workers, partial(divmod, 1), [1, 0]).result()


def test_a_folder_that_holds_a_flight_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "mosaic.json").write_text("{}")
    with pytest.raises(UsageError, match="holds an earlier flight"):
        checked_target(str(tmp_path)).__enter__()
    assert [path.name for path in tmp_path.iterdir()] == ["mosaic.json"]


def test_one_writer_at_a_time(tmp_path: Path) -> None:
    with checked_target(str(tmp_path)), pytest.raises(UsageError, match="is being written by another gcs-mosaic"):
        checked_target(str(tmp_path)).__enter__()


def test_without_the_extra_the_command_says_what_it_needs(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr("gcs_mosaic.cli.extras.CLUSTER", ("dask", "no_such_package"))
    assert cli.main(["reprocess", str(tmp_path), "--out", str(tmp_path / "map")]) == 2
    said = capsys.readouterr().err
    assert re.fullmatch(
        r"gcs-mosaic: reprocess needs the packages? no_such_package: pip install 'gcs-mosaic\[cluster\]'\n", said
    )
    assert not (tmp_path / "map").exists()


def test_without_bokeh_the_dashboard_says_what_it_needs(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr("gcs_mosaic.archive.cluster.find_spec", lambda name: None)
    (tmp_path / "a.jpg").write_bytes(encoded(".jpg"))
    assert cli.main(["reprocess", str(tmp_path / "a.jpg"), "--out", str(tmp_path / "map"), "--dashboard"]) == 2
    assert capsys.readouterr().err == "gcs-mosaic: --dashboard needs the package bokeh: pip install bokeh\n"
    assert [path.name for path in tmp_path.iterdir()] == ["a.jpg"]


@pytest.mark.long
def test_an_archive_without_a_whole_picture_ends_with_that_and_each_stage_is_a_line_of_json(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "frames").mkdir()
    (tmp_path / "frames" / "cut.jpg").write_bytes(b"\xff\xd8\xff\xe0 no more of it")
    out = tmp_path / "map"
    assert cli.main(["reprocess", str(tmp_path / "frames"), "--out", str(out), "--workers", "1", "--json"]) == 3
    said = capsys.readouterr()
    assert said.err == f"gcs-mosaic: none of 1 frames found a place: there is no map, {out} has the reasons\n"
    told = [json.loads(line) for line in said.out.splitlines()]
    assert {"stage": "arrivals", "done": 1, "of": 1, "state": "done"}.items() <= told[1].items()
    assert [line["said"] for line in told[-3:]][:2] == [f"0 of 1 frames placed, 0 covered: {out}", "  1 damaged"]
    assert [frame.state for frame in frames_of(out).values()] == [FrameState.DAMAGED]


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a file's name is Unicode, and no other bytes can be")
def test_a_map_of_a_name_that_is_no_text_is_written_and_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "cut.jpg").write_bytes(b"\xff\xd8\xff\xe0 no more of it")
    out = tmp_path / os.fsdecode(b"map\xff")
    assert cli.main(["reprocess", str(tmp_path / "cut.jpg"), "--out", str(out), "--workers", "1"]) == 3
    assert f"0 of 1 frames placed, 0 covered: {tmp_path}/map\\xff\n" in capsys.readouterr().out
    assert (out / "mosaic.json").is_file()


def test_an_interrupt_while_workers_start_waits_for_them() -> None:
    with _interrupts_held() as release:
        signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            release()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_the_second_interrupt_while_workers_start_does_not_wait() -> None:
    with _interrupts_held() as release:
        signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            release()


@pytest.mark.long
@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="Windows has no signal masks")
def test_workers_leave_interrupts_to_the_client() -> None:
    with workers_at(None, 1) as client:
        (blocked,) = client.run(lambda: signal.pthread_sigmask(signal.SIG_BLOCK, set())).values()
    assert signal.SIGINT in blocked
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, set())
