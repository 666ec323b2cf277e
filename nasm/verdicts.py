"""Is transport global under one forcing, or is a barrier left?

The boundary on the ray through the forcing tells only where to look and how hard. The answer comes
from the forcing itself: a circle that is certified there, or no start that survives converse KAM.
"""

from dataclasses import dataclass, field, replace
from enum import Enum
from math import inf, nan

import numpy as np

from nasm import barriers, circles
from nasm.barriers import critical_scale, per_period
from nasm.circles import continuation
from nasm.critical import CriticalScale, Result, Status, no_answer
from nasm.maps import MIN_SIZE, forcing
from nasm.numbers import rational
from nasm.symmetries import lengthen, shorten

__all__ = ["Answer", "Evidence", "Verdict", "verdict"]

_COARSE, _CLEAR = 1e-2, 0.05  # tolerance of a first look, with three kicks, and where it is enough
_TOLERANCES = (1e-3, 1e-4, 2e-5)  # of the boundary, until its error tells a point from it
_FAR = 1.1  # times a point: a circle so far out that the point is no matter of tolerances
_STEPS = 1000  # of converse KAM that every point is asked to survive
_MOST_STEPS = 400_000  # of converse KAM at a point, a second or two: to 4e-6 above the boundary
_MOST_POINTS = 2**15  # of a circle that is further than the first tolerance from its breakup
_BUDGET = 20.0  # CPU seconds of a proof
_NEAREST = 1.5e-5  # below the boundary: nearer, certificates fail, and take 5 s to do so


class Answer(Enum):
    """Is transport in y global?"""

    BARRIER = "barrier"
    TRANSPORT = "transport"
    UNDECIDED = "undecided"

    __repr__ = Enum.__str__


class Evidence(Enum):
    """What an Answer rests on."""

    INTEGRABLE = "without kicks, every y is a circle"
    CIRCLE = (
        "the circle was computed at exactly this forcing by Newton's method and certified on a "
        "finer grid; this is not a computer-assisted proof"
    )
    CIRCLE_BEYOND = (
        "the circle is certified further out on the ray from κ = 0, not at this forcing; that it "
        "exists all the way is an assumption"
    )
    CONES = (
        "converse KAM excludes a circle through every sampled initial condition at exactly this "
        "forcing: strong evidence, not a proof"
    )
    CIRCLE_PROVED = (
        "proved for exactly this forcing: an invariant circle exists, by the a-posteriori KAM "
        "theorem of nasm/proofs/README.md (A barrier exists), in ball arithmetic"
    )
    TRANSPORT_PROVED = (
        "proved for exactly this forcing: no invariant circle exists, by the converse KAM theorem "
        "of nasm/proofs/README.md (Transport is global), checked with rigorous rounding"
    )
    NONE = "no circle is certified at this forcing, and not all starts are eliminated"

    __repr__ = Enum.__str__


@dataclass(frozen=True, eq=False)
class Verdict(Result):
    """Whether a rotational invariant circle is left under the forcing kappa.

    answer, evidence : what is known, and from what. UNDECIDED makes no statement about either.
    boundary : CriticalScale of the last barrier on the ray s·kappa, s = 1 being the forcing itself.
        Its omega is the circle's, if there is one; else that of the last circle that broke.
    circle : x, y of it at the start of a period, ndarrays, x on the lift, y up to an integer; None
        unless evidence is CIRCLE or CIRCLE_PROVED.
    steps : float, within which converse KAM eliminated all starts; inf if it did not.
    proof : BarrierProof or TransportProof that was tried, proved or not; None if none was.
    proved_below : float; a barrier is proved to exist under s·kappa for 0 ≤ s ≤ this. NaN where
        that was not tried.
    """

    answer: Answer
    evidence: Evidence
    boundary: CriticalScale
    circle: tuple[np.ndarray, np.ndarray] | None = field(default=None, repr=False)
    steps: float = inf
    proof: object = None
    proved_below: float = nan


def verdict(kappa, prove=False):
    """Does a barrier exist under the forcing kappa, or is transport global?

    1. The boundary on the ray through kappa, the finer the nearer it turns out to be; with three
       kicks or more at 1% first.
    2. Below it, the circle under kappa itself, certified, while converse KAM leaves a survivor.
    3. Above it, converse KAM under kappa itself, with as many steps as the distance asks for.
    4. If asked to, prove the circle, and up to which multiple of kappa there is one; or where there
       is none that transport is global. Each takes up to some 20 seconds.

    kappa : sequence of P floats; P at most 64, or kappa repeats after one or two kicks.
    prove : bool; evidence is CIRCLE_PROVED or TRANSPORT_PROVED where a proof succeeds.

    Returns Verdict. UNDECIDED closer to the boundary than some 1.5·10⁻⁵ below and 4·10⁻⁶ above, in
    parts of kappa, or where the methods fail or contradict each other; its boundary then holds the
    bracket.

    ValueError if kappa is not finite or too large. ImportError if a circle is to be proved and
    python-flint is not installed.
    """
    kappa = forcing(kappa)
    size = float(np.abs(kappa).max())
    if size == 0:
        return Verdict(Answer.BARRIER, Evidence.INTEGRABLE, no_answer(None, Status.NO_BREAKUP))
    (short,), zero = shorten([kappa], rational(0))
    answer, evidence = Answer.UNDECIDED, Evidence.NONE
    found, circle, steps, proof = None, None, inf, None
    for tol in [_COARSE] * (short.size > 2) + [*_TOLERANCES]:
        unit = critical_scale(short / size, tol)
        lengths = {n: getattr(unit, n) / size for n in ("value", "error", "lower", "upper")}
        boundary = replace(unit, **lengths)
        if tol == _COARSE and not abs(boundary.value - 1) > _CLEAR:
            continue
        if abs(boundary.value - 1) <= boundary.error and tol > _TOLERANCES[-1]:
            continue  # look closer before deciding
        end = boundary.value if np.isfinite(boundary.value) else boundary.upper
        if end < 1:
            n_max = min(max(1.6 / (1 / end - 1), _STEPS), _MOST_STEPS)
            steps = barriers.longest_lived(short, int(n_max)).kicks / kappa.size
            if steps < inf:
                answer, evidence = Answer.TRANSPORT, Evidence.CONES
                boundary = replace(boundary, upper=min(boundary.upper, 1.0))
                break
        elif end > 1:
            found = _circle_under(short, boundary)
            if found is not None:
                answer, evidence = Answer.BARRIER, Evidence.CIRCLE
                boundary = replace(boundary, omega=found.omega, lower=np.fmax(boundary.lower, 1.0))
                circle = lengthen(kappa, *circles.graph(found))
                break
        too_near = boundary.error < end - 1 < _NEAREST
        if too_near or (boundary.lower > _FAR and np.isnan(boundary.value)):
            break  # a closer look tells no more
    if (
        answer is Answer.UNDECIDED
        and boundary.lower >= 1
        and not barriers.eliminates(short, _STEPS)
    ):
        answer, evidence = Answer.BARRIER, Evidence.CIRCLE_BEYOND
    if boundary.upper == inf:  # kicks so weak that floats do not reach from them to the boundary
        boundary = no_answer(boundary.omega, Status.NO_BREAKUP)
    if boundary.omega is not None:
        boundary = replace(boundary, omega=per_period(boundary.omega, kappa, short, zero))
    below = nan
    if prove:
        answer, evidence, proof = _proved(kappa, short, found, answer, evidence)
        proved = evidence is Evidence.CIRCLE_PROVED
        if proved and boundary.value > 1 and size >= MIN_SIZE:  # as a profile must be
            from nasm.proofs.fan import proved_below

            below, _ = proved_below(found.omega, short, boundary.value, _BUDGET)
    return Verdict(answer, evidence, boundary, circle, steps, proof, below)


def _proved(kappa, short, found, answer, evidence):
    """The answer and its evidence, after a proof was tried where there is something to prove."""
    from nasm.proofs import barrier, transport  # 0.2 s to import, and mostly not needed

    if found is not None:
        proof = barrier.prove(found.omega, short, start=found.u, budget=_BUDGET)
        return answer, Evidence.CIRCLE_PROVED if proof.proved else evidence, proof
    if answer is Answer.BARRIER:
        return answer, evidence, None
    proof = transport.prove(kappa, _BUDGET)
    if proof.proved:
        return Answer.TRANSPORT, Evidence.TRANSPORT_PROVED, proof
    return answer, evidence, proof


def _circle_under(kappa, boundary):
    """A certified circle under kappa; None if there is none, or if converse KAM contradicts it."""
    if barriers.eliminates(kappa, _STEPS):
        return None
    omega, distance = boundary.omega, 1 - 1 / boundary.value
    if _NEAREST <= distance < _TOLERANCES[0]:
        scale, u = continuation.certified_circle(omega, kappa, boundary.value, distance)
        if u is None or not scale > 1 - 1e-12:  # not certified here, only further in
            return None
        error = np.abs(circles.residual(omega, kappa, u)).max()
        return circles.InvariantCircle(omega, kappa, u, error, Status.OK)
    omegas = [omega]
    if omega is None:  # as next to a cusp, where residues give no value
        beyond = boundary.upper * kappa
        omegas = barriers.candidates(beyond, barriers.longest_lived(beyond, 2 * _STEPS))
    found = (circles.invariant_circle(omega, kappa, _MOST_POINTS) for omega in omegas)
    return next((circle for circle in found if circle.certified), None)
