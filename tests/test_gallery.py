"""The gallery: its commands are valid, and its page shows what the workflows have written."""

import shlex
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import pytest
from commands import succeed

from workflows import gallery
from workflows.parts.cli import main_of


class Links(HTMLParser):
    def __init__(self):
        super().__init__()
        self.targets, self.texts = [], []

    def handle_starttag(self, tag, attrs):
        attrs = dict(attrs)
        self.targets += [attrs[key] for key in ("href", "src") if key in attrs]

    def handle_data(self, data):
        self.texts.append(data.strip())


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
    links = Links()
    links.feed((out / "index.html").read_text(encoding="utf-8"))
    assert all((out / unquote(target)).exists() for target in links.targets)
    pictures = {target for target in links.targets if target.endswith(".png")}
    assert {f"period_one/{path.name}" for path in (out / "period_one").glob("*.png")} == pictures
    assert len(pictures) == 2
    for caption in (out / "period_one").glob("*.txt"):
        assert caption.read_text(encoding="utf-8").strip() in links.texts
    assert "Figures 3 & 4" in links.texts
    (command,) = [text for text in links.texts if text.startswith("python -m")]
    words = shlex.split(command)
    assert words[:3] == ["python", "-m", "workflows.period_one"]
    assert words[-2:] == ["--out", str(Path(out) / "period_one")]
