"""The command line: help is quick; bad input gives one message, and nothing is written."""

import ast
import inspect
import os
import re
import subprocess
import sys
import tomllib
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from commands import invoke
from matplotlib.figure import Figure

import nasm
from nasm.planes import parse
from workflows.__main__ import main as overview
from workflows.figures import style
from workflows.shared.cli import commands, main_of
from workflows.shared.forcing_files import numbers_in
from workflows.shared.rays import ray_angles

COMMANDS, ROOT = commands(), Path(__file__).parents[1]


@pytest.mark.parametrize("name", COMMANDS)
def test_every_file_at_the_top_level_is_a_command_with_help_and_a_version(name):
    assert main_of(name).help
    assert all(option.help for option in main_of(name).params if option.param_type_name == "option")
    result = CliRunner().invoke(main_of(name), ["--version"])
    assert (result.exit_code, result.output) == (0, f"nasm {nasm.__version__}\n")


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_is_the_last_function_of_its_file(name):
    source = inspect.getsource(inspect.getmodule(main_of(name).callback))
    assert getattr(ast.parse(source).body[-1], "name", None) == "main"


def test_the_overview_has_a_line_for_each_command():
    listed = CliRunner().invoke(overview).output.partition("--help:")[2]
    summaries = dict(
        line.split(maxsplit=1) for line in listed.splitlines() if line[:3].count(" ") == 2
    )
    assert list(summaries) == COMMANDS
    assert all(len(words) > 20 for words in summaries.values())


def test_the_overview_runs_a_command_or_lists_all_if_it_is_unknown():
    result = CliRunner().invoke(overview, ["status", "--version"])
    assert (result.exit_code, result.output) == (0, f"nasm {nasm.__version__}\n")
    unknown = CliRunner().invoke(overview, ["nosuch"])
    assert unknown.exit_code == 2
    assert f"there is no command nosuch; choose one of {', '.join(COMMANDS)}" in unknown.output


def test_the_console_script_is_the_overview():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert EntryPoint("", project["scripts"]["nasm-transport"], "").load() is overview


@pytest.mark.parametrize("command", ["ask", pytest.param("escape_plane", marks=pytest.mark.slow)])
def test_if_numba_is_disabled_one_sentence_states_what_to_unset(command, tmp_path):
    arguments = ["0.3"] if command == "ask" else []
    result = subprocess.run(
        [sys.executable, "-m", f"workflows.{command}", *arguments, f"--out={tmp_path}"],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
    )
    assert result.returncode == 2
    assert result.stderr.count("Error") == 1
    assert re.search("Error: NUMBA_DISABLE_JIT is set, but .*; unset it\n$", result.stderr)
    assert not any(tmp_path.iterdir())


def test_one_sentence_explains_that_another_package_hides_ours(tmp_path):
    (tmp_path / "pipeline").mkdir()
    (tmp_path / "pipeline/__init__.py").touch()
    paths = {**os.environ, "PYTHONPATH": f"{tmp_path}:{ROOT}"}
    command = [sys.executable, "-m", "workflows.status"]
    result = subprocess.run(command, capture_output=True, text=True, env=paths, cwd=tmp_path)
    assert result.returncode == 1
    (line,) = result.stderr.splitlines()
    assert f"hidden by another package pipeline, {tmp_path}/pipeline/__init__.py; install" in line


def test_full_changes_defaults_but_not_explicit_options():
    options = ["--full", "--n-orbits", "7"]
    long = main_of("direct_boundary").make_context("it", options).params
    assert (long["n_max"], long["n_orbits"]) == ([100_000, 500_000, 1_000_000], 7)
    phases = [main_of("three_kicks").make_context("it", each).params for each in ([], ["--full"])]
    assert [len(short_or_long["phase"]) for short_or_long in phases] == [3, 6]


def test_each_command_except_explore_status_and_verify_has_its_own_folder():
    """A command uses the same folder whether run as a module, by the overview, or from Python."""
    folders = {name: main_of(name).make_context(name, ["1"] * (name == "ask")) for name in COMMANDS}
    folders = {name: context.params["out"] for name, context in folders.items()}
    shared = {"explore": "out/critical_boundary", "status": "out", "verify": "out"}
    assert folders == {name: f"out/{name}" for name in COMMANDS} | shared
    for command in (["-m", "workflows.last_barrier"], ["-m", "workflows", "last_barrier"]):
        result = subprocess.run(
            [sys.executable, *command, "--help"], capture_output=True, text=True
        )
        assert "[default: out/last_barrier]" in result.stdout
    result = subprocess.run([sys.executable, "-m", "workflows.ramp", "-h"], stdout=-1, text=True)
    assert "[default: out/ramp]" in result.stdout


def test_different_commands_write_files_with_different_names():
    """Only names written as literals are checked here; `test_every_command` checks all names."""
    assert not [(a, b) for a in COMMANDS for b in COMMANDS if a != b and b.startswith(a)]
    for name in COMMANDS:
        source = inspect.getsource(inspect.unwrap(main_of(name).callback))
        names = re.findall(r'run\.(?:table|figure|path)\((?:"\w+", )?f?"(\w+)', source)
        assert [file for file in names if not file.startswith(name)] == []


def test_a_figure_for_a_column_is_saved_next_to_the_one_for_the_screen(tmp_path):
    style.save(Figure(), tmp_path, "name", "caption", kinds=["png"])
    with style.sheet(column=True):
        (path,) = style.save(Figure(), tmp_path, "name", "caption", kinds=["png"])
    assert path == f"{tmp_path}/name_column.png"
    files = ["name.png", "name.txt", "name_column.png", "name_column.txt"]
    assert sorted(file.name for file in tmp_path.iterdir()) == files


def test_rays_cover_the_range_of_angles_stated_in_the_help():
    help = CliRunner().invoke(main_of("last_barrier"), ["--help"], terminal_width=200).output
    assert "from 0 to 180 degrees, or to 360 where κ and -κ are not equivalent" in help
    reach = {name: ray_angles(parse(name), 3, 0)[-1] for name in ("two-kicks", "three-kicks:0.2")}
    assert reach == {"two-kicks": 180, "three-kicks:0.2": 360}


def test_equal_rotation_numbers_are_used_once():
    options = ["--omega", "[0;(1)]", "--omega", "2gamma", "--omega", "gamma"]
    omega = main_of("circle_boundaries").make_context("it", options).params["omega"]
    assert list(omega) == ["gamma", "2gamma"]


def test_help_is_quick_because_numpy_is_not_imported():
    code = "import sys; from workflows.shared.cli import main_of\n"
    code += f"for name in {COMMANDS}: main_of(name).main(['--help'], standalone_mode=False)\n"
    code += "assert not {'numpy', 'jinja2', 'obstore', 'dask'} & sys.modules.keys()"
    help = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert help.stdout.count("Usage:") == len(COMMANDS)


@pytest.mark.parametrize("name", COMMANDS)
def test_the_error_for_a_mistyped_option_names_the_intended_one(name):
    options = [each for option in main_of(name).params for each in option.opts if each[:2] == "--"]
    known = {*options, "--help"}
    assert len(known) > 2
    for meant in options:
        typos = {meant[1:], meant + "x", meant.replace(meant[3:5], meant[4:2:-1]), meant[:-1]}
        for typed in typos - known:
            for words in ([typed], [typed + "=1"], ["0.3", typed, "1"]):
                result = CliRunner().invoke(main_of(name), words)
                assert result.exit_code == 2
                assert meant in result.output.replace("\n", " ").partition(typed)[2]


@pytest.mark.parametrize(
    "text", ["0.3 -.5\n1e-2", "\ufeff0.3\r\n-.5\r\n1e-2\r\n", "0.3, -.5,\t1e-2"]
)
def test_kicks_are_read_from_files_written_on_any_operating_system(text):
    assert numbers_in(text.encode()) == [0.3, -0.5, 0.01]


def test_numbers_on_the_command_line_may_be_negative():
    words = ["-0.69", "-.5", "-1e-3", "--prove", "-2E+1", "-inf"]
    assert main_of("ask").make_context("ask", words).params["kappa"] == (
        -0.69,
        -0.5,
        -1e-3,
        -20,
        -np.inf,
    )


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("escape_plane", "--first 1:0:8", "lower one first"),
        ("escape_plane", "--n-orbits 100,10", "increasing whole numbers from 1"),
        ("critical_boundary", "--first 0:1:30 --levels 3", "multiple of 4"),
        ("escape_plane", "--follow 2000000", "must be at most n-max"),
        ("escape_plane", "--precision single --n-max 2000000", "needs --precision double"),
        ("circle_boundaries", "--omega golden", "is not a rotation number"),
        ("circle_boundaries", "--omega 3/5", "like [0;1,1,2,(1)]"),
        ("escape_plane", "--plane rotating", "is not a plane; write two-kicks"),
        ("escape_plane", "--plane nowhere.json", "nowhere.json: [Errno 2] No such file"),
        ("escape_plane", "--plane {}/a.json", "a.json: Expecting value"),
        ("escape_plane", "--plane {}/b.json", "must be a JSON object with the keys name, axes"),
        ("escape_plane", "--first -1e7:1e7:4", "not finite or too large"),
        ("last_barrier", "--tol nan", "'nan' must be a number from 1e-05 to"),
        ("three_kicks", "--phase 1/0", "phase='1/0' is not a fraction"),
        ("tori", "--vector 0.6,0.2", "'--vector' requires 2 arguments"),
        (
            "flux",
            "--least-excess 1e-5 --q-max 100",
            "too short for --least-excess 1e-05; use 1000000",
        ),
        ("frequencies", "--frequency 3/5", "must be a frequency above 0, at most 1/2"),
        ("frequencies", "--frequency 20/99", "must have a denominator up to 64"),
        ("frequencies", "--frequency 0.4", "is too close to the fraction 2/5"),
        ("ask", "", "give the strengths of one period, e.g. ask 0.3 0.5"),
        ("ask", "0,3 0,5", "'0,3' is not a number; write one like 0.3 or -1e-2"),
        ("ask", "0.3 --out=", "it is empty"),
        ("ask", "0.3 --out=~nobody-here/x", "no such home directory; write"),
        ("ask", "0.3 --out=s3://bucket/x", "a directory is needed"),
        ("last_barrier", "--store=", "it is empty"),
        ("ask", "1e7 0", "not finite or too large"),
        ("ask", "--plane rotating:1/3 0.3", "has two, kappa_mean and kappa_amplitude"),
        ("ask", "--plane rotating:1/100 0.3 0.2", "from 2 to 64"),
        ("ask", "0.3 --once pyproject.toml", "leave KAPPA"),
        ("ask", "--once pyproject.toml", "is not a number; write one like 0.3"),
        ("ask", "--once {}/commas.txt", "-0,3 may be one number or two; write one like 0.3"),
        ("ask", "--once {}/bytes.json", "bytes.json: not UTF-8 text"),
        ("ask", "--once {}/kicks.txt --prove", "needs a periodic forcing"),
        ("last_barrier", "--scheduler tcp://127.0.0.1:9 --workers 1", "leave --workers out"),
        ("last_barrier", "--scheduler {}/nowhere.json", "nowhere.json': no such file"),
        ("last_barrier", "--scheduler {}/a.json", "must be tcp://HOST:PORT"),
        ("last_barrier", "--scheduler {}/bytes.json", "must be tcp://HOST:PORT"),
        ("last_barrier", "--scheduler {}/list.json", "must be tcp://HOST:PORT"),
        ("last_barrier", "--scheduler {}/inproc.json", "must be tcp://HOST:PORT"),
        ("last_barrier", "--scheduler {}/tls.json", "needs TLS files"),
    ],
)
def test_bad_input_gives_one_message_and_nothing_is_computed(
    tmp_path, monkeypatch, name, options, message
):
    monkeypatch.setattr("pipeline.sweep.cluster._FILE_PATIENCE", 0)
    files = {
        "a.json": "plane",
        "b.json": '{"name": "plane"}',
        "bytes.json": "\xff\xfe",
        "commas.txt": "1 0.5\n-0,3\n",
        "inproc.json": '{"address": "inproc://1/2"}',
        "kicks.txt": "0.3 0.2",
        "list.json": "[]",
        "tls.json": '{"address": "tls://127.0.0.1:9"}',
    }
    for file, content in files.items():
        (tmp_path / file).write_text(content, encoding="latin-1")
    result = invoke(name, tmp_path / "out", *options.format(tmp_path).split())
    assert result.exit_code == 2
    assert message in result.output.replace("\n", " ")
    assert not (tmp_path / "out").exists()


def test_each_option_has_one_name_and_no_two_names_differ_only_by_an_s():
    options = [option for name in commands() for option in main_of(name).params]
    options = [option for option in options if option.name not in ("help", "kappa")]
    assert all(len(option.opts) == 1 for option in options)
    names = {option.opts[0] for option in options}
    assert not names & {f"{name}s" for name in names}


def test_an_option_shared_by_several_commands_takes_one_kind_of_value():
    kinds = {}
    for option in (option for name in commands() for option in main_of(name).params):
        kinds.setdefault(option.opts[0], set()).add(type(option.type).__name__)
    several = {name for name, types in kinds.items() if len(types) > 1}
    # Some commands take several numbers of steps or orbits, as in 100,1000.
    assert several <= {"--n-max", "--n-orbits", "--out"}
