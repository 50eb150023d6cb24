"""The program `gcs-mosaic`, also `python -m gcs_mosaic`: what is to be set before anything is loaded, then the command line."""

import os
import sys

from gcs_mosaic.app.heap import share_heap


def main() -> int:
    """Run the program; returns its exit code."""
    share_heap()
    # numpy reads it when it is loaded. Threads of one product that wait for each other take a third of all the time of a
    # flight; what is to go on side by side has threads of its own.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from gcs_mosaic.cli.main import main as command_line

    return command_line()


if __name__ == "__main__":
    sys.exit(main())
