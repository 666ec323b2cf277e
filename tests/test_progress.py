"""The line of progress: what is foreseen, what is left, and no long silence."""

import io
import time

from pipeline.sweep import progress
from pipeline.sweep.progress import Progress


def lines(stream):
    return [line.strip() for line in stream.getvalue().splitlines()]


def test_tiles_that_are_foreseen_count_until_their_sweep_has_ended():
    stream = io.StringIO()
    line = Progress("all", stream, {"one": (4, 4.0), "two": (6, 60.0)})
    line.interval = -1
    with line:
        line.go_on("one", "one")
        line.begin(1, 1.0)
        line.advance(1, 1.0)
        line.begin(1, 1.0)
        line.advance(1, 1.0)
        line.go_on("two", "two")  # with two tiles less than were foreseen
        line.begin(6, 60.0)
        line.advance(6, 60.0)
    first, second, at_end, *_, last = lines(stream)
    assert first.startswith("one: 1/10 tiles")
    assert second.startswith("one: 2/10 tiles")
    assert "s left" in second
    assert at_end.startswith("one: 2/8 tiles")
    assert last.startswith("two: 8/8 tiles")
    assert not any(" 0 s left" in told for told in lines(stream))
    assert "left" not in last


def test_the_time_left_begins_as_predicted():
    stream = io.StringIO()
    line = Progress("all", stream, {"one": (10, 100.0)})
    line.interval = -1
    line.go_on("one", "one")
    line.begin(10, 100.0, workers=2)
    line.advance(1, 0.0)
    assert lines(stream)[-1].endswith("about 50 s left")


def test_a_long_silence_is_broken(monkeypatch):
    monkeypatch.setattr(progress, "_SILENCE", 0.05)
    stream = io.StringIO()
    with Progress("computing", stream):
        deadline = time.monotonic() + 60
        while not lines(stream):
            assert time.monotonic() < deadline
            time.sleep(0.01)
    assert lines(stream)[0].startswith("computing: ")
