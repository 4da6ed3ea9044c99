"""Fixtures that the tests of the add-on share."""

import pytest

bpy = pytest.importorskip("bpy", reason="needs Blender's module bpy")

from blender import checkout  # noqa: E402
from blender.checkout import load  # noqa: E402


def pytest_configure(config):
    if config.getoption("--from-zip"):
        checkout.use_zip()


@pytest.fixture
def empty_scene():
    """A file with nothing in it."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    return bpy.context.scene


@pytest.fixture(scope="session")
def registered():
    """The add-on's classes, registered as Blender would."""
    addon = load("bsface_addon")
    if checkout.is_installed():
        yield addon  # Blender did
        return
    addon.register()
    yield addon
    addon.unregister()


@pytest.fixture
def addon(registered, empty_scene):
    """The registered add-on in a file with nothing in it."""
    return registered


@pytest.fixture
def solved(monkeypatch, tmp_path):
    """Reconstruction without solving: operators get the made-up face.

    Returns the list of requests that were made.
    """
    from blender import faces

    pipeline = load("bsface_addon.pipeline")
    running = load("bsface_addon.operators.running")
    requests = []

    def solve(request, progress=None):
        requests.append(request)
        return pipeline.Outcome(faces.reconstruction(tmp_path / "photos"), {})

    monkeypatch.setattr(pipeline, "solve", solve)
    monkeypatch.setattr(running.LongOperator, "solve", staticmethod(solve))
    faces.photo_files(tmp_path / "photos")
    return requests
