"""The heap is set up where the C library has such a heap, and nothing is done elsewhere."""

import ctypes
import subprocess
import sys

import pytest

from gcs_mosaic.app import machine


class Library:
    """Answers like glibc."""

    def __init__(self) -> None:
        self.set: dict[int, int] = {}

    def mallopt(self, option: int, value: int) -> int:
        self.set[option] = value
        return 1


def test_every_option_of_the_heap_is_set(monkeypatch: pytest.MonkeyPatch) -> None:
    library = Library()
    monkeypatch.setattr(ctypes, "CDLL", lambda name: library)
    machine.set_up_heap()
    assert library.set == machine.HEAP


def test_another_c_library_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ctypes, "CDLL", lambda name: object())
    machine.set_up_heap()
    machine.give_back()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="glibc is Linux's")
def test_glibc_takes_every_value() -> None:
    if not hasattr(ctypes.CDLL(None), "gnu_get_libc_version"):
        pytest.skip("another C library")
    code = f"import ctypes; print([ctypes.CDLL(None).mallopt(*one) for one in {[*machine.HEAP.items()]}])"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert said.strip() == str([1] * len(machine.HEAP))
