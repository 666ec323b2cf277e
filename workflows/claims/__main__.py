"""Does each claim in the paper hold? A page and tables to read alongside the paper.

For every claim in arXiv:1606.04824, the page lists our value with its error, the verdict that a
rule in `workflows.claims.rules` derives from it, and the command that reproduces it. It also lists
the errata and the envelope of all CB_ω.

Writes a page, three tables and eight cubes to OUT, in about four CPU minutes, or in one with
--n-rays 19 --n-cusp-rays 8 --tol 1e-3 --n-max 20000 --n-orbits 64.
"""

from workflows.shared.cli import command, real, sweeps, whole


@command()
@whole("--n-rays", 91, 3, 10**5, "Rays from 0 to 45 degrees.")
@whole("--n-cusp-rays", 24, 0, 1000, "Extra rays, 5 to 0.01 degrees below the cusp at 45.")
@whole("--n-image-rays", 6, 1, 1000, "Rays per 45 degrees, from 0 to 180, for images and for tori.")
@real("--tol", 1e-4, 1e-5, 0.01, "Target width of the bracket of CB_gt, relative to the scale.")
@whole("--n-max", 1_000_000, 10_000, 10**8, "Steps (periods of the forcing) in direct iteration.")
@whole("--n-orbits", 1000, 10, 10**5, "Orbits in direct iteration.")
@sweeps
def main(run, **size):
    from pipeline.cubes.cube import untiled
    from workflows.claims.page import write
    from workflows.claims.study import envelope, examine, judgement, planned

    (jobs, rays), examined = planned(**size), untiled("claims", **size)
    steps_and_orbits = size["n_max"], size["n_orbits"]
    with run.sweeping(*jobs.values(), studies=[(examined, 12)], drawing=2):
        cubes = {name: run.sweep(job).load() for name, job in jobs.items()}
        examined = run.kept(examined, lambda: examine(cubes, rays, *steps_and_orbits))
        options = " ".join(f"--{name.replace('_', '-')} {n}" for name, n in size.items())
        command = f"python -m workflows.claims {options}"
        write(run, *judgement(examined), *envelope(cubes, rays), command)
