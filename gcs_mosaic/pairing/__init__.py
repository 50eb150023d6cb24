"""Events in, frames in, outcomes out. No clock, no I/O: time comes as an argument."""

from gcs_mosaic.pairing.outcomes import Accounts, Failed, How, Matched, Missing, Orphan, Outcome, Unmatched
from gcs_mosaic.pairing.pairing import Pairing
from gcs_mosaic.pairing.settings import PairingSettings

__all__ = [
    "Accounts",
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
