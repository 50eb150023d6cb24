"""Other machines are not told where things lie on this one: of an absolute path they see its last name."""

from __future__ import annotations

import re

# In JSON text as written, in which a drive's backslashes are doubled. Within a sentence a path begins where no name, number or
# address precedes it, and ends with a blank or a quote; the watched folder may have blanks in its name.
_FOLDER = re.compile(r"""("folder":\s*")(?:/|[A-Za-z]:(?=[\\/]))[^"]*?([^"/\\]*[/\\]*")""")
_POSIX = re.compile(r"""(?<![\w/.~\\*-])/(?=[^\s/"'\\])(?:[^\s"'\\/]+/)*([^\s"'\\/]*)""")
_WINDOWS = re.compile(r"""\b[A-Za-z]:(?:\\\\|/(?!/))(?:[^"'\\/]+(?:\\\\|/))*([^\s"'\\/]*)""")


def without_paths(document: str) -> str:
    """A JSON document with absolute paths shortened to their last names."""
    shortened = _FOLDER.sub(r"\1\2", document)
    return _POSIX.sub(r"\1", _WINDOWS.sub(r"\1", shortened))
