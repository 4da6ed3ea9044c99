"""The pages that came with the extension, opened in the user's browser.

In Blender, *Online Manual* in a button's context menu opens the part of the artist
guide that explains it.
"""

from __future__ import annotations

from pathlib import Path

import bpy

ROOT = Path(__file__).resolve().parents[1]
# As HTML in the extension (tools/build_pages.py), as Markdown in a checkout.
FOLDER, ENDING = (
    (ROOT / "manual", ".html") if (ROOT / "manual").is_dir() else (ROOT / "docs", ".md")
)
# Page -> the text of its button.
PAGES = {
    "artist_guide": "Artist Guide",
    "capture_guide": "How to Take the Photos",
    "troubleshooting": "Troubleshooting",
}
# Names of operators, the first that fits -> the part of the artist guide.
PARTS = (
    ("photos_*", "photos"),
    ("mask_*", "what-counts-as-skin"),
    ("skin_*", "what-counts-as-skin"),
    ("landmarks_*", "landmarks"),
    ("face_next", "landmarks"),
    ("reconstruct", "reconstruct"),
    ("surface_map", "texture"),
    ("surface_trim", "texture"),
    ("texture_*", "texture"),
    ("surface_*", "surface"),
    ("coarse_*", "surface"),
    ("full_head", "surface"),
    ("view_*", "cameras-and-light"),
    ("light_*", "cameras-and-light"),
    ("expression_*", "expressions"),
    ("arkit_keys", "expressions"),
    ("export", "export"),
    ("*", "artist-guide"),
)


def address(page: str) -> str:
    """The address of a page for a browser."""
    return (FOLDER / f"{page}{ENDING}").as_uri()


def draw(layout: bpy.types.UILayout) -> None:
    """A button for each page."""
    column = layout.column(align=True)
    for page, text in PAGES.items():
        column.operator("wm.url_open", text=text, icon="HELP").url = address(page)


def places() -> tuple[str, tuple[tuple[str, str], ...]]:
    """Where Blender finds the page of a button, for `bpy.utils`."""
    guide = address("artist_guide")
    return guide, tuple((f"bpy.ops.bsface.{name}", f"#{part}") for name, part in PARTS)


def register():
    bpy.utils.register_manual_map(places)


def unregister():
    bpy.utils.unregister_manual_map(places)
