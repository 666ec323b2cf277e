"""Schedules of faults, by seed; see campaign.py. A failing one is run again by its seed:

`python -m pytest tests/test_campaign.py -s -m "slow or not slow" -k seed117-`. The seed decides the
faults and when they come; processes keep their own time, as ever.
"""

import io
import os
import random
import re
import signal
import socket
import threading
import time
from contextlib import ExitStack, suppress
from urllib.parse import urlsplit

import campaign
import click
import pytest
import toy
from click.testing import CliRunner
from pipeline.cluster import connect
from pipeline.layout import COMMIT
from test_objects import assert_complete, bare, environment, serving
from workflows.cli import cluster_options

from pipeline import store
from pipeline.sweep import sweep

FEW = range(3)
MANY = range(100, 300)
ON_ITS_OWN_WORKERS = range(300, 306)


@pytest.fixture(scope="module")
def report():
    report = campaign.Report()
    yield report
    print(f"\n{report}")


@pytest.fixture(scope="module")
def pool(tmp_path_factory):
    with campaign.pool(tmp_path_factory.mktemp("pool")) as pool:
        yield pool


def seeds(numbers):
    return pytest.mark.parametrize("seed", numbers, ids=lambda seed: f"seed{seed}-")


def test_each_fault_has_its_effect_and_the_sweep_outlives_it(tmp_path, pool):
    report = campaign.Report()
    under_way = [
        (0.05, campaign.slow_store),
        (0.1, campaign.stop_worker),
        (0.15, campaign.jump_clocks),
        (0.2, campaign.cut_chunk),
        (0.2, campaign.flip_bit),
        (0.25, campaign.second_driver),
        (0.3, campaign.kill_worker),
        (0.4, campaign.kill_driver),
    ]
    fatal = [campaign.fill_disk, campaign.move_store, campaign.lose_permissions]
    tiles = [(0.1, campaign.fail_tile), (0.1, campaign.poison)]
    gone = [campaign.interrupt, campaign.kill_scheduler]
    for name, faults in (
        ("one", [under_way, *([(0.2, fault)] for fault in fatal)]),
        ("other", [*([(0.2, fault)] for fault in gone), tiles]),
    ):
        (tmp_path / name).mkdir()
        campaign.carry_out_schedule(0, tmp_path / name, pool, report, faults)
    assert report.faults == dict.fromkeys(map(campaign.words, campaign.WEIGHTS), 1)


@seeds([*FEW, *(pytest.param(seed, marks=pytest.mark.slow) for seed in MANY)])
def test_a_sweep_outlives_a_schedule_of_faults(tmp_path, pool, report, seed):
    campaign.carry_out_schedule(seed, tmp_path, pool, report)


@pytest.mark.slow
def test_a_worker_may_stand_still_for_a_minute(tmp_path, pool, report):
    faults = [[(0.3, campaign.stop_worker_for_a_minute), (0.35, campaign.kill_driver)]]
    campaign.carry_out_schedule(0, tmp_path, pool, report, faults)
    assert report.faults["stop worker for a minute"] == 1


@pytest.mark.slow
@seeds(ON_ITS_OWN_WORKERS)
def test_a_sweep_on_its_own_workers_outlives_a_schedule_of_faults(tmp_path, report, seed):
    campaign.carry_out_schedule(seed, tmp_path, None, report)


class Wire:
    """Between us and a server on this machine: a port of our own, which can be cut."""

    def __init__(self, address):
        self.server = urlsplit(address).port
        self.port, self.ends = 0, []
        self.mend()

    def mend(self):
        self.listening = socket.create_server(("127.0.0.1", self.port))
        self.port = self.listening.getsockname()[1]
        threading.Thread(target=self._accept, args=[self.listening], daemon=True).start()

    def cut(self):
        for end in (self.listening, *self.ends):
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
            end.close()
        self.ends.clear()

    def _accept(self, listening):
        with suppress(OSError):
            while True:
                ours, _ = listening.accept()
                theirs = socket.create_connection(("127.0.0.1", self.server))
                self.ends += [ours, theirs]
                for pair in ((ours, theirs), (theirs, ours)):
                    threading.Thread(target=self._carry, args=pair, daemon=True).start()

    def _carry(self, source, target):
        with suppress(OSError):
            while data := source.recv(2**16):
                target.sendall(data)
            target.shutdown(socket.SHUT_WR)


def records(url):
    """{commit record: its bytes and its time}."""
    shop = bare(f"{url}/cubes.zarr/toy/{COMMIT}/c")
    listed = [entry for page in shop.list() for entry in page]
    return {
        entry["path"]: (bytes(shop.get(entry["path"]).bytes()), entry["last_modified"])
        for entry in listed
    }


@pytest.mark.slow
@seeds(range(400, 403))
def test_a_sweep_outlives_cuts_to_its_object_store_and_its_drivers_death(tmp_path, seed):
    choose = random.Random(seed)
    url = f"s3://cubes/campaign{seed}/run"
    (tmp_path / "pool").mkdir()
    with ExitStack() as stack:
        address, _ = stack.enter_context(serving())
        wire = Wire(address)
        stack.callback(wire.cut)
        stack.enter_context(environment(address))
        variables = {name: value for name, value in os.environ.items() if name.startswith("AWS_")}
        variables["AWS_ENDPOINT_URL"] = f"http://127.0.0.1:{wire.port}"
        pool = stack.enter_context(campaign.pool(tmp_path / "pool", variables))
        stage = campaign.Stage(tmp_path, pool, campaign.Report(), 0.05, url)
        stack.callback(stage.close)

        def drive_until(part):
            driver = campaign.Driver(stage)
            stage.until(driver, lambda: len(records(url)) >= part * len(stage.indices))
            assert driver.alive, campaign.told(driver.output)
            return driver

        def assert_nothing_lost(before):
            assert before.items() <= records(url).items()
            return records(url)

        # A short cut is sat out; a driver that is killed keeps others out until its lease expires.
        driver = drive_until(choose.uniform(0.05, 0.2))
        wire.cut()
        time.sleep(0.3)
        wire.mend()
        committed, more = len(records(url)), choose.randint(3, 15)
        stage.until(driver, lambda: len(records(url)) >= committed + more)
        assert driver.alive, campaign.told(driver.output)
        os.kill(driver.pid, signal.SIGKILL)
        assert driver.finish()[0] == -signal.SIGKILL
        code, text = campaign.Driver(stage).finish()
        assert code == 2, text
        assert re.search(rf"another run \(process {driver.pid} on .*try again in \d s", text)
        time.sleep(campaign.LEASE + 1.1)  # the server tells whole seconds
        before = records(url)

        # A long one ends the sweep, and the lease too must expire.
        driver = drive_until(choose.uniform(0.5, 0.7))
        wire.cut()
        code, text = driver.finish()
        wire.mend()
        assert code == 1, text
        assert "does not answer within 1 s" in text
        assert "Traceback" not in text
        before = assert_nothing_lost(before)
        time.sleep(campaign.LEASE + 1.1)

        code, text = campaign.Driver(stage).finish()
        assert code == 0, text
        assert_nothing_lost(before)
        assert_complete(url, stage.plan)


def predict_no_more(coords, settings):
    os.kill(settings["scheduler"], signal.SIGKILL)
    time.sleep(60)


def test_a_scheduler_that_dies_while_costs_are_predicted_is_one_message(tmp_path, pool):
    pool.wait()
    plan = toy.cube(scheduler=pool.scheduler.pid)
    with (
        pytest.raises(ConnectionError, match="the dask scheduler is gone; run again to resume"),
        connect(toy.no_warm_up, scheduler=pool.address) as client,
        store.driving(tmp_path),
    ):
        sweep(client, tmp_path, plan, toy.compute, predict_no_more, report=io.StringIO())


def test_a_worker_that_dies_after_the_last_tile_is_no_error(pool):
    pool.wait()
    with connect(toy.no_warm_up, scheduler=pool.address):
        os.kill(pool.workers[0].pid, signal.SIGKILL)


def test_ctrl_c_before_the_sweep_ends_a_workflow_with_exit_code_130():
    @click.command()
    @cluster_options
    def describes_its_cube(out, cluster):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(1)

    result = CliRunner().invoke(describes_its_cube, [])
    assert result.exit_code == 130
    assert result.output == "abandoned; run the same command again to resume\n"
