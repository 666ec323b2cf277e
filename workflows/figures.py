"""Figures: each function takes a Dataset, returns a Figure, and computes no physics."""

from fractions import Fraction

import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import LogNorm

# Okabe & Ito, safe for colour-blind readers; of boundaries, the largest N first.
_CIRCLE_COLOURS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"]
_BOUNDARY_COLOURS = ["#0072B2", "#009E73", "#56B4E9"]


def save(figure, out, name):
    """Write the figure as NAME.png and NAME.pdf; returns the two paths."""
    paths = [f"{out}/{name}.{kind}" for kind in ("png", "pdf")]
    for path in paths:
        figure.savefig(path, dpi=200, bbox_inches="tight")
    plt.close(figure)
    return paths


def draw_escape_plane(plane, steps):
    """First escape times of the largest ensemble, with the boundary of each number of steps."""
    figure, axes = _plane_axes(plane)
    field = _draw_field(axes, plane)
    for n, colour in zip(steps[::-1], _BOUNDARY_COLOURS, strict=False):
        axes.contour(
            plane.kappa1, plane.kappa2, field <= n, levels=[0.5], colors=colour, linewidths=1.0
        )
        axes.plot([], [], color=colour, label=f"$N = {_power(n)}$")
    axes.legend(loc="best")
    return figure


def draw_critical_boundary(plane, circles, barrier):
    """The escape field, CB_ω of the circles and CB_gt in the colours of the last circle; which
    circle that is, by angle; and how CB_gt falls from the tip at 45°."""
    figure = plt.figure(figsize=(12, 10.5))
    axes, strip, tip = _three_panels(figure)
    _draw_field(axes, plane)
    breakdown = {"color": "0.45", "lw": 0.7}
    for i in range(circles.omega.size):
        label = r"$\mathit{CB}_\omega$ of the paper's six circles" if i == 0 else None
        axes.plot(circles.kappa1[i], circles.kappa2[i], label=label, **breakdown)
    colours = _draw_barrier(axes, barrier)
    ends = [(float(c.min()), float(c.max())) for c in (plane.kappa1, plane.kappa2)]
    axes.set(xlabel=r"$\kappa_1$", ylabel=r"$\kappa_2$", aspect="equal", xlim=ends[0], ylim=ends[1])
    axes.set_title(
        rf"Where the last barrier breaks; behind it, escape of {int(plane.ensemble[-1])} orbits "
        rf"within ${_power(plane.attrs['n_max'])}$ steps"
    )
    axes.legend(loc="upper center", fontsize="small")
    _draw_circle_strip(strip, barrier, colours)
    _draw_tip(tip, barrier, colours)
    figure.tight_layout()
    return figure


def _three_panels(figure):
    """Axes for the plane, for what happens by angle, and for the tip."""
    return figure.subplot_mosaic(
        [["plane", "plane"], ["strip", "tip"]],
        height_ratios=[1.5, 1],
        width_ratios=[2.4, 1],
    ).values()


def _plane_axes(plane):
    width = float(plane.kappa1.max() - plane.kappa1.min())
    height = float(plane.kappa2.max() - plane.kappa2.min())
    figure, axes = plt.subplots(figsize=(10, 1.2 + 8 * min(1.2, height / width)))
    axes.set(xlabel=r"$\kappa_1$", ylabel=r"$\kappa_2$", aspect="equal")
    axes.set_title(
        rf"Global transport: {int(plane.ensemble[-1])} orbits, up to "
        rf"${_power(plane.attrs['n_max'])}$ steps of $\mathcal{{T}}_{{\kappa_1\kappa_2}}$"
    )
    return figure, axes


def _draw_field(axes, plane):
    """The field on a log scale; cells without escape are left white. Returns the field."""
    field = plane.escape_time.isel(ensemble=-1).values
    half = [float(c.diff(c.name)[0]) / 2 for c in (plane.kappa1, plane.kappa2)]
    extent = [
        float(plane.kappa1[0]) - half[0],
        float(plane.kappa1[-1]) + half[0],
        float(plane.kappa2[0]) - half[1],
        float(plane.kappa2[-1]) + half[1],
    ]
    finite = np.where(np.isfinite(field), field, np.nan)
    earliest = max(1.0, np.nanmin(finite)) if np.isfinite(finite).any() else 1.0
    image = axes.imshow(
        finite,
        extent=extent,
        origin="lower",
        norm=LogNorm(vmin=earliest, vmax=max(plane.attrs["n_max"], 1.1 * earliest)),
        cmap="magma",
        interpolation="nearest",
    )
    axes.figure.colorbar(
        image, ax=axes, label="first escape $n^*$ (steps); white: none", fraction=0.024, pad=0.02
    )
    return field


def _power(n):
    """10^5, 5·10^5, … in TeX; small numbers and crooked ones as they are."""
    if n < 1000 or n % 10 ** (len(str(n)) - 2):
        return str(n)
    exponent = len(str(n)) - 1
    mantissa = n / 10**exponent
    return f"10^{exponent}" if mantissa == 1 else rf"{mantissa:g}\cdot 10^{exponent}"


def draw_circle_boundaries(breakdown, barrier):
    """CB_ω of each rotation number over the upper half plane, and CB_gt behind them, Fig. 8."""
    figure, axes = plt.subplots(figsize=(10, 5.8))
    axes.fill_between(barrier.kappa1, barrier.kappa2, color="0.92", label=r"$\mathit{CB}_{gt}$")
    _draw_circles(axes, breakdown, breakdown.kappa1, breakdown.kappa2)
    axes.set(xlabel=r"$\kappa_1$", ylabel=r"$\kappa_2$", aspect="equal", ylim=(0, None))
    axes.set_title(r"Breakup of circles: $\mathit{CB}_\omega$, and of the last one")
    axes.legend(loc="upper center", ncols=2, fontsize="small")
    return figure


def draw_tips(residues, circles, barrier):
    """The tips at 45° and 135° in detail, Fig. 9: residues as lines, circles as points."""
    figure, panels = plt.subplots(1, 2, figsize=(11, 5.5), layout="constrained")
    for axes, sign in zip(panels, (-1, 1), strict=True):
        axes.fill_between(barrier.kappa1, barrier.kappa2, color="0.92")
        _draw_circles(axes, residues, residues.kappa1, residues.kappa2)
        for i in range(circles.omega.size):
            colour = _CIRCLE_COLOURS[i % len(_CIRCLE_COLOURS)]
            axes.plot(circles.kappa1[i], circles.kappa2[i], ".", color=colour, ms=3)
        ends = sorted((sign * 0.7, sign * 1.0))
        axes.set(xlim=ends, ylim=(0.7, 1.0), aspect="equal", xlabel=r"$\kappa_1$")
    panels[0].set_ylabel(r"$\kappa_2$")
    panels[1].legend(loc="lower right", fontsize="x-small")
    figure.suptitle("The tips: lines by Greene's residue, points by continuation of circles")
    return figure


def _draw_circles(axes, breakdown, x, y):
    """The curves (x, y) of each ω; with (-x, -y), as all boundaries have that symmetry."""
    for i, text in enumerate(breakdown.omega.attrs["exact"]):
        colour = _CIRCLE_COLOURS[i % len(_CIRCLE_COLOURS)]
        axes.plot(x[i], y[i], color=colour, lw=1.3, label=rf"$\omega = {text}$")
        axes.plot(-x[i], -y[i], color=colour, lw=1.3)


def draw_rotating_circles(breakdown, transport):
    """CB_ω and the onset of transport for Ω = 1/2 in the variables κ̄, Δκ: the diamond, Fig. 10."""
    figure, axes = plt.subplots(figsize=(7, 7))
    mean, amplitude = (
        (breakdown.kappa1 + breakdown.kappa2) / 2,
        (breakdown.kappa1 - breakdown.kappa2) / 2,
    )
    _draw_circles(axes, breakdown, mean, amplitude)
    _draw_transport(axes, transport.sel(frequency=0.5))
    axes.set_title(r"Rotating standard map with $\Omega = 1/2$: $T_{\kappa_1\kappa_2}$")
    return _rotating(figure, axes)


def draw_rotating_tori(tori, transport):
    """Breakup of tori by the residue of long orbits, and the onset of transport, Fig. 11."""
    figure, axes = plt.subplots(figsize=(7, 7))
    for i, vector in enumerate(tori.attrs["vectors"]):
        curve, colour = tori.isel(frequency=i), _CIRCLE_COLOURS[i % len(_CIRCLE_COLOURS)]
        axes.plot(
            curve.kappa_mean, curve.kappa_amplitude, color=colour, lw=1.0, label=f"torus ({vector})"
        )
        axes.plot(-curve.kappa_mean, -curve.kappa_amplitude, color=colour, lw=1.0)
    for i, style in zip(range(transport.frequency.size), ("-", "--", ":", "-."), strict=False):
        _draw_transport(axes, transport.isel(frequency=i), style)
    axes.set_title("Rotating standard maps: tori and the onset of transport")
    return _rotating(figure, axes)


def _draw_transport(axes, transport, style="-"):
    frequency = Fraction(float(transport.frequency)).limit_denominator(10**6)
    label = rf"transport, $\Omega = {frequency}$, $N = {_power(transport.attrs['n_max'])}$"
    for sign, text in ((1, label), (-1, None)):
        scale = sign * transport.upper / transport.critical_scale
        axes.plot(
            scale * transport.kappa_mean,
            scale * transport.kappa_amplitude,
            style,
            color="black",
            lw=1.6,
            label=text,
        )


def _rotating(figure, axes):
    axes.set(xlabel=r"$\bar\kappa$", ylabel=r"$\Delta\kappa$", aspect="equal")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=2, fontsize="small")
    return figure


def draw_last_barrier(barrier):
    """CB_gt over the upper half plane, coloured by the last circle; which one it is, by angle; and
    how CB_gt falls from the tip at 45°."""
    figure = plt.figure(figsize=(11, 8.5))
    plane, strip, tip = _three_panels(figure)
    colours = _draw_barrier(plane, barrier)
    plane.set(xlabel=r"$\kappa_1$", ylabel=r"$\kappa_2$", aspect="equal")
    plane.set_title("Where the last barrier breaks")
    _draw_circle_strip(strip, barrier, colours)
    _draw_tip(tip, barrier, colours)
    figure.tight_layout()
    return figure


def _draw_tip(axes, barrier, colours):
    """How far the boundary is below the tip at 45°, on logarithmic axes."""
    side = barrier.isel(angle=np.flatnonzero(((barrier.angle < 45) & (barrier.angle > 25)).values))
    short = barrier.critical_scale.sel(angle=45) - side.critical_scale
    if not (short > 0).any():
        axes.set_axis_off()
        return
    axes.scatter(45 - side.angle, short, c=[colours[c] for c in side.circle.values], s=14)
    axes.set(xscale="log", yscale="log", xlabel=r"$45° - \varphi$", ylabel="scale below the tip")
    axes.grid(lw=0.3)


def _draw_barrier(axes, table):
    """CB_gt, each point in the colour of its last circle; returns {circle: colour}."""
    circles = [c for c in dict.fromkeys(table.circle.values.tolist()) if c]
    palette = plt.get_cmap("tab20").colors
    colours = {circle: palette[i % len(palette)] for i, circle in enumerate(circles)}
    colours[""] = "black"
    axes.plot(table.kappa1, table.kappa2, color="0.6", lw=0.8, zorder=1)
    points = [colours[c] for c in table.circle.values]
    axes.scatter(table.kappa1, table.kappa2, c=points, s=9, zorder=2)
    return colours


def _draw_circle_strip(axes, table, colours):
    """Which circle is the last, by angle."""
    for circle, colour in colours.items():
        here = table.isel(angle=np.flatnonzero(table.circle.values == circle))
        if here.angle.size:
            label = rf"$\omega = {circle}$" if circle else "undecided"
            axes.plot(here.angle, here.omega, ".", color=colour, ms=5, label=label)
    axes.set(xlabel=r"angle $\varphi$ of the ray (degrees)", ylabel=r"$\omega$ of the last circle")
    axes.legend(loc="upper right", fontsize="xx-small", ncols=2)
    axes.grid(lw=0.3)


def draw_convergence(bias, others, fits):
    """Error against effort of four methods, Fig. 7 and its likes, on logarithmic axes."""
    figure, panels = plt.subplots(2, 2, figsize=(11, 9), layout="constrained")
    direct, orbits, cones, sharp = panels.flat
    for i, angle in enumerate(bias.angle.values):
        colour, words = _CIRCLE_COLOURS[i], rf"$\varphi = {angle:g}°$"
        eta, deviation = fits[angle]
        label = rf"{words}: $\eta = {eta:.2f} \pm {deviation:.2f}$"
        direct.plot(bias.n, bias.sel(angle=angle)[-1], ".", color=colour, label=label)
        ratio = bias.sel(angle=angle) / bias.sel(angle=angle).isel(ensemble=-1)
        orbits.plot(bias.ensemble, ratio.mean("n"), ".-", color=colour, label=words)
        here = others.sel(angle=angle)
        cones.plot(here.steps, here.cones_raw, "o-", color=colour, label=f"{words}: upper")
        cones.plot(here.steps, here.cones_corrected, "s--", color=colour, mfc="none")
        q = here.residue.dropna("q")
        sharp.plot(q.q, q, ".-", color=colour, label=f"{words}: residues")
        sharp.plot(here.modes, here.circles_raw, "^--", color=colour, mfc="none")
    n = bias.n.values
    middle = float(bias[-1].median())
    for slope, style in ((2.681, ":"), (3.012, "-"), (3.322, "--")):
        guide = middle * (n / np.sqrt(n[0] * n[-1])) ** (-1 / slope)
        direct.plot(n, guide, style, color="0.6", lw=1, label=rf"$\eta = {slope}$")
    count = [int(size) for size in bias.ensemble]
    direct.set(title=f"Direct iteration, {count[-1]} orbits", xlabel="steps $N$")
    direct.set_ylabel(r"$\kappa_N/\kappa_c - 1$")
    orbits.set(title=f"Bias in parts of that with {count[-1]} orbits", xlabel="orbits $M$")
    orbits.set_ylabel("mean over $N$")
    cones.set(title="Converse KAM; dashed: corrected", xlabel="steps $N$", ylabel="relative error")
    sharp.set(
        title="Residue crossings; dashed: last certified circle",
        xlabel="period $q$, or grid points $n$",
        ylabel="relative error",
    )
    for axes in panels.flat:
        axes.set(xscale="log", yscale="linear" if axes is orbits else "log")
        axes.grid(lw=0.3)
        axes.legend(fontsize="x-small")
    return figure


def draw_scaling(measured, simulated, model):
    """Efficiency against the time of a tile: measured, simulated, and predicted."""
    figure, panels = plt.subplots(1, 3, figsize=(15, 4.8), layout="constrained", sharey=True)
    here, crowd, cluster = panels
    for i, workers in enumerate(measured.workers.values):
        for n, marker in zip(measured.tiles.values, "ov^s", strict=False):
            row = measured.sel(workers=workers, tiles=n).dropna("cost", subset=["wall"])
            label = f"{_count(workers)}, {n} tiles"
            _draw_efficiency(here, row, _CIRCLE_COLOURS[i], marker, label)
    for i, workers in enumerate(simulated.workers.values):
        row = simulated.sel(workers=workers)
        _draw_efficiency(crowd, row, _CIRCLE_COLOURS[i], "o", _count(workers))
    for i, workers in enumerate(model.workers.values):
        row = model.efficiency.sel(workers=workers)
        colour = "k" if i == 0 else _CIRCLE_COLOURS[i - 1]
        cluster.plot(row.cost, row, color=colour, label=_count(workers))
    here.set_title("Measured, worker processes on this machine")
    crowd.set_title("Simulated, all workers in one process")
    cluster.set_title("Model, ten minutes, each worker on its own core")
    here.set_ylabel("efficiency: tiles' time / workers' time")
    for axes in panels:
        axes.set(xscale="log", xlabel="time of a tile (s)", ylim=(0, 1.05))
        axes.grid(lw=0.3)
        axes.legend(fontsize="x-small")
    for axes in (here, crowd):
        axes.plot([], [], "k--", label="model, slowed as the machine was")
        axes.legend(fontsize="x-small", loc="best")
    return figure


def _count(workers):
    return "1 worker" if workers == 1 else f"{workers} workers"


def _draw_efficiency(axes, row, colour, marker, label):
    """Points where it was measured, a dashed line through what the model says there."""
    axes.plot(row.cost, row.efficiency, marker, color=colour, label=label)
    by_model = row.efficiency * row.wall / row.model_wall
    axes.plot(row.cost, by_model, "--", marker=marker, mfc="none", ms=8, color=colour, lw=1)


def draw_primary_points(primary):
    """Stability of the four primary period-one points over the plane, Fig. 3."""
    figure, panels = plt.subplots(2, 2, figsize=(8, 8), sharex=True, sharey=True)
    for axes, i, point in zip(panels.flat, range(4), primary.point.attrs["points"], strict=True):
        residue = primary.residue.isel(point=i)
        stable = (residue > 0) & (residue < 1)
        axes.contourf(primary.kappa1, primary.kappa2, stable, levels=[0.5, 1.5], colors=["#D55E00"])
        axes.set(title=f"$(x, y) = {point}$", aspect="equal")
        axes.axhline(0, color="0.7", lw=0.6)
        axes.axvline(0, color="0.7", lw=0.6)
    for axes in panels[1]:
        axes.set_xlabel(r"$\kappa_1$")
    for axes in panels[:, 0]:
        axes.set_ylabel(r"$\kappa_2$")
    figure.suptitle("Strengths for which a primary period-one orbit is stable")
    return figure


def draw_secondary_points(secondary):
    """Where secondary points exist and are stable, and the error of the cubic estimate, Fig. 4."""
    figure, axes = plt.subplots(figsize=(7.5, 6))
    error = secondary.estimate_error.where(secondary.estimate_error > 0)
    image = axes.pcolormesh(
        secondary.kappa1, secondary.kappa2, error, norm=LogNorm(vmin=1e-4, vmax=3), cmap="viridis"
    )
    figure.colorbar(image, ax=axes, label=r"error of the cubic estimate of $z_*$; white: no point")
    stable = (secondary.residue > 0) & (secondary.residue < 1)
    axes.contourf(
        secondary.kappa1, secondary.kappa2, stable, levels=[0.5, 1.5], colors="none", hatches=["//"]
    )
    axes.fill_between([], [], [], facecolor="none", edgecolor="black", hatch="//", label="stable")
    axes.set(xlabel=r"$\kappa_1$", ylabel=r"$\kappa_2$", aspect="equal")
    axes.set_title("Secondary period-one orbits next to $(1/2, 0)$")
    axes.legend(loc="lower left")
    return figure


def draw_verdict(portrait):
    """A phase portrait with the circle that is a barrier, or with an orbit that escapes."""
    escapes = "escaping_y" in portrait
    figure, panels = plt.subplots(
        1, 1 + escapes, figsize=(6 + 6 * escapes, 6.2), layout="constrained", squeeze=False
    )
    axes = panels[0, 0]
    axes.plot(portrait.x.values.ravel(), _cell(portrait.y.values.ravel()), **_dots("0.3", 0.9))
    if "circle_x" in portrait:
        stride = max(1, portrait.theta.size // 4096)
        x, y = portrait.circle_x.values[::stride] % 1, _cell(portrait.circle_y.values[::stride])
        order = np.argsort(x)
        axes.plot(
            x[order], y[order], color="#D55E00", lw=1.8, label=rf"$\omega = {portrait.omega}$"
        )
    if escapes:
        time = np.arange(portrait.time.size)
        x, y = portrait.escaping_x.values, portrait.escaping_y.values
        axes.plot(x % 1, _cell(y), label="orbit that escapes", **_dots("#D55E00", 1.5))
        panels[0, 1].plot(time, y, color="#D55E00", lw=0.3, marker=".", ms=2, rasterized=True)
        panels[0, 1].set(xlabel="step $n$", ylabel="$y_n$ of the orbit that escapes", box_aspect=1)
    axes.set(xlim=(0, 1), ylim=(-0.25, 0.75), xlabel="$x$ (turns)", ylabel="$y$ (mod 1)")
    axes.set_aspect("equal")
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="upper right", framealpha=0.95, markerscale=6)
    kappa1, kappa2 = portrait.kappa
    figure.suptitle(rf"$(\kappa_1, \kappa_2) = ({kappa1:.8g}, {kappa2:.8g})$: {portrait.answer}")
    return figure


def _dots(colour, size):
    return {"ls": "", "marker": ".", "ms": size, "mew": 0, "color": colour, "rasterized": True}


def _cell(y):
    """y mod 1 in [-1/4, 3/4): the circles of 0 ≤ ω/P ≤ 1/2, up to their amplitude, are whole."""
    return (y + 0.25) % 1 - 0.25


# Colour of a method, by how its name begins; its better answer is drawn filled, the other hollow.
_METHOD_COLOURS = {
    "direct, 100 orbits, near": "#E69F00",
    "direct, 100 orbits": "#CC79A7",
    "direct": "#D55E00",
    "weighted": "0.6",
    "converse": "#0072B2",
    "last certified": "#56B4E9",
    "blow-up": "#56B4E9",
    "residue": "#009E73",
    "barriers": "black",
}
_BETTER = ("extrapolated", "value", "blow-up", "Aitken")


def draw_work_precision(data):
    """Error against CPU time, a panel for each ray, grey where the judge may err; and the time of a
    Newton step."""
    n_panels = data.angle.size + 1
    figure, panels = plt.subplots(
        -(-n_panels // 3), min(3, n_panels), figsize=(13, 9), layout="constrained", squeeze=False
    )
    for axes, i in zip(panels.flat, range(data.angle.size), strict=False):
        here = data.isel(angle=i)
        for method, name in enumerate(data.method.attrs["names"]):
            colour = next(c for start, c in _METHOD_COLOURS.items() if name.startswith(start))
            better = any(word in name for word in _BETTER)
            axes.plot(
                here.cpu_seconds[method],
                np.maximum(here.error[method], 1e-16),
                "o-" if better else "o--",
                color=colour,
                mfc=colour if better else "white",
                ms=5,
                lw=1.2,
                label=name,
            )
        axes.axhspan(1e-16, float(here.judge_error), color="0.9")
        axes.set(xscale="log", yscale="log", ylim=(1e-14, 2))
        axes.set_title(rf"$\varphi = {int(here.angle)}°$")
        axes.set(xlabel="CPU time (s)", ylabel="relative error")
        axes.grid(lw=0.3)
    steps = panels.flat[data.angle.size]
    for i, name in enumerate(data.form.attrs["names"]):
        steps.plot(data.points, 1e6 * data.step_seconds[i], "os"[i] + "-", color="k", label=name)
    steps.set(xscale="log", yscale="log", xlabel="points of the circle $n$", ylabel="CPU time (µs)")
    steps.set_title("A Newton step")
    steps.legend()
    steps.grid(lw=0.3)
    for axes in panels.flat[n_panels:]:
        axes.set_axis_off()
    figure.legend(*panels.flat[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def draw_stability(studies):
    """Where each method stops being right: nine panels, one for each study."""
    figure, panels = plt.subplots(3, 3, figsize=(16, 13), layout="constrained")
    draw = {
        "cusp": _draw_near_cusp,
        "boundary": _draw_past_boundary,
        "fractions": _draw_fractions,
        "twist": _draw_twist,
        "amplitude": _draw_amplitudes,
        "beam": _draw_missed,
        "fakes": _draw_fakes,
        "disorder": _draw_disorder,
        "rounding": _draw_rounding,
    }
    for axes, (name, panel) in zip(panels.flat, draw.items(), strict=True):
        panel(axes, studies[name])
        axes.grid(lw=0.3)
        if axes.get_legend_handles_labels()[0]:
            axes.legend(fontsize="x-small")
    return figure


def _draw_near_cusp(axes, study):
    """Errors as they are, the claims dashed, and crosses where there is no answer."""
    for i, name in enumerate(study.approach.attrs["names"]):
        here, colour = study.isel(approach=i), _CIRCLE_COLOURS[i]
        off = np.maximum(here.off, 1e-14)
        axes.plot(study.delta, off, "o-", color=colour, ms=4, label=name)
        axes.plot(study.delta, here.error, "--", color=colour, lw=1)
        silent = study.delta[(here.status != 1).values]
        axes.plot(silent, np.full(silent.size, 0.3 / 2**i), "x", color=colour)
    axes.set(xscale="log", yscale="log", xlabel=r"$45° - \varphi$ (degrees)")
    axes.set(ylabel="relative error", title="Near the cusp: error; dashed: claimed; ×: no answer")


def _draw_past_boundary(axes, study):
    """What each method claims about each side: a mark for each method that says so."""
    excess = study.excess.values
    inside = np.abs(excess[excess != 0]).min()
    place = np.sign(excess) * np.log10(np.maximum(np.abs(excess), inside / 10) / inside * 10)
    claims = (
        ("circle certified", study.certified == 1, "o", 3),
        ("Birkhoff: regular, 5 digits", study.digits >= 5, "s", 2),
        ("eliminated by converse KAM", np.isfinite(study.elimination_time), "v", 1),
        ("escape seen", np.isfinite(study.escape_time), "^", 0),
    )
    for _, said, mark, row in claims:
        for i, angle in enumerate(study.angle.values):
            here = said.sel(angle=angle).values
            y = np.full(here.sum(), row + 0.15 * i)
            axes.plot(place[here], y, mark, color=_CIRCLE_COLOURS[i], ms=4)
    axes.set_yticks([3, 2, 1, 0], [label for label, *_ in claims], fontsize="x-small")
    axes.axvline(0, color="black", lw=0.8)
    chosen = [i for i, x in enumerate(excess) if x == 0 or abs(np.log10(abs(x)) % 1) < 1e-6]
    axes.set_xticks(place[chosen], [f"{excess[i]:.0e}" for i in chosen], fontsize="xx-small")
    for i, angle in enumerate(study.angle.values):
        axes.plot([], [], "o", color=_CIRCLE_COLOURS[i], label=rf"$\varphi = {angle:g}°$")
    axes.set(
        xlabel="$s/s_c - 1$", ylim=(-0.3, 4.2), title="Who says what on either side of the breakup"
    )


def _draw_fractions(axes, study):
    """Breakups by continuation and by residues, with errors, and the certified circles below."""
    for i, quotient in enumerate(study.quotient.values):
        here, colour = study.isel(quotient=i), _CIRCLE_COLOURS[i]
        place = study.q * 1.08**i
        residues, norms = (here.isel(approach=m) for m in (0, 1))
        axes.errorbar(
            place, norms.value, norms.error, fmt="s", color=colour, ms=4, mfc="none", lw=1
        )
        axes.plot(place, residues.value, "o", color=colour, ms=5, label=f"$a = {quotient}$")
        axes.plot(place, here.lower, "_", color=colour)
    axes.axhline(study.attrs["golden"], color="0.5", lw=0.8)
    axes.set(xscale="log", ylim=(0, 3), xlabel="$q$ of $p/q$", ylabel="breakup on $s(0.3, 0.2)$")
    axes.set_title(r"$[0;1,…,1,a,\overline{1}]$: ● residues, □ continuation, – certified", size=10)


def _draw_twist(axes, study):
    """Lives on the dominant line, and the least twist."""
    for i, angle in enumerate(study.angle.values):
        here, colour = study.isel(angle=i), _CIRCLE_COLOURS[i]
        finite = here.where(np.isfinite(here.elimination_time))
        label = rf"$\varphi = {angle:g}°$"
        axes.plot(study.scale, finite.elimination_time, "o-", color=colour, ms=3, label=label)
        axes.plot(study.scale, here.escape_time.where(np.isfinite(here.escape_time)), "^:", ms=3,
                  color=colour, lw=0.8)  # fmt: skip
        end = here.scale.where(here.twist < 1e-9).min()
        axes.axvline(float(end), color=colour, lw=0.8, ls="--")
    axes.set(yscale="log", xlabel="scale $s$", ylabel="steps")
    axes.set_title("● converse KAM, ▲ escape; dashed: the twist ends")


def _draw_amplitudes(axes, study):
    """Amplitudes of the last circles and of others."""
    for kick in (0, 1):
        style = ("o-", "x")[kick]
        label = f"last circle, kick {kick + 1}"
        axes.plot(study.angle, study["last"].sel(kick=kick), style, color="#0072B2", label=label)
    for i, part in enumerate(study.part.values[:4]):
        label = rf"seven others at ${part:g}\,s_c$"
        here = study.largest.sel(part=part)
        axes.plot(study.angle, here, ".--", color=_CIRCLE_COLOURS[1 + i], label=label)
    axes.set(xlabel=r"angle $\varphi$ (degrees)", ylabel="amplitude in $y$", ylim=(0, 0.25))
    axes.set_title("Proposition 1 assumes amplitudes below 1")


def _draw_missed(axes, study):
    axes.plot(study.kept, 100 * study.missed, "o-", label="searches that miss 1% of the life")
    axes.plot(study.kept, 100 * study.worst, "s--", mfc="none", label="largest part missed")
    axes.set_xscale("log", base=2)
    axes.set(xlabel="starts kept", ylabel="percent")
    axes.set_title(f"Beam search of converse KAM, {study.attrs['searches']} searches")


def _draw_fakes(axes, study):
    for ray, label in enumerate(("standard map", "on $(1, 0.5)$")):
        past = study.past.sel(ray=ray)
        axes.plot(study.n, past.where(past > 0), "o-", color=_CIRCLE_COLOURS[ray], label=label)
    passed, fakes = int(study.passed.sum() + study.polished.sum()), int(study.fakes.sum())
    axes.set_xscale("log", base=2)
    axes.set(yscale="log", xlabel="grid points $n$", ylabel="past the breakup")
    axes.set_title(f"Fake circles: {fakes} believed in, {passed} certified")


def _draw_disorder(axes, study):
    for i, name in enumerate(("lost", "right", "refused", "accepted")):
        for j, style in enumerate(("o-", "s--")):
            label = name if j == 0 else None
            y = study[name].isel(noise=j)
            axes.plot(study.scale, y, style, color=_CIRCLE_COLOURS[i], ms=4, label=label)
    noises = " and ".join(f"{noise:g}" for noise in study.noise.values)
    axes.set(xlabel="scale $s$ of $s(1, 0.5)$", ylabel="part of starts")
    axes.set_title(f"Newton for 13/21 from bad starts (off by {noises})")


def _draw_rounding(axes, study):
    for i, name in enumerate(study.arithmetic.attrs["names"]):
        here, colour = study.isel(arithmetic=i), _CIRCLE_COLOURS[i]
        axes.plot(study.steps, here.drift, "o-", color=colour, ms=4, label=name)
        reversal = here.reversal.where(here.reversal > 0)
        axes.plot(study.steps, reversal, "--", color=colour, lw=1)
    n = study.steps.values
    axes.plot(n, 2e-17 * n**0.5, ":", color="0.5", label=r"$\sqrt{n}$")
    axes.set(xscale="log", yscale="log", xlabel="steps $n$", ylabel="distance")
    axes.set_title("Drift off a circle; dashed: error of $n$ steps and back")
