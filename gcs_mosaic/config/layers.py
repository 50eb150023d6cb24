"""Where settings come from: the user's file, the file of `--config`, the environment, each over the one before.

Independent of the settings tree, which loads the stitching: links are opened before that, by the settings that concern them.
"""

from __future__ import annotations

import dataclasses
import os
import re
import typing
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from gcs_mosaic.config import yaml_text
from gcs_mosaic.config.settings_file import fields_of, from_mapping, nearest, read_settings, shown, value_of
from gcs_mosaic.errors import UsageError

PREFIX = "GCS_MOSAIC_"  # of the environment's variables: GCS_MOSAIC_STITCH__SEARCH__NEIGHBOURS=8
WITHIN = "__"
# Kubernetes, and Docker for its links, tell every container of a service that is called gcs-mosaic by these.
_OF_A_SERVICE = re.compile(rf"{PREFIX}(PORT(_\d+_.+)?|SERVICE_(HOST|PORT)(_.+)?|NAME|ENV_.+)")

S = TypeVar("S")


@dataclass(frozen=True, slots=True)
class SettingsLayer:
    """Settings from one place, as they are written there. `where`: how sentences call it."""

    where: str
    values: Mapping[str, Any]


def user_file(environment: Mapping[str, str] = os.environ) -> Path | None:
    """Where settings of the user's own are, whether or not there are any; None for a user without a home."""
    base = environment.get("XDG_CONFIG_HOME", "")
    try:
        folder = Path(base) if Path(base).is_absolute() else Path.home() / ".config"
    except RuntimeError:
        return None
    return folder / "gcs-mosaic" / "config.yaml"


def files(given: Path | None) -> list[SettingsLayer]:
    """The user's file, if there is one, and the one that is given. Raises UsageError for one that cannot be read."""
    own = user_file()
    paths = [own] if own is not None and os.path.lexists(own) else []
    return [SettingsLayer(str(path), read_settings(path)) for path in (*paths, *([given] if given else []))]


def settings_of(kind: type[S], given: Path | None, *, only: bool = False) -> tuple[S, dict[str, str]]:
    """The settings, and where those that are set come from, by their dotted names. `only`: what `kind` does not know is left to
    others. Raises UsageError, which names the place of what cannot be used."""
    layers, values, origins = files(given), dict[str, Any](), dict[str, str]()
    known = typing.get_type_hints(kind)
    for layer in layers:
        said = {key: value for key, value in layer.values.items() if key in known} if only else dict(layer.values)
        values = merged(values, said)
        from_mapping(kind, values, layer.where)
        origins |= dict.fromkeys(names_in(kind, said), layer.where)
    variables = list(_variables(kind, os.environ, only=only))
    for variable, path, value in variables:
        said = _nested(path, value)
        values = merged(values, said)
        origins |= dict.fromkeys(names_in(kind, said), variable)
    where = ", ".join(variable for variable, _, _ in variables) or (layers[-1].where if layers else "the defaults")
    return typing.cast(S, from_mapping(kind, values, where)), origins


def merged(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Settings over others: mappings are joined, all else is replaced."""
    joined = dict(below)
    for key, value in above.items():
        both = isinstance(value, dict) and isinstance(joined.get(key), dict)
        joined[key] = merged(joined[key], value) if both else value
    return joined


def names_in(kind: Any, values: Mapping[str, Any], before: str = "") -> Iterator[str]:
    """The dotted names of the settings that a mapping sets."""
    hints = typing.get_type_hints(kind)
    for key, value in values.items():
        if dataclasses.is_dataclass(hints.get(key)) and isinstance(value, dict):
            yield from names_in(hints[key], value, f"{before}{key}.")
        else:
            yield f"{before}{key}"


def _variables(kind: type, environment: Mapping[str, str], *, only: bool) -> Iterator[tuple[str, list[str], Any]]:
    """Name, path and value of each variable that sets something; an empty one sets nothing. Raises UsageError."""
    for variable in sorted(environment):
        if not variable.startswith(PREFIX) or not environment[variable] or _OF_A_SERVICE.fullmatch(variable):
            continue
        path = variable[len(PREFIX) :].lower().split(WITHIN)
        if only and path[0] not in fields_of(kind):
            continue
        yield variable, path, _of_text(_kind_at(kind, path, variable), environment[variable], variable)


def _kind_at(kind: Any, path: list[str], variable: str) -> Any:
    """The type of the setting at a path. Raises UsageError."""
    for name in path:
        known = fields_of(kind)
        if name not in known:
            hints = typing.get_type_hints(kind) if known else {}
            meant = nearest(name, {one: hints[one] for one in known}) if known else ""
            raise UsageError(
                f"{shown(variable)} in the environment names no setting{meant}; a setting within another is "
                f"{PREFIX}STITCH{WITHIN}SEARCH{WITHIN}NEIGHBOURS, and gcs-mosaic config shows all."
            )
        kind = typing.get_type_hints(kind)[name]
    return kind


def _of_text(kind: Any, text: str, variable: str) -> Any:
    """A variable's text as YAML or, where that does not fit, as it stands ('*_T.*' is no YAML). Raises UsageError."""
    try:
        value = yaml_text.parsed(text.encode("utf-8", "surrogateescape"))
        value_of(kind, value, variable)
    except (yaml_text.NotReadable, UsageError) as error:
        try:
            value_of(kind, text, variable)
        except UsageError as as_text:
            raise (error if isinstance(error, UsageError) else as_text) from None
        return text
    return value


def _nested(path: list[str], value: Any) -> dict[str, Any]:
    for name in reversed(path):
        value = {name: value}
    return typing.cast(dict[str, Any], value)
