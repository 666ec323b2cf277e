"""The breakdown of a circle, from how its norms blow up along the ray κ = s·profile.

The scale of a circle's finest structure is 1/M, with

    M = ‖u‖_{H³} / ‖u‖_{H²}  →  ∞     as  s → s_c.

Near the breakup it is self-similar: if ω has the tail (b_1, …, b_m), there are δ and Λ with

    M(s_c - d/δ) = Λ M(s_c - d),                                              (*)

where Λ is the rate at which m more partial quotients make the denominators of the convergents grow,
and δ the unstable eigenvalue of renormalisation, the same for all circles with that tail. So M blows
up like d^(-ν), ν = log Λ / log δ, times a function that is periodic in log M. The extrapolation
by (*) does not mind that function: it compares scales at which M differs by Λ.
"""

from dataclasses import dataclass

import numpy as np

from nasm import circles, fourier
from nasm.critical import CriticalScale, Status
from nasm.maps import forcing
from nasm.symmetries import shortest
