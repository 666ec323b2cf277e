"""Each bound in the checker is valid, and less than twice as large as the quantity it bounds."""

import json
import lzma
import subprocess
import sys
from fractions import Fraction
from itertools import product

import numpy as np
import pytest
from flint import acb, acb_poly, arb, arb_mat, arb_poly, ctx

from nasm.proofs import barrier
from nasm.proofs import certificate_checker as checker


def random_box(rng):
    """Return a for a line x = a, and a random box on this line for a forcing of two kicks.

    The sizes vary so widely that each part of a bound dominates in some boxes.
    """

    def size():
        return rng.choice([0.0, 10 ** rng.uniform(-6, -2)])

    a = rng.choice([0, 0.5])
    y = rng.integers(8) / 8 + rng.choice([0, 1]) * rng.uniform(0, 1e-3)
    box = [y, 10 ** rng.uniform(-6, -2)]
    for _ in range(2):
        box += [rng.choice([0, 1, -1, 2, -2, rng.uniform(-2, 2)]), size()]
    box += [rng.choice([0, 1, rng.uniform(-9, 9)]) for _ in range(2)]
    return Fraction(a), [Fraction(float(number)) for number in box]


def orbit(a, box, place, n):
    """Return x_k and κ_k, k < n, of the orbit that starts at a corner of the box.

    place : the sign of each coordinate of the corner. The caller sets the precision, 300 bits.
    """
    y, delta, k0, h0, k1, h1, *shears = map(checker.ball, box)
    moved = [s * h for s, h in zip(place[1:], (h0, h1), strict=True)]
    x = [checker.ball(a), checker.ball(a) + y + place[0] * delta]
    x[1] += sum(shear * move for shear, move in zip(shears, moved, strict=True))
    kappa = [(k0 + moved[0], k1 + moved[1])[k % 2] for k in range(n)]
    for k in range(1, n):
        x.append(2 * x[-1] - x[-2] + kappa[k] * (2 * x[-1]).sin_pi() / (2 * arb.pi()))
    return x[:n], kappa


def variation(eta, cosines):
    """Return half the second variation Q: the terms on one side, and half the term at site 0."""
    around = [2 * eta[1], *(a + b for a, b in zip(eta, [*eta[2:], 0.0], strict=False))]
    terms = [x * ((2 + c) * x - y) for x, c, y in zip(eta, cosines, around, strict=True)]
    return terms[0] / 2 + sum(terms[1:])


def test_the_second_variation_has_sharp_bounds_in_boxes():
    rng, largest = np.random.default_rng(1), np.zeros(5)
    for i in range(400):
        a, box = random_box(rng)
        with ctx.workprec(128 if i % 4 else 24):  # with few bits, rounding matters
            begun, first = checker.on_a_line(a, box)
            sites = list(checker.orbits(*begun, 4))
            bound, eta = checker.summed(sites, *first)
        with ctx.workprec(300):
            eta = [arb(number) for number in [*eta, *[0.0] * (4 - len(eta))]]
            middle = variation(eta, [cosine for cosine, *_ in sites])
            for place in product((1, -1), repeat=3):
                x, kappa = orbit(a, box, place, 4)
                cosines = [k * (2 * at).cos_pi() for k, at in zip(kappa, x, strict=True)]
                signs = arb_mat([[s] for s in place])
                for n, (cosine, row, matrix, rest) in enumerate(sites):
                    known = row * signs + signs.transpose() * matrix * signs
                    off = abs(cosines[n] - cosine - known[0, 0])
                    assert not off > rest + 1e-36
                    used = off / rest if i % 4 and rest > 1e-30 else 0
                    largest[n] = max(largest[n], float(used))
                result = variation(eta, cosines)
                assert not result > bound + 1e-36
                used = (result - middle) / (bound - middle) if bound - middle > 1e-30 else 0
                largest[4] = max(largest[4], float(used))
    assert (largest[1:] > 0.9).all()


@pytest.mark.parametrize(("most", "a", "small"), [(8, 0.2, 1e-6), (80, 0.9, 1e-6), (24, 0.9, 0.1)])
def test_the_inverse_is_bounded_by_the_defect_of_its_approximation(most, a, small):
    """Compare with 1/(1 + a cos φ) = (1 + 2 Σ (-b)^k cos kφ)/√(1 - a²), b = (1 - √(1 - a²))/a.

    In the last case there are too few modes for a small defect.
    """
    r, root = 1.2, (1 - a**2) ** 0.5
    weighted = (1 - root) / a * r
    exact = (1 + 2 * weighted / (1 - weighted)) / root
    with ctx.workprec(checker.BITS):
        d, defect = checker.inverse([acb(x) for x in (a / 2, 1, a / 2)], arb(r), most)
        size = checker.norm(d, arb(r))
        bound = checker.neumann(size, defect)
        assert checker.neumann(size, arb(1)) == arb.pos_inf()
    d = np.array(d, dtype=complex)
    off = -np.convolve(d, [a / 2, 1, a / 2])
    off[len(off) // 2] += 1
    k = np.arange(len(off)) - len(off) // 2
    assert float(size) == pytest.approx(np.abs(d) @ r ** np.abs(k[1:-1]), rel=1e-12)
    assert float(defect) < small
    assert (float(defect) < 1e-6) == (small < 0.1)
    assert float(defect) == pytest.approx(np.abs(off) @ r ** np.abs(k), abs=1e-12)
    assert (1 - 1e-12) * exact <= bound <= (1 + 2 * small) * exact


ALPHA, RHO = (5**0.5 - 1) / 4, 0.01


def norm_of_residuals(kappa, u):
    """Return ‖E_j‖ in floats, from 512 points, for u_j = Σ_k c_k e^{2πikφ} + complex conjugate."""
    k = np.fft.fftfreq(512, 1 / 512)
    modes = np.zeros((2, 512), complex)
    modes[:, : u.shape[1]] = u
    turn = np.exp(2j * np.pi * k * ALPHA)
    real, shifted, back = (
        2 * 512 * np.fft.ifft(m).real for m in (modes, turn * modes, modes / turn)
    )
    E = shifted[::-1] + back[::-1] - 2 * real
    E -= np.array(kappa)[:, None] * np.sin(2 * np.pi * (k / 512 + real)) / (2 * np.pi)
    return np.abs(np.fft.fft(E)) / 512 @ (np.exp(2 * np.pi * RHO * np.abs(k)) * (np.abs(k) < 120))


def theorem(kappa, u):
    data = {"omega": "[0;(1)]", "rho": RHO.hex(), "kappa": [k.hex() for k in kappa]}
    functions = [[[int(x * 2**200) for x in part] for part in (f.real, f.imag)] for f in u]
    data["moves"] = {"unit": -200, "numbers": [[functions]]}
    with ctx.workprec(checker.BITS):
        return checker.theorem(data)[1]


def test_bounds_on_residuals_agree_with_a_float_evaluation_of_the_chain():
    kappa, k = (0.3, -0.5), np.arange(40)
    waves = np.random.default_rng(2).normal(size=(2, 2, 40)) * np.exp(-k) * (k > 0) / 50
    u = waves[0] + 1j * waves[1]
    result, exact = theorem(kappa, u), norm_of_residuals(kappa, u)
    slopes = 1 + 4 * np.pi * (k * np.abs(u)) @ np.exp(2 * np.pi * RHO * k)
    assert result["error"] == pytest.approx(exact.max(), rel=1e-9)
    assert result["n"] == pytest.approx(slopes.max(), rel=1e-9)
    assert result["epsilon"] == pytest.approx(slopes @ exact, rel=1e-9)


def test_the_error_of_a_grid_of_points_is_bounded_in_the_best_strip():
    f = np.array([0, 0.05, 0.02])
    with ctx.workprec(checker.BITS):
        grid = checker.Grid(arb(RHO), [arb_poly(f.tolist())] * 2)
        u = [acb_poly((f / 2).tolist())] * 2
        with_missed = grid.residuals([arb(0.3), arb(-0.5)], u, arb(ALPHA))
        (missed, _), grid.missed = grid.missed, [arb(0)] * 2
        without = grid.residuals([arb(0.3), arb(-0.5)], u, arb(ALPHA))
    hat = np.linspace(1.25, 15.75, 1000)[:, None] * RHO
    sizes = hat + 2 * (np.exp(2 * np.pi * hat * [0, 1, 2]) @ f)[:, None] - (hat - RHO) * grid.half
    assert 1 <= float(missed) / (2 * np.exp(2 * np.pi * sizes).min()) < 1.01
    for k, more, less in zip((0.3, 0.5), with_missed, without, strict=True):
        assert float(more - less) == pytest.approx(k / (2 * np.pi) * float(missed))


def test_the_checker_runs_as_a_program_on_certificate_files(tmp_path):
    certificate = barrier.prove("gamma", (0.3,)).certificate()
    contents = {
        "one.json": json.dumps(certificate).encode(),
        "list.json.xz": lzma.compress(json.dumps([certificate, certificate]).encode()),
        "wrong.json": json.dumps(certificate | {"omega": "[0;(2)]"}).encode(),
    }
    for name, content in contents.items():
        (tmp_path / name).write_bytes(content)
    command = [sys.executable, "-I", checker.__file__, *contents]
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    lines = result.stdout.splitlines()
    assert [line.split(":")[0] for line in lines] == ["one.json", "list.json.xz", "list.json.xz"]
    assert all("proved: a rotational invariant circle of [0;(1)] exists" in line for line in lines)
    assert result.stderr == "wrong.json: refuted: the seal is broken\n"
    assert result.returncode == 1
