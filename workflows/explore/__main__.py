"""Click on the plane, see the orbits, get the verdict: the explorer, a page in the browser.

Left the plane of forcings, with first escape times and the last circle's boundary; right the phase
portrait of the forcing that was clicked; above them the verdict.

What an earlier run has left in OUT, escape times and the boundary, is shown at once; OUT is only
read, and need not exist. The rest is computed where you look. Ctrl-C ends it.

The page is served on localhost only. From another machine, forward a port, ssh -L
5006:localhost:5006 MACHINE, and open http://localhost:5006/ there.
"""

import click

from workflows.shared.cli import cluster_options, command, directory, flag, plane_option, whole


@command(default_map={"out": "out/critical_boundary"})
@plane_option
@whole("--port", 5006, 0, 65535, "Port of the page on this machine; 0 takes any free one.")
@flag("--no-browser", "Print the address of the page without opening a browser.")
@cluster_options
@directory("Directory of a run whose cubes are shown; it need not exist.")
def main(plane, port, no_browser, out, **cluster):
    try:
        import bokeh  # noqa: F401
    except ImportError:
        words = "the explorer needs Bokeh, an extra: pip install '.[explore]'"
        raise click.ClickException(words) from None
    click.echo("loading", err=True)
    from workflows.explore.server import serve
    from workflows.shared.run import place_of, usage_errors

    cluster["n_workers"] = cluster.pop("workers")
    place = place_of(out)
    with usage_errors(place):
        serve(plane, place, port, not no_browser, cluster)
