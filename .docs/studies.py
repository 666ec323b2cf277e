"""Evaluate the results of `stability` and `work_precision`, which test methods, and of `claims`.

Each function reads the results that its command has written to a folder. A promise is what the
documentation of a method states about its results, e.g. that a value is accurate to within its
error. To test this, the difference between the value and the value of the most accurate method is
divided by the sum of their errors; if this ratio exceeds 1, the promise is broken.
"""

import csv
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from nasm import action, barriers, circles, escape, orbits, periodic, tori
from nasm.circles import continuation
from nasm.converse_kam import symmetry_line
from nasm.results import Status
from workflows.shared.judgement import Verdict

OK = list(Status).index(Status.OK)
DIGITS = 5  # an orbit whose average has at least this many digits looks regular


@dataclass(frozen=True)
class Finding:
    """How often a method kept a promise in a study.

    Attributes
    ----------
    method : callable
        The method.
    promise, sample : str
        What the method promises, and the cases on which the promise is tested.
    asked, answered, broken : int
        Numbers of cases, of answers that can be compared, and of answers that break the promise.
    worst : float
        The largest ratio; NaN if the promise involves no ratio and is simply kept or broken.
    """

    method: Callable[..., Any]
    promise: str
    sample: str
    asked: int
    answered: int
    broken: int
    worst: float = float("nan")


def opened(folder: Path, name: str) -> xr.Dataset:
    return xr.open_zarr(folder / f"{name}.zarr", chunks=None).load()


def by_ratio(method: Callable[..., Any], promise: str, sample: str, ratio: xr.DataArray) -> Finding:
    """Return the Finding for an array of ratios; NaN marks a case without an answer."""
    known = ratio.values[np.isfinite(ratio.values)]
    broken = int((known > 1).sum())
    return Finding(
        method, promise, sample, ratio.size, known.size, broken, known.max(initial=-np.inf)
    )


def by_case(method: Callable[..., Any], promise: str, sample: str, broken: xr.DataArray) -> Finding:
    """Return the Finding for an array that is true where a promise is broken."""
    return Finding(method, promise, sample, broken.size, broken.size, int(broken.sum()))


def below(
    method: Callable[..., Any], promise: str, sample: str, lower: xr.DataArray, most: xr.DataArray
) -> Finding:
    """Return the Finding for lower bounds, which are promised to be below `most`."""
    known = (lower.notnull() & most.notnull()).values
    broken = int((lower.values >= most.values)[known].sum())
    return Finding(method, promise, sample, lower.size, int(known.sum()), broken)


def stability(folder: Path) -> Iterator[Finding]:
    """Yield the findings of six of the seven studies in `workflows.stability`."""
    value = "value ± error"
    study = opened(folder, "stability_cusp")
    ratio = study.off / (study.error + study.judge_error)
    methods = periodic, continuation, symmetry_line, barriers
    for number, module in enumerate(methods):
        sample = "rays 10° to 10⁻⁵° from the cusp at 45°"
        yield by_ratio(module.critical_scale, value, sample, ratio.isel(approach=number))

    study = opened(folder, "stability_boundary")
    beyond = study.isel(excess=np.flatnonzero(study.excess > 0))
    within = study.isel(excess=np.flatnonzero(study.excess < 0))
    sample = f"forcings 0.01 to 10% {{}} the breakup, on {study.angle.size} rays"
    past, inside = sample.format("beyond"), sample.format("below")
    yield by_case(
        circles.invariant_circle, "a certified circle exists", past, beyond.certified == 1
    )
    yield by_case(
        symmetry_line.longest_lived,
        "where all starts are eliminated no circle exists",
        inside,
        np.isfinite(within.elimination_time),
    )
    for name, words in ("escape_time", "double"), ("escape_time_single", "single"):
        promise = f"an escape shows transport, in {words} precision"
        yield by_case(escape.first_escape, promise, inside, np.isfinite(within[name]))
    promise = f"not promised: where a Birkhoff average has {DIGITS} digits a circle exists"
    yield by_case(orbits.rotation_number, promise, past, beyond.digits >= DIGITS)

    study = opened(folder, "stability_fractions")
    last = study.isel(approach=2)
    sample = "irrational ω close to fractions"
    for number, module in enumerate((periodic, continuation)):
        part = study.isel(approach=number)
        ratio = abs(part.value - last.value) / (part.error + last.error)
        yield by_ratio(module.critical_scale, value, sample, ratio)
    yield below(
        continuation.critical_scale,
        "a circle exists at lower",
        sample,
        study.lower,
        last.value + last.error,
    )

    study = opened(folder, "stability_twist")
    excluded = study.circle.values[np.isfinite(study.elimination_time.values)]
    promise = "a certified circle exists"
    sample = "forcings up to scale 3 at which converse KAM excludes all circles"
    yield by_case(circles.invariant_circle, promise, sample, excluded == OK)

    study = opened(folder, "stability_disorder")
    trials = study.attrs["trials"]
    accepted, refused = (
        round(float(study[name].sum()) * trials) for name in ("accepted", "refused")
    )
    wrong = accepted + refused
    promise, sample = (
        "an orbit in a different order is rejected",
        "wrong orbits that Newton's method finds",
    )
    yield Finding(action.is_ordered, promise, sample, wrong, wrong, accepted)

    study = opened(folder, "stability_tori")
    sample = "tori near resonances, judged by converse KAM from above"
    promise, least = "value - error is below the breakup", study.value - study.error
    yield below(tori.critical_scale, promise, sample, least, study.upper)
    yield below(tori.critical_scale, "a torus exists at lower", sample, study.lower, study.upper)
    sample = "searches 1 to 50% beyond the bound of converse KAM"
    yield by_case(tori.invariant_torus, "a certified torus exists", sample, study.past == OK)


def work_precision(folder: Path) -> Iterator[Finding]:
    """Yield findings that compare the claimed errors with the true ones at all levels of effort."""
    study = opened(folder, "work_precision")
    ratio = study.error / (study.estimated_error + study.judge_error)
    ratio = ratio.where(study.effort.notnull())
    answers = {
        escape.critical_scale: [name for name in study.method.values if name.startswith("direct")],
        symmetry_line.critical_scale: ["converse KAM, upper bound", "converse KAM, value"],
        continuation.critical_scale: ["blow-up of circles"],
        periodic.critical_scale: ["residue, Aitken"],
        barriers.critical_scale: ["last barrier, value"],
    }
    for method, names in answers.items():
        part = ratio.sel({"method": names})  # `method` is also an argument of sel
        measured = study.effort.sel({"method": names}).notnull().broadcast_like(part)
        asked = part.values[measured.transpose(*part.dims).values]
        yield by_ratio(
            method,
            "value ± error",
            f"runs on {study.ray.size} rays, at all levels of effort",
            xr.DataArray(asked),
        )


def claims(folder: Path) -> list[tuple[str, Counter[Verdict]]]:
    """Return the counts of each verdict on the paper's claims, for each section of the paper."""
    with (folder / "claims.csv").open(encoding="utf-8", newline="") as file:
        lines = list(csv.DictReader(file))
    sections: dict[str, Counter[Verdict]] = {}
    for line in lines:
        section = line["place"].partition(",")[0]
        sections.setdefault(section, Counter())[Verdict(line["verdict"])] += 1
    return list(sections.items())
