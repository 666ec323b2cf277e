"""Compare speeds within one run: `python -m pytest -m benchmark -s`.

Other programs on the machine affect every timing. The functions to be compared are therefore timed
in turn, in CPU seconds, and the medians of their times are compared.
"""

import time
from functools import partial

import numpy as np
import oracles
import pytest
import toy

import nasm
from nasm import circles, diffusion, escape
from nasm.circles import fourier, parameterization
from nasm.converse_kam import symmetry_line
from nasm.numbers import parse
from pipeline import fill

pytestmark = pytest.mark.benchmark

KAPPA = (0.3, 0.3)  # no orbit escapes, so the kernels run at their steady speed


def median_times(*timed, repeats=9):
    """Return the median CPU seconds of each function; the functions are called in turn."""
    times = np.empty((repeats, len(timed)))
    for row in times:
        for i, function in enumerate(timed):
            start = time.process_time()
            function()
            row[i] = time.process_time() - start
    return np.median(times, axis=0)


def per_unit(unit, timed, counts):
    """Print and return the nanoseconds per unit of work for each function in {name: function}."""
    for function in timed.values():
        function()
    times = median_times(*timed.values()) * 1e9 / np.array(counts)
    for name, ns in zip(timed, times, strict=True):
        faster = f"{times[0] / ns:5.1f} times faster than plain Numba"
        print(f"\n{name:13} {ns:6.3f} ns per {unit}, {faster}", end="")
    return times


def test_escape_kernels_are_over_25_times_faster_than_plain_numba():
    n_orbits, n = 1024, 20_000
    x, y = escape.ensemble(n_orbits)
    few, short = slice(0, 64), 4000  # plain Numba is slow: time fewer orbits and steps
    line = np.linspace(0.2, 0.3, 256)  # all these starts survive such weak kicks
    kicks = escape.kick_series(np.array(KAPPA))
    timed = {
        "plain Numba": lambda: oracles.escape_time(KAPPA, x[few], y[few], short),
        "escape_time": lambda: escape.escape_time(KAPPA, x, y, n),
        "first_escape": lambda: escape.first_escape([KAPPA], x, y, [n_orbits], n),
        "diffusion": lambda: diffusion._iterate(kicks, x - 0.25, y.copy(), n),
        "converse KAM": lambda: symmetry_line.elimination_time((0.01, 0.01), line, n),
    }
    assert all(np.isinf(timed[name]()).all() for name in timed if name != "diffusion")
    counts = [64 * short, *[n_orbits * n] * 3, line.size * n]
    plain, lanes, ensemble, spread, converse_kam = per_unit("step", timed, counts)
    assert plain / lanes > 25
    assert plain / ensemble > 25
    assert spread < 1.1 * lanes
    assert converse_kam < 3 * lanes


def test_a_newton_step_for_a_circle_costs_n_log_n():
    omega, kappa, modes = parse("gamma"), (0.3, 0.3), 2 ** np.arange(8, 15)
    exact = circles.invariant_circle(omega, kappa).u
    starts = [fourier.resample(exact, n) for n in modes]
    chain = [partial(circles.newton_step, omega, kappa, u) for u in starts]
    frame = [partial(parameterization.newton_step, omega, kappa, u) for u in starts]
    for function in chain:
        function()
    times = median_times(*chain, *frame, repeats=15).reshape(2, -1) * 1e6
    print("\n    n  chain form  Algorithm 1, µs per step")
    for n, ours, paper in zip(modes, *times, strict=True):
        print(f"{n:6} {ours:10.0f} {paper:10.0f}")
    large = modes >= 1024
    for row in times:
        slope = np.polyfit(np.log(modes[large]), np.log(row[large]), 1)[0]
        print(f"grows like n^{slope:.2f}")
        assert slope < 1.3
    assert (times[0] < times[1]).all()


def test_fill_adds_less_than_a_millisecond_per_tile_to_the_sweep(here, tmp_path):
    """The sweep alone and `fill` both store results; each time includes the worker threads."""
    side, places = 20, (tmp_path / str(n) for n in range(100))

    def swept():
        assert toy.run(here, next(places), toy.cube(side, side, tile=1)).committed == side**2

    def filled():
        cube = fill(toy.job(side, side, 1), next(places), client=here(), progress=False)
        assert cube.wave.notnull().all()

    swept()
    sweep, more = median_times(swept, filled, repeats=3) * 1e3 / side**2
    print(f"\nCPU time per tile: sweep {sweep:.2f} ms, fill {more:.2f} ms", end="")
    assert more < sweep + 1


def test_an_answer_costs_as_much_as_a_known_number_of_kicks():
    # Measured on two days: at most 4.8, 14, 1.4 and 14 times as long as 10⁸ kicks.
    n_orbits, n = 1024, 50_000
    x, y = escape.ensemble(n_orbits)
    timed = {
        "10⁸ kicks": lambda: escape.escape_time(KAPPA, x, y, n),
        "ray, 1e-4": lambda: nasm.critical_scale((1.0, 0.58), 1e-4),
        "ray, 2e-5": lambda: nasm.critical_scale((1.0, 0.58), 2e-5),
        "verdict": lambda: nasm.verdict((0.5, 0.29)),
        "three kicks": lambda: nasm.critical_scale((0.3, 0.2, 0.25), 1e-3),
    }
    for function in timed.values():
        function()
    unit, *times = median_times(*timed.values(), repeats=5)
    costs = dict(zip([*timed][1:], np.array(times) / unit, strict=True))
    for name, cost in costs.items():
        print(f"\n{name:12} {cost:6.1f} times as long as 10⁸ kicks", end="")
    assert costs["ray, 1e-4"] < 5.7
    assert costs["ray, 2e-5"] < 21
    assert costs["verdict"] < 1.8
    assert costs["three kicks"] < 14
