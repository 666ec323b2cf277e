"""Interactive explorer in the browser: click on a forcing to see its orbits and the verdict.

The page shows the plane of forcings on the left, with first escape times and the boundary of the
last circle; the phase portrait of the selected forcing on the right; and the verdict above both.

Escape times and the boundary from an earlier run in OUT are shown immediately; OUT is only read,
and need not exist. Everything else is computed on demand. Ctrl-C stops the explorer.

The page is served on localhost only. To view it on another machine, forward a port by running
ssh -L 5006:localhost:5006 MACHINE there, where MACHINE is the one that runs the explorer, and then
open http://localhost:5006/ there.
"""

import click

from workflows.shared.cli import cluster_options, command, directory, flag, plane_option, whole


@command(default_map={"out": "out/critical_boundary"})
@plane_option
@whole("--port", 5006, 0, 65535, "Port of the page on this machine; 0 means any free port.")
@flag("--no-browser", "Print the address of the page without opening a browser.")
@cluster_options
@directory("Directory of a run whose cubes are shown, if it exists.")
def main(plane, port, no_browser, out, **cluster):
    try:
        import bokeh  # noqa: F401
    except ImportError:
        message = "the explorer needs Bokeh; install it with: pip install '.[explore]'"
        raise click.ClickException(message) from None
    click.echo("loading", err=True)
    from workflows.explore.server import serve
    from workflows.shared.places import place_of, usage_errors

    cluster["n_workers"] = cluster.pop("workers")
    if cluster["n_workers"] is None and cluster["scheduler"] is None:
        from dask.system import CPU_COUNT

        cluster["n_workers"] = CPU_COUNT + 1  # one is left to clicks while others compute rays
    place = place_of(out)
    with usage_errors(place):
        serve(plane, place, port, not no_browser, cluster)
