"""Settings that nobody would write: refused in one short line, at once."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from gcs_mosaic.config.settings_file import documented_defaults
from gcs_mosaic.config.yaml_text import MOST_BYTES, NotReadable, parsed
from gcs_mosaic.errors import UsageError
from tests.settings import load_config


def bomb(name: str, times: int = 9, levels: int = 9) -> str:
    """Aliases of aliases: 300 bytes that stand for a billion values."""
    lines = ["x0: &a0 lol"]
    lines += [f"x{n}: &a{n} [{', '.join([f'*a{n - 1}'] * times)}]" for n in range(1, levels)]
    return "\n".join([*lines, f"{name}: *a{levels - 1}"])


def merged(levels: int = 40) -> str:
    """Each mapping takes the one before in twice."""
    lines = ["x0: &a0 {b: 1}"]
    lines += [f"x{n}: &a{n} {{'<<': [*a{n - 1}, *a{n - 1}]}}" for n in range(1, levels)]
    return "\n".join(lines)


HOSTILE = {
    "nested lists": "[" * 10_000,
    "nested mappings": "{a: " * 10_000,
    "nested by indentation": "\n".join(f"{' ' * n}a:" for n in range(400)),
    "nested keys": "? " * 5_000,
    **{
        f"a bomb under {name}": bomb(name) for name in ("decode", "stitch", "sources", "rtsp", "scale", "<<", "unknown")
    },
    "merges": merged(),
    "itself": "decode: &a [*a]",
    "itself in a mapping": "decode: &a {cpu_s: *a}",
    "a long name": "a" * 100_000 + ": 1",
    "a long value": "scale: " + "a" * 100_000,
    "a long value among few": f"method: {'a' * 100_000}",
    "many digits": "scale: " + "9" * 5_000,
    "many digits in sixteens": "resume_h: 0x" + "f" * 5_000,
    "no date": "watch: 2021-99-99",
    "no day": "? 2021-02-30\n: 1",
    "infinite": "resume_h: .inf",
    "larger than any file": "a: 1\n" * 100_000,
    "a tag of code": "watch: !!python/object/apply:os.system [true]",
    "not UTF-8": "watch: \udcff",
    "a zero": "watch: a\0b",
    "two documents": "a: 1\n---\nb: 1",
    "a list as a key": "? [a]\n: 1",
    "anchors without end": "&a " * 5_000,
    "quotes without end": 'watch: "' + "x" * 10_000,
}


@pytest.mark.long
@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_settings_are_refused_in_one_short_line_and_at_once(tmp_path: Path, name: str) -> None:
    """10 kB of brackets brought a traceback of 204 kB; aliases under `decode` were written out for a minute."""
    file, began = tmp_path / "settings.yaml", time.process_time()
    file.write_bytes(HOSTILE[name].encode("utf-8", "surrogateescape"))
    with pytest.raises(UsageError) as caught:
        load_config(file)
    said = str(caught.value)
    assert "\n" not in said
    assert len(said) < 1000
    assert said.startswith(str(file)) or "settings.yaml is not YAML" in said
    assert time.process_time() - began < 1.0


def test_all_settings_with_their_comments_are_far_from_any_limit() -> None:
    whole = documented_defaults().encode()
    assert parsed(whole)
    assert 5 * len(whole) < MOST_BYTES


def test_aliases_and_merges_are_what_they_were() -> None:
    told = parsed(b"a: &a {b: 1, c: [1, 2]}\nd: *a\ne: {<<: *a, b: 2}\nf: [*a, *a]")
    assert told["d"] == told["a"]
    assert told["e"] == {"b": 2, "c": [1, 2]}
    assert parsed(b"") is None
    assert parsed(b"\xef\xbb\xbfa: 1") == {"a": 1}


def test_a_value_is_read_as_often_as_it_is_written_out() -> None:
    with pytest.raises(NotReadable, match="stands for more than"):
        parsed(bomb("a", times=2, levels=20).encode())
