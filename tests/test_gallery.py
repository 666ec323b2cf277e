"""The gallery: its commands are valid, and its page shows what the workflows have written."""

import ast
import json
import re
import shlex
import subprocess
import sys
from html import unescape
from pathlib import Path
from urllib.parse import unquote

import pytest
import xarray as xr
from click.testing import CliRunner
from commands import follow, succeed, table
from every_command import SMALLEST

import nasm
from workflows.gallery import __main__ as gallery
from workflows.gallery import release
from workflows.gallery.exhibits import Exhibit
from workflows.shared.cli import main_of
from workflows.shared.judgement import Verdict


@pytest.mark.parametrize(
    "exhibit",
    gallery.EXHIBITS + release.RELEASE + release.FULL_MAP,
    ids=lambda exhibit: exhibit.name,
)
def test_the_options_of_every_exhibit_are_valid(exhibit):
    main = main_of(exhibit.program)
    for options in (exhibit.quick, exhibit.full):
        with main.make_context("command", shlex.split(options)):
            pass


SMALL = [
    Exhibit("period_one", "Figures 3 & 4", SMALLEST["period_one"]),
    Exhibit("critical_boundary", "All", SMALLEST["critical_boundary"]),
]


@pytest.fixture(scope="module")
def page(tmp_path_factory, workers):
    """Return the page of small exhibits after two runs; the second has nothing left to compute."""
    out = tmp_path_factory.mktemp("gallery") / "out put"
    (out / "claims").mkdir(parents=True)
    rows = [f"Sec. I,T_κ1κ2 is a map,{'x' * 300},{verdict.value}" for verdict in Verdict]
    claims = "\n".join(["place,statement,value,verdict", *rows])
    (out / "claims" / "claims.csv").write_text(claims, encoding="utf-8")
    (out / "claims" / "claims.txt").write_text("Of 4 claims 1 hold.\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gallery, "EXHIBITS", SMALL)
        for _ in range(2):
            output = succeed("gallery", out, *workers)
    assert "3 figures from 2 commands on one page. Of 4 claims 1 hold." in output
    return out / "index.html"


def test_the_page_shows_claims_version_and_each_figure_with_its_command(page):
    text, here = page.read_text(encoding="utf-8"), page.parent / "period_one"
    targets = set(map(unquote, re.findall(r'(?:href|src)="([^"#:]+)"', text)))
    assert all((page.parent / target).exists() for target in targets - {"claims/claims.html"})
    assert {f"period_one/{path.name}" for path in here.glob("*.png")} < targets
    words = unescape(text)
    for caption in here.glob("*.txt"):
        assert f"<figcaption>{caption.read_text(encoding='utf-8').strip()}</figcaption>" in words
    assert '<h2 id="period_one">Figures 3 &amp; 4</h2>' in text
    command = shlex.split(re.search("<code>(python -m .*period_one.*)</code>", words)[1])
    assert command[2] == "workflows.period_one"
    assert command[-2:] == ["--out", "period_one"]
    text = " ".join(text.split())
    assert "A preview" in text
    assert f"nasm {nasm.__version__}" in text
    assert "Of 4 claims 1 hold." in text
    for verdict in Verdict:
        assert f'<tr class="{verdict.value.replace(" ", "-")}">' in text


def test_the_code_below_figures_runs_as_a_script_and_as_a_notebook(page):
    text, out = unescape(page.read_text(encoding="utf-8")), page.parent
    for exhibit in SMALL:
        script = out / "recipes" / f"{exhibit.name}.py"
        assert f"<pre><code>{script.read_text(encoding='utf-8')}</code></pre>" in text
        message = follow(script, out)
        notebook = json.loads(script.with_suffix(".ipynb").read_text(encoding="utf-8"))
        cells = notebook["cells"]
        assert (notebook["nbformat"], notebook["nbformat_minor"]) == (4, 5)
        assert [cell["id"] for cell in cells] == ["text", "code"]
        assert [cell["cell_type"] for cell in cells] == ["markdown", "code"]
        script.with_name("cell.py").write_text(cells[1]["source"])
        assert follow(script.with_name("cell.py"), out) == message
    rows = table(out / "critical_boundary/critical_boundary.csv")
    for circle in {row["circle"] for row in rows}:
        count = sum(row["circle"] == circle for row in rows)
        assert re.search(rf"^{re.escape(circle)} +{count}$", message, re.MULTILINE)


def test_every_exhibit_has_a_recipe():
    recipes = gallery.recipes()
    assert list(recipes) == [exhibit.name for exhibit in gallery.EXHIBITS]
    for name, script in recipes.items():
        assert ast.get_docstring(ast.parse(script, name))


@pytest.mark.parametrize(
    "parts",
    [
        pytest.param(1, id="the boundary"),
        pytest.param(4, id="with certificates", marks=pytest.mark.slow),
        pytest.param(99, id="all", marks=pytest.mark.release),
    ],
)
def test_a_release_is_complete_and_intact_and_states_how_it_was_made(parts, tmp_path, monkeypatch):
    monkeypatch.setattr(release, "RELEASE", exhibits := release.RELEASE[:parts])
    result = CliRunner().invoke(gallery.main, ["--release", str(tmp_path), "--quick"])
    assert result.exit_code == 0, result.output
    assert float(re.search(r"release: .*, (\S+) MB", result.output)[1]) < 10
    subprocess.run(["sha256sum", "--check", "--strict", release.SUMS], cwd=tmp_path, check=True)
    summed = [line[66:] for line in (tmp_path / release.SUMS).read_text().splitlines()]
    there = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file()}
    assert {*summed} == {name for name in there if not name.endswith(".lock")} - {release.SUMS}
    about = json.loads((tmp_path / ".zenodo.json").read_text(encoding="utf-8"))
    citation = Path("CITATION.cff").read_text(encoding="utf-8")
    assert f"version: {about['version']}" in citation
    assert f"license: {about['license']}" in citation
    assert about["creators"][0]["name"] in citation
    assert (tmp_path / "LICENSE").read_text() == Path("LICENSE").read_text()
    if parts > 1:
        certificates = sorted((tmp_path / "proved_map/certificates/proved_map").iterdir())
        smallest = min(certificates, key=lambda path: path.stat().st_size)
        check = [sys.executable, "-I", "certificate_checker.py", smallest]
        claim = subprocess.run(check, cwd=tmp_path, check=True, capture_output=True, text=True)
        assert "proved: transport is global under every forcing within" in claim.stdout
    output = (tmp_path / "README.md").read_text(encoding="utf-8")
    for exhibit in exhibits:
        folder = tmp_path / exhibit.name
        assert "damaged" not in succeed("verify", folder)
        program, name = exhibit.program, exhibit.name
        command = re.search(rf"python -m workflows.{program} .*--out {name}$", output, re.M)[0]
        planned = succeed(program, folder, *shlex.split(command)[3:-2], "--dry-run")
        assert re.search("in all +0 tiles", planned)  # the cube was made by the command shown
        (cube, *_) = folder.glob("*.zarr")
        assert xr.open_zarr(cube).attrs["computed_by"] in output
