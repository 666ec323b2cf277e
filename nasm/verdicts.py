"""Is transport global under one forcing, or does a barrier exist?

The boundary on the ray through the forcing only determines where to search, and how hard. The
answer comes from the forcing itself: either a circle is certified under it, or converse KAM
eliminates all starts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from math import inf, isfinite, nan
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from nasm import circles, escape, survivors
from nasm.arithmetic.lanes import LANES
from nasm.barriers import DEFAULT_EFFORT, Effort, critical_scale
from nasm.circles import hull
from nasm.circles.newton import MAX_POINTS
from nasm.converse_kam import aperiodic
from nasm.maps import MAX_PERIOD, MIN_SIZE, forcing
from nasm.numbers import rational
from nasm.results import CriticalScale, Result, Status, no_answer
from nasm.symmetries import lengthen, per_period, shorten
from nasm.tables import html_table, omega_text
from nasm.texts import rounded_bracket, rounded_value
from nasm.types import FloatArray

if TYPE_CHECKING:  # these modules take 0.2 s to import, and are rarely needed
    from nasm.proofs.barrier import BarrierProof
    from nasm.proofs.transport import TransportProof

__all__ = ["Answer", "Evidence", "Verdict", "VerdictSettings", "verdict"]


_NINE_DIGITS = replace(DEFAULT_EFFORT, last_period=DEFAULT_EFFORT.orbit_period)


@dataclass(frozen=True)
class VerdictSettings:
    """Settings that determine the effort of `verdict`.

    Attributes
    ----------
    tol : float
        Tolerance of the search for the boundary. The value comes from residues, and is usually much
        more precise. Circles closer to their breakup than this are computed from long orbits.
    min_distance : float
        Distance below the boundary within which no circle is sought. At 10⁻⁵, 24 of 30 circles were
        certified, in 0.6 s each (median).
    effort : Effort
        Settings of both searches. Its orbits yield nine digits, and take half the time of those
        that yield eleven.
    max_steps : int
        Limit on the number of steps of converse KAM. Under one or two kicks, this many take a
        second or two; they suffice if the forcing is at least 4·10⁻⁶ above the boundary.
    proof_seconds : float
        CPU seconds for a proof.
    n_kicks : int
        Number of kicks per orbit in the direct iteration under forcings with long periods; it takes
        a few CPU seconds.

    Examples
    --------
    >>> from nasm.verdicts import VerdictSettings, verdict
    >>> verdict((0.3, 0.4), settings=VerdictSettings(tol=1e-3)).answer
    Answer.BARRIER
    """

    tol: float = 0.01
    min_distance: float = 1.5e-5
    effort: Effort = _NINE_DIGITS
    max_steps: int = 400_000
    proof_seconds: float = 20.0
    n_kicks: int = 4 * 10**7

    @property
    def second_tol(self) -> float:
        """Tolerance of a second search, in which a circle is certified at `min_distance`."""
        return min(self.min_distance / (1 - self.effort.share_above), self.tol)


DEFAULT_SETTINGS = VerdictSettings()


class Answer(Enum):
    """Answer to the question of whether transport in y is global."""

    BARRIER = "barrier"
    TRANSPORT = "transport"
    UNDECIDED = "undecided"

    __repr__ = Enum.__str__


class Evidence(Enum):
    """The kinds of evidence for an Answer."""

    INTEGRABLE = "without kicks, every line of constant y is an invariant circle"
    CIRCLE = (
        "the circle was computed at exactly this forcing by Newton's method and certified on a "
        "finer grid; this is not a computer-assisted proof"
    )
    CIRCLE_BEYOND = (
        "the circle is certified further out on the ray from κ = 0, not at this forcing; its "
        "existence here, closer to κ = 0, is an assumption"
    )
    CONVERSE_KAM = (
        "at exactly this forcing, converse KAM shows that no circle passes through any sampled "
        "initial condition: strong evidence, not a proof"
    )
    CIRCLE_PROVED = (
        "proved for exactly this forcing: an invariant circle exists, by the a-posteriori KAM "
        "theorem of nasm/proofs/README.md (A barrier exists), in ball arithmetic"
    )
    TRANSPORT_PROVED = (
        "proved for exactly this forcing: no invariant circle exists, by the converse KAM theorem "
        "of nasm/proofs/README.md (Transport is global), checked with rigorous rounding"
    )
    ESCAPE = (
        "in direct iteration under exactly this forcing, an orbit crosses the whole cell; apart "
        "from rounding errors, this shows that no invariant circle stops it"
    )
    NONE = "no circle is certified at this forcing, and not all starts are eliminated"

    __repr__ = Enum.__str__


@dataclass(frozen=True, eq=False, repr=False)
class Verdict(Result):
    """Verdict on whether a rotational invariant circle exists under a forcing.

    Attributes
    ----------
    kappa : ndarray, shape (P,)
        The forcing, first kick first.
    answer : Answer
        Whether a barrier exists or transport is global. UNDECIDED makes no claim either way.
    evidence : Evidence
        The kind of evidence for the answer.
    boundary : CriticalScale
        Breakup of the last barrier on the ray s·kappa, s = 1 being the forcing itself. Its omega is
        the rotation number of the circle, if one is found, and otherwise of the last circle to
        break.
    circle : tuple of two ndarrays, shape (n,), or None
        x and y of the circle at the start of a period, x on the lift, y up to an integer. None
        unless evidence is CIRCLE or CIRCLE_PROVED.
    steps : float
        Steps (periods of the forcing) within which converse KAM eliminated all starts; inf if
        some starts survived.
    proof : BarrierProof, TransportProof or None
        The proof that was attempted, whether or not it succeeded.
    proved_below : float
        A barrier is proved to exist under s·kappa for 0 ≤ s ≤ proved_below. 0 if no
        proof succeeded in the time allowed, NaN if none was attempted.

    Notes
    -----
    Verdicts compare by value, with NaN equal to NaN. They contain arrays and cannot be hashed.
    """

    kappa: FloatArray
    answer: Answer
    evidence: Evidence
    boundary: CriticalScale
    circle: tuple[FloatArray, FloatArray] | None = None
    steps: float = inf
    proof: BarrierProof | TransportProof | None = None
    proved_below: float = nan

    def __repr__(self) -> str:
        text = f"<Verdict: {self.answer.name}, evidence {self.evidence.name}"
        if self.boundary.omega is None:
            return f"{text}>"
        return f"{text}; circle {self.boundary.omega} breaks at {self._breakup()}>"

    def _repr_html_(self) -> str:
        """Return the table that a notebook shows."""
        boundary, omega = self.boundary, self.boundary.omega
        lower, upper = rounded_bracket(boundary.lower, boundary.upper)
        name = "circle" if self.answer is Answer.BARRIER else "last circle to break"
        rows = {
            "evidence": self.evidence.value,
            "forcing": np.array2string(self.kappa, separator=", ", threshold=8),
            name: "" if omega is None else omega_text(omega, self.kappa.size),
            "its breakup": self._breakup(),
            "method": boundary.method,
            "a circle is found at": f"{lower} times the forcing" * bool(lower),
            "no circle is found at": f"{upper} times the forcing" * bool(upper),
            "status": "OK" if boundary.status is Status.OK else boundary.status.value,
        }
        if self.evidence is Evidence.INTEGRABLE:
            rows = {"evidence": self.evidence.value, "forcing": rows["forcing"]}
        if self.steps < inf:
            rows["all starts eliminated"] = f"after {round(self.steps * self.kappa.size)} kicks"
        if self.proof is not None:
            rows["proof"] = self.proof.reason
        if isfinite(self.proved_below):
            below = f"{self.proved_below:.10g} times the forcing"
            nothing = "no scale, in the time allowed"
            rows["barrier proved up to"] = below if self.proved_below else nothing
        return html_table(rows, f"Verdict: {self.answer.name}")

    def _breakup(self) -> str:
        value, error = self.boundary.value, self.boundary.error
        return f"{rounded_value(value, error)} times the forcing" if isfinite(value) else "unknown"


def verdict(
    kappa: ArrayLike, prove: bool = False, settings: VerdictSettings = DEFAULT_SETTINGS
) -> Verdict:
    """Decide whether a barrier exists under a forcing, or transport is global.

    1. Find the boundary on the ray through kappa.
    2. If kappa is below the boundary, certify the circle under kappa itself, unless converse KAM
       eliminates all starts.
    3. If kappa is above the boundary, apply converse KAM under kappa itself, with as many steps as
       the distance requires.
    4. If that fails, and kappa is within the bracket of the boundary, repeat steps 1 to 3 once with
       a much narrower bracket.
    5. With `prove`, try to prove that the circle exists under kappa, and under all multiples of
       kappa up to some scale; or that transport is global. Each proof takes up to 20 CPU seconds.

    Parameters
    ----------
    kappa : array_like, shape (P,)
        Strengths of the kicks, first kick first. Beyond 64 kicks no circle is sought: the answer is
        either UNDECIDED, or TRANSPORT by converse KAM or by an orbit that escapes.
    prove : bool
        Whether to attempt proofs. If one succeeds, evidence is CIRCLE_PROVED or TRANSPORT_PROVED.
    settings : VerdictSettings
        Settings that determine the effort.

    Returns
    -------
    Verdict
        UNDECIDED if kappa is below the boundary by a relative distance of less than 1.5·10⁻⁵, or
        above it by less than 4·10⁻⁶, or if the methods fail or contradict each other; `boundary`
        then contains the bracket.

    Raises
    ------
    ValueError
        If kappa is not finite or too large.
    ImportError
        If `prove` is True, a circle is found, and python-flint is not installed.

    Examples
    --------
    >>> from nasm.verdicts import verdict
    >>> verdict((0.3, 0.4)).answer
    Answer.BARRIER
    >>> verdict((1.2, 0.9))
    <Verdict: TRANSPORT, evidence CONVERSE_KAM; circle ...>
    """
    kappa = forcing(kappa)
    size = float(np.abs(kappa).max())
    if size == 0:
        no_breakup = no_answer(None, Status.NO_BREAKUP)
        return Verdict(kappa, Answer.BARRIER, Evidence.INTEGRABLE, no_breakup)
    (short,), zero = shorten([kappa], rational(0))
    if short.size > MAX_PERIOD:
        return _verdict_on_long_period(kappa, short, prove, settings)
    answer, evidence = Answer.UNDECIDED, Evidence.NONE
    circle, graph, steps, proof = None, None, inf, None
    for tol in (settings.tol, settings.second_tol):
        boundary = _boundary(short, tol, settings.effort)
        end = boundary.value if isfinite(boundary.value) else boundary.upper
        if end < 1:
            steps = _kicks_to_eliminate(short, end, settings) / kappa.size
            if steps < inf:
                answer, evidence = Answer.TRANSPORT, Evidence.CONVERSE_KAM
                boundary = replace(boundary, upper=min(boundary.upper, 1.0))
        elif end > 1 and not survivors.eliminates(short, settings.effort.locating_steps):
            circle = _circle_under(short, boundary, settings)
            if circle is not None:
                answer, evidence = Answer.BARRIER, Evidence.CIRCLE
                lower = float(np.fmax(boundary.lower, 1.0))
                boundary = replace(boundary, omega=circle.omega, lower=lower)
                graph = lengthen(kappa, *circles.graph(circle))
            elif boundary.lower >= 1:
                answer, evidence = Answer.BARRIER, Evidence.CIRCLE_BEYOND
        if answer is not Answer.UNDECIDED or boundary.lower > 1 or boundary.upper < 1:
            break  # a narrower bracket would not settle it either
    if boundary.upper == inf:  # in units of kappa, the boundary is beyond the range of floats
        boundary = no_answer(boundary.omega, Status.NO_BREAKUP)
    if boundary.omega is not None:
        boundary = replace(boundary, omega=per_period(boundary.omega, kappa, short, zero))
    below = nan
    if prove:
        seconds = settings.proof_seconds
        answer, evidence, proof = _prove(kappa, short, circle, answer, evidence, seconds)
        is_ray = boundary.value > 1 and size >= MIN_SIZE  # a profile must not be smaller
        if circle is not None and evidence is Evidence.CIRCLE_PROVED and is_ray:
            from nasm.proofs.patches import proved_below

            below, _ = proved_below(circle.omega, short, boundary.value, seconds)
    return Verdict(kappa, answer, evidence, boundary, graph, steps, proof, below)


def _boundary(kappa: FloatArray, tol: float, effort: Effort) -> CriticalScale:
    """Return the CriticalScale of the last breakup on the ray through kappa, in units of kappa."""
    size = float(np.abs(kappa).max())
    unit = critical_scale(kappa / size, tol, effort=effort)
    names = "value", "error", "lower", "upper"
    return replace(unit, **{name: getattr(unit, name) / size for name in names})


def _kicks_to_eliminate(kappa: FloatArray, boundary: float, settings: VerdictSettings) -> float:
    """Return the number of kicks in which converse KAM eliminates all starts; inf if some survive.

    Try the number of steps that usually suffices, and then four times as many, and so on: close to
    a shorter forcing, starts survive longer.
    """
    usual = survivors.LONGEST_LIFETIME / (1 / boundary - 1)
    n_steps, kicks = max(usual, settings.effort.locating_steps), inf
    while kicks == inf:
        kicks = survivors.longest_lived(kappa, int(min(n_steps, settings.max_steps))).kicks
        if n_steps >= settings.max_steps:
            break
        n_steps *= 4
    return kicks


def _verdict_on_long_period(
    kappa: FloatArray, short: FloatArray, prove: bool, settings: VerdictSettings
) -> Verdict:
    """Judge a forcing with more than 64 kicks by converse KAM and direct iteration alone."""
    boundary = _boundary(kappa, settings.effort.resolution, settings.effort)
    answer, evidence = Answer.UNDECIDED, Evidence.NONE
    steps = aperiodic.last_survivor(aperiodic.around_strongest(kappa)).kicks / kappa.size
    if steps < inf:
        answer, evidence = Answer.TRANSPORT, Evidence.CONVERSE_KAM
    else:
        x, y = escape.ensemble(LANES)
        n_max = settings.n_kicks // kappa.size + 1
        escapes = escape.first_escape(kappa, x, y, [x.size], n_max)
        if escapes[0] < inf:
            answer, evidence = Answer.TRANSPORT, Evidence.ESCAPE
    if answer is Answer.TRANSPORT:
        boundary = replace(boundary, upper=min(boundary.upper, 1.0))
    proof = None
    if prove:  # the attempt fails, but its outcome states the reason
        seconds = settings.proof_seconds
        answer, evidence, proof = _prove(kappa, short, None, answer, evidence, seconds)
    return Verdict(kappa, answer, evidence, boundary, steps=steps, proof=proof)


def _prove(
    kappa: FloatArray,
    short: FloatArray,
    circle: circles.InvariantCircle | None,
    answer: Answer,
    evidence: Evidence,
    seconds: float,
) -> tuple[Answer, Evidence, BarrierProof | TransportProof | None]:
    """Try to prove the answer, and return it with its evidence and the proof."""
    from nasm.proofs import barrier, transport

    if circle is not None:
        proof = barrier.prove(circle.omega, short, start=circle.u, budget=seconds)
        return answer, Evidence.CIRCLE_PROVED if proof.proved else evidence, proof
    if answer is Answer.BARRIER:
        return answer, evidence, None
    transport_proof = transport.prove(kappa, seconds)
    if transport_proof.proved:
        return Answer.TRANSPORT, Evidence.TRANSPORT_PROVED, transport_proof
    return answer, evidence, transport_proof


def _circle_under(
    kappa: FloatArray, boundary: CriticalScale, settings: VerdictSettings
) -> circles.InvariantCircle | None:
    """Return a certified circle under kappa; None if none is found."""
    omega, distance = boundary.omega, 1 - 1 / boundary.value
    if omega is not None and settings.min_distance <= distance < settings.tol:
        scale, u = hull.certified_circle(omega, kappa, boundary.value, distance)
        if u is None or not scale > 1 - 1e-12:  # certified for weaker kicks only
            return None
        error = np.abs(circles.residual(omega, kappa, u)).max()
        return circles.InvariantCircle(omega, kappa, u, error, Status.OK)
    if omega is not None:
        omegas = [omega]
    else:  # e.g. close to a cusp, where residues give no value
        beyond = boundary.upper * kappa
        start = survivors.longest_lived(beyond, 2 * settings.effort.locating_steps)
        omegas = survivors.candidates(beyond, start)
    solutions = (circles.invariant_circle(omega, kappa, MAX_POINTS) for omega in omegas)
    return next((circle for circle in solutions if circle.certified), None)
