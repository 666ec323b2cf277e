"""Clusters: worker processes on this machine by default, or a running dask scheduler.

A scheduler elsewhere is named by its address, or by the file in which it has written that.
"""

import json
import logging
import multiprocessing
import re
import resource
import signal
import socket
import sys
import time
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from multiprocessing import resource_tracker
from pathlib import Path
from traceback import format_exception_only

import dask
from dask.system import CPU_COUNT
from distributed import Client, LocalCluster, Status
from distributed.security import Security

from pipeline.store import without_password
from pipeline.sweep.progress import plural

NO_SCHEDULER = "the dask scheduler is gone; run again to resume"
_QUIET = {
    # A task that was with a worker when it died is suspect at once, not after it killed three
    # more; the sweep reruns suspects alone. (A scheduler elsewhere has its own setting, 3 deaths.)
    "distributed.scheduler.allowed-failures": 0,
    # What dask measures for its dashboard takes 4% of the CPU by default.
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "10s",
}
_LOCAL = {
    # Dask would give up a worker for good that takes 15 s to be started again, as at load 20.
    "distributed.deploy.lost-worker-timeout": "300s",
    # Nothing is served to browsers, which any page or user of this machine could ask.
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
    "distributed.worker.preload": [
        # Before the worker starts the threads that it counts for.
        "from nasm.arithmetic.memory import keep_freed_memory; keep_freed_memory()",
    ],
}
_TLS_FILES = "tls_ca_file", "tls_client_cert", "tls_client_key"
_ADDRESS = re.compile(r"(tcp|tls)://[^/@\s]+:\d+")
_FILE_PATIENCE = 10  # seconds to wait for the file of a scheduler that is being started
_GUARD = (
    'workers import the script that starts them: put what it does below if __name__ == "__main__":'
)


class ClusterError(Exception):
    """No cluster to compute on; the message says why, and what to do."""


@contextmanager
def connect(scheduler=None, n_workers=None, tls=None):
    """Yield a function that returns the dask Client; it connects when it is first called.

    scheduler : address of a running scheduler, "tcp://…" or "tls://…", or the path of its scheduler
        file, whose workers see this machine's files and have this package; by default workers are
        started on this machine, which listen on loopback only, and to nobody but this process.
    n_workers : int ≥ 1, worker processes to start here; default one per core.
    tls : (ca, cert, key) files, for a "tls://" address.

    ClusterError if the arguments do not go together, here; if the scheduler does not answer or has
    no workers, when the function is called. ConnectionError then if workers cannot be started.
    """
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        sys.exit(_GUARD)  # a worker to be, which imports the script
    if scheduler is not None and n_workers is not None:
        words = "has its own workers; leave --workers out"
        raise ClusterError(f"the scheduler at {without_password(scheduler)} {words}")
    address = None if scheduler is None else _address(scheduler)
    if (tls is not None) != (address or "").startswith("tls://"):
        raise ClusterError("a tls:// address needs TLS files: CA, CERT and KEY; others take none")
    # What they would log of processes that are gone are tracebacks; the sweep says it in words.
    for name in ("asyncio", "distributed.batched", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    settings = _QUIET
    if address is None:
        # What the user's files and environment say, of workers by fork or of timeouts, is for other
        # clusters and may hang this one: it has dask's own defaults.
        settings = dask.config.merge(*dask.config.defaults) | _LOCAL | _QUIET
    with dask.config.set(settings), ExitStack() as stack:
        connection = _local(n_workers) if address is None else _remote(address, tls)
        yield cache(lambda: stack.enter_context(connection))


@contextmanager
def _local(n_workers):
    how = {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0", "silence_logs": "CRITICAL"}
    # Tiles are small: to watch the memory costs more than they use.
    how |= {"n_workers": n_workers or CPU_COUNT, "threads_per_worker": 1, "memory_limit": 0}
    # Dask executes what it is sent, and any user of this machine can send to loopback: a
    # certificate that lasts as long as the cluster lets only its own processes speak to it.
    how |= {"security": Security.temporary(), "scheduler_kwargs": {"dashboard": False}}
    _check_machine(how["n_workers"])
    # A Ctrl-C in the terminal reaches all its processes, and is for the driver. Workers, also those
    # that are started again, inherit the mask of the thread that dask starts here, at their birth.
    resource_tracker.ensure_running()  # it would unblock the signal as it starts with a worker
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        started = LocalCluster(**how)
    except Exception as error:
        raise ConnectionError(f"workers on this machine cannot be started: {_why(error)}") from None
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
    client = Client(started, set_as_default=False)
    try:
        yield client
    finally:
        for opened in client, started:
            with suppress(TimeoutError):  # what is too slow, on a busy machine, ends with us
                opened.close()


def _check_machine(n_workers):
    """ConnectionError if the machine lacks what workers need, without which they might hang."""
    cannot = "workers on this machine cannot be started: "
    with suppress(OSError, ValueError):
        _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
    allowed, needed = resource.getrlimit(resource.RLIMIT_NOFILE)[0], 50 + 10 * n_workers
    if 0 <= allowed < needed:  # without a limit it is -1
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


def _why(error):
    """Return the reason, in dask's words, why workers did not start, and how to mend a script."""
    while (reason := error.__cause__ or error.__context__) is not None:
        error = reason
    words = "".join(format_exception_only(error)).strip()
    main = sys.modules["__main__"]
    is_script = getattr(main, "__spec__", None) is None and hasattr(main, "__file__")
    return f"{words}. If this is a script: {_GUARD}" if is_script else words


def credentials(client, folder):
    """Write what other processes need to use the client's workers: paths of CA, CERT and KEY."""
    paths = []
    for name in _TLS_FILES:
        paths.append(str(Path(folder) / f"{name}.pem"))
        Path(paths[-1]).write_text(getattr(client.security, name))
    return paths


def are_starting(client):
    """Whether workers of ours are being started, which on a busy machine takes its time."""
    nannies = client.cluster.workers.values() if client.cluster else ()
    processes = [getattr(n, "process", None) for n in nannies if n.status == Status.running]
    return any(process and process.status != Status.running for process in processes)


@contextmanager
def _remote(address, tls):
    security = tls and Security(require_encryption=True, **dict(zip(_TLS_FILES, tls, strict=True)))
    try:
        client = Client(address, security=security, timeout=5, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise ClusterError(
            f"no dask scheduler answers at {address} ({error}); start one with `dask scheduler`, "
            "or leave the address out to compute on this machine. One with TLS needs a tls:// "
            "address and PEM files: its CA, a certificate, and the key of that"
        ) from None
    with client:
        if not client.nthreads():
            raise ClusterError(f"the scheduler at {address} has no workers; start `dask worker`s")
        yield client


def _address(scheduler):
    """Return the address that `scheduler` is, or that its file holds, which is waited for."""
    address = scheduler
    if "://" not in scheduler:
        file, end = Path(scheduler).expanduser(), time.monotonic() + _FILE_PATIENCE
        while not file.exists() and time.monotonic() < end:
            time.sleep(0.1)
        if not file.exists():
            raise ClusterError(f"scheduler={scheduler!r}: no such file, nor is it an address")
        with suppress(OSError, ValueError, KeyError, TypeError, RecursionError):
            address = json.loads(file.read_bytes())["address"]
    if not _ADDRESS.fullmatch(str(address)):
        shown = without_password(scheduler)
        raise ClusterError(
            f"scheduler={shown!r} must be tcp://HOST:PORT or tls://HOST:PORT, or the file that "
            "`dask scheduler --scheduler-file` has written"
        )
    return address
