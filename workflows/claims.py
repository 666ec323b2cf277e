"""What became of each claim of the paper? A page to hold beside it, and the same as tables.

Claim by claim through arXiv:1606.04824: our value with its error, the verdict that a rule makes of
it (`workflows.paper.rules`), and the command that shows it. Then the errata, measured, and the
paper's conjecture on the envelope of all CB_ω, examined with the two-sided bracket.
"""

from pathlib import Path

import click

from workflows.cli import HELP, carry_out, cluster_options, session, store_option
from workflows.convergence import direct_bias, direct_job, steps_up_to
from workflows.last_barrier import unfolded
from workflows.rotating import VECTORS, two_kicks
from workflows.three_kicks import compared

_STEP = 7.5  # degrees, of rays around the half plane, so that mirror images and tori have theirs


def jobs(angles, tips, tol, n_max, n_orbits):
    """{name: Job} of all sweeps, and the rays of the plane."""
    import numpy as np

    from nasm import barriers
    from nasm.numbers import NAMES, parse
    from nasm.symmetries import ray
    from pipeline.cubes import barrier, breakdown, rotating
    from workflows.paper.envelope import wedge_angles

    around = np.arange(0, 180 + _STEP, _STEP)
    rays = np.unique(np.concatenate([wedge_angles(angles, tips), around]).round(9))
    cusp = {45.0: float(barriers.critical_scale(ray(45.0), 1e-3).value)}
    return {
        "barrier": barrier.last_barrier(rays, tol),
        "circles": breakdown.by_residue(sorted(map(parse, NAMES), key=float), rays, 6000),
        "escapes": direct_job(cusp, [n_orbits], n_max),
        "tori": rotating.tori(VECTORS[:1], around),
        "three": rotating.three_kicks(["0", "1/24", "1/12"], around, 100),
    }, rays


def examine(cubes, rays, n_max, n_orbits):
    """All claims, all errata, and the ranges of the envelope with their summary."""
    from workflows.paper.boundary import boundary_claims
    from workflows.paper.circles import circle_claims
    from workflows.paper.discussion import discussion_claims
    from workflows.paper.envelope import ranges, summary
    from workflows.paper.errata import errata
    from workflows.paper.map import map_claims
    from workflows.paper.periodic import periodic_claims
    from workflows.paper.results import result_claims
    from workflows.paper.symmetries import symmetry_claims

    barrier, circles = unfolded(cubes["barrier"], rays), cubes["circles"].load()
    three = compared(cubes["three"], two_kicks(cubes["barrier"], cubes["three"].angle.values))
    bias = direct_bias(cubes["escapes"].load(), steps_up_to(n_max)).isel(ensemble=-1, angle=0)
    claims = [
        *map_claims(),
        *symmetry_claims(),
        *periodic_claims(),
        *boundary_claims(bias, n_max, n_orbits),
        *circle_claims(),
        *result_claims(circles, barrier),
        *discussion_claims(circles, barrier, cubes["tori"].load(), three),
    ]
    rows = ranges(circles, barrier)
    claims.sort(key=lambda claim: claim.place.split(",")[0])  # as the paper goes
    return claims, errata(), rows, summary(circles, barrier, rows)


@click.command(context_settings=HELP)
@click.option(
    "--angles",
    default=91,
    show_default=True,
    type=click.IntRange(3, 10**5),
    help="Rays, from 0 to 45 degrees.",
)
@click.option(
    "--tips",
    default=24,
    show_default=True,
    type=click.IntRange(0, 1000),
    help="More rays below the cusp at 45 degrees, from 5 to 0.01 degrees, spaced logarithmically.",
)
@click.option(
    "--tol",
    default=1e-4,
    show_default=True,
    type=click.FloatRange(1e-5, 0.01),
    help="Width of the bracket of CB_gt to aim at, in parts of the scale.",
)
@click.option(
    "--n-max",
    default=1_000_000,
    show_default=True,
    type=click.IntRange(10_000, 10**8),
    help="Steps of direct iteration.",
)
@click.option(
    "--n-orbits",
    default=1000,
    show_default=True,
    type=click.IntRange(10, 10**5),
    help="Orbits of direct iteration.",
)
@store_option
@cluster_options
def main(out, place, cluster, angles, tips, tol, n_max, n_orbits):
    """The paper's claims, one by one: a page, three tables and five cubes in OUT.

    The defaults take some minutes on two cores; --angles 19 --tips 8 --tol 1e-3 --n-max 20000
    --n-orbits 64 about one.
    """
    wanted, rays = jobs(angles, tips, tol, n_max, n_orbits)
    with session(out, cluster, wanted.values(), place) as client:
        cubes = {name: carry_out(client, place, job) for name, job in wanted.items()}
        from workflows.paper.claims_page import claims_page, write_tables
        from workflows.paper.rules import CLAIMS

        claims, errata, rows, sentences = examine(cubes, rays, n_max, n_orbits)
        tables = write_tables(out, claims, errata, rows)
        path = Path(out) / "claims.html"
        command = f"{CLAIMS} --angles {angles} --tips {tips} --tol {tol:g} --n-max {n_max}"
        command = f"{command} --n-orbits {n_orbits}"
        text = claims_page(claims, errata, rows, sentences, command)
        path.write_text(text, encoding="utf-8")
    click.echo(f"page:   {path}")
    click.echo(f"tables: {', '.join(map(str, tables))}")
    groups = ", ".join(job.cube.name for job in wanted.values())
    click.echo(f"cubes:  {place}/cubes.zarr, groups {groups}")


if __name__ == "__main__":
    main()
