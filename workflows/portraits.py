"""What do the orbits look like? Phase portraits of T_{κ1κ2}, Figs. 1 and 2.

Fig. 1: T_{κ1κ2} and T_{κ2κ1} beside the nonautonomous map itself (arXiv:1606.04824, Eq. (nas_map)),
every kick of which is seen. After an even number of kicks its orbits are those of T_{κ1κ2}, after
an odd one those of T_{κ2κ1}, so that in one plane they cross. Fig. 2: four forcings that the
symmetries of Sec. III take to each other, each iterated on its own from the images of the same
starts.
"""

import click

from workflows.cli import HELP, driver
from workflows.labelled import labelled

FORCING = (0.35, 0.5)
ISLAND = (0.0, 0.55)  # Fig. 1(d): a start in the island of (0, 1/2)
SYMMETRIC_FORCING = (0.5, 0.7)
# Fig. 2: in the island of (1/2, 0), in the chain of ω = 2/3, and in the island of (0, 1/2).
MARKED = ((0.5, 0.12), (0.5, 0.36), (0.0, 0.44))

_BY_STEP = "forcing", "step", "orbit"


def nonautonomous_dataset(n_orbits, steps):
    """T_{κ1κ2}, T_{κ2κ1} and the nonautonomous map from the same starts; one orbit in an island.

    x, y with dims (forcing, step, orbit); kick_x, kick_y (kick, orbit); island_x, island_y (kick).
    """
    import numpy as np

    from nasm import orbits

    forcings = np.array([FORCING, FORCING[::-1]])
    x, y = np.stack([orbits.portrait(kappa, n_orbits, steps) for kappa in forcings], axis=1)
    kicked = orbits.kicked_orbit(FORCING, x[0, 0], y[0, 0], steps)
    island = orbits.kicked_orbit(FORCING, *ISLAND, steps)
    return labelled(
        "Orbits of T and of the nonautonomous map",
        {
            "forcing": _numbered(2, "forcing"),
            "step": _numbered(steps + 1, "steps of two kicks"),
            "kick": _numbered(steps + 1, "kicks of the first forcing"),
            "orbit": _numbered(n_orbits, "orbit"),
        },
        {
            **_strengths(forcings),
            **_points("", _BY_STEP, x, y),
            **_points("kick_", ("kick", "orbit"), *kicked),
            **_points("island_", ("kick",), *island),
        },
        source="arXiv:1606.04824, Sec. II and Fig. 1",
    )


def images(kappa, x, y):
    """(κ, x, y) and its images by `negate`, by both, and by `alternate`: the order of Fig. 2."""
    from nasm.symmetries import alternate, negate

    alternated = alternate(kappa, x, y)
    return [(kappa, x, y), negate(kappa, x, y), negate(*alternated), alternated]


def symmetric_dataset(n_orbits, steps):
    """Four symmetric forcings: x, y with dims (forcing, step, orbit), marked_x, marked_y likewise.

    `difference` is how far the marked orbits are from the images of the first forcing's.
    """
    import numpy as np

    from nasm import orbits

    def iterated(x, y):
        starts = images(SYMMETRIC_FORCING, x, y)
        return np.stack([orbits.orbit(*start, steps) for start in starts], axis=1)

    starts = orbits.portrait(SYMMETRIC_FORCING, n_orbits, 0)
    marked = iterated(*np.transpose(MARKED))
    ideal = images(SYMMETRIC_FORCING, *marked[:, 0])
    apart = marked - np.stack([points for _, *points in ideal], axis=1)
    apart = np.abs(apart - np.rint(apart)).max(axis=(0, 2, 3))
    words = "largest distance, mod 1, of marked orbits from the images of the first forcing's"
    return labelled(
        "Symmetric orbits of T",
        {
            "forcing": _numbered(4, "forcing"),
            "step": _numbered(steps + 1, "steps of two kicks"),
            "orbit": _numbered(n_orbits, "orbit"),
            "marked": _numbered(len(MARKED), "marked orbit"),
        },
        {
            **_strengths([kappa for kappa, *_ in ideal]),
            **_points("", _BY_STEP, *iterated(*(start[0] for start in starts))),
            **_points("marked_", ("forcing", "step", "marked"), *marked),
            "difference": (("forcing",), apart, words),
        },
        source="arXiv:1606.04824, Sec. III.A and Fig. 2",
    )


def _numbered(n, words):
    return range(n), words, "1"


def _strengths(forcings):
    kicks = zip(("first", "second"), zip(*forcings, strict=True), strict=True)
    return {
        f"kappa{i}": (("forcing",), list(strengths), f"strength of the {kick} kick")
        for i, (kick, strengths) in enumerate(kicks, 1)
    }


def _points(prefix, dims, x, y):
    return {f"{prefix}x": (dims, x % 1.0, "x mod 1"), f"{prefix}y": (dims, y % 1.0, "y mod 1")}


@click.command(context_settings=HELP)
@click.option(
    "--n-orbits",
    default=48,
    show_default=True,
    type=click.IntRange(2, 1000),
    help="Orbits of each portrait, from the lines x = 0 and x = 1/2.",
)
@click.option(
    "--steps",
    default=1000,
    show_default=True,
    type=click.IntRange(1, 100_000),
    help="Steps of each orbit, and kicks of the nonautonomous map's.",
)
@click.option("--out", default="out", show_default=True, help="Directory of the results.")
def main(out, n_orbits, steps):
    """Phase portraits: two cubes and two figures in OUT. A few seconds."""
    with driver(out):
        from pipeline import store
        from pipeline.cubes.cube import Cube
        from workflows.figures import portraits as figures
        from workflows.figures.style import save

        settings = {"n_orbits": n_orbits, "steps": steps}
        cubes = [
            Cube("portraits", nonautonomous_dataset(n_orbits, steps), {}, settings),
            Cube("portraits_symmetry", symmetric_dataset(n_orbits, steps), {}, settings),
        ]
        for cube in cubes:
            store.refuse_different(out, cube)
        for cube in cubes:
            store.replace(out, cube)
        kicks, symmetry = (cube.template for cube in cubes)
        drawn = save(figures.draw_kicks(kicks), out, "portraits", figures.describe_kicks(kicks))
        drawn += save(
            figures.draw_symmetry(symmetry),
            out,
            "portraits_symmetry",
            figures.describe_symmetry(symmetry),
        )
    click.echo(f"cubes:   {out}/cubes.zarr, groups portraits and portraits_symmetry")
    click.echo(f"figures: {', '.join(drawn)}")


if __name__ == "__main__":
    main()
