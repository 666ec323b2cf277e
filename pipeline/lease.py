"""A lease: one driver at a time in an object store, which knows no locks.

The lease is one small object, written only on a condition that the store itself checks.

1. Take it: put it if it is absent; or, if it is free or has expired, replace it if it is still the
   one that was read.
2. Keep it: a thread replaces it by a new one again and again, if it is still the one before.
3. It has expired if it was not replaced for a time, by the store's clock alone: the time of its
   last change against that of a probe written now. No driver's clock is read: it may be wrong.
4. Release it: replace it by an empty object, on the same condition.

A driver that was cut off for so long that another took over says so at its end. What both have
written is the same.
"""

import json
import os
import socket
import threading
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from uuid import uuid4

from obstore.exceptions import AlreadyExistsError, BaseError, PreconditionError

from pipeline.faults import StorageError, StoreError
from pipeline.seal import parsed

LEASE = 60
"""Seconds without a renewal after which a driver counts as dead. It renews four times as often."""

_KEY = ".lease"
_PROBE = ".lease-probe"
_UNKNOWN = {"process": "?", "host": "?", "run": "?"}
KEYS = frozenset({_KEY, _PROBE})


@contextmanager
def leased(store, url):
    """Hold the lease of an obstore store; `url` names it in messages."""
    holder = {
        "process": os.getpid(),
        "host": socket.gethostname(),
        "run": uuid4().hex,
        "renewal": 0,
    }
    try:
        version = _take(store, url, holder)
    except NotImplementedError:  # AWS_CONDITIONAL_PUT=disabled
        raise StoreError(
            f"{url} is set to do without conditions on writes, so two runs could not be kept apart"
        ) from None
    if _put(store, {**holder, "run": ""}, "create") is not None:
        raise StoreError(f"{url} ignores conditions on writes, so two runs could not be kept apart")
    stop, lost = threading.Event(), threading.Event()
    keeper = threading.Thread(target=_keep, args=[store, holder, version, stop, lost], daemon=True)
    keeper.start()
    try:
        yield
    finally:
        stop.set()
        keeper.join(timeout=5)  # a store that is gone is not waited for; the lease will expire
    if lost.is_set():
        raise StorageError(
            f"{url} was taken over by another run, as this one was not heard of for {LEASE} s"
        )


def holder(store):
    """Who holds the lease now, in words; "" if nobody does. By this machine's clock: it tells only,
    and writes nothing."""
    try:
        found, other = _read(store)
    except FileNotFoundError:
        return ""
    age = (datetime.now(UTC) - found["last_modified"]).total_seconds()
    if not other or age > LEASE:
        return ""
    return f"process {other['process']} on {other['host']}, heard of {max(0, age):.0f} s ago"


def _take(store, url, holder):
    """The version of the lease that we now hold."""
    version = _put(store, holder, "create")
    if version is not None:
        return version
    found, other = _read(store)
    if other:
        age = (_now(store) - found["last_modified"]).total_seconds()
        if age <= LEASE:
            raise StoreError(
                f"{url} is being written by another run (process {other['process']} on "
                f"{other['host']}, heard of {age:.0f} s ago); wait for it or stop it; if it is "
                f"dead, try again in {LEASE - age + 1:.0f} s"
            )
    version = _put(store, holder, _is(found))
    if version is None:
        raise StoreError(f"{url} has just been taken by another run; wait for it or stop it")
    return version


def _keep(store, holder, version, stop, lost):
    """Renew until told to stop, then release. A store that does not answer is asked again."""
    while not stop.wait(LEASE / 4):
        holder["renewal"] += 1
        with suppress(BaseError):
            version = _put(store, holder, version)
            if version is None:
                lost.set()
                return
    with suppress(BaseError):
        if _put(store, {}, version) is None:
            lost.set()


def _put(store, holder, condition):
    """Write the lease; its version, or None if the condition did not hold."""
    try:
        body = json.dumps(holder).encode() if holder else b""
        return _is(store.put(_KEY, body, mode=condition))
    except (AlreadyExistsError, PreconditionError, FileNotFoundError):
        # It may have been ourselves: a write of which we never got the answer.
        with suppress(FileNotFoundError):
            found, present = _read(store)
            if holder and present.get("run") == holder["run"]:
                return _is(found)
        return None


def _read(store):
    """(What the store says of the lease, its holder); the holder of a free one is {}."""
    answer = store.get(_KEY)
    body = bytes(answer.bytes())
    return answer.meta, (_UNKNOWN | (parsed(body) or {})) if body else {}


def _is(found):
    """The condition that the lease is still this one; stores tell by the one or the other."""
    return {key: found[key] for key in ("e_tag", "version") if found[key] is not None}


def _now(store):
    """The store's clock."""
    store.put(_PROBE, b"")
    return store.head(_PROBE)["last_modified"]
