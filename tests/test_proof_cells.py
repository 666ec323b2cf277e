import json
import math

import audit
import numpy as np
import pytest
from cases import thirds
from test_proof_transport import BREAKUPS, beyond

from nasm import proofs
from nasm.proofs import certificate_checker as checker
from nasm.proofs.transport import Outcome
from nasm.proofs.transport_cells import prove_cell


def cell_beyond(angle, widths, size):
    """Return the centre and half-width of the grid cell `widths` cells beyond the breakup."""
    place = beyond(angle, widths * size / BREAKUPS[angle])
    return np.floor(place / size) * size + size / 2, size / 2


CELLS = [cell_beyond(20, 4, 2.0**-6), cell_beyond(30, 8, 2.0**-7)]


@pytest.mark.parametrize(
    "cell",
    [
        *CELLS,
        (np.array([0.25, 0.75]), (2.0**-7, 2.0**-5)),
        (np.array([-0.75, -0.59326171875]), 2.0**-9),
    ],
)
def test_an_independent_program_accepts_the_certificate_of_a_cell(cell):
    kappa, half_width = cell
    for signs in ((1, 1), (-1, 1)):
        proof = prove_cell(signs * kappa[::-1], half_width)
        assert proof.proved
        checker.check(json.loads(json.dumps(proof.certificate())))


def test_a_shear_that_is_not_a_number_proves_nothing(monkeypatch):
    monkeypatch.setattr(proofs.transport_cells, "_shears", lambda *_: np.full(2, math.nan))
    assert prove_cell(*CELLS[0]).outcome is Outcome.PRECISION


TINY = 2.0**-16
BOX = {"y": 0.5, "δ": 2.0**-44, "k0": 1.0, "h0": 2.0**-38, "k1": 1.0, "h1": 2.0**-38}


@pytest.mark.parametrize(
    ("split", "changes", "exact"),
    [
        *((split, {}, True) for split in range(3)),
        (0, {"δ": 2.0**-44 * (1 + TINY)}, False),
        (1, {"h0": 2.0**-38 * (1 + TINY)}, False),
        (2, {"h1": 2.0**-38 * (1 + TINY)}, False),
        (1, {"k0": 0.0, "h0": 2.0**-38 * (1 + TINY)}, False),  # ŷ cannot be shifted exactly
        (0, {"δ": math.nan}, False),
    ],
)
def test_a_box_is_bisected_exactly_or_not_at_all(split, changes, exact):
    box = [*(BOX | changes).values(), 127 / 256, 127 / 256, 0.0]
    assert proofs.transport_cells._bisect(np.zeros((4, 9)), 0, np.array(box), split) == exact


def test_transport_is_not_proved_in_cells_that_reach_below_the_breakup():
    for angle in (0, 20, 30):
        for widths in (-2, -0.5, 0):
            kappa, half_width = cell_beyond(angle, widths, 2.0**-7)
            if (beyond(angle, 0) > kappa - half_width).all():  # the cell reaches below the breakup
                assert not prove_cell(kappa, half_width, 0.05).proved


@pytest.mark.parametrize("kappa", [(3, 3), (1.999, 0.5), (0.5, -1.999)])
def test_cells_outside_the_scope_of_the_theorem_are_not_proved(kappa):
    kappa = np.rint(np.array(kappa) * 2**10) / 2**10
    assert prove_cell(kappa, 2.0**-7).outcome is Outcome.SCOPE


@pytest.mark.parametrize("width", [0.0, -(2.0**-7)])
def test_cells_without_a_positive_width_are_refused(width):
    with pytest.raises(ValueError, match="must be positive"):
        prove_cell((0.75, 0.25), (2.0**-7, width))


NAMES = "t", "p", "q", "tt", "tp", "tq", "pp", "pq", "qq"  # first- and second-order terms
KNOWN = [(name, f"z{name}", f"l{name}") for name in NAMES]
KERNEL = audit.Kernel(
    functions=(
        proofs.transport.horner,
        proofs.transport_cells._trigonometry,
        proofs.transport_cells._kick,
    ),
    names=(
        *"xyvwVW",
        *(name for move, step, _ in KNOWN for name in (move, step)),
        *("A", "B", *(total for *_, total in KNOWN), "rest", "paid", "mt", "mp", "mq"),
    ),
    known=tuple(KNOWN),
    places=((1, 1, 1), (1, -1, 1), (1, 1, -1), (1, -1, -1), (0.3, -0.9, 0.7)),
    rounding=(0.864 * 2.0**-53, 2.0**-53),
)


@pytest.mark.parametrize("a", [0, 0.5])
@pytest.mark.parametrize("k0", [0.25, 0.0, -0.25])
def test_half_of_a_kick_on_the_symmetry_line_counts_whatever_its_sign(a, k0):
    """In a box in a wide cell, kicks on the line may differ in sign from the kick at the centre."""
    start, kicks = np.zeros((proofs.transport_cells._ROWS, 1)), np.zeros((8, 4, 1))
    box = np.array([0.3, 2.0**-12, k0, 2.0**-8, 0.5, 2.0**-8, 0, 0, 0, 0])
    line, plane = np.array([[a, 0.0], [a, 0.5]]), np.eye(3)[1:]
    proofs.transport_cells._start(start, kicks, 0, plane, line, True, box, 0)
    *numbers, scale = start[:, 0]
    state, bad = proofs.transport_cells._kick(*kicks[0, :, 0], scale, tuple(numbers))
    after, cosine = dict(zip(KERNEL.names, state, strict=True)), math.cos(2 * math.pi * a)
    assert bad == 0
    assert after["lp"] == pytest.approx(2.0**-8 * cosine / 2)
    assert after["W"] == pytest.approx(k0 * cosine / 2 + 2.0**-8 / 2)  # plus the payment for h0


def test_bounds_for_a_kick_in_a_cell_are_sufficient_and_nearly_sharp():
    shares = audit.audit_of_kicks(KERNEL)
    assert all(0.9 < share <= 1 for share in shares.values())


@pytest.mark.parametrize("deviation", [0.0, 0.3])
def test_a_box_whose_v_might_overflow_is_bad_however_far_it_extends(deviation):
    """A kick of strength 0 leaves V unchanged; boxes that extend further than 0.1 are bad too."""
    for V in (1.0, 0.99e100, 1.01e100, 1e120):
        values = dict.fromkeys(KERNEL.names, 0.0)
        values |= {"x": 0.1, "v": 1.0, "V": V, "t": deviation, "zt": 1.0}
        _, bad = proofs.transport_cells._kick(0.0, 0.0, 0.0, 0.0, 1.0, tuple(values.values()))
        assert (bad > 0) == (V > 1e100 or deviation > 0.1)


CHANGES = {
    "nothing is paid": (" + due / V * UP", ""),
    "half of what is known": ("UP * (known + rest)", "UP * (0.5 * known + rest)"),
    **{f"{total} left out": (f"fabs({total})", "0.0") for *_, total in KNOWN},
    "strength without its own term": ("+ fc * V2", ""),
    "other strength without its own term": ("+ gc * V2", ""),
    "strength moves nothing": (" + f * h\n", "\n"),
    "other strength moves nothing": (" + g * h\n", "\n"),
    "strength moves the wrong way": ("fma(kc, p, zp) + f", "fma(kc, p, zp) - f"),
    "start and strength: one product": ("pq2 = 2.0 * t * p", "pq2 = t * p"),
    **{f"no twist of {x} by α": (f" + twist_f * {x}", "") for x in "tpq"},
    **{f"no twist of {x} by β": (f" + twist_g * {x}", "") for x in "tpq"},
    **{f"no turn of {x}": (f" + turn * {x}2", "") for x in ("t", "p", "q", "tp", "tq", "pq")},
    "a solution of second order stops": (
        "pp, zpp, pq, zpq, qq, zqq),",
        "pp, zpp, pq, 0.0, qq, zqq),",
    ),
    "last differences change places": ("t1, zt, p1, zp, q1, zq)", "t1, zt, p1, zq, q1, zp)"),
    "a turn of the wrong sign": ("-TWO_PI2 * kc * V2", "TWO_PI2 * kc * V2"),
    "κh'' too small": ("bend = -TWO_PI2 * k", "bend = -0.99 * TWO_PI2 * k"),
    "a strength's product moves nothing": ("fma(fc, q, fma(gc, p, bend * pq2))", "bend * pq2"),
    "one of two products moves nothing": ("fma(gc, p, bend * pq2)", "bend * pq2"),
    "start and strength move nothing": ("fma(fc, t, bend * tp2)", "bend * tp2"),
    "start and other strength move nothing": ("fma(gc, t, bend * tq2)", "bend * tq2"),
    "square of a strength moves nothing": ("fma(fc, p, bend * p2)", "bend * p2"),
    "square of the other moves nothing": ("fma(gc, q, bend * q2)", "bend * q2"),
    "one strength spreads": ("fabs(f) + fabs(g)", "fabs(f)"),
    "defect: blur left out": (" + 0.16 * blur", ""),
    "defect: blur of 0.15": ("0.16 * blur", "0.15 * blur"),
    "cosine: blur left out": (" * rounding + blur", " * rounding"),
    "cosine: square left out": (" + TWO_PI2 * fabs(c) * both + COS", " + COS"),
    "nothing along t": ("B = (B + defect * fabs(v)) * UP", "B = B"),
    "a cube of 6.57": ("CUBIC * fabs(c)", "6.57 * fabs(c)"),
    "defect: square left out": ("expansion = PI * sine * both + CUBIC", "expansion = CUBIC"),
    "defect: strength left out": (" + spread * of_strength + 0.16", " + 0.16"),
    "strength: error of cos": ("COS_CUBIC * E3 + 3e-14", "COS_CUBIC * E3"),
    "strength: sine": ("of_strength = TWO_PI * sine * curved + TWO_PI2", "of_strength = TWO_PI2"),
    "strength: square": ("curved + TWO_PI2 * E2 + COS_CUBIC * E3 + 3e-14", "curved + 3e-14"),
    "defect: strength's cosine": ("fabs(c) * curved + COS * E + PI * sine", "PI * sine"),
    "orbit: half of the rounding": ("(size + 1.5) * ULP", "0.5 * (size + 1.5) * ULP"),
    "solutions: strength": ("(E1 + E + spread)", "(E1 + E)"),
    "solutions: 0.1 for 3.1": ("solutions = 3.1 * ULP", "solutions = 0.1 * ULP"),
    "cosine: cube left out": (" + COS_CUBIC * E3\n    of_strength", "\n    of_strength"),
    "cosine: ρ left out": ("TWO_PI * sine * unknown + ", ""),
    "no rounding": ("(1.0 + size) * rounding", "0.0"),
    "rounding of sums": (" + 1e-15 * known", ""),
    "nothing along v": ("A = (A + defect * at) * UP", "A = A * UP"),
    "q left out of |x - x̂|": ("straight = at + ap + aq", "straight = at + ap"),
    "qq left out of |x - x̂|": (" + fabs(qq) + unknown", " + unknown"),
    "a square of one factor": ("both = curved * (E + straight)", "both = curved * E"),
    "a box of any size": ("maximum(0.0, E - _MAX_DEVIATION)", "0.0"),
    "a Wronskian of any size": ("+ maximum(0.0, wronskian - _MAX_WRONSKIAN_ERROR)", ""),
    "a Wronskian that is not rounded": ("+ 4 * ULP * (fabs(vt)", "- 4 * ULP * (fabs(vt)"),
}


@pytest.mark.alters_sources
@pytest.mark.parametrize("change", thirds(CHANGES))
def test_a_changed_line_is_noticed(change):
    assert max(audit.audit_of_kicks(KERNEL, change).values()) > 1
