"""The server of the page: a Bokeh server on localhost, for browsers on this machine only.

One process serves all tabs and runs short computations in threads; dask workers run the long ones.
A page from another site may be open in the same browser. It can neither read this page nor connect
to it, even if its host name is made to point at this machine: a request must name this machine
(with any port, because ssh may forward one) and must not come from a page with another host or
port. Any site may link to this page. Opening such a link starts no computation before the page has
connected to the server: until then the values in the address are only parsed, within the limits of
`nasm.texts`.

The modules of this folder import xarray, zarr, pandas and dask.distributed in functions, which are
called after the page has been sent; these imports take 0.9 s.
"""

import logging
import os
import re
import signal
import webbrowser
from contextlib import suppress
from functools import partial
from pathlib import Path
from threading import Event, Lock, Thread

import click
from bokeh.application import Application
from bokeh.application.handlers import FunctionHandler
from bokeh.server.server import BaseServer
from bokeh.server.tornado import BokehTornado
from bokeh.server.util import bind_sockets
from bokeh.settings import settings
from tornado.httpserver import HTTPServer
from tornado.ioloop import IOLoop
from tornado.routing import AnyMatches, HostMatches, Rule, RuleRouter
from tornado.web import Application as WebApplication
from tornado.web import OutputTransform, RequestHandler

from nasm.arithmetic.kernels import are_missing
from pipeline.sweep.cluster import NO_SCHEDULER, ClusterError, connect
from workflows.explore.on_workers import load_portrait_kernels, load_verdict_kernels
from workflows.explore.page import fill
from workflows.explore.rays import Rays

_HOST = "127.0.0.1"
_NAMES = "localhost", _HOST, "[::1]"
_OF_THE_TERMINAL = "browsh", "carbonyl", "elinks", "links", "links2", "lynx", "w3m", "www-browser"
_LIFETIME = 10_000  # ms for which an unconnected page is kept; creating one takes a few ms
_SLOWEST = 20  # seconds allowed for a request, and until the next one on the same connection
_BODY = 1000  # maximum bytes in the body of a request; the page sends none
_HEAD_START = 3  # seconds that the workers wait for the first picture, at most
_GRACE, _CLOSING = 10, 60  # seconds for the event loop to stop, and for the workers to end
_POLICY = (  # Bokeh evaluates strings as code; its page and ours have inline scripts and styles
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; object-src 'none'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_KERNELS = {"portrait": load_portrait_kernels, "verdict": load_verdict_kernels}  # by first use
_HEADERS = {
    "Content-Security-Policy": _POLICY,
    "X-Frame-Options": "DENY",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
}


class Shared:
    """The objects that all tabs share.

    plane : the plane of forcings. place : where the cubes to be shown are stored; it is only read.
    rays : Rays, the boundary computed so far.
    fields : {(View, N): Field}, the complete fields, the newest last.
    client : function that waits for the connection and returns the dask Client.
    opened : Event, set when a page has been sent the cubes in OUT.
    connected : Event, set when the workers have started, or failed to start.
    loaded : for "portrait" and "verdict", an Event, set when the kernels have loaded or failed
    to load.
    preparing : what the page must wait for, as text; "" when all is ready.
    """

    def __init__(self, plane, place, client):
        self.plane, self.place, self._client = plane, place, client
        self.rays, self.fields = Rays(plane), {}
        self.opened, self.connected = Event(), Event()
        self.loaded, self._lock = {name: Event() for name in _KERNELS}, Lock()
        self.preparing = "starting the workers"

    def client(self):
        """Return the client once the kernels for escape times and portraits have been loaded."""
        self.loaded["portrait"].wait()
        return self._connected()

    def _connected(self):
        with self._lock:
            client = self._client()
        if client.status != "running":
            raise ConnectionError(NO_SCHEDULER)
        return client

    def prepare(self):
        """Start the workers and load the kernels; `serve` calls this in a thread.

        The workers wait for the first picture, of the cubes in OUT, because they would delay it. If
        no kernels have been compiled yet, a worker compiles them before this process loads them.
        """
        self.opened.wait(_HEAD_START)
        try:
            client = self._connected()
            self.connected.set()
            must_compile = are_missing()
            compiling = "compiling the kernels, once per machine: about half a minute"
            self.preparing = compiling if must_compile else "loading the kernels"
            for name, load in _KERNELS.items():
                on_worker = client.submit(load, pure=False)
                if must_compile:
                    on_worker.result()
                load()
                on_worker.result()
                self.loaded[name].set()
            self.preparing = ""
        except ClusterError as error:
            self.preparing = str(error)
        except Exception as error:  # Ctrl-C may cause any exception
            self.preparing = f"the workers did not start: {error!r}"
        finally:
            for event in (self.connected, *self.loaded.values()):
                event.set()


def serve(plane, place, port, opens, cluster):
    """Serve the page until Ctrl-C or SIGTERM.

    plane, place : as for `Shared`. port : the port of the page, 0 for any free port. opens : True
    to open the page in the browser. cluster : arguments of `cluster.connect`.

    Raise click.UsageError if the port is taken, and ClusterError if the cluster arguments are
    invalid.
    """
    for name in ("bokeh", "tornado"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # they would report each closed tab
    try:
        sockets, port = bind_sockets(_HOST, port)
    except OSError as error:
        message = f"port {port}: {error.strerror} (another explorer?); choose another, or 0 for any"
        raise click.BadParameter(message, param_hint="--port") from None
    with connect(**cluster, allowed_failures=2, without_scipy=True) as client:
        shared = Shared(plane, place, client)
        server = server_of(shared, sockets, port)
        _stop_at_signals(loop := server.io_loop)
        Thread(target=shared.prepare, daemon=True).start()
        server.start()
        url = f"http://localhost:{port}/"
        click.echo(f"the explorer is at {url}\nCtrl-C ends it", err=True)
        if opens:  # some browsers stay in the foreground until they are closed
            Thread(target=_open, args=[url], daemon=True).start()
        loop.start()
        signal.alarm(_CLOSING)
        server.stop()
        shared.connected.wait(20)  # otherwise, workers about to start would be left running
    signal.alarm(0)


def _stop_at_signals(loop):
    """Stop the event loop at SIGINT or SIGTERM; if it is blocked, end the process.

    A blocked process ends `_GRACE` seconds later. If Python code blocks the loop, the main thread
    still runs the handler of the signal. If a compiled kernel blocks the loop, the handler has to
    wait; but the kernel has released Python's lock, so another thread can read the signal from a
    pipe. Both the handler and that thread set an alarm; when it goes off, the system ends the
    process.
    """
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    signal.set_wakeup_fd(writer)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: signal.alarm(_GRACE))

    def listen():
        while os.read(reader, 1):
            signal.alarm(_GRACE)
            loop.add_callback(loop.stop)

    Thread(target=listen, daemon=True).start()


def _open(url):
    """Open the page in the browser, unless it is a terminal browser, which cannot run the page."""
    with suppress(webbrowser.Error):  # no browser is installed
        browser = webbrowser.get()
        if Path(getattr(browser, "name", "")).name not in _OF_THE_TERMINAL:
            browser.open(url)


def server_of(shared, sockets, port):
    """Return the server of the page, for the event loop of this thread."""
    settings.perform_document_validation = False  # 0.1 s for each tab
    settings.allowed_ws_origin = ["*"]  # regardless of the environment; `_Ours` checks the origin
    web = _Web(
        Application(FunctionHandler(partial(fill, shared=shared))),
        extra_websocket_origins=["*"],
        unused_session_lifetime_milliseconds=_LIFETIME,
        check_unused_sessions_milliseconds=_LIFETIME // 10,
    )
    refusals = WebApplication([(".*", _Refusal, {"port": port})])
    for application in (web, refusals):
        application.add_transform(_Guarded)
    names = f"({'|'.join(map(re.escape, _NAMES))})$"
    router = RuleRouter([Rule(_Ours(names), web), Rule(AnyMatches(), refusals)])
    slowest = {"idle_connection_timeout": _SLOWEST, "body_timeout": _SLOWEST}
    http = HTTPServer(router, max_body_size=_BODY, **slowest)
    http.add_sockets(sockets)
    return BaseServer(IOLoop.current(), web, http)


class _Ours(HostMatches):
    """A rule that matches requests to these hosts from their own pages or from followed links.

    Browsers state in the headers where a request comes from and what it is for.
    """

    def match(self, request):
        headers = request.headers
        origin = headers.get("Origin", f"http://{request.host}")
        same = origin.partition("://")[2].lower() == request.host.lower()
        same &= headers.get("Sec-Fetch-Site", "none") in ("none", "same-origin")
        followed = headers.get("Sec-Fetch-Dest") == "document" and "Origin" not in headers
        return super().match(request) if same or followed else None


class _Guarded(OutputTransform):
    """A transform that adds the security headers of the page to every response."""

    def transform_first_chunk(self, status_code, headers, chunk, finishing):
        headers.update(_HEADERS)
        return status_code, headers, chunk


class _Refusal(RequestHandler):
    """A handler that refuses a request and explains how to reach the page."""

    def initialize(self, port):
        self.port = port

    def prepare(self):
        self.set_status(403)
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(
            f"The explorer answers on localhost only; this request is for {self.request.host}, and "
            f"came from {self.request.headers.get('Origin', 'another site or no page at all')}.\n"
            f"Open http://localhost:{self.port}/ on the machine where the explorer runs. From "
            f"another machine:\n\n    ssh -L {self.port}:localhost:{self.port} MACHINE\n\n"
            f"and open http://localhost:{self.port}/ there.\n"
        )


class _Web(BokehTornado):
    """Bokeh's web application, whose pages start computing once the browser has connected."""

    def new_connection(self, protocol, socket, application_context, session):
        session.document.session_context.begin()
        return super().new_connection(protocol, socket, application_context, session)
