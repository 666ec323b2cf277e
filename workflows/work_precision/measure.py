"""Measure CPU times and errors of all methods, and find the fastest one for each accuracy."""

from math import nan
from statistics import median
from time import thread_time

import numpy as np
import xarray as xr

from nasm.numbers import parse
from pipeline.cubes.cube import blank, coordinate, text
from workflows.work_precision.methods import JUDGE, METHODS, PROFILES, Ray, judged

ACCURACIES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-8, 1e-10)


def timed(run, *arguments):
    """Return the result and the median CPU time of up to five runs, started within 0.2 CPU s."""
    seconds = []
    while len(seconds) < 5 and sum(seconds) < 0.2:
        start = thread_time()
        found = run(*arguments)
        seconds.append(thread_time() - start)
    return found, median(seconds)


def measure(rays, names, quick, show):
    """Return a Dataset of CPU times and errors on rays, with dims (ray, method, level).

    show : function called with a text that describes the current measurement.
    """
    efforts = {name: METHODS[name].efforts[: -1 if quick else None] for name in names}
    answers = [(name, answer) for name in names for answer in METHODS[name].answers]
    ray = text("ray", rays, "degrees, or the forcing")
    method = text("method", (answer for _, answer in answers), "method, and its result")
    level = coordinate("level", range(max(map(len, efforts.values()))), "level of effort")
    coords = {"ray": ray, "method": method, "level": level}
    effort = [METHODS[name].effort for name, _ in answers]
    label = "effort: steps N or n, period q, points, tolerance tol, or distance ε"
    variables = {
        "effort": blank({"method": method, "level": level}, label),
        "effort_is": text("method", effort, "meaning of the effort"),
        "cpu_seconds": blank(coords, "median CPU time of one run", units="s"),
        "error": blank(coords, "relative error"),
        "estimated_error": blank(coords, "relative error that the method estimates"),
        "warm_up_seconds": blank({"method": method}, "CPU time of a first run", units="s"),
        "value": blank({"ray": ray}, "reference scale of the breakup"),
        "judge_error": blank({"ray": ray}, "estimated relative error of value"),
    }
    labels = {"title": "Speed against accuracy of all methods", "judge_q_max": JUDGE}
    data = xr.Dataset(variables, coords, labels).compute().copy(deep=True)  # blanks share memory
    rows = {name: [i for i, (of, _) in enumerate(answers) if of == name] for name in names}
    for name, indices in rows.items():  # the first method that uses a kernel compiles it
        data.effort[indices, : len(efforts[name])] = efforts[name]
        start = thread_time()
        METHODS[name].run(Ray(PROFILES["0"], parse("gamma"), 0.48, nan), METHODS[name].efforts[0])
        data.warm_up_seconds[indices] = thread_time() - start
    for i, on in enumerate(rays):
        ray = judged(on)
        data.value[i], data.judge_error[i] = ray.value, ray.error / ray.value
        for name, indices in rows.items():
            for level, effort in enumerate(efforts[name]):
                show(f"{on}: {name}, {METHODS[name].effort} = {effort:g}")
                answer_values, seconds = timed(METHODS[name].run, ray, effort)
                data.cpu_seconds[i, indices, level] = seconds
                scale, error = np.transpose(answer_values)
                data.error[i, indices, level] = np.abs(scale / ray.value - 1)
                data.estimated_error[i, indices, level] = error / ray.value
    return data


def order(data, method):
    """Fit the slope of log error against log effort; return the median over rays, or NaN."""
    slopes = []
    for ray in range(data.ray.size):
        levels = data.isel(ray=ray, method=method)
        is_resolved = (levels.error > 10 * levels.judge_error).values
        if is_resolved.sum() > 2:
            points = (
                np.log(levels.effort.values[is_resolved]),
                np.log(levels.error.values[is_resolved]),
            )
            slopes.append(np.polyfit(*points, 1)[0])
    return float(np.median(slopes)) if slopes else nan


def seconds_for(data, accuracy):
    """Return the CPU seconds that each method needs to reach an accuracy on every ray.

    The accuracy refers to the scale of the last breakup. On each ray, a level of effort qualifies
    if all errors at this level and above are within the accuracy, and the qualifying level with the
    shortest CPU time is chosen. The result is the time on the slowest ray, or NaN if no level
    qualifies on some ray. Rays on which a method has no answer are skipped.
    """
    failed = (data.error > accuracy) | data.error.isnull() & data.effort.notnull()
    from_here = ~failed.values[..., ::-1].cumsum(axis=-1)[..., ::-1].astype(bool)
    from_here &= data.error.notnull().values
    seconds = np.where(from_here, data.cpu_seconds, np.inf).min(axis=-1)
    seconds = np.where(data.error.notnull().any("level"), seconds, 0).max(axis=0)
    return np.where(np.isinf(seconds) | (seconds == 0), nan, seconds)


def fastest(data):
    """Describe which method is the fastest for each accuracy."""
    cheapest = {}
    for accuracy in ACCURACIES:
        seconds = seconds_for(data, accuracy)
        if np.isfinite(seconds).any():
            best = int(np.nanargmin(seconds))
            cheapest[data.method.values[best], f"{seconds[best]:.2g} s"] = accuracy
    parts = [f"{accuracy:.0e} by {name} in {s}" for (name, s), accuracy in cheapest.items()]
    rays = ", ".join(f"{name}°" if name.isdigit() else name for name in data.ray.values)
    return (
        "CPU time to reach a given relative error of the last breakup on every ray with an answer; "
        f"rays: {rays}; reference: Greene's residue, with a relative error of "
        f"{float(data.judge_error.max()):.0e}. Fastest: "
        f"{'; '.join(parts) or 'none'}. Circles and residues need ω as input, proofs need a "
        "forcing; barriers and converse KAM need neither."
    )


def table(data):
    """Return a Markdown table of each method's CPU times, by accuracy and for its first run."""
    columns = [seconds_for(data, accuracy) for accuracy in ACCURACIES]
    columns.append(data.warm_up_seconds.values)
    heads = [f"{accuracy:.0e}".replace("e-0", "e-") for accuracy in ACCURACIES]
    lines = [f"| seconds for an error of | {' | '.join(heads)} | first run | error ∝ |"]
    lines.append("|---" * (len(columns) + 2) + "|")
    for i, label in enumerate(data.method.values):
        cells = [f"{column[i]:.2g}" if column[i] == column[i] else "–" for column in columns]
        slope = order(data, i)
        law = f"{data.effort_is.values[i]}^{slope:.2f}" if abs(slope) > 0.1 else "–"
        lines.append(f"| {label} | {' | '.join(cells)} | {law} |")
    return "\n".join(lines)
