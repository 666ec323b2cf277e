"""How much does each method compute for an accuracy? Speed against error, all methods on five rays.

The answer that all are judged by is Greene's residue with periods up to 30 000; the circle that
breaks last, whose ω circles and residues must be told, is the one that `nasm.barriers` names.
Seconds are CPU seconds of one thread, the median of several runs; a first run, which imports and
compiles, is told apart.

There is no single precision here. Only direct iteration could use it: its error, a bias, is far
above rounding, and twice the steps in the same time would divide it by 2^(1/3). All other methods
need digits that single precision has not: starts 10⁻¹⁶ apart, residuals of 10⁻¹⁰, residues from
10⁻¹² on.
"""

from math import nan
from statistics import median
from time import thread_time

import click

from workflows.cli import HELP, driver
from workflows.contenders import JUDGE, METHODS, PROFILES, Ray, judged

ACCURACIES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-8, 1e-10)
FORMS = ("chain form", "the paper's Algorithm 1")
POINTS = [2**k for k in range(6, 15)]


def answers(names):
    """(name, answer) of all answers of some methods."""
    return [(name, answer) for name in names for answer in METHODS[name].answers]


def plan(angles, names, quick):
    """The cube, nothing measured yet."""
    import numpy as np
    import xarray as xr

    from pipeline.cubes.cube import Cube

    efforts = {name: METHODS[name].efforts[: -1 if quick else None] for name in names}
    rows = answers(names)
    n_levels = max(map(len, efforts.values()))
    effort = [efforts[name] + [np.nan] * (n_levels - len(efforts[name])) for name, _ in rows]
    coords = {
        "angle": ("angle", angles, _told("angle of the ray", "degree")),
        "method": ("method", range(len(rows)), _told("method and what it answers")),
        "level": ("level", range(n_levels), _told("level of effort")),
        "form": ("form", range(len(FORMS)), _told("form of Newton's step for a circle")),
        "points": ("points", POINTS, _told("points of the circle")),
    }
    coords["method"][2]["names"] = [answer for _, answer in rows]
    coords["method"][2]["efforts"] = [METHODS[name].effort for name, _ in rows]
    coords["form"][2]["names"] = list(FORMS)
    every = ("angle", "method", "level")
    variables = {
        "effort": (every[1:], "effort: steps N or n, period q, points, or tolerance tol", "1"),
        "cpu_seconds": (every, "CPU time of one run, median", "s"),
        "error": (every, "relative error", "1"),
        "estimated_error": (every, "error that the method estimates, in parts of the value", "1"),
        "warm_up_seconds": (every[1:2], "CPU time of a first run, which compiles", "s"),
        "value": (every[:1], "scale of the breakup that all are judged by", "1"),
        "judge_error": (every[:1], "relative error of that scale, estimated", "1"),
        "step_seconds": (("form", "points"), "CPU time of one Newton step, median", "s"),
    }
    template = xr.Dataset(coords=coords, attrs={"title": "Speed against accuracy of all methods"})
    for key, (dims, long_name, units) in variables.items():
        blank = np.full([template.sizes[dim] for dim in dims], np.nan)
        template[key] = (dims, blank, _told(long_name, units))
    template["effort"].values[:] = effort
    settings = {"efforts": efforts, "judge_q_max": JUDGE}
    return Cube("work_precision", template, {}, settings)


def _told(long_name, units="1"):
    return {"long_name": long_name, "units": units}


def timed(run, *arguments):
    """What it returns, and the median CPU seconds of up to five runs, in 0.2 s or one run."""
    seconds = []
    while len(seconds) < 5 and sum(seconds) < 0.2:
        start = thread_time()
        found = run(*arguments)
        seconds.append(thread_time() - start)
    return found, median(seconds)


def measure(blank, names, tell=lambda text: None):
    """`plan`'s template with all numbers; tell(text) hears of the progress."""
    import numpy as np

    from nasm.numbers import parse

    data = blank.copy(deep=True)
    rows = {name: [] for name in names}
    for row, (name, _) in enumerate(answers(names)):
        rows[name].append(row)
    for name, here in rows.items():  # kernels that methods share are compiled by the first of them
        start = thread_time()
        METHODS[name].run(Ray(PROFILES[0], parse("gamma"), nan, nan), METHODS[name].efforts[0])
        data.warm_up_seconds[here] = thread_time() - start
    for i, angle in enumerate(data.angle.values.tolist()):
        ray = judged(angle)
        data.value[i], data.judge_error[i] = ray.value, ray.error / ray.value
        for name, here in rows.items():
            n_efforts = int(data.effort[here[0]].notnull().sum())
            for level, effort in enumerate(METHODS[name].efforts[:n_efforts]):
                found, seconds = timed(METHODS[name].run, ray, effort)
                data.cpu_seconds[i, here, level] = seconds
                scale, error = np.transpose(found)
                data.error[i, here, level] = np.abs(scale / ray.value - 1)
                data.estimated_error[i, here, level] = error / ray.value
                tell(f"{angle}°: {name}, {METHODS[name].effort} = {effort:g}: {seconds:.3g} s")
    data["step_seconds"].values[:] = newton_seconds()
    return data


def newton_seconds():
    """CPU time of a Newton step of the golden circle, in the order of FORMS and POINTS."""
    import numpy as np

    from nasm import circles, fourier, parameterization
    from nasm.numbers import parse

    omega, kappa = parse("gamma"), np.array([0.3, 0.5])
    u = circles.invariant_circle(omega, kappa).u
    return [
        [timed(step, omega, kappa, fourier.resample(u, n))[1] for n in POINTS]
        for step in (circles.newton_step, parameterization.newton_step)
    ]


def order(data, method):
    """The slope of log error against log effort, median over the rays; NaN if there is none."""
    import numpy as np

    slopes = []
    for angle in range(data.angle.size):
        here = data.isel(angle=angle, method=method)
        seen = (here.error > 10 * here.judge_error).values
        if seen.sum() > 2:
            points = np.log(here.effort.values[seen]), np.log(here.error.values[seen])
            slopes.append(np.polyfit(*points, 1)[0])
    return float(np.median(slopes)) if slopes else nan


def seconds_for(data, accuracy):
    """CPU seconds by method to have the last circle's breakup to that accuracy on every ray.

    The effort is the least from which on all errors are that small; the slowest ray counts. NaN
    where a ray is never that accurate.
    """
    import numpy as np

    failed = (data.error > accuracy) | data.error.isnull() & data.effort.notnull()
    from_here = ~failed.values[..., ::-1].cumsum(axis=-1)[..., ::-1].astype(bool)
    from_here &= data.error.notnull().values
    seconds = np.where(from_here, data.cpu_seconds, np.inf).min(axis=-1).max(axis=0)
    return np.where(np.isinf(seconds), nan, seconds)


def table(data):
    """Lines of a Markdown table: which method for which accuracy, and what it compiles."""
    columns = [seconds_for(data, accuracy) for accuracy in ACCURACIES]
    columns.append(data.warm_up_seconds.values)
    heads = [f"{accuracy:.0e}".replace("e-0", "e-") for accuracy in ACCURACIES]
    lines = [f"| seconds for an error of | {' | '.join(heads)} | first run | error ∝ |"]
    lines.append("|---" * (len(columns) + 2) + "|")
    for i, label in enumerate(data.method.attrs["names"]):
        cells = [f"{column[i]:.2g}" if column[i] == column[i] else "–" for column in columns]
        slope = order(data, i)
        law = f"{data.method.attrs['efforts'][i]}^{slope:.2f}" if abs(slope) > 0.1 else "–"
        lines.append(f"| {label} | {' | '.join(cells)} | {law} |")
    return lines


def _choice(option, values, help):
    return click.option(option, multiple=True, type=click.Choice(values), help=help)


@click.command(context_settings=HELP)
@click.option("--quick", is_flag=True, help="Leave out the largest effort of each method.")
@_choice("--only", list(METHODS), "A method to measure; may be repeated.  [default: all]")
@_choice("--angle", [str(a) for a in PROFILES], "A ray, in degrees; may be repeated.  [all]")
@click.option("--out", default="out", show_default=True, help="Directory of the results.")
def main(out, quick, only, angle):
    """Speed against accuracy of all methods: a cube, a table and a figure in OUT.

    On one core, about a minute and a half with --quick and fifteen minutes without.
    """
    names = tuple(dict.fromkeys(only)) or tuple(METHODS)
    with driver(out):
        from dataclasses import replace

        from pipeline import store
        from workflows.figures.style import save
        from workflows.figures.work_precision import draw_work_precision

        cube = plan([int(a) for a in dict.fromkeys(angle)] or list(PROFILES), names, quick)
        store.refuse_different(out, cube)
        data = measure(cube.template, names, lambda text: click.echo(text, err=True))
        store.replace(out, replace(cube, template=data))
        cells = data[["effort", "cpu_seconds", "error", "estimated_error"]].to_dataframe()
        cells = cells.dropna(subset=["cpu_seconds"]).reset_index()
        for key in ("names", "efforts"):
            cells[key] = [data.method.attrs[key][i] for i in cells.method]
        cells.to_csv(f"{out}/work_precision.csv", index=False, float_format="%.6g")
        figures = save(draw_work_precision(data), out, "work_precision")
    click.echo("\n".join(table(data)))
    click.echo(f"cube:   {out}/cubes.zarr, group work_precision")
    click.echo(f"table:  {out}/work_precision.csv")
    click.echo(f"figure: {', '.join(figures)}")


if __name__ == "__main__":
    main()
