"""Short recorded videos of a flight over a made ground, encoded here."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.frames.files import looks_in
from gcs_mosaic.frames.rtsp.settings import StreamSettings
from gcs_mosaic.frames.video.extraction import ChosenPicture, GoOn, ReadToTheEnd, Told, extract
from gcs_mosaic.frames.video.klv import KEY, checksum
from gcs_mosaic.frames.video.reading import Known, VideoReading

Image = NDArray[np.uint8]

WIDTH, HEIGHT, RATE = 320, 240, 25
SPEED = 120  # px a second: a frame each 0.8 s
X264 = {"preset": "ultrafast", "g": "10"}
MOST_PIXELS = 10**8
LATITUDE, LONGITUDE = 47.1, 8.2
_COARSE = np.random.default_rng(0).integers(30, 225, (200, 400, 3)).astype(np.uint8)
GROUND: Image = np.asarray(cv2.resize(_COARSE, (2400, 1200), interpolation=cv2.INTER_CUBIC), np.uint8)


def view(x: float, y: float = 300.0) -> Image:
    """The ground from above, its upper left corner there."""
    left, top = round(x), round(y)
    return np.ascontiguousarray(GROUND[top : top + HEIGHT, left : left + WIDTH])


def flight(seconds: float, begin_s: float = 0.0) -> Iterator[Image]:
    """Straight on at SPEED."""
    return (view(100 + SPEED * (begin_s + k / RATE)) for k in range(round(seconds * RATE)))


def interlaced(seconds: float) -> Iterator[Image]:
    """The same, the lines of the second field half a picture later."""
    for k in range(round(seconds * RATE)):
        picture, later = view(100 + SPEED * k / RATE), view(100 + SPEED * (k + 0.5) / RATE)
        picture[1::2] = later[1::2]
        yield picture


def write_film(
    path: Path,
    pictures: Iterable[Image],
    *,
    codec: str = "libx264",
    options: Mapping[str, str] = X264,
    pix_fmt: str = "yuv420p",
    stamps_ms: Sequence[int] | None = None,
    clockwise_deg: int = 0,
    aspect: Fraction | None = None,
    metadata: Mapping[str, str] | None = None,
    klv: Sequence[tuple[float, bytes]] = (),
    container: Mapping[str, str] | None = None,
) -> Path:
    """Encode pictures, at RATE or these times; `klv`: packets of metadata with their times in seconds (TS alone)."""
    with av.open(str(path), "w", options=dict(container or {})) as out:
        out.metadata.update(metadata or {})
        stream = out.add_stream(codec, rate=RATE, options=dict(options))
        assert isinstance(stream, av.VideoStream)
        stream.pix_fmt = pix_fmt
        if stamps_ms is not None:
            stream.time_base = stream.codec_context.time_base = Fraction(1, 1000)
        told = out.add_data_stream("klv") if klv else None
        if clockwise_deg:
            stream.set_display_rotation(-clockwise_deg)
        for at, picture in enumerate(pictures):
            if at == 0:
                stream.height, stream.width = picture.shape[:2]
                if aspect is not None:
                    stream.codec_context.sample_aspect_ratio = aspect
            frame = av.VideoFrame.from_ndarray(picture, format="bgr24")
            frame.pts = round(1000 * at / RATE) if stamps_ms is None else stamps_ms[at]
            frame.time_base = Fraction(1, 1000)
            out.mux(stream.encode(frame))
            out.mux([_packet(told, *one) for one in klv if round(one[0] * RATE) == at])
        out.mux(stream.encode())
    return path


def _packet(stream: Any, seconds: float, data: bytes) -> av.Packet:  # type: ignore[type-arg]
    packet = av.Packet(data)
    packet.stream, packet.time_base = stream, Fraction(1, 90_000)
    packet.pts = packet.dts = round(seconds * 90_000)
    return packet


def sound(path: Path) -> Path:
    """A file with sound alone."""
    with av.open(str(path), "w") as out:
        stream = out.add_stream("aac", rate=48_000)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 48_000), np.float32), format="flt", layout="mono")
        frame.sample_rate, frame.pts = 48_000, 0
        out.mux(stream.encode(frame))
        out.mux(stream.encode())
    return path


def klv_packet(utc: float, latitude_deg: float, longitude_deg: float, altitude_m: float) -> bytes:
    """A local set of MISB ST 0601."""
    values = {
        2: round(utc * 1e6).to_bytes(8),
        13: struct.pack(">i", round(latitude_deg / 90 * (2**31 - 1))),
        14: struct.pack(">i", round(longitude_deg / 180 * (2**31 - 1))),
        15: round((altitude_m + 900) / 19900 * 65535).to_bytes(2),
    }
    body = b"".join(bytes([tag, len(value)]) + value for tag, value in values.items()) + bytes([1, 2])
    head = KEY + bytes([0x81, len(body) + 2]) + body
    return head + checksum(head).to_bytes(2)


def place(seconds: float) -> tuple[float, float]:
    """Latitude and longitude of the flight: a pixel of the ground is half a metre, and it flies east."""
    east_m = 0.5 * SPEED * seconds
    return LATITUDE, LONGITUDE + east_m / (111_320 * np.cos(np.radians(LATITUDE)))


def told(path: Path, go_on: GoOn | None = None, **settings: str) -> list[Told | str]:
    """What the process that reads it would tell."""
    return list(extract(path, StreamSettings(**settings), MOST_PIXELS, go_on))  # type: ignore[arg-type]


def chosen(path: Path, go_on: GoOn | None = None, **settings: str) -> list[ChosenPicture]:
    return [one for one in told(path, go_on, **settings) if isinstance(one, ChosenPicture)]


def the_end(path: Path) -> ReadToTheEnd:
    return next(one for one in told(path) if isinstance(one, ReadToTheEnd))


def picture_of(one: ChosenPicture) -> Image:
    found = cv2.imdecode(np.frombuffer(one.jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert found is not None
    return np.asarray(found, np.uint8)


def difference(one: Image, other: Image) -> float:
    """Mean absolute difference, in counts."""
    return float(np.abs(one.astype(int) - other).mean())


def reading(path: Path, known: Known | None = None) -> VideoReading:
    return VideoReading(looks_in(path, videos_too=True)[0][0], StreamSettings(), MOST_PIXELS, known or {})


def survey_place(seconds: float) -> tuple[float, float]:
    """Two legs over the ground, 150 px a second: east, a step south, and back; upper left corners."""
    along = 150 * seconds
    legs = ((700.0, (1.0, 0.0)), (150.0, (0.0, 1.0)), (700.0, (-1.0, 0.0)))
    x, y = 200.0, 300.0
    for length, (right, down) in legs:
        part = min(max(along, 0.0), length)
        x, y, along = x + right * part, y + down * part, along - length
    return x, y


SURVEY_S = 10.0


def write_survey(path: Path, codec: str = "libx264") -> Path:
    """A video of it, and subtitles as DJI writes them: a pixel is half a metre, and what is down in the picture is south."""
    write_film(path, (view(*survey_place(k / RATE)) for k in range(round(SURVEY_S * RATE))), codec=codec)
    path.with_suffix(".SRT").write_text("".join(_cue(k) for k in range(round(SURVEY_S * 5))), encoding="utf-8")
    return path


def _cue(k: int) -> str:
    x, y = survey_place(k / 5)
    longitude = LONGITUDE + 0.5 * x / (111_320 * np.cos(np.radians(LATITUDE)))
    begin, end = (f"00:00:{ms // 1000:02},{ms % 1000:03}" for ms in (200 * k, 200 * k + 200))
    place = (
        f"[latitude: {LATITUDE - 0.5 * y / 111_320:.7f}] [longitude: {longitude:.7f}] [rel_alt: 50.0 abs_alt: 480.0]"
    )
    return f'{k + 1}\n{begin} --> {end}\n<font size="28">{place} </font>\n\n'
