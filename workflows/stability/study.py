"""Studies of where each method fails; a study returns a Dataset, a smaller one if `quick`.

The studies test the methods at the cusp, beyond the breakup, close to fractions and without twist;
they count starts that beam searches miss, and wrong orbits that Newton's method finds; and they
compute tori close to a resonance, and search for tori beyond their breakup.
"""

import numpy as np

from nasm import action, barriers, circles, escape, orbits, periodic, tori
from nasm.circles import continuation
from nasm.converse_kam import symmetry_line
from nasm.maps import twist
from nasm.numbers import RotationNumber, convergents, parse
from nasm.results import Status
from nasm.symmetries import dominant_centre, ray
from nasm.tori import last_torus
from pipeline.cubes.cube import angles_of_rays, field_arrays, status_code, text
from workflows.shared.tables import columns, dataset, described, outcomes

_NUMBERS = {"value": "value", "error": "error", "lower": "lower"}  # fields of a CriticalScale
_LIFETIMES = {
    "elimination_time": "steps until converse KAM has eliminated all starts (inf if some survive)",
    "digits": "digits of the weighted Birkhoff average of the longest-lived start",
    "escape_time": "steps until the first of 100 orbits escapes (inf if none does)",
}
_GOLDEN = (5**0.5 - 1) / 2
_PAIRS = {  # (ω, Ω) at a distance δ from a resonance
    "Ω = 1/3 + δ": lambda delta: (_GOLDEN, 1 / 3 + delta),
    "2ω = Ω + δ": lambda delta: ((2**0.5 - 1 + delta) / 2, 2**0.5 - 1),
    "13ω = 8 + δ": lambda delta: ((8 + delta) / 13, 2**0.5 - 1),
}


def near_cusp(quick):
    """1. Compare values and errors close to the cusp at 45° with those of longer runs.

    The methods are `periodic` and `circles.continuation` for the circle of γ, and
    `converse_kam.symmetry_line` and `barriers` for the last circle. The references are residues
    of orbits ten times longer and, where these fail, lifetimes a hundred times longer.
    """
    gamma, deltas = parse("gamma"), np.geomspace(10, 1e-5, 5 if quick else 13)
    q_max = 15_000 if quick else 60_000

    def values_and_references(profile):
        circle = periodic.critical_scale(gamma, profile, q_max)
        last = barriers.critical_scale(profile, 3e-4 if quick else 1e-4)
        if last.status is Status.OK:
            last = periodic.critical_scale(last.omega, profile, q_max)
        if last.status is not Status.OK:
            last = symmetry_line.critical_scale(profile, 30_000 if quick else 100_000)
        return [
            (periodic.critical_scale(gamma, profile), circle),
            (continuation.critical_scale(gamma, profile), circle),
            (symmetry_line.critical_scale(profile, 1000), last),
            (barriers.critical_scale(profile, 1e-3), last),
        ]

    scales = field_arrays([values_and_references(ray(45 - delta)) for delta in deltas], _NUMBERS)
    value, error = (
        scales["value"].T,
        scales["error"].T,
    )  # dims (value or reference, approach, delta)
    (claimed, uncertain), dims = error / value, ("approach", "delta")
    off = abs(value[0] - value[1]) / value[1]
    approaches = "Greene's residue", "continuation of circles", "converse KAM", "all together"
    distance = deltas, described("distance 45° - φ from the cusp", "degree")
    variables = {
        "off": (dims, off, "relative difference from the most accurate value known"),
        "error": (dims, claimed, "relative error that the method claims"),
        "judge_error": (dims, uncertain, "relative error that the most accurate method claims"),
        "status": outcomes(dims, scales["status"].T[0]),
    }
    title = "Distance to the cusp at 45 degrees"
    coords = {"approach": text("approach", approaches, "method"), "delta": distance}
    return dataset(title, coords, variables)


def past_boundary(quick):
    """2. Apply each method at scales s_c(1 + x), on both sides of the breakup s_c."""
    angles = (20.0, 45.0) if quick else (0.0, 20.0, 40.0, 45.0)
    decades = np.geomspace(1e-4, 1e-1, 4 if quick else 10)
    excess = np.concatenate([-decades[::-1], [0.0], decades])
    n_cones, n_escape, n_modes = 5000, *((10_000, 2048) if quick else (100_000, 16_384))
    breakups = {angle: barriers.critical_scale(ray(angle), 1e-3) for angle in angles}

    def answers(angle, x):
        kappa = breakups[angle].value * (1 + x) * ray(angle)
        circle = circles.invariant_circle(breakups[angle].omega, kappa, n_max=n_modes)
        single = _first_escape(kappa, n_escape, "single")
        return circle.certified, single, *_lifetimes(kappa, n_cones, 5000, n_escape)

    certified, single, *lifetimes = _over(angles, excess, answers)
    label, dims = "1 if a circle with n_modes points is certified", ("angle", "excess")
    variables = {
        "certified": (dims, certified.astype("int8"), label),
        "escape_time_single": (dims, single, f"{_LIFETIMES['escape_time']}, in single precision"),
        **columns(dims, _LIFETIMES, lifetimes),
    }
    efforts = {"n_cones": n_cones, "n_escape": n_escape, "n_modes": n_modes}
    beyond = excess, "scale relative to the breakup, minus 1"
    coords = {"angle": angles_of_rays(angles), "excess": beyond}
    return dataset("Methods around the breakup", coords, variables, efforts)


def disguised_fractions(quick):
    """3. Compute breakups of circles with ω = [0;1,…,1,a,(1)] near p/q, on the ray s·(0.3, 0.2).

    Each ω is at a distance 1/(aq²) from p/q. For large a, the circles break long before the golden
    circle, whose first convergents they share. The reference is the breakup computed from residues
    of longer orbits.
    """
    kappa, large = np.array([0.3, 0.2]), (10, 100, 10**6)
    ones = range(3, 10, 3) if quick else range(3, 17)
    q = [list(convergents(RotationNumber((0, *[1] * n))))[-1].denominator for n in ones]
    omegas = [[RotationNumber((0, *[1] * n, a), (1,)) for n in ones] for a in large]

    def scales_of(omega):
        residues = periodic.critical_scale(omega, kappa)
        longer = periodic.critical_scale(omega, kappa, 10_000 if quick else 20_000)
        return residues, continuation.critical_scale(omega, kappa), longer

    scales = field_arrays([[scales_of(omega) for omega in row] for row in omegas], _NUMBERS)
    value, error, lower, status = (scales[name].swapaxes(1, 2) for name in (*_NUMBERS, "status"))
    certified = [[circles.invariant_circle(omega, kappa) for omega in row] for row in omegas]
    status[:, 2] = field_arrays(certified, {})["status"]
    golden = periodic.critical_scale(RotationNumber((0,), (1,)), kappa).value
    approaches = "periodic", "continuation", "longer orbits (for status: circles)"
    coords = {
        "quotient": (list(large), "partial quotient a after the ones"),
        "approach": text("approach", approaches, "method"),
        "q": (q, "denominator of the fraction"),
    }
    variables = {
        "value": ([*coords], value, "breakup, relative to (0.3, 0.2)"),
        "error": ([*coords], error, "error that the method claims for value"),
        "lower": (("quotient", "q"), lower[:, 1], "last circle certified by continuation"),
        "status": outcomes([*coords], status),
    }
    title = "Fractions disguised as irrational rotation numbers"
    return dataset(title, coords, variables, {"golden": float(golden)})


def beyond_the_twist(quick):
    """4. Apply the methods at scales up to 3; where |κ2| ≥ 2, a step is no longer a twist map."""
    angles, scales = (0.0, 20.0, 45.0, 90.0, 135.0), np.linspace(0.25, 3.0, 8 if quick else 23)
    x = np.arange(400) / 400

    def answers(angle, scale):
        kappa = scale * ray(angle)
        circle = circles.invariant_circle(parse("gamma"), kappa, 512)
        least = twist(kappa, *np.meshgrid(x, x)).min()
        return status_code(circle.status), least, *_lifetimes(kappa, 2000, 2000, 2000)

    status, least, *lifetimes = _over(angles, scales, answers)
    coords = {"angle": angles_of_rays(angles), "scale": (scales, "scale s of the forcing")}
    variables = {
        "twist": ([*coords], least, "smallest ∂x'/∂y of a step"),
        **columns([*coords], _LIFETIMES, lifetimes),
        "circle": outcomes([*coords], status),
    }
    return dataset("Near the loss of twist and beyond it", coords, variables)


def _over(first, second, answers):
    """Return, for each number that answers(a, b) returns, an array over first × second."""
    return np.array([[answers(a, b) for b in second] for a in first], float).transpose(2, 0, 1)


def _lifetimes(kappa, n_cones, n_average, n_escape):
    """Return the values of _LIFETIMES: elimination time, digits and escape time."""
    y, steps = symmetry_line.longest_lived(kappa, n_cones)
    site, a = dominant_centre(kappa)
    _, digits = orbits.rotation_number(np.roll(kappa, -site), a, y, n_average)
    return steps, digits, _first_escape(kappa, n_escape)


def _first_escape(kappa, n_max, precision="double"):
    starts = escape.ensemble(100)
    return escape.first_escape(kappa, *starts, [100], n_max, precision=precision)[0]


def missed_survivors(quick):
    """5. Count how often each beam search of converse KAM misses the longest lifetime found."""
    kept, n_max = 2 ** np.arange(6), 20_000
    random = np.random.default_rng(6)
    n_rays = 20 if quick else 150
    angles = np.where(random.random(n_rays) < 1 / 3, 45 - random.random(n_rays), 45)
    angles = np.where(angles == 45, 45 * random.random(n_rays), angles)
    lifetimes = np.empty((kept.size, n_rays))
    for j, (angle, x) in enumerate(zip(angles, 10 ** random.uniform(-4, -2, n_rays), strict=True)):
        kappa = symmetry_line.critical_scale(ray(angle), 3000).value * (1 + x) * ray(angle)
        for i, number in enumerate(kept):
            search = symmetry_line.SearchSettings(width=int(number))
            settings = symmetry_line.LineSettings(search=search)
            lifetimes[i, j] = symmetry_line.longest_lived(kappa, n_max, settings)[1]
    best = lifetimes.max(axis=0)
    known = np.isfinite(best)
    lost = 1 - lifetimes[:, known] / best[known]
    coords, searches = {"kept": (kept, "starts kept at each level")}, {"searches": int(known.sum())}
    variables = {
        "missed": (
            "kept",
            (lost > 0.01).mean(axis=1),
            "fraction of searches that miss more than 1% of the lifetime",
        ),
        "worst": ("kept", lost.max(axis=1), "largest fraction of a lifetime missed"),
    }
    return dataset("Lifetimes that the beam search misses", coords, variables, searches)


def disordered_orbits(quick):
    """6. Start Newton's method far from the orbit of 13/21, and classify the results.

    The forcing increases from below the last breakup to far beyond it. Each start is the rigid
    rotation plus random deviations of 0.03 or 0.1 turns (rms).
    """
    p, q, noises = 13, 21, (0.03, 0.1)
    scales = np.linspace(0.2, 1.6, 8)
    trials = 100 if quick else 1000
    random = np.random.default_rng(8)
    counts = np.zeros((4, len(noises), scales.size), int)
    for j, scale in enumerate(scales):
        kappa = scale * np.array([1.0, 0.5])
        _, orbit = action.ordered_orbits(kappa, p, q)
        theta, hop, work = orbit.chain.frame
        least = action.total_action(orbit.kappa, theta, orbit.u)
        for i, noise in enumerate(noises):
            for _ in range(trials):
                u = orbit.u[0] + noise * random.standard_normal(theta.size)
                search = action.newton_solve(
                    orbit.kappa, theta, u, orbit.kind, 0.1 / q, action.FLAT, work
                )
                change, curvature, *_, bad = search
                if not change < 1e-7 or bad or curvature >= 0:
                    outcome = 0
                elif not action.is_ordered(u, hop, 1 / q):
                    outcome = 2
                else:  # the right orbit, started at any of its points, has the same action
                    same = abs(action.total_action(orbit.kappa, theta, u) - least) < 1e-12
                    outcome = 1 if same else 3
                counts[outcome, i, j] += 1
    coords = {
        "noise": (list(noises), "rms deviation from the rotation, in turns"),
        "scale": (scales, "scale s of the forcing s·(1, 0.5)"),
    }
    labels = {
        "lost": "fraction of starts that do not converge",
        "right": "fraction that converges to the orbit",
        "refused": "fraction that converges to a different orbit, which is rejected",
        "accepted": "fraction that converges to a different orbit, which is accepted",
    }
    variables = columns([*coords], labels, counts / trials)
    title = "Orbits that Newton's method finds from bad starts"
    return dataset(title, coords, variables, {"trials": trials})


def nearly_resonant(quick):
    """7. Compute breakups of tori with frequencies (ω, Ω) at a distance δ from a resonance.

    The reference is the bound from converse KAM for all tori with the same Ω. Beyond this bound,
    tori with the first pair of frequencies are sought on grids of up to n points.
    """
    deltas = np.e * 10.0 ** -np.array([2, 5, 10] if quick else range(2, 13))
    profile, tol, kicks = ray(45), *((0.1, 1000) if quick else (0.03, 8000))
    pairs = list(_PAIRS)[: 2 if quick else None]
    vectors = [[_PAIRS[name](delta) for delta in deltas] for name in pairs]
    breakups = [[tori.critical_scale(*vector, *profile, tol) for vector in row] for row in vectors]
    frequencies = {Ω for row in vectors for _, Ω in row}
    known = {Ω: last_torus.upper_scale(Ω, *profile, kicks) for Ω in frequencies}
    upper = np.array([[known[frequency] for _, frequency in row] for row in vectors])
    sizes, excess = 2 ** np.arange(13, 16 if quick else 19, 2), np.array([0.01, 0.1, 0.5])
    beyond = [(1 + x) * upper[0, 0] * profile for x in excess]
    past = [[tori.invariant_torus(*vectors[0][0], *at, int(n)) for at in beyond] for n in sizes]
    dims = "pair", "delta"
    numbers = field_arrays(breakups, _NUMBERS)
    coords = {
        "pair": text("pair", pairs, "rotation vector"),
        "delta": (deltas, "distance δ from the resonance"),
        "n": (sizes, "largest number of grid points"),
        "excess": (excess, "scale relative to upper, minus 1"),
    }
    variables = {
        "value": (dims, numbers["value"], "breakup on the ray at 45°"),
        "error": (dims, numbers["error"], "error that the method claims for value"),
        "lower": (dims, numbers["lower"], "scale of the last certified torus"),
        "upper": (dims, upper, "scale at which no torus with this Ω exists"),
        "status": outcomes(dims, numbers["status"]),
        "past": outcomes(("n", "excess"), field_arrays(past, {})["status"]),
    }
    return dataset("Tori close to a resonance, and beyond their breakup", coords, variables)
