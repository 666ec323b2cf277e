"""The losses that `ripple_spectrum` computes, their predictions, and the findings."""

import numpy as np
from scipy.stats import binom

from nasm import periodic
from nasm.numbers import parse
from nasm.survivors import LONGEST_LIFETIME
from workflows.ripple_spectrum import small_divisors
from workflows.shared.judgement import finding, span
from workflows.shared.tables import columns, dataset

_CHANCE = 0.01  # probability below which agreements are not attributed to chance
_N_MODES = 8  # number of modes whose resonances are marked


def with_loss(cube, golden):
    """Add the losses 1 - κ_c/κ_G of the critical scale and of its bounds."""
    labels = {
        "loss": ("critical_scale", "loss of the threshold, 1 - κ_c/κ_G"),
        "least_loss": ("upper", "loss at the upper bound"),
        "most_loss": ("lower", "loss at the lower bound"),
    }
    values = [1 - cube[name].values / golden for name, _ in labels.values()]
    names = {name: label for name, (_, label) in labels.items()}
    dims = cube.critical_scale.dims
    added = dataset("", {}, columns(dims, names, values))
    return cube.assign(added.data_vars).assign_attrs(golden=golden)


def adiabatic_bound(frequency, depth):
    """Estimate an upper bound on κ_c(1 + d)/κ_G from the kicks around the largest one.

    At a relative distance ε beyond the breakup, converse KAM eliminates all starts within N = C/ε
    kicks in either direction (C: `LONGEST_LIFETIME`). Within N kicks of the largest one, strengths
    are at least κ(1 + d)(1 - d/(1 + d)·(1 - cos 2πNΩ)). If this minimum is κ_G(1 + ε), no start
    survives. The smallest bound over all ε is returned; it tends to 1 as Ω → 0.
    """
    excess = np.geomspace(1e-4, 10, 2000)
    turns = np.minimum(np.multiply.outer(frequency, LONGEST_LIFETIME / excess), 0.5)
    weakest = 1 - depth / (1 + depth) * (1 - np.cos(2 * np.pi * turns))
    return 1 / (weakest / (1 + excess)).max(axis=-1)


def prediction(fractions, depths, n):
    """Predict κ_c by small divisors, and bound it for slow ripples, at the given Ω and in between.

    The attribute `golden` is κ_G, at which the golden circle breaks under constant kicks; it is
    computed by residues.
    n : number of additional Ω in an evenly spaced series, and also in a geometric series.
    """
    given, least = np.array(fractions, float), float(min(fractions))
    spread = [np.geomspace(least, 0.5, n), np.linspace(least, 0.5, n)]
    frequencies, depths = np.unique(np.concatenate([given, *spread])), np.array(depths)
    kappa, omega = small_divisors.predicted(frequencies, depths)
    bound = np.transpose([adiabatic_bound(frequencies, d) / (1 + d) for d in depths])
    labels = {
        "predicted_loss": "loss of the threshold, 1 - κ_c/κ_G, by small divisors",
        "predicted_omega": "turns per kick of the circle that breaks last, by small divisors",
        "adiabatic_loss": "lower bound on the loss, by the kicks around the largest one",
    }
    golden = periodic.critical_scale("gamma", (1.0,)).value
    values = 1 - kappa / golden, omega, 1 - bound
    modes = np.arange(1, _N_MODES + 1)
    turns = modes * float(parse("gamma"))
    variables = columns(["frequency", "depth"], labels, values)
    variables["resonance"] = "mode", abs(turns - np.rint(turns)), "Ω = ±mγ mod 1"
    coords = {"frequency": (frequencies, "frequency Ω"), "depth": (depths, "depth d")}
    coords["mode"] = modes, "mode m along the golden circle"
    title = "Predicted spectrum of a ripple"
    return dataset(title, coords, variables, {"golden": golden})


def side_by_side(cube, theory):
    """Return the cube, extended by the predictions at its frequencies."""
    there = theory.drop_dims("mode").sel(frequency=cube.frequency)
    return cube.assign(there.data_vars)


def findings(cube, theory):
    """Describe how much of the spectrum small divisors and the largest kick explain."""
    table = side_by_side(cube, theory)
    known = int(cube.loss.notnull().sum())
    only = cube.fraction.values[(cube.loss.isnull() & cube.upper.notnull()).any("depth")]
    bounds = f"; some at Ω = {', '.join(only)} have only an upper bound" if only.size else ""
    limits = (
        f"Of {cube.loss.size} ripples, {known} have a value{bounds}. Not studied: phases of the "
        "ripple other than a maximum at n = 0, and irrational Ω; the prediction is to first "
        "order in d"
    )
    return " ".join([_small_divisors(table), _slow(table), f"{limits}."])


def steps(table):
    """Return whether the loss rises (1) or falls (-1) between neighbouring Ω, and what is expected.

    The first result is 0 where the brackets of neighbours overlap or where a bracket is missing;
    such pairs are not counted.
    """
    least, most = table.least_loss.values, table.most_loss.values
    found = (least[1:] > most[:-1]).astype(int) - (most[1:] < least[:-1])
    return found, np.sign(np.diff(table.predicted_loss.values, axis=0))


def _small_divisors(table):
    found, expected = steps(table)
    decided = found != 0
    n, agree = int(decided.sum()), int((found == expected)[decided].sum())
    chance = binom.sf(agree - 1, n, 0.5)
    ratio = (table.loss / table.predicted_loss).values
    known = ratio[np.isfinite(ratio)]
    low, middle, high = np.quantile(known, [0.1, 0.5, 0.9]) if known.size else 3 * [np.nan]
    text = (
        f"the loss changes as predicted in {agree} of {n} steps between neighbouring Ω whose "
        "brackets do not overlap (by chance, at least as many would agree with probability "
        f"{chance:.1g}); its ratio to the predicted loss has a median of {middle:.2g}, and is "
        f"{low:.2g} to {high:.2g} for 80% of the ripples"
    )
    claim = "losses rise and fall with Ω as small divisors of circles under constant kicks predict"
    # If 0.5**n exceeds this probability, even n agreements could be due to chance.
    return finding(claim, text, agree == n, chance < _CHANCE, 0.5**n < _CHANCE)


def _slow(table):
    """Judge whether κ_c = κ_G/(1 + d) where the kicks around the largest one alone cause a loss."""
    slow = table.where(table.adiabatic_loss > 0)
    by = (1 + table.depth) / table.attrs["golden"]
    upper, lower = (by * slow.upper).values, (by * slow.lower).values
    bound = (by * (1 - slow.adiabatic_loss) * table.attrs["golden"]).values
    n, below = int(np.isfinite(upper).sum()), int((upper < 1).sum())
    contradicted = int((lower > bound).sum())
    text = (
        f"of {n} ripples so slow that the kicks around the largest one cause a loss by themselves, "
        f"{below} already have no barrier at κ_G/(1 + d), and {contradicted} have a barrier beyond "
        f"the bound from these kicks; their upper bounds on κ_c(1 + d)/κ_G are {span(upper)}"
    )
    claim = "a slow ripple lowers κ_c exactly to κ_G/(1 + d), where its largest kick is κ_G"
    return finding(claim, text, below == 0 and contradicted == 0, known=n > 0)
