"""Where does each method stop being right? Nine small studies of failure, and one figure.

What they found, in the full run:

1. Distance to the cusp. Residues answer down to 10⁻³ degrees from 45°, barriers to 3·10⁻⁴, and
   then say that they do not; converse KAM and continuation answer down to 10⁻⁵, with errors of 10⁻⁴
   and 4·10⁻³ of the value. Errors stayed within what was claimed, but for continuation at 10° and
   3°, which was off by 1.2 times its claim of 8·10⁻⁷.
2. Past the breakup s_c. No circle of 16384 points is certified beyond it, and the last one is 0.1%
   to 0.2% below. Converse KAM with 5000 steps eliminates from 2·10⁻⁴ beyond on (10⁻⁴ at 45°), and
   nothing below. Weighted Birkhoff averages of 5000 steps see a "regular" orbit, with five digits
   or more, up to 0.5% beyond on every ray. 100 orbits in 10⁵ steps show an escape nowhere but 10%
   beyond at 45°.
3. Fractions disguised as irrational, [0;1,…,1,a,(1)]: for a = 10 and q ≤ 13 they break at 1.60 to
   1.96, where both methods reach that far. Behind a larger a residues used to answer with the
   breakup of the golden circle, 2.0806, as the convergents before a are its own, with errors of
   10⁻² to 10⁻¹⁰; continuation too, with 2.065 ± 0.025 or so. Residues now give no answer until
   their periods know a. Continuation takes the way from its last certified circle as the error:
   honest, but where q is 20 to 50 of the size of the value.
4. The end of the twist, |κ2| = 2, is far outside: converse KAM, which works with single kicks and
   needs no twist of the whole step, eliminates all starts within two steps before it. No circle is
   certified beyond. Orbits of 89/144 are lost from scales of 1.25 (0°) to 2.25 (135°) on; before,
   their residues reach 10⁸³. Weighted Birkhoff averages show 16 digits there, and no circle: many
   of the longest-lived starts are regular orbits of another kind.
5. Amplitudes. The last circles' are 0.077 on the axis to 0.155 on the diagonal, the same before
   both kicks; those of seven other circles inside at most 0.162. Proposition 1 asks for less than
   1: it has sixfold room everywhere in the plane up to CB_gt, and |Δy| > 1.17 would do as an exit.
   (On these samples: a circle not sampled may have a larger one.)
6. The beam search of converse KAM misses the longest life by 1% or more in 65%, 21% and 3% of 150
   searches with 1, 2 and 4 starts kept, and in none with 8 to 32. It uses 32.
7. Fake circles. With a stop on small updates Newton's method goes on 66% past the breakup with 16
   points, 10% with 64, 1.9% with 256, 0.3% with 1024; with 512 its steps end short of it. All 181
   fakes are rejected by both certificates.
8. Orbits of another order. From starts off by 0.03 and 0.1 turns Newton's method ends on another
   one in no trial up to the scale 0.8, and in 12% to 40% from 1.0 on. All of these the order check
   refused: none of 16 000 trials gave a wrong orbit.
9. Rounding. Orbits drift off a circle like √n: 10⁻¹³ after 10⁷ steps with either sine, 5·10⁻¹³ on
   a lattice, which alone is exactly reversible; 10⁶ steps and back are 10⁻⁷ off otherwise. float32
   is 2·10⁻⁶ off from 10⁵ steps on. On the lift x keeps fewer and fewer digits, and the drift grows
   like n^1.5: 3·10⁻⁹ after 10⁶ steps, and as many back are 2% of a turn off.
"""

import time

import click

from workflows.cli import HELP, driver


def near_cusp(quick):
    """1. Values and errors next to the cusp at 45°, judged by longer runs.

    `periodic` and `continuation` on the circle of γ, `cones` and `barriers` on the last circle: by
    residues of ten times longer orbits, and where these fail, by lives a hundred times longer.
    """
    import numpy as np

    from nasm import barriers, cones, continuation, periodic
    from nasm.critical import Status
    from nasm.numbers import parse
    from pipeline.tasks import profile

    gamma, deltas = parse("gamma"), np.geomspace(10, 1e-5, 5 if quick else 13)
    q_max = 15_000 if quick else 60_000
    rows = []
    for delta in deltas:
        ray = profile(45 - delta)
        circle = periodic.critical_scale(gamma, ray, q_max)
        last = barriers.critical_scale(ray, 3e-4 if quick else 1e-4)
        if last.status is Status.OK:
            last = periodic.critical_scale(last.omega, ray, q_max)
        if last.status is not Status.OK:
            last = cones.critical_scale(ray, 30_000 if quick else 100_000)
        found = [
            (periodic.critical_scale(gamma, ray), circle),
            (continuation.critical_scale(gamma, ray), circle),
            (cones.critical_scale(ray, 1000), last),
            (barriers.critical_scale(ray, 1e-3), last),
        ]
        rows.append([_judged(scale, judge) for scale, judge in found])
    off, claimed, uncertain, status = np.array(rows).transpose(2, 1, 0)
    return _labelled(
        "Distance to the cusp at 45 degrees",
        {
            "approach": _names("periodic", "continuation", "cones", "barriers"),
            "delta": (deltas, "distance 45° - φ from the cusp", "degree"),
        },
        {
            "off": (off, "difference to the sharpest value known, in parts of it"),
            "error": (claimed, "error that the method claims, in parts of the value"),
            "judge_error": (uncertain, "error that the sharpest method claims, likewise"),
            "status": _statuses(status),
        },
    )


def _judged(scale, judge):
    off = abs(scale.value - judge.value) / judge.value
    status = _code(scale.status)
    return off, scale.error / scale.value, judge.error / judge.value, status


def past_boundary(quick):
    """2. What each method says at scales s_c(1 + x), on either side of the breakup s_c."""
    import numpy as np

    from nasm import barriers, circles, cones, escape, orbits, periodic
    from pipeline.tasks import profile

    angles = (20.0, 45.0) if quick else (0.0, 20.0, 40.0, 45.0)
    decades = np.geomspace(1e-4, 1e-1, 4 if quick else 10)
    excess = np.concatenate([-decades[::-1], [0.0], decades])
    n_cones, n_escape, n_modes = 5000, *((10_000, 2048) if quick else (100_000, 16_384))
    starts = escape.ensemble(100)
    shape = len(angles), excess.size
    certified, digits, lived, escaped = np.zeros((4, *shape))
    for i, angle in enumerate(angles):
        best = barriers.critical_scale(profile(angle), 1e-3)
        for j, x in enumerate(excess):
            kappa = best.value * (1 + x) * profile(angle)
            circle = circles.invariant_circle(best.omega, kappa, n_max=n_modes)
            certified[i, j] = circle.certified
            y, lived[i, j] = cones.longest_lived(kappa, n_cones)
            site, a = periodic.dominant_centre(kappa)
            digits[i, j] = orbits.rotation_number(np.roll(kappa, -site), a, y, 5000)[1]
            escaped[i, j] = escape.first_escape(kappa, *starts, [100], n_escape)[0]
    return _labelled(
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
            status[i, :, j] = [_code(code) for code in codes]
    return _labelled(
        "Fractions disguised as irrational rotation numbers",
        {
            "quotient": (large, "the partial quotient a after the ones", "1"),
            "approach": _names("periodic", "continuation", "longer orbits; of status: circles"),
            "q": (q, "denominator of the fraction", "1"),
        },
        {
            "value": (values, "breakup, in parts of (0.3, 0.2)"),
            "error": (errors, "its error"),
            "lower": (("quotient", "q"), lower, "last certified circle of continuation"),
            "status": _statuses(status),
        },
        golden=float(periodic.critical_scale(RotationNumber((0,), (1,)), kappa).value),
    )


def beyond_the_twist(quick):
    """4. What is left of the methods for scales up to 3; the twist ends at |κ2| = 2."""
    import numpy as np

    from nasm import circles, cones, escape, orbits, periodic
    from nasm.maps import twist
    from nasm.numbers import parse
    from pipeline.tasks import profile

    angles, scales = (0.0, 20.0, 45.0, 90.0, 135.0), np.linspace(0.25, 3.0, 12 if quick else 23)
    shape = len(angles), scales.size
    least, lived, residue, digits, escaped, status = np.full((6, *shape), np.nan)
    x = np.arange(400) / 400
    for i, angle in enumerate(angles):
        for j, scale in enumerate(scales):
            kappa = scale * profile(angle)
            least[i, j] = twist(kappa, *np.meshgrid(x, x)).min()
            y, lived[i, j] = cones.longest_lived(kappa, 2000)
            residue[i, j] = periodic.residue(kappa, 89, 144)
            site, a = periodic.dominant_centre(kappa)
            digits[i, j] = orbits.rotation_number(np.roll(kappa, -site), a, y, 2000)[1]
            escaped[i, j] = escape.first_escape(kappa, *escape.ensemble(100), [100], 2000)[0]
            status[i, j] = _code(circles.invariant_circle(parse("gamma"), kappa, 512).status)
    return _labelled(
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
            "circle": _statuses(status),
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
    from pipeline.tasks import profile

    angles = np.linspace(0, 45, 6 if quick else 19)
    others = ["gamma", "2gamma", "[0;2,(1)]", "[0;3,(1)]", "[0;4,(1)]", "[0;1,3,(1)]", "[0;8,(1)]"]
    fractions = np.array([0.3, 0.6, 0.8, 0.9, 0.97])
    last, largest = (
        np.full((2, angles.size), np.nan),
        np.full((angles.size, fractions.size), np.nan),
    )
    for i, angle in enumerate(angles):
        best = barriers.critical_scale(profile(angle), 1e-3)
        _, u = continuation.certified_circle(best.omega, profile(angle), best.value, 1e-3)
        if u is not None:
            last[:, i] = _heights(best.omega, u)
        for j, fraction in enumerate(fractions):
            kappa = fraction * best.value * profile(angle)
            for omega in map(parse, others):
                circle = circles.invariant_circle(omega, kappa, n_max=512)
                if circle.certified:
                    largest[i, j] = np.nanmax([largest[i, j], *_heights(omega, circle.u)])
    return _labelled(
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


def missed_survivors(quick):
    """6. How often the beam search of `cones` misses the longest life, by the number it keeps.

    Judged by the best that any of them found.
    """
    import numpy as np

    from nasm import cones
    from pipeline.tasks import profile

    kept, n_max = 2 ** np.arange(6), 20_000
    random = np.random.default_rng(6)
    n_rays = 20 if quick else 150
    angles = np.where(random.random(n_rays) < 1 / 3, 45 - random.random(n_rays), 45)
    angles = np.where(angles == 45, 45 * random.random(n_rays), angles)
    lives = np.empty((kept.size, n_rays))
    standard = cones._KEPT
    try:
        for j, (angle, x) in enumerate(
            zip(angles, 10 ** random.uniform(-4, -2, n_rays), strict=True)
        ):
            cones._KEPT = standard
            kappa = cones.critical_scale(profile(angle), 3000).value * (1 + x) * profile(angle)
            for i, number in enumerate(kept):
                cones._KEPT = int(number)
                lives[i, j] = cones.longest_lived(kappa, n_max)[1]
    finally:
        cones._KEPT = standard
    best = lives.max(axis=0)
    known = np.isfinite(best)
    lost = 1 - lives[:, known] / best[known]
    return _labelled(
        "Lives that the beam search misses",
        {"kept": (kept, "starts kept at each level", "1")},
        {
            "missed": ((lost > 0.01).mean(axis=1), "part of searches that miss 1% of a life"),
            "worst": (lost.max(axis=1), "largest part of a life missed"),
        },
        searches=int(known.sum()),
    )


def fake_circles(quick):
    """7. How far past the breakup Newton's method "converges", and what the certificate says.

    The naive method stops on small updates, with n points, and goes on in κ as far as it gets.
    """
    import numpy as np

    from nasm import circles, periodic
    from nasm.critical import Status
    from nasm.numbers import parse

    gamma, profiles = parse("gamma"), ((1.0,), (1.0, 0.5))
    points = 2 ** np.arange(4, 9 if quick else 11)
    past, fakes, passed, polished = np.zeros((4, len(profiles), points.size))
    for i, profile in enumerate(profiles):
        breakup = periodic.critical_scale(gamma, profile).value
        for j, n in enumerate(points):
            path = _naive_path(gamma, np.array(profile), int(n), breakup)
            believed = [(scale, u) for scale, u in path if scale > breakup]
            past[i, j] = path[-1][0] / breakup - 1
            fakes[i, j] = len(believed)
            for scale, u in believed:
                kappa = scale * np.array(profile)
                passed[i, j] += circles.certify(gamma, kappa, u)[1] is Status.OK
                polished[i, j] += circles.polished_is_circle(gamma, kappa, u)
    return _labelled(
        "Fake circles",
        {
            "ray": (range(len(profiles)), "the standard map, and (1, 0.5)", "1"),
            "n": (points, "grid points", "1"),
        },
        {
            "past": (past, "last naive convergence over the breakup, less 1"),
            "fakes": (fakes.astype(int), "circles believed in beyond the breakup"),
            "passed": (passed.astype(int), "those that pass `certify`"),
            "polished": (polished.astype(int), "those that pass `polished_is_circle`"),
        },
    )


def _naive_path(omega, profile, n, breakup):
    """(scale, u) of all circles that small updates on n points make believe in."""
    import numpy as np

    from nasm import circles

    path, step = [(0.0, np.zeros((profile.size, n)))], 0.1 * breakup
    while step > 1e-4 * breakup and path[-1][0] < 3 * breakup:
        target, trial = path[-1][0] + step, path[-1][1]
        for _ in range(40):
            before, (trial, error) = trial, circles.newton_step(omega, target * profile, trial)
            change = np.abs(trial - before).max()
            if change < 1e-10 or not error < 1:
                break
        if change < 1e-10 and error < 1:
            path.append((target, trial))
        else:
            step /= 2
    return path


def disordered_orbits(quick):
    """8. Newton's method for the orbit of 13/21 from bad starts: what it finds, and what is said.

    The forcing grows from inside the plane's barriers to far beyond; starts are the rotation with
    random deviations of 0.03 and 0.1 turns.
    """
    import numpy as np

    from nasm import chain, periodic

    p, q, noises = 13, 21, (0.03, 0.1)
    scales = np.linspace(0.2, 1.6, 8)
    trials = 100 if quick else 1000
    random = np.random.default_rng(8)
    counts = np.zeros((4, len(noises), scales.size), int)
    for j, scale in enumerate(scales):
        kappa = scale * np.array([1.0, 0.5])
        orbit = chain.HalfOrbit(0 * kappa, kappa, p, q, periodic.dominant_centre(kappa))
        orbit.move(1.0)
        right, full = orbit.u.copy(), np.empty(orbit.n_sites)
        workspace, end = np.empty((2, right.size)), orbit.n_sites // 2
        for i, noise in enumerate(noises):
            for _ in range(trials):
                u = noise * random.standard_normal(right.size)
                u[0] = u[end:] = 0.0
                if not chain._newton(kappa, orbit.site, orbit.n_sites, orbit.theta, u, workspace):
                    outcome = 0
                elif np.abs(u - right)[: end + 1].max() < 1e-9:
                    outcome = 1
                else:
                    outcome = 3 if chain._ordered(u, q, orbit.stride, full) else 2
                counts[outcome, i, j] += 1
    names = ("lost", "right", "refused", "accepted")
    words = ("no convergence", "the orbit", "another orbit, refused", "another orbit, accepted")
    return _labelled(
        "Orbits that Newton's method finds from bad starts",
        {
            "noise": (noises, "rms of the start's deviations from the rotation, turns", "1"),
            "scale": (scales, "scale s of the forcing s·(1, 0.5)", "1"),
        },
        {
            name: (part / trials, f"part of starts that lead to: {word}")
            for name, part, word in zip(names, counts, words, strict=True)
        },
        trials=trials,
    )


def rounding(quick):
    """9. Drift off a certified circle of (0.3, 0.3), and the error of n steps forth and n back.

    lift: the polynomial sine, x not reduced. turns: the same, x reduced each kick. libm: math.sin
    of 2πx, reduced. lattice: y rounded to 2⁻⁵¹ each kick. float32: the polynomial, reduced.
    """
    import numpy as np

    from nasm import circles
    from nasm.numbers import parse

    kappa = np.array([0.3, 0.3])
    steps = 10 ** np.arange(2, 6 if quick else 8)
    circle = circles.invariant_circle(parse("gamma"), kappa, n_max=1024)
    x, y = (values[:: circle.u.shape[-1] // 8] for values in circles.graph(circle))
    x, y = (x + 3.0) - 3.0, (y + 3.0) - 3.0  # on the lattice of 2⁻⁵¹
    kernels = _arithmetics()
    drift, back = np.full((2, len(kernels), steps.size), np.nan)
    for i, (advance, retreat, kind) in enumerate(kernels.values()):
        at, done = (x.astype(kind), y.astype(kind)), 0
        start = at[0].copy(), at[1].copy()
        for j, n in enumerate(steps):
            advance(kappa.astype(kind), *at, n - done)
            done = n
            drift[i, j] = np.sqrt(np.mean(_height_above(circle, *at) ** 2))
            if n <= 10**6:
                there = at[0].copy(), at[1].copy()
                retreat(kappa.astype(kind), *there, n)
                off = [a.astype(float) - b for a, b in zip(there, start, strict=True)]
                back[i, j] = max(np.abs(off[0] - np.rint(off[0])).max(), np.abs(off[1]).max())
    return _labelled(
        "Rounding",
        {
            "arithmetic": _names(*kernels),
            "steps": (steps, "steps of two kicks", "1"),
        },
        {
            "drift": (drift, "rms distance in y from the circle, of 8 orbits"),
            "reversal": (back, "largest error of x or y after n steps and back"),
        },
    )


def _height_above(circle, x, y):
    """y less that of the circle at the same x, by Newton's method for θ."""
    import numpy as np

    from nasm import circles

    n = circle.u.shape[-1]
    modes = np.fft.rfft(np.stack([circle.u[0], circles.graph(circle)[1]])) / n
    modes[:, 1:] *= 2
    k = np.arange(modes.shape[1])
    x, y = x.astype(float), y.astype(float)
    x = x - np.floor(x)
    theta = x.copy()
    for _ in range(20):
        waves = np.exp(2j * np.pi * k * theta[:, None])
        u, slope = (waves @ modes[0]).real, 1 + (waves @ (2j * np.pi * k * modes[0])).real
        theta -= (theta + u - x) / slope
    return y - (np.exp(2j * np.pi * k * theta[:, None]) @ modes[1]).real


def _arithmetics():
    """{name: (advance, retreat, dtype)}: n steps forth or back, in place."""
    import math

    import numpy as np
    from numba import njit

    from nasm.sine import SINE, sin2pi

    two_pi, two_pi_32 = 2 * np.pi, np.float32(2 * np.pi)
    c = tuple(np.float32(a) for a in SINE[:6])

    @njit
    def polynomial(kappa, x):
        return kappa / two_pi * sin2pi(x)

    @njit
    def libm(kappa, x):
        return kappa / two_pi * math.sin(two_pi * x)

    @njit
    def quantised(kappa, x):
        return ((kappa / two_pi * sin2pi(x)) + 3.0) - 3.0

    @njit
    def single(kappa, x):
        a = abs(x - np.rint(x))
        u = math.copysign(min(a, np.float32(0.5) - a), x - np.rint(x))
        u = np.float32(u)
        v = u * u
        s = c[4] + v * c[5]
        s = c[3] + v * s
        s = c[2] + v * s
        s = c[1] + v * s
        s = c[0] + v * s
        return kappa / two_pi_32 * (two_pi_32 * u * s)

    @njit
    def same(x):
        return x

    @njit
    def reduced(x):
        return x - np.floor(x)

    def pair(force, wrap):
        @njit
        def advance(kappa, x, y, n):
            for i in range(x.size):
                a, b = x[i], y[i]
                for _ in range(n):
                    for strength in kappa:
                        b = b + force(strength, a)
                        a = wrap(a + b)
                x[i], y[i] = a, b

        @njit
        def retreat(kappa, x, y, n):
            for i in range(x.size):
                a, b = x[i], y[i]
                for _ in range(n):
                    for strength in kappa[::-1]:
                        a = wrap(a - b)
                        b = b - force(strength, a)
                x[i], y[i] = a, b

        return advance, retreat

    return {
        "lift": (*pair(polynomial, same), np.float64),
        "turns": (*pair(polynomial, reduced), np.float64),
        "libm": (*pair(libm, reduced), np.float64),
        "lattice": (*pair(quantised, reduced), np.float64),
        "float32": (*pair(single, reduced), np.float32),
    }


def _names(*names):
    return range(len(names)), list(names), "1"


def _code(status):
    from pipeline.tasks import STATUSES

    return 1 + STATUSES.index(status)


def _statuses(codes):
    import numpy as np

    from pipeline.tasks import STATUSES

    return np.asarray(codes).astype("int8"), [status.name for status in STATUSES]


def _labelled(title, coords, variables, **attrs):
    """A Dataset; variables without dims have all of them, in the order of the coordinates."""
    import numpy as np
    import xarray as xr

    dataset = xr.Dataset(attrs={"title": title, **attrs})
    for name, (values, long_name, units) in coords.items():
        attrs = {"long_name": long_name, "units": units}
        if isinstance(long_name, list):
            attrs = {"long_name": name, "units": units, "names": long_name}
        dataset[name] = xr.DataArray(np.array(values), dims=name, attrs=attrs)
    for name, (*dims, values, words) in variables.items():
        dims = dims[0] if dims else tuple(coords)
        dataset[name] = xr.DataArray(values, dims=dims, attrs={"units": "1"})
        if isinstance(words, list):
            flags = {
                "flag_values": list(range(1, len(words) + 1)),
                "flag_meanings": " ".join(words),
            }
            dataset[name].attrs.update(long_name="status of the method", **flags)
        else:
            dataset[name].attrs["long_name"] = words
    return dataset


STUDIES = {
    "cusp": near_cusp,
    "boundary": past_boundary,
    "fractions": disguised_fractions,
    "twist": beyond_the_twist,
    "amplitude": amplitudes,
    "beam": missed_survivors,
    "fakes": fake_circles,
    "disorder": disordered_orbits,
    "rounding": rounding,
}


def run(quick, only=None):
    """{name: Dataset} of all studies, or some, with a line of progress for each."""
    found = {}
    for name in only or STUDIES:
        begin = time.perf_counter()
        found[name] = STUDIES[name](quick)
        seconds = time.perf_counter() - begin
        click.echo(f"{name}: {found[name].attrs['title']}, {seconds:.1f} s", err=True)
    return found


@click.command(context_settings=HELP)
@click.option("--quick", is_flag=True, help="A preview: fewer and shorter runs of everything.")
@click.option("--out", default="out", show_default=True, help="Directory of the results.")
def main(out, quick):
    """Where each method stops being right: nine cubes and a figure in OUT.

    Two to three minutes on two cores; --quick less than one.
    """
    with driver(out):
        from pipeline import store
        from pipeline.schema import Cube

        # One that takes a moment, and tells whether OUT holds other settings.
        first = run(quick, ["disorder"])
        cube = Cube("stability_disorder", first["disorder"], {}, {"quick": quick})
        store.refuse_different(out, cube)
        found = run(quick, [name for name in STUDIES if name not in first]) | first
        for name, dataset in found.items():
            store.replace(out, Cube(f"stability_{name}", dataset, {}, {"quick": quick}))
        from workflows.figures import draw_stability, save

        figures = save(draw_stability(found), out, "stability")
    click.echo(f"cubes:  {out}/cubes.zarr, groups stability_{', stability_'.join(found)}")
    click.echo(f"figure: {', '.join(figures)}")


if __name__ == "__main__":
    main()
