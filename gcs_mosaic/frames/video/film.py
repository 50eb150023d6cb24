"""A recorded video: opened with limits, decoded to pictures in the order of their times."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import av
import av.error
import av.filter
from av.codec.context import ThreadType
from av.container import InputContainer
from av.stream import Disposition
from av.video.frame import VideoFrame
from av.video.stream import VideoStream

from gcs_mosaic.frames.video.described import ENCRYPTED, Described, creation_utc, is_scrambled, no_video, unopened
from gcs_mosaic.frames.video.klv import PlatformReport, read_klv
from gcs_mosaic.frames.video.upright import Orientation, of_degrees, of_matrix

FORMATS = "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,mpegts,mpeg,avi"  # no playlists: they name other files and hosts
CODECS = {
    *(
        "h264",
        "hevc",
        "mpeg2video",
        "mpeg1video",
        "mpeg4",
        "msmpeg4v3",
        "mjpeg",
        "av1",
        "libdav1d",
        "vp8",
        "vp9",
        "prores",
    ),
    *("dnxhd", "dvvideo", "ffv1", "h263", "libvpx-vp9", "libvpx"),
}
MOST_FAULTS = 2000  # packets in a row that bring no picture
TAINTED_S = 10.0  # after a fault, where no key frame ends it: cameras that refresh row by row have none
USUAL_STEP_S = 1 / 30  # where times jump back and nothing else is known
THREADS = 4


@dataclass(frozen=True, slots=True)
class FilmPicture:
    """A picture; `seconds` from the video's beginning, always more than the one before."""

    video: VideoFrame
    seconds: float
    damaged: bool
    orientation: Orientation


class Timeline:
    """Times from the beginning that never go back, of time stamps that may: recordings that were put one after another."""

    def __init__(self, first_s: float | None = None) -> None:
        self._offset = None if first_s is None else -first_s
        self._last: float | None = None
        self._step = USUAL_STEP_S

    def seconds(self, stamp_s: float | None) -> float:
        """Of the next picture; None for one without a time stamp."""
        if self._offset is None:
            self._offset = -(stamp_s or 0.0)
        now = None if stamp_s is None else stamp_s + self._offset
        if self._last is None:
            self._last = max(now or 0.0, 0.0)
            return self._last
        if now is None or now <= self._last:
            now = self._last + self._step
            self._offset = self._offset if stamp_s is None else now - stamp_s
        elif now - self._last < 1:
            self._step = now - self._last
        self._last = now
        return now

    def beside(self, stamp_s: float | None) -> float | None:
        """Of something else in the recording, such as a position."""
        return self._last if stamp_s is None or self._offset is None else stamp_s + self._offset


class Film:
    """An open video. `reports` are what its metadata told since they were last taken."""

    def __init__(self, container: InputContainer, video: VideoStream, described: Described) -> None:
        self._container, self._video, self.described = container, video, described
        self._told = [stream for stream in container.streams if stream.type == "data"]
        self._timeline = Timeline()
        self._deinterlacer: _Deinterlacer | None = None
        self._fault_s: float | None = None  # when the picture was last damaged, until a key frame
        self._is_faulty = False
        self.is_encrypted = False
        self.reports: list[tuple[float, PlatformReport]] = []

    @classmethod
    def open(cls, path: Path, max_pixels: int) -> Film | str:
        """Open a video, or tell in a sentence why it is none. `max_pixels`: width times height."""
        options = {"format_whitelist": FORMATS, "protocol_whitelist": "file"}
        try:
            container = av.open(f"file:{path.absolute()}", options=options, metadata_errors="replace")
        except (av.error.FFmpegError, OSError, ValueError) as error:
            return unopened(path, getattr(error, "strerror", None) or type(error).__name__)
        found = _picture_stream(container, path, max_pixels)
        if isinstance(found, str):
            container.close()
            return ENCRYPTED if container.format.name == "mpegts" and is_scrambled(path) else found
        context = found.codec_context
        context.thread_type, context.thread_count = ThreadType.AUTO, THREADS
        context.options = {"max_pixels": str(max_pixels)}
        return cls(container, found, _described(container, found))

    def seek(self, seconds: float) -> bool:
        """Go to a key frame before this time, as far as the file's time stamps are those of its beginning."""
        first = _first_stamp(self._video)
        try:
            self._container.seek(round((first + seconds) / float(self._video.time_base or 1)), stream=self._video)
        except (av.error.FFmpegError, OSError):
            return False
        self._timeline, self._deinterlacer = Timeline(first), None
        return True

    def pictures(self) -> Iterator[FilmPicture]:
        """All pictures from here on. Raises OSError when the file cannot be read on."""
        faults = 0
        for packet in self._container.demux(self._video, *self._told):
            if packet.stream is not self._video:
                self._hear(packet)
                continue
            if packet.has_sidedata("encryption_info"):
                self.is_encrypted = True
                return
            self._is_faulty |= packet.is_corrupt
            frames = self._decoded(packet)
            faults = 0 if frames else faults + 1
            if faults > MOST_FAULTS:
                return
            for frame in frames:
                yield self._dated(frame)

    def close(self) -> None:
        self._container.close()

    def _decoded(self, packet: Any) -> list[VideoFrame]:
        try:
            frames = list(packet.decode())
        except (av.error.FFmpegError, ValueError):
            self._is_faulty = True
            return []
        is_end = packet.size == 0
        if self._deinterlacer is None and any(frame.interlaced_frame for frame in frames):
            self._deinterlacer = _Deinterlacer()
        return frames if self._deinterlacer is None else self._deinterlacer.through(frames, is_end=is_end)

    def _dated(self, frame: VideoFrame) -> FilmPicture:
        stamp = None if frame.pts is None or frame.time_base is None else float(frame.pts * frame.time_base)
        seconds = self._timeline.seconds(stamp)
        if self._is_faulty or frame.is_corrupt:
            self._fault_s, self._is_faulty = seconds, False
        elif frame.key_frame or (self._fault_s is not None and seconds - self._fault_s > TAINTED_S):
            self._fault_s = None
        return FilmPicture(frame, seconds, self._fault_s is not None, _orientation(frame, self._video))

    def _hear(self, packet: Any) -> None:
        stamp = None if packet.pts is None else float(packet.pts * packet.time_base)
        seconds = self._timeline.beside(stamp)
        if packet.size and seconds is not None:
            self.reports += [(seconds, report) for report in read_klv(bytes(packet))]


def _picture_stream(container: InputContainer, path: Path, max_pixels: int) -> VideoStream | str:
    """The largest stream of moving pictures; or why there is none. Covers of music and thumbnails are none."""
    streams = [one for one in container.streams.video if not one.disposition & Disposition.attached_pic]
    if not streams:
        return no_video(path, [one.type for one in container.streams])
    known = [one for one in streams if one.codec_context is not None and one.codec_context.name in CODECS]
    if not known:
        names = {one.codec_context.name if one.codec_context else "none that is known" for one in streams}
        return f"its codec ({', '.join(sorted(names))}) cannot be read: convert it to H.264 or H.265"
    largest = max(known, key=lambda one: one.codec_context.width * one.codec_context.height)
    width, height = largest.codec_context.width, largest.codec_context.height
    if not width * height:
        return f"no picture in it can be decoded ({largest.codec_context.name} without a size)"
    if width * height > max_pixels:
        return f"{width} x {height} pixels, more than the limit of {max_pixels}"
    return largest


def _described(container: InputContainer, video: VideoStream) -> Described:
    context = video.codec_context
    duration = container.duration / 1e6 if container.duration and container.duration > 0 else None
    aspect = float(video.sample_aspect_ratio or 1)
    return Described(
        codec=context.name,
        width=context.width,
        height=context.height,
        duration_s=duration if duration is not None and math.isfinite(duration) else None,
        pixel_aspect=aspect if aspect > 0 else 1.0,
        utc=creation_utc([container.metadata, video.metadata]),
    )


def _first_stamp(video: VideoStream) -> float:
    return float((video.start_time or 0) * (video.time_base or 0))


def _orientation(frame: VideoFrame, video: VideoStream) -> Orientation:
    """By the picture's display matrix, else by the tag that older files have instead."""
    matrix: Any = frame.side_data.get("DISPLAYMATRIX")
    if matrix is not None and (found := of_matrix(bytes(matrix))):
        return found
    try:
        tags = {name.lower(): value for name, value in video.metadata.items()}
        return of_degrees(float(tags.get("rotate", "0")))
    except (ValueError, OverflowError):
        return Orientation()


class _Deinterlacer:
    """Both fields of a picture were taken at different times: one of the second's lines is made of its neighbours."""

    def __init__(self) -> None:
        self._graph: av.filter.Graph | None = None
        self._kind: tuple[int, int, str] | None = None

    def through(self, frames: list[VideoFrame], *, is_end: bool) -> list[VideoFrame]:
        """What is ready; at the end, the rest."""
        ready: list[VideoFrame] = []
        for frame in frames:
            kind = (frame.width, frame.height, frame.format.name)
            if self._graph is None or kind != self._kind:
                ready += self._rest()
                self._graph, self._kind = _graph(frame), kind
            self._graph.push(frame)
            ready += _pulled(self._graph)
        return ready + self._rest() if is_end else ready

    def _rest(self) -> list[VideoFrame]:
        if self._graph is None:
            return []
        self._graph.push(None)
        rest, self._graph = _pulled(self._graph), None
        return rest


def _graph(frame: VideoFrame) -> av.filter.Graph:
    graph = av.filter.Graph()
    source = graph.add_buffer(width=frame.width, height=frame.height, format=frame.format, time_base=frame.time_base)
    graph.link_nodes(
        source,
        graph.add("bwdif", "mode=send_frame:parity=auto:deint=interlaced"),
        graph.add("buffersink"),
    ).configure()
    return graph


def _pulled(graph: av.filter.Graph) -> list[VideoFrame]:
    pulled: list[VideoFrame] = []
    while True:
        try:
            frame = graph.pull()
        except (BlockingIOError, EOFError):
            return pulled
        if isinstance(frame, VideoFrame):
            pulled.append(frame)
