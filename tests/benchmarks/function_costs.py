"""Which functions a stitch spends its computing time in: python -m tests.benchmarks.function_costs FOLDER [--most 25]

The command `stitch`, in this process, with a clock around the functions named in `WATCHED`. Printed for each frame: calls, and
milliseconds of the thread that called, so that other programs and waiting do not count. What one of them calls is in its figure,
too. Pictures that processes of their own decode are told by themselves, and so is all that was computed.
"""

from __future__ import annotations

import argparse
import importlib
import os
import sys
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Callable
from dataclasses import fields, replace
from functools import wraps
from pathlib import Path
from shutil import copyfile
from tempfile import TemporaryDirectory
from typing import Any

WATCHED = (
    "stitch.features.extraction:extract",
    "stitch.mosaic:Mosaic.place",
    "stitch.registration.registration:register",
    "stitch.features.matching:match",
    "stitch.registration.by_pixels:proved_by_pixels",
    "stitch.bundle.island:resect",
    "stitch.bundle.island:adjusted",
    "stitch.mapping.covering:Covering.look",
    "render.brightness:Brightness.settled",
    "render.brightness:Brightness.final",
    "render.seams:look_for_seams",
    "render.frame_warp:frame_warp",
    "render.seams:see",
    "render.territory:Territory.lay_over",
    "render.territory:Territory.lay_anew",
    "render.territory:Territory.settle",
    "render.whole_things:as_wholes",
    "render.pixels:piece",
    "render.warp:warped",
    "render.pixels:_lit",
    "frames.decode:decode_whole",
    "store.tiles:write_tile",
    "store.tiles:encode_jpeg",
    "store.disk:write_beside",
)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.function_costs", allow_abbrev=False)
    parser.add_argument("folder", type=Path, help="frames of a flight")
    parser.add_argument("--most", type=int, help="frames; all if not given")
    given = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the program has it; before numpy is loaded
    from tests.benchmarks.flown_live import pictures_in

    pictures = pictures_in(given.folder, given.most)
    watch = Watch()
    before = os.times()
    with TemporaryDirectory(prefix="costs-") as home:
        stitched(pictures, Path(home), watch)
    spent = [now - then for now, then in zip(os.times()[:4], before[:4], strict=True)]
    print(f"{len(pictures)} frames, {sum(spent) / len(pictures) * 1000:.0f} ms each, start included,")
    print(
        f"of which {sum(spent[2:]) / len(pictures) * 1000:.0f} ms in processes that decode; milliseconds, calls, function:"
    )
    for name, seconds in sorted(watch.seconds.items(), key=lambda one: -one[1]):
        print(f"{seconds / len(pictures) * 1000:8.1f} {watch.calls[name] / len(pictures):8.1f}  {name}")
    return 0


class Watch:
    """Seconds of the calling threads, and calls, by function."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self.calls: Counter[str] = Counter()
        self._lock = threading.Lock()

    def around(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(function)
        def timed(*given: Any, **named: Any) -> Any:
            began = time.thread_time()
            try:
                return function(*given, **named)
            finally:
                with self._lock:
                    self.seconds[name] += time.thread_time() - began
                    self.calls[name] += 1

        return timed


def stitched(pictures: list[Path], home: Path, watch: Watch) -> None:
    from gcs_mosaic.app.commands import batch  # all modules that are watched are loaded with it
    from gcs_mosaic.app.machine import share_heap
    from gcs_mosaic.cli.main import main as command_line

    assert batch
    share_heap()
    frames = home / "frames"
    frames.mkdir()
    for one in pictures:
        copyfile(one, frames / one.name)
    for name in WATCHED:
        put_around(name, watch)
    arguments, sys.argv = sys.argv, ["gcs-mosaic", "stitch", str(frames), "--out", str(home / "map")]
    try:
        command_line()
    finally:
        sys.argv = arguments


def put_around(name: str, watch: Watch) -> None:
    """Watch a function wherever a module, or a blend mode, has it."""
    from gcs_mosaic.render.blend_modes import MODES

    module, path = name.split(":")
    *holders, last = path.split(".")
    holder: Any = importlib.import_module(f"gcs_mosaic.{module}")
    for one in holders:
        holder = getattr(holder, one)
    function = getattr(holder, last)
    timed = watch.around(name, function)
    setattr(holder, last, timed)
    for loaded in [one for key, one in sys.modules.items() if key.startswith("gcs_mosaic")]:
        for known in [key for key, value in vars(loaded).items() if value is function]:
            setattr(loaded, known, timed)
    for key, mode in MODES.items():
        of_mode: dict[str, Any] = {one.name: timed for one in fields(mode) if getattr(mode, one.name) is function}
        MODES[key] = replace(mode, **of_mode)


if __name__ == "__main__":
    sys.exit(main())
