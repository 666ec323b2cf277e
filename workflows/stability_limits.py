"""Studies of stability: at the cusp, past the breakup, at fractions, without twist, in amplitude.

Their findings are in `workflows.stability`.
"""

from workflows.labelled import labelled, listed, status_code, status_flags


def near_cusp(quick):
    """1. Values and errors next to the cusp at 45°, judged by longer runs.

    `periodic` and `continuation` on the circle of γ, `cones` and `barriers` on the last circle: by
    residues of ten times longer orbits, and where these fail, by lives a hundred times longer.
    """
    import numpy as np

    from nasm import barriers, cones, continuation, periodic
    from nasm.critical import Status
    from nasm.numbers import parse
    from nasm.symmetries import ray

    gamma, deltas = parse("gamma"), np.geomspace(10, 1e-5, 5 if quick else 13)
    q_max = 15_000 if quick else 60_000
    rows = []
    for delta in deltas:
        profile = ray(45 - delta)
        circle = periodic.critical_scale(gamma, profile, q_max)
        last = barriers.critical_scale(profile, 3e-4 if quick else 1e-4)
        if last.status is Status.OK:
            last = periodic.critical_scale(last.omega, profile, q_max)
        if last.status is not Status.OK:
            last = cones.critical_scale(profile, 30_000 if quick else 100_000)
        found = [
            (periodic.critical_scale(gamma, profile), circle),
            (continuation.critical_scale(gamma, profile), circle),
            (cones.critical_scale(profile, 1000), last),
            (barriers.critical_scale(profile, 1e-3), last),
        ]
        rows.append([_judged(scale, judge) for scale, judge in found])
    off, claimed, uncertain, status = np.array(rows).transpose(2, 1, 0)
    return labelled(
        "Distance to the cusp at 45 degrees",
        {
            "approach": listed("periodic", "continuation", "cones", "barriers"),
            "delta": (deltas, "distance 45° - φ from the cusp", "degree"),
        },
        {
            "off": (off, "difference to the sharpest value known, in parts of it"),
            "error": (claimed, "error that the method claims, in parts of the value"),
            "judge_error": (uncertain, "error that the sharpest method claims, likewise"),
            "status": status_flags(status),
        },
    )


def _judged(scale, judge):
    off = abs(scale.value - judge.value) / judge.value
    status = status_code(scale.status)
    return off, scale.error / scale.value, judge.error / judge.value, status


def past_boundary(quick):
    """2. What each method says at scales s_c(1 + x), on either side of the breakup s_c."""
    import numpy as np

    from nasm import barriers, circles, cones, escape, orbits, periodic
    from nasm.symmetries import ray

    angles = (20.0, 45.0) if quick else (0.0, 20.0, 40.0, 45.0)
    decades = np.geomspace(1e-4, 1e-1, 4 if quick else 10)
    excess = np.concatenate([-decades[::-1], [0.0], decades])
    n_cones, n_escape, n_modes = 5000, *((10_000, 2048) if quick else (100_000, 16_384))
    starts = escape.ensemble(100)
    shape = len(angles), excess.size
    certified, digits, lived, escaped = np.zeros((4, *shape))
    for i, angle in enumerate(angles):
        best = barriers.critical_scale(ray(angle), 1e-3)
        for j, x in enumerate(excess):
            kappa = best.value * (1 + x) * ray(angle)
            circle = circles.invariant_circle(best.omega, kappa, n_max=n_modes)
            certified[i, j] = circle.certified
            y, lived[i, j] = cones.longest_lived(kappa, n_cones)
            site, a = periodic.dominant_centre(kappa)
            digits[i, j] = orbits.rotation_number(np.roll(kappa, -site), a, y, 5000)[1]
            escaped[i, j] = escape.first_escape(kappa, *starts, [100], n_escape)[0]
    return labelled(
        "Distance past the breakup",
        {
            "angle": (angles, "direction of the ray in the plane", "degree"),
            "excess": (excess, "scale over that of the breakup, less 1", "1"),
        },
        {
            "certified": (
                certified.astype("int8"),
                "whether a circle of n_modes points is certified",
            ),
            "elimination_time": (lived, "steps in which converse KAM eliminates all; inf: not so"),
            "digits": (digits, "digits of the weighted Birkhoff average of the longest-lived"),
            "escape_time": (escaped, "first escape of 100 orbits, steps; inf: none"),
        },
        n_cones=n_cones,
        n_escape=n_escape,
        n_modes=n_modes,
    )


def disguised_fractions(quick):
    """3. Circles of fractions p/q disguised as irrational, [0;1,…,1,a,(1)], on the ray (0.3, 0.2).

    They are 1/(aq²) from p/q and, for large a, break long before the golden circle, to which their
    first convergents belong. Judged by residues of longer orbits where these see the tail.
    """
    import numpy as np

    from nasm import circles, continuation, periodic
    from nasm.numbers import RotationNumber, convergents

    kappa, large = np.array([0.3, 0.2]), (10, 100, 10**6)
    ones = range(3, 10 if quick else 17)
    q = [list(convergents(RotationNumber((0, *[1] * n))))[-1].denominator for n in ones]
    values, errors = np.full((2, len(large), 3, len(ones)), np.nan)
    lower, status = np.full((len(large), len(ones)), np.nan), np.zeros((len(large), 3, len(ones)))
    for i, a in enumerate(large):
        for j, n in enumerate(ones):
            omega = RotationNumber((0, *[1] * n, a), (1,))
            found = (
                periodic.critical_scale(omega, kappa),
                continuation.critical_scale(omega, kappa),
                periodic.critical_scale(omega, kappa, 10_000 if quick else 20_000),
            )
            values[i, :, j] = [scale.value for scale in found]
            errors[i, :, j] = [scale.error for scale in found]
            lower[i, j] = found[1].lower
            circle = circles.invariant_circle(omega, kappa)
            codes = found[0].status, found[1].status, circle.status
            status[i, :, j] = [status_code(code) for code in codes]
    return labelled(
        "Fractions disguised as irrational rotation numbers",
        {
            "quotient": (large, "the partial quotient a after the ones", "1"),
            "approach": listed("periodic", "continuation", "longer orbits; of status: circles"),
            "q": (q, "denominator of the fraction", "1"),
        },
        {
            "value": (values, "breakup, in parts of (0.3, 0.2)"),
            "error": (errors, "its error"),
            "lower": (("quotient", "q"), lower, "last certified circle of continuation"),
            "status": status_flags(status),
        },
        golden=float(periodic.critical_scale(RotationNumber((0,), (1,)), kappa).value),
    )


def beyond_the_twist(quick):
    """4. What is left of the methods for scales up to 3; the twist ends at |κ2| = 2."""
    import numpy as np

    from nasm import circles, cones, escape, orbits, periodic
    from nasm.maps import twist
    from nasm.numbers import parse
    from nasm.symmetries import ray

    angles, scales = (0.0, 20.0, 45.0, 90.0, 135.0), np.linspace(0.25, 3.0, 12 if quick else 23)
    shape = len(angles), scales.size
    least, lived, residue, digits, escaped, status = np.full((6, *shape), np.nan)
    x = np.arange(400) / 400
    for i, angle in enumerate(angles):
        for j, scale in enumerate(scales):
            kappa = scale * ray(angle)
            least[i, j] = twist(kappa, *np.meshgrid(x, x)).min()
            y, lived[i, j] = cones.longest_lived(kappa, 2000)
            residue[i, j] = periodic.residue(kappa, 89, 144)
            site, a = periodic.dominant_centre(kappa)
            digits[i, j] = orbits.rotation_number(np.roll(kappa, -site), a, y, 2000)[1]
            escaped[i, j] = escape.first_escape(kappa, *escape.ensemble(100), [100], 2000)[0]
            status[i, j] = status_code(circles.invariant_circle(parse("gamma"), kappa, 512).status)
    return labelled(
        "Near the end of the twist and beyond",
        {
            "angle": (angles, "direction of the ray in the plane", "degree"),
            "scale": (scales, "scale s of the forcing", "1"),
        },
        {
            "twist": (least, "least ∂x'/∂y of a step"),
            "elimination_time": (lived, "steps in which converse KAM eliminates all; inf: not so"),
            "residue": (residue, "residue of the minimax orbit of 89/144; NaN: not found"),
            "digits": (digits, "digits of the weighted Birkhoff average of the longest-lived"),
            "escape_time": (escaped, "first escape of 100 orbits, steps; inf: none"),
            "circle": status_flags(status),
        },
    )


def amplitudes(quick):
    """5. max y - min y of circles just inside CB_gt, before the first and before the second kick.

    The last circle at 0.999 of its breakup, and nobles of ω between its translates where they
    exist. A circle and its translate by y = 1 confine an orbit to |Δy| ≤ 1 + amplitude.
    """
    import numpy as np

    from nasm import barriers, circles, continuation
    from nasm.numbers import parse
    from nasm.symmetries import ray

    angles = np.linspace(0, 45, 6 if quick else 19)
    others = ["gamma", "2gamma", "[0;2,(1)]", "[0;3,(1)]", "[0;4,(1)]", "[0;1,3,(1)]", "[0;8,(1)]"]
    fractions = np.array([0.3, 0.6, 0.8, 0.9, 0.97])
    last, largest = (
        np.full((2, angles.size), np.nan),
        np.full((angles.size, fractions.size), np.nan),
    )
    for i, angle in enumerate(angles):
        best = barriers.critical_scale(ray(angle), 1e-3)
        _, u = continuation.certified_circle(best.omega, ray(angle), best.value, 1e-3)
        if u is not None:
            last[:, i] = _heights(best.omega, u)
        for j, fraction in enumerate(fractions):
            kappa = fraction * best.value * ray(angle)
            for omega in map(parse, others):
                circle = circles.invariant_circle(omega, kappa, n_max=512)
                if circle.certified:
                    largest[i, j] = np.nanmax([largest[i, j], *_heights(omega, circle.u)])
    return labelled(
        "Amplitudes of invariant circles",
        {
            "kick": ((0, 1), "kick before which y is taken", "1"),
            "angle": (angles, "direction of the ray in the plane", "degree"),
            "part": (fractions, "scale over that of the last breakup", "1"),
        },
        {
            "last": (("kick", "angle"), last, "amplitude of the last circle at 0.999 s_c"),
            "largest": (("angle", "part"), largest, "largest amplitude of seven other circles"),
        },
        justified_exit=float(1 + max(np.nanmax(last), np.nanmax(largest))),
    )


def _heights(omega, u):
    """max y - min y before each kick: y_j = x_j - x_{j-1}."""
    import numpy as np

    from nasm import fourier

    before = fourier.rotate(u[-1], fourier.turns(omega, u.shape[-1] // 2 + 1).conj())
    return np.ptp(np.diff(np.vstack([before, u]), axis=0), axis=1)
