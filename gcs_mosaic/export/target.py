"""Where an export must not go: onto what a flight is made of, this one or another, by whatever way it is named."""

from __future__ import annotations

from pathlib import Path

from gcs_mosaic.errors import UsageError
from gcs_mosaic.store import inside
from gcs_mosaic.store.folder import LEDGER_NAME, WRITTEN_NAMES
from gcs_mosaic.store.reading import MOSAIC_NAME


def refuse_our_own(target: Path) -> None:
    """Raises UsageError for a target that is, or lies in, a part of a flight's folder."""
    try:
        place = target.parent.resolve() / target.name  # a link at the target itself is replaced, not followed
    except (OSError, RuntimeError) as error:  # the second: links in a circle
        raise UsageError(f"{target} cannot be found ({error}): give another file.") from None
    if target.name in ("", ".."):
        place = target.resolve()
    ours = {name.casefold() for name in WRITTEN_NAMES}  # some file systems know no case
    for flight in (place, *place.parents)[1:]:
        first = place.relative_to(flight).parts[0]
        if first.casefold() in ours and _holds_a_flight(flight):
            raise UsageError(
                f"{target} is part of the flight in {flight}, which an export would replace: give another file."
            )


def _holds_a_flight(folder: Path) -> bool:
    return any(inside.is_file(folder / name, folder) for name in (LEDGER_NAME, MOSAIC_NAME))
