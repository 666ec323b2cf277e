import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from nasm.arithmetic.roots import root

FUNCTIONS = {
    "smooth": lambda x, at: np.tanh(x - at),
    "steep": lambda x, at: np.sinh(20 * (x - at)),
    "flat": lambda x, at: (x - at) ** 9,
    "discontinuous": lambda x, at: 100.0 if x > at else -100.0,
    "kinked": lambda x, at: x - at if x > at else 1e-6 * (x - at),
}


@given(st.floats(-0.999, 0.999), st.sampled_from(sorted(FUNCTIONS)))
def test_finding_a_root_takes_about_as_many_steps_as_in_scipy(at, name):
    points = []

    def f(x):
        points.append(x)
        return FUNCTIONS[name](x, at)

    assert abs(root(f, -1, 1, 1e-9) - at) <= 2e-9 or abs(f(root(f, -1, 1, 1e-9))) < 1e-70
    points.clear()
    root(f, 1, -1, 1e-9)
    ours = len(points)
    points.clear()
    brentq(f, -1, 1, xtol=1e-9)
    assert ours <= max(1.5 * len(points), 60)


def test_after_max_steps_the_best_point_so_far_is_returned():
    points = []

    def f(x):
        points.append(x)
        return np.exp(x) - 2

    result = root(f, 0, 30, max_steps=3)
    assert len(points) == 5
    assert abs(f(result)) == min(abs(f(x)) for x in points[:5])


def test_root_refuses_an_interval_without_a_sign_change():
    for f in (lambda x: 1 + x**2, lambda x: np.nan):
        with pytest.raises(ValueError, match="must have different signs"):
            root(f, -1, 1)
    assert root(lambda x: x, 0, 1) == root(lambda x: x - 1, 0, 1) - 1 == 0
