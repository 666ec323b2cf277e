"""The text of the progress line and the predicted remaining time, with a clock set by the tests."""

import io
import re
import time

import numpy as np
import pytest
from commands import invoke

from pipeline.sweep import progress
from pipeline.sweep.progress import Progress, clock_time
from workflows.shared.cli import commands, main_of


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


class Terminal(io.StringIO):
    def isatty(self):
        return True


def follow(tiles, workers=2, slowness=1.0, error=1.0, later=0.0, after=0.0):
    """Simulate a sweep; yield (Progress, actual seconds remaining) after each tile.

    tiles, later : predicted CPU seconds for the tiles, and for a later sweep. error : ratio of
    actual to predicted CPU seconds. slowness : ratio of elapsed to CPU seconds. after : CPU seconds
    that the driver uses after the sweeps.
    """
    clock = Clock()
    line = Progress("run", None, {"one": sum(tiles), "two": later}, after, clock)
    line.begin_sweep("one", "one")
    line.add_work(sum(tiles), workers)
    clock.now += 10  # compiling kernels
    line.warmed_up()
    free, ends = [clock.now] * workers, []
    for tile in tiles:
        first = int(np.argmin(free))
        free[first] += tile * error * slowness
        ends.append((free[first], tile))
    end = max(free) + slowness * (later * error / workers + after)
    for clock.now, tile in sorted(ends):
        line.advance(tile, tile * error, tile * error * slowness)
        yield line, end - clock.now


@pytest.mark.parametrize("slowness", [1.0, 4.0])
@pytest.mark.parametrize("error", [0.3, 1.0, 3.0])
@pytest.mark.parametrize("later", [0.0, 60.0])
def test_after_a_tenth_of_the_work_predictions_are_within_a_factor_of_1_5(slowness, error, later):
    """This holds even if the machine is 4 times slower and predictions are off by a factor of 3."""
    tiles = np.sort(np.random.default_rng(0).lognormal(0, 0.7, 100))[::-1]
    ratios = [
        line.remaining() / remains
        for line, remains in follow(tiles, slowness=slowness, error=error, later=later, after=4.0)
        if line.done > 0.1 * tiles.sum()
    ]
    assert 2 / 3 < min(ratios) <= max(ratios) < 3 / 2


def test_the_workers_do_not_slow_down_the_driver_that_runs_after_them():
    """Two workers and another program share two processors: each gets two thirds of a processor.

    After the sweep, the driver and the other program get a processor each.
    """
    clock = Clock()
    line = Progress("run", None, {"one": 10.0}, after=10.0, clock=clock)
    line.begin_sweep("one", "one")
    line.add_work(10.0, workers=2)
    line.warmed_up()
    for _ in range(5):
        clock.now += 1.5
        line.advance(2.0, used=2.0, wall=3.0)
    assert line.remaining() == 10.0


def test_finished_driver_work_counts_in_the_bar_but_not_as_remaining_time():
    clock = Clock()
    line = Progress("run", None, {"one": 10.0}, after=30.0, clock=clock)
    line.begin_sweep("one", "one")
    line.add_work(10.0)
    line.warmed_up()
    clock.now = 20.0
    line.advance(10.0, used=10.0, wall=20.0)
    assert (line.fraction(), line.remaining()) == (0.25, 60.0)
    line.count_study(20.0)
    assert (line.fraction(), line.remaining()) == (0.75, 20.0)


def test_no_remaining_time_is_shown_before_the_first_tile_has_ended():
    clock = Clock()
    line = Progress("run", io.StringIO(), {"one": 10.0}, clock=clock)
    line.begin_sweep("sweep 1 of 1, one", "one")
    line.add_work(10.0, workers=2)
    clock.now = 2.0
    assert line.line() == "sweep 1 of 1, one, loading kernels: 0%, elapsed 0:02"
    clock.now = 12.0
    expected = "sweep 1 of 1, one, compiling kernels (half a minute, once): 0%, elapsed 0:12"
    assert line.line() == expected
    line.warmed_up()
    clock.now = 13.0
    assert line.line() == "sweep 1 of 1, one: 0%, elapsed 0:13"
    clock.now = 15.0
    line.advance(2.0, used=2.0, wall=3.0)  # the other worker has probably used one second
    clock.now = 16.0
    assert line.line() == "sweep 1 of 1, one: 20%, elapsed 0:16, remaining about 0:07"


def test_the_remaining_time_includes_worker_idle_time_between_batches():
    clock = Clock()
    line = Progress("run", None, {"one": 20.0, "two": 20.0}, clock=clock)
    line.begin_sweep("one", "one")
    line.add_work(20.0)
    line.warmed_up()
    for _ in range(20):
        clock.now += 2.0
        line.advance(1.0, used=1.0, wall=1.0)
    assert line.remaining() == pytest.approx(40.0)
    clock.now += 10.0  # the driver examines the results, and begins the next sweep
    line.begin_sweep("two", "two")
    line.add_work(20.0)
    line.warmed_up()
    clock.now += 2.0
    line.advance(1.0, used=1.0, wall=1.0)
    assert line.remaining() == pytest.approx(52.0 * 19 / 21)


def test_the_remaining_time_counts_down_while_no_tile_finishes():
    line, _ = next(follow([5.0] * 10))
    before = line.remaining()
    line.clock.now += 3
    assert line.remaining() == pytest.approx(before - 3)
    line.clock.now += 1000
    assert 0 < line.remaining() < before


def test_the_bar_measures_cpu_seconds_and_never_decreases():
    """The bar does not decrease even if a refinement needs more work than predicted."""
    line = Progress("run", None, {"one": 20.0, "two": 20.0}, clock=Clock())
    parts = []
    for sweep, tiles in (("one", [10.0, 5.0]), ("two", [20.0, 10.0])):
        line.begin_sweep(sweep, sweep)
        for seconds in tiles:
            line.add_work(seconds)
            line.advance(seconds, seconds, seconds)
            parts.append(line.fraction())
    assert parts == [0.25, 0.375, 1.0, 1.0]
    assert parts == sorted(parts)


def test_the_predicted_work_of_a_sweep_counts_until_the_sweep_has_ended():
    clock = Clock()
    line = Progress("run", None, {"one": 10.0, "two": 30.0}, clock=clock)
    line.begin_sweep("one", "one")
    line.add_work(4.0)
    line.warmed_up()
    clock.now = 4.0
    line.advance(4.0, 4.0, 4.0)
    assert line.remaining() == pytest.approx(36.0)
    line.begin_sweep("two", "two")  # `one` took six seconds less than predicted
    assert line.remaining() == pytest.approx(30.0)


def test_on_a_terminal_one_line_is_rewritten_and_fits_the_width(monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")
    stream = Terminal()
    with Progress("run", stream, {"one": 4.0}) as line:
        line.begin_sweep("one", "one")
        line.add_work(4.0)
        line.advance(2.0, 2.0, 2.0)
        line.show("drawing figures")
        line.finish()
    *_, drawing, done = re.split(r"[\r\n]", stream.getvalue().strip())
    assert drawing.startswith("[##########----------] drawing figures: 50%, elapsed 0:0")
    assert done.startswith("[####################] done: 100%, elapsed 0:0")
    assert "remaining" not in done
    assert {len(words) for words in re.split(r"[\r\n]", stream.getvalue())} <= {0, 59}
    assert stream.getvalue().endswith("\n")


def test_a_log_gets_a_line_every_ten_seconds_but_a_silent_run_has_no_log(monkeypatch):
    waits = []

    def wait(over, seconds):
        waits.append(seconds)
        return len(waits) > 3

    monkeypatch.setattr(progress.threading.Event, "wait", wait)
    stream = io.StringIO()
    Progress("run", stream)._keep_writing()
    assert waits == [10.0] * 4
    assert stream.getvalue() == "run: elapsed 0:00\n" * 3
    with Progress("run", None, {"one": 4.0}) as line:
        line.begin_sweep("one", "one")
        line.add_work(4.0)
        line.write("\n")


def test_a_thread_writes_while_the_driver_is_busy(monkeypatch):
    stream = Terminal()
    with Progress("run", stream):
        end = time.monotonic() + 60
        while stream.getvalue().count("\r") < 2:
            assert time.monotonic() < end
            time.sleep(0.01)


def test_a_log_has_a_line_for_each_sweep_that_computed_tiles():
    stream = io.StringIO()
    line = Progress("run", stream, {"one": 4.0}, clock=Clock())
    line.begin_sweep("sweep 1 of 2, complete", "complete")
    line.end_sweep()
    assert stream.getvalue() == ""
    line.begin_sweep("sweep 2 of 2, one", "one")
    line.add_work(4.0)
    line.advance(4.0, 4.0, 4.0)
    line.end_sweep()
    line.finish()
    assert stream.getvalue() == (
        "sweep 2 of 2, one: 100%, elapsed 0:00\ndone: 100%, elapsed 0:00\n"
    )


def test_times_are_formatted_like_a_clock():
    text = {0.4: "0:00", 29: "0:29", 88: "1:28", 725.2: "12:05", 3599.6: "1:00:00", 3723: "1:02:03"}
    assert {seconds: clock_time(seconds) for seconds in text} == text


def test_a_quiet_run_prints_its_results_and_nothing_else(tmp_path, workers):
    plane = [
        "--first",
        "0:1:2",
        "--second",
        "0:1:2",
        "--n-max",
        "10",
        "--n-orbits",
        "2",
        "--levels",
        "1",
    ]
    result = invoke("escape_plane", tmp_path, *plane, *workers, "--quiet")
    assert (result.exit_code, result.stderr) == (0, "")
    assert f"cubes:   {tmp_path}/escape.zarr" in result.stdout
    assert "at least one orbit escapes" in result.stdout


@pytest.mark.parametrize("name", commands())
def test_every_command_that_computes_accepts_quiet(name):
    options = {option.name for option in main_of(name).params}
    assert ("quiet" in options) == (name not in {"explore", "status", "verify"})
