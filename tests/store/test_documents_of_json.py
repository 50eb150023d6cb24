"""Documents of a flight as anybody may have written them: objects of some size, lines, times and numbers, names."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs_mosaic.store.documents import finite, iso_utc
from gcs_mosaic.store.journal import told_after
from gcs_mosaic.store.placements import append
from gcs_mosaic.store.reading import read_document
from gcs_mosaic.store.revision import last_revision
from gcs_mosaic.store.stored_text import restored, stored


def test_a_document_is_an_object_of_some_size(tmp_path: Path) -> None:
    path = tmp_path / "mosaic.json"
    path.write_text('{"revision": 7}')
    assert read_document(path) == {"revision": 7}
    assert read_document(path, 15) == {"revision": 7}
    with pytest.raises(OSError, match=r"."):
        read_document(path, 14)
    assert last_revision(tmp_path) == 7
    for text in ("[1]", "[" * 100_000, '{"revision": null}', '{"revision": 1e400}', "{}"):
        path.write_text(text)
        assert last_revision(tmp_path) == 0
    path.unlink()
    assert last_revision(tmp_path) == 0


def test_what_was_told_after_a_revision(tmp_path: Path) -> None:
    path = tmp_path / "placements.jsonl"
    lines = [b'{"since":3}\n', *(b'{"revision":%d}\n' % one for one in (4, 5, 6))]
    path.write_bytes(b"".join(lines) + b'{"revision":')
    assert told_after(path, 3) == b"".join(lines)
    assert told_after(path, 5) == lines[0] + lines[3]
    assert told_after(path, 6) == lines[0]
    path.write_bytes(lines[0])
    assert told_after(path, 0) == lines[0]


def test_a_line_is_appended_at_the_end(tmp_path: Path) -> None:
    path = tmp_path / "file"
    for line in (b"one\n", b"two\n"):
        append(path, line)
    assert path.read_bytes() == b"one\ntwo\n"


@pytest.mark.parametrize("text", ["plain", "Grüße", "half\udce4byte", None])
def test_any_name_is_stored_and_restored(text: str | None) -> None:
    assert restored(stored(text)) == text
    assert isinstance(stored(text), bytes) is (text is not None and "\udce4" in text)


def test_times_and_numbers_of_documents() -> None:
    assert iso_utc(1714564800.25) == "2024-05-01T12:00:00.250Z"
    assert [finite(one) for one in (1.5, float("nan"), float("inf"))] == [1.5, None, None]
