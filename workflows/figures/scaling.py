"""Efficiency of the pipeline."""

import matplotlib.pyplot as plt

from workflows.figures.style import CIRCLE_COLOURS


def draw_scaling(measured, simulated, model):
    """Efficiency against the time of a tile: measured, simulated, and predicted."""
    figure, panels = plt.subplots(1, 3, figsize=(15, 4.8), layout="constrained", sharey=True)
    here, crowd, cluster = panels
    for i, workers in enumerate(measured.workers.values):
        for n, marker in zip(measured.tiles.values, "ov^s", strict=False):
            row = measured.sel(workers=workers, tiles=n).dropna("cost", subset=["wall"])
            label = f"{_count(workers)}, {n} tiles"
            _draw_efficiency(here, row, CIRCLE_COLOURS[i], marker, label)
    for i, workers in enumerate(simulated.workers.values):
        row = simulated.sel(workers=workers)
        _draw_efficiency(crowd, row, CIRCLE_COLOURS[i], "o", _count(workers))
    for i, workers in enumerate(model.workers.values):
        row = model.efficiency.sel(workers=workers)
        colour = "k" if i == 0 else CIRCLE_COLOURS[i - 1]
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
