"""A certificate claims what it proves about the given forcing, and no more."""

import hashlib
import json
import re
from fractions import Fraction
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from audit import mutant
from cases import thirds
from test_proof_cells import cell_beyond
from test_proof_transport import SEVERAL, beyond

import nasm
from nasm import proofs
from nasm.checks import with_sha256
from nasm.numbers import parse
from nasm.proofs import certificate_checker, certificates
from nasm.proofs.certificate_checker import Refuted, check, claim
from nasm.proofs.certificates import columns_in_hex

PROOFS = {
    "transport": lambda: proofs.transport.prove((1.2, 0.3)),
    "shortened": lambda: proofs.transport.prove((1.1, -1.1)),
    "several": lambda: proofs.transport.prove((0.55, 0.4, 0.2)),
    "cell": lambda: proofs.transport_cells.prove_cell((0.75, 0.25), 2.0**-6),
    "barrier": lambda: proofs.barrier.prove(parse("gamma"), (0.4, -0.4)),
    "ray": lambda: proofs.proved_below(parse("gamma"), (0.4, -0.4), 1.5, 1e-3)[1][0],
    "fan": lambda: proofs.proved_below(parse("gamma"), (0.5, 0), 0.4, 1e-3, (0.0625, 0.125))[1][0],
}

COVERS = {
    "transport": lambda: proofs.transport.prove(beyond(20, 0.1)),
    "several": lambda: proofs.transport.prove(SEVERAL),
    "cell": lambda: proofs.transport_cells.prove_cell(*cell_beyond(20, 8, 2.0**-8)),
}


@pytest.fixture(scope="module")
def made():
    return {name: json.loads(json.dumps(proof().certificate())) for name, proof in PROOFS.items()}


def boxes_of(certificate):
    return np.array(
        [np.frombuffer(bytes.fromhex(column), ">f8") for column in certificate["boxes"]]
    ).T


def resealed(certificate):
    return with_sha256({key: value for key, value in certificate.items() if key != "sha256"})


def refuted(certificate, changes, reason=None):
    """Assert that the certificate is refuted after changes, with its claim updated to match."""
    changed = certificate | changes
    changed["claim"] = claim(changed)
    with pytest.raises(Refuted, match=reason):
        check(resealed(changed))


def test_a_claim_refers_to_the_forcing_that_was_given(made):
    assert {name: check(certificate) for name, certificate in made.items()} == {
        "transport": "transport is global under the forcing (1.2, 0.3)",
        "shortened": "transport is global under the forcing (1.1, -1.1)",
        "several": "transport is global under the forcing (0.55, 0.4, 0.2)",
        "cell": "transport is global under every forcing within (0.015625, 0.015625) of "
        "(0.75, 0.25)",
        "barrier": "a rotational invariant circle of [0;(1)] exists under the forcing (0.4, -0.4)",
        "ray": "a rotational invariant circle of [0;(1)] exists under every forcing from 0.0 to "
        "0.75 times (0.4, -0.4)",
        "fan": "a rotational invariant circle of [0;(1)] exists under every forcing from 0.0 to "
        "0.2 times ((0.5, 0.0) + t (0.0625, 0.125)), -1 <= t <= 1",
    }


def test_certificates_identify_the_statements_in_the_readme_by_digest():
    text = (Path(nasm.__file__).parent / "proofs" / "README.md").read_text(encoding="utf-8")
    statements = re.findall(r"```text\n(.*?)\n```", text, re.DOTALL)
    digests = {s.split(".")[0]: hashlib.sha256(s.encode()).hexdigest() for s in statements}
    assert all(f"Version {certificates._VERSION}." in s for s in statements)
    assert digests == certificates._STATEMENTS
    assert digests == {name: digest for name, (digest, _) in certificate_checker.THEOREMS.items()}


@pytest.mark.parametrize("name", PROOFS)
def test_a_proof_prints_on_one_line_and_as_a_table_and_is_not_hashable(name):
    proof = PROOFS[name]()
    line, table = repr(proof), proof._repr_html_()
    assert "\n" not in line
    assert ("circle [0;(1)] exists" in line) != ("transport is global" in line)
    assert table.startswith("<table><caption>Proof that ")
    assert f"{proof.kappa}" in table or f"{proof.original_kappa}" in table
    with pytest.raises(TypeError, match="unhashable"):
        hash(proof)


def in_hex(*numbers):
    return [float(number).hex() for number in numbers]


def of_another(omega, *kappa):
    """Return changes that replace the circle and the forcing, both as given and as shortened."""
    given = {"omega": omega, "kappa": in_hex(*kappa)}
    return given | {"shortened_from": given}


FALSE = [  # a certificate, what is changed in it, and why it is refused
    ("transport", {"shortened_from": {"kappa": in_hex(9.9, 9.9)}}, "claimed"),
    ("transport", {"shortened_from": {"kappa": in_hex(9.9, 9.9)}}, "shortened"),
    ("transport", {"claim": "transport is global under the forcing (9.9, 9.9)"}, "claimed"),
    ("transport", {"theorem": "anything"}, "malformed"),
    ("transport", {"theorem": {"name": "Anything", "version": 1, "sha256": ""}}, "malformed"),
    ("transport", {"constants": {}}, "unknown"),
    ("transport", {"half_width": in_hex(0, 0)}, "unknown"),
    ("shortened", {"shortened_from": {"kappa": in_hex(1.1, 1.1)}}, "claimed"),
    ("shortened", {"shortened_from": {"kappa": in_hex(1.1, -1.0)}}, "claimed"),
    ("shortened", {"kappa": in_hex(-1.1)}, "shortened"),
    ("cell", {"shortened_from": {"kappa": in_hex(9.9, 9.9)}}, "unknown"),
    ("cell", {"half_width": in_hex(2.0**-5, 2.0**-5)}, "claimed"),
    ("barrier", {"claim": "a circle exists under kappa = (9.9, 9.9)"}, "claimed"),
    ("barrier", {"constants": {}}, "unknown"),
    ("barrier", {"omega": "[0;(2)]"}, "omega"),
    *(
        ("barrier", {"shortened_from": {"omega": omega, "kappa": in_hex(*kappa)}}, "shortened")
        for omega, *kappa in (("[0;(2)]", 0.4, -0.4), ("[0;(1)]", 9.9, 9.9), ("[0;(1)]", 0.4, 0.4))
    ),
    ("ray", {"scales": in_hex(0, 1.1)}, "claimed"),
    ("ray", {"shortened_from": {"omega": "[0;(1)]", "kappa": in_hex(0.4, 0.4)}}, "shortened"),
    ("fan", {"scales": in_hex(0, 1.1)}, "claimed"),
    ("fan", {"tilt": in_hex(9.9, 9.9)}, "claimed"),
    ("fan", {"kappa": in_hex(9.9, 9.9)}, "shortened"),
    ("fan", {"constants": {}}, "unknown"),
    # (0.5, 0) equals (0.5, -0); under this forcing the circle with rotation number ω + 1 is the one
    # with ω, shifted by half a turn. Neighbouring forcings lack this symmetry.
    ("fan", {"shortened_from": {"omega": "[1;(1)]", "kappa": in_hex(0.5, 0)}}, "omega"),
    ("fan", of_another("[0;3,(1)]", 0.5, 0), "inequality"),
    ("fan", of_another("[0;(1)]", 0.51, 0), "inequality"),
    ("barrier", of_another("[0;1,4,4,4,4,3,(4)]", 0.4), "inequality"),
    ("barrier", of_another("[0;1,(4)]", 0.4 * (1 + 2.0**-20)), "inequality"),
    ("ray", {"scales": in_hex(0, 1.1)}, "inequality"),
    ("ray", {"scales": in_hex(0.75, 0)}, "not an interval"),
    ("ray", {"tilt": in_hex(0.001)}, "several directions"),
    ("fan", {"scales": in_hex(0, 1.1)}, "inequality"),
    ("fan", {"scales": in_hex(0.2, 0.2)}, "not an interval"),
    ("fan", {"scales": in_hex(-0.2, 0.2)}, "not an interval"),
    ("fan", {"tilt": in_hex(0.0625, 0.126)}, "inequality"),
    ("fan", {"tilt": in_hex(0, 0)}, "depend on t"),
    ("fan", {"tilt": in_hex(0.125)}, "for each kick"),
    ("fan", {"rho": (-0.01).hex()}, "rho is not"),
    ("barrier", {"rho": (-0.07).hex()}, "rho is not"),
    ("barrier", {"rho": "nan"}, "not a number"),
    ("barrier", {"omega": "[0;2,-3,(1)]"}, "not a quadratic irrational"),
    ("cell", {"half_width": in_hex(2.0**-6)}, "for each kick"),
    ("barrier", {"moves": {"unit": -76, "numbers": [[]]}}, "degrees"),
    ("barrier", {"moves": {"unit": -76, "numbers": [[[[[], [0, 1]]]]]}}, "inequality"),
    ("barrier", {"moves": {"unit": -76, "numbers": [[[[[], [0, 1]]] * 2]]}}, "for each kick"),
    ("barrier", {"moves": {"unit": -76, "numbers": [[[[[], [0, 1]]]]] * 2}}, "depend on s"),
    ("fan", {"moves": {"unit": -76, "numbers": []}}, "degrees"),
    ("fan", {"moves": {"unit": -76, "numbers": [[], []]}}, "degrees"),
    ("fan", {"moves": {"unit": -76, "numbers": [[[[[], [1]]] * 2]]}}, "not real"),
    ("fan", {"moves": {"unit": "nan", "numbers": [[[[[], [0, 1]]] * 2]]}}, "the unit"),
]


@pytest.mark.parametrize(("name", "changes", "reason"), FALSE)
def test_what_a_certificate_says_is_bound_to_what_it_proves(name, changes, reason, made):
    if reason == "claimed":
        with pytest.raises(Refuted, match=reason):
            check(resealed(made[name] | changes))
    else:
        refuted(made[name], changes, reason)


@pytest.mark.parametrize(("name", "bit"), [("barrier", -22), ("ray", -10), ("fan", -10)])
def test_a_circle_with_changed_functions_is_refused(name, bit, made):
    moves = made[name]["moves"]
    narrow = [functions[:1] for functions in moves["numbers"]]  # functions that do not depend on t
    if name == "fan":
        refuted(made[name], {"moves": moves | {"numbers": narrow}}, "inequality")
    for k in (1, 2, 5):
        changed = json.loads(json.dumps(moves))
        changed["numbers"][0][0][0][1][k] += 1 << bit - moves["unit"]
        refuted(made[name], {"moves": changed}, "inequality")


@pytest.mark.parametrize("name", thirds([*COVERS]))
def test_boxes_that_are_eliminated_too_late_or_leave_a_gap_are_refused(name):
    right = json.loads(json.dumps(COVERS[name]().certificate()))
    check(right)
    boxes, lives, kappa = boxes_of(right), right["lives"], right["kappa"]
    longest = max(range(len(lives)), key=lambda i: np.sum(lives[i]))
    box, life = boxes[longest].copy(), np.array(lives[longest])

    def other_life(life):
        return {"lives": [*lives[:longest], life.tolist(), *lives[longest + 1 :]]}

    def other_box(column, number):
        rows = boxes.copy()
        rows[longest, column] = number
        return {"boxes": columns_in_hex(rows)}

    changes = [other_life(shorter) for shorter in (life // 2, 9 * life // 10, 0 * life)]
    changes += [
        {"boxes": columns_in_hex(boxes[part]), "lives": lives[part]}
        for part in (slice(1, None), slice(-1))
    ]
    for column in {*range(min(len(box), 8))} - ({2} if name == "several" else set()):
        changes += [other_box(column, box[column] - box[1] / 16)]
    changes += [other_box(0, np.nan), {"boxes": [column[:-2] for column in right["boxes"]]}]
    weaker = [(0.85 * float.fromhex(strength)).hex() for strength in kappa]
    for k in (weaker, in_hex(*[2.0] * len(kappa)), kappa[::-1]):
        given = {} if name == "cell" else {"shortened_from": {"kappa": k}}
        changes.append({"kappa": k} | given)
    changes += [{"site": (right["site"] + 1) % len(kappa)}]
    changes += [{"a": 0.5 - right["a"]}] if "a" in right else []
    if name == "cell":
        changes += [{"half_width": [(2 * float.fromhex(h)).hex() for h in right["half_width"]]}]
    if name == "several":
        slope, (x, y) = box[2], map(float.fromhex, right["points"][0])
        changes += [other_box(2, other) for other in (slope + 0.5, slope / 3)]
        changes += [other_life(life[:1]), {"points": right["points"][:-1]}]
        changes += [{"points": [in_hex(x + 2.0**-10, y), *right["points"][1:]]}]
        # If η before the curve, 1 - split, were rounded, both halves could be 0 for Q = 2⁻⁵³.
        refuted(right, other_box(2, -(2.0**-53)), "a part of the site is")
    for change in changes:
        refuted(right, change)


def test_a_cell_with_a_negative_width_is_refused(made):
    rows = boxes_of(made["cell"]).copy()
    rows[:, 5] *= -1
    changes = {"half_width": in_hex(2.0**-6, -(2.0**-6)), "boxes": columns_in_hex(rows)}
    refuted(made["cell"], changes, "the width of a box is not positive")


@pytest.mark.parametrize("name", PROOFS)
@pytest.mark.parametrize("key", ["version", "sha256", "name"])
def test_a_certificate_for_another_statement_is_refused(name, key, made):
    names = list(certificate_checker.THEOREMS)
    following = names[names.index(made[name]["theorem"]["name"]) - 1]
    other = {"version": 2, "sha256": "0" * 64, "name": following}[key]
    theorem = made[name]["theorem"] | {key: other}
    with pytest.raises(Refuted, match=r"statement|unknown"):
        check(resealed(made[name] | {"theorem": theorem}))


@pytest.mark.parametrize("name", PROOFS)
def test_a_certificate_with_one_digit_changed_is_refused(name, made):
    text = json.dumps(made[name])
    digits = [i for i, character in enumerate(text) if character.isdigit()]
    for i in np.random.default_rng(3).choice(digits, 100):
        changed = text[:i] + str(int(text[i]) % 9 + 1) + text[i + 1 :]
        with pytest.raises(Refuted, match="seal"):
            check(json.loads(changed))


@pytest.mark.parametrize(
    "kappa", [(1.1, 1.1), (1.1, -1.1), (1.1, 0, -1.1, 0), (0, 1.1, 0, -1.1), (0.5, 1.2) * 3]
)
def test_the_checker_accepts_the_shorter_form_of_a_forcing(kappa):
    check(proofs.transport.prove(kappa).certificate())
    check(proofs.barrier.prove(parse("gamma"), np.array(kappa) / 10).certificate())


def test_only_repetitions_with_equal_or_alternating_signs_are_shortened():
    def is_shortened(long):
        data = {"kappa": in_hex(0.5), "shortened_from": {"kappa": in_hex(*long)}}
        try:
            return certificate_checker.shortened(data) is None
        except Refuted:
            return False

    both = [*filter(is_shortened, product((0.0, 0.5, -0.5, 2.0, -2.0), repeat=2))]
    assert both == [(0.5, 0.5), (0.5, -0.5)]


# --- individual lines without which the checker would accept a false certificate -----------------


def polygon_at_one_height():
    """Certify a curve that runs out and back: its starts are eliminated, but circles exist."""
    points = np.array([[0.5, 0.0], [0.5, 2.0**-6], [0.5, 0.0]])
    kappa = tuple((0.5 * np.array(SEVERAL)).tolist())
    proof, _ = proofs.transport._covered(kappa, kappa, 0, points, 10.0)
    assert proof.proved
    return proof.certificate()


def box_across_a_corner():
    """Certify a box on two pieces although circles exist; all of them cross the second piece."""
    kappa, slopes = 0.5 * np.array(SEVERAL), np.array([0.25])
    straight, whole = np.array([[0.5, 0.0], [0.5, 2.0**-8]]), np.array([[0.25, 0.25]])
    cycle = np.tile(kappa, 3)
    ways = cycle, cycle[::-1].copy()
    lives = [
        proofs.transport._followed(way, i, straight, whole, slopes, np.inf)
        for i, way in enumerate(ways)
    ]
    assert np.all(lives)
    points = np.array([[0.5, 0.0], [0.5, 2.0**-9], [0.5, 0.5]])
    forged = proofs.transport.TransportProof(
        *(proofs.transport.Outcome.PROVED, *[tuple(kappa.tolist())] * 2, 0, points),
        *(np.repeat(rows, 2, axis=0) for rows in ([[0.5, 0.5]], np.transpose(lives), slopes)),
    )
    return forged.certificate()


def matrix_without_an_inverse():
    """Certify (1, 1, 5), to which the theorem does not apply: its matrix is at best singular."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(proofs.transport, "is_twist", lambda _: True)
        return proofs.transport.prove((1.0, 1.0, 5.0)).certificate()


ALONE = [  # the line, its replacement, the reason for refusal, and the certificate
    ("points[0][1] != points[-1][1]", "True", "images", polygon_at_one_height),
    ("2 * (s + delta) <= piece + 1", "True", "corner", box_across_a_corner),
    ("if pivot <= 0:", "if pivot < 0:", "does not apply", matrix_without_an_inverse),
]


@pytest.mark.parametrize(("reason", "forge"), [row[2:] for row in ALONE])
def test_a_false_certificate_is_refused(reason, forge):
    with pytest.raises(Refuted, match=reason):
        check(json.loads(json.dumps(forge())))


@pytest.mark.parametrize(("line", "wrong", "reason", "forge"), ALONE)
def test_a_false_certificate_passes_without_the_line_that_refuses_it(line, wrong, reason, forge):
    forged = json.loads(json.dumps(forge()))
    assert mutant(certificate_checker, (line, wrong)).check(forged) == forged["claim"]


# --- values that are too large or of the wrong type -----------------------------------------------


def first(value):
    """Return a function that replaces the first item of a list by `value`."""
    return lambda row: [value, *row[1:]]


def of_theorem(version):
    return lambda theorem: theorem | {"version": version}


def moves(**changes):
    return lambda old: old | changes


def given(**changes):
    return {"shortened_from": lambda old: old | changes}


def one_function(*parts):
    return {"moves": moves(numbers=[[[list(parts)]]])}


def mode(value):
    return one_function([], [0, value])


NOTHING = [[], []]
MANY = [[[[], [0] * 4000]] * 2, *[[NOTHING] * 2] * 63]
LARGE = [  # a certificate, what is changed in it, and why it is refused
    *(("transport", {"lives": first(x)}, "from 1 to") for x in (10**9, 0, -1, 1.0, True, "9", [2])),
    ("transport", {"lives": [10**5] * 101, "boxes": ["0" * 1616] * 2}, "in all"),
    ("transport", {"lives": []}, "lives is not a list"),
    ("transport", {"boxes": ["0"] * 10**5}, "boxes are not 2 strings"),
    ("transport", {"boxes": first("0" * 10**6)}, "boxes are not 2 strings"),
    ("transport", {"kappa": in_hex(*range(65))}, "1 to 64"),
    ("transport", {"kappa": []}, "1 to 64"),
    ("transport", {"kappa": ["1e-99999999"]}, "is not a number"),
    ("transport", {"kappa": ["0." + "0" * 10**6]}, "24 characters"),
    ("transport", {"kappa": ["0.5"]}, "float.hex"),
    ("transport", {"kappa": [1.2]}, "24 characters"),
    ("transport", {"site": True}, "site is not"),
    ("transport", {"site": 0.0}, "site is not"),
    ("transport", {"a": "1e-99999999"}, "a is not"),
    ("transport", {"a": False}, "a is not"),
    ("transport", given(kappa=in_hex(*range(1001))), "1 to 1000"),
    *(("transport", {"theorem": of_theorem(version)}, "statement") for version in (1.0, True)),
    ("cell", {"half_width": in_hex(*[0.1] * 65)}, "for each kick"),
    ("several", {"points": lambda old: old * 10**5}, "can join"),
    ("several", {"points": first(in_hex(0.5))}, "pairs"),
    ("several", {"lives": first([1])}, "in pairs"),
    ("several", {"lives": first([1, 10**9])}, "from 1 to"),
    ("barrier", {"omega": f"[0;{'1' * 3000},(1)]"}, "at most 50 digits"),
    ("barrier", {"omega": f"[0;({'1,' * 4999}1)]"}, "1 to 200"),
    ("barrier", {"omega": "0" * 10**6}, "characters"),
    ("barrier", given(omega=f"[0;({'1,' * 4999}1)]"), "1 to 200"),
    ("barrier", {"rho": (1e300).hex()}, "rho is not"),
    ("barrier", {"rho": (1.5).hex()}, "rho is not"),
    *(("barrier", {"moves": moves(unit=x)}, "the unit") for x in (10**30, -(10**5), 1.0, True)),
    *(("barrier", mode(x), "integers") for x in (float("nan"), 1.0, True, 1 << 10001, "1")),
    ("barrier", one_function([], [0], [0]), "two lists"),
    ("barrier", {"moves": moves(more=1)}, "a unit and numbers"),
    ("ray", {"moves": moves(numbers=[[[NOTHING]]] * 65)}, "degrees"),
    ("fan", {"moves": moves(numbers=[[[NOTHING] * 2] * 65])}, "degrees"),
    ("fan", {"moves": moves(numbers=[MANY, *[[[NOTHING] * 2] * 64] * 63])}, "too many"),
    ("fan", {"tilt": in_hex(*range(10**4))}, "for each kick"),
    ("fan", {"scales": in_hex(0, 1, 2)}, "2 numbers"),
]


@pytest.mark.parametrize(("name", "changes", "reason"), LARGE)
def test_oversized_or_invalid_values_are_refused_before_any_work(
    name, changes, reason, made, monkeypatch
):
    def computes(*_):
        raise AssertionError("something is computed")

    for name_of_step in ("claim", "shortened", "hypothesis", "hypothesis_of_several", "theorem"):
        monkeypatch.setattr(certificate_checker, name_of_step, computes)
    monkeypatch.setattr(certificate_checker, "product", computes)  # used for continued fractions
    changed = {
        field: change(made[name][field]) if callable(change) else change
        for field, change in changes.items()
    }
    with pytest.raises(Refuted, match=reason):
        check(resealed(made[name] | changed))


def test_the_caller_sets_how_many_kicks_are_checked(made):
    n = sum(made["transport"]["lives"])
    with pytest.raises(Refuted, match=f"more than {n - 1} kicks in all"):
        check(made["transport"], n - 1)
    assert check(made["transport"], n) == made["transport"]["claim"]


def test_orbits_too_far_apart_are_not_followed_further():
    """The bounds grow like 4^(4^n), so their exponents would exhaust the memory."""
    box = [Fraction(x) for x in ("1/3", "1/1000", "2", "0", "1", "0")]
    begun, _ = certificate_checker.on_a_line(Fraction(0), box)
    with pytest.raises(Refuted, match="orbits in a box are too far apart"):
        list(certificate_checker.orbits(*begun, 10**5))


def test_orbits_are_followed_only_until_the_second_variation_is_decided(made):
    lives = [10**5] * len(made["transport"]["lives"])
    certificate = resealed(made["transport"] | {"lives": lives})
    assert check(certificate) == certificate["claim"]


def test_a_circle_with_a_large_residual_is_refused_before_any_inversion(made, monkeypatch):
    monkeypatch.setattr(certificate_checker, "inverse", None)
    unit, numbers = -1, [[[[[], [0, 1, 1, 1]]]]]
    refuted(made["barrier"], {"moves": {"unit": unit, "numbers": numbers}}, "a residual is")


def test_deeply_nested_objects_are_refused():
    deep = {}
    for _ in range(10**5):
        deep = {"claim": deep}
    with pytest.raises(Refuted, match="RecursionError"):
        check(deep)


FIELDS = "kappa half_width shortened_from site a points boxes lives omega rho scales tilt moves"
MALFORMED = [
    {key: value}
    for key in f"claim theorem {FIELDS}".split()
    for value in (None, [], {}, "a", 1.5, [[]], [None], {"kappa": [1]}, {"name": []})
]


@pytest.mark.parametrize(
    "name", [*thirds(["ray", "cell", "fan", "transport", "barrier"]), "several"]
)
def test_malformed_certificates_are_refused_without_any_other_error(name, made):
    for certificate in (None, [], {}, {"sha256": 1}, {"theorem": {}}):
        with pytest.raises(Refuted):
            check(certificate)
    for changes in MALFORMED:
        (key,) = changes
        if key in made[name]:
            with pytest.raises(Refuted):
                check(resealed(made[name] | changes))
    for key in made[name].keys() - {"sha256"}:
        with pytest.raises(Refuted):
            check(resealed({other: value for other, value in made[name].items() if other != key}))
