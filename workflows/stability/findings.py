"""What the nine studies of stability found, each in a sentence with the numbers just measured."""

import numpy as np

from nasm.critical import Status
from pipeline.cubes.cube import status_code

OK = status_code(Status.OK)
_NAMES = {
    "periodic": "residues",
    "continuation": "continuation",
    "cones": "converse KAM",
    "barriers": "all together",
}


def findings(studies):
    """Return {name: numbered sentence} of all studies, {name: Dataset}."""
    say = {
        "cusp": _cusp,
        "boundary": _boundary,
        "fractions": _fractions,
        "twist": _twist,
        "amplitude": _amplitude,
        "beam": _beam,
        "fakes": _fakes,
        "disorder": _disorder,
        "rounding": _rounding,
    }
    return {name: f"{i}. {say[name](studies[name])}" for i, name in enumerate(say, 1)}


def _cusp(study):
    parts = []
    for i, name in enumerate(study.approach.attrs["names"]):
        here = study.isel(approach=i)
        answered = here.delta.values[(here.status == OK).values]
        over = float((here.off / (here.error + here.judge_error)).max())
        parts.append(
            f"{_NAMES[name]} down to {answered.min(initial=np.inf):.0e}° (off by up to "
            f"{float(here.off.max()):.0e}, and by {over:.2g} times what is claimed)"
        )
    return f"Towards the cusp at 45° answers come from {'; '.join(parts)}."


def _boundary(study):
    beyond, inside = (study.isel(excess=np.flatnonzero(side)) for side in _sides(study.excess))
    n_false = int((beyond.certified == 1).sum()) or "no"
    eliminated = float(beyond.excess[np.isfinite(beyond.elimination_time).all("angle")].min())
    regular = beyond.excess.where((beyond.digits >= 5).any("angle")).max()
    seen = beyond.excess.values[np.isfinite(beyond.escape_time).any("angle")]
    n_killed = int(np.isfinite(inside.elimination_time).sum())
    return (
        f"Past the breakup {n_false} circle is certified. Converse KAM eliminates all starts from "
        f"{100 * eliminated:.2g}% beyond on, and wrongly in {n_killed} cases inside; a weighted "
        f"Birkhoff average calls an orbit regular (5 digits) up to {100 * float(regular):.2g}% "
        "beyond; 100 orbits show an escape "
        + (f"from {100 * seen.min():.2g}% beyond on." if seen.size else "nowhere.")
    )


def _sides(excess):
    return (excess > 1e-12).values, (excess < -1e-12).values


def _fractions(study):
    parts = []
    for a in study.quotient.values.tolist():
        here = study.sel(quotient=a)
        silent = int((here.status.isel(approach=0) != OK).sum())
        both = [here[name].sel(approach=1) for name in ("value", "error")]
        off = abs(both[0] - here.value.sel(approach=2))
        wrong = int((off > both[1] + here.error.sel(approach=2)).sum())
        parts.append(f"{silent} and {wrong} for a = {a:g}")
    return (
        f"Fractions disguised as irrational, [0;1,…,1,a,(1)]: of {study.q.size} for each a, "
        "residues say that they do not know, and continuation is further off than it claims (as "
        f"longer orbits show where they know), in {', '.join(parts)}."
    )


def _twist(study):
    beyond = study.isel(scale=np.flatnonzero((study.scale > 1.5).values))
    lives = beyond.elimination_time.values
    return (
        "Beyond a scale of 1.5, to and past the end of the twist, converse KAM eliminates all "
        f"starts in {np.isfinite(lives).sum()} of {lives.size} cases, within {np.max(lives):g} "
        f"steps; {int((beyond.circle == OK).sum()) or 'no'} circle is certified, though Birkhoff "
        f"averages show up to {float(beyond.digits.max()):.0f} digits for other regular orbits."
    )


def _amplitude(study):
    last, largest = study["last"], float(study.largest.max())
    return (
        f"Amplitudes of the last circles are {float(last.min()):.3f} to {float(last.max()):.3f}, "
        f"those of seven others at most {largest:.3f}, where Proposition 1 assumes less than 1: "
        f"|Δy| > {study.attrs['justified_exit']:.2f} would do as an exit."
    )


def _beam(study):
    shares = ", ".join(
        f"{100 * share:.0f}% with {kept}"
        for kept, share in zip(study.kept.values.tolist(), study.missed.values, strict=True)
    )
    return (
        "The search of converse KAM for the longest life misses 1% of it or more in these shares "
        f"of {study.attrs['searches']} searches, by the number of starts it keeps (32 in use): "
        f"{shares}."
    )


def _fakes(study):
    past = ", ".join(
        f"{100 * float(x):.2g}% with {n}"
        for n, x in zip(study.n.values.tolist(), study.past.max("ray"), strict=True)
    )
    passed = int(study.passed.sum() + study.polished.sum())
    return (
        f"Fake circles: a stop on small updates lets Newton's method go on past the breakup by "
        f"{past} points. Of {int(study.fakes.sum())} fakes the certificates pass {passed}."
    )


def _disorder(study):
    total = study.attrs["trials"] * study.refused.size
    worst = study.refused.max("noise")
    return (
        f"From bad starts Newton's method ends on an orbit of another order in up to "
        f"{100 * float(worst.max()):.0f}% of trials, from the scale "
        f"{float(study.scale[(worst > 0).values].min()):.2g} on; of all {total} the order check "
        f"lets {round(float(study.accepted.sum()) * study.attrs['trials'])} wrong ones pass."
    )


def _rounding(study):
    last = study.isel(steps=-1)
    drift = ", ".join(
        f"{name} {float(last.drift[i]):.0e}"
        for i, name in enumerate(study.arithmetic.attrs["names"])
    )
    back = study.reversal.max("steps")
    exact = [n for i, n in enumerate(study.arithmetic.attrs["names"]) if float(back[i]) == 0]
    return (
        f"Rounding: after {int(study.steps[-1])} steps orbits have drifted off a circle by {drift}"
        f"; iterated back, {' and '.join(exact) or 'none'} returns exactly to the start."
    )
