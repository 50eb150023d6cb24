"""Packages that only some commands need, and that may be missing."""

from __future__ import annotations

from importlib.util import find_spec

from gcs_mosaic.errors import UsageError

CLUSTER = ("dask", "distributed", "cryptography")


def need_cluster() -> None:
    """Raises UsageError if a cluster cannot be used."""
    missing = [name for name in CLUSTER if find_spec(name) is None]
    if missing:
        raise UsageError(f"reprocess needs the packages {' and '.join(missing)}: pip install 'gcs-mosaic[cluster]'")
