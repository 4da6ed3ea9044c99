"""The pages of docs/ for people at Blender, as HTML for the extension's zip.

    python tools/build_pages.py FOLDER

Links between these pages, and their pictures, work in the folder; a link to anything
else of the checkout becomes plain text.
"""

import html
import re
import shutil
import sys
from pathlib import Path

from markdown_it import MarkdownIt
from markdown_it.token import Token

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGES = (
    "artist_guide",
    "capture_guide",
    "troubleshooting",
    "settings",
    "file_formats",
    "headless",
)
STYLE = """
body { font: 16px/1.55 system-ui, sans-serif; max-width: 52rem; margin: 0 auto;
       padding: 1rem 1.5rem 4rem; color: #222; background: #fff; }
nav { border-bottom: 1px solid #ccc; padding-bottom: .6rem; }
nav a { margin-right: 1.2rem; }
img { max-width: 100%; }
code { background: #f0f0f0; padding: 0 .2em; }
pre { background: #f0f0f0; padding: .7rem; overflow-x: auto; }
table { border-collapse: collapse; }
th, td { border: 1px solid #ccc; padding: .25rem .6rem; text-align: left;
         vertical-align: top; }
"""


def write_pages(folder: Path) -> None:
    """Write all pages and the pictures that they show."""
    parser = MarkdownIt("commonmark").enable("table")
    parsed = {
        page: parser.parse((DOCS / f"{page}.md").read_text("utf-8")) for page in PAGES
    }
    titles = {page: tokens[1].content for page, tokens in parsed.items()}
    links = "\n".join(
        f'<a href="{page}.html">{html.escape(title)}</a>'
        for page, title in titles.items()
    )
    folder.mkdir(parents=True, exist_ok=True)
    for page, tokens in parsed.items():
        for picture in _adapted(tokens):
            target = folder / picture
            target.parent.mkdir(exist_ok=True)
            shutil.copy(DOCS / picture, target)
        body = parser.renderer.render(tokens, parser.options, {})
        text = (
            '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
            f"<title>BSface: {html.escape(titles[page])}</title>\n"
            f"<style>{STYLE}</style>\n</head>\n<body>\n<nav>\n{links}\n</nav>\n"
            f"{body}</body>\n</html>\n"
        )
        (folder / f"{page}.html").write_text(text, "utf-8")


def _adapted(tokens: list[Token]) -> list[str]:
    """Name the headings and turn the links to the pages; the pictures that are shown.

    The tokens are changed in place.
    """
    pictures = []
    for before, token in zip([None, *tokens], tokens, strict=False):
        if token.type != "inline":
            continue
        if before is not None and before.type == "heading_open":
            before.attrSet("id", anchor(token.content))
        outwards = False
        for part in token.children or []:
            if part.type == "image":
                pictures.append(str(part.attrGet("src")))
            elif part.type == "link_open":
                address = _address(str(part.attrGet("href")))
                outwards = address is None
                part.hidden = outwards
                part.attrSet("href", address or "")
            elif part.type == "link_close":
                part.hidden = outwards
    return pictures


def anchor(heading: str) -> str:
    """The name of a heading in links, as code hosts make it."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


def _address(link: str) -> str | None:
    """A link of the Markdown in the HTML; None for what is not in the zip."""
    if re.match(r"https?:|#", link):
        return link
    page, dot, rest = link.partition(".md")
    return f"{page}.html{rest}" if dot and page in PAGES else None


if __name__ == "__main__":
    write_pages(Path(sys.argv[1]))
