"""Nothing is caught without a trace: every place in the package that catches something broad, by the syntax tree."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "gcs_mosaic"

BROAD = {"", "Exception", "BaseException", "OSError"}

# Handlers that neither log nor raise nor tell what they caught, by module and function, and why.
SILENT = {
    ("cli.py", "_flush_or_let_go"): "the reader of the terminal is gone: nobody is there to be told",
    ("flight/folder.py", "close"): "tidying up; the log is closed already",
    ("flight/lock.py", "try_lock"): "a network folder without locks, before there is a log",
    ("flight/lock.py", "is_still_there"): "it is not there, which is the answer",
    ("flight/log.py", "tell"): "the terminal is gone",
    ("flight/log.py", "close"): "the log itself",
    ("flight/log.py", "write"): "the log itself: what went wrong before is raised",
    ("link/channels.py", "send"): "a peer that is away, at each packet",
    ("link/ports.py", "holder_of_udp_port"): "other users' processes may not be looked into",
    ("link/ports.py", "_inodes_on"): "a system without this table",
    ("reporting.py", "_put"): "logged by the handler around it",
    ("stitch/adjusting/background.py", "_send"): "the result, waited for, tells that the process has died",
    ("stitch/adjusting/background.py", "_work"): "another process: its pipe is closed when the program ends",
    (
        "stitch/adjusting/background.py",
        "_tried",
    ): "another process: its traceback goes home in Failed and is logged there",
}


def catchers(tree):
    """(function, node) of each place that catches something broad."""
    for function in ast.walk(tree):
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
            for node in ast.walk(function):
                if (isinstance(node, ast.ExceptHandler) and BROAD & kinds([node.type])) or (
                    isinstance(node, ast.Call)
                    and ast.unparse(node.func) in ("suppress", "contextlib.suppress")
                    and BROAD & kinds(node.args)
                ):
                    yield function.name, node


def kinds(caught):
    return {
        "" if one is None else ast.unparse(one)
        for kind in caught
        for one in (kind.elts if isinstance(kind, ast.Tuple) else [kind])
    }


def leaves_a_trace(node):
    """Whether it raises or logs the traceback; what the system says of a file may also be told in words."""
    if not isinstance(node, ast.ExceptHandler):
        return False
    inside = list(ast.walk(node))
    told = any(isinstance(part, ast.Name) and part.id == node.name for part in inside)
    calls = [part for part in inside if isinstance(part, ast.Call) and ast.unparse(part.func).startswith("logger.")]
    logged = any(
        ast.unparse(call.func) == "logger.exception" or "exc_info" in {word.arg for word in call.keywords}
        for call in calls
    )
    of_the_system = not kinds([node.type]) & (BROAD - {"OSError"})
    return any(isinstance(part, ast.Raise) for part in inside) or logged or (of_the_system and told)


def test_nothing_is_caught_without_a_trace():
    silent = {
        (path.relative_to(PACKAGE).as_posix(), function)
        for path in PACKAGE.rglob("*.py")
        for function, node in catchers(ast.parse(path.read_text(encoding="utf-8")))
        if not leaves_a_trace(node)
    }
    assert silent == set(SILENT)


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_whoever_logs_does_so_under_its_own_name(path):
    text = path.read_text(encoding="utf-8")
    if "logger." in text and path.name != "log.py":  # which is given loggers
        assert "logger = logging.getLogger(__name__)" in text
