"""Words on the command line: what cannot be done is said in one sentence, and nothing is written."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import threading
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np
import pytest
from rich.console import Console

import sitl.flight
from gcs_mosaic.app.commands.batch import stitch
from gcs_mosaic.cli import choices, options
from gcs_mosaic.cli import main as cli
from gcs_mosaic.config.tree import Config
from gcs_mosaic.store.folder import LEDGER_NAME
from sitl.path import Plan
from tests.ports import free_port
from tests.running import PROGRAM, run, until
from tests.settings import FEW_FEATURES
from tests.sure import sure

Refused = Callable[..., str]


@pytest.fixture
def refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Refused:
    """Runs the program in an empty folder; it must exit with 2, say one line, and leave the folder as it was."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cli, "_end_on_signals", lambda stop, hurry: None)  # they are pytest's here

    def run_here(*words: str | Path) -> str:
        before = sorted(tmp_path.rglob("*"))
        code = cli.main([str(word) for word in words])
        said = capfd.readouterr()
        assert (code, said.out, said.err.count("\n")) == (2, "", 1), said
        assert sorted(tmp_path.rglob("*")) == before
        return said.err

    return run_here


def listening() -> tuple[str, str]:
    """The option for a port that is free."""
    return "--mavlink", f"udp:127.0.0.1:{free_port()}"


@pytest.fixture
def taken() -> Iterator[socket.socket]:
    """A UDP port that another program has."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        yield other


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory, world_cache: Path) -> Path:
    """A finished flight of three frames."""
    frames = tmp_path_factory.mktemp("given")
    route = Plan(frames=3, height=60)
    sitl.flight.make("survey", frames, (640, 480), cache=world_cache, seed=3, world_size=2048, route=route)
    return stitch([frames], tmp_path_factory.mktemp("flown") / "mosaic", FEW_FEATURES, Console(quiet=True))


@pytest.fixture
def empty(tmp_path: Path) -> Path:
    """A flight that ended before its first frame."""
    (tmp_path / "mosaic.json").write_text('{"format": 1, "islands": []}')
    return tmp_path


@pytest.mark.long
@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--mavlink", "utp:14550"], "--mavlink 'utp:14550' is not understood: give an address such as udp:14550"),
        (["--mavlink", "udp:port"], "a port from 1 to 65535"),
        (["--mavlink", "udpout:127.0.0.1:14550"], "nothing is ever sent"),
        (["--mavlink", "nothere.tlog"], "nothere.tlog"),
        (["--http", "nonsense:port:9"], "is not HOST:PORT: write, for example, --http 127.0.0.1:8470"),
        (["--http", "127.0.0.1:99999"], "is not HOST:PORT"),
        (["--http", "192.0.2.1:8470"], "192.0.2.1:8470 is not an address of this machine"),
        (["--http", "127.0.0.1:1", "--no-http"], "not allowed with"),
        (["--fly"], "unrecognized arguments: --fly (gcs-mosaic --help"),
        (["--vehicle", "one"], "invalid int value: 'one'"),
        (["--vehicle", "0"], "--vehicle: expected a MAVLink system id from 1 to 255, got 0"),
        (["--vehicle=-1"], "--vehicle: expected a MAVLink system id from 1 to 255, got -1"),
        (["--vehicle", "256", "--vehicle", "1"], "--vehicles: expected a MAVLink system id from 1 to 255, got 256"),
        (["--from", "yesterday"], "--from 'yesterday' is not understood: give now"),
        (["--config", "none.yaml"], "none.yaml cannot be read (No such file or directory)"),
        (["--watch", "mosaic/tiles"], "overlap"),
        (["--watch", ".", "--out", "mosaic"], "choose an --out outside the watched folder"),
        (["--resume"], "--resume: mosaic holds no flight to go on with: start without --resume"),
        (["config", "--fly"], "unrecognized arguments: --fly (gcs-mosaic"),
        (["--blend", "seems"], "--blend: 'seems' is not one of seam, edge, newest, first"),
        (["stitch", ".", "--blend", "egde"], "--blend: 'egde' is not one of seam, edge, newest, first"),
        (["status", "nowhere"], "nowhere does not exist: name a folder that gcs-mosaic has written a flight into"),
        (["serve", "."], ". holds no flight"),
        (["stich", "."], "'stich' is no command (did you mean 'stitch'?)"),
        (
            ["fly"],
            "'fly' is no command (those are stitch, merge, reprocess, replay, serve, status, vehicle, check, anchor, pair, "
            "export, integral, looks, benchmark, config, demo)",
        ),
        (["stitch", ".", "--fly"], "unrecognized arguments: --fly (gcs-mosaic stitch --help shows what there is)"),
        (["stitch", ".", "--out", "./"], "is the folder of the frames: choose another one"),
        (["stitch", ".", "--out", "mosaic"], "holds no images"),
        (["stitch", "nowhere", "--out", "mosaic"], "cannot be read"),
        (["export", ".", "--format", "png"], ". holds no flight"),
        (["export", ".", "--format", "jpeg"], "invalid choice: 'jpeg'"),
        (["--announce", "255"], "255 is the ground station's own number"),
        (["--vehicle", "7", "--announce", "7"], "7 is the number of the aircraft that is followed"),
        (["--recover"], "add --announce"),
        (["--watch", "1=a", "--watch", "b"], "--watch b names no aircraft, others do: name that of each"),
        (["--watch", "a", "--watch", "b"], "for several aircraft name each, as in --watch 1=a"),
        (
            ["--watch", "1=a", "--watch", "1=b"],
            "aircraft 1 was given more than one folder or stream: give each aircraft one",
        ),
        (["--watch", "1=", "--watch", "2=b"], "--watch 1= names no folder or stream"),
        (["--watch", "1=a", "--watch", "2=a/b"], "give each a folder of its own, none inside another"),
        (["--watch", "256=a"], "--watch: vehicle: expected a MAVLink system id from 1 to 255, got 256"),
        (["--vehicle", "1", "--vehicles", "all"], "--vehicles all: leave out --vehicle"),
        (["--vehicle", "1", "--vehicle", "2", "--announce", "2"], "2 is the number of an aircraft of this flight"),
        (["--mavlink", "udpout:127.0.0.1:14550"], "calls out, but nothing is ever sent"),
    ],
)
def test_misuse_is_told_in_one_sentence(refused: Refused, words: list[str], sentence: str) -> None:
    live = "--mavlink" not in words and words[0] not in cli.COMMANDS
    assert sentence in refused(*words, *(listening() if live else ()))


def test_a_stitch_without_any_map_says_so_and_ends_with_a_code_of_its_own(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    frames, out = tmp_path / "frames", tmp_path / "mosaic"
    frames.mkdir()
    (frames / "a.jpg").write_bytes(b"\xff\xd8 no picture")
    assert cli.main(["stitch", str(frames), "--out", str(out)]) == 3
    said = capfd.readouterr()
    assert said.err.endswith(f"gcs-mosaic: none of 1 frame found a place: there is no map, {out} has the reasons\n")
    assert "no island" in said.out


def test_the_version_is_told(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main(["--version"])
    assert ended.value.code == 0
    told = capfd.readouterr().out
    assert re.fullmatch(r"gcs-mosaic \d+\.\d+\S*\n", told)  # of a checkout without a tag: 0.1.dev7+gabc


def test_the_blend_on_the_command_line_overrules_the_settings_file(tmp_path: Path) -> None:
    file = tmp_path / "settings.yaml"
    file.write_text("paint: {canvas: {blend: first, threads: 1}}")
    canvas = choices.config_of(options.parse(["--config", str(file), "--blend", "newest"])).paint.canvas
    assert (canvas.blend, canvas.threads) == ("newest", 1)


def test_each_option_of_the_table_reaches_its_setting(tmp_path: Path) -> None:
    words = (
        "--watch w --every overlap --from 30m --vehicle 3 --announce --recover --record --no-http --verbose --scale 0.5"
    )
    given = options.parse([*words.replace("--scale 0.5", "").split(), "--mavlink", "udp:1", "--mavlink", "udp:2"])
    config = choices.flight_config(given, options.listening_of(given))
    assert (config.watch, config.stream.every, config.frames.from_age_s) == ("w", "overlap", 1800.0)
    assert (config.mavlink, config.link.vehicle, config.link.announce) == (("udp:1", "udp:2"), 3, options.ANNOUNCE_AS)
    assert (config.link.recover, config.record, config.http, config.log.verbose) == (True, True, None, True)
    given = options.parse(["stitch", "DIR", "--scale", "0.5", "--features", "orb", "--method", "paper"])
    config = choices.config_of(given)
    assert (config.scale, config.features, config.method) == (0.5, "orb", "paper")


@pytest.mark.parametrize("words", ["--watch 1=a --watch 2=b", "replay F.tlog --out o --frames 1=a --frames 2=b"])
def test_an_aircraft_that_is_named_beside_those_with_a_source_counts_too(words: str) -> None:
    """As the program itself says to do of one that it leaves out."""
    for more, aircraft in ((), (1, 2)), (("--vehicle", "3"), (1, 2, 3)), (("--vehicle", "2"), (1, 2)):
        given = options.parse([*words.split(), *more])
        replayed = given.command == "replay"
        config = choices.replay_config(given) if replayed else choices.flight_config(given, options.listening_of(given))
        assert config.aircraft == aircraft


def test_the_defaults_are_told_as_a_file_that_can_be_given_back(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["config"]) == 0
    (tmp_path / "c.yaml").write_text(told := capsys.readouterr().out)
    assert "# " in told
    assert choices.config_of(options.parse(["--config", str(tmp_path / "c.yaml")])) == Config()


def test_an_unknown_setting_is_told_with_the_nearest_known_one(refused: Refused, tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text("frames: {poll: 1}")
    assert "c.yaml: frames: 'poll' is not a setting (did you mean 'poll_s'?)" in refused("--config", "c.yaml")
    (tmp_path / "c.yaml").write_text("vehicle: 3")
    assert "'vehicle' is not a setting (did you mean 'link: {vehicle: ...}'?)" in refused("--config", "c.yaml")
    (tmp_path / "c.yaml").write_text("[1, 2")
    assert "c.yaml is not YAML" in refused("--config", "c.yaml")


def test_a_port_that_is_taken_names_who_has_it_and_how_to_share(refused: Refused, taken: socket.socket) -> None:
    said = refused("--mavlink", f"udp:127.0.0.1:{taken.getsockname()[1]}", "--no-http")
    assert "is taken by py" in said
    assert "Enable forwarding" in said


@pytest.mark.long
def test_a_page_that_cannot_be_served_leaves_no_folder_behind(refused: Refused) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        page = f"127.0.0.1:{other.getsockname()[1]}"
        said = refused(*listening(), "--http", page)
    assert f"another program listens on {page} already" in said
    assert "--no-http" in said


def test_folders_that_can_be_none_leave_no_other_behind(refused: Refused, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    out, watch = ("--out", "file/mosaic", "--no-http"), ("--watch", "file/frames", "--no-http")
    assert "cannot be written (Not a directory): choose another --out" in refused(*listening(), *out)
    assert "can be no folder (Not a directory)" in refused(*listening(), *watch)


def test_an_old_flight_is_not_watched(refused: Refused, tmp_path: Path) -> None:
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "flight.sqlite").write_bytes(b"")
    assert "old holds a flight" in refused(*listening(), "--watch", "old", "--out", "new")


def test_the_folder_beside_is_not_the_watched_one(refused: Refused, tmp_path: Path) -> None:
    (tmp_path / "mosaic" / "tiles").mkdir(parents=True)  # more than a start that was killed has left
    (tmp_path / "mosaic" / "flight.sqlite").write_bytes(b"")
    (tmp_path / "mosaic-2").mkdir()
    said = refused(*listening(), "--no-http", "--watch", "mosaic-2")
    assert "the output folder mosaic-2 and the watched folder mosaic-2 overlap" in said


@pytest.mark.long
def test_an_export_of_what_is_not_there_is_refused(refused: Refused, flight: Path, empty: Path) -> None:
    export = ("export", flight, "--format", "png")
    assert f"There is no island 7 in {flight}; there are: 0." in refused(*export, "--island", "7")
    assert "give a lower --zoom" in refused(*export, "--zoom", "30")
    assert "no frame was placed in this flight" in refused("export", empty, "--format", "png")


def test_an_export_to_a_place_that_cannot_be_written_is_refused(refused: Refused, flight: Path) -> None:
    for format_name in ("png", "placements"):
        assert "give another file" in refused("export", flight, "--format", format_name, "--to", "no/where")


@pytest.mark.parametrize("damage", ["", "[]", "{}", '{"islands": 3}'])
def test_a_map_that_cannot_be_read_is_refused(refused: Refused, empty: Path, damage: str) -> None:
    (empty / "mosaic.json").write_text(damage)
    assert "is not a map that this gcs-mosaic can read" in refused("export", empty, "--format", "png")


def test_a_flight_is_exported(flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["export", str(flight), "--format", "png", "--to", str(tmp_path / "p.png")]) == 0
    picture = sure(cv2.imread(str(tmp_path / "p.png"), cv2.IMREAD_UNCHANGED))
    assert picture.shape[2] == 4
    assert min(picture.shape[:2]) > 480
    assert cli.main(["export", str(flight), "--format", "placements", "--to", str(tmp_path / "p.json")]) == 0
    assert len(json.loads((tmp_path / "p.json").read_text())["frames"]) == 3
    assert "3 placements written" in capsys.readouterr().out


@pytest.mark.long
def test_help_and_misuse_of_the_installed_program(tmp_path: Path) -> None:
    for words in (["--help"], ["stitch", "--help"], ["demo", "--help"]):
        helped = run(*words, cwd=tmp_path)
        assert (helped.returncode, helped.stderr) == (0, "")
        assert "--out" in helped.stdout
    assert run("--fly", cwd=tmp_path).returncode == 2


@pytest.mark.long
def test_who_reads_no_more_of_an_answer_is_told_of_no_fault(flight: Path, tmp_path: Path) -> None:
    """`gcs-mosaic status DIR | head -1`."""
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "wb") as nobody:
        done = subprocess.run(
            [*PROGRAM, "status", str(flight)], stdout=nobody, stderr=subprocess.PIPE, text=True, timeout=60, check=False
        )
    assert (done.returncode, done.stderr) == (141, "")


def test_a_command_that_ends_on_a_full_disk_does_not_promise_to_go_on(
    tmp_path: Path, tiny_disk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.jpg").write_bytes(sure(cv2.imencode(".jpg", np.full((48, 64, 3), 90, np.uint8))[1]).tobytes())
    with suppress(OSError):
        (tiny_disk / "fill").write_bytes(bytes(2 << 20))
    assert cli.main(["stitch", str(tmp_path / "a.jpg"), "--out", str(tiny_disk / "map")]) == 1
    assert "the disk is full: free some space, then start again (" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words", [["status"], ["check"], ["serve"], ["export", "--format", "png"], ["anchor"], ["pair"]], ids=" ".join
)
def test_a_flight_of_another_user_is_not_told_as_damaged(
    tmp_path: Path, words: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its folder may be open, its files are not; for root all are, so the system's answer is replaced."""
    ledger = tmp_path / LEDGER_NAME
    ledger.touch()
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path) != ledger)
    assert cli.main([words[0], str(tmp_path), *words[1:]]) == 1
    said = capsys.readouterr().err
    assert f"{ledger} cannot be opened (Permission denied): do it as the user who wrote the flight" in said


def test_help_names_all_settings_that_count_for_an_earlier_flight(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        cli.main(["serve", "--help"])
    assert "`web`, `hints`, `permissions`" in " ".join(capsys.readouterr().out.split())


@pytest.mark.long
def test_a_finished_flight_is_served(flight: Path, tmp_path: Path) -> None:
    """The page, its documents and a tile; SIGTERM ends it."""
    command = [*PROGRAM, "serve", str(flight), "--http", "127.0.0.1:0"]
    with subprocess.Popen(command, cwd=Path(__file__).parents[2], stdout=subprocess.PIPE, text=True) as server:
        killer = threading.Timer(30, server.kill)
        killer.start()
        assert server.stdout is not None
        page = server.stdout.readline().split()[4]
        tile = next((flight / "tiles").rglob("*.jpg")).relative_to(flight).as_posix()
        for path in ("", "mosaic.json", tile):
            with urllib.request.urlopen(page + path, timeout=10) as answer:
                assert answer.status == 200
                assert answer.read()
        server.send_signal(signal.SIGTERM)
        assert until(lambda: server.poll() is not None, "ended")
        killer.cancel()
    assert server.returncode == 0
