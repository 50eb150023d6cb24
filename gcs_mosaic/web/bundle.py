"""The page's scripts as one file, made when it is first asked for: a page that loads forty is blank if one is lost on the way.

Each module becomes a function that is called once, in the order of the imports, and tells its exports. That is all that the
page's own manner of writing needs: named imports, one on a line, and exports where they are declared. A list of words is loaded
by itself, by whoever speaks that language.
"""

from __future__ import annotations

import re
from functools import lru_cache
from pathlib import Path

FIRST = "viewer"
NAME = "page.js"
IMPORT = re.compile(r'^import (\{[\w, ]+\}) from "/viewer/(\w+)\.js";$', re.MULTILINE)
EXPORT = re.compile(r"^export ((?:async function|function|class|const) (\w+))", re.MULTILINE)
STRANGE = re.compile(r"^(?:import|export)\b.*", re.MULTILINE)


@lru_cache(1)
def bundle(folder: Path) -> str:
    """The script; as a module it exports `modules`, by their names. Raises ValueError for what is written in another manner."""
    texts: dict[str, str] = {}
    _add(folder, FIRST, texts, ())
    return "\n".join(["const modules = {};", *texts.values(), "export { modules };", ""])


def _add(folder: Path, name: str, texts: dict[str, str], path: tuple[str, ...]) -> None:
    """A module, after those that it imports."""
    if name in texts:
        return
    if name in path:
        raise ValueError(f"these scripts import each other: {', '.join(path)}")
    source = (folder / f"{name}.js").read_text("utf-8")
    for _, other in IMPORT.findall(source):
        _add(folder, other, texts, (*path, name))
    texts[name] = _wrapped(name, source)


def _wrapped(name: str, source: str) -> str:
    exported = [found[1] for found in EXPORT.findall(source)]
    body = EXPORT.sub(r"\1", IMPORT.sub(r"const \1 = modules.\2;", source))
    if strange := STRANGE.search(body):
        raise ValueError(f"{name}.js: {strange[0]}")
    how = ("await (async ()", ")") if name == FIRST else ("(()", ")")  # who waits for the words before it says anything
    return f"modules.{name} = {how[0]} => {{\n{body}\nreturn {{ {', '.join(exported)} }};\n}}{how[1]}();"
