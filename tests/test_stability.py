"""Where methods stop being right: quick runs of the studies keep their promises."""

import numpy as np
import pytest

from nasm.critical import Status
from workflows.shared.tables import outcomes
from workflows.stability import limits
from workflows.stability.findings import OK


@pytest.mark.slow
def test_no_method_crosses_the_breakup():
    boundary = limits.past_boundary(quick=True)
    beyond, inside = boundary.sel(excess=slice(0, None)), boundary.sel(excess=slice(None, -1e-9))
    assert (beyond.certified == 0).all()
    assert (inside.isel(excess=0).certified == 1).all()
    assert np.isinf(inside.elimination_time).all()
    assert np.isinf(inside.escape_time).all()
    assert np.isinf(inside.escape_time_single).all()
    assert np.isfinite(beyond.sel(excess=slice(9e-4, None)).elimination_time).all()
    # Weighted Birkhoff averages are no proof of a circle.
    assert (boundary.sel(excess=1e-3, method="nearest").digits > 5).all()


def test_beyond_the_twist_nothing_is_certified():
    twist = limits.beyond_the_twist(quick=True)
    assert outcomes("", [])[2]["flag_meanings"].split()[OK] == Status.OK.name.lower()
    beyond = twist.scale > 1.5
    assert (twist.circle.where(beyond, 0) != OK).all()
    assert np.isfinite(twist.elimination_time.where(beyond, 1)).all()
    assert (twist.twist.sel(angle=90, scale=2.25) < 0).all()
