"""The stitching methods."""

from typing import Literal

Method = Literal["adjusted", "paper"]
