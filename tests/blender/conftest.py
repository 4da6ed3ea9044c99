"""Fixtures that the tests of the add-on share."""

import shutil

import pytest

bpy = pytest.importorskip("bpy", reason="needs Blender's module bpy")

from blender import checkout  # noqa: E402
from blender.checkout import load  # noqa: E402


def pytest_configure(config):
    if config.getoption("--from-zip"):
        checkout.use_zip()


@pytest.fixture
def example_photos():
    """Copies some of the example photos into a folder, where the networks can run."""
    try:
        load("core.landmarks.face_models").find_models()
    except load("core.errors").ReconstructionError as error:
        pytest.skip(f"no face models: {error}")

    def copied(folder, numbers):
        for number in numbers:
            path = checkout.ROOT / "examples" / "photos" / f"{number:03}.jpg"
            shutil.copy(path, folder)
        return folder

    return copied


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
def solver(registered, tmp_path):
    """The session's solver for this test: answers with the made-up face."""
    from blender import faces

    faces.photo_files(tmp_path / "photos")
    now = load("bsface_addon.session").current()
    real, now.solver = now.solver, faces.FakeSolver(tmp_path / "photos")
    yield now.solver
    now.solver = real


@pytest.fixture
def solved(solver):
    """Reconstruction without solving; the list of requests that were made."""
    return solver.requests


@pytest.fixture
def face(addon, solved, tmp_path):
    """A face made by the operator."""
    bpy.ops.bsface.reconstruct(directory=str(tmp_path / "photos"), name="Ann")
    solved.clear()
    return bpy.context.scene.bsface.face
