"""Kernels on disk: never stale, safe with many writers, harmless where they cannot be kept."""

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from numba import config

from nasm.arithmetic import kernels

ROOT = Path(__file__).parent.parent

HALF = """
@kernels.kernel
def half(x):
    return x / 2 if x > 0 else x * 2.0
"""
# A program that calls it for a type, while other writers have time to come between.
SLOWLY = f"""
import sys, time
from numba.core.caching import IndexDataCacheFile
from nasm.arithmetic import kernels
{HALF}
save = IndexDataCacheFile._save_index
IndexDataCacheFile._save_index = lambda *a: (time.sleep(0.5), save(*a))
print(*(half(5) if kind == "int" else half(5.0) for kind in sys.argv[1:]), end=" ")
print(sum(half.stats.cache_hits.values()))
"""
# A program whose kernel inlines a function of another file.
SINE = """
from nasm.arithmetic import kernels, sine

@kernels.kernel
def turned(x):
    return sine.sin2pi(x)

print(turned(0.1))
"""


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """The directory of kernels of this process, as one that has just started finds it."""

    def at(folder):
        monkeypatch.setattr(config, "CACHE_DIR", str(folder))
        kernels.directory.cache_clear()
        return kernels.directory()

    yield at(tmp_path / "cache"), at
    monkeypatch.undo()
    kernels.directory.cache_clear()


@pytest.fixture
def half(tmp_path):
    """What a small kernel returns for some values, and how many of its types came from disk."""
    script = tmp_path / "script.py"
    script.write_text(HALF)
    code = compile(HALF, script, "exec")

    def run(*values):
        exec(code, names := {"kernels": kernels, "__name__": __name__})
        results = [names["half"](value) for value in values]
        return *results, sum(names["half"].stats.cache_hits.values())

    return run


def started(script, *arguments, cache, source=ROOT):
    environment = {**os.environ, "PYTHONPATH": str(source), "NUMBA_CACHE_DIR": str(cache)}
    command = [sys.executable, "-W", "error", script, *arguments]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    return subprocess.Popen(command, env=environment, **pipes)


@pytest.mark.slow
def test_processes_that_write_at_once_keep_all_and_of_those_that_miss_one_kernel_one_compiles_it(
    tmp_path,
):
    script = tmp_path / "script.py"
    script.write_text(SLOWLY)
    cache = tmp_path / "cache"
    writers = [started(script, kind, cache=cache) for kind in ("float", "int", "float")]
    said = sorted(writer.communicate(timeout=120)[0] for writer in writers)
    assert said == ["2.5 0\n", "2.5 0\n", "2.5 1\n"]
    reader = started(script, "int", "float", cache=cache)
    assert reader.communicate(timeout=120)[0] == "2.5 2.5 2\n"


def test_a_kernel_is_compiled_once_and_again_if_a_bit_of_its_files_has_changed(half, kept):
    directory, _ = kept
    assert kernels.are_missing()
    assert [half(5.0) for _ in range(2)] == [(2.5, 0), (2.5, 1)]
    assert half(5, 5.0) == (2.5, 2.5, 1)
    assert not kernels.are_missing()
    for suffix in ("nbc", "nbi"):
        for file in directory.glob(f"*.{suffix}"):
            content = bytearray(file.read_bytes())
            content[len(content) // 2] ^= 1
            file.write_bytes(content)
        assert half(5.0) == (2.5, 0)
    assert half(5.0) == (2.5, 1)


def test_where_no_kernel_can_be_kept_it_is_compiled_and_none_is_said_to_be_missing(
    half, kept, tmp_path
):
    (tmp_path / "file").touch()
    assert kept[1](tmp_path / "file" / "cache") is None
    assert [half(5.0) for _ in range(2)] == [(2.5, 0)] * 2
    assert not kernels.are_missing()


def test_kernels_of_other_versions_are_deleted_when_they_are_a_month_old(kept, tmp_path):
    names = {"old": "kernels-0000000000000000", "young": "kernels-1111111111111111"}
    for name in (*names.values(), "of_others"):
        (tmp_path / "cache" / name).mkdir()
    month_ago = time.time() - 31 * 24 * 3600
    for name in (names["old"], "of_others"):
        os.utime(tmp_path / "cache" / name, (month_ago, month_ago))
    kept[1](tmp_path / "cache")
    left = {path.name for path in (tmp_path / "cache").iterdir()}
    assert left == {kept[0].name, names["young"], "of_others"}


def test_an_edit_in_a_room_changes_what_a_kernel_computes(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(SINE)
    shutil.copytree(ROOT / "nasm", tmp_path / "copy" / "nasm")
    sine = tmp_path / "copy" / "nasm" / "arithmetic" / "sine.py"
    original = sine.read_text()
    edited = original.replace("-6.579736267392568", "-6.5")
    assert edited != original
    results = []
    for text in (original, edited):
        sine.write_text(text)
        run = started(script, cache=tmp_path / "cache", source=tmp_path / "copy")
        results.append(float(run.communicate(timeout=120)[0]))
    assert 1e-4 < abs(results[0] - results[1]) < 1e-3
    assert len(list((tmp_path / "cache").glob("kernels-*"))) == 2  # both versions, side by side


def test_a_program_that_begins_without_scipy_has_its_kernels_and_may_load_it_later():
    program = """
import sys
from nasm.arithmetic import kernels
kernels.begin_without_scipy()
from nasm import circles
print(circles.invariant_circle("gamma", (0.3,)).certified)
print({"scipy.fft", "scipy.linalg"} & sys.modules.keys())
import scipy.fft, scipy.linalg
"""
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT)
    assert run.stdout.split("\n") == ["True", "set()", ""], run.stderr
    assert run.returncode == 0
