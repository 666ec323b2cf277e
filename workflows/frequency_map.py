"""Which orbits of this forcing are regular, and with what rotation number? A frequency map.

Starts on a grid in phase space are iterated, and ω is averaged over each whole orbit and over its
halves (arXiv:1606.04824, Eq. (23)). The number of digits that these averages share distinguishes
regular orbits, on circles and in islands, from chaotic ones; islands appear as areas of constant ω.
`nasm.orbits.rotation_number_of` does the same for a time series of your own.

KAPPA ... is one period of the forcing, first kick first, like 0.3 0.2, or a text file of strengths.
Writes the cube `frequency_map` and a figure to OUT in a few CPU seconds.
"""

import click

from workflows.shared.cli import StrengthOrFile, axis, command, sweeps, whole


@command(ignore_unknown_options=True)
@click.argument("kappa", type=StrengthOrFile(), nargs=-1)
@axis("--position", "0:1:256", "Starts along x, in turns: lower end, upper end, cells.")
@axis("--momentum", "-0.25:0.75:256", "Starts along y, in turns per kick: as for --position.")
@whole("--n-max", 3000, 4, 10**9, "Steps (periods of the forcing) of each orbit.")
@sweeps
def main(run, kappa, position, momentum, n_max):
    from pipeline import jobs
    from workflows.figures import frequency_map as figures
    from workflows.shared.forcing_files import read_forcings

    if not kappa:
        raise click.UsageError("KAPPA is missing: give the kicks of one period, e.g. 0.3 0.2")
    try:
        (strengths, *others), _ = read_forcings(kappa)
        if others:
            raise ValueError(f"{kappa[0]} has {1 + len(others)} forcings; exactly one is needed")
        job = jobs.frequency_map(strengths, position, momentum, n_max)
    except ValueError as error:
        raise click.UsageError(str(error)) from None
    with run.sweeping(job):
        cube = run.sweep(job).load()
        caption = figures.frequency_map_caption(cube)
        run.figure("frequency_map", figures.draw_frequency_map, cube, caption=caption)
