"""Arguments of all commands, and the setting that each overrides; independent of the stitching."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NoReturn, TypeVar, get_args

from gcs_mosaic.cli.aircraft import add_recorded_frames, add_sources, add_vehicles, of_each_aircraft
from gcs_mosaic.cli.through_trees import add_flying, add_integral
from gcs_mosaic.config.layers import settings_of
from gcs_mosaic.config.methods import Method
from gcs_mosaic.detection.persons import CLOTHES, POSTURES, Person, is_clothes, is_posture
from gcs_mosaic.errors import UsageError
from gcs_mosaic.extensions import names
from gcs_mosaic.hints.settings import HintSettings
from gcs_mosaic.mavlink.settings import Listening
from gcs_mosaic.messages import HIGHEST_SYSTEM
from gcs_mosaic.stitch.features.detectors import FeatureKind
from gcs_mosaic.store.permissions import Readers
from gcs_mosaic.web.address import DEFAULT as DEFAULT_PAGE
from gcs_mosaic.web.settings import WebSettings

MOST_LOOKS, MOST_METRES = 100, 10_000.0  # of a mission
DEFAULT_OUT = Path("mosaic")  # of the settings, which would load the stitching
ANNOUNCE_AS = 191  # default system id: not an aircraft's, which count from 1, nor the ground station's

# The setting that each option overrides, if given.
SETTINGS: Mapping[str, tuple[str, ...]] = {
    "mavlink": ("mavlink",),
    "vehicle": ("link", "vehicle"),
    "vehicles": ("link", "vehicles"),
    "announce": ("link", "announce"),
    "recover": ("link", "recover"),
    "watch": ("watch",),
    "rtsp": ("rtsp",),
    "sources": ("sources",),
    "source": ("source",),
    "every": ("stream", "every"),
    "from": ("frames", "from_age_s"),
    "cameras": ("frames", "cameras"),
    "out": ("out",),
    "resume": ("resume",),
    "verbose": ("log", "verbose"),
    "method": ("method",),
    "scale": ("scale",),
    "blend": ("paint", "canvas", "blend"),
    "record": ("record",),
    "anchor": ("anchor",),
    "http": ("http",),
}

WHEN_FRAMES_CAME = """\
When a frame came follows from the files' times if they lie within the recording; else from the file names in the camera
messages, else from what is likeliest by numbers in names, the camera's clock (EXIF) and order together. The result is the same
every time, at any speed. Besides a telemetry log the autopilot's own can be given: ArduPilot's .BIN, PX4's .ulg."""

T = TypeVar("T")


class Parser(argparse.ArgumentParser):
    """Raises UsageError on invalid arguments."""

    def __init__(self, **more: Any) -> None:
        super().__init__(**{"allow_abbrev": False, **more})
        self.asked = self.prog  # whose --help to name: unknown arguments of a command are reported by the parent parser

    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message} ({self.asked} --help shows what there is)")


def overruled(settings: T, given: argparse.Namespace, among: Sequence[str] = tuple(SETTINGS)) -> T:
    """Settings overridden by the given options among those. Raises UsageError for invalid values."""
    for name in among:
        value = getattr(given, name, None)
        if value is not None and value is not False:
            try:
                settings = _with(settings, SETTINGS[name], tuple(value) if isinstance(value, list) else value)
            except ValueError as error:
                told = str(error)
                raise UsageError(f"--{told}" if told.startswith(f"{name}:") else f"--{name}: {told}") from None
    return settings


def _with(settings: Any, path: tuple[str, ...], value: object) -> Any:
    first, *rest = path
    assert is_dataclass(settings), "the table names what there is"
    inner = _with(getattr(settings, first), tuple(rest), value) if rest else value
    return replace(settings, **{first: inner})  # type: ignore[type-var]


def names_given(given: argparse.Namespace) -> list[str]:
    """The dotted names of the settings that the command line overrides."""
    told = [name for name in SETTINGS if getattr(given, name, None) not in (None, False)]
    return [".".join(SETTINGS[name]) for name in told]


def listening_of(given: argparse.Namespace) -> Listening:
    """The link settings of files and environment, overridden by the command line."""
    listening, _ = settings_of(Listening, given.config, only=True)
    known = [field.name for field in fields(Listening)]
    return overruled(listening, given, [name for name, path in SETTINGS.items() if path[0] in known])


@dataclass(frozen=True, slots=True, kw_only=True)
class ServeSettings:
    """What counts for a flight that was flown before; the other settings are not looked at."""

    web: WebSettings = field(default_factory=WebSettings)
    hints: HintSettings = field(default_factory=HintSettings)
    permissions: Readers = "owner"


def serve_settings_of(given: argparse.Namespace) -> ServeSettings:
    """Those of files and environment. Raises UsageError."""
    return settings_of(ServeSettings, given.config, only=True)[0]


def parse(words: Sequence[str]) -> argparse.Namespace:
    """Parse the arguments; `command` is None for a live flight. Raises UsageError."""
    if words and not words[0].startswith("-") and words[0] not in COMMANDS:
        near = get_close_matches(words[0], COMMANDS, n=1)
        meant = f"did you mean {near[0]!r}?" if near else f"those are {', '.join(COMMANDS)}"
        raise UsageError(f"{words[0]!r} is no command ({meant}); without one gcs-mosaic flies")
    if words[:1] == ["demo"]:  # the simulator parses its own arguments
        return argparse.Namespace(command="demo", words=list(words[1:]))
    parser = _parser()
    if words and words[0] in COMMANDS:
        parser.asked = f"{parser.prog} {words[0]}"
    return of_each_aircraft(parser.parse_args(words))


def _parser() -> Parser:
    parser = Parser(
        prog="gcs-mosaic",
        description="Without a command: a live flight. Listen on the link, take the frames, stitch them, show the map.",
        epilog="gcs-mosaic COMMAND --help tells more of each.",
    )
    parser.add_argument("--version", action=_TellVersion, nargs=0, help="tell which version this is")
    add_live(parser)
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", parser_class=Parser)
    for name, (told, add, more) in COMMANDS.items():
        add(commands.add_parser(name, help=told, description=told, **more))
    return parser


class _TellVersion(argparse.Action):
    """Looks the version up only when asked for: a clone that is not installed works all the same."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from importlib.metadata import PackageNotFoundError, version

        try:
            told = version("gcs-mosaic")
        except PackageNotFoundError:
            told = "of a clone that is not installed"
        print(f"gcs-mosaic {told}")
        parser.exit()


def add_live(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of a live flight."""
    parser.add_argument("--mavlink", action="append", metavar="ADDRESS", help="link to listen on; may be repeated")
    add_sources(parser)
    parser.add_argument("--source", metavar="NAME[:ADDRESS]", help="frames of an installed extension, beside those")
    _add_every(parser, "frames of the stream without triggers too, and of videos; default for those: overlap")
    parser.add_argument("--from", metavar="now|start|30m", help="how old a file may be at the start")
    _add_cameras(parser)
    add_vehicles(parser)
    announce = parser.add_argument(
        "--announce", type=int, nargs="?", metavar="ID", help="send a heartbeat and warnings, as this MAVLink system"
    )
    announce.const = ANNOUNCE_AS
    parser.add_argument("--recover", action="store_true", help="ask the camera again for messages that were lost")
    _add_blend(parser)
    _add_method(parser)
    _add_output(parser)
    begin = parser.add_mutually_exclusive_group()
    begin.add_argument(
        "--resume", action="store_const", const="always", help="go on with the newest flight in --out, however old"
    )
    begin.add_argument(
        "--new",
        dest="resume",
        action="store_const",
        const="never",
        help="begin a new flight, beside one that has just ended",
    )
    parser.add_argument(
        "--record",
        nargs="?",
        const=True,
        metavar="FILE",
        help="keep what is heard as FILE (.tlog), or as flight.tlog in the output folder",
    )
    _add_anchor_by(parser)
    page = parser.add_mutually_exclusive_group()
    page.add_argument("--http", metavar="HOST:PORT", help="where the page is served")
    page.add_argument("--no-http", action="store_true", help="serve no page")


def _add_stitch(parser: argparse.ArgumentParser) -> None:
    told = "image files, recorded videos (MP4, MOV, MKV, TS), or folders of them"
    parser.add_argument("frames", nargs="+", type=Path, metavar="FRAMES|VIDEO|DIR", help=told)
    _add_cameras(parser)
    _add_every(parser, "which frames of a video are taken; default: overlap, whenever the view has moved")
    told = "go on with the newest flight in --out: what it has of these frames is not taken again"
    parser.add_argument("--resume", action="store_const", const="always", help=told)
    _add_anchor_by(parser)
    _add_method(parser)
    _add_scale(parser)
    parser.add_argument(
        "--debug", type=Path, metavar="DIR", help="new folder for pictures of matches, footprints, residuals"
    )
    _add_blend(parser)
    _add_output(parser)


def _add_merge(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("flights", nargs="+", type=Path, metavar="DIR", help="output folders of finished flights")
    _add_scale(parser)
    _add_output(parser)


def _add_reprocess(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "archive", nargs="+", metavar="SOURCE", help="image files, folders of them, or s3://BUCKET/PREFIX"
    )
    parser.add_argument("--out", required=True, metavar="TARGET", help="folder for the map, or s3://BUCKET/PREFIX")
    parser.add_argument(
        "--cluster", metavar="ADDRESS", help="tcp://HOST:PORT of a Dask scheduler; without: this machine"
    )
    parser.add_argument("--workers", type=_positive, metavar="N", help="on this machine; default: one for each core")
    parser.add_argument("--dashboard", action="store_true", help="tell where Dask shows what the workers do")
    parser.add_argument("--json", action="store_true", help="progress as a line of JSON each second")
    _add_cameras(parser)
    _add_scale(parser)
    _add_blend(parser)
    parser.add_argument("--features", choices=get_args(FeatureKind), help="what frames are matched by; default: sift")
    parser.add_argument("--config", type=Path, metavar="FILE", help="settings in YAML (gcs-mosaic config shows all)")


def _positive(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text} is no number of workers: give 1 or more")
    return int(text)


def _add_replay(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("recording", type=Path, metavar="FLIGHT.tlog", help="what was heard (--record writes it)")
    add_recorded_frames(parser)
    _add_cameras(parser)
    parser.add_argument(
        "--speed", type=float, default=0.0, metavar="N", help="times as fast as it was flown; 0 as fast as it goes (0)"
    )
    _add_scale(parser)
    add_vehicles(parser)
    _add_method(parser)
    _add_anchor_by(parser)
    _add_output(parser)


def _add_serve(parser: argparse.ArgumentParser) -> None:
    _add_flight(parser)
    parser.add_argument("--http", metavar="HOST:PORT", default=DEFAULT_PAGE, help="where the page is served")
    told = f"settings in YAML, of which {', '.join(f'`{one.name}`' for one in fields(ServeSettings))} count"
    parser.add_argument("--config", type=Path, metavar="FILE", help=told)


def _add_status(parser: argparse.ArgumentParser) -> None:
    _add_flight(parser)
    parser.add_argument("--json", action="store_true", help="as JSON")


def _add_vehicle_command(parser: argparse.ArgumentParser) -> None:
    told = "MAVLink system id to follow; without: list what is heard"
    parser.add_argument("system", nargs="?", type=_system_or_folder, metavar="ID", help=told)
    parser.add_argument("flight", nargs="?", type=Path, metavar="DIR", help=f"the flight's --out ({DEFAULT_OUT})")


def _system_or_folder(text: str) -> int | Path:
    if not text.isdecimal():
        return Path(text)
    if not 1 <= int(text) <= HIGHEST_SYSTEM:
        raise argparse.ArgumentTypeError(f"{text} is no MAVLink system id: give one from 1 to {HIGHEST_SYSTEM}")
    return int(text)


CANVAS_FORMATS = ("png", "tiff", "placements", "finds-geojson", "finds-csv", "finds-kml", "finds-report", "debriefing")
MISSION_FORMATS = ("mission-plan", "mission-waypoints", "mission-kml", "mission-gpx")
EARTH_FORMATS = (
    "geotiff",
    "cog",
    "mbtiles",
    "pmtiles",
    "xyz",
    "kmz",
    "geojson",
    *MISSION_FORMATS,
)  # of maps that have an anchor


def _add_export(parser: argparse.ArgumentParser) -> None:
    _add_flight(parser)
    told = f"{', '.join((*CANVAS_FORMATS, *EARTH_FORMATS))}, or one of an installed extension"
    parser.add_argument("--format", type=_format, required=True, metavar="FORMAT", help=told)
    parser.add_argument("--to", type=Path, metavar="FILE", help="default: mosaic.png or the like, in DIR")
    told = "which island; default: the largest, or all that have an anchor"
    parser.add_argument("--island", type=int, metavar="N", help=told)
    parser.add_argument("--zoom", type=int, metavar="Z", help="finest level; default: the finest that fits")
    told = "cut out, in degrees; for what has coordinates"
    parser.add_argument("--box", type=float, nargs=4, metavar=("W", "S", "E", "N"), help=told)
    parser.add_argument("--crs", type=_crs, metavar="EPSG:3857|utm", help="geotiff, cog: default EPSG:3857")
    parser.add_argument("--bands", action="store_true", help="geotiff, cog: every band of the frames at its depth")
    parser.add_argument("--no-gains", action="store_true", help="bands: counts as the camera wrote them, seams and all")
    parser.add_argument("--tiles", choices=["png", "webp", "jpg"], help="mbtiles, pmtiles, xyz: default png")
    _add_mission(parser)


def _add_mission(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--looks", type=_looks, metavar="N", help="mission: also ground that fewer frames saw; default: gaps alone"
    )
    told = "mission: also ground that was seen coarser, in metres a pixel; it is flown lower"
    parser.add_argument("--gsd", type=_metres, metavar="M", help=told)
    told = "mission: metres over ground as it was flown, where the pictures do not tell"
    parser.add_argument("--height", type=_metres, metavar="M", help=told)
    told = "mission: instead, ground where a person would have been seen with a lower probability, as 0.8"
    parser.add_argument("--below", type=_probability, metavar="P", help=told)
    told = f"who is sought, for --below, geojson and debriefing: {'|'.join(POSTURES)},{'|'.join(CLOTHES)}; default lying,blue"
    parser.add_argument("--person", type=_person, metavar="POSTURE,CLOTHES", help=told)


def _probability(text: str) -> float:
    try:
        found = float(text)
    except ValueError:
        found = 0.0
    if not 0 < found < 1:  # which NaN is not
        raise argparse.ArgumentTypeError(f"{text} is no probability: give one between 0 and 1, as 0.8")
    return found


def _person(text: str) -> Person:
    posture, _, clothes = text.partition(",")
    if not is_posture(posture) or not is_clothes(clothes):
        raise argparse.ArgumentTypeError(
            f"{text} is nobody: give a posture ({', '.join(POSTURES)}) and clothes ({', '.join(CLOTHES)}), as lying,blue"
        )
    return Person(posture=posture, clothes=clothes)


def _looks(text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= MOST_LOOKS:
        raise argparse.ArgumentTypeError(f"{text} is no number of frames: give one from 1 to {MOST_LOOKS}")
    return int(text)


def _metres(text: str) -> float:
    try:
        found = float(text)
    except ValueError:
        found = 0.0
    if not 0 < found <= MOST_METRES:  # which NaN is not
        raise argparse.ArgumentTypeError(f"{text} is no number of metres: give one above 0")
    return found


def _format(text: str) -> str:
    if text in (*CANVAS_FORMATS, *EARTH_FORMATS):
        return text
    known = (*CANVAS_FORMATS, *EARTH_FORMATS, *names("exports"))
    if text not in known:
        raise argparse.ArgumentTypeError(f"invalid choice: {text!r} (choose from {', '.join(map(repr, known))})")
    return text


def _crs(text: str) -> str:
    known = {"epsg:3857": "EPSG:3857", "utm": "utm"}
    if text.lower() not in known:
        raise argparse.ArgumentTypeError(
            f"{text} is not written: give EPSG:3857 (Web Mercator) or utm (the map's zone)"
        )
    return known[text.lower()]


def _add_check(parser: argparse.ArgumentParser) -> None:
    _add_flight(parser)
    parser.add_argument("--tiles", action="store_true", help="also paint every tile again and compare; takes its time")
    parser.add_argument("--repair", action="store_true", help="make anew what ledger and originals can give")
    parser.add_argument(
        "--frames", type=Path, action="append", default=[], metavar="DIR", help="repair: where the camera's files are"
    )
    parser.add_argument("--json", action="store_true", help="as JSON")


def _add_anchor(parser: argparse.ArgumentParser) -> None:
    _add_flight(parser)
    told = "control points: a table (name; frame, px, py; latitude, longitude; sigma_m) or OpenDroneMap's gcp_list.txt"
    parser.add_argument("--points", type=Path, metavar="FILE", help=told)
    parser.add_argument(
        "--delete", type=int, action="append", default=[], metavar="N", help="pin N lays nothing any more"
    )
    told = "let the positions of the triggers lay islands without pins, or not"
    parser.add_argument("--positions", action=argparse.BooleanOptionalAction, default=None, help=told)


def _add_benchmark(parser: argparse.ArgumentParser) -> None:
    _add_frames(parser)
    parser.add_argument("--most", type=int, metavar="N", help="use the first N frames only")
    parser.add_argument("--config", type=Path, metavar="FILE", help="settings in YAML (gcs-mosaic config shows all)")


def _add_nothing(parser: argparse.ArgumentParser) -> None:
    pass


def _add_frames(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("frames", nargs="+", type=Path, metavar="FRAMES|DIR", help="image files, or folders of them")


def _add_every(parser: argparse.ArgumentParser, told: str) -> None:
    parser.add_argument("--every", metavar="1s|overlap", help=told)


def _add_flight(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("flight", type=Path, metavar="DIR", help="output folder of a flight")


def _add_pair(parser: argparse.ArgumentParser) -> None:
    _add_flight(parser)
    told = "by how many shots later each picture belongs than found in flight (-1: earlier); 0 or auto: as found"
    parser.add_argument("--shift", type=_shift, metavar="N", help=told)


def _shift(text: str) -> int:
    if text == "auto":
        return 0
    try:
        return int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text} is no number of shots: give 1, -1, or auto") from None


def _add_anchor_by(parser: argparse.ArgumentParser) -> None:
    told = (
        "positions: those of the triggers, or of a video, lay the map on earth where nobody sets pins; for showing only"
    )
    parser.add_argument("--anchor", choices=["pins", "positions"], help=told)


def _add_cameras(parser: argparse.ArgumentParser) -> None:
    told = "names of the files that are mapped, such as '*_T.*'; '*': all; may be repeated"
    parser.add_argument("--cameras", action="append", metavar="PATTERN", help=told)


def _add_scale(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--scale", type=float, choices=[1, 0.5, 0.25], help="size at which frames are painted")


def _add_output(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", metavar="DIR", help="folder for the map (an earlier flight in it is left as it is)")
    parser.add_argument("--config", type=Path, metavar="FILE", help="settings in YAML (gcs-mosaic config shows all)")
    parser.add_argument("--verbose", action="store_true", help="tell on the terminal what is written into flight.log")


def _add_blend(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--blend", metavar="seam|edge|newest|first", help="which frame shows where several do")


def _add_method(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--method", choices=get_args(Method), help="paper: the paper's recipe literally, to compare with"
    )
    parser.add_argument("--features", choices=get_args(FeatureKind), help="what frames are matched by; default: sift")


Add = Callable[[argparse.ArgumentParser], None]
COMMANDS: Mapping[str, tuple[str, Add, Mapping[str, Any]]] = {
    "stitch": ("a folder of frames, or a recorded video, without MAVLink", _add_stitch, {}),
    "merge": ("flights of earlier days or other laptops become one map", _add_merge, {}),
    "reprocess": ("an archive of frames, on all cores or a cluster", _add_reprocess, {}),
    "replay": ("a recorded flight again", _add_replay, {"epilog": WHEN_FRAMES_CAME}),
    "serve": ("the page of a flight that was written before", _add_serve, {}),
    "status": ("what a running or ended flight says of itself", _add_status, {}),
    "vehicle": ("which aircraft a running flight follows: list them, or choose one", _add_vehicle_command, {}),
    "check": ("whether a flight is whole, and its repair", _add_check, {}),
    "anchor": ("where the map lies on earth: show it, set control points", _add_anchor, {}),
    "pair": ("which trigger belongs to which picture: show it, shift them all", _add_pair, {}),
    "export": (
        "a flight for other programs: a picture, all bands, a map with coordinates, what was found",
        _add_export,
        {},
    ),
    "integral": ("what lies beneath leaves at a place: all looks laid together", add_integral, {}),
    "looks": ("how to fly for so many looks at each place", add_flying, {}),
    "benchmark": ("what a frame costs on this machine", _add_benchmark, {}),
    "config": ("all settings with their defaults and reasons, as YAML", _add_nothing, {}),
    "demo": ("a simulated flight into the program and its page", _add_nothing, {}),
}
