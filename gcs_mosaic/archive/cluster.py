"""The workers: a local cluster with one for each core, or any Dask cluster that is there already."""

from __future__ import annotations

import logging
import os
import signal
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib.util import find_spec
from multiprocessing import resource_tracker

import dask
from distributed import Client, LocalCluster
from distributed.security import Security
from distributed.utils import LoopRunner
from tornado.ioloop import IOLoop

from gcs_mosaic.archive import worker_setup
from gcs_mosaic.archive.versions import versions
from gcs_mosaic.errors import FlightFailed, UsageError

logger = logging.getLogger(__name__)

CONNECT_S = 10.0  # to a scheduler
WAIT_S = 60.0  # for the first worker of a cluster
# Settings of a local cluster. A task that has killed so many workers and one more is not given to another (Dask's default is 3).
# A worker that has died is started again by its nanny; the cluster would give that one up if it happens twice within 15 s.
KEYS = "distributed.comm.tls, such as DASK_DISTRIBUTED__COMM__TLS__CA_FILE"
PRELOAD = "distributed.worker.preload"
LOCAL = {"distributed.scheduler.allowed-failures": 1, "distributed.deploy.lost-worker-timeout": "365 days"}


@contextmanager
def workers_at(address: str | None, count: int | None = None, *, dashboard: bool = False) -> Iterator[Client]:
    """A client of the cluster at this address, or of a local one with so many workers. Raises UsageError."""
    if address is None:
        with _local(count or os.cpu_count() or 1, dashboard=dashboard) as client:
            yield client
        return
    with _connected(address) as client:
        check_versions(client, address)
        yield client


@contextmanager
def _local(count: int, *, dashboard: bool) -> Iterator[Client]:
    if dashboard and find_spec("bokeh") is None:
        raise UsageError("--dashboard needs the package bokeh: pip install bokeh")
    with (
        dask.config.set(LOCAL | {PRELOAD: [*dask.config.get(PRELOAD, []), worker_setup.__name__]}),
        tempfile.TemporaryDirectory(prefix="gcs-mosaic-workers-", ignore_cleanup_errors=True) as scratch,
        _uninterrupted_loop() as loop,
        _interrupts_held() as release,
        _started(count, scratch, loop, dashboard=dashboard) as cluster,
    ):
        release()
        with Client(cluster) as client:
            yield client


@contextmanager
def _interrupts_held() -> Iterator[Callable[[], None]]:
    """Ctrl-C waits until what is yielded is called: Dask cannot close a cluster that is starting. A second one does not wait."""
    if threading.current_thread() is not threading.main_thread():
        yield lambda: None
        return
    held = threading.Event()

    def hold(*_: object) -> None:
        if held.is_set():
            raise KeyboardInterrupt
        held.set()

    def release() -> None:
        signal.signal(signal.SIGINT, before)
        if held.is_set():
            held.clear()
            signal.raise_signal(signal.SIGINT)

    before = signal.signal(signal.SIGINT, hold)
    try:
        yield release
    finally:
        release()


@contextmanager
def _uninterrupted_loop() -> Iterator[IOLoop]:
    """A loop in a thread to which Ctrl-C is not told, nor to the processes that it starts: the client is, and ends them."""
    resource_tracker.ensure_running()  # which lets Ctrl-C through again where it starts
    runner, can_block = LoopRunner(), hasattr(signal, "pthread_sigmask")
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}) if can_block else set()
    try:
        runner.start()
    finally:
        if can_block:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
    try:
        yield runner.loop
    finally:
        runner.stop()


def _started(count: int, scratch: str, loop: IOLoop, *, dashboard: bool) -> LocalCluster:
    """Raises FlightFailed."""
    # With keys of its own, because whoever reaches a scheduler can have it run code: others who use this machine, too.
    try:
        return LocalCluster(
            loop=loop,
            n_workers=count,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            security=Security.temporary(),
            dashboard_address="127.0.0.1:0",
            worker_dashboard_address="127.0.0.1:0",
            scheduler_kwargs={"dashboard": dashboard},
            silence_logs=logging.CRITICAL,
            local_directory=scratch,
        )
    except (RuntimeError, OSError) as error:
        logger.debug("the workers cannot be started", exc_info=True)
        raise FlightFailed(
            f"{count} workers cannot be started here ({_cause(error)}): try fewer by --workers, and see that there is memory"
        ) from None


def _cause(error: BaseException) -> str:
    """What Dask wraps, in a line."""
    while error.__cause__ is not None:
        error = error.__cause__
    return f"{type(error).__name__}: {error}".partition("\n")[0]


def _connected(address: str) -> Client:
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what it means is said in one sentence
    try:
        return Client(address, timeout=CONNECT_S)
    except (OSError, TimeoutError):
        raise UsageError(
            f"--cluster {address}: no scheduler answers there; start one (dask scheduler), or leave --cluster out"
        ) from None
    except TypeError:  # an address of tls:// without keys
        raise UsageError(
            f"--cluster {address}: its keys are missing; name them in Dask's own settings, {KEYS}"
        ) from None
    except (ValueError, OverflowError) as error:
        raise UsageError(f"--cluster {address}: {error}; give an address such as tcp://HOST:8786") from None


def check_versions(client: Client, address: str) -> None:
    """Raises UsageError unless all workers have this program and its libraries in the versions that are here."""
    try:
        client.wait_for_workers(1, timeout=WAIT_S)
    except TimeoutError:
        raise UsageError(
            f"--cluster {address}: the scheduler has no workers; start some (dask worker {address})"
        ) from None
    try:
        found: Mapping[str, dict[str, str]] = client.run(versions, on_error="return")
    except Exception as error:
        raise UsageError(f"--cluster {address}: its workers do not answer ({error!r})") from None
    ours = versions()
    for worker, theirs in sorted(found.items()):
        if isinstance(theirs, OSError):  # it has gone, or cannot be reached
            raise UsageError(
                f"--cluster {address}: the worker {worker} does not answer ({theirs!r}); end it, or start it anew"
            )
        if not isinstance(theirs, dict):
            raise UsageError(
                f"--cluster {address}: the worker {worker} lacks this program ({theirs!r}); install gcs-mosaic[cluster] there"
            )
        unlike = [
            f"{name} {theirs.get(name)} (here {version})"
            for name, version in ours.items()
            if theirs.get(name) != version
        ]
        if unlike:
            raise UsageError(
                f"--cluster {address}: the worker {worker} has {', '.join(unlike)}; install the same there"
            )
