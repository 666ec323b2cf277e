"""The breakup of circles: critical scales of several ω on rays, CB_ω, by one of two methods.

κ = s·(cos angle, sin angle), arXiv:1606.04824, Sec. VI.
"""

from nasm import continuation, numbers, periodic
from pipeline.cubes.cube import PAPER, Job
from pipeline.cubes.rays import KICKS, cube_on_rays, rows_of, tile_on_rays

_TILE = 20  # rays


def by_continuation(omegas, angles, tol):
    """Return the Job of the cube `breakdown`: circles continued to their breakdown.

    omegas : list of RotationNumber. angles : degrees. tol : float, the error to aim at.
    """
    settings = {"method": "continuation of circles", "tol": tol}
    cube = _cube("breakdown", omegas, angles, settings)
    return Job(cube, _compute_continuation, _predict_continuation, _warm_up_continuation)


def by_residue(omegas, angles, q_max):
    """Return the Job of the cube `breakdown_residue`: Greene's residue.

    omegas : list of RotationNumber. angles : degrees. q_max : int, the longest period.
    """
    settings = {"method": "Greene's residue", "q_max": q_max}
    cube = _cube("breakdown_residue", omegas, angles, settings)
    return Job(cube, _compute_residue, _predict_residue, warm_up_residue)


def _cube(name, omegas, angles, settings):
    exact = {str(omega): float(omega) for omega in omegas}
    return cube_on_rays(
        name,
        rows_of("omega", exact, "rotation number per step"),
        angles,
        KICKS,
        _TILE,
        {"omegas": list(exact), **settings},
        title="Breakup of invariant circles of the nonautonomous standard map",
        source=f"{PAPER}, Sec. VI",
    )


def _exact(settings):
    """Return {float: RotationNumber} of the setting `omegas`."""
    return {float(omega): omega for omega in map(numbers.parse, settings["omegas"])}


def _compute_continuation(coords, settings):
    exact = _exact(settings)

    def critical_scale(omega, profile):
        return continuation.critical_scale(exact[omega], profile, settings["tol"])

    return tile_on_rays(coords, "omega", critical_scale, KICKS)


def _predict_continuation(coords, settings):
    return 0.01 * coords["omega"].size * coords["angle"].size


def _warm_up_continuation():
    continuation.critical_scale(numbers.RotationNumber((0,), (1,)), (1.0, 0.0), 0.1)


def _compute_residue(coords, settings):
    exact = _exact(settings)

    def critical_scale(omega, profile):
        return periodic.critical_scale(exact[omega], profile, settings["q_max"])

    return tile_on_rays(coords, "omega", critical_scale, KICKS)


def _predict_residue(coords, settings):
    return 0.03 * coords["omega"].size * coords["angle"].size


def warm_up_residue():
    """Compile the kernels of Greene's residue."""
    periodic.residue((0.1, 0.1), 1, 3)
