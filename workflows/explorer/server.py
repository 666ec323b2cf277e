"""The server of the page: Bokeh's, on loopback, with Bokeh's check of origins.

One process serves all tabs and does the small work in threads; dask workers do the large work.
"""

import logging
import signal
import webbrowser
from functools import partial
from threading import Lock, Thread

import click
from bokeh.application import Application
from bokeh.application.handlers import FunctionHandler
from bokeh.server.server import Server
from bokeh.server.util import bind_sockets

from pipeline.sweep.cluster import ClusterError, connect
from workflows.explorer.page import fill
from workflows.explorer.rays import Rays
from workflows.explorer.warm import warm_up
from workflows.explorer.work import GONE

_HOST = "127.0.0.1"


class Shared:
    """What all tabs share.

    plane : of forcings. place : of cubes to show, only read. rays : Rays, the boundary so far.
    fields : {(View, N): Field} that were computed to the end, the newest last.
    client : function → dask Client, which waits until it is connected.
    preparing : what the page must wait for, in words; "" when all is ready.
    """

    def __init__(self, plane, place, client):
        self.plane, self.place, self._client = plane, place, client
        self.rays, self.fields = Rays(plane), {}
        self.preparing, self._lock = "starting the workers", Lock()

    def client(self):
        with self._lock:
            client = self._client()
        if client.status != "running":
            raise OSError(GONE)
        return client

    def prepare(self):
        """Start the workers and load the kernels; in a thread."""
        try:
            client = self.client()
            self.preparing = "loading the kernels"  # or compiling, where the page does not suffer
            client.submit(warm_up, pure=False).result()
            warm_up()
            self.preparing = ""
        except ClusterError as error:
            self.preparing = str(error)
        except Exception as error:  # at Ctrl-C anything
            self.preparing = f"the workers did not start: {error!r}"


def serve(plane, place, port, opens, cluster):
    """Serve the page until Ctrl-C or SIGTERM.

    plane, place : as for `Shared`. port : of the page, 0 for any. opens : whether to open it in the
    browser. cluster : arguments of `cluster.connect`.

    click.UsageError if the port is taken; ClusterError if the arguments of the cluster do not fit.
    """
    for name in ("bokeh", "tornado"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # a closed tab is no news
    port = _free(port)
    with connect(**cluster) as client:
        shared = Shared(plane, place, client)
        page = Application(FunctionHandler(partial(fill, shared=shared)))
        lifetimes = {"unused_session_lifetime_milliseconds": 10_000}
        lifetimes["check_unused_sessions_milliseconds"] = 1000
        origins = [f"localhost:{port}", f"{_HOST}:{port}"]
        where = {"address": _HOST, "port": port, "allow_websocket_origin": origins}
        server = Server({"/": page}, **where, **lifetimes)
        for number in (signal.SIGINT, signal.SIGTERM):
            stop = partial(server.io_loop.add_callback_from_signal, server.io_loop.stop)
            signal.signal(number, lambda *_, stop=stop: stop())
        preparing = Thread(target=shared.prepare, daemon=True)
        preparing.start()
        server.start()
        url = f"http://localhost:{port}/"
        click.echo(f"the explorer is at {url}\nCtrl-C ends it", err=True)
        if opens:
            server.io_loop.add_callback(webbrowser.open, url)
        server.io_loop.start()
        server.stop()
        preparing.join(20)  # workers that are about to start would stay behind


def _free(port):
    """Return the port, or any free one for 0; a usage error if it is taken."""
    try:
        sockets, found = bind_sockets(_HOST, port)
    except OSError as error:
        words = f"port {port}: {error.strerror}; another explorer? Take another, or 0 for any"
        raise click.BadParameter(words, param_hint="--port") from None
    for socket in sockets:
        socket.close()
    return found
