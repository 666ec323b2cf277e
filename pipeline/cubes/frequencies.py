"""The last barrier of rotating standard maps against the frequency Ω, rational or not.

κ_n = s·(cos angle + sin angle · cos 2π(φ0 + nΩ)), arXiv:1606.04824, Sec. VII;
`nasm.tori.last_torus`.
"""

from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import product

import numpy as np

from nasm.planes import ROTATING_AXES
from nasm.symmetries import ray
from nasm.tori import last_torus
from pipeline.cubes import cube
from pipeline.cubes.breakdown import cube_on_rays, scales
from pipeline.cubes.cube import Job, blank, coordinate

_KICKS = 8_000, 32_000  # on either side, for fractions and for others


def last_barriers(fractions, n_phases, irrational, angles):
    """Return the Job of the cube `frequencies`: brackets of the last circle, or torus.

    fractions : list of Fraction, Ω = p/q. n_phases : int, at least 2, of φ0 from 0 to 1/2q; all
    others are images of these. irrational : list of floats. angles : degrees.
    """
    shares = [Fraction(k, n_phases - 1) for k in range(n_phases)]
    rotating = [
        (float(Ω), float(share), f"{Ω},{share / 2 / Ω.denominator}")
        for Ω, share in product(fractions, shares)
    ]
    rotating += [(Ω, np.nan, repr(Ω)) for Ω in irrational]
    frequencies, shares, names = zip(*rotating, strict=True)
    words = "phase φ0, in parts of 1/2q; NaN: Ω is irrational, and all phases are alike"
    rows = {
        "forcing": cube.text("forcing", names, "Ω, and φ0 if Ω is a fraction, exactly"),
        "frequency": coordinate("forcing", frequencies, "frequency Ω, turns of φ per kick"),
        "phase": coordinate("forcing", shares, words),
    }
    settings = {"kicks": list(_KICKS), "method": "converse KAM, and continuation"}
    plan = cube_on_rays("frequencies", ROTATING_AXES, rows, angles, 10, settings, "Last barriers")
    on_ray = {"forcing": rows["forcing"], "angle": plan.template.angle}
    omega = blank(on_ray, "turns per kick of what is certified at lower")
    plan = replace(plan, template=plan.template.assign(omega=omega))
    warm_up = partial(_compute, {"forcing": ["1/2,0"], "angle": np.zeros(1)}, {"kicks": [400, 400]})
    return Job(plan, _compute, _predict, warm_up)


def _predict(coords, settings):
    """Predict seconds by the period; tori take longest."""
    name = coords["forcing"][0]
    q = Fraction(name.split(",")[0]).denominator if "," in name else 200
    return (0.5 + 0.15 * q) * coords["angle"].size


def _compute(coords, settings):
    found = [
        [_bracket(name, on, settings) for on in ray(coords["angle"])] for name in coords["forcing"]
    ]
    arrays = scales([[scale for scale, _ in row] for row in found], ROTATING_AXES, coords["angle"])
    return arrays | {"omega": np.array([[omega for _, omega in row] for row in found])}


def _bracket(name, profile, settings):
    frequency, _, phase = name.partition(",")
    of_fractions, of_others = settings["kicks"]
    if phase:
        return last_torus.of_fraction(frequency, float(Fraction(phase)), *profile, of_fractions)
    return last_torus.of_irrational(float(frequency), *profile, of_others)
