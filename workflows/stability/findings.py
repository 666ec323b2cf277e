"""The seven studies of stability, and a sentence on each with the numbers just measured."""

import numpy as np

from workflows.figures.style import names_of
from workflows.stability import limits, searches, tori

OK = 1  # of `status`, see `pipeline.cubes.cube`
_SAID = {"periodic": "residues", "cones": "converse KAM", "barriers": "all together"}


def _cusp(study):
    parts = []
    for i, name in enumerate(names_of(study.approach)):
        here = study.isel(approach=i)
        nearest = here.delta.values[(here.status == OK).values].min(initial=np.inf)
        over = float((here.off / (here.error + here.judge_error)).max())
        parts.append(
            f"{_SAID.get(name, name)} down to {nearest:.0e}° (off by up to "
            f"{float(here.off.max()):.0e}, and by {over:.2g} times what is claimed)"
        )
    return f"Towards the cusp at 45° answers come from {'; '.join(parts)}."


def _boundary(study):
    beyond = study.isel(excess=np.flatnonzero((study.excess > 1e-12).values))
    wrong = np.isfinite(study.elimination_time.where(study.excess < -1e-12)).sum()
    gone = beyond.excess.where(np.isfinite(beyond.elimination_time).all("angle")).min()
    regular = beyond.excess.where((beyond.digits >= 5).any("angle")).max()
    seen, single = (
        beyond.excess.where(np.isfinite(times).any("angle")).min()
        for times in (beyond.escape_time, beyond.escape_time_single)
    )
    leaks = np.isfinite(study.escape_time_single.where(study.excess < -1e-12)).sum()
    return (
        f"Past the breakup {int((beyond.certified == 1).sum())} circles are certified. Converse "
        f"KAM eliminates all starts from {_percent(gone)} beyond on, and wrongly in {int(wrong)} "
        "cases inside; a weighted Birkhoff average calls an orbit regular (5 digits) up to "
        f"{_percent(regular)} beyond; 100 orbits show an escape "
        + (f"from {_percent(seen)} beyond on" if np.isfinite(seen) else "nowhere")
        + (f" (in single precision from {_percent(single)})" if np.isfinite(single) else "")
        + f"; in single precision {int(leaks)} ensembles leak through a circle inside."
    )


def _fractions(study):
    silent = [(study.status.isel(approach=i) != OK).sum("q").values.tolist() for i in (0, 1)]
    norms, judge = study.isel(approach=1), study.isel(approach=2)
    wrong = int((abs(norms.value - judge.value) > norms.error + judge.error).sum())
    large = ", ".join(f"{a:g}" for a in study.quotient.values)
    return (
        f"Fractions disguised as irrational, [0;1,…,1,a,(1)] with a = {large}: of {study.q.size} "
        f"for each a residues refuse an answer in {', '.join(map(str, silent[0]))}, continuation "
        f"in {', '.join(map(str, silent[1]))}; judged by longer orbits, continuation is further "
        f"off than it claims in {wrong}."
    )


def _twist(study):
    beyond = study.isel(scale=np.flatnonzero((study.scale > 1.5).values))
    lives = beyond.elimination_time.values
    return (
        "Beyond a scale of 1.5, to and past the end of the twist, converse KAM eliminates all "
        f"starts in {np.isfinite(lives).sum()} of {lives.size} cases, within {np.max(lives):g} "
        f"steps; {int((beyond.circle == OK).sum())} circles are certified, though Birkhoff "
        f"averages show up to {float(beyond.digits.max()):.0f} digits for other regular orbits."
    )


def _beam(study):
    return (
        "The search of converse KAM for the longest life misses 1% of it or more in these shares "
        f"of {study.attrs['searches']} searches, by the number of starts it keeps (32 in use): "
        f"{_shares(study.kept, study.missed)}."
    )


def _disorder(study):
    trials, worst = study.attrs["trials"], study.refused.max("noise")
    return (
        "From bad starts Newton's method ends on an orbit of another order in up to "
        f"{_percent(worst.max())} of trials, from the scale "
        f"{float(study.scale.where(worst > 0).min()):.2g} on; of all {trials * study.refused.size} "
        f"the order check lets {round(float(study.accepted.sum()) * trials)} wrong ones pass."
    )


def _tori(study):
    parts = []
    for i, name in enumerate(names_of(study.pair)):
        here = study.isel(pair=i)
        shown = here.delta.values[here.lower.notnull().values].min(initial=np.inf)
        known = here.delta.values[(here.status == OK).values].min(initial=np.inf)
        parts.append(f"{name} down to {shown:.0e} (with a value, {known:.0e})")
    return (
        f"Next to a resonance tori are certified for {'; '.join(parts)}; nearer, the status says "
        f"why not. Of those {int((study.lower >= study.upper).sum())} are beyond what converse KAM "
        f"leaves of their Ω; past that {int((study.past == OK).sum())} of {study.past.size} are "
        "certified, on any grid."
    )


def _percent(part):
    return f"{100 * float(part):.2g}%"


def _shares(numbers, parts):
    pairs = zip(numbers.values.tolist(), parts.values, strict=True)
    return ", ".join(f"{_percent(part)} with {number}" for number, part in pairs)


STUDIES = {
    "cusp": (limits.near_cusp, _cusp),
    "boundary": (limits.past_boundary, _boundary),
    "fractions": (limits.disguised_fractions, _fractions),
    "twist": (limits.beyond_the_twist, _twist),
    "beam": (searches.missed_survivors, _beam),
    "disorder": (searches.disordered_orbits, _disorder),
    "tori": (tori.nearly_resonant, _tori),
}
"""{name: (study(quick) → Dataset, Dataset → what it found)}, in the order of their numbers."""
