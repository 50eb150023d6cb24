"""What tests of archives begin with."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from urllib.request import Request as HttpRequest
from urllib.request import urlopen

import pytest

from gcs_mosaic.archive.progress import StageCost
from gcs_mosaic.archive.reprocess import Request, reprocess
from gcs_mosaic.config.tree import Config
from sitl.flight import plan
from sitl.path import Plan
from tests.ports import free_port
from tests.running import until

FRAMES, SIZE = 9, (400, 300)
STRETCH = 2  # frames placed by themselves: so few that there is something to join twice
SIDE = 4  # tiles along a super-tile: several, though the map is small


@dataclass
class Heard:
    """What a run has told."""

    said: list[str] = field(default_factory=list)
    costs: list[StageCost] = field(default_factory=list)

    def begin(self, cost: StageCost) -> None:
        self.costs.append(cost)

    def advance(self, cost: StageCost) -> None:
        assert cost.done <= cost.tasks

    def end(self, cost: StageCost) -> None:
        assert cost.done <= cost.tasks

    def say(self, text: str) -> None:
        self.said.append(text)

    def kept_in(self, folder: Path) -> AbstractContextManager[None]:
        assert folder.is_dir()
        return nullcontext()


def flight_in(folder: Path, cache: Path) -> Path:
    """A folder with the pictures of a small simulated flight."""
    flown = plan("survey", SIZE, cache=cache, seed=3, world_size=2048, route=Plan(frames=FRAMES, height=60))
    folder.mkdir(exist_ok=True)
    for number, data in zip(range(FRAMES), flown.pictures(), strict=False):
        (folder / f"IMG_{number:04}.JPG").write_bytes(data)
    return folder


def run(
    *sources: Path | str, out: Path | str, config: Config | None = None, heard: Heard | None = None, **more: object
) -> Heard:
    """Reprocess an archive on two workers of this machine, or as `more` says."""
    heard = heard or Heard()
    request = Request(tuple(map(str, sources)), str(out), workers=2, stretch=STRETCH, side=SIDE)
    reprocess(replace(request, **more), config or Config(), heard)  # type: ignore[arg-type]
    return heard


def tiles_of(out: Path) -> dict[str, bytes]:
    """All tiles and masks of a flight's folder."""
    paths = [path for folder in ("tiles", "masks") for path in (out / folder).rglob("*.*")]
    return {path.relative_to(out).as_posix(): path.read_bytes() for path in paths}


@contextmanager
def bucket_server(monkeypatch: pytest.MonkeyPatch, *buckets: str) -> Iterator[str]:
    """A server of S3 with these buckets."""
    address = f"http://127.0.0.1:{(port := free_port())}"
    command = [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)]
    server = subprocess.Popen(command, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    for name, value in {
        "AWS_ENDPOINT_URL": address,
        "AWS_ALLOW_HTTP": "true",
        "AWS_REGION": "us-east-1",
        "AWS_ACCESS_KEY_ID": "key",
        "AWS_SECRET_ACCESS_KEY": "secret",
    }.items():
        monkeypatch.setenv(name, value)
    try:
        until(lambda: answers(address), "the server answers")
        for bucket in buckets:
            urlopen(HttpRequest(f"{address}/{bucket}", method="PUT"), timeout=10).close()
        yield address
    finally:
        server.kill()
        server.wait()


def answers(address: str) -> bool:
    try:
        urlopen(address, timeout=10).close()
    except OSError:
        return False
    return True
