"""The sweeps for the claims, and the judgement of all claims."""

import numpy as np

from nasm import barriers
from nasm.arithmetic.reproducible import geometric
from nasm.planes import rotating, two_kicks
from nasm.symmetries import ray
from pipeline.cubes import breakdown, rotating_maps
from pipeline.cubes.barrier import cube_name, last_barrier, unfolded
from pipeline.cubes.cube import text
from workflows.claims.boundary import boundary_claims
from workflows.claims.circles import circle_claims
from workflows.claims.envelope import ranges, summary
from workflows.claims.errata import errata
from workflows.claims.map import map_claims, symmetry_claims
from workflows.claims.periodic import periodic_claims
from workflows.claims.results import result_claims
from workflows.claims.rules import Erratum, as_texts, claims_of, printed_texts
from workflows.shared import direct_iteration
from workflows.shared.judgement import Verdict
from workflows.shared.rays import PAPER_CIRCLES, by_phase, with_ratio
from workflows.shared.tables import dataset

_OFF = {
    "printed_off": "error of the printed form",
    "corrected_off": "error of the corrected form",
    "bound": "bound on rounding errors",
}
_TORUS = "1705/3136,2631/3136"
_THREE = {phase: rotating("1/3", phase) for phase in ("0", "1/24", "1/12")}


def planned(n_rays, n_cusp_rays, n_image_rays, tol, n_max, n_orbits):
    """Return the jobs of all sweeps, {name: job}, and the rays of the plane."""
    around = np.linspace(0, 180, 4 * n_image_rays + 1)
    spread = (
        np.linspace(0, 45, n_rays),
        45 - geometric(5, 0.01, n_cusp_rays),
    )  # degrees below the cusp
    rays = np.unique(np.concatenate([*spread, around]).round(9))
    cusp = {45.0: float(barriers.critical_scale(ray(45.0), 1e-3).value)}
    return {
        "barrier": last_barrier(two_kicks(), rays, tol),
        "circles": breakdown.by_residue(two_kicks(), PAPER_CIRCLES, rays, q_max=6000),
        "escapes": direct_iteration.bias_job(two_kicks(), cusp, [n_orbits], n_max),
        "tori": rotating_maps.residues([_TORUS], around),
        **{
            phase: last_barrier(plane, around, 1e-2, cube_name(plane))
            for phase, plane in _THREE.items()
        },
    }, rays


def examine(cubes, rays, n_max, n_orbits):
    """Judge all claims and check all errata; return a Dataset with dims (claim) and (erratum)."""
    barrier = unfolded(cubes["barrier"], rays)
    tori, angles = cubes["tori"], cubes["tori"].angle.values
    three = by_phase({phase: unfolded(cubes[phase], angles) for phase in _THREE})
    # With κ1, κ2 = κ̄ ± Δκ a ray at ψ in (κ̄, Δκ) becomes a ray at 45° - ψ, √2 times as long.
    two = unfolded(cubes["barrier"], 45 - angles)
    scale, upper = two.critical_scale.values / np.sqrt(2), two.upper.values / np.sqrt(2)
    tori, three = (with_ratio(cube, scale, "the scale for two kicks") for cube in (tori, three))
    three["ratio_lower"] = three.lower / upper
    bias = direct_iteration.direct_bias(cubes["escapes"], direct_iteration.steps_up_to(n_max))
    results = {
        **map_claims(),
        **symmetry_claims(),
        **periodic_claims(),
        **boundary_claims(bias.isel(ensemble=-1, angle=0), n_max, n_orbits),
        **circle_claims(),
        **result_claims(cubes["circles"], barrier, tori, three),
    }
    return recorded(as_texts(results), errata())


def recorded(claims, errata):
    """Return a Dataset of claims (as returned by `as_texts`) and all errata, for `judgement`."""
    values, verdicts = zip(*claims.values(), strict=True)
    off = {name: [getattr(one, name) for one in errata] for name in _OFF}
    return dataset(
        "Claims of the paper and its errata, measured",
        {
            "claim": text("claim", claims, "name of the claim, as in claims.toml"),
            "erratum": text("erratum", printed_texts("errata"), "name as in errata.toml"),
        },
        {
            "value": text("claim", values, "measured result, as text"),
            "verdict": text("claim", [verdict.value for verdict in verdicts], "verdict by a rule"),
            **{name: ("erratum", off[name], label) for name, label in _OFF.items()},
        },
    )


def judgement(examined):
    """Return all Claims and all Errata in a Dataset made by `recorded`."""
    claims = zip(*(examined[name].values for name in ("claim", "value", "verdict")), strict=True)
    results = {name: (value, Verdict(verdict)) for name, value, verdict in claims}
    texts = printed_texts("errata")
    errata = [
        Erratum(**texts[name], **{off: float(examined[off].sel(erratum=name)) for off in _OFF})
        for name in examined.erratum.values
    ]
    return claims_of(results), errata


def envelope(cubes, rays):
    """Return the ranges of the envelope, and sentences about them."""
    both = cubes["circles"], unfolded(cubes["barrier"], rays)
    rows = ranges(*both)
    return rows, summary(*both, rows)
