"""YAML of a bounded size, depth and number of values: whatever the text is, reading it costs little and raises one kind of error.

An alias stands for what it refers to, so that a few hundred bytes can stand for more values than a machine can hold ("billion
laughs"); values are counted as they would be written out.
"""

from __future__ import annotations

from typing import Any

import yaml

MOST_BYTES = 256 << 10  # ten times all settings with their comments
DEEPEST = 20  # the settings go four deep
MOST_VALUES = 10_000  # keys and values, each alias written out
LONGEST_FAULT = 300  # characters


class NotReadable(ValueError):  # noqa: N818 - names a state
    """The message says why, in a sentence without its end."""


def parsed(data: bytes) -> Any:
    """The one document in a text in UTF-8; None if it is empty. Raises NotReadable."""
    if len(data) > MOST_BYTES:
        raise NotReadable(f"it is longer than {MOST_BYTES >> 10} KB")
    loader = None
    try:
        loader = _Loader(data.decode("utf-8"))
        root = loader.get_single_node()
        if root is None:
            return None
        _count(root, {})
        return loader.construct_document(root)
    except (yaml.YAMLError, ValueError, OverflowError, RecursionError) as error:
        # A number of 5,000 digits, a date of the 40th of May: what Python refuses is refused.
        raise NotReadable(" ".join(str(error).split())[:LONGEST_FAULT]) from error
    finally:
        if loader is not None:
            loader.dispose()


class _Loader(yaml.SafeLoader):
    """Composes no deeper than `DEEPEST`."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._depth = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        if self._depth > DEEPEST:
            raise NotReadable(f"it is nested deeper than {DEEPEST}")
        self._depth += 1
        try:
            return super().compose_node(parent, index)
        finally:
            self._depth -= 1


def _count(node: yaml.Node, known: dict[int, int | None]) -> int:
    """How many values a node stands for; each node is looked at once. Raises NotReadable."""
    if id(node) in known:
        counted = known[id(node)]
        if counted is None:
            raise NotReadable("a value contains itself")
        return counted
    known[id(node)] = None
    total = 1 + sum(_count(child, known) for child in _children(node))
    if total > MOST_VALUES:
        raise NotReadable(f"it stands for more than {MOST_VALUES} values")
    known[id(node)] = total
    return total


def _children(node: yaml.Node) -> list[yaml.Node]:
    if isinstance(node, yaml.MappingNode):
        return [one for pair in node.value for one in pair]
    return list(node.value) if isinstance(node, yaml.SequenceNode) else []
