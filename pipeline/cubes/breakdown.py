"""The breakup of circles: critical scales of several ω on rays, CB_ω, by one of two methods.

κ = s·(cos angle, sin angle), arXiv:1606.04824, Sec. VI.
"""

from functools import partial

from nasm import continuation, numbers, periodic
from pipeline.cubes.cube import PAPER, Job
from pipeline.cubes.rays import KICKS, cube_on_rays, per_ray, rows_of, tile_on_rays


def by_continuation(omegas, angles, tol):
    """Return the Job of the cube `breakdown`: circles continued to their breakdown.

    omegas : list of RotationNumber. angles : degrees. tol : float, the error to aim at.
    """
    settings = {"method": "continuation of circles", "tol": tol}
    warm_up = partial(continuation.critical_scale, numbers.parse("gamma"), (1.0, 0.0), 0.1)
    cube = _cube("breakdown", omegas, angles, settings)
    compute = partial(_compute, continuation.critical_scale, "tol")
    return Job(cube, compute, partial(per_ray, 0.01), warm_up)


def by_residue(omegas, angles, q_max):
    """Return the Job of the cube `breakdown_residue`: Greene's residue.

    omegas : list of RotationNumber. angles : degrees. q_max : int, the longest period.
    """
    settings = {"method": "Greene's residue", "q_max": q_max}
    cube = _cube("breakdown_residue", omegas, angles, settings)
    compute = partial(_compute, periodic.critical_scale, "q_max")
    return Job(cube, compute, partial(per_ray, 0.03), warm_up_residues)


warm_up_residues = partial(periodic.residue, (0.1, 0.1), 1, 3)


def _cube(name, omegas, angles, settings):
    exact = {str(omega): float(omega) for omega in omegas}
    return cube_on_rays(
        name,
        rows_of("omega", exact, "rotation number per step"),
        angles,
        KICKS,
        20,
        {"omegas": list(exact), **settings},
        title="Breakup of invariant circles of the nonautonomous standard map",
        source=f"{PAPER}, Sec. VI",
    )


def _compute(method, effort, coords, settings):
    exact = {float(omega): omega for omega in map(numbers.parse, settings["omegas"])}
    return tile_on_rays(
        coords,
        "omega",
        KICKS,
        lambda omega, profile: method(exact[omega], profile, settings[effort]),
    )
