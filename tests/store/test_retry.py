"""What is told while nothing can be written, and when it is tried again."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from gcs_mosaic.messages import Notice
from gcs_mosaic.store import retry as writing
from gcs_mosaic.store.disk import CannotWrite, DiskFull
from gcs_mosaic.store.retry import UntilWritable


class Disk:
    """Writes that fail with these errors, one after another, then succeed; and what is told of it."""

    def __init__(self, *errors: Exception, ensure: Callable[[], bool] = lambda: False) -> None:
        self.errors, self.said, self.waits = list(errors), list[Notice](), 0
        self.until_writable = UntilWritable(Path("out"), self.said.append, self._wait, ensure)

    def write(self) -> str:
        if self.errors:
            raise self.errors.pop(0)
        return "written"

    def _wait(self, trouble: CannotWrite) -> None:
        self.waits += 1

    @property
    def texts(self) -> list[str]:
        return [notice.text for notice in self.said]


def failure(number: int) -> OSError:
    return OSError(number, os.strerror(number), "out/x")


@pytest.mark.parametrize(
    ("number", "advice"),
    [
        (errno.EROFS, "its disk is read-only now; make it writable, then it goes on"),
        (errno.EIO, "its disk reports errors; look at the cable, the card, the mount, then it goes on"),
        (errno.EACCES, "there is no permission any more; give it back, then it goes on"),
        (errno.ENOENT, "bring it back, then it goes on"),
    ],
)
def test_a_failure_is_told_once_with_what_to_do(number: int, advice: str) -> None:
    disk = Disk(*[failure(number)] * 5)
    assert disk.until_writable(disk.write) == "written"
    assert len(disk.texts) == 2
    assert disk.texts[0].endswith(advice)
    assert disk.texts[1] == "the disk can be written again: going on"


def test_another_trouble_is_told_too_but_a_full_disk_only_once_whatever_does_not_fit(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(writing, "SAID_OTHERWISE_S", 0.0)
    disk = Disk(DiskFull("full, a"), DiskFull("full, b"), failure(errno.EIO), DiskFull("full, c"))
    disk.until_writable(disk.write)
    assert [text.split()[0] for text in disk.texts] == ["full,", "out", "full,", "the"]


def ensuring(*found: bool | Exception) -> Callable[[], bool]:
    left = list(found)

    def ensure() -> bool:
        one = left.pop(0) if left else False
        if isinstance(one, Exception):
            raise one
        return one

    return ensure


def test_a_folder_that_could_be_taken_again_at_once_is_no_trouble() -> None:
    disk = Disk(failure(errno.ENOENT), ensure=ensuring(False, True))
    assert disk.until_writable(disk.write) == "written"
    assert disk.texts == []
    assert not disk.waits


def test_why_the_folder_is_gone_is_told_not_what_could_not_be_written() -> None:
    ensure = ensuring(False, CannotWrite("the folder is gone"), CannotWrite("the folder is gone"), True)
    disk = Disk(failure(errno.ENOENT), ensure=ensure)
    assert disk.until_writable(disk.write) == "written"
    assert disk.texts == ["the folder is gone", "the disk can be written again: going on"]
    assert disk.waits == 2


def test_a_fault_of_the_program_is_no_trouble_of_the_disk() -> None:
    disk = Disk(KeyError("x"))
    with pytest.raises(KeyError):
        disk.until_writable(disk.write)
