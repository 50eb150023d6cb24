"""Merges camera events into shots and matches shots with frames. No clock, no I/O: time is passed in.

May import `messages`; called by `app`.
"""

from gcs_mosaic.triggers.matcher import Pairing
from gcs_mosaic.triggers.outcomes import EventCounts, Failed, How, Matched, Missing, Orphan, Outcome, Unmatched
from gcs_mosaic.triggers.settings import PairingSettings

__all__ = [
    "EventCounts",
    "Failed",
    "How",
    "Matched",
    "Missing",
    "Orphan",
    "Outcome",
    "Pairing",
    "PairingSettings",
    "Unmatched",
]
