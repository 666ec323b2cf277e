"""The reference values: quantities, their conditions, and both measurements of each quantity."""

import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from nasm import barriers, diffusion, escape, flux, manifolds, orbits, periodic
from nasm.circles import continuation
from pipeline.cubes.cube import text
from workflows.reference import circle_through, second_variation, spreading, symmetric
from workflows.shared import ramps
from workflows.shared.judgement import Verdict, agrees
from workflows.shared.tables import dataset

_TEXTS = Path(__file__).with_name("reference.toml").read_text(encoding="utf-8")
KINDS: dict[str, Any] = tomllib.loads(_TEXTS)
"""The texts of each kind, {kind: texts}, from reference.toml."""

Number = tuple[float, float]  # a value and its error


@dataclass(frozen=True)
class Case:
    """A quantity under certain conditions.

    Attributes
    ----------
    kind : str
        A key of `KINDS`.
    conditions : dict
        The parameters of the quantity, in types that JSON can represent.
    measure, measure_again : callable
        () → (value, error), by the first and by the second method of the kind.
    texts : dict
        Additional entries for the templates of the kind.
    has_check : bool
        True if the lines of plain Python that check values of this kind work for this case.
    """

    kind: str
    conditions: dict[str, Any]
    measure: Callable[[], Number]
    measure_again: Callable[[], Number]
    texts: dict[str, Any]
    has_check: bool = True

    @property
    def name(self) -> str:
        """The kind and the conditions, as text."""
        return f"{self.kind} {', '.join(f'{k}={v}' for k, v in self.conditions.items())}".strip()

    def written(self, template: str) -> str:
        """Return a text of the kind with its entries filled in; "" if the kind has no such text."""
        entries = {k: tuple(v) if isinstance(v, list) else v for k, v in self.conditions.items()}
        return KINDS[self.kind].get(template, "").format(**entries | self.texts)


def cases(quick):
    """List all Cases, or, if `quick`, fewer of them with smaller ensembles."""
    n_orbits, most = (2048, 10**5) if quick else (2**14, 10**6)
    opened = _OPEN[: 1 if quick else None]
    return [
        Case("critical_strength", {"profile": [1.0]}, _kappa_g, _kappa_g_again, {}),
        *(_last_barrier(profile) for profile in _PROFILES[: 1 if quick else None]),
        *(_residue(kappa, p, q) for kappa, fractions in _PERIODIC for p, q in fractions),
        *(_rotation_number(*start) for start in _STARTS),
        *(_flux(p, q) for p, q in _GOLDEN_ORBITS),
        *(_turnstile(*edge) for edge in _EDGES[: 1 if quick else None]),
        *(_diffusion(kappa, n_orbits) for kappa in _DIFFUSIVE[: 1 if quick else None]),
        *(_escape("escape_time", kappa, most) for kappa in opened),
        *(_escape("escape_factor", kappa, most) for kappa in opened),
        *(_ramp(rate) for rate in _RATES[: 1 if quick else None]),
    ]


_PROFILES = [(1.0, 0.5), (1.0, 0.2), (1.0, 0.9), (1.0, 1.0, 0.0), (1.0, 0.5, 0.5), (1.0, 0.5, 0.3)]
_LONG = [(3, 8), (5, 13), (8, 21)]
_PERIODIC = [  # forcings that are the same forwards and backwards in time, and values of (p, q)
    ((0.9,), [(0, 1), (1, 2), (1, 3), (1, 4), (2, 5), *_LONG, (13, 34), (21, 55)]),
    ((0.5, 0.3), [(0, 1), (1, 1), (1, 2), (1, 3), (2, 3), (3, 5), *_LONG, (13, 21)]),
    (
        (0.6, 0.3, 0.3),
        [(0, 1), (1, 1), (3, 2), (4, 3), (5, 4), (6, 5), (7, 5), (9, 7), (11, 8), (18, 13)],
    ),
]
_GOLDEN_ORBITS = [(8, 13), (34, 55), (144, 233)]
_STARTS = [
    ((0.5,), 0.5, 0.6),
    ((0.5,), 0.5, 0.68),
    ((0.8,), 0.5, 0.6),
    ((0.3, 0.2), 0.1, 0.31),
    ((0.3, 0.2), 0.1, 0.19),
    ((0.3, 0.2, 0.1), 0.25, 0.21),
]
_EDGES = [
    ((0.98135,), 1, 2, True),
    ((0.98135,), 2, 5, True),
    ((0.98135,), 2, 5, False),
    ((0.6, 0.5), 1, 2, True),
    ((0.6, 0.5), 2, 5, True),
]
_DIFFUSIVE = [(1.8,), (5.2,), (8.0,), (2.0, 1.5), (3.0, 2.0), (2.5, 2.0, 1.5)]
_OPEN = [(8.0,), (8.5, 5.0), (10.0, 7.5)]
_RATES = [1e-2, 3e-3, 1e-3]


@cache
def _kappa_g():
    scale = periodic.critical_scale("gamma", (1.0,), q_max=20_000)
    return scale.value, scale.error


def _kappa_g_again():
    scale = continuation.critical_scale("gamma", (1.0,), 1e-7)
    return scale.value, scale.error


@cache
def _last(profile):
    return barriers.critical_scale(profile, 1e-4)


def _last_barrier(profile):
    def measure():
        return _last(profile).value, _last(profile).error

    def bracket():
        lower, upper = _last(profile).lower, _last(profile).upper
        return (lower + upper) / 2, (upper - lower) / 2

    return Case("last_barrier", {"profile": list(profile)}, measure, bracket, {}, has_check=False)


def _residue(kappa, p, q):
    def measure():
        value = periodic.residue(kappa, p, q)
        return value, 4 * symmetric.EPSILON * max(abs(value), 1)

    def again():
        orbit = symmetric.symmetric_orbit(kappa, p, q, 0.5)
        return orbit.residue, orbit.error

    conditions = {"kappa": list(kappa), "p": p, "q": q}
    return Case("residue", conditions, measure, again, {"n_kicks": len(kappa)})


def _rotation_number(kappa, x, y):
    def measure():
        omega, digits = orbits.rotation_number(kappa, x, y, 20_000)
        return float(omega), 10.0 ** -float(digits)

    conditions = {"kappa": list(kappa), "x": x, "y": y}
    again = partial(circle_through.rotation_number, kappa, x, y)
    return Case("rotation_number", conditions, measure, again, {})


def _flux(p, q):
    kappa = (0.98135,)

    def measure():
        return flux.action_difference(kappa, p, q), 4 * symmetric.EPSILON  # as in `_turnstile`

    conditions = {"kappa": list(kappa), "p": p, "q": q}
    again = partial(symmetric.gap_flux, kappa, p, q)
    # The check in plain Python does not find the minimizing orbit of 144/233.
    return Case("flux", conditions, measure, again, {"strength": kappa[0]}, has_check=q < 100)


def _turnstile(kappa, p, q, above):
    @cache
    def turnstile(spacing):
        return manifolds.turnstile(kappa, p, q, above, spacing)

    def measure():
        # The error comes from rounding the distances between the two orbits; their norm is below 1.
        return turnstile(4e-4).area, 4 * symmetric.EPSILON

    def polygons():
        # The error of the polygon's area is proportional to the square of the spacing.
        coarse, fine = (
            np.mean([abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2 for x, y in lobes])
            for lobes in (turnstile(spacing).lobes for spacing in (4e-4, 2e-4))
        )
        return float(fine), float(abs(fine - coarse))

    conditions = {"kappa": list(kappa), "p": p, "q": q, "above": above}
    return Case("turnstile", conditions, measure, polygons, {}, has_check=False)


def _diffusion(kappa, n_orbits):
    def measure():
        rate = diffusion.diffusion(kappa, n_orbits)
        return rate.value, 3 * rate.error

    again = partial(spreading.green_kubo, kappa, n_orbits // 4, 8192, 1024)
    return Case("diffusion", {"kappa": list(kappa)}, measure, again, {"n_orbits": n_orbits})


@cache
def _escape_times(kappa, n_orbits):
    return escape.escape_time(kappa, *escape.ensemble(n_orbits), 10**5)


@cache
def _transport(kappa, cells_per_turn):
    return spreading.escapes(kappa, escape.PAPER_WINDOW, 0.3, cells_per_turn)


def _escape(kind, kappa, n_orbits):
    def measure():
        times = _escape_times(kappa, n_orbits)
        if kind == "escape_time":
            return times.mean(), 3 * times.std() / times.size**0.5
        first = np.ceil(4 * times.mean())
        left = times[times > first] - first  # 1, 2, …: geometrically distributed, mean 1/(1 - λ)
        return 1 - 1 / left.mean(), 3 * left.std() / left.size**0.5 / left.mean() ** 2

    def again():
        coarse, fine = (_transport(kappa, n)[kind == "escape_factor"] for n in (40, 80))
        return fine, abs(fine - coarse)

    return Case(kind, {"kappa": list(kappa)}, measure, again, {"n_orbits": n_orbits})


def _ramp(rate):
    def of(lifetime, *efforts):
        """Return the result with the greater effort, and its difference from the other result."""
        few, many = (ramps.lost(_kappa_g()[0], rate, partial(lifetime, **each)) for each in efforts)
        return many, abs(many - few)

    measure = partial(of, ramps.longest_lived, {"effort": 1}, {"effort": 8})
    grids = {"n_starts": 2000, "n_best": 30}, {"n_starts": 4000, "n_best": 60}
    again = partial(of, second_variation.longest_lifetime, *grids)
    conditions = {"rate": rate, "lines": ramps.lines(rate)}
    return Case("ramp", conditions, measure, again, {}, has_check=False)


def measured(quick):
    """Measure all values by both methods; return a Dataset with the dimension `value`."""
    chosen = cases(quick)
    numbers = np.array([[*case.measure(), *case.measure_again()] for case in chosen]).T
    verdicts = [agrees(*four)[1].value for four in numbers.T.tolist()]
    names = [case.name for case in chosen]
    labels = {
        "number": "value by the first method",
        "error": "error of the first value",
        "second": "value by the second method",
        "second_error": "error of the second value",
    }
    units = [KINDS[case.kind]["unit"] for case in chosen]
    return dataset(
        "Reference values, each by two methods",
        {"value": text("value", names, "kind of quantity, and conditions")},
        {
            **{
                name: ("value", column, label)
                for (name, label), column in zip(labels.items(), numbers, strict=True)
            },
            "verdict": text("value", verdicts, "whether the two values agree within their errors"),
            "unit": text("value", units, "unit of the four numbers"),
        },
    )


AGREEMENT = {
    Verdict.HOLDS: "confirmed",
    Verdict.FAILS: "contradicted",
    Verdict.UNDECIDED: "not decided",
}


def entries(cube, quick):
    """Return the entries of the JSON file: a list with a dict for each value."""
    chosen, found = {case.name: case for case in cases(quick)}, []
    for row in cube.to_dataframe().reset_index().itertuples():
        case = chosen[row.value]
        texts, call, lines = KINDS[case.kind], case.written("call"), case.written("check")
        check = {"lines": lines.strip().splitlines(), "accuracy": texts.get("accuracy")}
        found.append({
            "name": row.value,
            "kind": case.kind,
            "definition": texts["definition"],
            "conditions": case.conditions,
            "unit": row.unit,
            "value": row.number,
            "error": row.error,
            "method": case.written("method"),
            "second_value": row.second,
            "second_error": row.second_error,
            "second_method": case.written("second_method"),
            "difference": abs(row.number - row.second),
            "verdict": AGREEMENT[Verdict(row.verdict)],
            "command": f'python -c "import nasm; print({call})"' if call else COMMAND,
            "check": check if case.has_check and lines else None,
        })  # fmt: skip
    return found


COMMAND = "python -m workflows.reference"
