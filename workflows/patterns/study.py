"""The forcings of the command `patterns`, and its findings."""

from math import gcd

import numpy as np

from workflows.figures.patterns import BURSTS, CONSTANT, FLIPS, PAIRS, SIGNS
from workflows.figures.style import of_family
from workflows.shared.judgement import finding

PARAMETER = f"ε of {PAIRS}, P of {SIGNS}, M of {FLIPS}, fraction of the period kicked in {BURSTS}"


def pair(p, q):
    """Return the profile of two kicks that are p/q of a period apart."""
    return [float(n in (0, p)) for n in range(q)]


def patterns(quick):
    """List all forcings as (family, parameter, profile), or fewer of them if `quick`."""
    apart = [(p, q) for q in range(2, 9) for p in range(1, 1 + q // 2) if gcd(p, q) == 1]
    apart += [(1, q) for q in (9, 10, 11, 12, 16, 24, 48, 64)]
    given = [
        (CONSTANT, 1, [1.0]),
        *((PAIRS, p / q, pair(p, q)) for p, q in apart),
        *((SIGNS, q, [1.0] * (q - 1) + [-1.0]) for q in range(3, 9)),
        *((FLIPS, m, [1.0] * m + [-1.0] * m) for m in range(1, 6)),
        *((BURSTS, n / q, [1.0] * n + [0.0] * (q - n)) for q in range(4, 8) for n in range(3, q)),
    ]
    return [forcing for forcing in given if not quick or len(forcing[2]) in (1, 2, 3, 4, 6)]


def findings(cube):
    """Describe the cube, and judge the claim about the spacing 1/3 from the brackets alone."""
    pairs = of_family(cube, PAIRS)
    lower, upper = (pairs[side] * pairs.period for side in ("lower", "upper"))
    third = np.isclose(pairs.parameter, 1 / 3)
    third_upper, others = upper.values[third], lower.values[~third]
    width = (2 * (cube.upper - cube.lower) / (cube.upper + cube.lower)).dropna("forcing")
    return " ".join([
        f"Of {cube.family.size} forcings, {int(cube.critical_scale.notnull().sum())} have a value "
        f"and {width.size} a bracket, at most {100 * float(width.max()):.2g}% wide. The middle of "
        "each bracket is drawn. The unit of time is the period for K, and the time between kicks "
        "for κ; for cold atoms K is 8ω_r times the period times the phase depth of a pulse (ω_r: "
        "recoil frequency).",
        finding(
            "as K grows, pairs a third of the period apart lose their last barrier first",
            f"their last barrier breaks below K = {third_upper.item():.4g}; for the {others.size} "
            f"other spacings, circles are certified up to K = {others.min():.4g} or more. To first "
            "order, all resonances for the spacing 1/3 have a strength of at least K, whereas for "
            "spacings 1/P with even P the resonance at momentum P/2 is absent",
            bool((third_upper < others).all()),
            known=bool(np.isfinite([*third_upper, *others]).all()),
        ),
        "Not studied: kicks of finite duration, spacings other than 1/P and fractions with q ≤ 8, "
        "and quantum effects.",
    ])  # fmt: skip
