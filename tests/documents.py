"""The documents of an output folder, read as config/README.md tells other programs to read them."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from jsonschema import Draft202012Validator

from gcs_mosaic.store.told_documents import JournalHead, MosaicDocument, PlacementsDocument, StatusDocument
from gcs_mosaic.web.api.schema import Schemas

TOLD = {"mosaic.json": MosaicDocument, "placements.json": PlacementsDocument, "status.json": StatusDocument}
LISTS = ("frames", "covered", "rejected", "waiting")


def document_at(path: Path) -> dict[str, Any]:
    """One of a flight's documents; the test fails if it is other than it is described."""
    told: dict[str, Any] = json.loads(path.read_bytes())
    assert misfits(TOLD[path.name], told) == []
    return told


def misfits(kind: type, told: Any) -> list[str]:
    """How a document is other than it is described."""
    found = validator(kind).iter_errors(told)
    return [f"{'/'.join(map(str, one.absolute_path))}: {one.message[:300]}" for one in found]


@cache
def validator(kind: type) -> Draft202012Validator:
    schemas = Schemas(closed=True)
    schema = schemas.of(kind)
    return Draft202012Validator(schema | {"components": {"schemas": schemas.named}})


def placements(out: Path) -> dict[str, Any]:
    """What placements.json would say now: itself, and the lines of the journal that are newer."""
    lines = [json.loads(line) for line in journal_lines(out)]
    assert [fault for line in lines[:1] for fault in misfits(JournalHead, line)] == []
    assert [fault for line in lines[1:] for fault in misfits(PlacementsDocument, line)] == []
    told = document_at(out / "placements.json")
    assert not lines or lines[0]["since"] <= told["revision"], "who reads in this order misses nothing"
    for line in lines[1:]:
        if line["revision"] > told["revision"]:
            told = _followed(told, line)
    return told


def journal_lines(out: Path) -> list[bytes]:
    """The whole lines of placements.jsonl; none if there is no such file."""
    path = out / "placements.jsonl"
    return path.read_bytes().split(b"\n")[:-1] if path.exists() else []


def _followed(document: dict[str, Any], line: dict[str, Any]) -> dict[str, Any]:
    """A document with what a line tells in place of what was told of the same frames."""
    lens = len(document["cameras"])
    told = {entry["name"]: (kind, entry) for kind in LISTS for entry in document[kind]}
    for kind in LISTS:
        for entry in line[kind]:
            told[entry["name"]] = kind, entry | ({"camera": entry["camera"] + lens} if kind == "frames" else {})
    frames = {name: entry for name, (kind, entry) in told.items() if kind == "frames"}
    for kind, entry in told.values():
        if kind == "covered":
            _lay(entry, frames.get(entry["covered_by"]))
    lists = {kind: [entry for fate, entry in told.values() if fate == kind] for kind in LISTS}
    return line | {"cameras": document["cameras"] + line["cameras"]} | lists


def _lay(covered: dict[str, Any], keyframe: dict[str, Any] | None) -> None:
    """A covered frame goes where its keyframe goes."""
    place = None if keyframe is None else np.array(keyframe["canvas_from_frame"]) @ covered["keyframe_from_frame"]
    covered["island"] = keyframe and keyframe["island"]
    covered["canvas_from_frame"] = None if place is None else (place / place[2, 2]).tolist()
