"""Kernels on disk are never stale and tolerate many writers; failure to save them is not fatal."""

import errno
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from filelock import FileLock
from numba import config
from numba.core.caching import IndexDataCacheFile

from nasm.arithmetic import kernels

ROOT = Path(__file__).parent.parent

HALF = """
@kernels.kernel
def half(x):
    return x / 2 if x > 0 else x * 2.0
"""
# A program that calls `half` and saves it so slowly that other writers have time to interfere.
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
# A program whose kernel inlines a function from another file.
SINE = """
from nasm.arithmetic import kernels, sine

@kernels.kernel
def turned(x):
    return sine.sin2pi(x)

print(turned(0.1))
"""

# The same program, except that it loads an edited version of `sine.py` and then undoes the edit.
EDITING = """
import importlib, os, warnings
from pathlib import Path
import nasm
file = Path(nasm.__file__).parent / "arithmetic" / "sine.py"
if IS_IMPORTED_BEFORE:
    from nasm.arithmetic import sine
original, times = file.read_text(), os.stat(file)
file.write_text(original.replace("-6.579736267392568", "-6.579736267392569 + 0.08"))
from nasm.arithmetic import kernels, sine
importlib.reload(sine)
file.write_text(original)
os.utime(file, ns=(times.st_atime_ns, times.st_mtime_ns))

@kernels.kernel
def turned(x):
    return sine.sin2pi(x)

with warnings.catch_warnings(record=True) as given:
    warnings.simplefilter("always")
    print(turned(0.1), turned(0), len(given))
assert "sources of nasm have changed" in str(given[0].message)
"""


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """Yield the kernel directory that a new process would use, and a function that changes it."""

    def at(folder):
        monkeypatch.setattr(config, "CACHE_DIR", str(folder))
        kernels.directory.cache_clear()
        return kernels.directory()

    yield at(tmp_path / "cache"), at
    monkeypatch.undo()
    kernels.directory.cache_clear()


@pytest.fixture
def half(tmp_path):
    """Return a function that calls a small kernel with some values.

    The function returns the results, and the number of signatures loaded from disk.
    """
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
def test_only_one_process_compiles_a_kernel_and_all_signatures_are_saved(
    tmp_path,
):
    script = tmp_path / "script.py"
    script.write_text(SLOWLY)
    cache = tmp_path / "cache"
    writers = [started(script, kind, cache=cache) for kind in ("float", "int", "float")]
    output = sorted(writer.communicate(timeout=120)[0] for writer in writers)
    assert output == ["2.5 0\n", "2.5 0\n", "2.5 1\n"]
    reader = started(script, "int", "float", cache=cache)
    assert reader.communicate(timeout=120)[0] == "2.5 2.5 2\n"


def test_a_kernel_is_recompiled_only_if_its_files_have_changed(half, kept):
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


def test_a_kernel_that_cannot_be_saved_is_compiled_without_a_warning(half, kept, tmp_path):
    (tmp_path / "file").touch()
    assert kept[1](tmp_path / "file" / "cache") is None
    assert [half(5.0) for _ in range(2)] == [(2.5, 0)] * 2
    assert not kernels.are_missing()


def loosen(path, mode):
    """Make a file or directory writable by others, or give it to another user."""
    if mode is None:
        os.chown(path, 54321, -1)
    else:
        os.chmod(path, path.stat().st_mode | mode)


OTHERS = [0o020, 0o002]
if os.geteuid() == 0:  # only root may give a file to another user
    OTHERS.append(None)


@pytest.mark.parametrize("mode", OTHERS)
def test_kernels_that_others_can_write_are_refused_with_one_warning(half, kept, mode):
    directory, at = kept
    assert directory.stat().st_mode & 0o777 == 0o700
    half(5.0)
    loosen(directory, mode)
    with pytest.warns(RuntimeWarning, match="set NUMBA_CACHE_DIR") as output:
        assert at(directory.parent) is None
    files = {path.name for path in directory.iterdir()}
    assert [half(5, 5.0) for _ in range(2)] == [(2.5, 2.5, 0)] * 2
    assert len(output) == 1
    assert {path.name for path in directory.iterdir()} == files
    assert not kernels.are_missing()


@pytest.mark.parametrize("mode", OTHERS)
@pytest.mark.parametrize("suffix", ["nbc", "nbi"])
def test_kernel_files_that_others_can_write_are_not_loaded(half, kept, suffix, mode):
    half(5.0)
    for file in kept[0].glob(f"*.{suffix}"):
        loosen(file, mode)
    assert half(5.0) == (2.5, 0)
    assert half(5.0) == (2.5, 1)  # our own files have replaced them


def test_only_this_user_can_read_or_write_kernels_whatever_the_umask(half, kept):
    umask = os.umask(0)
    try:
        half(5.0)
    finally:
        os.umask(umask)
    modes = {file.stat().st_mode & 0o777 for file in kept[0].glob("*.nb?")}
    assert modes == {0o600}


def test_kernels_from_other_versions_are_deleted_after_a_month(kept, tmp_path):
    names = {"old": "kernels-0000000000000000", "young": "kernels-1111111111111111"}
    for name in (*names.values(), "of_others"):
        (tmp_path / "cache" / name).mkdir()
    month_ago = time.time() - 31 * 24 * 3600
    for name in (names["old"], "of_others"):
        os.utime(tmp_path / "cache" / name, (month_ago, month_ago))
    kept[1](tmp_path / "cache")
    left = {path.name for path in (tmp_path / "cache").iterdir()}
    assert left == {kept[0].name, names["young"], "of_others"}


def test_editing_an_inlined_function_changes_what_a_kernel_computes(tmp_path):
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


@pytest.mark.parametrize("is_imported_before", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_edited_sources_disable_the_kernels_on_disk_with_one_warning(is_imported_before, tmp_path):
    shutil.copytree(ROOT / "nasm", tmp_path / "copy" / "nasm")
    cache, results = tmp_path / "cache", []
    editing = EDITING.replace("IS_IMPORTED_BEFORE", str(is_imported_before))
    for i, program in enumerate([editing, SINE, editing, SINE]):
        script = tmp_path / "script.py"
        script.write_text(program)
        run = started(script, cache=cache, source=tmp_path / "copy")
        results.append(run.communicate(timeout=120)[0].split())
        assert len(list(cache.rglob("*.nbc"))) == (i > 0)
    edited, original = results[:2]
    assert edited[1:] == ["0.0", "1"]
    assert 1e-4 < abs(float(edited[0]) - float(original[0])) < 1e-3
    assert results[2:] == results[:2]


def _no_locks(*_, **__):
    raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))


def _no_flock(*_, **__):  # filelock 3.12 raises this error on a file system without locks
    raise NotImplementedError("FileSystem does not appear to support flock")


@pytest.mark.parametrize("acquire", [_no_locks, _no_flock])
def test_kernels_are_saved_even_on_a_file_system_without_locks(half, kept, monkeypatch, acquire):
    monkeypatch.setattr(FileLock, "acquire", acquire)
    assert [half(5.0) for _ in range(2)] == [(2.5, 0), (2.5, 1)]
    assert half(5, 5.0) == (2.5, 2.5, 1)
    assert half(5, 5.0) == (2.5, 2.5, 2)


def test_two_signatures_saved_at_once_without_a_lock_have_their_own_files(half, kept, monkeypatch):
    monkeypatch.setattr(FileLock, "acquire", _no_locks)
    save_index = IndexDataCacheFile._save_index

    def save_index_after_another_process(files, overloads):
        monkeypatch.setattr(IndexDataCacheFile, "_save_index", save_index)
        half(5)
        save_index(files, overloads)

    monkeypatch.setattr(IndexDataCacheFile, "_save_index", save_index_after_another_process)
    assert half(5.0) == (2.5, 0)
    assert len(list(kept[0].glob("*.nbc"))) == 2


def test_kernels_are_loaded_from_a_read_only_directory(half, kept, monkeypatch):
    half(5.0)

    def refuse(*_, **__):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    for name in ("utime", "replace", "mkdir"):
        monkeypatch.setattr(os, name, refuse)
    monkeypatch.setattr(FileLock, "acquire", refuse)
    assert kept[1](kept[0].parent) == kept[0]
    assert half(5.0, 5) == (2.5, 2.5, 1)
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    for file in kept[0].iterdir():
        file.unlink()
    assert not kernels.are_missing()


def test_kernels_do_not_need_scipy_which_may_be_loaded_later():
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
