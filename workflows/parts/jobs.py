"""Jobs of the pipeline."""

from collections import namedtuple
from fractions import Fraction

from pipeline import schema, tasks

Job = namedtuple("Job", "cube compute predict method")
WORDS = [status.name.lower() for status in tasks.STATUSES]


def barrier(angles, tol):
    cube = schema.barrier_cube("barrier", angles, WORDS, tile=1, settings={"tol": tol})
    return Job(cube, tasks.barrier_tile, tasks.barrier_cost, "barrier")


def continuation(omegas, angles, tol):
    settings = {"method": "continuation of circles", "tol": tol}
    exact = {str(omega): float(omega) for omega in omegas}
    cube = schema.breakdown_cube("breakdown", exact, angles, WORDS, 20, settings)
    return Job(cube, tasks.circle_tile, tasks.circle_cost, "circle")


def residue(omegas, angles, q_max):
    settings = {"method": "Greene's residue", "q_max": q_max}
    exact = {str(omega): float(omega) for omega in omegas}
    cube = schema.breakdown_cube("breakdown_residue", exact, angles, WORDS, 20, settings)
    return Job(cube, tasks.residue_tile, tasks.residue_cost, "residue")


def tori(vectors, angles):
    settings = {"method": "Greene's residue of one orbit", "vectors": list(vectors)}
    exact = {text: float(Fraction(text)) for text in (v.split(",")[1] for v in vectors)}
    cube = schema.rotating_cube("rotating_tori", exact, angles, WORDS, 20, settings)
    return Job(cube, tasks.torus_tile, tasks.torus_cost, "residue")


def transport(angles, n_max, n_orbits):
    settings = {"method": "direct iteration", "phase": 0.0, "n_max": n_max, "n_orbits": n_orbits}
    cube = schema.rotating_cube("rotating_transport", {"1/2": 0.5}, angles, WORDS, 10, settings)
    return Job(cube, tasks.transport_tile, tasks.transport_cost, "escape")


def three_kicks(phases, angles, n_max):
    settings = {"method": "converse KAM on transversals", "frequency": "1/3", "n_max": n_max}
    exact = {text: float(Fraction(text)) for text in phases}
    cube = schema.phases_cube("three_kicks", exact, angles, WORDS, 4, settings)
    return Job(cube, tasks.phases_tile, tasks.phases_cost, "transversal")


def flux(scales, circles, excesses, q_max):
    cube = schema.flux_cube("flux", scales, circles, excesses, WORDS, {"q_max": q_max})
    return Job(cube, tasks.flux_tile, tasks.flux_cost, "flux")


def escape_rays(name, sizes, scales, excesses, n_max):
    from nasm.escape import PAPER_WINDOW

    cube = schema.escape_rays_cube(name, sizes, scales, excesses, n_max, PAPER_WINDOW, tile=1)
    return Job(cube, tasks.escape_rays_tile, tasks.escape_rays_cost, "escape")


def escape(name, kappa1, kappa2, sizes, n_max, tile):
    from nasm.escape import PAPER_WINDOW

    cube = schema.escape_cube(name, kappa1, kappa2, sizes, n_max, PAPER_WINDOW, tile)
    return Job(cube, tasks.escape_tile, tasks.escape_cost, "escape")
