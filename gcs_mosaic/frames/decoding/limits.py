"""What decoding a picture may cost: pixels, memory, computing time."""

from __future__ import annotations

import contextlib
import os
from dataclasses import dataclass
from pathlib import Path

from gcs_mosaic.frames.structure import Whole

MB = 10**6
FREE_OF_EXTRA_MB = 100.0  # of pixels: a Raspberry Pi decodes these in half of `cpu_s`
# Of a picture, at most, at one time: the decoder's, a converted one, the shared one, that of the main process.
COPIES = 4
COEFFICIENT_BYTES = 8  # a pixel: those of a progressive JPEG of four components are kept until the last scan
SLACK_BYTES = 128 * MB  # for libraries' own tables, and for what the allocator has not given back
CGROUP_LIMIT = Path("/sys/fs/cgroup/memory.max")


@dataclass(frozen=True, slots=True, kw_only=True)
class DecodeSettings:
    """Limits of decoding a frame. A frame that exceeds one is refused; those behind it go on."""

    cpu_s: float = 4.0
    """Computing time for a picture of up to 100 MB of pixels (33 megapixels in colour), in proportion for larger ones: ten
    times what a laptop needs, twice what a Raspberry Pi needs. Not wall time: a machine that is busy, or asleep, refuses
    nothing."""
    wall_s: float = 60.0
    """Wall time, as a last resort, after which a frame is tried once more, in a new process."""
    any_pixels: int = 100_000_000
    """Up to this size frames are always decoded, if the memory allows it, whatever came before."""
    most_growth: float = 4.0
    """Above it, a frame has at most this many times the pixels of the largest one so far; the first may have any size."""
    memory_share: float = 0.5
    """Share of the machine's memory that one frame may need."""


@dataclass(frozen=True, slots=True)
class Allowance:
    """What a worker may use for one picture, beyond what it had before."""

    cpu_s: float
    memory_bytes: int


def picture_bytes(whole: Whole) -> int:
    """Of its pixels at full size."""
    return whole.width * whole.height * whole.bands * -(-whole.bits // 8)


def allowance(whole: Whole, file_bytes: int, settings: DecodeSettings) -> Allowance:
    """For a file with this header; one in doubt is decoded twice."""
    pixels, times = picture_bytes(whole), 2 if whole.doubt else 1
    memory = (COPIES + times - 1) * pixels + COEFFICIENT_BYTES * whole.width * whole.height
    cpu_s = settings.cpu_s * max(1.0, pixels / (FREE_OF_EXTRA_MB * MB))
    return Allowance(times * cpu_s, memory + 2 * times * file_bytes + SLACK_BYTES)


def refusal(whole: Whole, largest: int, memory_bytes: int | None, settings: DecodeSettings) -> str | None:
    """Why a picture is not decoded at all, if so. `largest`: pixels of the largest frame so far, 0 before the first;
    `memory_bytes`: of this machine, if known."""
    size, pixels = f"{whole.width} x {whole.height} pixels", whole.width * whole.height
    most = max(settings.any_pixels, settings.most_growth * largest)
    if largest and pixels > most:
        return f"{size}, more than {settings.most_growth:g} times the largest frame so far"
    needed = COPIES * picture_bytes(whole)
    if memory_bytes is not None and needed > settings.memory_share * memory_bytes:
        return f"{size} need {needed / 1e9:.1f} GB of memory, this machine has {memory_bytes / 1e9:.1f} GB"
    return None


def machine_memory() -> int | None:
    """Bytes of memory that this machine, or the container that the program runs in, has; None if it does not say."""
    if not hasattr(os, "sysconf") or "SC_PHYS_PAGES" not in os.sysconf_names:
        return None
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    with contextlib.suppress(FileNotFoundError, ValueError):  # there is no such limit, or it is "max"
        memory = min(memory, int(CGROUP_LIMIT.read_text()))
    return memory
