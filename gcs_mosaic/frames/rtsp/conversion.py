"""Pixels of PyAV's pictures, converted by as few of FFmpeg's scalers as there are formats.

A picture that is asked for its pixels makes a scaler of its own, whose threads live for as long as the garbage collector lets
them: hundreds of threads, and gigabytes of address space for their stacks.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from av.video.frame import VideoFrame
from av.video.reformatter import VideoReformatter
from numpy.typing import NDArray


class Converter:
    """For pictures of one source; to be used by one thread at a time."""

    def __init__(self) -> None:
        self._by_format: dict[str, VideoReformatter] = {}

    def picture(self, video: VideoFrame) -> ConvertedPicture:
        """The picture, to be converted by this."""
        return ConvertedPicture(video, self)

    def array(self, video: VideoFrame, form: str) -> NDArray[Any]:
        """The pixels in a format of FFmpeg's, such as gray and bgr24."""
        reformatter = self._by_format.setdefault(form, VideoReformatter())
        return reformatter.reformat(video, format=form).to_ndarray()


class ConvertedPicture:
    """A `ring_buffer.VideoPicture`."""

    def __init__(self, video: VideoFrame, converter: Converter) -> None:
        self._video, self._converter = video, converter
        self.width, self.height = video.width, video.height

    def to_ndarray(self, *, format: str) -> NDArray[Any]:
        """The pixels in that format."""
        return self._converter.array(self._video, format)

    def luma(self) -> NDArray[np.uint8]:
        """(height, width) bytes of the first plane, unconverted and not copied: only to be compared with others of the stream."""
        plane = self._video.planes[0]
        data = np.asarray(memoryview(plane), np.uint8)
        return data.reshape(plane.height, plane.line_size)[:, : self.width]
