"""Clusters: worker processes on this machine by default, or a running dask scheduler.

A scheduler elsewhere is named by its address, or by the file in which it has written that.
"""

import json
import logging
import os
import re
import signal
import threading
from contextlib import contextmanager
from functools import partial
from multiprocessing import resource_tracker

import dask
from dask.system import CPU_COUNT
from distributed import Client, LocalCluster
from distributed.comm import CommClosedError
from distributed.security import Security

from pipeline.admission import ClusterError, comparing
from pipeline.faults import NO_SCHEDULER

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
_LOOPBACK = {"distributed.comm.require-encryption": False}
"""A site's demand is for its network."""


_ADDRESS = re.compile(r"(tcp|tls)://[^/\s]+:\d+")


@contextmanager
def connect(warm_up, scheduler=None, n_workers=None, tls=None):
    """A dask Client whose workers have our versions and are warmed up, also those that join later.

    Parameters
    ----------
    warm_up : function without arguments, run once in each worker process.
    scheduler : address of a running scheduler, "tcp://…" or "tls://…", or the path of its scheduler
        file, whose workers see this machine's files and have this package; by default workers are
        started on this machine, which listen on loopback only.
    n_workers : int ≥ 1, worker processes to start here; default one per core.
    tls : (ca, cert, key) files, for a "tls://" address.

    ClusterError if the scheduler does not answer or has no workers, or workers that are not fit.
    """
    if n_workers is not None and n_workers < 1:
        raise ClusterError(f"workers={n_workers} must be at least 1")
    if scheduler is None and tls is not None:
        raise ClusterError("TLS files are for a scheduler elsewhere; give its tls:// address too")
    if scheduler is not None and n_workers is not None:
        raise ClusterError(f"the scheduler at {scheduler} has its own workers; leave --workers out")
    if scheduler is None:
        settings = QUIET | _LOOPBACK
        connection, prepare = _local(n_workers), partial(_ready_ours, warm_up)
    else:
        settings = QUIET
        connection, prepare = _remote(_address(scheduler), tls), warm_up
    with dask.config.set(settings), connection as client, comparing(client, prepare):
        yield client


def _ready_ours(warm_up):
    """Ready a worker that the driver has started: deaf to a Ctrl-C that is meant for the driver."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    warm_up()


@contextmanager
def _local(n_workers):
    with _interrupts_kept() as kept:
        cluster = LocalCluster(
            n_workers=n_workers or CPU_COUNT,
            threads_per_worker=1,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",
            memory_limit=0,  # tiles are small; to watch the memory costs more than they use
            silence_logs="CRITICAL",
        )
    with cluster, Client(cluster, set_as_default=False) as client:
        try:
            if kept:
                raise KeyboardInterrupt
            yield client
        except KeyboardInterrupt:
            # It would log what the workers were being asked and will not answer.
            logging.getLogger("asyncio").setLevel(logging.CRITICAL)
            raise


@contextmanager
def _interrupts_kept():
    """A list of the Ctrl-C that come meanwhile, which do nothing else.

    Threads that are started meanwhile are deaf to it, and so are the processes that they start:
    workers, until their plugin sees to it. A program that was started with Ctrl-C ignored ignores
    it, and its workers with it.
    """
    kept = []
    ignored = signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    if ignored or threading.current_thread() is not threading.main_thread():
        yield kept
        return
    resource_tracker.ensure_running()  # as it starts, it makes the thread hear again
    previous = signal.signal(signal.SIGINT, lambda *_: kept.append(True))
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield kept
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        signal.signal(signal.SIGINT, previous)


def _address(scheduler):
    """The address that `scheduler` is, or that its file holds."""
    if _ADDRESS.fullmatch(scheduler):
        return scheduler
    if "://" in scheduler or not os.path.isfile(scheduler):
        raise ClusterError(
            f"scheduler={scheduler!r} must be tcp://HOST:PORT or tls://HOST:PORT, or the file that "
            "`dask scheduler --scheduler-file` has written; there is no such file"
        )
    try:
        with open(scheduler, encoding="utf-8") as file:
            address = json.load(file)["address"]
        if _ADDRESS.fullmatch(address):
            return address
    except OSError as error:
        raise ClusterError(
            f"cannot read the scheduler file {scheduler}: {error.strerror}"
        ) from None
    except (ValueError, KeyError, TypeError):
        pass
    raise ClusterError(
        f"{scheduler} is no scheduler file: no JSON with an address tcp://HOST:PORT or "
        "tls://HOST:PORT; give the one that `dask scheduler --scheduler-file` has written"
    )


@contextmanager
def _remote(address, tls):
    # What dask would log of a scheduler that is gone are tracebacks; the sweep says it in words.
    for name in ("client", "batched"):
        logging.getLogger(f"distributed.{name}").setLevel(logging.CRITICAL)
    security = _security(address, tls)
    try:
        client = Client(address, security=security, timeout=5, set_as_default=False)
    except CommClosedError:
        raise ClusterError(
            f"{address} answers, but hangs up: a scheduler with TLS needs a tls:// address and "
            "certificates of the CA that it knows; one without TLS, a tcp:// address; one that is "
            "being stopped, to be started again"
        ) from None
    except (OSError, ValueError, TypeError) as error:
        raise ClusterError(
            f"no dask scheduler answers at {address} ({error}); start one with `dask scheduler`, "
            "or leave the address out to compute on this machine"
        ) from None
    with client:
        try:
            if not client.scheduler_info(n_workers=-1)["workers"]:
                raise ClusterError(
                    f"the scheduler at {address} has no workers; start `dask worker`s"
                )
            yield client
        except CommClosedError:
            raise ConnectionError(NO_SCHEDULER) from None


def _security(address, tls):
    if address.startswith("tcp://"):
        if tls is not None:
            raise ClusterError(f"TLS files are for a tls:// address, not {address}")
        return None
    if tls is None:
        raise ClusterError(f"the scheduler at {address} needs TLS files: CA, CERT and KEY")
    ca, cert, key = map(os.fspath, tls)
    security = Security(
        tls_ca_file=ca, tls_client_cert=cert, tls_client_key=key, require_encryption=True
    )
    try:
        security.get_connection_args("client")
    except OSError as error:
        raise ClusterError(
            f"the TLS files {ca}, {cert} and {key} cannot be used ({error}); they must be the CA's "
            "certificate, a certificate, and the key of that, in PEM format"
        ) from None
    return security
