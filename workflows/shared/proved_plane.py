"""Proofs in a plane: sweeps of cells with transport, and of triangles below CB_gt.

The proofs (see `nasm.proofs.cells`) cover the plane's fundamental domain, `wedge`; its images
under the symmetries cover the rest.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from nasm.barriers import critical_scale
from nasm.planes import Plane
from nasm.types import FloatArray
from pipeline.cubes.barrier import last_barrier, unfolded
from pipeline.cubes.cube import Job
from pipeline.cubes.proved import proved_map, proved_triangles
from workflows.shared.run import Run

_N_RAYS = 91  # number of rays on which CB_gt is computed first


@dataclass(frozen=True)
class ProvedPlane:
    """Settings of the proofs.

    Attributes
    ----------
    plane : Plane
        The plane of forcings.
    cells : int
        Number of cells per unit of strength at the finest level.
    seconds : float
        Limit on the CPU time for the proof of each cell.
    distance : float
        Relative distance from the boundary at which proofs of barriers stop.
    """

    plane: Plane
    cells: int
    seconds: float
    distance: float

    @property
    def angles(self) -> FloatArray:
        """Directions of the rays, in degrees, on which CB_gt is computed."""
        return np.linspace(*self.plane.wedge, _N_RAYS)

    @property
    def barriers(self) -> Job:
        """The job that computes the last barriers on rays, from which the proofs start.

        Their tolerance is small compared with the distance at which proofs of barriers stop.
        """
        return last_barrier(self.plane, self.angles, min(self.distance / 25, 0.01))

    def later(self) -> list[Job]:
        """Return jobs of about the same cost as the jobs that depend on the results of `barriers`.

        They predict the computing time, and are planned from seven rays in a second or two.
        """
        few = self.angles[:: _N_RAYS // 6].tolist()
        origin, profiles = self.plane.ray(few)
        start = origin if origin.any() else None
        last = [critical_scale(profile, 0.1, start) for profile in profiles]
        guess = [(angle, each.value) for angle, each in zip(few, last, strict=True)]
        return self._jobs(guess, [str(each.omega or "") for each in last])

    def swept(self, run: Run) -> tuple[xr.Dataset, xr.Dataset, xr.Dataset]:
        """Sweep the cells, the triangles, and CB_gt in the wedge; call it inside `run.sweeping`."""
        barrier = unfolded(run.sweep(self.barriers), self.angles)
        known = barrier.dropna("angle", subset=["critical_scale"])
        names = "angle", "critical_scale", "circle"
        at, scales, circles = (known[name].values.tolist() for name in names)
        jobs = self._jobs(list(zip(at, scales, strict=True)), circles)
        cells, triangles = (run.sweep(job).load() for job in jobs)
        return cells, triangles, barrier

    def _jobs(self, rays: Sequence[Sequence[float]], circles: Sequence[str]) -> list[Job]:
        return [
            proved_map(self.plane, rays, self.cells, self.seconds),
            proved_triangles(self.plane, rays, circles, self.distance),
        ]
