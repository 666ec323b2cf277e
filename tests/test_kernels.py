"""Kernels on disk: never stale, safe with many writers, harmless where they cannot be kept."""

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent

# Prints what a small kernel returns for each type asked for, and how many of them came from disk.
SCRIPT = """
import sys, time
from numba.core.caching import IndexDataCacheFile
from nasm.arithmetic import kernels

if "slowly" in sys.argv:  # other writers have time to come between
    save = IndexDataCacheFile._save_index
    IndexDataCacheFile._save_index = lambda *a: (time.sleep(0.5), save(*a))

@kernels.kernel
def half(x):
    return x / 2 if x > 0 else x * 2.0

for kind in sys.argv[1].split(","):
    print(half(int(5)) if kind == "int" else half(5.0), end=" ")
print(sum(half.stats.cache_hits.values()), kernels.directory() is None)
"""


@pytest.fixture
def run(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)

    def start(*args, cache=tmp_path / "cache", source=ROOT):
        environment = {**os.environ, "PYTHONPATH": str(source), "NUMBA_CACHE_DIR": str(cache)}
        command = [sys.executable, "-W", "error", *([] if args[0] == "-c" else [script]), *args]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
        return subprocess.Popen(command, env=environment, cwd=tmp_path, **pipes)

    def finish(*args, **kwargs):
        return start(*args, **kwargs).communicate(timeout=120)[0].strip()

    finish.start = start
    return finish


def test_two_processes_that_write_at_once_keep_both_their_kernels(run):
    writers = [run.start(kind, "slowly") for kind in ("int", "float")]
    assert [writer.communicate(timeout=120)[0] for writer in writers] == ["2.5 0 False\n"] * 2
    assert run("int,float") == "2.5 2.5 2 False"


def test_of_processes_that_miss_a_kernel_one_compiles_it_and_the_others_load_it(run):
    writers = [run.start("float", "slowly") for _ in range(3)]
    answers = sorted(writer.communicate(timeout=120)[0] for writer in writers)
    assert answers == ["2.5 0 False\n", "2.5 1 False\n", "2.5 1 False\n"]


def test_a_kernel_is_compiled_once_and_again_if_a_bit_of_its_files_has_changed(run, tmp_path):
    assert [run("float") for _ in range(2)] == ["2.5 0 False", "2.5 1 False"]
    for suffix in ("nbc", "nbi"):
        (file,) = (tmp_path / "cache").glob(f"kernels-*/*.{suffix}")
        content = bytearray(file.read_bytes())
        content[len(content) // 2] ^= 1
        file.write_bytes(content)
        assert run("float") == "2.5 0 False"
    assert run("float") == "2.5 1 False"


def test_kernels_are_missing_until_one_is_kept_but_not_where_none_can_be(run, tmp_path):
    (tmp_path / "file").touch()
    nowhere = {"cache": tmp_path / "file" / "cache"}
    asked = "-c", "from nasm.arithmetic import kernels; print(kernels.are_missing())"
    assert run(*asked) == "True"
    run("float")
    assert run(*asked) == "False"
    assert run(*asked, **nowhere) == "False"
    assert run("float", **nowhere) == "2.5 0 True"


def test_kernels_of_other_versions_are_deleted_when_they_are_a_month_old(run, tmp_path):
    names = {"old": "kernels-0000000000000000", "young": "kernels-1111111111111111"}
    for name in (*names.values(), "of_others"):
        (tmp_path / "cache" / name).mkdir(parents=True)
    month_ago = time.time() - 31 * 24 * 3600
    for name in (names["old"], "of_others"):
        os.utime(tmp_path / "cache" / name, (month_ago, month_ago))
    run("float")
    left = {path.name for path in (tmp_path / "cache").iterdir()}
    assert names["old"] not in left
    assert {names["young"], "of_others"} < left


def test_an_edit_in_a_room_changes_what_a_kernel_computes(run, tmp_path):
    shutil.copytree(ROOT / "nasm", tmp_path / "copy" / "nasm")
    sine = tmp_path / "copy" / "nasm" / "arithmetic" / "sine.py"
    original = sine.read_text()
    edited = original.replace("-6.579736267392568", "-6.5")
    assert edited != original
    code = "from nasm import orbits; print(orbits.orbit((0.5, 0.2), 0.1, 0.3, 5)[1][-1])"
    results = []
    for text in (original, edited):
        sine.write_text(text)
        results.append(run("-c", code, source=tmp_path / "copy"))
    assert results[0] != results[1]
    assert all(0.1 < abs(float(result)) < 1 for result in results)
    assert len(list((tmp_path / "cache").glob("kernels-*"))) == 2  # both versions, side by side
