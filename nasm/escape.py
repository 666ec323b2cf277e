"""Direct iteration: the time at which an ensemble first leaves a window in y.

    n* = min { n ≥ 0 : y_n < lo or y_n > hi },   (x_n, y_n) = Tⁿ(x_0, y_0)

An escape from y_0 in [0, 0.3] out of the window (-2, 2.3) shows global transport (Proposition 1 of
arXiv:1606.04824, Sec. V.B), as long as every invariant circle has an amplitude below 1. The
criterion is one-sided: n* = inf only means that nothing escaped up to n_max. The boundary of the
set {n* ≤ N} lies outside the boundary of global transport, at a distance that decreases only as
N^(-1/3.012).

n* of an ensemble is effectively random: different floating-point arithmetic yields a different
value of the same order of magnitude.

The kernel advances 64 orbits in lockstep (`nasm.arithmetic.lanes`), using the angle shifted by a
quarter turn,

    X = x - 1/4,   r = X - rint X,   u = |r| - 1/4:
    y' = y - κ u·p(u²),   X' = r + y',       since sin 2πx = -sin 2πu = -2πu·p(u²)

where p is the polynomial of `nasm.arithmetic.sine`; the kernel uses its coefficients multiplied by
-κ. Orbits are tested for escape once per block of steps, using the largest |y| in the block. If it
exceeds the distance from 0 to the nearer end of the window, the block is repeated step by step, so
escape times are exact. In single precision p has degree 4.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit, types
from numba.extending import overload
from numpy.typing import ArrayLike

from nasm.arithmetic.kernels import kernel
from nasm.arithmetic.lanes import LANES, fabs, fma, load, maximum, own_frame, rint, store
from nasm.arithmetic.sine import SINE, SINGLE_SINE
from nasm.checks import count, floats, has_mask, points, positive
from nasm.maps import direction, forcing
from nasm.results import CriticalScale, Status, no_answer
from nasm.types import FloatArray

__all__ = ["PAPER_WINDOW", "boundary", "critical_scale", "ensemble", "escape_time", "first_escape"]
__all__ += ["IterationSettings", "onset_scale"]

METHOD = "direct iteration"
PAPER_WINDOW = (-2.0, 2.3)
"""Window (lo, hi) of Sec. V.B: starts fill 0 ≤ y ≤ 0.3, and |y_n - y_0| > 2 shows transport."""

MAX_STEPS = 10**12
"""Maximum n_max: 64 orbits then take half a day; floats represent integers exactly up to 2⁵³."""

MAX_SINGLE_STEPS = 10**6
"""Maximum n_max in single precision: rounding errors of 3·10⁻⁸ per kick add up to 3·10⁻⁵ in y."""

_ETA = 3.012  # η of the bias, k_N - k_c ~ N^(-1/η)


@dataclass(frozen=True)
class IterationSettings:
    """How many steps orbits are iterated at a time; this does not affect escape times.

    Attributes
    ----------
    block_steps : int
        Steps between successive tests for escape. Small blocks spend more time on tests; large
        blocks take longer to repeat.
    max_chunk_steps : int
        Maximum number of steps before the surviving orbits are packed together again. In the search
        for the first escape, other orbits are iterated up to this many steps beyond it.

    Examples
    --------
    >>> from nasm.escape import IterationSettings, ensemble, escape_time
    >>> times = [
    ...     escape_time((2.0, 1.5), *ensemble(100), 1000, settings=IterationSettings(n))
    ...     for n in (16, 128)
    ... ]
    >>> (times[0] == times[1]).all()
    np.True_
    """

    block_steps: int = 128
    max_chunk_steps: int = 4096


DEFAULT_SETTINGS = IterationSettings()


def ensemble(n_orbits: int) -> tuple[FloatArray, FloatArray]:
    """Spread starts evenly over [0, 1] × [0, 0.3]; the first m of them are spread evenly too.

    The starts follow the additive sequence of the plastic number g (g³ = g + 1), frac(1/2 + i/g)
    and frac(1/2 + i/g²). Ensembles of all sizes are therefore nested, and identical on every
    machine.

    Parameters
    ----------
    n_orbits : int
        Number of starts, 1 to 10⁸.

    Returns
    -------
    x, y : ndarray, shape (n_orbits,)
        Starts, in turns.

    Examples
    --------
    >>> from nasm.escape import ensemble
    >>> x, y = ensemble(3)
    >>> x.round(3), y.round(3)
    (array([0.5  , 0.255, 0.01 ]), array([0.15 , 0.021, 0.192]))
    """
    n_orbits = count("n_orbits", n_orbits, 1, 10**8)
    plastic = 1.324717957244746
    i = np.arange(n_orbits)
    return (0.5 + i / plastic) % 1.0, 0.3 * ((0.5 + i / plastic**2) % 1.0)


def escape_time(
    kappa: ArrayLike,
    x: ArrayLike,
    y: ArrayLike,
    n_max: int,
    window: ArrayLike = PAPER_WINDOW,
    settings: IterationSettings = DEFAULT_SETTINGS,
) -> FloatArray:
    """Compute the first step n at which each orbit is outside the window.

    Parameters
    ----------
    kappa : array_like, shape (P,)
        The forcing, first kick first.
    x, y : array_like
        Starts, in turns. Their shapes broadcast.
    n_max : int
        Maximum number of steps (periods of the forcing, P kicks each), 1 to 10¹².
    window : (lo, hi)
        An orbit is inside while lo ≤ y ≤ hi.
    settings : IterationSettings
        Affects only the speed.

    Returns
    -------
    ndarray of float
        n*, of the broadcast shape: 0 for a start outside the window, inf if the orbit does not
        escape within n_max steps.

    Raises
    ------
    ValueError
        If an argument is empty, not finite, or out of range.

    Examples
    --------
    >>> from nasm.escape import escape_time
    >>> escape_time((12.0,), [0.0, 0.25, 0.25], [0.0, 0.0, 3.0], 1000)
    array([inf,  2.,  0.])
    """
    strengths, x, y, n_max, lo, hi, shift = _checked(kappa, x, y, n_max, window)
    times = np.empty(x.size)
    starts = x.ravel() - 0.25, y.ravel() - shift
    portions = settings.block_steps, settings.max_chunk_steps
    _escape_times(kick_series(strengths), *starts, n_max, lo, hi, False, *portions, times)
    return times.reshape(x.shape)


def first_escape(
    kappas: ArrayLike,
    x: ArrayLike,
    y: ArrayLike,
    sizes: ArrayLike,
    n_max: int,
    window: ArrayLike = PAPER_WINDOW,
    precision: str = "double",
    settings: IterationSettings = DEFAULT_SETTINGS,
) -> FloatArray:
    """Compute the first escape time of nested ensembles, for many forcings at once.

    Parameters
    ----------
    kappas : array_like, shape (..., P)
        Forcings of the same period.
    x, y : array_like, shape (M,)
        Starts, in turns; ensemble m consists of the first m of them.
    sizes : array_like of int, shape (S,)
        Sizes of the ensembles, increasing, from 1 to M.
    n_max, window
        As for `escape_time`.
    precision : {"double", "single"}
        Floating-point precision. "single" is 2.5 times faster and allowed up to 10⁶ steps.
    settings : IterationSettings
        Affects only the speed.

    Returns
    -------
    ndarray of float, shape (S, ...)
        min n* over each ensemble, exact for every size; inf if none of its orbits escapes.

    Raises
    ------
    ValueError
        As for `escape_time`, and if sizes are not increasing or precision is unknown.

    Examples
    --------
    >>> from nasm.escape import ensemble, first_escape
    >>> times = first_escape([(0.3, 0.5), (2.0, 1.5)], *ensemble(100), [10, 100], 1000)
    >>> times < float("inf")
    array([[False,  True],
           [False,  True]])
    """
    kappas = floats("kappas", kappas)
    if kappas.ndim < 1:
        raise ValueError(f"kappas={kappas!r} is a number; give an array of shape (..., P)")
    plane = kappas.shape[:-1]
    flat = forcing(kappas.ravel()).reshape(-1, kappas.shape[-1])
    _, x, y, n_max, lo, hi, shift = _checked(flat[0], x, y, n_max, window)
    if x.ndim != 1:
        raise ValueError(f"x and y have shape {x.shape}; nested ensembles need a vector of starts")
    sizes = floats("sizes", sizes) if has_mask(sizes) else np.asarray(sizes)
    ordered = sizes.ndim == 1 and sizes.size and sizes.dtype.kind in "iu"
    if not (ordered and sizes[0] >= 1 and sizes[-1] <= x.size and (sizes[1:] > sizes[:-1]).all()):
        raise ValueError(
            f"sizes={sizes.tolist()} must be increasing whole numbers from 1 to {x.size}, "
            "the number of starts"
        )
    if precision not in _PRECISIONS:
        raise ValueError(f"precision={precision!r} must be one of {', '.join(_PRECISIONS)}")
    if precision == "single" and n_max > MAX_SINGLE_STEPS:
        raise ValueError(
            f"n_max={n_max} is too large for precision='single', whose rounding carries orbits "
            f"across circles; use at most {MAX_SINGLE_STEPS}, or precision='double'"
        )
    sizes, (kind, series) = sizes.astype(np.int64), _PRECISIONS[precision]
    times = np.empty((len(flat), sizes.size))
    starts = (x - 0.25).astype(kind), (y - shift).astype(kind)
    kicks, portions = kick_series(flat, series), (settings.block_steps, settings.max_chunk_steps)
    _first_escapes(kicks.astype(kind), *starts, sizes, n_max, lo, hi, *portions, times)
    return times.T.reshape(sizes.size, *plane)


def onset_scale(
    profile: ArrayLike,
    n_max: int,
    n_orbits: int = 1000,
    window: ArrayLike = PAPER_WINDOW,
    precision: str = "double",
    max_scale: float | None = None,
) -> float:
    """Compute k_N, the scale on the ray κ = s·profile at which escapes within N steps begin.

    k_N is what the paper plots. It lies above the scale at which global transport begins, which
    `critical_scale` estimates. Bisection finds k_N, to a relative accuracy of 10⁻⁴, between 0 and
    `max_scale`: an orbit escapes at k_N, and none escapes one bisection step below it.

    Parameters
    ----------
    profile : array_like, shape (P,)
        Direction of the ray, first kick first.
    n_max : int
        N, 1 to 10¹² steps.
    n_orbits : int
        Size of the `ensemble`.
    window : (lo, hi)
        Window in y; it must contain all starts.
    precision : {"double", "single"}
        As for `first_escape`.
    max_scale : float, optional
        Largest scale of interest, above 0; by default the scale at which the largest |κ| is 2.

    Returns
    -------
    float
        k_N; NaN if nothing escapes even at `max_scale`.

    Raises
    ------
    ValueError
        If profile is zero or tiny, or an argument is out of range.

    Notes
    -----
    Scales with and without an escape interleave around k_N, in an interval that widens as the
    numbers of steps and orbits decrease (to about 20% of k_N for 20 orbits, 50 steps); k_N is one
    point of this interval.

    Examples
    --------
    >>> from nasm.escape import onset_scale
    >>> 1.1 < onset_scale((1, 1), 1000, n_orbits=64) < 1.5
    True
    """
    n_max = count("n_max", n_max, 1, MAX_STEPS)
    if max_scale is not None:
        max_scale = positive("max_scale", max_scale, "the largest scale of interest")
    return _onset_scales(profile, [n_max], n_orbits, window, precision, max_scale)[0]


def critical_scale(
    profile: ArrayLike,
    n_max: int,
    n_orbits: int = 1000,
    window: ArrayLike = PAPER_WINDOW,
    precision: str = "double",
) -> CriticalScale:
    """Estimate the scale at which global transport begins on the ray κ = s·profile.

    1. Compute k_N, the `onset_scale` for N = n_max steps.
    2. Compute k_{N/8}, and extrapolate by the law k_N - k_c ~ N^(-1/η), η = 3.012 = ln(αβ)/ln δ
       from the scaling constants of MacKay (Physica D 7 (1983) 283).
    3. Compute k_{N/64}, and compare the bias with the one that the law predicts from k_{N/64} and
       k_{N/8}.

    Parameters
    ----------
    profile, n_orbits, window, precision
        As for `onset_scale`.
    n_max : int
        64 to 10¹² steps.

    Returns
    -------
    CriticalScale
        upper: k_N, at which an escape was observed. value: the extrapolated scale. error: the bias,
        upper - value, plus its difference from the predicted bias. lower is NaN, because the
        absence of escapes shows nothing. omega is None. The value is NaN with status NOT_CONVERGED
        if the error would exceed the value, because the law does not hold yet (use more steps or
        orbits). It is NaN with status NO_BREAKUP if nothing escapes even at the scale at which the
        largest |κ| is 2.

    Raises
    ------
    ValueError
        If profile is zero or tiny, or an argument is out of range.

    Examples
    --------
    >>> from nasm.escape import critical_scale
    >>> scale = critical_scale((1, 0), 1024, n_orbits=256)
    >>> scale.value < scale.upper, scale.status
    (True, Status.OK)
    """
    n_max = count("n_max", n_max, 64, MAX_STEPS)
    steps = n_max, n_max // 8, n_max // 64
    upper, before, earlier = _onset_scales(profile, steps, n_orbits, window, precision)
    if np.isnan(upper):
        return no_answer(None, Status.NO_BREAKUP, METHOD)
    ratio = 8 ** (1 / _ETA)
    bias, predicted = (before - upper) / (ratio - 1), (earlier - before) / (ratio - 1) / ratio
    value, error, status = upper - bias, bias + abs(bias - predicted), Status.OK
    if not error < value:  # the error is NaN if nothing escapes in N/64 steps
        value, error, status = np.nan, np.nan, Status.NOT_CONVERGED
    return CriticalScale(value, error, np.nan, upper, None, status, METHOD)


def _onset_scales(
    profile: ArrayLike,
    steps: Sequence[int],
    n_orbits: int,
    window: ArrayLike,
    precision: str,
    max_scale: float | None = None,
) -> list[float]:
    """Compute k_N for each N in `steps`, a decreasing sequence; NaN where nothing escapes."""
    profile = direction(profile)
    max_scale = max_scale or 2 / np.abs(profile).max()
    x, y = ensemble(n_orbits)
    *_, lo, hi, shift = _checked(profile, x, y, 1, window)
    if not ((lo <= y - shift) & (y - shift <= hi)).all():
        raise ValueError(
            f"window={window!r} leaves out some starts of the ensemble, which would escape without "
            "a kick; it must contain y from 0 to 0.3"
        )

    def escapes(scale: float, n: int) -> bool:
        return first_escape(scale * profile, x, y, [x.size], n, window, precision)[0] < np.inf

    inside, scales = 0.0, []
    for n in steps:  # an orbit that does not escape in N steps does not escape in fewer
        outside = max_scale if escapes(max_scale, n) else np.nan
        while outside - inside > 1e-4 * outside:
            middle = (inside + outside) / 2
            inside, outside = (inside, middle) if escapes(middle, n) else (middle, outside)
        scales.append(float(outside))
    return scales


def boundary(
    escape_time: ArrayLike, kappa1: ArrayLike, kappa2: ArrayLike, angles: ArrayLike, n: int
) -> FloatArray:
    """Find where rays from the origin enter {n* ≤ n}, given n* on a grid in the (κ1, κ2) plane.

    Parameters
    ----------
    escape_time : array_like, shape (kappa2.size, kappa1.size)
        First escape times; NaN or masked where unknown.
    kappa1, kappa2 : array_like, one-dimensional
        Equally spaced cell centres, increasing, at least two each.
    angles : array_like
        Directions of the rays, in degrees.
    n : int
        Number of steps, 1 to 10¹².

    Returns
    -------
    ndarray, shape of angles
        Distance from the origin at which the ray first passes from a cell without transport into
        a cell with transport, to within one cell. NaN if the ray meets no such pair of cells in the
        plane, or if the first cell with transport directly follows an unknown cell.

    Raises
    ------
    ValueError
        If an argument is not numeric or has the wrong shape, or centres are not equally spaced.

    Examples
    --------
    >>> from nasm.escape import boundary
    >>> times = [[float("inf"), float("inf"), 7.0]]
    >>> boundary([*times, *times], [0.5, 1.5, 2.5], [-0.5, 0.5], [0.0], 10).round(1)
    array([1.9])
    """
    if np.ma.isMaskedArray(escape_time):
        escape_time = np.where(np.ma.getmaskarray(escape_time), np.nan, escape_time.data)
    escape_time = floats("escape_time", escape_time)
    centres = _centres("kappa1", kappa1), _centres("kappa2", kappa2)
    cells = centres[1].size, centres[0].size
    if escape_time.shape != cells:
        raise ValueError(
            f"escape_time has shape {escape_time.shape}; with these kappa2 and kappa1 it must be "
            f"{cells}"
        )
    n = count("n", n, 1, MAX_STEPS)
    first, width = np.array([(c[0], c[1] - c[0]) for c in centres]).T[:, :, None]
    ends = np.array(escape_time.shape[::-1])[:, None]
    reach = np.hypot(*(np.abs(c).max() + c[1] - c[0] for c in centres))
    angles = floats("angles", angles)
    scale = np.full(angles.shape, np.nan)
    for i, radians in np.ndenumerate(np.deg2rad(angles)):
        direction = np.array([[np.cos(radians)], [np.sin(radians)]])
        # With eight samples per cell, the ray misses at most the corner of a cell.
        along = np.arange(0, reach, 1 / (8 * np.abs(direction / width).max()))
        cells = (along * direction - first) / width + 0.5
        # Keep samples that rounding errors move just beyond the edges.
        inside = ((cells > -1e-9) & (cells < ends + 1e-9)).all(axis=0)
        column, row = np.clip(cells[:, inside].astype(int), 0, ends - 1)
        along, times = along[inside], escape_time[row, column]
        first_in = (times <= n).argmax() if times.size else 0
        if first_in > 0 and times[first_in - 1] > n:
            scale[i] = along[first_in - 1 : first_in + 1].mean()
    return scale


def _centres(name: str, values: ArrayLike) -> FloatArray:
    """Check that cell centres are equally spaced and increasing, and return them as floats."""
    centres = floats(name, values)
    if centres.ndim != 1 or centres.size < 2:
        raise ValueError(
            f"{name}={values!r} must be the centres of at least two cells, to define their width"
        )
    steps = np.diff(centres)
    if not (steps > 0).all() or np.ptp(steps) > 1e-6 * steps[0]:
        raise ValueError(f"{name}={values!r} must be cell centres that increase in equal steps")
    return centres


def _checked(
    kappa: ArrayLike, x: ArrayLike, y: ArrayLike, n_max: int, window: ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray, int, float, float, float]:
    """Check the arguments, and move the window by an integer `shift` to centre it near y = 0.

    Return strengths, x, y, n_max, lo, hi, shift.
    """
    strengths = forcing(kappa)
    x, y = points(x, y)
    if x.size == 0:
        raise ValueError("x and y are empty; an ensemble needs at least one start")
    n_max = count("n_max", n_max, 1, MAX_STEPS)
    ends = floats("window", window)
    if ends.shape != (2,) or not np.isfinite(ends).all() or not ends[0] < ends[1]:
        raise ValueError(f"window={window!r} must be two finite numbers, lower end first")
    shift = float(np.rint(ends.mean()))
    lo, hi = (ends - shift).tolist()
    return strengths, x, y, n_max, lo, hi, shift


_PRECISIONS = {"double": (np.float64, SINE), "single": (np.float32, SINGLE_SINE)}


def kick_series(kappas: FloatArray, series: Sequence[float] | FloatArray = SINE) -> FloatArray:
    """Compute the coefficients of y' = y + u·Σ c_k u²ᵏ for forcings of shape (..., P).

    Each kick has the coefficients of the sine times -κ, followed by 1/4; the shape of the result is
    (..., P, len(series) + 1).
    """
    quarter = np.full((*kappas.shape, 1), 0.25)
    return np.concatenate([-kappas[..., None] * np.array(series), quarter], axis=-1)


def polynomial(c: FloatArray, p: int, v: FloatArray) -> FloatArray:
    """Evaluate Σ c_k vᵏ for kick p; the precision of c determines the number of terms."""
    raise NotImplementedError("polynomial is compiled inside kernels only")


@overload(polynomial, jit_options={"forceinline": True})
def _polynomial_of(c, p, v):
    terms = len(SINE if c.dtype == types.float64 else SINGLE_SINE)

    def of_terms(c, p, v):
        s = fma(v, c[p, terms - 1], c[p, terms - 2])
        for k in range(terms - 3, -1, -1):
            s = fma(s, v, c[p, k])
        return s

    return of_terms


@njit(forceinline=True)
def kick_on_lanes(c, p, x, y):
    """Apply kick p to lanes or floats; x is the shifted angle X."""
    r = x - rint(x)
    u = fabs(r) - c[p, c.shape[1] - 1]
    y = fma(polynomial(c, p, u * u), u, y)
    return r + y, y


@njit(nogil=True)
def advance(c, x, y, start, n, reach):
    """Advance 64 orbits from index `start` by n steps, in place.

    Set `reach` to the largest |y| of each orbit.
    """
    own_frame()
    xs = load(x, start)
    ys = load(y, start)
    furthest = fabs(ys)
    if c.shape[0] == 2:
        # This is the paper's map, unrolled, which is 1.3 times faster than the loop.
        for _ in range(n):
            xs, ys = kick_on_lanes(c, 0, xs, ys)
            xs, ys = kick_on_lanes(c, 1, xs, ys)
            furthest = maximum(furthest, fabs(ys))
    else:
        for _ in range(n):
            for p in range(c.shape[0]):
                xs, ys = kick_on_lanes(c, p, xs, ys)
            furthest = maximum(furthest, fabs(ys))
    store(x, start, xs)
    store(y, start, ys)
    store(reach, 0, furthest)


@njit(nogil=True)
def _replay(c, x, y, n, lo, hi):
    """Return the first of the steps 0, …, n at which an orbit is outside the window, else n + 1."""
    for t in range(n + 1):
        if y < lo or y > hi:
            return t
        for p in range(c.shape[0]):
            x, y = kick_on_lanes(c, p, x, y)
    return n + 1


@njit(nogil=True)
def _park(x, y, lane):
    """Park a lane at (x, y) = (0, 0), a fixed point for every forcing.

    A parked lane is never replayed, even if the window excludes this point.
    """
    x[lane], y[lane] = -0.25, 0.0


@kernel
def _escape_times(c, x0, y0, n_max, lo, hi, only_first, block_steps, max_chunk_steps, times):
    """Write n* of every orbit to `times`; inf if it exceeds n_max.

    With `only_first`, the entries of orbits that escape later than the first may remain inf.
    Survivors are packed together after each chunk of steps.
    """
    # Copy and fill element by element: Numba takes seconds to compile slices.
    orbit, size = np.empty(x0.size, np.int64), (x0.size + LANES - 1) // LANES * LANES
    x, y, last = np.empty(size, x0.dtype), np.empty(size, x0.dtype), n_max
    for i in range(size):
        _park(x, y, i)
    for i in range(x0.size):
        orbit[i], x[i], y[i] = i, x0[i], y0[i]
        times[i] = np.inf
        if y0[i] < lo or y0[i] > hi:
            times[i] = 0
            last = 0 if only_first else n_max
    x_before, y_before = np.empty(LANES, x.dtype), np.empty(LANES, x.dtype)
    reach = np.empty(LANES, x.dtype)
    limit = min(-lo, hi)
    alive = x0.size
    n = 0
    while n < last and alive > 0:
        # A chunk is a quarter of the steps so far, but at least one block.
        chunk = min(max(n // 4, block_steps), max_chunk_steps, last - n)
        for start in range(0, alive, LANES):
            done = 0
            while done < chunk and n + done <= last:
                block = min(block_steps, chunk - done)
                for lane in range(LANES):
                    x_before[lane], y_before[lane] = x[start + lane], y[start + lane]
                advance(c, x, y, start, block, reach)
                for lane in range(min(LANES, alive - start)):
                    i = start + lane
                    if reach[lane] > limit and np.isinf(times[orbit[i]]):
                        t = _replay(c, x_before[lane], y_before[lane], block, lo, hi)
                        if t <= block:
                            times[orbit[i]] = n + done + t
                            last = min(last, n + done + t - 1) if only_first else last
                            _park(x, y, i)
                done += block
        n += chunk
        survivors = 0
        for i in range(alive):
            if np.isinf(times[orbit[i]]):
                orbit[survivors], x[survivors], y[survivors] = orbit[i], x[i], y[i]
                survivors += 1
        for i in range(survivors, alive):
            _park(x, y, i)
        alive = survivors


@kernel
def _first_escapes(c, x, y, sizes, n_max, lo, hi, block_steps, max_chunk_steps, escapes):
    """Write first escape times to `escapes`: a row for each forcing, a column for each ensemble."""
    times = np.empty(x.size)
    for i in range(c.shape[0]):
        first, start = np.inf, 0
        for j in range(sizes.size):
            if first > 0:  # the added orbits matter only if one escapes before all others
                added, most = slice(start, sizes[j]), int(min(n_max, first - 1))
                _escape_times(
                    c[i],
                    x[added],
                    y[added],
                    most,
                    lo,
                    hi,
                    True,
                    block_steps,
                    max_chunk_steps,
                    times[added],
                )
                for k in range(start, sizes[j]):
                    first = min(first, times[k])
            start = sizes[j]
            escapes[i, j] = first
