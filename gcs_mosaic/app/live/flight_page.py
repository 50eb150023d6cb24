"""The page of a live flight: who may look, and what the operator is told of it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from rich.console import Console

from gcs_mosaic.config.tree import Config
from gcs_mosaic.messages import Notice, Topic
from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.store.folder import candidates
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.invitation import Invitation, invitation, scannable
from gcs_mosaic.web.page_keeper import PageKeeper
from gcs_mosaic.web.page_task import PageTask
from gcs_mosaic.web.token import access_to

DARK = "white on black"  # a code's blocks are its light parts, whatever the terminal's colours


def flights_of(out: Path) -> Iterator[Path]:
    """The folders of this `--out`, the newest first."""
    yield from reversed([path for path in candidates(out) if path.is_dir()])


class FlightPage:
    """Begun at once, in a process of its own. Without an address there is no page, and nothing to say."""

    def __init__(self, config: Config, address: HttpAddress | None, folder: Path) -> None:
        self._settings, self._address = config.web, address
        self._invitation: Invitation | None = None
        self._keeper: PageKeeper | None = None
        if address is not None:
            self._access = access_to(address, config.web, folder, flights_of(Path(config.out)))
            task = PageTask(root=folder, address=address, access=self._access, settings=config.web, hints=config.hints)
            self._keeper = PageKeeper(task)

    def wait(self) -> list[Notice]:
        """Wait until it is served; returns what to say of it. Raises UsageError if it cannot be."""
        if self._keeper is None or self._address is None:
            return []
        port = self._keeper.start()
        if port is None:
            text = "the page takes long to start; the flight goes on without it meanwhile"
            return [Notice(source="page", level="warning", text=text)]
        secure = self._settings.certificate is not None
        text = f"the map is at {self._address.url(port, secure=secure)}"
        notices = [Notice(source="page", level="info", text=text, topic=Topic.PAGE)]
        self._invitation = invitation(self._address, port, self._access, secure=secure)
        if self._invitation is not None:
            notices.append(Notice(source="page", level="info", text=self._invitation.notice))
        return notices

    def invite(self, console: Console) -> None:
        """Show others' links on the terminal; they are written nowhere else, because whoever reads them may look."""
        if self._invitation is None:
            return
        lines = list(self._invitation.links)
        wanted = {"always": True, "never": False}.get(self._settings.qr, console.is_terminal)
        if lines and wanted and console.encoding.lower().startswith("utf"):
            lines.append(scannable(lines[0]))
        for line in lines:
            console.print(line, style=DARK if "\n" in line else "bold", highlight=False, soft_wrap=True, markup=False)

    def publish(self, revision: int, tiles: Iterable[tuple[int, Tile]] | None) -> None:
        """Tell open pages what was painted; returns at once."""
        if self._keeper is not None:
            self._keeper.publish(revision, tiles)

    def news(self) -> list[Notice]:
        """What has become of it since the last call."""
        return [] if self._keeper is None else self._keeper.news()

    def stop(self) -> None:
        if self._keeper is not None:
            self._keeper.stop()
