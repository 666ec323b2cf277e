"""Schedules of faults, by seed; see campaign.py. A failing one is run again by its seed,

`python -m pytest tests/test_campaign.py -s -m "slow or not slow" -k pool--117-`, which decides the
faults and when they come; processes keep their own time, as ever.
"""

from collections import Counter

import campaign
import pytest
import seaweed


@pytest.fixture(scope="module")
def report():
    report = Counter()
    yield report
    print("\n" + ", ".join(f"{what}: {n}" for what, n in report.items()))


@pytest.fixture(scope="module")
def pool():
    with campaign.pool() as pool:
        yield pool


@pytest.fixture(scope="module")
def own():
    with campaign.own() as pool:
        yield pool


SLOW = pytest.mark.slow
OWN = campaign.kill_driver, campaign.interrupt  # they reach the driver's own workers
EACH = [
    pytest.param("own" if fault in OWN else "pool", fault, marks=SLOW) for fault in campaign.ENDS
]


@pytest.mark.parametrize(("workers", "fault"), EACH)
def test_a_fault_ends_a_run_as_it_should_and_the_next_completes_the_cube(
    tmp_path, request, workers, fault
):
    pool = request.getfixturevalue(workers)
    codes = campaign.carry_out(0, tmp_path, pool, Counter(), faults=[[(0.2, fault)]])
    # The pool has another worker, and of two drivers the first goes on.
    survived = fault in (campaign.kill_worker, campaign.second_driver)
    assert codes == [0 if survived else campaign.ENDS[fault], 0]


@pytest.fixture(scope="module")
def remote(tmp_path_factory):
    """A pool with the credentials of an object store."""
    with seaweed.serving(tmp_path_factory.mktemp("weed")), campaign.pool() as pool:
        yield pool


SCHEDULES = [("pool", 49)]  # of a killed driver, a killed worker and a flipped bit
SCHEDULES += [pytest.param("pool", n, marks=SLOW) for n in range(100, 300)]
SCHEDULES += [pytest.param("own", n, marks=SLOW) for n in range(300, 306)]
SCHEDULES += [pytest.param("remote", n, marks=SLOW) for n in range(400, 420)]


@pytest.mark.parametrize(("workers", "seed"), SCHEDULES, ids=lambda value: f"{value}-")
def test_a_sweep_outlives_a_schedule_of_faults(tmp_path, report, request, workers, seed):
    url = f"s3://cubes/campaign{seed}" if workers == "remote" else None
    campaign.carry_out(seed, tmp_path, request.getfixturevalue(workers), report, url)
