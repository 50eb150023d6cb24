"""Commands that somebody is told to type are those of any folder, whatever it is called."""

from __future__ import annotations

import os
import shlex
from pathlib import Path

import pytest

from gcs_mosaic.app.inputs.pairing_check import shifted_text
from gcs_mosaic.app.live.left_behind import LeftBehind, not_kept_words, unpainted_words, unstitched_words
from gcs_mosaic.check.findings import CheckedPart, Fault, Findings
from gcs_mosaic.check.table import verdict
from gcs_mosaic.store.disk import CannotWrite
from gcs_mosaic.store.typed import typed, typed_on_windows

ODD = Path("card 1/Suche „Alm“ & Hof #2")
LEFT = LeftBehind(frames=1, pictures_lost=0, triggers_lost=0)
SENTENCES = {
    "unpainted": unpainted_words(ODD),
    "unstitched": unstitched_words(2, ODD),
    "not kept": not_kept_words(["a.jpg"], ODD),
    "full disk": LEFT.last_words(CannotWrite("the disk is full"), ODD),
    "pairing": shifted_text(ODD, 1, 1),
    "check": verdict(Findings(str(ODD), [CheckedPart("tiles", "tiles", faults=[Fault("1", "lost")])]), mended=False),
}


@pytest.mark.skipif(os.name == "nt", reason="read as a shell of POSIX reads it")
@pytest.mark.parametrize("sentence", SENTENCES.values(), ids=list(SENTENCES))
def test_a_command_is_one_that_a_shell_takes(sentence: str) -> None:
    command = sentence[sentence.index("gcs-mosaic ") :]
    assert str(ODD) in shlex.split(command)


def test_a_plain_path_is_told_as_it_is() -> None:
    assert typed(Path("mosaic-2")) == "mosaic-2"


@pytest.mark.parametrize(
    ("path", "word"),
    [
        (r"D:\flights\mosaic-2", r"D:\flights\mosaic-2"),
        (r"D:\card 1\Alm", r'"D:\card 1\Alm"'),
        (r"D:\Alm&Hof", r'"D:\Alm&Hof"'),
        (r"D:\Suche (2)", r'"D:\Suche (2)"'),
    ],
)
def test_on_windows_it_is_in_double_quotes(path: str, word: str) -> None:
    assert typed_on_windows(path) == word
