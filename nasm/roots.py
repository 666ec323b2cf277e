"""The root of a function in a bracket, f(a)·f(b) ≤ 0, by Chandrupatla's method.

Inverse quadratic interpolation through the last three points where it is safe, bisection where it
is not: where f is monotone between them and not too bent (Chandrupatla, Adv. Eng. Softw. 28 (1997)
145). It takes about as many steps as Brent's method. SciPy has that, but a quarter of a second of
imports comes with it, as long as a whole breakup takes.
"""


def root(f, a, b, tolerance):
    """x between a and b with f(x) = 0 to within `tolerance`; ValueError if f does not change sign.

    f may raise; what it raises is passed on.
    """
    fa, fb = f(a), f(b)
    if not (fa <= 0 <= fb or fb <= 0 <= fa):
        raise ValueError(f"f does not change sign: it is {fa} at {a} and {fb} at {b}")
    share = 0.5
    while fa != 0 and fb != 0:
        nearest = tolerance / abs(b - a)
        if nearest > 0.5:
            break
        x = a + min(max(share, nearest), 1 - nearest) * (b - a)
        fx = f(x)
        if (fx > 0) == (fa > 0):
            c, fc = a, fa
        else:
            c, fc, b, fb = b, fb, a, fa
        a, fa = x, fx
        place, height = (a - b) / (c - b), (fa - fb) / (fc - fb)
        share = 0.5
        if height**2 < place and (1 - height) ** 2 < 1 - place:
            share = fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (
                fc - fb
            )
    return a if abs(fa) <= abs(fb) else b
