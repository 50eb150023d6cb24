"""`python -m gcs_mosaic`."""

import sys

from gcs_mosaic.cli import main

sys.exit(main())
