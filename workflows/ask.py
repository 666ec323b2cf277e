"""Is transport global under this one forcing, or does a barrier stop it?

The verdict of `nasm.verdict` in plain sentences, and a phase portrait with what decides: the
circle, or an orbit that escapes. One forcing, no sweep.
"""

import os

import click

from workflows.parts.cli import announce_kernels, command, out_option

_STARTS, _STEPS = 64, 10**6  # of direct iteration; it only illustrates
_NEAR = 0.96  # where the boundary is nearer, no orbit escapes: none did on 12 rays, 4% beyond
_INSIDE = 0.95  # of the breakup, where the last circle is drawn that broke


def escaping_orbit(kappa):
    """Return x, y of an orbit up to its escape from the paper's window, or None.

    The starts that escape first in one arithmetic are followed in another: chaos lets few of them
    do so at the same step, but most do.
    """
    import numpy as np

    from nasm import escape, orbits

    x, y = escape.ensemble(_STARTS)
    times = escape.escape_time(kappa, x, y, _STEPS)
    lo, hi = escape.PAPER_WINDOW
    for start in np.argsort(times, kind="stable")[:4]:
        if np.isfinite(times[start]):
            orbit = orbits.orbit(kappa, x[start], y[start], min(4 * int(times[start]), _STEPS))
            outside = (orbit[1] < lo) | (orbit[1] > hi)
            if outside.any():
                return tuple(values[: outside.argmax() + 1] for values in orbit)
    return None


def portrait_of(kappa, verdict, escaping):
    """Return what `draw_verdict` takes: orbits, and the circle, or where the last one was."""
    import numpy as np

    from nasm import circles, orbits
    from nasm.verdict import Answer

    x, y = orbits.portrait(kappa, 80, 600)
    boundary, lost = verdict.boundary, None
    if verdict.answer is Answer.TRANSPORT and boundary.omega is not None and boundary.value > 0:
        scale = _INSIDE * boundary.value
        found = circles.invariant_circle(boundary.omega, scale * np.array(kappa), n_max=2048)
        lost = (scale, *circles.graph(found)) if found.certified else None
    return {
        "kappa": kappa,
        "answer": verdict.answer.value,
        "x": x,
        "y": y,
        "rotation": orbits.rotation_number(kappa, x[0], y[0], 2000)[0],
        "omega": str(boundary.omega or ""),
        "circle": verdict.circle,
        "lost": lost,
        "escaping": escaping,
        "bracket": (boundary.lower, boundary.value, boundary.upper),
    }


def sentences(kappa, verdict, escaping):
    """Put the verdict into words, a list of lines."""
    from nasm.verdict import Answer, Evidence

    boundary, omega = verdict.boundary, verdict.boundary.omega
    meaning, circle = {
        Answer.BARRIER: (
            "a rotational invariant circle is left; no orbit gets past it",
            "The circle",
        ),
        Answer.TRANSPORT: (
            "no rotational invariant circle is left; transport in y is global",
            "The last circle to break on the ray was that",
        ),
        Answer.UNDECIDED: (
            "neither a barrier nor transport could be shown",
            "The last circle to break on the ray is that",
        ),
    }[verdict.answer]
    lines = [f"{verdict.answer.name} at (kappa1, kappa2) = ({kappa[0]}, {kappa[1]}): {meaning}."]
    if omega is not None:
        number = f"omega = {omega} = {float(omega):.12g} per step"
        lines.append(f"{circle} of {number} (likewise all ±omega + 2n).")
    lines.append(f"Evidence: {verdict.evidence.value}.")
    if verdict.proof is not None and not verdict.proof.proved:
        lines.append(f"A proof was tried: {verdict.proof.why}.")
    if verdict.steps < float("inf"):
        lines.append(f"The longest-lived start is eliminated after {verdict.steps:g} steps.")
    if verdict.evidence is not Evidence.INTEGRABLE:
        lines += _distance(boundary)
    if escaping is not None:
        x, y = escaping[0][0], escaping[1][0]
        lines.append(
            f"Direct iteration: the orbit from (x, y) = ({x:.6g}, {y:.6g}) arrives at "
            f"y = {escaping[1][-1]:.3g} after {escaping[0].size - 1} steps."
        )
    elif verdict.answer is Answer.TRANSPORT:
        lines.append(
            "Direct iteration shows nothing: it is too slow this near the boundary."
            if boundary.value > _NEAR
            else f"Direct iteration: no escape seen of {_STARTS} orbits in {_STEPS} steps; that "
            "shows nothing."
        )
    return lines


def _distance(boundary):
    """Say where the last circle breaks on the ray, in multiples of the strengths asked about."""
    from math import isfinite

    lines = []
    if isfinite(boundary.value):
        lines.append(
            f"It breaks at {boundary.value:.12g} times these strengths, ±{boundary.error:.1g}, by "
            "Greene's residue (a criterion, not a proof)."
        )
    else:
        lines.append(f"Where the last one breaks on the ray is not known: {boundary.status.value}.")
    if isfinite(boundary.lower):
        lines.append(f"A circle is certified at {boundary.lower:.9g} times these strengths.")
    if isfinite(boundary.upper):
        lines.append(
            f"At {boundary.upper:.9g} times these strengths converse KAM finds no circle at all."
        )
    return lines


@command(ignore_unknown_options=True)
@click.argument("kappa1", type=float)
@click.argument("kappa2", type=float)
@click.option("--prove", is_flag=True, help="Prove the answer, if 20 s are enough.")
@out_option
def main(kappa1, kappa2, prove, out):
    """Transport or barrier under kicks of strengths KAPPA1, KAPPA2 in turn? With a portrait in OUT.

    Strengths are dimensionless, -1e6 to 1e6, and may be negative: -0.69 0.525. The answer may be
    UNDECIDED, within a few parts in 10^5 of the boundary; the exit code is 0 for all three. It
    takes about two seconds, and the first time on a machine twenty more to compile the kernels.
    """
    from nasm.maps import forcing
    from nasm.verdict import Answer, verdict

    kappa = (kappa1, kappa2)
    try:
        forcing(kappa)
        os.makedirs(out, exist_ok=True)
    except ValueError as error:
        raise click.UsageError(str(error)) from None
    except OSError as error:
        raise click.UsageError(f"--out={out}: {error.strerror}; choose another directory") from None
    announce_kernels()
    found = verdict(kappa, prove)
    transport = found.answer is Answer.TRANSPORT
    far = not found.boundary.value > _NEAR  # NaN: not known to be near
    escaping = escaping_orbit(kappa) if transport and far else None
    told = "\n".join(sentences(kappa, found, escaping))
    click.echo(told)

    from workflows.figures.ask import draw_verdict
    from workflows.figures.style import save

    figure = draw_verdict(portrait_of(kappa, found, escaping))
    click.echo(f"figures: {', '.join(save(figure, out, f'ask_{kappa1}_{kappa2}', told))}")


if __name__ == "__main__":
    main()
