"""Where the arrays of features are kept that are needed again: in memory, or wherever a shelf puts them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeAlias

import numpy as np

from gcs_mosaic.stitch.arrays import AnyArray


class Shelved(Protocol):
    """An array that lies elsewhere. For any thread."""

    @property
    def shape(self) -> tuple[int, ...]: ...

    def array(self) -> AnyArray:
        """The array, not to be changed; zeros, which match nothing, if it is lost."""

    def exact(self) -> AnyArray:
        """The array. Raises OSError if it is lost."""


Shelve: TypeAlias = Callable[[AnyArray], Shelved]


def at_hand(kept: AnyArray | Shelved) -> AnyArray:
    """The array itself."""
    return kept if isinstance(kept, np.ndarray) else kept.array()


def exactly(kept: AnyArray | Shelved) -> AnyArray:
    """The array itself. Raises OSError if it is lost."""
    return kept if isinstance(kept, np.ndarray) else kept.exact()
