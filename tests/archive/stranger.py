"""Loaded by workers of the tests (`distributed.worker.preload`): makes one that is not as the client is, as STRANGER says."""

from __future__ import annotations

import os
import sys

import numpy as np
from distributed import Worker


def dask_setup(worker: Worker) -> None:
    if os.environ["STRANGER"] == "older":
        vars(np)["__version__"] = "1.0"
    else:
        for name in [name for name in sys.modules if name.partition(".")[0] == "gcs_mosaic"]:
            del sys.modules[name]
        sys.modules["gcs_mosaic"] = None  # type: ignore[assignment]  # as if it were not installed
