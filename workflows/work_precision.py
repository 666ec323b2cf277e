"""How much does each method compute for an accuracy? Speed against error, all methods on five rays.

The answer that all are judged by is Greene's residue with periods up to `JUDGE`; the circle that
breaks last, whose ω circles and residues must be told, is the one that `nasm.barriers` names.
Seconds are CPU seconds of one thread, the median of several runs; a first run, which imports and
compiles, is told apart.

There is no single precision here. Only direct iteration could use it: its error, a bias, is far
above rounding, and twice the steps in the same time would divide it by 2^(1/3). All other methods
need digits that single precision has not: starts 10⁻¹⁶ apart, residuals of 10⁻¹⁰, residues from
10⁻¹² on.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, nan, radians
from statistics import median
from time import thread_time

import click

from workflows.cli import HELP, driver

JUDGE = 30_000
PROFILES = {45: (1.0, 1.0), 0: (1.0, 0.0)} | {
    angle: (cos(radians(angle)), cos(radians(90 - angle))) for angle in (30, 40, 120)
}
ACCURACIES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-8, 1e-10)


@dataclass(frozen=True)
class Ray:
    """A problem: on κ = s·profile the last circle, of omega, breaks at s = value ± error."""

    profile: tuple
    omega: object
    value: float
    error: float


@dataclass
class Method:
    """run(ray, effort) → (scale, estimated error) for each of `answers`; efforts, the last one in
    full runs only."""

    answers: tuple[str, ...]
    effort: str
    efforts: list
    run: Callable


def direct(n_orbits, reach):
    """Direct iteration; transport is |y_n - y_0| > reach for all starts 0 ≤ y_0 ≤ 0.3."""

    def run(ray, n_max):
        from nasm import escape

        window = (-reach, 0.3 + reach)
        found = escape.critical_scale(ray.profile, n_max, n_orbits, window)
        return (found.upper, found.error), (found.value, found.error)

    return run


def converse_kam(ray, n_max):
    from nasm import cones

    found = cones.critical_scale(ray.profile, n_max)
    return (found.upper, found.upper - found.value), (found.value, found.error)


def crossing(ray, q_max):
    from nasm import periodic

    _, scales = periodic.crossings(ray.omega, ray.profile, q_max)
    return ((scales[-1], abs(scales[-1] - scales[-2])) if scales.size else (nan, nan),)


def residue(ray, q_max):
    from nasm import periodic

    found = periodic.critical_scale(ray.omega, ray.profile, q_max)
    return ((found.value, found.error),)


def continuation(ray, tol):
    from nasm import continuation

    found = continuation.critical_scale(ray.omega, ray.profile, tol)
    return ((found.value, found.error),)


def last_circle(ray, n_points):
    """The last circle that is certified with that many points."""
    import numpy as np

    from nasm import circles

    start = None

    def exists(scale):
        nonlocal start
        kappa = scale * np.array(ray.profile)
        circle = circles.invariant_circle(ray.omega, kappa, n_points, start)
        start = circle.u if circle.certified else start
        return circle.certified

    largest = 2 / max(map(abs, ray.profile))  # where there is no circle
    return ((_last(exists, 0.0, largest, 0.1 / n_points), nan),)


def birkhoff(ray, n):
    """The last scale at which the orbit that lives longest by converse KAM looks quasiperiodic.

    It does if its rotation number has five digits, and is none of the fractions up to q = 200 that
    islands have. No test of existence: longer islands and what is left of circles look so too. The
    search stays within a tenth of what converse KAM says, for more regular orbits lie beyond.
    """
    from fractions import Fraction

    import numpy as np

    from nasm import cones, orbits, periodic

    profile = np.array(ray.profile)
    site, a = periodic.dominant_centre(profile)

    def quasiperiodic(scale):
        y, _ = cones.longest_lived(scale * profile, n)
        omega, digits = map(float, orbits.rotation_number(scale * np.roll(profile, -site), a, y, n))
        if omega != omega:
            return False
        return abs(omega - Fraction(omega).limit_denominator(200)) > 10 * 10**-digits

    near = cones.critical_scale(profile, 100).value
    return ((_last(quasiperiodic, 0.9 * near, 1.1 * near, 0.1 / n), nan),)


def _last(holds, low, high, precision):
    """Bisection for the scale up to which something holds, to that part of it."""
    while high - low > precision * high:
        middle = (low + high) / 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def barrier(ray, tol):
    from nasm import barriers

    found = barriers.critical_scale(ray.profile, tol)
    return (found.lower, found.upper - found.lower), (found.value, found.error)


STEPS = [1000, 10_000, 100_000, 1_000_000]
PERIODS = [30, 100, 300, 1000, 3000, 10_000]
METHODS = {
    "direct": Method(("direct", "direct, extrapolated"), "N", STEPS, direct(10_000, 2.0)),
    "direct-100": Method(
        ("direct, 100 orbits", "direct, 100 orbits, extrapolated"), "N", STEPS, direct(100, 2.0)
    ),
    "direct-window": Method(
        ("direct, 100 orbits, near exit", "direct, 100 orbits, near exit, extrapolated"),
        "N",
        STEPS,
        direct(100, 1.2),
    ),
    "cones": Method(
        ("converse KAM, upper bound", "converse KAM, value"), "N", [100, *STEPS], converse_kam
    ),
    "birkhoff": Method(("weighted Birkhoff average",), "n", STEPS, birkhoff),
    "circle": Method(
        ("last certified circle",), "points", [64, 256, 1024, 4096, 16_384], last_circle
    ),
    "continuation": Method(
        ("blow-up of circles",), "tol", [1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6], continuation
    ),
    "crossing": Method(("residue, last crossing",), "q", PERIODS, crossing),
    "residue": Method(("residue, Aitken",), "q", PERIODS, residue),
    "barriers": Method(
        ("barriers, bracket", "barriers, value"), "tol", [1e-1, 1e-2, 1e-3, 1e-4, 2e-5], barrier
    ),
}
FORMS = ("chain form", "the paper's Algorithm 1")
POINTS = [2**k for k in range(6, 15)]


def answers(names):
    """(name, answer) of all answers of some methods."""
    return [(name, answer) for name in names for answer in METHODS[name].answers]


def plan(angles, names, quick):
    """The cube, nothing measured yet."""
    import numpy as np
    import xarray as xr

    from pipeline.schema import Cube

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
        "naming_seconds": (every[:1], "CPU time to find which circle is the last one", "s"),
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


def judged(angle):
    """The Ray at that angle, and the seconds that it took to name its last circle."""
    from nasm import barriers, periodic

    profile = PROFILES[angle]
    named, seconds = timed(barriers.critical_scale, profile, 1e-2)
    judge = periodic.critical_scale(named.omega, profile, JUDGE)
    return Ray(profile, named.omega, judge.value, judge.error), seconds


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
    judged(0)
    for i, angle in enumerate(data.angle.values.tolist()):
        ray, data.naming_seconds[i] = judged(angle)
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
    names = only or tuple(METHODS)
    with driver(out):
        from dataclasses import replace

        from pipeline import store
        from workflows.figures import draw_work_precision, save

        cube = plan([int(a) for a in angle] or list(PROFILES), names, quick)
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
