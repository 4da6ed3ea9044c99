"""Arguments of wrong kinds: every public function refuses each in one sentence."""

import inspect

import bsface
import numpy as np
import pytest
from bsface import Detail, ReconstructionError
from bsface.formats import ExchangeCurve
from bsface.formats.curves import curve_on_surface
from bsface.photometry.lighting import PhotometricEvidence
from bsface.rig.mesh import QuadMesh
from bsface.surface.alignment import Similarity
from bsface.surface.coarse import coarse_net
from bsface.surface.deviation import Deviation, deviation
from fake_face import painted_reconstruction

PICTURE = np.zeros((40, 40, 3), np.uint8)
WRONG = [
    None,
    True,
    -1,
    float("nan"),
    "wrong",
    b"wrong",
    [3],
    {"a": 1},
    np.zeros(3),
    np.array(["a"]),
    object(),
    object,
]
#: As the signatures write them.
KINDS = {type(None): "None", bool: "bool", str: "str"}
FUNCTIONS = [
    name for name in bsface.__all__ if inspect.isfunction(getattr(bsface, name))
]


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    """Arguments with which each function works, or fails late in a known sentence."""
    place = tmp_path_factory.mktemp("kinds")
    face = painted_reconstruction(count=2, side=48)
    detail = Detail(np.zeros((8, 8), np.float32), np.zeros((8, 8, 3), np.float32))
    marks = face.landmarks[0]
    small = {"detector": False, "control_points": face.surface.shape}
    bsface.write_landmarks(place / "a.json", marks)
    face.save(place / "a.npz")
    return {
        "arkit_keys": {"face": face},
        "bake_texture": {"reconstruction": face, "size": 64, "detail": False},
        "compare": {"first": face.surface, "second": face.surface, "size": 8},
        "export": {"path": place / "a.igs", "face": face},
        "list_photos": {"folder": place},
        "load": {"path": place / "a.npz"},
        "load_template": {"path": place / "a.npz"},
        "read_landmarks": {"path": place / "a.json"},
        "reconstruct": {"photos": [PICTURE], "settings": {"detector": False}},
        "track": {"photos": [PICTURE], "face": face, "settings": small},
        "write_displacement": {"path": place / "a.png", "detail": detail},
        "write_landmarks": {"path": place / "b.json", "landmarks": marks},
        "write_normals": {"path": place / "a.png", "detail": detail},
        "write_report": {
            "path": place / "a.html",
            "reconstruction": bsface.load(place / "a.npz"),
            "textured": False,
        },
        "write_texture": {"path": place / "a.png", "linear": detail.normals},
    }


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_argument(name, good, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # where a file named "wrong" would be written
    function = getattr(bsface, name)
    for argument, parameter in inspect.signature(function).parameters.items():
        if argument == "changes":  # settings, see test_settings.py
            continue
        refused = 0
        for wrong in WRONG:
            if argument == "progress" and wrong is object:
                continue  # can be called, and says itself how
            if KINDS.get(type(wrong)) in parameter.annotation.split(" | "):
                continue
            try:
                function(**{**good[name], argument: wrong})
            except (TypeError, ValueError, ReconstructionError) as error:
                refused += 1
                said = str(error)
                # What Python and NumPy say is no sentence.
                assert said[-1] == "." and "\n" not in said, (argument, wrong, said)
        assert refused, argument


@pytest.mark.parametrize("name", ["face.step", "face.v2"])
def test_a_face_file_has_its_own_ending(good, tmp_path, name):
    with pytest.raises(ReconstructionError, match=rf"{name}: a face file ends in"):
        good["track"]["face"].save(tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_methods_refuse_what_is_no_surface_and_no_place(good):
    face = good["track"]["face"]
    with pytest.raises(TypeError, match="surface must be a BSplineSurface, not int"):
        face.with_surface(3)
    for function in (deviation, curve_on_surface, coarse_net):
        with pytest.raises(TypeError, match="must be a BSplineSurface, not Recon"):
            function(face, (12, 14))
    for place in (np.nan, np.inf, 1e300):
        with pytest.raises(ValueError, match="points must be finite places"):
            face.surface.closest_point([[0.0, 0.0, place]])
    uv, distance = face.surface.closest_point([])
    assert uv.shape == (0, 2) and distance.shape == (0,)


@pytest.mark.parametrize(
    "kind",
    [
        bsface.BSplineSurface,
        bsface.Camera,
        bsface.Comparison,
        bsface.Constraint,
        bsface.Detail,
        bsface.Landmarks,
        bsface.Photo,
        bsface.Reconstruction,
        bsface.Template,
        bsface.Texture,
        bsface.TrackedPhoto,
        Deviation,
        ExchangeCurve,
        PhotometricEvidence,
        QuadMesh,
        Similarity,
    ],
)
def test_what_holds_arrays_is_equal_to_itself_only(kind):
    """NumPy's answer to "equal" is no truth: `==` and `hash` of arrays fail."""
    one, other = object.__new__(kind), object.__new__(kind)
    for made in (one, other):
        made.__dict__.update(dict.fromkeys(kind.__dataclass_fields__, np.zeros(2)))
    assert one == one and one != other
    assert {one: 1}[one] == 1


def test_a_surface_is_told_from_another(good):
    face = good["track"]["face"]
    assert face.surface in [face.surface]
    assert face.surface != bsface.BSplineSurface(face.surface.control_points)
