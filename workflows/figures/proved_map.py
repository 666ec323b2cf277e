"""The map of forcings for which transport is proved to be global."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import ListedColormap


def draw_proved_map(cube, barrier):
    """Draw the four quadrants of the plane, and CB_gt by residues as a line; and the caption.

    cube : `proved_map`; its half κ2 > κ1 is filled by reflection. barrier : CB_gt from 0° to 45°.
    """
    flags = cube.proved.attrs
    proved = dict(zip(flags["flag_meanings"].split(), flags["flag_values"], strict=True))
    transport = np.triu(cube.proved.values == proved["transport_is_global"])
    transport |= transport.T
    whole = np.block([[transport[::-1, ::-1], transport[::-1]], [transport[:, ::-1], transport]])
    figure, axes = plt.subplots(figsize=(7.5, 7), layout="constrained")
    reach = float(cube.kappa1[-1] + cube.kappa1[0])
    style = {"origin": "lower", "extent": 2 * (-reach, reach), "interpolation": "nearest"}
    axes.imshow(whole, cmap=ListedColormap(["0.92", "#E69F00"]), vmin=0, vmax=1, **style)
    x = np.append(barrier.kappa1, barrier.kappa2[::-1])
    y = np.append(barrier.kappa2, barrier.kappa1[::-1])
    for sign1, sign2 in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        axes.plot(sign1 * x, sign2 * y, color="black", lw=0.8)
    axes.set(xlabel=r"$\kappa_1$", ylabel=r"$\kappa_2$", aspect="equal")
    axes.set_title("Transport is proved to be global (orange)")
    return figure, _caption(cube, transport, barrier)


def _caption(cube, transport, barrier):
    kappa1, kappa2 = np.meshgrid(cube.kappa1, cube.kappa2)
    angle = np.rad2deg(np.arctan2(kappa2, kappa1))
    excess = np.hypot(kappa1, kappa2) / np.interp(angle, barrier.angle, barrier.critical_scale) - 1
    wedge = (kappa2 <= kappa1) & (excess > 0)
    open_ = excess[wedge & ~transport]
    return (
        f"Transport is proved to be global for every forcing of {100 * transport[wedge].mean():.1f}"
        f"% of the square beyond CB_gt (line: by residues, no proof), in cells down to "
        f"1/{cube.attrs['cells']}. Half of the open area there is within "
        f"{100 * np.median(open_):.1g}% of the boundary, 95% within "
        f"{100 * np.quantile(open_, 0.95):.2g}%, all within {100 * open_.max():.2g}%. Inside CB_gt "
        "all is open here: proofs that a barrier exists are of single forcings."
    )
