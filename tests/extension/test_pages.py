"""The pages that the zip brings: every link and every picture is there."""

import importlib.util
from html.parser import HTMLParser
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


class Found(HTMLParser):
    """Addresses and anchors of a page."""

    def __init__(self):
        super().__init__()
        self.links, self.anchors = [], []

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        self.links += [values[k] for k in ("href", "src") if k in values]
        self.anchors += [values[k] for k in ("id",) if k in values]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    spec = importlib.util.spec_from_file_location(
        "build_pages", ROOT / "tools" / "build_pages.py"
    )
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    made = tmp_path_factory.mktemp("manual")
    module.write_pages(made)
    return made


def read(path):
    found = Found()
    found.feed(path.read_text("utf-8"))
    return found


def test_every_link_leads_somewhere(folder):
    pages = {path.name: read(path) for path in folder.glob("*.html")}
    assert len(pages) == 6
    for name, page in pages.items():
        assert len(page.links) >= len(pages), name
        for link in page.links:
            if link.startswith("http"):
                continue
            file, _, anchor = link.partition("#")
            assert (folder / file).exists(), f"{name}: {link}"
            if anchor:
                assert anchor in pages[file or name].anchors, f"{name}: {link}"


def test_the_parts_that_buttons_open_are_in_the_guide(folder):
    pytest.importorskip("bpy", reason="needs Blender's module bpy")
    from blender.checkout import load

    parts = {part for _, part in load("bsface_addon.manual").PARTS}
    assert parts <= set(read(folder / "artist_guide.html").anchors)


def test_what_is_not_in_the_zip_is_text_and_tables_are_tables(folder):
    text = (folder / "settings.html").read_text("utf-8")
    assert "<table>" in text and "<code>control_points</code>" in text
    texts = [path.read_text("utf-8") for path in folder.glob("*.html")]
    assert not any(".md)" in t or '.md"' in t for t in texts)
