"""Claims about periodic orbits (Sec. IV)."""

import numpy as np

from nasm import fixed_points
from nasm.action import ordered_orbits
from nasm.maps import TWO_PI, kick, step, step_tangent, unkick
from pipeline.sweep.grid import parse_axis
from workflows.claims.map import both_kicks
from workflows.claims.rules import identity
from workflows.shared.judgement import grade
from workflows.shared.period_one import secondary_dataset


def periodic_claims():
    """Judge the claims of Sec. IV."""
    kappas = np.random.default_rng(2).uniform(-4, 4, (2, 500))
    half, total, apart = kappas.prod(0) / 2, kappas.sum(0), kappas[0] - kappas[1]
    printed = np.stack([-total - half, total - half, half - apart, apart + half])
    residue, points = fixed_points.primary_residue(*kappas), fixed_points.PRIMARY
    tangents = np.array([[step_tangent(kappa, x, y) for kappa in kappas.T] for x, y in points])
    of_tangents = (2 - np.trace(tangents, axis1=-2, axis2=-1)) / 4
    off = max(np.abs(residues - printed / 2).max() for residues in (residue, of_tangents))
    # The boundary between complex and real eigenvalues has measure zero: no sample lies on it.
    stable = np.abs(np.linalg.eigvals(tangents).imag).min(axis=-1) > 0
    wrong = int((stable != ((printed > 0) & (printed < 2))).sum())
    # P3 maps points I, II, III, IV to II, I, IV, III; P4 maps them to III, IV, I, II.
    permutations = ((-1, -1), [1, 0, 3, 2]), ((1, -1), [2, 3, 0, 1])
    asymmetry = max(
        np.abs(fixed_points.primary_residue(*(kappas.T * signs).T) - residue[order]).max()
        for signs, order in permutations
    )
    return {
        **_carried_orbits(),
        "six_orbits": _six_orbits(),
        "primary_residues": identity(off, 1e-13),
        "primary_stable": grade({"wrong": wrong, "cases": printed.size}, wrong == 0),
        "primary_symmetric": identity(asymmetry, 1e-13),
        **_secondary_orbits(),
    }


def _carried_orbits():
    """Compare orbits for several p/q under κ1 > κ2 > 0 with their images under swapped kicks."""
    worst, residues = 0.0, 0.0
    for kappa in ((0.5, 0.3), (0.8, 0.1), (0.35, 0.3)):
        for p, q in ((1, 2), (1, 3), (2, 5), (5, 8)):
            _, minimax = ordered_orbits(kappa, p, q)
            z = [points[0] for points in minimax.points()]
            w = unkick(kappa[1], *z)
            first, second = _period(kappa, *z, p, q), _period(kappa[::-1], *w, p, q)
            worst = max(worst, first[0], second[0])
            residues = max(residues, abs(first[1] - second[1]))
    return {
        "carried_orbits": identity(worst, 1e-12, "12 orbits close within"),
        "carried_residues": identity(residues, 1e-12, "largest difference of residues"),
    }


def _period(kappa, x, y, p, q):
    """Return by how much an orbit fails to close after q steps and p turns, and its residue."""
    period = np.tile(kappa, q)
    end_x, end_y = step(period, x, y)
    return max(abs(end_x - p - x), abs(end_y - y)), fixed_points.residue(period, x, y)


def _six_orbits():
    """Count sign changes of y' - y = x' - x - m on the curves 2y = m - (κ1/2π) sin 2πx."""
    first, second = np.random.default_rng(3).uniform(-1, 1, (2, 200, 1, 1))
    x, m = (np.arange(4000) + 0.5) / 4000, np.array([[-1], [0], [1]])
    y = (m - first / TWO_PI * np.sin(TWO_PI * x)) / 2
    rise = kick(second, *kick(first, x, y))[1] - y
    counts = np.count_nonzero(rise * np.roll(rise, 1, axis=-1) < 0, axis=-1)
    six, four = int(counts.sum(axis=1).min()), int(counts[:, 1:].sum(axis=1).min())
    return grade({"six": six, "four": four}, four == 6, six == 6)


def _secondary_orbits():
    secondary = secondary_dataset(parse_axis("0:8:80"))
    kappa1, kappa2 = np.meshgrid(secondary.kappa1, secondary.kappa2)
    exists = np.isfinite(secondary.z.values)
    primary = fixed_points.primary_residue(kappa1, kappa2)[1]
    x, y, residue = (secondary[name].values[exists] for name in ("x", "y", "residue"))
    off = np.abs(both_kicks((kappa1[exists], kappa2[exists]), x, y) - [x, y]).max()
    stable, near = (residue > 0) & (residue < 1), primary[exists] > -0.25
    elsewhere = int((exists != (primary < 0)).sum())
    z2, *estimates = cubic_estimates(1e-3)
    as_printed, corrected = (abs(estimate - z2) for estimate in estimates)
    return {
        "secondary": identity(off, 1e-12, f"{exists.sum()} points are fixed within"),
        "cubic_estimate": grade(
            {"z2": z2, "printed": as_printed, "corrected": corrected},
            as_printed < z2**1.5,
            corrected < z2**1.5,
        ),
        "secondary_region": grade({"elsewhere": elsewhere, "cells": exists.size}, elsewhere == 0),
        "secondary_stable": grade(
            {"all": stable.mean(), "near": stable[near].mean()},
            stable.all(),
            stable[near].all(),
        ),
    }


def cubic_estimates(epsilon):
    """Return z² from Eq. (38b), its printed and corrected estimates, for κ1 = κ2 = 4 + epsilon."""
    kappa = 4 + epsilon
    exact = float(fixed_points.secondary(kappa, kappa)[0][0]) ** 2
    denominator = kappa - kappa**2 / 2 + kappa * (1 - kappa / 2) ** 3
    as_printed = (12 * kappa + 3 * kappa**2) / denominator
    return exact, as_printed, float(fixed_points.cubic_estimate(kappa, kappa)) ** 2
