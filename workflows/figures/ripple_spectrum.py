"""How much a ripple lowers the threshold, against its frequency; the limit of slow ripples."""

from workflows.figures import style

_MARKERS = "os^Dv"


def draw_ripple_spectrum(cube, theory):
    """Draw the loss against Ω with the prediction, and κ_c(1 + d)/κ_G with the slow-ripple limit.

    Where only an upper bound on κ_c is known, a hollow triangle points towards the value.
    """
    figure, (losses, largest) = style.panels(1, 2, 12, 5.4)
    for i, depth in enumerate(cube.depth.values):
        rows, curve = cube.sel(depth=depth), theory.sel(depth=depth)
        options = {"color": style.colour_of(i), "label": f"$d = {depth:g}$"}
        _draw_losses(losses, rows, curve, i, options)
        _draw_largest_kick(largest, rows, curve, i, options)
    _mark_resonances(losses, theory)
    losses.set(xlim=(0, 0.51), xlabel=r"frequency $\Omega$ (turns per kick)")
    losses.set(ylabel=r"loss, $1 - \kappa_c/\kappa_G$", ylim=(0, None))
    losses.set_title("Spectrum of a ripple", pad=16)
    largest.axhline(1, color="black", lw=0.8)
    largest.set(xscale="log", xlabel=r"frequency $\Omega$ (turns per kick)", ylim=(None, 1.3))
    largest.set(ylabel=r"largest kick, $\kappa_c(1 + d)/\kappa_G$")
    largest.set_title("From slow to fast", pad=16)
    marks = {"^": r"only an upper bound on $\kappa_c$", "-": "predicted by small divisors"}
    marks["--"] = "upper bound from the kicks around the largest one"
    style.key(losses, marks, "^")
    losses.plot([], [], color="0.8", label=r"$\Omega = \pm m\gamma$ mod 1, labelled by $m$")
    handles, labels = losses.get_legend_handles_labels()
    style.outer_legend(figure, 3, handles=handles, labels=labels)
    return figure


def ripple_spectrum_caption(cube, findings):
    depths = ", ".join(f"{d:g}" for d in cube.depth.values)
    return (
        f"Kicks κ(1 + d cos 2πnΩ) with depth d = {depths}. (a) The fraction by which the breakup "
        "of the last barrier, κ_c, lies below κ_G, and the prediction from small divisors to first "
        "order in d, without free parameters. (b) The largest kick at the last breakup, divided by "
        "κ_G. Bars are brackets, mostly "
        "smaller than the markers. Hollow triangles: only an upper bound on κ_c is known; "
        f"the loss is larger and κ_c smaller than drawn.\n{findings}"
    )


def _draw_losses(axes, rows, curve, i, options):
    axes.plot(curve.frequency, curve.predicted_loss, lw=0.8, color=options["color"])
    _draw_points(axes, rows, rows.loss, rows.least_loss, rows.most_loss, i, options)


def _draw_largest_kick(axes, rows, curve, i, options):
    by = (1 + rows.depth) / rows.attrs["golden"]
    values, lower, upper = (by * rows[name] for name in ("critical_scale", "lower", "upper"))
    bound = (1 - curve.adiabatic_loss) * (1 + curve.depth)
    axes.plot(curve.frequency, bound, "--", lw=0.8, color=options["color"])
    _draw_points(axes, rows, values, lower, upper, i, options)


def _draw_points(axes, rows, values, lower, upper, i, options):
    """Draw values with their brackets; if only one end of a bracket is known, draw that end."""
    marker = {"marker": _MARKERS[i % len(_MARKERS)], "ms": 4, "ls": ""}
    axes.plot(rows.frequency, values, **marker, **options)
    ends = lower.values, upper.values
    style.draw_brackets(axes, rows.frequency.values, *ends, options["color"])


def _mark_resonances(axes, theory):
    above = {"xycoords": axes.get_xaxis_transform(), "textcoords": "offset points"}
    for mode, place in zip(theory.mode.values, theory.resonance.values, strict=True):
        axes.axvline(place, color="0.8", lw=0.6, zorder=0)
        axes.annotate(f"{mode}", (place, 1), (0, 2), ha="center", fontsize="x-small", **above)
