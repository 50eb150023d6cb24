"""The command line: arguments -> settings -> what was asked for; exit codes.

0: done. 1: something failed that should not have. 2: bad usage, told in one sentence. 3: no frame found a place.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path
from types import FrameType

from rich.console import Console

from gcs_mosaic.app.shutdown import Ending
from gcs_mosaic.cli.options import add_announce, add_blend, add_method, add_output, listening_of, make_parser
from gcs_mosaic.errors import FlightFailed, NothingPlaced, UsageError
from gcs_mosaic.store.disk import CannotWrite

USAGE = """\
gcs-mosaic [--mavlink udp:14550] [--watch DIR | --rtsp URL] [--out DIR] ...   live: listen, watch, stitch, show
       gcs-mosaic stitch DIR --out DIR                                  a folder of frames, without MAVLink
       gcs-mosaic replay FLIGHT.tlog --frames DIR --out DIR             a recorded flight again
       gcs-mosaic serve DIR | status DIR | export DIR --format FORMAT   a flight that was written before
       gcs-mosaic benchmark DIR                                         what a frame costs on this machine"""

WHEN_FRAMES_CAME = """\
When a frame came follows from the files' times if they lie within the recording; else from the file names in the camera
messages, else from the numbers in the file names and the messages' counters, else from the order of names and shots. The
result is the same every time, at any speed."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit code."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    try:
        _run(words)
    except UsageError as error:
        print(f"gcs-mosaic: {error}", file=sys.stderr)
        return 2
    except (CannotWrite, FlightFailed) as error:
        print(f"gcs-mosaic: {error}", file=sys.stderr)
        return 1
    except NothingPlaced as error:
        print(f"gcs-mosaic: {error}", file=sys.stderr)
        return 3
    except KeyboardInterrupt:
        print("gcs-mosaic: interrupted", file=sys.stderr)
        return 130
    finally:
        _flush_or_let_go()
    return 0


def _run(words: Sequence[str]) -> None:
    if not words or words[0].startswith("-"):
        fly(words)
    elif words[0] in COMMANDS:
        COMMANDS[words[0]](words[1:])
    else:
        near = get_close_matches(words[0], COMMANDS, n=1)
        meant = f"did you mean {near[0]!r}?" if near else f"those are {', '.join(COMMANDS)}"
        raise UsageError(f"{words[0]!r} is no command ({meant}); without one gcs-mosaic flies")


def _flush_or_let_go() -> None:
    """A reader that is gone must not decide the exit code, as it would if Python's own last flush failed."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, stream.fileno())
            os.close(nowhere)


class _TellVersion(argparse.Action):
    """Looked up only when it is asked for: a clone that is not installed flies all the same."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from importlib.metadata import PackageNotFoundError, version

        try:
            told = version("gcs-mosaic")
        except PackageNotFoundError:
            told = "of a clone that is not installed"
        print(f"gcs-mosaic {told}")
        parser.exit()


def fly(words: Sequence[str]) -> None:
    """The live flight. The links are opened before anything large is loaded, and what comes meanwhile is kept by the system."""
    from gcs_mosaic.app.links import listen

    parser = make_parser("gcs-mosaic", USAGE)
    parser.add_argument("--version", action=_TellVersion, nargs=0, help="tell which version this is")
    parser.add_argument("--mavlink", action="append", metavar="ADDRESS", help="link to listen on; may be repeated")
    source = parser.add_mutually_exclusive_group()
    source.add_argument("--watch", metavar="DIR", help="folder in which the camera's files appear")
    source.add_argument("--rtsp", metavar="URL|auto", help="live stream instead, a frame of it for each trigger")
    parser.add_argument("--every", metavar="1s|overlap", help="frames of the stream without triggers too")
    parser.add_argument("--from", dest="oldest", metavar="now|start|30m", help="how old a file may be at the start")
    parser.add_argument("--vehicle", type=int, metavar="ID", help="MAVLink system id of the aircraft")
    add_announce(parser)
    add_blend(parser)
    add_method(parser)
    add_output(parser)
    parser.add_argument(
        "--record",
        nargs="?",
        const=True,
        metavar="FILE",
        help="keep what is heard as FILE (.tlog), or as flight.tlog in the output folder",
    )
    page = parser.add_mutually_exclusive_group()
    page.add_argument("--http", metavar="HOST:PORT", help="where the page is served")
    page.add_argument("--no-http", action="store_true", help="serve no page")
    again = parser.add_mutually_exclusive_group()
    again.add_argument("--resume", action="store_true", help="go on with the flight in --out")
    again.add_argument("--new", action="store_true", help="a new flight, beside the one in --out")
    given = parser.parse_args(words)
    ending = Ending(stop=threading.Event(), hurry=threading.Event())
    _end_on_signals(ending.stop, ending.hurry)
    listening = listening_of(given)
    with ExitStack() as stack:
        links = listen(listening, ending.stop, stack)
        from gcs_mosaic.app import live as daemon
        from gcs_mosaic.cli.choices import flight_config

        daemon.fly(flight_config(given, listening), links, Console(stderr=True), ending, resume=given.resume)


def stitch(words: Sequence[str]) -> None:
    """A folder of frames."""
    from gcs_mosaic.app import batch
    from gcs_mosaic.cli.choices import blended, config_of

    parser = make_parser("gcs-mosaic stitch")
    parser.add_argument("frames", nargs="+", type=Path, metavar="FRAMES|DIR", help="image files, or folders of them")
    add_method(parser)
    parser.add_argument("--scale", type=float, choices=[1, 0.5, 0.25], help="size at which frames are painted")
    parser.add_argument(
        "--debug", type=Path, metavar="DIR", help="new folder for pictures of matches, footprints, residuals"
    )
    add_blend(parser)
    add_output(parser)
    given = parser.parse_args(words)
    config = blended(config_of(given), given.blend)
    if given.scale:
        config = replace(config, scale=given.scale)
    if given.debug and config.method == "paper":
        raise UsageError("--debug shows how the default method decides: leave it out with --method paper")
    batch.stitch(given.frames, Path(config.out), config, Console(), given.debug)


def replay(words: Sequence[str]) -> None:
    """A recorded flight."""
    from gcs_mosaic.app import replay as replays
    from gcs_mosaic.cli.choices import config_of

    parser = make_parser("gcs-mosaic replay", epilog=WHEN_FRAMES_CAME)
    parser.add_argument("recording", type=Path, metavar="FLIGHT.tlog", help="what was heard (--record writes it)")
    parser.add_argument("--frames", type=Path, required=True, metavar="DIR", help="folder of the flight's pictures")
    parser.add_argument(
        "--speed", type=float, default=0.0, metavar="N", help="times as fast as it was flown; 0 as fast as it goes (0)"
    )
    parser.add_argument("--scale", type=float, choices=[1, 0.5, 0.25], help="size at which frames are painted")
    parser.add_argument("--vehicle", type=int, metavar="ID", help="MAVLink system id of the aircraft")
    add_method(parser)
    add_output(parser)
    given = parser.parse_args(words)
    config = config_of(given)
    if given.scale:
        config = replace(config, scale=given.scale)
    if given.vehicle is not None:
        config = replace(config, link=replace(config.link, vehicle=given.vehicle))
    replays.replay(given.recording, given.frames, Path(config.out), config, Console(), given.speed)


def benchmark(words: Sequence[str]) -> None:
    """What a frame costs on this machine."""
    from gcs_mosaic.app import benchmark as benchmarks
    from gcs_mosaic.config.tree import Config, load_config

    parser = make_parser("gcs-mosaic benchmark")
    parser.add_argument("frames", nargs="+", type=Path, metavar="FRAMES|DIR", help="image files, or folders of them")
    parser.add_argument("--most", type=int, metavar="N", help="use the first N frames only")
    parser.add_argument("--config", type=Path, metavar="FILE", help="settings in YAML, see config/default.yaml")
    given = parser.parse_args(words)
    config = load_config(given.config) if given.config else Config()
    benchmarks.run(given.frames, config, Console(), given.most)


def serve(words: Sequence[str]) -> None:
    """The page of a flight that is over, or that another program writes."""
    from gcs_mosaic.store.folder import find_flight
    from gcs_mosaic.web.address import DEFAULT, HttpAddress
    from gcs_mosaic.web.server import WebServer

    parser = make_parser("gcs-mosaic serve")
    parser.add_argument("flight", type=Path, metavar="DIR", help="output folder of a flight")
    parser.add_argument("--http", metavar="HOST:PORT", default=DEFAULT, help="where the page is served")
    given = parser.parse_args(words)
    stop = threading.Event()
    _end_on_signals(stop, stop)
    server = WebServer(find_flight(given.flight), HttpAddress.parse(given.http))
    print(f"the map is at {server.start()} (Ctrl-C ends)", flush=True)
    while not stop.wait(1.0):
        pass
    server.stop()


def status(words: Sequence[str]) -> None:
    """What a running or ended flight says of itself."""
    from gcs_mosaic.store.status import read_status

    parser = make_parser("gcs-mosaic status")
    parser.add_argument("flight", type=Path, metavar="DIR", help="output folder of a flight")
    parser.add_argument("--json", action="store_true", help="as JSON")
    given = parser.parse_args(words)
    print(read_status(given.flight, as_json=given.json))


def export(words: Sequence[str]) -> None:
    """A flight for other programs."""
    from gcs_mosaic.export import export as exports

    parser = make_parser("gcs-mosaic export")
    parser.add_argument("flight", type=Path, metavar="DIR", help="output folder of a flight")
    parser.add_argument("--format", choices=["png", "tiff", "placements"], required=True)
    parser.add_argument("--to", type=Path, metavar="FILE", help="default: mosaic.png or the like, in DIR")
    parser.add_argument("--island", type=int, metavar="N", help="which island; default: the largest")
    parser.add_argument("--zoom", type=int, metavar="Z", help="level of the picture; default: the finest that fits")
    parser.add_argument("--no-gains", action="store_true", help="tiff: counts as the camera wrote them, seams and all")
    given = parser.parse_args(words)
    if given.format == "tiff":
        from gcs_mosaic.export.multiband_tiff import export_tiff

        target = given.to or given.flight / "mosaic.tif"
        print(export_tiff(given.flight, target, island=given.island, level=given.zoom, gains=not given.no_gains))
    elif given.format == "placements":
        target = given.to or given.flight / "placements-export.json"
        print(exports.export_placements(given.flight, target))
    else:
        target = given.to or given.flight / "mosaic.png"
        print(exports.export_png(given.flight, target, island=given.island, level=given.zoom))


COMMANDS: dict[str, Callable[[Sequence[str]], None]] = {
    "stitch": stitch,
    "replay": replay,
    "serve": serve,
    "status": status,
    "export": export,
    "benchmark": benchmark,
}


def _end_on_signals(stop: threading.Event, hurry: threading.Event) -> None:
    """Ctrl-C, SIGTERM and a terminal that is closed ask for the end; the second one for a quick one."""

    def ask(number: int, frame: FrameType | None) -> None:
        (hurry if stop.is_set() else stop).set()

    signal.signal(signal.SIGINT, ask)
    signal.signal(signal.SIGTERM, ask)
    hang_up = getattr(signal, "SIGHUP", None)  # not on Windows
    if hang_up is not None and signal.getsignal(hang_up) is not signal.SIG_IGN:  # nohup ignores it on purpose
        signal.signal(hang_up, ask)
