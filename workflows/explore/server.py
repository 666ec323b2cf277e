"""The server of the page: Bokeh's, on loopback, for the browsers of this machine alone.

One process serves all tabs and does the small work in threads; dask workers do the large work. A
page of another site may run in the same browser. It can neither read the page nor connect to it,
also if its name is made to point at this machine: the name and the origin would be its own. The
address of a page computes nothing until the page is connected.
"""

import logging
import re
import signal
import webbrowser
from functools import partial
from threading import Lock, Thread

import click
import dask
from bokeh.application import Application
from bokeh.application.handlers import FunctionHandler
from bokeh.server.server import BaseServer
from bokeh.server.tornado import BokehTornado
from bokeh.server.util import bind_sockets
from tornado.httpserver import HTTPServer
from tornado.ioloop import IOLoop
from tornado.routing import HostMatches, Rule, RuleRouter

from nasm import escape
from nasm.verdict import verdict
from pipeline.sweep.cluster import NO_SCHEDULER, ClusterError, connect
from workflows.explore.page import fill
from workflows.explore.rays import Rays
from workflows.shared.phase_space import portrait

_HOST = "127.0.0.1"
_NAMES = "localhost", _HOST, "[::1]"
_LIFETIME = 10_000  # milliseconds of a page, a few of work, whose browser does not connect


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
            raise ConnectionError(NO_SCHEDULER)
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


def warm_up():
    """Use every kernel once; the first time on a machine this compiles them, for half a minute."""
    escape.first_escape([[0.0, 0.0]], *escape.ensemble(1), [1], 1, precision="single")
    portrait((0.3, 0.2))
    verdict((0.3, 0.2))


def serve(plane, place, port, opens, cluster):
    """Serve the page until Ctrl-C or SIGTERM.

    plane, place : as for `Shared`. port : of the page, 0 for any. opens : whether to open it in the
    browser. cluster : arguments of `cluster.connect`.

    click.UsageError if the port is taken; ClusterError if the arguments of the cluster do not fit.
    """
    for name in ("bokeh", "tornado"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # nobody reads that a tab was closed
    try:
        sockets, port = bind_sockets(_HOST, port)
    except OSError as error:
        words = f"port {port}: {error.strerror}; another explorer? Take another, or 0 for any"
        raise click.BadParameter(words, param_hint="--port") from None
    # A call whose worker is lost is sent again, twice at the most.
    again = {"distributed.scheduler.allowed-failures": 2}
    with connect(**cluster) as client, dask.config.set(again):
        shared = Shared(plane, place, client)
        server = server_of(shared, sockets, port)
        loop = server.io_loop
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: loop.add_callback_from_signal(loop.stop))
        preparing = Thread(target=shared.prepare, daemon=True)
        preparing.start()
        server.start()
        url = f"http://localhost:{port}/"
        click.echo(f"the explorer is at {url}\nCtrl-C ends it", err=True)
        if opens:
            loop.add_callback(webbrowser.open, url)
        loop.start()
        server.stop()
        preparing.join(20)  # workers that are about to start would stay behind


def server_of(shared, sockets, port):
    """Return the server of the page, for the event loop of this thread."""
    web = _Web(
        Application(FunctionHandler(partial(fill, shared=shared))),
        extra_websocket_origins=[f"{name}:{port}" for name in _NAMES],
        unused_session_lifetime_milliseconds=_LIFETIME,
        check_unused_sessions_milliseconds=_LIFETIME // 10,
    )
    ours = HostMatches(f"({'|'.join(map(re.escape, _NAMES))})$")
    http = HTTPServer(RuleRouter([Rule(ours, web)]))
    http.add_sockets(sockets)
    return BaseServer(IOLoop.current(), web, http)


class _Web(BokehTornado):
    """Bokeh's web application, whose pages begin to compute when they are connected."""

    def new_connection(self, protocol, socket, application_context, session):
        session.document.session_context.begin()
        return super().new_connection(protocol, socket, application_context, session)
