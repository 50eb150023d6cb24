"""Which pictures are damaged: a picture with a fault in it, and all that are made from it, until a whole one comes."""

from __future__ import annotations

from collections.abc import Iterable

# What the decoders and the depacketiser of FFmpeg say when they had to make something up. Over TCP they say none of it.
_RECEIVER = "rtsp"
_DECODERS = ("h264", "hevc")
_LOST_WORDS = ("missed", "bad cseq")


def tells_of_damage(log: Iterable[tuple[int, str, str]]) -> bool:
    """Whether warnings (level, component, text) mean that a picture is not what was sent.

    A decoder's flags are not enough: H.265 with a missing packet decodes to a torn picture without any.
    """
    return any(
        name in _DECODERS or (name == _RECEIVER and any(word in text for word in _LOST_WORDS)) for _, name, text in log
    )


class DamageWatch:
    """Told of one picture after the other; begins as damaged, since a stream may be joined between two key frames."""

    def __init__(self) -> None:
        self._tainted = True
        self._fault_before = False

    def is_damaged(self, *, fault: bool, key: bool) -> bool:
        """Whether a picture is damaged. `fault`: something went wrong since the picture before; `key`: it stands alone.

        A fault just before a key frame may already be the key frame's own: its first packet ends the picture before.
        """
        if fault:
            self._tainted = True
        elif key and not self._fault_before:
            self._tainted = False
        self._fault_before = fault
        return self._tainted
