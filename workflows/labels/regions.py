"""Certificates for the answers: each covers a cell or patch of the proved map, or one forcing."""

from fractions import Fraction
from functools import cache

import numpy as np

from nasm.proofs import cells as proved_cells
from pipeline import store
from pipeline.cubes import proved
from pipeline.store.tiles import arrays_of
from workflows.labels.study import BARRIER, TRANSPORT


def in_map(place, cells, triangles, forcings):
    """Find, for each forcing, a certificate of the proved map whose region contains the forcing.

    All comparisons are exact, so the certificate proves the answer for these floats.

    Returns
    -------
    dict of int to (label, certificate, file)
        For each forcing inside such a region, under its number: the answer, the certificate's
        SHA-256, and its file.
    """
    found, (width, _) = {}, arrays_of(place, "proved_map")["proved"].chunks  # cells of a tile
    patches = _patches(place, triangles.sizes["triangle"])

    @cache
    def squares(key):
        return [square_of(each) for each in proved.unpack_certificates(place.read(key))]

    for i, (kappa1, kappa2, margin) in enumerate(_rows(forcings)):
        if margin > 0:
            column, row = (int(kappa * cells.attrs["cells"]) for kappa in (kappa1, kappa2))
            if max(column, row) >= cells.sizes["kappa1"]:
                continue
            if int(cells.proved[row, column]) == proved_cells.TRANSPORT:
                key = store.certificates_key("proved_map", (row // width, column // width))
                known = (name for name, covers in squares(key) if covers(kappa1, kappa2))
                if name := next(known, None):
                    found[i] = TRANSPORT, name, key
        else:
            known = (each for each in patches if each[2](kappa1, kappa2))
            if patch := next(known, None):
                found[i] = BARRIER, *patch[:2]
    return found


def _rows(forcings):
    return np.stack([forcings.kappa1, forcings.kappa2, forcings.margin], -1).tolist()


def square_of(certificate):
    """Return the name of a cell's certificate, and a function that tests if a forcing is inside."""
    centre, half = (proved.floats_of(certificate, name) for name in ("kappa", "half_width"))
    ends = [
        (Fraction(middle) - Fraction(width), Fraction(middle) + Fraction(width))
        for middle, width in zip(centre, half, strict=True)
    ]

    def covers(*kappa):
        return all(low <= k <= high for k, (low, high) in zip(kappa, ends, strict=True))

    return certificate["sha256"], covers


def _patches(place, n):
    """List (name, file, `patch_of`) for every certificate of a triangle."""
    keys = [store.certificates_key("proved_triangles", (i,)) for i in range(n)]
    return [
        (each["sha256"], key, patch_of(each))
        for key in keys
        for each in proved.unpack_certificates(place.read(key))
    ]


def patch_of(certificate):
    """Return a function that tests if κ = s(a + tb), |t| ≤ 1, with s between the patch's scales."""
    names = "kappa", "tilt", "scales"
    a, b, (low, high) = (
        [Fraction(number) for number in proved.floats_of(certificate, name)] for name in names
    )
    determinant = a[0] * b[1] - a[1] * b[0]

    def covers(*kappa):
        k = [Fraction(strength) for strength in kappa]
        s = (k[0] * b[1] - k[1] * b[0]) / determinant
        st = (a[0] * k[1] - a[1] * k[0]) / determinant
        return low <= s <= high and abs(st) <= s

    return covers


def by_own_proofs(place, job, sources):
    """Find the certificates of forcings with individual proofs, in the format of `in_map`.

    job : the job for all forcings that are not in `sources`, the result of `in_map`.
    """
    cube, found = store.read(place, job.cube.name).load(), {}
    total = cube.sizes["forcing"] + len(sources)
    numbers = [i for i in range(total) if i not in sources]
    for tile, number in enumerate(numbers):
        label = {proved.BARRIER: BARRIER, proved_cells.TRANSPORT: TRANSPORT}
        if answer := label.get(int(cube.proved[tile])):
            key = store.certificates_key(job.cube.name, (tile,))
            (certificate,) = proved.unpack_certificates(place.read(key))
            found[number] = answer, certificate["sha256"], key
    return found
