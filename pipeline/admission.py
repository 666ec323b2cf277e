"""Who may compute: workers whose numbers are the driver's, and who see its store.

Results must not depend on who computed them. So a worker is not fit if its copy of this package, or
a library that decides the last digits, is another one than the driver's; nor if it does not find,
where the store is, what the driver has put there. (Of all other versions dask itself warns.)

A `complaint` is a function without arguments, run on a worker: what is wrong with it, or "".
Workers that are there are all asked before any tile is computed, and one that is not fit ends the
program. A worker that joins later is asked as it joins, and sent away before it computes a tile.
"""

import re
import socket
import sys
import time
from contextlib import contextmanager, suppress
from functools import partial
from uuid import uuid4

from distributed import Status, WorkerPlugin

from pipeline.faults import StorageError
from pipeline.layout import FORMAT
from pipeline.provenance import digest_of, libraries
from pipeline.store import place_of

_SIGHT = 2  # seconds that a file system of several machines may take to show a file
_NAMED = 3  # workers in one message
_LACKING = re.compile(r"No module named '(\w+)")


class ClusterError(Exception):
    """No cluster to compute on; the message says why, and what to do."""


# Not the mathematics alone: workers write to the store too.
_SOURCE = digest_of("nasm/*.py", "pipeline/*.py")


def versions():
    """{package: version} of all that must be the same, in this process."""
    return {"nasm-transport": f"{FORMAT}, source {_SOURCE}", **libraries()}


def other_versions(ours):
    """The complaint of a worker, compared with the driver's `versions`."""
    differences = [
        f"{package} {theirs} instead of {ours[package]}"
        for package, theirs in versions().items()
        if theirs != ours[package]
    ]
    return f"has {', '.join(differences)}" if differences else ""


def unseen(place, token):
    """The complaint of a worker that does not find the driver's token in the store's place."""
    deadline = time.monotonic() + _SIGHT
    while True:
        try:
            found = place.read(place.probe)
        except StorageError as fault:
            return str(fault)
        if found == token:
            return ""
        if time.monotonic() > deadline:
            return f"does not see {place} as this machine does"
        time.sleep(0.1)


@contextmanager
def comparing(client, prepare):
    """Workers have the driver's versions, also those that join; `prepare` is run in each."""
    with _admitting(
        client,
        "versions",
        partial(other_versions, versions()),
        prepare,
        "install the same versions on all machines, and restart the workers",
    ):
        yield


@contextmanager
def sharing(client, out):
    """Workers see the place `out`, which the driver holds, also those that join."""
    place, token = place_of(out), uuid4().hex.encode()
    place.put(place.probe, token)
    cure = "choose an --out that all machines share, or an object store, and its environment"
    try:
        with _admitting(client, "sight", partial(unseen, place, token), _nothing, cure):
            yield
    finally:
        with suppress(StorageError):  # a store that fails has said so before
            place.delete([place.probe])


def _nothing():
    pass


@contextmanager
def _admitting(client, name, complaint, prepare, cure):
    name = f"nasm-{name}-{client.id}"
    _refuse_unfit(client, complaint, cure)
    client.subscribe_topic(name, lambda event: print(event[1], file=sys.stderr, flush=True))
    # A task that the scheduler knows for as long as this client is connected to it, and that no
    # worker can take: a result would be in the way of the worker that holds it when that retires.
    alive = client.submit(_nothing, key=name, resources={name: 1}, pure=False)
    _register(client, _Admission(name, complaint, prepare))
    yield
    # A worker has gone meanwhile, and the others do without it; or the scheduler is a new one,
    # started again, that knows of no plugin.
    with suppress(OSError, ValueError):
        client.unregister_worker_plugin(name)
    client.unsubscribe_topic(name)
    alive.release()


def _register(client, plugin):
    """Register the plugin with all workers; the call fails if one goes meanwhile: then again."""
    for attempts_left in (2, 1, 0):
        try:
            client.register_plugin(plugin)
            return
        except OSError:
            if not attempts_left:
                raise


def _refuse_unfit(client, complaint, cure):
    unfit = []
    for worker, answer in sorted(client.run(_asked, complaint, on_error="return").items()):
        if isinstance(answer, OSError):
            continue  # it has gone
        # Dask wraps an error of unpickling in one of its own.
        if isinstance(answer, Exception) and (lacking := _LACKING.search(str(answer))):
            unfit.append(f"the worker {worker} lacks the package {lacking[1]}")
        elif isinstance(answer, Exception):
            unfit.append(f"the worker {worker} has another nasm-transport ({answer})")
        elif answer:
            unfit.append(f"the worker {worker} {answer}")
    if unfit:
        more = f", and {len(unfit) - _NAMED} more like it" if len(unfit) > _NAMED else ""
        raise ClusterError(f"{'; '.join(unfit[:_NAMED])}{more}: {cure}")


def _asked(complaint):
    """On a worker: its complaint, with the name of its machine."""
    answer = complaint()
    return f"on {socket.gethostname()} {answer}" if answer else ""


class _Admission(WorkerPlugin):
    """Asks a worker that joins, and readies it or sends it away.

    A driver that is killed leaves this plugin at the scheduler: without its driver it does nothing.
    """

    def __init__(self, name, complaint, prepare):
        self.name, self.complaint, self.prepare = name, complaint, prepare

    async def setup(self, worker):
        known = await worker.scheduler.get_task_status(keys=[self.name])
        if known[self.name] is None:
            return
        answer = _asked(self.complaint)
        if not answer:
            self.prepare()
            return
        worker.status = Status.paused  # it starts no task; those that it has go to others
        worker.log_event(self.name, f"sent away: the worker {worker.address} {answer}")
        worker.loop.add_callback(worker.close_gracefully, reason=answer)
