"""Nothing is caught without a trace: every place in the package that catches something broad, by the syntax tree."""

import ast
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "gcs_mosaic"

BROAD = {"", "Exception", "BaseException", "OSError"}

# Handlers that neither log nor raise nor tell what they caught, by module and function: how many there are, and why.
SILENT = {
    ("app/pipeline/resuming.py", "boot_id"): (1, "a system that does not tell, which is the answer"),
    ("cli/streams.py", "flush_or_let_go"): (1, "the reader of the terminal is gone: nobody is there to be told"),
    ("cli/streams.py", "open_standard_streams"): (1, "it is closed, which is the answer; there is no log yet"),
    ("app/machine.py", "share_heap"): (1, "another system, which has no such thing"),
    ("web/maps/underlay.py", "numbers_in"): (1, "a folder that cannot be read has no tiles, which is the answer"),
    ("views/taken.py", "captured_at"): (1, "an original that is not there tells nothing, which is the answer"),
    ("frames/directory.py", "FolderWatch._is_old"): (1, "gone, or of a name that is only shown so: it counts as old"),
    ("frames/picture_size.py", "picture_size"): (1, "of what cannot be read nothing is known, which is the answer"),
    ("frames/video/extraction.py", "_subtitles"): (1, "subtitles that cannot be read tell no places"),
    ("frames/video/film.py", "Film.seek"): (1, "a recording that cannot be sought through is read from its beginning"),
    ("frames/video/process.py", "describe_videos"): (1, "another process: its pipe is closed when the program ends"),
    ("frames/video/process.py", "read_video"): (1, "another process: its pipe is closed when the program ends"),
    ("mavlink/recording_kind.py", "_beside"): (1, "no log beside it can be named"),
    ("store/disk.py", "write_beside"): (1, "what failed before is raised"),
    ("store/folder.py", "_was_begun_by_us"): (1, "what cannot be looked into is not ours, which is the answer"),
    ("store/foreign_file.py", "_names_another"): (1, "it is not there, which is the answer"),
    ("store/foreign_file.py", "refuse_strange_files"): (1, "it is not there, so nothing is wrong with it"),
    ("store/inside.py", "status"): (1, "it is not there, which is the answer"),
    ("store/inside.py", "is_plain"): (1, "it is gone, which is the answer"),
    ("store/inside.py", "_listed"): (1, "a folder that is gone has nothing in it"),
    ("store/inside.py", "_is_folder"): (1, "it is gone, which is the answer"),
    ("store/requests.py", "_small_file"): (1, "the reason is returned, and told"),
    ("store/rewritten.py", "RewrittenFiles.remove_outdated"): (1, "gone, or on a disk that is lost: it harms nothing"),
    ("app/commands/merging.py", "_hold"): (1, "a folder that nobody can write into, so nobody does"),
    ("store/stages.py", "_tells_core"): (1, "another system, which has no such thing"),
    ("store/folder.py", "FlightFolder.close"): (1, "tidying up; the log is closed already"),
    ("store/checkpoint.py", "Checkpoints._made"): (1, "`_failed` logs it, once for each trouble"),
    ("store/lock.py", "try_lock"): (1, "a network folder without locks, before there is a log"),
    ("store/lock.py", "is_locked"): (
        2,
        "no lock file, or a network folder without locks: nobody holds it, which is the answer",
    ),
    ("check/documents.py", "_read"): (1, "a fault of the document, which is what is reported"),
    ("check/documents.py", "_read_placements"): (1, "a fault of the document, which is what is reported"),
    ("export/whole_file.py", "_held"): (1, "a network folder without locks: as in store/lock.py"),
    ("archive/target.py", "_locked"): (1, "what this run has made stays if it cannot be removed, and harms nobody"),
    ("archive/target.py", "_claimed"): (1, "what this run has made stays if it cannot be removed, and harms nobody"),
    ("archive/target.py", "_remove_empty"): (1, "something lies in it, so it stays"),
    ("archive/packing.py", "_frame_of"): (1, "it is read then, which tells"),
    ("archive/files.py", "FolderFiles.write"): (1, "what failed before is raised"),
    ("store/lock.py", "is_still_there"): (1, "it is not there, which is the answer"),
    ("store/lock.py", "FolderLock.is_deleted"): (1, "its disk is gone, so it was not deleted, which is the answer"),
    ("store/disk.py", "identity_of"): (1, "it is not there, which is the answer"),
    ("store/guard.py", "FolderGuard._is_strange"): (1, "it is not there, which is the answer"),
    ("store/guard.py", "disks_above"): (1, "it is not there, which is the answer"),
    ("store/log.py", "is_at"): (1, "it is not there, which is the answer"),
    ("store/log.py", "LogFile.reopen"): (1, "the log itself: its old disk is gone"),
    ("store/log.py", "_written"): (1, "the log itself: its old disk is gone"),
    ("mavlink/tlog_writer.py", "_written"): (1, "what is lost with the old disk was told when it was lost"),
    ("mavlink/tlog_writer.py", "_is_at"): (1, "it is not there, which is the answer"),
    ("store/log.py", "tell"): (1, "the terminal is gone"),
    ("store/log.py", "LogFile.close"): (1, "the log itself"),
    ("store/log.py", "_WholeLines.write"): (1, "the log itself: what went wrong before is raised"),
    ("store/log.py", "_message"): (1, "the log itself: what could not be put into words is described"),
    ("store/log.py", "_described"): (1, "the log itself: its type is told"),
    ("mavlink/channels.py", "UdpChannel.send"): (1, "a peer that is away, at each packet"),
    ("mavlink/sockets.py", "holder_of_udp_port"): (1, "other users' processes may not be looked into"),
    ("mavlink/sockets.py", "_inodes_on"): (1, "a system without this table"),
    ("processes/child.py", "ChildProcess.__init__"): (1, "the process has ended, which whoever asks it is told"),
    ("processes/main.py", "main"): (1, "another process: its pipe is closed when the program ends"),
    ("processes/pipe.py", "ChildTeller.tell"): (1, "another process: the flight is gone, whose log it is"),
    ("hints/hint_process.py", "Wanted.hear"): (1, "another process: its pipe is closed when nothing is wanted"),
    ("web/hint_keeper.py", "HintKeeper._serve"): (1, "the process has ended, which is said"),
    ("web/page_keeper.py", "PageKeeper._answer"): (1, "the page's process has ended, which is said"),
    ("web/page_keeper.py", "PageKeeper._serve"): (1, "the page's process has ended, which is said"),
    ("web/page_process.py", "serve_page"): (1, "another process: its pipe is closed when the flight has ended"),
    ("app/status/reporter.py", "Reporter._put"): (1, "logged by the handler around it"),
    ("frames/decoding/worker.py", "work"): (1, "another process: its pipe is closed when the program ends"),
    ("frames/decoding/worker.py", "_tried"): (
        1,
        "another process: its traceback goes home with the answer, and is logged",
    ),
    ("frames/rtsp/stream_process.py", "receive"): (1, "another process: its pipe is closed when the program ends"),
    ("frames/rtsp/stream_process.py", "_hear"): (1, "another process: its pipe is closed when the program ends"),
    ("app/machine.py", "give_back"): (1, "another C library, which has no such thing"),
    ("stitch/bundle/worker.py", "_send"): (1, "the result, waited for, tells that the process has died"),
    ("stitch/bundle/worker.py", "_work"): (1, "another process: its pipe is closed when the program ends"),
    ("stitch/bundle/worker.py", "_tried"): (
        1,
        "another process: its traceback goes home in Failed, and is logged",
    ),
}


def catchers(tree: ast.AST, where: str = "") -> Iterator[tuple[str, ast.AST]]:
    """(Class.function, node) of each place that catches something broad."""
    for node in ast.iter_child_nodes(tree):
        inside = where
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            inside = f"{where}.{node.name}".lstrip(".")
        if catches_broadly(node):
            yield inside, node
        yield from catchers(node, inside)


def catches_broadly(node: ast.AST) -> bool:
    if isinstance(node, ast.ExceptHandler):
        return bool(BROAD & kinds([node.type]))
    if not isinstance(node, ast.Call) or ast.unparse(node.func) not in ("suppress", "contextlib.suppress"):
        return False
    return bool(BROAD & kinds(node.args))


def kinds(caught: Sequence[ast.expr | None]) -> set[str]:
    return {
        "" if one is None else ast.unparse(one)
        for kind in caught
        for one in (kind.elts if isinstance(kind, ast.Tuple) else [kind])
    }


def leaves_a_trace(node: ast.AST) -> bool:
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


def test_nothing_is_caught_without_a_trace() -> None:
    silent = Counter(
        (path.relative_to(PACKAGE).as_posix(), function)
        for path in PACKAGE.rglob("*.py")
        for function, node in catchers(ast.parse(path.read_text(encoding="utf-8")))
        if not leaves_a_trace(node)
    )
    assert silent == {place: count for place, (count, _) in SILENT.items()}


def test_methods_of_one_name_and_nested_ones_are_told_apart() -> None:
    body = "with suppress(OSError):\n   pass\n  try:\n   pass\n  except Exception:\n   pass\n"
    code = f"class A:\n def f(self):\n  {body}class B:\n def f(self):\n  def g():\n   try: 1\n   except: 2\n"
    assert [name for name, _ in catchers(ast.parse(code))] == ["A.f", "A.f", "B.f.g"]


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_whoever_logs_does_so_under_its_own_name(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    if "logger." in text and path.name != "log.py":  # which is given loggers
        assert "logger = logging.getLogger(__name__)" in text
