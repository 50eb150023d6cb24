"""Loaded by workers of the tests (`distributed.worker.preload`): kills one in every stage, and all at a poisonous frame.

The folder that SABOTAGE names tells what to do: `stages` is there if workers are to be killed, and each stage leaves a file once
it has killed one; `poison` holds the name of a frame.
"""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import Any

from distributed import Worker, WorkerPlugin

from gcs_mosaic.archive import features
from gcs_mosaic.archive.features import frame_at
from gcs_mosaic.archive.sources import SourceFile
from gcs_mosaic.messages import Frame


class Saboteur(WorkerPlugin):  # type: ignore[misc]  # Dask is not typed
    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def transition(self, key: Any, start: str, finish: str, **more: Any) -> None:
        if finish != "executing":
            return
        try:
            (self._folder / str(key).partition("-")[0]).touch(exist_ok=False)
        except FileExistsError:
            return
        os.kill(os.getpid(), signal.SIGKILL)


async def dask_setup(worker: Worker) -> None:
    folder = Path(os.environ["SABOTAGE"])
    if (folder / "stages").exists():
        await worker.plugin_add(Saboteur(folder))
    if (folder / "poison").exists():
        poison = (folder / "poison").read_text()

        def deadly(file: SourceFile, digest: str) -> Frame:
            if file.name.endswith(poison):
                os.kill(os.getpid(), signal.SIGKILL)
            return frame_at(file, digest)

        vars(features)["frame_at"] = deadly
