"""The guide opens from the buttons and from *Online Manual* of every operator."""

from pathlib import Path
from urllib.parse import urlparse
from urllib.request import url2pathname

import pytest
from bl_operators.wm import WM_OT_doc_view_manual
from blender.checkout import load

manual = load("bsface_addon.manual")


def file_of(address):
    parts = urlparse(address)
    assert parts.scheme == "file"
    return Path(url2pathname(parts.path)), parts.fragment


@pytest.mark.parametrize("page", list(manual.PAGES))
def test_pages_are_there(page):
    path, _ = file_of(manual.address(page))
    assert path.is_file()


@pytest.mark.parametrize(
    ("name", "part"),
    [
        ("photos_add", "photos"),
        ("surface_map", "texture"),
        ("surface_refit", "surface"),
        ("reset", "artist-guide"),
    ],
)
def test_online_manual_of_an_operator(addon, name, part):
    found = WM_OT_doc_view_manual._lookup_rna_url(f"bpy.ops.bsface.{name}")
    path, fragment = file_of(found)
    assert path.stem == "artist_guide" and path.is_file()
    assert fragment == part


def test_other_operators_keep_their_pages(addon):
    found = WM_OT_doc_view_manual._lookup_rna_url("bpy.ops.mesh.subdivide")
    assert "docs.blender.org" in found
