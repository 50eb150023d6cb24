"""One connection to a camera: packets in, timestamped images out."""

from __future__ import annotations

import struct
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from statistics import median
from typing import TypeAlias

import av
import av.error
import av.logging
from av.container import InputContainer
from av.packet import Packet
from av.video.stream import VideoStream

from gcs_mosaic.frames.rtsp.address import StreamAddress
from gcs_mosaic.frames.rtsp.clock import CaptureClock
from gcs_mosaic.frames.rtsp.conversion import Converter
from gcs_mosaic.frames.rtsp.packet_loss import DamageWatch, tells_of_damage
from gcs_mosaic.frames.rtsp.redirect import final_address, followed_elsewhere
from gcs_mosaic.frames.rtsp.ring_buffer import StreamPicture
from gcs_mosaic.frames.rtsp.settings import StreamSettings

Log: TypeAlias = list[tuple[int, str, str]]

LOGIN_WANTED = "it wants a login, or another one: --rtsp rtsp://NAME:PASSWORD@HOST:554/PATH"
_PAUSES = 3.0  # usual intervals without an image: a slow stream is not a broken one
_INTERVALS = 31
_OPTIONS = {
    "allowed_media_types": "video",  # with audio, image times jump at the first sender report
    "analyzeduration": "200000",
    "probesize": "200000",
    "fpsprobesize": "0",  # the frame rate is not needed, and probing it takes two seconds
    "flags": "low_delay",
    "max_delay": "100000",  # microseconds to wait for a UDP packet
    "protocol_whitelist": "rtsp,rtsps,rtp,srtp,tcp,udp,tls,crypto",  # a camera must not redirect us to files
}


@dataclass(frozen=True, slots=True)
class NotConnected:
    """Why there is no stream (any more); contains no part of the address."""

    reason: str


class Connection:
    """An open stream. `log` is where PyAV collects FFmpeg's messages of this thread; it is emptied here."""

    def __init__(
        self, address: StreamAddress, container: InputContainer, video: VideoStream, settings: StreamSettings, log: Log
    ) -> None:
        self.address = address
        self.paused_s: float | None = None
        """Length in seconds of an unusually long gap before the newest image."""
        self.longest_pause_s = settings.gap_s
        """A longer one between two images is unusual."""
        self._container, self._video, self._settings, self._log = container, video, settings, log
        self._packets: Iterator[Packet[VideoStream]] = container.demux(video)
        self._watch, self._converter = DamageWatch(), Converter()
        self._fault = False
        self._clock = self._new_clock()
        self._last: tuple[float, float] | None = None  # timestamp and arrival of the newest image
        self._intervals: deque[float] = deque(maxlen=_INTERVALS)

    @classmethod
    def open(cls, address: StreamAddress, settings: StreamSettings, log: Log) -> Connection | NotConnected:
        """Connect; takes as long as the settings allow."""
        final = final_address(address, settings.allowed_hosts, settings.open_timeout_s)
        if isinstance(final, str):
            return NotConnected(final)
        av.logging.set_level(av.logging.INFO)  # at which redirects are logged
        av.logging.set_skip_repeated(False)  # a second lost packet is as bad as the first
        timeout = (settings.open_timeout_s, settings.read_timeout_s)
        options = _OPTIONS | {"rtsp_transport": settings.transport}
        try:
            container = av.open(final.url, format="rtsp", options=options, timeout=timeout)
        except (av.error.FFmpegError, OSError, ValueError, MemoryError) as error:
            return NotConnected(_left_for(address, settings, log) or _reason(error))
        finally:
            av.logging.set_level(av.logging.WARNING)
        if elsewhere := _left_for(address, settings, log):
            container.close()
            return NotConnected(elsewhere)
        log[:] = [one for one in log if one[0] <= av.logging.WARNING]
        if not container.streams.video:
            container.close()
            return NotConnected("it has no video")
        video = container.streams.video[0]
        if video.codec_context is None:
            container.close()
            return NotConnected("its video is of a kind that cannot be decoded")
        # With one thread, log messages belong to the current image, and no images are delayed.
        video.codec_context.thread_type = "NONE"
        return cls(address, container, video, settings, log)

    @property
    def described(self) -> str:
        """Codec, size and transport, for display."""
        codec = {"h264": "H.264", "hevc": "H.265"}.get(self._video.codec_context.name, self._video.codec_context.name)
        return f"{codec}, {self._video.width} x {self._video.height}, over {self._settings.transport.upper()}"

    def read(self) -> list[StreamPicture] | NotConnected:
        """The images in the next packet: one, or none."""
        self.paused_s = None
        try:
            packet = next(self._packets, None)
        except (av.error.FFmpegError, OSError, ValueError, MemoryError) as error:
            return NotConnected(_reason(error))
        # The final empty packet would flush the decoder, returning images from long ago.
        if packet is None or not packet.size:
            return NotConnected("the camera ended it")
        arrival, arrival_utc = time.monotonic(), time.time()
        self._fault |= packet.is_corrupt
        pictures = self._decode(packet, arrival)
        if packet.pts is not None:
            picture_s = float(packet.pts * packet.time_base)
            self._clock.note(picture_s, arrival, arrival_utc, _camera_utc(packet))
        return pictures

    def close(self) -> None:
        self._container.close()

    def _decode(self, packet: Packet[VideoStream], arrival: float) -> list[StreamPicture]:
        try:
            frames = packet.decode()
        except (av.error.FFmpegError, ValueError, MemoryError):
            frames, self._fault = [], True
        self._fault |= tells_of_damage(self._log)
        self._log.clear()
        pictures = []
        for frame in frames:
            damaged = self._watch.is_damaged(fault=self._fault or frame.is_corrupt, key=frame.key_frame)
            self._fault = False
            if frame.pts is not None and frame.time_base is not None:
                picture_s = float(frame.pts * frame.time_base)
                self._follow(picture_s, arrival)
                pictures.append(StreamPicture(self._converter.picture(frame), picture_s, self._clock, damaged))
        return pictures

    def _follow(self, picture_s: float, arrival: float) -> None:
        """Start a new clock if the image times or their arrivals jump."""
        if self._last is not None:
            step_s, pause_s = picture_s - self._last[0], arrival - self._last[1]
            # Of the first two pictures a slow stream's interval is the same by both clocks, a gap on the way is not.
            usual_s = median(self._intervals) if self._intervals else min(step_s, pause_s)
            longest_s = self.longest_pause_s = max(self._settings.gap_s, _PAUSES * usual_s)
            if pause_s > longest_s:
                self.paused_s = pause_s
            if pause_s > longest_s or step_s <= 0 or step_s > pause_s + longest_s:
                self._clock = self._new_clock()
            else:
                self._intervals.append(step_s)
        self._last = (picture_s, arrival)

    def _new_clock(self) -> CaptureClock:
        return CaptureClock(time.monotonic(), self._settings.latency_s)


def _left_for(address: StreamAddress, settings: StreamSettings, log: Log) -> str | None:
    """Why not to stay where FFmpeg was redirected to, by its log."""
    return followed_elsewhere((text for _, _, text in log), address, settings.allowed_hosts)


def _camera_utc(packet: Packet[VideoStream]) -> float | None:
    """The camera's capture time: FFmpeg's AVProducerReferenceTime, microseconds since 1970."""
    for data in packet.iter_sidedata():
        if data.data_type == "prft" and data.data_size >= 8:
            return float(struct.unpack("=q", bytes(data)[:8])[0] / 1e6)
    return None


def _reason(error: BaseException) -> str:
    """The cause, without the address that FFmpeg puts into its messages."""
    if isinstance(error, av.error.ExitError):
        return "no answer in time"
    if isinstance(error, av.error.HTTPUnauthorizedError):
        return LOGIN_WANTED
    return getattr(error, "strerror", None) or type(error).__name__
