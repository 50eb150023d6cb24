"""Entry point of `gcs-mosaic` and `python -m gcs_mosaic`: sets the environment before imports, then runs the command line."""

import os
import sys

from gcs_mosaic.app.machine import allow_more_files, share_heap
from gcs_mosaic.cli.streams import open_standard_streams


def main() -> int:
    """Run the program; returns the exit code."""
    open_standard_streams()
    share_heap()
    allow_more_files()
    # numpy reads it on import. BLAS threads waiting for each other within one product cost a third of a flight's total time;
    # parallel work has threads of its own.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from gcs_mosaic.cli.main import main as command_line

    return command_line()


if __name__ == "__main__":
    sys.exit(main())
