"""Where do tori of the rotating standard map with irrational Ω break, and what do they look like?

For an irrational Ω the kicks never repeat (arXiv:1606.04824, Sec. VII), and the barriers are tori
over (θ, φ). They are continued to their breakup by Newton's method and certified on finer grids.
By default there are three rotation vectors: one from the tribonacci constant, as in the paper's
Fig. 11, and two from √2 and the golden mean.

Writes two cubes, a table and two figures to OUT. The defaults take about eight CPU minutes; --quick
takes half a minute.
"""

import click

from workflows.shared.cli import command, preset, real, sweeps, whole

VECTORS = (
    (0.5436890126920764, 0.8392867552141612),
    (0.222084, 0.6180339887498949),
    (0.6180339887498949, 0.2700907567377265),
)
_VECTOR = {"default": VECTORS, "metavar": "OMEGA FREQUENCY"}
_VECTOR["show_default"] = "one from the tribonacci constant, and two from √2 and the golden mean"
_VECTOR["help"] = "Rotation vector: turns of θ and φ per kick. May be repeated."


@command()
@click.option("--vector", type=(float, float), multiple=True, **_VECTOR)
@whole("--n-rays", 13, 2, 10**5, "Rays from 0 to 90 degrees; the sign of Δκ only shifts φ0.")
@real("--tol", 1e-3, 1e-5, 0.2, "Target error of the scales.")
@real(
    "--picture-angle", 45.0, 0, 90, "Ray, in degrees, for pictures of tori with the first vector."
)
@preset("--quick", "A preview", n_rays=3, tol=0.05)
@sweeps
def main(run, vector, n_rays, tol, picture_angle):
    import numpy as np

    from pipeline.cubes import rotating_maps
    from pipeline.cubes.cube import untiled
    from workflows.figures import tori as figures

    vector = list(dict.fromkeys(vector))
    job = rotating_maps.breakups(vector, np.union1d(np.linspace(0, 90, n_rays), picture_angle), tol)
    with run.sweeping(job):
        breakups = run.sweep(job).load()
        run.table("tori", breakups)
        caption = figures.breakups_caption(breakups)
        run.figure("tori", figures.draw_breakups, breakups, caption=caption)
        known = float(breakups.lower.isel(vector=0).sel(angle=picture_angle))
        if np.isnan(known):
            ray = f"On the ray at {picture_angle:g}°"
            run.say(f"{ray} no torus with the first vector was certified.")
            return
        scales = [part * known for part in (0.7, 0.95, 0.99)]
        drawn = untiled(
            "torus", rotation_vector=list(vector[0]), angle=picture_angle, scales=scales
        )
        drawn = run.kept(drawn, lambda: rotating_maps.pictures(vector[0], picture_angle, scales))
        caption = figures.pictures_caption(drawn)
        run.figure("tori_pictures", figures.draw_pictures, drawn, caption=caption)
