"""Certificates say what they prove, of the forcing as it was given, and no more."""

import hashlib
import json
import re
from pathlib import Path

import numpy as np
import pytest
from cases import thirds
from test_proof_cells import cell_beyond
from test_proof_transport import SEVERAL, beyond

import nasm
from nasm import proofs
from nasm.checks import sealed
from nasm.numbers import parse
from nasm.proofs import certificate_checker, certificates
from nasm.proofs.certificate_checker import Refuted, check, claim
from nasm.proofs.certificates import columns_in_hex

PROOFS = {
    "transport": lambda: proofs.transport.prove((1.2, 0.3)),
    "shortened": lambda: proofs.transport.prove((1.1, -1.1)),
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
    return sealed({key: value for key, value in certificate.items() if key != "sha256"})


def refuted(certificate, changes, reason=None):
    """After changes, though it claims what it then is about."""
    changed = certificate | changes
    changed["claim"] = claim(changed)
    with pytest.raises(Refuted, match=reason):
        check(resealed(changed))


def test_a_claim_is_of_the_forcing_as_it_was_given(made):
    assert {name: check(certificate) for name, certificate in made.items()} == {
        "transport": "transport is global under the forcing (1.2, 0.3)",
        "shortened": "transport is global under the forcing (1.1, -1.1)",
        "cell": "transport is global under every forcing within (0.015625, 0.015625) of "
        "(0.75, 0.25)",
        "barrier": "a rotational invariant circle of [0;(1)] exists under the forcing (0.4, -0.4)",
        "ray": "a rotational invariant circle of [0;(1)] exists under every forcing from 0.0 to "
        "0.75 times (0.4, -0.4)",
        "fan": "a rotational invariant circle of [0;(1)] exists under every forcing from 0.0 to "
        "0.2 times ((0.5, 0.0) + t (0.0625, 0.125)), -1 <= t <= 1",
    }


def test_certificates_name_the_statements_of_the_document_by_their_digests():
    text = (Path(nasm.__file__).parent / "proofs" / "README.md").read_text(encoding="utf-8")
    statements = re.findall(r"```text\n(.*?)\n```", text, re.DOTALL)
    digests = {s.split(".")[0]: hashlib.sha256(s.encode()).hexdigest() for s in statements}
    assert all(f"Version {certificates._VERSION}." in s for s in statements)
    assert digests == certificates._STATEMENTS
    assert digests == {name: digest for name, (digest, _) in certificate_checker.THEOREMS.items()}


def in_hex(*numbers):
    return [float(number).hex() for number in numbers]


def of_another(omega, *kappa):
    """Changes to another circle and forcing, of which nothing is shortened."""
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
    # (0.5, 0) is (0.5, -0), for which ω + 1 is the same circle moved by half a turn: not so beside.
    ("fan", {"shortened_from": {"omega": "[1;(1)]", "kappa": in_hex(0.5, 0)}}, "omega"),
    ("fan", of_another("[0;3,(1)]", 0.5, 0), "inequality"),
    ("fan", of_another("[0;(1)]", 0.51, 0), "inequality"),
    ("barrier", of_another("[0;1,4,4,4,4,3,(4)]", 0.4), "inequality"),
    ("barrier", of_another("[0;1,(4)]", 0.4 * (1 + 2.0**-20)), "inequality"),
    ("ray", {"scales": in_hex(0, 1.1)}, "inequality"),
    ("ray", {"scales": in_hex(0.75, 0)}, "no part"),
    ("ray", {"tilt": in_hex(0.001)}, "several directions"),
    ("fan", {"scales": in_hex(0, 1.1)}, "inequality"),
    ("fan", {"scales": in_hex(0.2, 0.2)}, "no part"),
    ("fan", {"scales": in_hex(-0.2, 0.2)}, "no part"),
    ("fan", {"tilt": in_hex(0.0625, 0.126)}, "inequality"),
    ("fan", {"tilt": in_hex(0, 0)}, "functions of t"),
    ("fan", {"tilt": in_hex(0.125)}, "no part"),
    ("fan", {"rho": (-0.01).hex()}, "no part"),
    ("barrier", {"rho": (-0.07).hex()}, "no part"),
    ("barrier", {"rho": "nan"}, "no part"),
    ("barrier", {"omega": "[0;2,-3,(1)]"}, "no quadratic irrational"),
    ("cell", {"half_width": in_hex(2.0**-6)}, "malformed"),
    ("barrier", {"moves": {"unit": -76, "numbers": [[]]}}, "functions of t"),
    ("barrier", {"moves": {"unit": -76, "numbers": [[[[[], [0, 1]]]]]}}, "inequality"),
    ("barrier", {"moves": {"unit": -76, "numbers": [[[[[], [0, 1]]] * 2]]}}, "for a kick"),
    ("barrier", {"moves": {"unit": -76, "numbers": [[[[[], [0, 1]]]]] * 2}}, "functions of s"),
    ("fan", {"moves": {"unit": -76, "numbers": []}}, "malformed"),
    ("fan", {"moves": {"unit": -76, "numbers": [[], []]}}, "malformed"),
    ("fan", {"moves": {"unit": -76, "numbers": [[[[[], [1]]] * 2]]}}, "not real"),
    ("fan", {"moves": {"unit": "nan", "numbers": [[[[[], [0, 1]]] * 2]]}}, "malformed"),
]


@pytest.mark.parametrize(("name", "changes", "reason"), FALSE)
def test_what_a_certificate_says_is_bound_to_what_it_proves(name, changes, reason, made):
    if reason == "claimed":
        with pytest.raises(Refuted, match=reason):
            check(resealed(made[name] | changes))
    else:
        refuted(made[name], changes, reason)


@pytest.mark.parametrize(("name", "bit"), [("barrier", -22), ("ray", -10), ("fan", -10)])
def test_a_changed_function_of_a_circle_is_refused(name, bit, made):
    moves = made[name]["moves"]
    narrow = [functions[:1] for functions in moves["numbers"]]  # which do not depend on t
    if name == "fan":
        refuted(made[name], {"moves": moves | {"numbers": narrow}}, "inequality")
    for k in (1, 2, 5):
        changed = json.loads(json.dumps(moves))
        changed["numbers"][0][0][0][1][k] += 1 << bit - moves["unit"]
        refuted(made[name], {"moves": changed}, "inequality")


@pytest.mark.parametrize("name", thirds([*COVERS]))
def test_boxes_that_die_too_late_or_leave_a_gap_are_refused(name):
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
        # If a share could be rounded, both halves could be 0, and Q 2⁻⁵³.
        refuted(right, other_box(2, -(2.0**-53)), "a share of the site that is")
    for change in changes:
        refuted(right, change)


@pytest.mark.parametrize("name", PROOFS)
@pytest.mark.parametrize("key", ["version", "sha256", "name"])
def test_another_statement_is_refused(name, key, made):
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
def test_forcings_are_followed_to_their_shorter_forms(kappa):
    check(proofs.transport.prove(kappa).certificate())
    check(proofs.barrier.prove(parse("gamma"), np.array(kappa) / 10).certificate())


FIELDS = "kappa half_width shortened_from site a boxes lives omega rho scales tilt moves"
MALFORMED = [
    {key: value}
    for key in f"claim theorem {FIELDS}".split()
    for value in (None, [], {}, "a", 1.5, [[]], [None], {"kappa": [1]}, {"name": []})
]


@pytest.mark.parametrize("name", thirds(["ray", "cell", "fan", "transport", "barrier"]))
def test_what_is_malformed_is_refused_and_raises_nothing_else(name, made):
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
