"""Features of frames, kept between runs of a benchmark as long as nothing that finds them has changed."""

from __future__ import annotations

import ast
import os
import pickle
from collections.abc import Iterable
from functools import lru_cache, partial
from hashlib import blake2b
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np

from gcs_mosaic.app.waiting.prefetch import DecodedFrame, prepare
from gcs_mosaic.messages import Frame
from gcs_mosaic.stitch.features.extraction import Features, FeatureSettings, extract

FINDERS = ("gcs_mosaic.app.waiting.prefetch", "gcs_mosaic.frames.decode", "gcs_mosaic.stitch.features.extraction")


class FeatureFinder:
    """Finds the features of frames as a flight at this reduction does. `folder`: where they are kept; None: nowhere.

    Whoever can write into the folder can run code here: it holds pickles.
    """

    def __init__(self, settings: FeatureSettings, reduction: int, folder: Path | None = None) -> None:
        self._find = partial(extract, settings=settings)
        self._reduction = reduction
        self._least_pixels = settings.megapixels * 1e6
        self._folder = folder
        self._settings = repr((settings, reduction, cv2.__version__, np.__version__))
        self.found = 0  # frames whose features were not in the folder

    def features_of(self, frame: Frame) -> Features | str:
        """The features of a frame, or why it has none."""
        kept = self._place_of(frame)
        if kept and kept.exists():
            features = pickle.loads(kept.read_bytes())
            assert isinstance(features, Features)
            return features
        self.found += 1
        prepared = prepare(frame, self._find, self._reduction, self._least_pixels)
        if not isinstance(prepared, DecodedFrame):
            return prepared.reason
        if kept:
            _write(kept, pickle.dumps(prepared.features))
        return prepared.features

    def _place_of(self, frame: Frame) -> Path | None:
        if self._folder is None:
            return None
        key = f"{frame.content_hash} {self._settings} {source_hash(FINDERS)}"
        return self._folder / f"{blake2b(key.encode(), digest_size=16).hexdigest()}.pickle"


def _write(path: Path, data: bytes) -> None:
    """Written beside: another run may look for it at the same time."""
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_suffix(f".{os.getpid()}")
    beside.write_bytes(data)
    beside.replace(path)


@lru_cache
def source_hash(modules: Iterable[str]) -> str:
    """Hex of a hash over the source of these modules and of all of the project that they import."""
    sources = {name: path.read_bytes() for name, path in sources_of(modules).items()}
    together = b"\0".join(name.encode() + b"\0" + source for name, source in sorted(sources.items()))
    return blake2b(together, digest_size=16).hexdigest()


def sources_of(modules: Iterable[str]) -> dict[str, Path]:
    """Files of these modules and of all of the same packages that they import, by module."""
    found: dict[str, Path] = {}
    left = list(modules)
    while left:
        name = left.pop()
        spec = find_spec(name) if name not in found else None
        if spec and spec.origin:
            found[name] = Path(spec.origin)
            left += [other for other in _imported(found[name]) if other.split(".")[0] == name.split(".")[0]]
    return found


def _imported(path: Path) -> list[str]:
    """Modules named in import statements, those from which names are imported and those that the names may be."""
    names: list[str] = []
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return [name for name in names if _is_module(name)]


def _is_module(name: str) -> bool:
    try:
        return find_spec(name) is not None
    except ModuleNotFoundError:  # a name in a module, not in a package
        return False
