"""What the page's process is to do, as it is told by the flight."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Self

from gcs_mosaic.hints.settings import HintSettings
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.settings import WebSettings
from gcs_mosaic.web.token import Access


@dataclass(frozen=True, slots=True, kw_only=True)
class PageTask:
    """What to serve, where, and to whom."""

    root: Path
    address: HttpAddress
    access: Access
    settings: WebSettings
    hints: HintSettings = field(default_factory=HintSettings)

    def at(self, port: int) -> Self:
        return replace(self, address=replace(self.address, port=port))
