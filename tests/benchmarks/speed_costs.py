"""What a frame of a stitch costs, in floors: the whole command by the clock and on all cores, and each stage on all cores.

The command runs as anybody starts it, its start and its final painting included. For the stages the same pipeline runs once
more with nothing ahead, so that what the process uses meanwhile is the stage's own; the processes that decode and adjust are
added to theirs. Linux only, as it reads /proc.
"""

from __future__ import annotations

import logging
import os
import resource
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np

from gcs_mosaic.app.machine import share_heap
from gcs_mosaic.app.pipeline.driver import Driver
from gcs_mosaic.app.pipeline.pipeline import Pipeline
from gcs_mosaic.app.waiting.prefetch import prepare
from gcs_mosaic.config.tree import Config
from gcs_mosaic.frames.directory import frames_in
from gcs_mosaic.messages import Frame
from gcs_mosaic.store import stages
from tests.benchmarks import start
from tests.benchmarks.floors import Floor, floor_of
from tests.benchmarks.processes import Watched, cpu_of, family

WITHIN = {"encode"}  # stages that run within others
PROCESSES = {"frames.decoding.worker": "decode", "stitch.bundle.worker": "adjust"}  # whose work they do


@dataclass(frozen=True, slots=True)
class Work:
    """What is to be measured once."""

    pictures: tuple[Path, ...]
    scale: float


@dataclass(frozen=True, slots=True)
class Costs:
    """Of a frame, in floors. `floor_s`: its seconds by the clock; `wall`, `cpu`, `resident_mb`: of the whole command."""

    floor_s: float
    wall: float
    cpu: float
    resident_mb: float
    stages: dict[str, float] = field(default_factory=dict)


def measured(work: Work) -> Costs:
    """Meant for a process of its own."""
    share_heap()
    config = Config(scale=work.scale)
    with TemporaryDirectory() as scratch:
        wall_s, cpu_s, resident_mb = _of_command(work, Path(scratch) / "command")
        by_stage = _of_stages(work.pictures, Path(scratch) / "stages", config)
        floor = floor_of(Path(scratch) / "stages", config)
    return in_floors(floor, len(work.pictures), wall_s, cpu_s, resident_mb, by_stage)


def in_floors(
    floor: Floor, frames: int, wall_s: float, cpu_s: float, resident_mb: float, by_stage: dict[str, float]
) -> Costs:
    """Seconds of all frames as floors of one: time by the clock as such, and that of the processor likewise."""
    each = {name: seconds / frames / floor.cpu for name, seconds in by_stage.items()}
    return Costs(floor.all, wall_s / frames / floor.all, cpu_s / frames / floor.cpu, resident_mb, each)


def _of_command(work: Work, out: Path) -> tuple[float, float, float]:
    """Seconds by the clock and of all cores, and the memory of all its processes, MB."""
    words = ["stitch", *map(str, work.pictures), "--out", str(out), "--scale", str(work.scale)]
    begun, before = time.monotonic(), _cpu_of_ended()
    process = subprocess.Popen(
        [sys.executable, "-m", "gcs_mosaic", *words], stdout=subprocess.DEVNULL, env=start.environment()
    )
    with Watched(process.pid) as watched:
        assert process.wait() == 0, "the command ends well"
        wall_s = time.monotonic() - begun
    return wall_s, _cpu_of_ended() - before, watched.resident_mb


def _cpu_of_ended() -> float:
    """Of all processes below this one that were waited for."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


class _Heard(logging.Handler):
    """Adds up the CPU seconds that stages log, by their names."""

    def __init__(self) -> None:
        super().__init__(logging.DEBUG)
        self.cpu_s: dict[str, float] = defaultdict(float)

    def emit(self, record: logging.LogRecord) -> None:
        assert isinstance(record.args, tuple)
        name, _, _, cpu, *_ = record.args
        if name not in WITHIN:
            self.cpu_s[str(name)] += float(str(cpu))


def _of_stages(pictures: Sequence[Path], out: Path, config: Config) -> dict[str, float]:
    """CPU seconds of each stage, all frames and the final painting together."""
    out.mkdir()
    linking, heard = replace(config, originals=replace(config.originals, keep="link")), _Heard()
    pipeline = Pipeline(out, linking, lambda notice: None, punctual=True, paint_live=False)
    stages.logger.addHandler(heard)
    stages.logger.setLevel(logging.DEBUG)
    with closing(pipeline):
        driver, decoding = Driver(pipeline), (pipeline.features_of, config.reduction, pipeline.feature_pixels)
        _begin(pipeline)
        before = _of_processes()
        for item in frames_in(pictures, config.frames).frames:
            frame = driver.accept(item) if isinstance(item, Frame) else None
            if frame is not None:
                driver.process(prepare(frame, *decoding, load=pipeline.decoders.load_frame))
        for _ in driver.finish():
            pass
        for stage, seconds in _of_processes().items():
            heard.cpu_s[stage] += seconds - before.get(stage, 0.0)
    return dict(heard.cpu_s)


def _begin(pipeline: Pipeline) -> None:
    """Let the process that decodes be there before the first frame: its start is no decoding."""
    small = cv2.imencode(".png", np.zeros((64, 64, 3), np.uint8))[1].tobytes()
    pipeline.decoders.decode(small, "the first")


def _of_processes() -> dict[str, float]:
    """CPU seconds of the processes that do a stage's work, by stage."""
    used: dict[str, float] = defaultdict(float)
    for process in family(os.getpid())[1:]:
        with suppress(OSError):
            command = Path(f"/proc/{process}/cmdline").read_text()
            for module, stage in PROCESSES.items():
                if module in command:
                    used[stage] += cpu_of(process)
    return used
