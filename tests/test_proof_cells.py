import inspect
import itertools
import json
import math
import re

import numpy as np
import pytest

pytest.importorskip("flint")
from flint import arb, ctx, fmpq
from test_proof_transport import BREAKUPS, beyond, fast_fma, used

from nasm import certificate_checker as checker
from nasm import proof_cells, proof_transport
from nasm.proof_cells import prove_cell
from nasm.proof_transport import Outcome, prove


def cell_beyond(angle, widths, size):
    """The cell of the grid of that size, some widths beyond the breakup on the ray."""
    place = beyond(angle, widths * size / BREAKUPS[angle])
    return np.floor(place / size) * size + size / 2, size / 2


CELLS = [cell_beyond(20, 4, 2.0**-6), cell_beyond(30, 8, 2.0**-7)]


@pytest.mark.parametrize("cell", CELLS)
def test_an_independent_program_checks_the_certificate_of_a_cell(cell):
    kappa, half_width = cell
    for signs in ((1, 1), (-1, 1)):
        proof = prove_cell(signs * kappa[::-1], half_width)
        assert proof.proved
        checker.check(json.loads(json.dumps(proof.certificate())))


def test_a_cell_may_be_oblong():
    proof = prove_cell((0.75, 0.25), (2.0**-7, 2.0**-5))
    assert proof.proved
    checker.check(proof.certificate())


@pytest.mark.parametrize("cell", CELLS)
def test_every_forcing_of_a_proved_cell_is_proved(cell):
    kappa, half_width = cell
    for signs in itertools.product((-1, 0, 1), repeat=2):
        assert prove(kappa + half_width * np.array(signs)).proved


def changed(certificate, index, box=None, life=None):
    boxes, lives = list(certificate["boxes"]), list(certificate["lives"])
    boxes[index], lives[index] = box or boxes[index], life or lives[index]
    return certificate | {"boxes": boxes, "lives": lives}


def test_a_changed_certificate_of_a_cell_is_refused():
    proof = prove_cell(*CELLS[0])
    certificate = proof.certificate()
    longest = int(proof.lives.argmax())
    numbers = proof.boxes[longest].tolist()
    wrong = [
        changed(certificate, longest, life=proof.lives[longest].item() - 10),
        certificate | {"boxes": certificate["boxes"][1:], "lives": certificate["lives"][1:]},
        certificate | {"half_width": [(2 * width).hex() for width in proof.half_width]},
        certificate | {"kappa": [(strength - 2.0**-6).hex() for strength in proof.kappa]},
        certificate | {"kappa": [(2.0).hex(), (2.0).hex()]},
        certificate | {"a": 0.5 - proof.a},
    ]
    for column in range(8):
        other = [*numbers[:column], numbers[column] + 2.0**-20, *numbers[column + 1 :]]
        wrong.append(changed(certificate, longest, box=[number.hex() for number in other]))
    for other in wrong:
        with pytest.raises((checker.Refuted, ValueError)):
            checker.hypothesis(other)


@pytest.mark.parametrize("proved", [lambda: prove((1.2, 0.3)), lambda: prove_cell(*CELLS[0])])
def test_a_certificate_with_one_digit_changed_is_refused(proved):
    certificate = proved().certificate()
    text = json.dumps(certificate)
    digits = [i for i, character in enumerate(text) if character.isdigit()]
    for i in np.random.default_rng(3).choice(digits, 100):
        changed = text[:i] + str(int(text[i]) % 9 + 1) + text[i + 1 :]
        with pytest.raises(checker.Refuted, match="seal"):
            checker.check(json.loads(changed))


def test_boxes_of_a_cell_tile_it_and_are_asked_whether_they_do(monkeypatch):
    (kappa, half_width), n = CELLS[1], 0
    proof = prove_cell(kappa, half_width)
    cell = np.roll(kappa, -proof.site), np.full(2, half_width)
    assert proof_cells._tile(proof.boxes, *cell)
    for i, box in list(enumerate(proof.boxes))[::8]:
        others = np.delete(proof.boxes, i, axis=0)
        twice = np.delete(others, i // 2, axis=0)
        changed = [others, [*proof.boxes, box], [*twice, box, box]]
        if (others[:, 8] == box[8]).any():  # a piece of one box may be wider than it need be
            for column in range(8):
                changed.append([*others, box + 2.0**-20 * (np.arange(9) == column)])
        assert not any(proof_cells._tile(np.array(boxes), *cell) for boxes in changed)
        n += len(changed)
    assert n > 50
    assert not proof_cells._tile(proof.boxes, cell[0], 2 * cell[1])
    monkeypatch.setattr(proof_cells, "_tile", lambda *_: False)
    with pytest.raises(RuntimeError, match="do not tile"):
        prove_cell(*CELLS[0])


def test_a_shear_that_is_no_number_proves_nothing(monkeypatch):
    monkeypatch.setattr(proof_cells, "_shears", lambda *_: (math.nan, math.nan))
    assert prove_cell(*CELLS[0]).outcome is Outcome.PRECISION


TINY = 2.0**-16
BOX = {"y": 0.5, "δ": 2.0**-44, "k0": 1.0, "h0": 2.0**-38, "k1": 1.0, "h1": 2.0**-38}


@pytest.mark.parametrize(
    ("split", "changes", "exact"),
    [
        (0, {}, True),
        (1, {}, True),
        (2, {}, True),
        (0, {"δ": 2.0**-44 * (1 + TINY)}, False),
        (1, {"h0": 2.0**-38 * (1 + TINY)}, False),
        (2, {"h1": 2.0**-38 * (1 + TINY)}, False),
        (1, {"k0": 0.0, "h0": 2.0**-38 * (1 + TINY)}, False),  # the start cannot move so little
        (0, {"δ": math.nan}, False),
    ],
)
def test_a_box_is_halved_exactly_or_not_at_all(split, changes, exact):
    box = [*(BOX | changes).values(), 127 / 256, 127 / 256, 0.0]
    boxes, waiting = np.array(box)[:, None], np.zeros((4, 9))
    assert proof_cells._halve(waiting, 0, boxes, 0, split) == exact


def test_cells_with_a_circle_are_not_proved():
    for angle in (0, 20, 30):
        for widths in (-2, -0.5, 0):
            kappa, half_width = cell_beyond(angle, widths, 2.0**-7)
            if (beyond(angle, 0) > kappa - half_width).all():  # some of it is below the breakup
                assert not prove_cell(kappa, half_width, 0.05).proved


@pytest.mark.parametrize("kappa", [(3, 3), (1.999, 0.5), (0.5, -1.999)])
def test_cells_outside_the_theorem_are_not_proved(kappa):
    kappa = np.rint(np.array(kappa) * 2**10) / 2**10
    assert prove_cell(kappa, 2.0**-7).outcome is Outcome.SCOPE


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (((0.1, 0.5), 0.25), "multiples of"),
        (((0.5, 0.5), 0.1), "multiples of"),
        (((0.5, 0.5), 0.0), "positive"),
        (((0.5, 0.5), -0.5), "positive"),
        (((0.5,), 0.5), "two strengths"),
        (((0.5, math.nan), 0.5), "not finite"),
        (((0.5, 0.5), 0.5, 0), "budget"),
    ],
)
def test_cells_that_cannot_be_halved_exactly_raise(arguments, message):
    with pytest.raises(ValueError, match=message):
        prove_cell(*arguments)


# Audits of the kernel against balls of many digits.

PLACES = [(1, 1, 1), (-1, 1, 1), (1, -1, 1), (1, 1, -1), (-1, -1, 1), (0.3, -0.9, 0.7)]
KICK = "".join(
    inspect.getsource(function.py_func)
    for function in (proof_cells._trigonometry, proof_cells._kick)
)


def kick_in_python(changes=()):
    source = re.sub("(?m)^@.*\n", "", KICK)
    for old, new in changes:
        assert source.count(old) == 1, old
        source = source.replace(old, new)
    namespace = vars(proof_transport) | vars(proof_cells)
    namespace |= {"fma": fast_fma, "rint": lambda a: float(round(a)), "fabs": abs}
    namespace |= {"copysign": math.copysign, "maximum": lambda a, b: a if a > b else b}
    exec(source, namespace)
    return namespace["_kick"]


def audit(kick, a, box, life):
    """Shares of the bounds of ρ_n and of the payments that are used at worst; ≤ 1 if they hold."""
    lanes = np.zeros((proof_cells._ROWS, 1))
    proof_cells._start(lanes, 0, a - 0.25, np.array(box)[:, None])
    state, (scale, *strengths) = tuple(lanes[:22, 0].tolist()), lanes[22:, 0].tolist()
    states = [state]
    for _ in range(life):
        state, bad = kick(*strengths, scale, state)
        strengths = strengths[2:] + strengths[:2]
        states.append(state)
        if not (bad <= 0 and state[4] > 0):
            break
    ctx.prec, share, paid_share = 150 + 3 * life, 0.0, 0.0
    y, delta, k0, h0, k1, h1, g0, g1, _ = map(arb, box)
    for sigma, sigma0, sigma1 in PLACES:
        kappa = [k0 + arb(sigma0) * h0, k1 + arb(sigma1) * h1]
        x, variation = arb(a), arb(0)
        step = y + arb(sigma) * delta + g0 * arb(sigma0) * h0 + g1 * arb(sigma1) * h1
        for n, state in enumerate(states[:-1]):
            first, second = (sigma0, sigma1) if n % 2 == 0 else (sigma1, sigma0)
            rho = x - arb(state[0]) - arb(fmpq(1, 4)) - arb(sigma) * state[6]
            rho -= arb(first) * state[8] + arb(second) * state[10]
            rho = abs(float((rho - round(float(rho.mid()))).mid()))
            share = max(share, used(rho, state[12] * abs(state[2]) + state[13] * abs(state[6])))
            V, V_after = arb(state[4]), arb(states[n + 1][4])
            V_before = V_after if n == 0 else arb(states[n - 1][4])
            slope = 2 + kappa[n % 2] * (2 * x).cos_pi()
            variation += V * (slope * V - V_before - V_after) * (fmpq(1, 2) if n == 0 else 1)
            paid = states[n + 1][18]
            paid_share = max(paid_share, used(paid + float(variation.mid()), paid))
            if n > 0:
                step += kappa[n % 2] * (2 * x).sin_pi() / (2 * arb.pi())
            x += step
    return share, paid_share


def audited(changes=()):
    """The worst shares over some boxes of a cell, and over boxes of (almost) one forcing."""
    proof, kick = prove_cell(*CELLS[0]), kick_in_python(changes)
    boxes, lives = proof.boxes[::40], proof.lives[::40]
    narrow = boxes * [1, 1, 1, 2.0**-20, 1, 2.0**-20, 1, 1, 1]
    rows = zip([*boxes.tolist(), *narrow.tolist()], [*lives, *lives], strict=True)
    return np.max([audit(kick, proof.a, box, int(life)) for box, life in rows], axis=0)


def test_bounds_of_cells_hold_against_arithmetic_of_many_digits():
    shares = audited()
    assert (shares <= 1).all()
    assert (shares > 0.1).all()


MUTATIONS = {
    "nothing is paid": (" + due / V * UP", ""),
    "half of what is known": ("UP * (known + rest)", "UP * (0.5 * known + rest)"),
    "the start left out": ("known = fabs(lt) + ", "known = "),
    "this strength left out": ("fabs(lt) + fabs(lp) + fabs(lq)", "fabs(lt) + fabs(lq)"),
    "the other strength left out": ("fabs(lp) + fabs(lq)", "fabs(lp)"),
    "strength without its own term": ("+ spread * c * V2", ""),
    "strength moves nothing": (" + spread * h\n", "\n"),
    "strength moves the wrong way": ("fma(kc, p, zp) + spread", "fma(kc, p, zp) - spread"),
    "cosine: square left out": (" + TWO_PI2 * fabs(c) * E2 + COS", " + COS"),
    "nothing along t": ("B = (B + defect * fabs(v)) * UP", "B = B"),
    "defect: square left out": ("expansion = PI * sine * E2 + CUBIC", "expansion = CUBIC"),
    "defect: strength left out": (" + spread * of_strength\n    defect", "\n    defect"),
}


@pytest.mark.parametrize("mutation", MUTATIONS)
def test_a_changed_kernel_of_cells_breaks_a_bound(mutation):
    assert audited([MUTATIONS[mutation]]).max() > 1
