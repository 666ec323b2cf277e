"""The documentation agrees with the program: READMEs, pages of the site, version numbers."""

import ast
import doctest
import os
import re
import shlex
import signal
import subprocess
import sys
import tomllib
from collections import defaultdict
from contextlib import chdir, suppress
from functools import partial
from importlib import import_module
from pathlib import Path

import pytest
from click.testing import CliRunner

import nasm
from pipeline.cubes.cube import FLAGS
from workflows.shared.cli import commands, main_of

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
LINES = [line.partition("#")[0].strip() for line in README.splitlines()]
PAGES = [path for path in sorted((ROOT / ".docs").rglob("*.md")) if "generated" not in path.parts]
CALLS = re.findall(r"`(python -m workflows\.[^`]+)`", README)
CALLS += [line for line in LINES if line.startswith("python -m workflows.")]


def blocks(language, text):
    """Return the code blocks in a given language from a Markdown text."""
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.S | re.M)


def test_the_pipeline_page_starts_a_cluster_as_the_readme_does():
    """The lines must be identical, because the tests run only those in the README."""
    pipeline = (ROOT / "pipeline" / "README.md").read_text(encoding="utf-8")
    assert blocks("sh", pipeline) == blocks("sh", README.partition("## On a cluster")[2])[:1]


def test_the_example_in_the_readme_of_the_proofs_prints_the_output_shown():
    text = (ROOT / "nasm" / "proofs" / "README.md").read_text(encoding="utf-8")
    (block,) = blocks("python", text)
    example = doctest.DocTestParser().get_doctest(block, {}, "README", None, None)
    assert doctest.DocTestRunner().run(example) == (0, 2)


def test_the_site_lists_the_status_codes_of_cubes(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / ".docs")
    rows = re.findall(r"^\| (\d+) \| `(\w+)` \|", import_module("tables").statuses(), re.M)
    codes = zip(FLAGS["flag_values"].tolist(), FLAGS["flag_meanings"].split(), strict=True)
    assert [("-128", "not_computed"), *rows] == [(str(code), name) for code, name in codes]


def test_the_readme_is_short():
    assert len(README.encode()) <= 7000


def test_the_sections_of_the_readme_are_in_the_order_a_newcomer_needs():
    heads = re.findall(r"^## (.+)$", README, re.M)
    expected = ["Install", "Three things to try", "From Python", "Your own forcing"]
    expected += ["What to trust", "Commands by question", "On a cluster"]
    assert heads == [*expected, "Compared with other software", "Citing and contributing"]


@pytest.mark.parametrize("call", dict.fromkeys(CALLS))
def test_a_command_in_the_readme_exists_and_accepts_the_options_shown(call):
    _, _, module, *options = shlex.split(call)
    name = module.removeprefix("workflows.")
    assert name in commands()
    if "--scheduler" not in options:  # the scheduler's file would have to exist
        main_of(name).make_context(name, options)


@pytest.mark.slow
@pytest.mark.parametrize("call", dict.fromkeys(CALLS))
def test_a_command_in_the_readme_succeeds_in_a_dry_run(call, tmp_path):
    """The command runs with the options shown, but in an empty folder."""
    _, _, module, *options = shlex.split(call)
    main = main_of(module.removeprefix("workflows."))
    flags = [flag for parameter in main.params for flag in parameter.opts]
    if "--dry-run" not in flags or "--scheduler" in options:
        pytest.skip("the command does not sweep, or needs a cluster started by other lines")
    with chdir(tmp_path):
        result = CliRunner().invoke(main, [*options, "--dry-run"])
    assert result.exit_code == 0, result.output
    assert "in all" in result.output
    assert list(tmp_path.iterdir()) == []


def test_python_code_in_the_readme_prints_the_output_shown(capsys):
    """Each line that prints ends in a comment with its output."""
    (block,) = blocks("python", README)
    shown = re.findall(r"^print\(.*\)  # (.+)$", block, re.M)
    exec(block, {})
    assert capsys.readouterr().out.splitlines() == shown
    assert len(shown) == 2


def test_relative_links_in_documents_point_to_existing_files():
    documents = [ROOT / "README.md", *ROOT.glob("*/README.md"), *(ROOT / ".github").rglob("*.md")]
    for document in documents:
        text = document.read_text(encoding="utf-8")
        for target in re.findall(r"\]\(([^)#]+)[^)]*\)", text):
            assert target.startswith("http") or (document.parent / target).exists(), target


def test_every_command_and_module_is_listed_in_the_table_of_its_readme():
    rows = (ROOT / "workflows" / "README.md").read_text(encoding="utf-8")
    assert [name for name in commands() if f"`{name}" not in rows] == []
    table = (ROOT / "nasm" / "README.md").read_text(encoding="utf-8")
    shared = {"__init__", "checks", "tables", "texts", "types", "versions"}  # without an equation
    names = {path.stem for path in (ROOT / "nasm").glob("*.py")} - shared
    assert [name for name in sorted(names) if f"`{name}.py" not in table] == []


def test_version_citation_and_changelog_agree():
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    version = PROJECT["version"]
    assert re.search(r"^version: (.+)$", citation, re.M)[1] == version
    assert re.search(r"^## ([\d.]+)", changelog, re.M)[1] == version
    assert re.search(r"version = \{(.+?)\}", README)[1] == version  # the site includes the README


def test_show_versions_lists_every_library_in_use(capsys):
    nasm.show_versions()
    versions = dict(line.split(None, 1) for line in capsys.readouterr().out.splitlines())
    assert versions["python"] == sys.version.split()[0]
    extras = PROJECT["optional-dependencies"]
    declared = [*PROJECT["dependencies"], *extras["proof"], *extras["explore"]]
    names = {re.match(r"[\w-]+", line)[0] for line in declared}
    assert names <= versions.keys()
    assert "sphinx" not in versions
    assert versions["numpy"] == sys.modules["numpy"].__version__


def test_a_copy_that_is_not_installed_shows_its_versions_too(monkeypatch, capsys):
    monkeypatch.setattr("nasm.versions.DISTRIBUTION", "no-such-distribution")
    nasm.show_versions()
    assert "no-such-distribution not installed" in capsys.readouterr().out


@pytest.mark.parametrize("page", sorted((ROOT / ".docs").rglob("*.md")), ids=lambda path: path.stem)
def test_python_code_on_a_page_is_run_by_the_build(page):
    """Pages have no plain Python blocks, because nothing would run them; cells are valid Python."""
    text = page.read_text(encoding="utf-8")
    assert blocks("python", text) == []
    cells = blocks(r"\{code-cell\} python", text)
    assert bool(cells) == ("file_format: mystnb" in text)
    for cell in cells:
        ast.parse(cell)


# Shell lines that the tests do not run; `.ci/run` runs those that install, test and build.
RUN_ELSEWHERE = "python3 -m venv", "pip ", "python -m pytest", "ruff "
EXPLORE = "python -m workflows.explore"
DOCUMENTS = [ROOT / "README.md", ROOT / ".github" / "CONTRIBUTING.md", *PAGES]
# Both templates start a process in the background, and wait until it is ready.
SCHEDULER_FILE = "{} & while [ ! -e scheduler.json ]; do kill -0 $!; sleep 0.2; done"
PAGE_OF_LOG = (
    "import re, sys, urllib.request as u; u.urlopen(re.search(r'http://\\S+', sys.stdin.read())[0])"
)
EXPLORED = f"""{{}} 2> explore.log &
until grep -q "Ctrl-C ends it" explore.log; do kill -0 $!; sleep 0.2; done
python -c "{PAGE_OF_LOG}" < explore.log
kill -INT $!
wait $!"""


def shell_lines(page):
    """Return the shell lines on a page, except those run elsewhere."""
    result = blocks("sh", page.read_text(encoding="utf-8"))
    lines = [line for block in result for line in block.splitlines()]
    return [line for line in lines if not line.startswith(RUN_ELSEWHERE)]


WITH_SHELL = [page for page in DOCUMENTS if shell_lines(page)]


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Return {command: folder}; pages that begin with the same command share its results."""
    return defaultdict(partial(tmp_path_factory.mktemp, "page"))


@pytest.mark.slow
@pytest.mark.parametrize("page", WITH_SHELL, ids=lambda path: path.stem)
def test_the_shell_lines_on_a_page_run_in_order(page, folders):
    """All lines run in one folder, which contains the page's JSON as a file.

    The processes of the cluster run on this machine. The explorer's page is requested once, then
    the explorer is stopped with Ctrl-C. The sweep on the cluster computes only a few rays; the main
    job, which the README runs earlier, computes as many rays as a user would.
    """
    folder = folders[shell_lines(page)[0]]
    for block in blocks("json", page.read_text(encoding="utf-8")):
        (folder / "doubled.json").write_text(block, encoding="utf-8")
    script = []
    for line in shell_lines(page):
        line = line.replace("/shared", str(folder)).replace("--nworkers 16", "--nworkers 2")
        if "--scheduler " in line:
            line = line.partition("#")[0] + " --n-rays 9 --n-cusp-rays 0"
        if line.startswith("dask "):
            script.append(SCHEDULER_FILE.format(line))
        elif line == EXPLORE:
            script.append(EXPLORED.format(line))
        else:
            script.append(line)
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    with (folder / "log").open("w") as log:
        shell = subprocess.Popen(
            ["bash", "-euc", "\n".join(script)],
            stdout=log,
            stderr=log,
            cwd=folder,
            env=os.environ | {"PATH": path, "BROWSER": "true"},  # the command `true` opens no page
            start_new_session=True,
        )
        code = shell.wait()
        with suppress(ProcessLookupError):  # end the scheduler and its workers
            os.killpg(shell.pid, signal.SIGTERM)
    assert code == 0, (folder / "log").read_text()[-3000:]
