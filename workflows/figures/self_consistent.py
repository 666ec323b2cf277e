"""The self-consistent field, its particles and its barriers; and a folded asymptotic circle."""

import numpy as np

from workflows.figures.style import COLOURS, VERMILION, dots, legend_below, line_of, panels

_BLUE, _, _GREEN = COLOURS[:3]
_BEGINNING = 250  # number of kicks of the transient to draw


def draw_self_consistent(fields, verdicts, settling):
    """Draw the strength, phase and spectrum, the particles, the verdicts, and the folded curve."""
    figure, (field, phase, spectrum, particles, barriers, folded) = panels(2, 3, 13, 8)
    count = fields.coupling.size
    chosen = sorted({count // 4, count // 2, count - 1})
    for i, coupling in enumerate(fields.coupling.values[chosen]):
        run, row = fields.sel(coupling=coupling), verdicts.sel(coupling=coupling)
        options = {"lw": 0.8, "label": rf"$\Gamma = {coupling:g}$", **line_of(i)}
        field.plot(run.kick[:_BEGINNING], run.kappa[:_BEGINNING], **options)
        settled = slice(fields.kick.size // 2, None)
        deviation = (run.theta - row.drift * run.kick)[settled]
        phase.plot(run.kick[settled], deviation - deviation.mean(), **options)
        spectrum.semilogy(run.frequency[1:], run.spectrum[1:], **options)
    field.set(xlabel="kick $n$", ylabel=r"$\kappa_n$", title="Strength: transient")
    phase.set(xlabel="kick $n$", ylabel=r"$\theta_n - n\,v$ (turns)")
    phase.set_title("Phase minus its drift $v$: second half")
    spectrum.set(xlabel="frequency (turns per kick)", ylabel=r"power of $\kappa_n$")
    spectrum.set_title("Spectrum: second half")
    for axes in (field, phase, spectrum):
        legend_below(axes, 3, 3)

    asked, row = verdicts.attrs["asked"], _strongest(verdicts)
    run, lives = fields.sel(coupling=row.coupling), _lifetime(row, asked)
    particles.plot(run.x, run.y - row.drift, label="particles", **dots("0.4", 1.5))
    for cell in (-1, 0):
        label = f"orbit with a lifetime of {lives} kicks" if cell else None
        particles.plot(row.x, row.y + cell, label=label, **dots(VERMILION, 3))
    particles.set(xlabel=r"$x - \theta$", ylabel="$y - v$", xlim=(0, 1), ylim=(-1.1, 1.1))
    particles.set_title(rf"After the last kick, $\Gamma = {float(row.coupling):g}$")
    legend_below(particles, 2, 1, markerscale=3)

    for name, words, marker, colour in (
        ("kicks_fitted", "fitted periodic forcing", "s", _GREEN),
        ("kicks", "recorded field", "o", _BLUE),
    ):
        kicks, survives = verdicts[name].clip(max=asked), np.isinf(verdicts[name])
        barriers.plot(verdicts.coupling, kicks, f"{marker}-", c=colour, mfc="white", label=words)
        barriers.plot(verdicts.coupling[survives], kicks[survives], marker, c=colour)
    if np.isfinite(verdicts.escape).any():
        barriers.plot(verdicts.coupling, verdicts.escape, "k^", label="first particle to escape")
    barriers.axhline(asked, color="0.6", lw=0.6, ls=":")
    barriers.set(
        xlabel=r"coupling $\Gamma$", ylabel="kicks until all starts are eliminated", yscale="log"
    )
    barriers.set_title("Converse KAM (filled: some starts survive)")
    legend_below(barriers, 2, 1)

    first, later, circle = (settling.isel(curve=i) for i in range(3))
    excluded = settling.excluded.values == 1
    folded.plot(circle.x, circle.y, color="0.6", lw=1, label="limiting circle")
    before = f"before kick {settling.attrs['asked']}"
    folded.plot(later.x, later.y, color=_GREEN, lw=1, label=before)
    for where, colour, words in (
        (~excluded, _BLUE, "before the first kick"),
        (excluded, VERMILION, "excluded by converse KAM"),
    ):
        folded.plot(first.x.values[where], first.y.values[where], label=words, **dots(colour, 2))
    folded.set(xlabel="$x$", ylabel="$y$", title=r"An asymptotic circle for $\kappa_n \to 0.9$")
    legend_below(folded, 2, 2, markerscale=3)
    return figure


def _strongest(verdicts):
    """Return the row of the strongest coupling whose field has a survivor, else the first row."""
    return verdicts.isel(coupling=max(np.flatnonzero(np.isinf(verdicts.kicks.values)), default=0))


def _lifetime(row, asked):
    return f"≥ {asked}" if np.isinf(row.kicks) else f"{float(row.kicks):.0f}"


def self_consistent_caption(fields, verdicts, settling):
    asked, row = verdicts.attrs["asked"], _strongest(verdicts)
    couplings = verdicts.coupling.values

    def where(holds):
        if not holds.any():
            return "for no Γ"
        first = int(holds.argmax())
        if holds[first:].all():
            return f"from Γ = {couplings[first]:g} on"
        return f"for Γ = {', '.join(f'{coupling:g}' for coupling in couplings[holds])}"

    horizon = verdicts.attrs["horizon"]
    recorded = where((verdicts.kicks <= horizon).values)
    fitted, escaped = (where(np.isfinite(verdicts[n].values)) for n in ("kicks_fitted", "escape"))
    first, *_, circle = settling.area.values
    return (
        f"The self-consistent map of {fields.attrs['n_particles']} particles, initially in a band "
        f"of |y| < 0.05, for {fields.attrs['n_max']} kicks at couplings Γ = {couplings[0]:g} to "
        f"{couplings[-1]:g}. Strength (a), phase minus its mean drift v per kick (b), and spectrum "
        f"(c) of the kicks; momentum is conserved to {float(fields.momentum_change.max()):.0e}. "
        "(d) Particles in the frame of the wave, and the orbit of the longest-lived start "
        f"(lifetime {_lifetime(row, asked)} kicks, {float(row.omega):.3f} turns per kick). (e) "
        f"Converse KAM over {asked} kicks in either direction from the middle of the second half. "
        f"It excludes every family of graphs in the recorded field {recorded}. Under the fitted "
        "forcing κ_n = κ̄ + Δκ cos 2π(φ0 + nΩ), with Ω = p/q and the mean and variance of the "
        f"recorded κ_n, it does so {fitted}. Lifetimes beyond {horizon} kicks in the recorded "
        "field count as undecided, because the search may miss longer ones. "
        f"At least one of {fields.particle.size} particles "
        f"moves by more than 2 in y {escaped}. (f) Under κ_n = "
        f"{settling.limit} + {settling.excess} e^(-n/{settling.time}) the coloured curve "
        f"converges to the golden circle of κ = {settling.limit} and bounds the same area, to "
        f"{abs(first - circle):.0e}: it is a barrier. Before the first kick this curve is "
        f"folded, and converse KAM excludes {float(settling.excluded.mean()):.0%} of its points. "
        f"Applied before kick {settling.attrs['asked']}, converse KAM excludes all graphs after "
        f"{float(settling.kicks):.0f} kicks. So the absence of graphs alone does not show "
        "transport; orbits that cross from one side to the other do."
    )
