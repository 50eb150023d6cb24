"""All settings in one tree, read from YAML. Each room's defaults stand beside the room; here they are only put together."""

from __future__ import annotations

import dataclasses
import difflib
import math
import types
import typing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import yaml

from gcs_mosaic.errors import UsageError
from gcs_mosaic.flight.log import LogSettings
from gcs_mosaic.flight.originals import OriginalsSettings
from gcs_mosaic.flight.tiles import TileSettings
from gcs_mosaic.frames.settings import FolderSettings
from gcs_mosaic.frames.stream.settings import StreamSettings
from gcs_mosaic.link.settings import LinkSettings
from gcs_mosaic.link.shots import ShotSettings
from gcs_mosaic.painter import PaintSettings
from gcs_mosaic.pairing import PairingSettings
from gcs_mosaic.stitch.matching.detectors import FeatureKind
from gcs_mosaic.stitch.mosaic import StitchSettings
from gcs_mosaic.stitch.paper.mosaic import PaperSettings

Method = Literal["adjusted", "paper"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Config:
    """What `gcs-mosaic` runs with. Paths are relative to where it is started."""

    # links to listen on, such as udp:14445, tcp:HOST:PORT, serial:/dev/ttyACM0:57600
    mavlink: tuple[str, ...] = ("udp:14550",)
    watch: str = "frames"  # folder in which the camera's files appear
    # live stream instead of a folder, such as rtsp://HOST:554/main; auto: where the aircraft says that it is; null: none
    rtsp: str | None = None
    out: str = "mosaic"  # folder for tiles, ledger and originals
    http: str | None = "127.0.0.1:8470"  # where the page is served; null for none
    method: Method = "adjusted"  # paper: its recipe literally, to compare with; it breaks on long flights
    scale: float = 1.0  # size at which frames are decoded and painted: 1, 0.5 or 0.25; smaller is faster and coarser
    # what is heard is kept as FILE.tlog, or with true as flight.tlog in the output folder, for replay; false: it is not
    record: bool | str = False
    finish_s: float = 60.0  # longest time for the last frames and the final painting after Ctrl-C
    link: LinkSettings = field(default_factory=LinkSettings)
    frames: FolderSettings = field(default_factory=FolderSettings)
    stream: StreamSettings = field(default_factory=StreamSettings)
    shots: ShotSettings = field(default_factory=ShotSettings)
    pairing: PairingSettings = field(default_factory=PairingSettings)
    stitch: StitchSettings = field(default_factory=StitchSettings)
    paper: PaperSettings = field(default_factory=PaperSettings)
    paint: PaintSettings = field(default_factory=PaintSettings)
    originals: OriginalsSettings = field(default_factory=OriginalsSettings)
    tiles: TileSettings = field(default_factory=TileSettings)
    log: LogSettings = field(default_factory=LogSettings)

    def __post_init__(self) -> None:
        if self.scale not in (1, 0.5, 0.25):
            raise ValueError(f"scale: expected 1, 0.5 or 0.25, got {self.scale:g}")

    @property
    def features(self) -> FeatureKind:
        """What frames are placed by."""
        return self.paper.features if self.method == "paper" else self.stitch.features.kind

    def with_features(self, kind: FeatureKind) -> Config:
        """The same with other features, in whichever method."""
        features = dataclasses.replace(self.stitch.features, kind=kind)
        stitch = dataclasses.replace(self.stitch, features=features)
        return dataclasses.replace(self, stitch=stitch, paper=dataclasses.replace(self.paper, features=kind))

    @property
    def reduction(self) -> int:
        """Whole factor by which frames are reduced."""
        return round(1 / self.scale)


def load_config(path: Path) -> Config:
    """Settings from a YAML file over the defaults. UsageError names what is unknown or of the wrong kind."""
    try:
        document = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UsageError(
            f"The configuration {path} cannot be read ({error.strerror}); give an existing YAML file."
        ) from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise UsageError(f"The configuration {path} is not YAML: {' '.join(str(error).split())}") from None
    settings = from_mapping(Config, {} if document is None else document, str(path))
    return typing.cast(Config, settings)


def from_mapping(kind: type, values: object, where: str) -> Any:
    """A settings dataclass from a mapping of some or all of its fields, checked and nested."""
    if not isinstance(values, dict):
        raise UsageError(f"{where}: expected settings as 'name: value' lines, got {values!r}.")
    hints = typing.get_type_hints(kind)
    for key in values:
        if key not in hints:
            raise UsageError(f"{where}: {key!r} is not a setting{_nearest(str(key), hints)}; see config/default.yaml.")
    given = {key: _value(hints[key], value, f"{where}: {key}") for key, value in values.items()}
    try:
        return kind(**given)
    except ValueError as error:
        raise UsageError(f"{where}: {error}.") from None


def _nearest(key: str, known: dict[str, Any]) -> str:
    close = difflib.get_close_matches(key, known, n=1, cutoff=0.5)
    return f" (did you mean {close[0]!r}?)" if close else f" (there are {', '.join(known)})"


def _value(kind: Any, value: object, where: str) -> Any:
    """The value if it is of this kind, else a UsageError."""
    if dataclasses.is_dataclass(kind):
        return from_mapping(typing.cast(type, kind), value, where)
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin in (types.UnionType, typing.Union):
        if value is None and type(None) in arguments:
            return None
        wanted = [argument for argument in arguments if argument is not type(None)]
        return _value(next((kind for kind in wanted if type(value) is kind), wanted[-1]), value, where)
    if origin is typing.Literal:
        if value not in arguments:
            raise UsageError(f"{where}: expected one of {', '.join(map(str, arguments))}, got {value!r}.")
        return value
    if origin is tuple:
        items = value if isinstance(value, list) else [value]
        return tuple(_value(arguments[0], item, where) for item in items)
    return _plain(kind, value, where)


def _plain(kind: type, value: object, where: str) -> Any:
    names = {int: "a whole number", float: "a number", bool: "true or false", str: "text"}
    fits = isinstance(value, kind) or (kind is float and isinstance(value, int))
    if isinstance(value, bool) and kind is not bool:
        fits = False
    if not fits or (isinstance(value, float) and not math.isfinite(value)):
        raise UsageError(f"{where}: expected {names.get(kind, kind.__name__)}, got {value!r}.")
    return kind(value)
