"""Detection of damaged images: one with a fault, and all predicted from it, until the next intact key frame."""

from __future__ import annotations

from collections.abc import Iterable

# Messages of FFmpeg's decoders and depacketiser when they conceal missing data. Over TCP there are none.
_RECEIVER = "rtsp"
_DECODERS = ("h264", "hevc")
_LOST_WORDS = ("missed", "bad cseq")


def tells_of_damage(log: Iterable[tuple[int, str, str]]) -> bool:
    """Whether warnings (level, component, text) mean that an image differs from what was sent.

    A decoder's flags are not enough: H.265 with a missing packet decodes to a torn image without any flag set.
    """
    return any(
        name in _DECODERS or (name == _RECEIVER and any(word in text for word in _LOST_WORDS)) for _, name, text in log
    )


class DamageWatch:
    """Tracks damage from image to image; starts as damaged, because a stream may be joined between two key frames."""

    def __init__(self) -> None:
        self._tainted = True
        self._fault_before = False

    def is_damaged(self, *, fault: bool, key: bool) -> bool:
        """Whether an image is damaged. `fault`: an error since the previous image; `key`: the image is a key frame.

        A fault just before a key frame may belong to the key frame: its first packet completes the previous image.
        """
        if fault:
            self._tainted = True
        elif key and not self._fault_before:
            self._tainted = False
        self._fault_before = fault
        return self._tainted
