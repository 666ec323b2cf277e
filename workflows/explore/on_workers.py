"""What workers run for the explorer, besides escape times (`field`) and rays (`rays`).

A worker imports the modules of the functions that it runs. These do not import Bokeh, xarray or
dask.array, which together take a second.
"""

import time

import numpy as np

from nasm import escape, orbits
from nasm.verdicts import verdict


def load_portrait_kernels():
    """Use the kernels for escape times and portraits once; this may compile them."""
    kappa, x, y = np.array([0.3, 0.2]), np.array([0.5]), np.array([0.1])
    escape.first_escape([kappa], *escape.ensemble(1), [1], 1, precision="single")
    orbits.orbit(kappa, x, y, 1)
    orbits.passages(kappa, x, y, 1, (0.0, 0.0, 1.0, 1.0))
    orbits.rotation_number(kappa, x, y, 4)


def load_verdict_kernels():
    """Use the kernels for verdicts once."""
    verdict((0.3, 0.2))


def timed_verdict(kappa):
    """Return the verdict on a forcing, and its computing time in seconds."""
    begin = time.perf_counter()
    return verdict(kappa), time.perf_counter() - begin
