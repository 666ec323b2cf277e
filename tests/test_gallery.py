"""The gallery: its commands are valid, and its page shows what the workflows have written."""

import re
import shlex
from html import unescape
from urllib.parse import unquote

import pytest
from commands import succeed

from workflows import gallery
from workflows.parts.cli import main_of


@pytest.mark.parametrize("exhibit", gallery.EXHIBITS, ids=lambda exhibit: exhibit.name)
def test_the_options_of_the_preview_are_valid(exhibit):
    main = main_of(exhibit.name)
    for options in (exhibit.quick, exhibit.full):
        with main.make_context("command", shlex.split(options)):
            pass


def test_the_page_shows_every_figure_with_its_caption_and_command(tmp_path, monkeypatch):
    out = tmp_path / "out put"
    small = gallery.Exhibit("Figures 3 & 4", "period_one", "--primary -4:4:40 --secondary 0:8:20")
    monkeypatch.setattr(gallery, "EXHIBITS", (small,))
    for _ in range(2):  # the second time the store is complete
        succeed("gallery", out, "--quick", "--workers", "1")
    page = (out / "index.html").read_text(encoding="utf-8")
    targets = set(map(unquote, re.findall(r'(?:href|src)="([^"]+)"', page)))
    assert all((out / target).exists() for target in targets)
    here = out / "period_one"
    pictures = {f"period_one/{path.name}" for path in here.glob("*.png")}
    assert len(pictures & targets) == 2
    words = unescape(page)
    for caption in here.glob("*.txt"):
        assert f"<figcaption>{caption.read_text(encoding='utf-8').strip()}</figcaption>" in words
    assert "<h2>Figures 3 &amp; 4</h2>" in page
    command = shlex.split(re.search("<code>(python -m .*)</code>", words)[1])
    assert command[:3] == ["python", "-m", "workflows.period_one"]
    assert command[-2:] == ["--out", str(here)]
