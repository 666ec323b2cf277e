"""Studies of stability: what beam searches miss, and what Newton's method finds in error.

Their findings are in `workflows.stability`.
"""

from workflows.labelled import labelled


def missed_survivors(quick):
    """6. How often the beam search of `cones` misses the longest life, by the number it keeps.

    Judged by the best that any of them found.
    """
    import numpy as np

    from nasm import cones
    from nasm.symmetries import ray

    kept, n_max = 2 ** np.arange(6), 20_000
    random = np.random.default_rng(6)
    n_rays = 20 if quick else 150
    angles = np.where(random.random(n_rays) < 1 / 3, 45 - random.random(n_rays), 45)
    angles = np.where(angles == 45, 45 * random.random(n_rays), angles)
    lives = np.empty((kept.size, n_rays))
    for j, (angle, x) in enumerate(zip(angles, 10 ** random.uniform(-4, -2, n_rays), strict=True)):
        kappa = cones.critical_scale(ray(angle), 3000).value * (1 + x) * ray(angle)
        for i, number in enumerate(kept):
            lives[i, j] = cones.longest_lived(kappa, n_max, int(number))[1]
    best = lives.max(axis=0)
    known = np.isfinite(best)
    lost = 1 - lives[:, known] / best[known]
    return labelled(
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
    return labelled(
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
                if not chain.newton(kappa, orbit.site, orbit.n_sites, orbit.theta, u, workspace):
                    outcome = 0
                elif np.abs(u - right)[: end + 1].max() < 1e-9:
                    outcome = 1
                else:
                    outcome = 3 if chain.ordered(u, q, orbit.stride, full) else 2
                counts[outcome, i, j] += 1
    names = ("lost", "right", "refused", "accepted")
    words = ("no convergence", "the orbit", "another orbit, refused", "another orbit, accepted")
    return labelled(
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
