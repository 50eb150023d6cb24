"""How frames are placed."""

from typing import Literal

Method = Literal["adjusted", "paper"]
