"""Tasks: pure functions (coordinates of a tile, settings) → arrays, each wrapping a nasm kernel.

For each cube there is one that computes a tile, and one that predicts its cost in CPU seconds from
a small probe, so that a sweep can start with the expensive tiles and batch the cheap ones.
"""

from fractions import Fraction
from operator import attrgetter

import numpy as np

from nasm import barriers, continuation, escape, flux, numbers, periodic, transversals
from nasm.critical import Status
from nasm.maps import rotating_forcing
from nasm.symmetries import ray

_SECONDS_PER_STEP = 0.8e-9  # of one orbit and one step of two kicks; only ratios matter
_PROBE_STEPS = 2000


def escape_tile(coords, settings):
    """First escape times of the nested ensembles over one tile of the (κ1, κ2) plane.

    coords : arrays `kappa1`, `kappa2`, `ensemble`; settings : `n_max`, `window`.
    Returns {"escape_time": array (ensemble, kappa2, kappa1)}.
    """
    sizes = coords["ensemble"]
    x, y = escape.ensemble(int(sizes[-1]))
    times = escape.first_escape(
        _strengths(coords), x, y, sizes, settings["n_max"], settings["window"]
    )
    return {"escape_time": times}


def escape_cost(coords, settings):
    """Predicted CPU seconds of `escape_tile`: a few cells, 64 orbits, up to 2000 steps.

    A cell that the probe sees escape costs its escape time, any other one n_max; times all orbits.
    """
    probed = {dim: coords[dim][:: max(1, coords[dim].size // 3)] for dim in ("kappa2", "kappa1")}
    n_max, n_orbits = settings["n_max"], int(coords["ensemble"][-1])
    x, y = escape.ensemble(64)
    kappas = _strengths(probed)
    times = escape.first_escape(kappas, x, y, [64], min(n_max, _PROBE_STEPS), settings["window"])
    steps = np.where(np.isinf(times), n_max, times).mean()
    cells = coords["kappa2"].size * coords["kappa1"].size
    return _SECONDS_PER_STEP * n_orbits * steps * cells


def escape_rays_tile(coords, settings):
    """First escape times along rays: (ensemble, angle, excess).

    settings : `n_max`, `window`, and `critical_scales`, {angle: scale of the breakup}.
    """
    sizes = coords["ensemble"]
    x, y = escape.ensemble(int(sizes[-1]))
    scales = np.array([settings["critical_scales"][str(a)] for a in coords["angle"].tolist()])
    profiles = scales[:, None] * ray(coords["angle"])
    kappas = profiles[:, None, :] * (1 + coords["excess"][:, None])
    times = escape.first_escape(kappas, x, y, sizes, settings["n_max"], settings["window"])
    return {"escape_time": times}


def escape_rays_cost(coords, settings):
    """Predicted CPU seconds of `escape_rays_tile`: the bias falls like N^(-1/3)."""
    steps = np.minimum(settings["n_max"], 100 * (0.3 / coords["excess"]) ** 3)
    return _SECONDS_PER_STEP * int(coords["ensemble"][-1]) * steps.sum() * coords["angle"].size


def residue_tile(coords, settings):
    """Critical scales by Greene's residue, of the circles `omega` on the rays `angle`.

    settings : `omegas`, the exact texts of all rotation numbers; `q_max`, the longest period.
    """
    exact = _exact_omegas(settings)

    def critical_scale(omega, profile):
        return periodic.critical_scale(exact[omega], profile, settings["q_max"])

    return _on_rays(coords, "omega", critical_scale, _KICKS)


def residue_cost(coords, settings):
    """Predicted CPU seconds of `residue_tile`: 30 ms for each ray, whatever it holds."""
    return 0.03 * coords["omega"].size * coords["angle"].size


def circle_tile(coords, settings):
    """Critical scales of the circles `omega` on the rays `angle`, by continuation to breakdown.

    settings : `omegas`, the exact texts of all rotation numbers; `tol`, the error to aim at.
    """
    exact = _exact_omegas(settings)

    def critical_scale(omega, profile):
        return continuation.critical_scale(exact[omega], profile, settings["tol"])

    return _on_rays(coords, "omega", critical_scale, _KICKS)


def circle_cost(coords, settings):
    """Predicted CPU seconds of `circle_tile`: 10 ms for each ray, whatever it holds."""
    return 0.01 * coords["omega"].size * coords["angle"].size


def barrier_tile(coords, settings):
    """The last barrier on the rays `angle`; settings : `tol`, the width of the bracket."""
    profiles = ray(coords["angle"])
    found = [barriers.critical_scale(profile, settings["tol"]) for profile in profiles]
    arrays = _breakdown(found, dict(zip(_KICKS, profiles.T, strict=True)))
    arrays["omega"] = np.array([np.nan if s.omega is None else float(s.omega) for s in found])
    arrays["quotients"] = np.zeros((coords["quotient"].size, len(found)), np.int32)
    arrays["tail_length"] = np.zeros(len(found), np.int8)
    for i, omega in enumerate(scale.omega for scale in found):
        if omega is not None:
            quotients = [*omega.prefix, *omega.tail]
            arrays["quotients"][: len(quotients), i] = quotients
            arrays["tail_length"][i] = len(omega.tail)
    return arrays


def barrier_cost(coords, settings):
    """Predicted CPU seconds of `barrier_tile`: two each ray at a tolerance of 2·10⁻⁵."""
    return (0.1 + 4e-5 / settings["tol"]) * coords["angle"].size


def torus_tile(coords, settings):
    """Breakup of tori of rotating standard maps, by the residue of one long orbit.

    settings : `vectors`, the rotation vectors "p/q,Ω" of all `frequencies`.
    """
    vectors = [vector.split(",") for vector in settings["vectors"]]
    omegas = {float(Fraction(frequency)): (omega, frequency) for omega, frequency in vectors}

    def critical_scale(frequency, profile):
        return periodic.torus_scale(*omegas[frequency], *profile)

    return _on_rays(coords, "frequency", critical_scale, _ROTATING)


def torus_cost(coords, settings):
    """Predicted CPU seconds of `torus_tile`: 0.5 s for each ray, whatever it holds."""
    return 0.5 * coords["frequency"].size * coords["angle"].size


def transport_tile(coords, settings):
    """The onset of global transport in rotating standard maps, by direct iteration.

    settings : `frequencies`, their exact texts; `phase`; `n_max` and `n_orbits`, the effort.
    """
    exact = {float(Fraction(text)): text for text in settings["frequencies"]}

    def critical_scale(frequency, profile):
        kappa = rotating_forcing(*profile, exact[frequency], settings["phase"])
        return escape.critical_scale(kappa, settings["n_max"], settings["n_orbits"])

    return _on_rays(coords, "frequency", critical_scale, _ROTATING)


def transport_cost(coords, settings):
    """Predicted CPU seconds of `transport_tile`: ten runs of the whole ensemble a ray."""
    rays = coords["frequency"].size * coords["angle"].size
    return 10 * _SECONDS_PER_STEP * settings["n_orbits"] * settings["n_max"] * rays


def flux_tile(coords, settings):
    """The flux through broken circles at the `excess` beyond their breakup on the rays `angle`.

    settings : `critical_scales` and `circles`, {angle: scale of the breakup} and {angle: exact text
    of ω}; `q_max`, the longest period.
    """
    found = [
        [
            flux.flux(
                numbers.parse(settings["circles"][angle]),
                settings["critical_scales"][angle] * (1 + excess) * ray(float(angle)),
                settings["q_max"],
            )
            for excess in coords["excess"]
        ]
        for angle in map(str, coords["angle"].tolist())
    ]
    return _fields(found, {"flux": "value", "error": "error", "period": "period"})


def flux_cost(coords, settings):
    """Predicted CPU seconds of `flux_tile`: the period needed grows like 1/excess."""
    return 3e-4 * coords["angle"].size * np.sum(1 / coords["excess"])


def phases_tile(coords, settings):
    """The last barrier of a rotating standard map for several phases, by converse KAM.

    settings : `frequency`, its exact text; `n_max`, steps.
    """

    def critical_scale(phase, profile):
        kappa = rotating_forcing(*profile, settings["frequency"], phase)
        return transversals.critical_scale(kappa, settings["n_max"])

    return _on_rays(coords, "phase", critical_scale, _ROTATING)


def phases_cost(coords, settings):
    """Predicted CPU seconds of `phases_tile`: two each ray for 1000 steps."""
    return 2e-3 * settings["n_max"] * coords["phase"].size * coords["angle"].size


def _exact_omegas(settings):
    """{float: RotationNumber} of the setting `omegas`."""
    return {float(omega): omega for omega in map(numbers.parse, settings["omegas"])}


def _on_rays(coords, dim, critical_scale, plane):
    """The arrays of a tile with dims (dim, angle), of critical_scale(coordinate, profile)."""
    profiles = ray(coords["angle"])
    found = [[critical_scale(row, profile) for profile in profiles] for row in coords[dim].tolist()]
    return _breakdown(found, dict(zip(plane, profiles.T, strict=True)))


def _breakdown(found, plane):
    """The arrays of a cube of critical scales: `found` is nested lists of CriticalScale."""
    arrays = _fields(found, _BREAKDOWN)
    for name, direction in plane.items():
        arrays[name] = arrays["critical_scale"] * direction
    return arrays


def _fields(found, names):
    """{variable: array of the field `names` gives for it} and `status`, of nested lists."""
    found = np.array(found, dtype=object)
    arrays = {
        name: np.vectorize(attrgetter(field), otypes=[float])(found)
        for name, field in names.items()
    }
    arrays["status"] = np.vectorize(lambda one: 1 + STATUSES.index(one.status))(found)
    return arrays


STATUSES = list(Status)
_KICKS = "kappa1", "kappa2"
_ROTATING = "kappa_mean", "kappa_amplitude"
_BREAKDOWN = {"critical_scale": "value", "error": "error", "lower": "lower", "upper": "upper"}


def warm_up(methods):
    """Compile the kernels of some methods, once per process: "escape", "residue", "circle", …"""
    for method in methods:
        _WARM_UPS[method]()


_GOLDEN = numbers.RotationNumber((0,), (1,))
_WARM_UPS = {
    "escape": lambda: escape.first_escape([[0.0, 0.0]], *escape.ensemble(1), [1], 1),
    "residue": lambda: periodic.residue((0.1, 0.1), 1, 3),
    "circle": lambda: continuation.critical_scale(_GOLDEN, (1.0, 0.0), 0.1),
    "flux": lambda: flux.action_difference((0.1, 0.1), 1, 3),
    "barrier": lambda: barriers.critical_scale((1.0, 0.0), 0.1),
    "transversal": lambda: transversals.elimination_time((1.0,), 0, 0.5, 0.0, 1),
}


def _strengths(coords):
    """The forcings of a tile, shape (kappa2, kappa1, 2)."""
    return np.stack(np.meshgrid(coords["kappa1"], coords["kappa2"]), axis=-1)
