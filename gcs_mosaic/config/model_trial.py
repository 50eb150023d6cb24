"""A learned model's file is tried in a process of its own before a flight: some damaged files crash OpenCV, and the program."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from gcs_mosaic.errors import UsageError
from gcs_mosaic.processes.limits import limit_memory
from gcs_mosaic.stitch.features.learned import REMEDY, LearnedDetector, UnusableModel, model_bytes

PROGRAM = (sys.executable, "-P", "-m", "gcs_mosaic.config.model_trial")
LONGEST_S = 60.0  # XFeat takes half a second with the start of the process
MOST_BYTES = 2 << 30  # of address space beside the libraries'; XFeat needs 200 MB
REFUSED, NO_MEMORY = 3, 4  # exit codes; why it is refused is on stdout


def try_model(path: str) -> None:
    """Raises UsageError, in one sentence, if this file cannot be used as `stitch: {features: {model: FILE.onnx}}`."""
    where = "stitch: features: model"
    try:
        model = model_bytes(Path(path))
        tried = subprocess.run([*PROGRAM, path], input=model, capture_output=True, timeout=LONGEST_S, check=False)
    except UnusableModel as error:
        raise UsageError(f"{where}: {error}.") from None
    except subprocess.TimeoutExpired:
        raise UsageError(f"{where}: {path} takes more than {LONGEST_S:g} s for one picture; {REMEDY}.") from None
    if tried.returncode == REFUSED:
        raise UsageError(f"{where}: {tried.stdout.decode(errors='replace').strip()}.")
    if tried.returncode == NO_MEMORY:
        raise UsageError(f"{where}: {path} needs more than {MOST_BYTES >> 30} GB of memory; {REMEDY}.")
    if tried.returncode:
        raise UsageError(f"{where}: {path} crashes OpenCV, wanted is an undamaged ONNX model; {REMEDY}.")


def main() -> int:
    limit_memory(MOST_BYTES)
    try:
        LearnedDetector(sys.stdin.buffer.read(), sys.argv[1])
    except MemoryError:
        return NO_MEMORY
    except UnusableModel as error:
        sys.stdout.buffer.write(str(error).encode(errors="replace"))
        return REFUSED
    return 0


if __name__ == "__main__":
    sys.exit(main())
