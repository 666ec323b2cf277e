"""With unusual session, machine or site settings, no command crashes or loses a result."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from workflows.shared.cli import commands, main_of

ROOT = Path(__file__).parents[1]
HELP = "-m", "workflows.rotating", "--help"


def python(*words, shell="", **environment):
    """Run Python in the project after the commands in `shell`; `environment` adds variables."""
    command = ["sh", "-c", f'{shell} exec "$@"', "sh", sys.executable, *map(str, words)]
    environment = {**os.environ, **environment}
    return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, timeout=120)


@pytest.mark.parametrize("encoding", ["latin-1", "cp1252", "ascii:strict", "utf-16"])
def test_characters_that_an_encoding_lacks_are_escaped(encoding):
    result = python(*HELP, PYTHONIOENCODING=encoding)
    assert (result.returncode, result.stderr) == (0, b"")
    # click writes UTF-8 if the encoding is ASCII.
    read = result.stdout.decode("utf-8" if "ascii" in encoding else encoding)
    assert "κ" in read or r"\u03ba" in read
    assert "Options:" in read


@pytest.mark.parametrize(
    ("redirection", "code", "words"),
    [
        ("exec >&- ;", 0, ""),
        ("exec 2>&- ;", 0, "Usage"),
        ("exec <&- >&- 2>&- ;", 0, ""),
        ("exec 2>/dev/full ;", 0, "Usage"),
        ("exec >/dev/full ;", 1, "Error: standard output cannot be written: No space left"),
    ],
)
def test_with_a_closed_or_full_stream_no_command_crashes_or_loses_results(redirection, code, words):
    result = python(*HELP, shell=redirection)
    output = (result.stdout + result.stderr).decode()
    assert result.returncode == code
    assert words in output
    assert bool(output) == bool(words)


@pytest.mark.parametrize("stream", ["stdout", "stderr"])
def test_a_command_finishes_even_if_the_reader_of_its_output_goes_away(tmp_path, stream):
    """With `| head -1`, for example, the command completes its work and exits as usual."""
    script = f"""
import click, sys
from workflows.shared.cli import COMMON
from workflows.shared.streams import Prepared
@click.command(cls=type("C", (Prepared, click.Command), {{}}))
def main():
    for _ in range(3):
        click.echo("κ" * 100_000, err={stream == "stderr"})
        print("κ" * 100_000, file=sys.{stream}, flush=True)
    open({str(tmp_path / "kept")!r}, "w").close()
main()
"""
    reader, writer = os.pipe()
    os.close(reader)
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, stream: writer}
    ended = subprocess.Popen([sys.executable, "-c", script], cwd=ROOT, **streams)
    os.close(writer)
    output = ended.communicate(timeout=60)
    assert (ended.returncode, *filter(None, output)) == (0,)
    assert (tmp_path / "kept").exists()


@pytest.mark.parametrize("flag", ["-O", "-OO"])
def test_python_without_assertions_is_refused_in_one_sentence(flag):
    result = python(flag, "-m", "workflows.status")
    assert result.returncode == 1
    (line,) = result.stderr.decode().splitlines()
    assert "PYTHONOPTIMIZE" in line


WITHOUT = "import sys; sys.modules['resource'] = None; "  # as on Windows, which has no such module
RUN = "import runpy; runpy.run_module('workflows{}', run_name='__main__')"


@pytest.mark.parametrize("name", ["", ".ask", ".last_barrier", ".status"])
def test_a_command_on_windows_prints_one_sentence(name):
    result = python("-c", WITHOUT + RUN.format(name))
    (line,) = result.stderr.decode().splitlines()
    assert line.startswith("nasm runs on Linux and macOS; on Windows, ")
    assert (result.returncode, result.stdout) == (1, b"")


@pytest.mark.parametrize("package", ["nasm", "pipeline"])
def test_a_failed_import_on_windows_states_the_reason(package):
    result = python("-c", f"{WITHOUT}import {package}")
    assert result.returncode == 1
    *_, line = result.stderr.decode().splitlines()
    assert line.startswith("ImportError: nasm runs on Linux and macOS; on Windows, ")
    assert "ModuleNotFoundError" not in result.stderr.decode()


@pytest.mark.parametrize("name", commands())
def test_a_path_may_begin_with_a_tilde_for_the_home_directory(tmp_path, monkeypatch, name):
    """Shells do not expand ~ after --out=, so commands must expand it.

    Otherwise they would create a folder named ~, and a careless `rm -r ~` would delete the home
    directory instead.
    """
    monkeypatch.setenv("HOME", str(tmp_path))
    plane = '{"name": "p", "axes": {"kappaa": "a", "kappab": "b"}, "origin": [0, 0], '
    (tmp_path / "plane.json").write_text(plane + '"first": [1, 0], "second": [0, 1]}')
    given = {"DIR": "~/x", "URL": "~/x", "FILE": "~/plane.json", "PLANE": "~/plane.json"}
    given["CA CERT KEY"] = "~/plane.json"
    n_paths = 0
    for option in main_of(name).params:
        if option.param_type_name == "option" and (path := given.get(option.make_metavar(None))):
            read = main_of(name).make_context(name, [option.opts[0], *[path] * option.nargs])
            value = read.params[option.name]
            for each in value if isinstance(value, tuple) else [value]:
                assert "~" not in str(each)
                assert getattr(each, "name", "p") == "p" or str(each).startswith(str(tmp_path))
            n_paths += 1
    assert n_paths >= 1


AXES = "--first", "0:1:2", "--second", "0:1:2"
SMALL = *AXES, "--n-max", 10, "--n-orbits", 2, "--levels", 1, "--workers", 1, "--quiet"
SESSION = """
import locale, logging, multiprocessing, socket, warnings
import numpy as np, xarray as xr
np.seterr(all="raise")
np.set_printoptions(precision=2, legacy="1.13")
xr.set_options(keep_attrs=False, arithmetic_join="exact")
socket.setdefaulttimeout(5)
multiprocessing.set_start_method("fork")
warnings.simplefilter("ignore")
"""
SETTINGS = {
    "DASK_DISTRIBUTED__SCHEDULER__IDLE_TIMEOUT": "1s",
    "DASK_DISTRIBUTED__WORKER__MULTIPROCESSING_METHOD": "fork",
    "DASK_SCHEDULER": "processes",
    "DASK_SCHEDULER_ADDRESS": "tcp://192.0.2.1:8786",
    "DASK_TEMPORARY_DIRECTORY": "/proc/nowhere",
    "MPLBACKEND": "nowhere",
    "OMP_NUM_THREADS": "many",
    "PYTHONIOENCODING": "latin-1",
    "PYTHONSAFEPATH": "1",
    "TZ": "nowhere",
    "COLUMNS": "7",
    "LANG": "C",
    "ZARR_CODEC_PIPELINE__PATH": "nowhere.Pipeline",
    "ZARR_DEFAULT_ZARR_FORMAT": "2",
}


@pytest.mark.slow
def test_a_sweep_runs_despite_settings_for_other_programs(tmp_path):
    """All SETTINGS apply at once; a sitecustomize.py changes further session settings."""
    (tmp_path / "sitecustomize.py").write_text(SESSION)
    (tmp_path / "matplotlibrc").write_bytes("# größer\nfont.size: 20".encode("latin-1"))
    paths = {"PYTHONPATH": f"{tmp_path}:{ROOT}", "MATPLOTLIBRC": f"{tmp_path}/matplotlibrc"}
    sweep = "-m", "workflows.escape_plane", *SMALL
    result = python(*sweep, "--out", tmp_path / "run", shell="umask 077;", **SETTINGS, **paths)
    assert (result.returncode, result.stderr) == (0, b"")
    words = result.stdout.decode("latin-1")
    assert r"\u03ba1 = 0 to 1" in words
    assert f"figures: {tmp_path}/run/escape_plane.png" in words
