"""Studies of stability: what beam searches miss, and what Newton's method finds in error."""

import numpy as np

from nasm import action
from nasm.converse_kam import symmetry_line
from nasm.symmetries import ray
from workflows.shared.tables import dataset


def missed_survivors(quick):
    """5. Count how often beam searches of converse KAM miss the longest life that any has found."""
    kept, n_max = 2 ** np.arange(6), 20_000
    random = np.random.default_rng(6)
    n_rays = 20 if quick else 150
    angles = np.where(random.random(n_rays) < 1 / 3, 45 - random.random(n_rays), 45)
    angles = np.where(angles == 45, 45 * random.random(n_rays), angles)
    lives = np.empty((kept.size, n_rays))
    for j, (angle, x) in enumerate(zip(angles, 10 ** random.uniform(-4, -2, n_rays), strict=True)):
        kappa = symmetry_line.critical_scale(ray(angle), 3000).value * (1 + x) * ray(angle)
        for i, number in enumerate(kept):
            lives[i, j] = symmetry_line.longest_lived(kappa, n_max, int(number))[1]
    best = lives.max(axis=0)
    known = np.isfinite(best)
    lost = 1 - lives[:, known] / best[known]
    coords, searches = {"kept": (kept, "starts kept at each level")}, {"searches": int(known.sum())}
    variables = {
        "missed": ("kept", (lost > 0.01).mean(axis=1), "part that misses 1% of a life"),
        "worst": ("kept", lost.max(axis=1), "largest part of a life missed"),
    }
    return dataset("Lives that the beam search misses", coords, variables, searches)


def disordered_orbits(quick):
    """6. Start Newton's method for the orbit of 13/21 badly: see what it finds, and accepts.

    The forcing grows from inside the plane's barriers to far beyond; starts are the rotation with
    random deviations of 0.03 and 0.1 turns.
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
        least = action.total(orbit.kappa, theta, orbit.u)
        for i, noise in enumerate(noises):
            for _ in range(trials):
                u = orbit.u[0] + noise * random.standard_normal(theta.size)
                search = action.relax(orbit.kappa, theta, u, orbit.kind, 0.1 / q, 60, work)
                change, curvature, *_, bad = search
                if not change < 1e-7 or bad or curvature >= 0:
                    outcome = 0
                elif not action.is_ordered(u, hop, 1 / q):
                    outcome = 2
                else:  # the right one, at any of its times, has its action
                    same = abs(action.total(orbit.kappa, theta, u) - least) < 1e-12
                    outcome = 1 if same else 3
                counts[outcome, i, j] += 1
    coords = {
        "noise": (list(noises), "rms deviation from the rotation, turns"),
        "scale": (scales, "scale s of the forcing s·(1, 0.5)"),
    }
    words = {
        "lost": "part of starts without convergence",
        "right": "part that leads to the orbit",
        "refused": "part that leads to another orbit, refused",
        "accepted": "part that leads to another orbit, accepted",
    }
    parts = zip(words.items(), counts / trials, strict=True)
    variables = {name: ([*coords], part, label) for (name, label), part in parts}
    title = "Orbits that Newton's method finds from bad starts"
    return dataset(title, coords, variables, {"trials": trials})
