"""Clusters: worker processes on this machine by default, or a running dask scheduler.

A scheduler elsewhere is specified by its address, or by the scheduler file that contains it.

Functions import `distributed` when they are called: its import takes 0.4 s, and the explorer shows
a picture, and commands read complete cubes, before they need it or without it.
"""

import json
import logging
import multiprocessing
import os
import re
import resource
import signal
import socket
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from multiprocessing import resource_tracker
from pathlib import Path
from traceback import format_exception_only
from typing import TYPE_CHECKING, Any

import dask
from dask.system import CPU_COUNT

from pipeline.store import without_password
from pipeline.sweep.progress import plural

if TYPE_CHECKING:
    from distributed import Client

NO_SCHEDULER = "the dask scheduler is gone; run again to resume"
_QUIET = {
    # With dask's defaults, measurements for its dashboard take 4% of the CPU time.
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "10s",
}
_PRELOAD = "distributed.worker.preload"
_LOCAL: dict[str, Any] = {
    # By default, dask gives up on a worker that takes 15 s to restart, as happens at a load of 20.
    "distributed.deploy.lost-worker-timeout": "300s",
    # Nothing is served to browsers, because any web page or user on this machine could read it.
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
    _PRELOAD: [
        # This affects only threads that start later, so it must run before the worker starts any.
        "from nasm.arithmetic.memory import keep_freed_memory; keep_freed_memory()",
    ],
}
_WITHOUT_SCIPY = "from nasm.arithmetic.kernels import begin_without_scipy; begin_without_scipy()"
_TLS_FILES = "tls_ca_file", "tls_client_cert", "tls_client_key"
_ADDRESS = re.compile(r"(tcp|tls)://[^/@\s]+:\d+")
_FILE_PATIENCE = 10  # seconds to wait for the scheduler file to appear
_ANSWER_PATIENCE = 5  # seconds to wait for a scheduler elsewhere to answer; it may be starting
_GUARD = (
    'workers import the script that starts them: put what it does below if __name__ == "__main__":'
)


class ClusterError(Exception):
    """There is no cluster to compute on; the message gives the reason and the remedy."""


@contextmanager
def connect(
    scheduler: str | None = None,
    n_workers: int | None = None,
    tls: Sequence[str] | None = None,
    allowed_failures: int = 0,
    without_scipy: bool = False,
) -> Iterator[Callable[[], "Client"]]:
    """Yield a function that returns the dask Client; it connects when it is first called.

    Parameters
    ----------
    scheduler : str, optional
        Address of a running scheduler, "tcp://…" or "tls://…", or the path of its scheduler file.
        Its workers must see this machine's files and have this package installed. By default,
        workers are started on this machine; they listen on loopback only, and serve only this
        process.
    n_workers : int, optional
        Number of worker processes to start on this machine, at least 1; by default one per core.
    tls : sequence of str, optional
        The CA, certificate and key files, for a "tls://" address.
    allowed_failures : int
        How often a task whose worker died is sent to another worker on this machine. By default it
        is suspect at once, not after it has killed more workers, and the sweep reruns each suspect
        alone. (A scheduler elsewhere has its own limit, by default 3.)
    without_scipy : bool
        True if workers on this machine will run no functions but this package's own. They then call
        `nasm.arithmetic.kernels.begin_without_scipy`, which saves each 0.4 CPU seconds.

    Raises
    ------
    ClusterError
        At once if the arguments contradict each other; when the function is called, if the
        scheduler does not answer or has no workers.
    ConnectionError
        When the function is called, if workers cannot be started.

    Examples
    --------
    >>> from pipeline.sweep.cluster import connect
    >>> with connect() as client:  # client() would start the workers
    ...     pass
    """
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        sys.exit(_GUARD)  # this is a worker being started, which imports the script
    if scheduler is not None and n_workers is not None:
        reason = "has its own workers; leave --workers out"
        raise ClusterError(f"the scheduler at {without_password(scheduler)} {reason}")
    address = None if scheduler is None else _address(scheduler)
    if (tls is not None) != (address or "").startswith("tls://"):
        raise ClusterError("a tls:// address needs TLS files: CA, CERT and KEY; others take none")
    # These loggers would write tracebacks when processes end; the sweep prints a sentence instead.
    for name in ("asyncio", "distributed.batched", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    own = _QUIET | {"distributed.scheduler.allowed-failures": allowed_failures}
    with ExitStack() as stack:

        @cache
        def client() -> "Client":
            import distributed  # noqa: F401  # it adds its defaults to dask's

            # The user's configuration files and environment may select forked workers, or set
            # timeouts, for other clusters. They could make workers on this machine hang, so these
            # use dask's defaults.
            defaults = dask.config.merge(*dask.config.defaults) | _LOCAL
            if without_scipy:
                defaults[_PRELOAD] = [*_LOCAL[_PRELOAD], _WITHOUT_SCIPY]
            stack.enter_context(dask.config.set(own if address else defaults | own))
            workers = _remote(address, tls) if address else _local(n_workers or CPU_COUNT)
            return stack.enter_context(workers)

        yield client


@contextmanager
def _local(n_workers: int) -> Iterator["Client"]:
    """Start workers on this machine, yield the Client, and stop the workers at the end."""
    from distributed import Client, LocalCluster
    from distributed.security import Security

    _check_machine(n_workers)
    # A Ctrl-C in the terminal reaches all its processes, but is meant for the driver. Workers,
    # including restarted ones, inherit the signal mask of the thread that dask starts here.
    resource_tracker.ensure_running()  # if started with a worker, it would unblock the signal
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        cluster = LocalCluster(
            n_workers=n_workers,
            threads_per_worker=1,
            # Tiles need so little memory that monitoring it is not worth the cost.
            memory_limit=0,
            host="127.0.0.1",
            # Dask executes any code that it is sent, and any user of this machine can send to
            # loopback. A temporary certificate ensures that only the cluster's own processes can
            # connect.
            security=Security.temporary(),
            dashboard_address="127.0.0.1:0",
            scheduler_kwargs={"dashboard": False},
            silence_logs="CRITICAL",
        )
    except Exception as error:
        reason = _reason(error)
        raise ConnectionError(f"workers on this machine cannot be started: {reason}") from None
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
    client = Client(cluster, set_as_default=False)
    try:
        yield client
    except KeyboardInterrupt:
        # Dask would wait four seconds for the tiles in flight, which are abandoned.
        for nanny in cluster.workers.values():
            nanny.auto_restart = False
            with suppress(OSError, TypeError):  # it has no process
                os.kill(nanny.pid, signal.SIGKILL)
        raise
    finally:
        for opened in client, cluster:
            with suppress(TimeoutError):  # occurs on busy machines; both end with this process
                opened.close()


def _check_machine(n_workers: int) -> None:
    """Raise ConnectionError if the machine lacks what workers need; otherwise they might hang."""
    cannot = "workers on this machine cannot be started: "
    with suppress(OSError, ValueError):
        _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
    allowed, needed = resource.getrlimit(resource.RLIMIT_NOFILE)[0], 50 + 10 * n_workers
    if 0 <= allowed < needed:  # -1 means no limit
        files = f"{plural(n_workers, 'worker')} and their driver need about {needed} open files"
        remedy = "raise the limit (ulimit -n), or use fewer --workers"
        raise ConnectionError(f"{cannot}{files}, and {allowed} are allowed; {remedy}")
    try:
        multiprocessing.get_context("spawn").Lock()
    except OSError as error:
        raise ConnectionError(f"{cannot}they need semaphores, in /dev/shm: {error}") from None
    try:
        with (
            socket.create_server(("127.0.0.1", 0)) as server,
            socket.create_connection(server.getsockname(), timeout=10),
        ):
            pass
    except OSError as error:
        raise ConnectionError(f"{cannot}they need the address 127.0.0.1: {error}") from None


def _reason(error: BaseException) -> str:
    """Return dask's reason for not starting workers and, for a script, a possible remedy."""
    while (cause := error.__cause__ or error.__context__) is not None:
        error = cause
    reason = "".join(format_exception_only(error)).strip()
    main = sys.modules["__main__"]
    is_script = getattr(main, "__spec__", None) is None and hasattr(main, "__file__")
    return f"{reason}. If this is a script: {_GUARD}" if is_script else reason


def write_credentials(client: "Client", folder: str | Path) -> list[str]:
    """Write the TLS files that other processes need to use the client's workers.

    Returns
    -------
    list of str
        Paths of the CA, the certificate and the key, in `folder`.
    """
    paths: list[str] = []
    for name in _TLS_FILES:
        paths.append(str(Path(folder) / f"{name}.pem"))
        Path(paths[-1]).write_text(getattr(client.security, name))
    return paths


def are_on_this_machine(client: "Client") -> bool:
    """Return True if the client's workers belong to a LocalCluster of this process.

    Workers of any other cluster start when that cluster's queue allows it.
    """
    from distributed import LocalCluster

    return isinstance(client.cluster, LocalCluster)


def are_starting(client: "Client") -> bool:
    """Return True if workers of this process are starting; on a busy machine this takes minutes."""
    from distributed import Status

    nannies = client.cluster.workers.values() if are_on_this_machine(client) else ()
    processes = [getattr(n, "process", None) for n in nannies if n.status == Status.running]
    return any(process and process.status != Status.running for process in processes)


@contextmanager
def _remote(address: str, tls: Sequence[str] | None) -> Iterator["Client"]:
    """Connect to a running scheduler, and yield the Client."""
    from distributed import Client
    from distributed.security import Security

    security = tls and Security(require_encryption=True, **dict(zip(_TLS_FILES, tls, strict=True)))
    try:
        client = Client(address, security=security, timeout=_ANSWER_PATIENCE, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise ClusterError(
            f"no dask scheduler answers at {address} ({error}); start one with `dask scheduler`, "
            "or leave the address out to compute on this machine. A scheduler with TLS needs a "
            "tls:// address and PEM files: its CA, a certificate, and the certificate's key"
        ) from None
    with client:
        if not client.nthreads():
            raise ClusterError(f"the scheduler at {address} has no workers; start `dask worker`s")
        yield client


def _address(scheduler: str) -> str:
    """Return `scheduler` if it is an address; else wait for this file and read the address."""
    address: Any = scheduler
    if "://" not in scheduler:
        file, end = Path(scheduler).expanduser(), time.monotonic() + _FILE_PATIENCE
        while not file.exists() and time.monotonic() < end:
            time.sleep(0.1)
        if not file.exists():
            raise ClusterError(f"scheduler={scheduler!r}: no such file, and not an address")
        with suppress(OSError, ValueError, KeyError, TypeError, RecursionError):
            address = json.loads(file.read_bytes())["address"]
    if not _ADDRESS.fullmatch(str(address)):
        shown = without_password(scheduler)
        raise ClusterError(
            f"scheduler={shown!r} must be tcp://HOST:PORT or tls://HOST:PORT, or the file that "
            "`dask scheduler --scheduler-file` has written"
        )
    return address
