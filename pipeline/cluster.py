"""Clusters: worker processes on this machine by default, or a running dask scheduler by address."""

import logging
import os
import re
import signal
import threading
from contextlib import contextmanager, suppress

import dask
from dask.system import CPU_COUNT
from distributed import Client, LocalCluster, WorkerPlugin
from distributed.security import Security

QUIET = {
    # A task that was with a worker when it died is suspect at once, not after it killed three
    # more; the sweep reruns suspects alone. (A scheduler elsewhere has its own setting, 3 deaths.)
    "distributed.scheduler.allowed-failures": 0,
    # What dask measures for its dashboard takes 4% of the CPU by default.
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.tick.limit": "1h",
    "distributed.admin.system-monitor.interval": "10s",
    "distributed.admin.system-monitor.gil.enabled": False,
}


class ClusterError(Exception):
    """No cluster to compute on; the message says why, and what to do."""


class _WarmUp(WorkerPlugin):
    """Readies a worker: compiled kernels, and, for a worker on this machine that the driver has
    started, deaf to a Ctrl-C that is meant for the driver."""

    name = "nasm-warm-up"

    def __init__(self, warm_up, ours):
        self.warm_up, self.ours = warm_up, ours

    def setup(self, worker):
        if self.ours and threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGINT, signal.SIG_IGN)
        self.warm_up()


@contextmanager
def connect(warm_up, scheduler=None, n_workers=None, tls=None):
    """A dask Client whose workers are warmed up.

    Parameters
    ----------
    warm_up : function without arguments, run once in each worker process.
    scheduler : address of a running scheduler, "tcp://…" or "tls://…", whose workers see this
        machine's files and have this package; by default workers are started on this machine, which
        listen on loopback only.
    n_workers : int ≥ 1, worker processes to start here; default one per core.
    tls : (ca, cert, key) files, for a "tls://" address.

    ClusterError if the scheduler does not answer or has no workers.
    """
    if n_workers is not None and n_workers < 1:
        raise ClusterError(f"workers={n_workers} must be at least 1")
    if scheduler is None and tls is not None:
        raise ClusterError("TLS files are for a scheduler elsewhere; give its tls:// address too")
    if scheduler is not None and n_workers is not None:
        raise ClusterError(f"the scheduler at {scheduler} has its own workers; leave --workers out")
    if scheduler is not None and not re.fullmatch(r"(tcp|tls)://[^/\s]+:\d+", scheduler):
        raise ClusterError(f"scheduler={scheduler!r} must be tcp://HOST:PORT or tls://HOST:PORT")
    if scheduler is not None and scheduler.startswith("tls://") and tls is None:
        raise ClusterError(f"the scheduler at {scheduler} needs TLS files: CA, CERT and KEY")
    connection = _local(n_workers) if scheduler is None else _remote(scheduler, tls)
    with dask.config.set(QUIET), connection as client:
        client.register_plugin(_WarmUp(warm_up, ours=scheduler is None))
        yield client
        if scheduler is not None:
            # A worker has gone meanwhile, and the others do without it; or the scheduler is a new
            # one, started again, that knows of none.
            with suppress(OSError, ValueError):
                client.unregister_worker_plugin(_WarmUp.name)


@contextmanager
def _local(n_workers):
    with _deaf_to_interrupts():  # workers inherit that, until their plugin sees to it
        cluster = LocalCluster(
            n_workers=n_workers or CPU_COUNT,
            threads_per_worker=1,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",
            memory_limit=0,  # tiles are small; to watch the memory costs more than they use
            silence_logs="CRITICAL",
        )
    with cluster, Client(cluster, set_as_default=False) as client:
        yield client


@contextmanager
def _deaf_to_interrupts():
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    previous = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, previous)


@contextmanager
def _remote(address, tls):
    # What dask would log of a scheduler that is gone is a traceback; the sweep says it in words.
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    security = None
    if tls is not None:
        ca, cert, key = map(os.fspath, tls)
        security = Security(
            tls_ca_file=ca, tls_client_cert=cert, tls_client_key=key, require_encryption=True
        )
    try:
        client = Client(address, security=security, timeout=5, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise ClusterError(
            f"no dask scheduler answers at {address} ({error}); start one with `dask scheduler`, "
            "or leave the address out to compute on this machine"
        ) from None
    with client:
        if not client.scheduler_info()["workers"]:
            raise ClusterError(f"the scheduler at {address} has no workers; start `dask worker`s")
        yield client
