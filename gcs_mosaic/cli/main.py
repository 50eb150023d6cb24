"""The command line: parses arguments, runs the command, returns the exit code.

0: success. 1: unexpected failure, or `check` has found faults. 2: usage error, reported in one sentence. 3: no frame could be
placed. 130: interrupted. 141: nobody reads what it says any more.
"""

from __future__ import annotations

import argparse
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import ExitStack, nullcontext
from pathlib import Path
from types import FrameType

from rich.console import Console

from gcs_mosaic.app.live.left_behind import GOES_ON
from gcs_mosaic.app.live.shutdown import Shutdown
from gcs_mosaic.cli.foreign import OF_A_FLIGHT, telling_of_foreign
from gcs_mosaic.cli.options import DEFAULT_OUT, listening_of, parse, serve_settings_of
from gcs_mosaic.cli.streams import flush_or_let_go, reader_has_gone
from gcs_mosaic.errors import FlightFailed, NothingPlaced, UsageError
from gcs_mosaic.store.disk import CannotWrite
from gcs_mosaic.store.log import without_passwords
from gcs_mosaic.store.permissions import restrict

SIMULATOR = "gcs_mosaic.sitl.__main__"  # by its name: it imports nothing of the program, nor the program of it


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit code."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    try:
        given = parse(words)
        with telling_of_foreign(given) if given.command in OF_A_FLIGHT else nullcontext():
            return (COMMANDS[given.command] if given.command else fly)(given) or 0
    except UsageError as error:
        return _say(error, 2)
    except (CannotWrite, FlightFailed) as error:
        return _say(error, 1)
    except NothingPlaced as error:
        return _say(error, 3)
    except BrokenPipeError:
        if not reader_has_gone():  # a pipe of our own
            raise
        return 141
    except KeyboardInterrupt:
        print("gcs-mosaic: interrupted", file=sys.stderr)
        return 130
    finally:
        flush_or_let_go()


def _say(error: Exception, code: int) -> int:
    """On the terminal, or in a service's journal. A setting that is refused may have a password in it; and what ends does not go
    on by itself, as a flight does once it has begun."""
    text = str(error).replace(GOES_ON, ", then start again")
    print(f"gcs-mosaic: {without_passwords(text)}", file=sys.stderr)
    return code


def fly(given: argparse.Namespace) -> None:
    """A live flight. Links are opened before any large import; the kernel buffers what arrives meanwhile."""
    from gcs_mosaic.app.inputs.links import listen

    shutdown = Shutdown(stop=threading.Event(), hurry=threading.Event())
    _end_on_signals(shutdown.stop, shutdown.hurry)
    listening = listening_of(given)
    with ExitStack() as stack:
        links = listen(listening, shutdown.stop, stack)
        from gcs_mosaic.app.live import daemon
        from gcs_mosaic.cli.choices import flight_config

        config = flight_config(given, listening)
        restrict(config.permissions)
        daemon.fly(config, links, Console(stderr=True), shutdown)


def stitch(given: argparse.Namespace) -> None:
    """Stitch a folder of frames, or recorded videos."""
    from gcs_mosaic.app.commands import batch
    from gcs_mosaic.cli.choices import config_of

    config = config_of(given)
    restrict(config.permissions)
    resume = given.resume is not None
    batch.stitch(given.frames, Path(config.out), config, Console(), given.debug, resume=resume)


def merge(given: argparse.Namespace) -> None:
    """Join finished flights into one map."""
    from gcs_mosaic.app.commands import merging
    from gcs_mosaic.cli.choices import config_of

    if given.out is None:
        raise UsageError("merge needs --out DIR, a new folder for the map of all")
    config = config_of(given)
    restrict(config.permissions)
    merging.merge(given.flights, Path(config.out), config, Console())


def reprocess(given: argparse.Namespace) -> None:
    """Make a map of an archive of frames, on all cores or a cluster."""
    from gcs_mosaic.cli.choices import config_of
    from gcs_mosaic.cli.extras import need_cluster

    need_cluster()
    from gcs_mosaic.archive.progress import Lines
    from gcs_mosaic.archive.reprocess import Request, reprocess

    config = config_of(given)
    restrict(config.permissions)
    where = {"cluster": given.cluster, "workers": given.workers, "dashboard": given.dashboard}
    request = Request(tuple(given.archive), given.out, **where)
    reprocess(request, config, Lines(Console(), as_json=given.json))


def replay(given: argparse.Namespace) -> None:
    """Replay a recorded flight."""
    from gcs_mosaic.app.commands import replay
    from gcs_mosaic.cli.choices import replay_config

    config = replay_config(given)
    restrict(config.permissions)
    replay.replay(given.recording, given.frames, Path(config.out), config, Console(), given.speed)


def benchmark(given: argparse.Namespace) -> None:
    """Measure the time per frame on this machine."""
    from gcs_mosaic.app.commands import benchmark
    from gcs_mosaic.cli.choices import config_of

    benchmark.run(given.frames, config_of(given), Console(), given.most)


def serve(given: argparse.Namespace) -> None:
    """Serve the page of a finished flight, or of one written by another process."""
    from gcs_mosaic.store.folder import find_flight
    from gcs_mosaic.web.serving import serve_until

    stop = threading.Event()
    _end_on_signals(stop, stop)
    settings = serve_settings_of(given)
    restrict(settings.permissions)
    serve_until(stop, find_flight(given.flight), given.http, settings.web, settings.hints)


def status(given: argparse.Namespace) -> None:
    """Print the status of a running or finished flight."""
    from gcs_mosaic.store.status import read_status

    print(read_status(given.flight, as_json=given.json))


def vehicle(given: argparse.Namespace) -> None:
    """List the aircraft of a flight, or choose the one that it follows."""
    from gcs_mosaic.store.aircraft import follow, heard_aircraft

    if isinstance(given.system, int):
        print(follow(given.flight or DEFAULT_OUT, given.system))
    else:
        print(heard_aircraft(given.system or DEFAULT_OUT))


def check(given: argparse.Namespace) -> int:
    """Check a flight, and repair it if asked to; the exit code is 1 if something is wrong with it."""
    from gcs_mosaic.check import table

    if given.frames and not given.repair:
        raise UsageError("--frames names where --repair finds originals: give both, or neither")
    how = {"mend": given.repair, "every_tile": given.tiles, "sources": given.frames, "as_json": given.json}
    return table.run(given.flight, Console(), **how)


def export_flight(given: argparse.Namespace) -> None:
    """Export a flight for other programs."""
    from gcs_mosaic.export.formats import FORMATS, Wish, export

    if given.format not in FORMATS:
        from gcs_mosaic.cli.extended_export import export_by_extension

        print(export_by_extension(given))
        return
    wish = Wish(
        to=given.to,
        island=given.island,
        zoom=given.zoom,
        no_gains=given.no_gains,
        box=tuple(given.box) if given.box else None,
        crs=given.crs,
        bands=given.bands,
        tiles=given.tiles,
        looks=given.looks,
        gsd=given.gsd,
        height=given.height,
        below=given.below,
        person=given.person,
    )
    print(export(given.flight, given.format, wish, Console(stderr=True)))


def integral(given: argparse.Namespace) -> None:
    """Lay all looks at a place together."""
    from gcs_mosaic.cli.through_trees import integral_wish
    from gcs_mosaic.export.integral_file import write_integral

    print(write_integral(given.flight, given.out, integral_wish(given)))


def looks(given: argparse.Namespace) -> None:
    """Say how to fly for a number of looks."""
    from gcs_mosaic.cli.through_trees import flying_wish
    from gcs_mosaic.integral.how_to_fly import flying_words

    print(flying_words(flying_wish(given)))


def anchor(given: argparse.Namespace) -> int:
    """Show how the map lies on earth, and change what it is laid by; the exit code is 1 if what was given lays nothing."""
    from gcs_mosaic.notes.anchors.anchor_flight import AnchorChange, anchor_flight

    change = AnchorChange(points=given.points, deleted=given.delete, positions=given.positions)
    told = anchor_flight(given.flight, change)
    print(told.text)
    return int(told.is_vain)


def pair(given: argparse.Namespace) -> None:
    """Show which triggers belong to which pictures, and shift them."""
    from gcs_mosaic.app.commands.pairing import pair

    print(pair(given.flight, given.shift))


def config(given: argparse.Namespace) -> None:
    """Print all settings with their defaults, as YAML suitable for --config, and as a remark what is set elsewhere."""
    from gcs_mosaic.config.settings_file import documented_defaults

    print(documented_defaults(), end="", flush=True)
    from gcs_mosaic.config.tree import changed, configured, shareable
    from gcs_mosaic.store.log import masked

    if set_elsewhere := list(changed(shareable(configured(None)))):
        print("\n# Set otherwise here, without --config or options:")
        print("".join(f"#   {masked(one)}\n" for one in set_elsewhere), end="")


def demo(given: argparse.Namespace) -> int:
    """Run a simulated flight: the simulator starts the program as a separate process, as an operator would."""
    from importlib import import_module

    simulator = import_module(SIMULATOR)
    # SIGTERM as Ctrl-C: else the program that it has started would stay.
    before = {end: signal.signal(end, simulator.interrupt) for end in (signal.SIGINT, signal.SIGTERM)}
    try:
        return int(simulator.main(given.words, program="gcs-mosaic demo"))
    finally:
        for end, handler in before.items():
            signal.signal(end, handler)


COMMANDS: dict[str, Callable[[argparse.Namespace], int | None]] = {
    "stitch": stitch,
    "merge": merge,
    "reprocess": reprocess,
    "replay": replay,
    "serve": serve,
    "status": status,
    "vehicle": vehicle,
    "check": check,
    "anchor": anchor,
    "pair": pair,
    "export": export_flight,
    "integral": integral,
    "looks": looks,
    "benchmark": benchmark,
    "config": config,
    "demo": demo,
}


def _end_on_signals(stop: threading.Event, hurry: threading.Event) -> None:
    """SIGINT, SIGTERM and a closed terminal request the end; a second signal requests a quick one."""

    def ask(number: int, frame: FrameType | None) -> None:
        (hurry if stop.is_set() else stop).set()

    signal.signal(signal.SIGINT, ask)
    signal.signal(signal.SIGTERM, ask)
    for name in ("SIGHUP", "SIGBREAK"):  # POSIX only, Windows only
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:  # nohup ignores SIGHUP on purpose
            signal.signal(number, ask)
