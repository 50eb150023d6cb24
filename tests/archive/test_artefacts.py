"""Artefacts: whole, or lost; also those of a folder that a stranger hands over."""

from __future__ import annotations

import zlib
from pathlib import Path

import pytest

from gcs_mosaic.archive import artefacts as module
from gcs_mosaic.archive.artefacts import HEAD, MAGIC, Artefacts, Lost, unpacked
from gcs_mosaic.archive.files import FolderFiles
from gcs_mosaic.store.checkpoint import encoded


@pytest.fixture
def artefacts(tmp_path: Path) -> Artefacts:
    return Artefacts(FolderFiles(tmp_path))


def crafted(artefacts: Artefacts, part: bytes, *, is_packed: bool) -> None:
    """An artefact whose sums are right."""
    head = encoded({"part": (0, len(part), module._digest(part), is_packed)})
    artefacts.files.write("key", MAGIC + HEAD.pack(len(head), module._digest(head, "key")) + head + part)


def test_what_is_put_is_found(artefacts: Artefacts) -> None:
    artefacts.put("key", {"small": {"a": 1}, "large": ["alike"] * 100_000})
    assert artefacts.whole("key", "small") == {"a": 1}
    assert artefacts.part("key", "large") == ["alike"] * 100_000


def test_a_part_that_asks_for_gigabytes_is_lost(artefacts: Artefacts) -> None:
    crafted(artefacts, b"Nr\xff\xff\xff\x0f.", is_packed=False)
    with pytest.raises(Lost):
        artefacts.part("key", "part")


def test_a_part_that_swells_is_lost(artefacts: Artefacts, monkeypatch: pytest.MonkeyPatch) -> None:
    """A kilobyte of zeros compressed is a megabyte."""
    monkeypatch.setattr(module, "MOST_BYTES", 1 << 20)
    crafted(artefacts, zlib.compress(encoded(bytes(2 << 20))), is_packed=True)
    with pytest.raises(Lost):
        artefacts.part("key", "part")


def test_what_was_made_small_is_whole_again_or_refused() -> None:
    data = bytes(range(256)) * 10
    assert unpacked(zlib.compress(data), len(data)) == data
    for damaged in (zlib.compress(data)[:-2], zlib.compress(data + b"x"), b"none"):
        with pytest.raises(ValueError, match="it is"):
            unpacked(damaged, len(data))
