"""Fixtures that the tests of the command line share."""

import dataclasses

import pytest
from bsface import Settings, reconstruct
from fake_face import person_folder


@pytest.fixture(scope="module")
def photos(tmp_path_factory):
    """Three drawn photos with landmark files beside them: no detector needed."""
    return person_folder(tmp_path_factory.mktemp("person") / "photos", count=3)


@pytest.fixture(scope="module")
def ready(photos):
    """A job that is done already; without photos the page takes no texture."""
    face = reconstruct(
        photos, Settings(method="motion", control_points=(10, 11), detector=False)
    )
    face = dataclasses.replace(face, photos=(), cameras=(), landmarks=())
    return lambda *args, **kwargs: face
