"""The page: self-contained, complete, honest about what is missing."""

import dataclasses
import html.parser
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from bsface.batch.record import Outcome, batch_facts
from bsface.drawing import maps, plots
from bsface.errors import ReconstructionError
from bsface.formats import load_face
from bsface.json_text import to_json
from bsface.report import page, report
from bsface.report.facts import failure_facts, result_facts
from bsface.result import HistoryEntry
from bsface.texture.bake import bake_texture
from fake_face import (
    PhotoReport,
    bare_reconstruction,
    face_surface,
    painted_reconstruction,
)
from json_schema import RESULT_SCHEMA as SCHEMA
from json_schema import problems

VOID = {"meta", "img", "br", "hr", "link", "input"}


class Page(html.parser.HTMLParser):
    """Collects what a page refers to, and checks that its tags close."""

    def __init__(self, text):
        super().__init__()
        self.sources, self.open, self.words = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        if tag not in VOID:
            self.open.append(tag)
        for name, value in attributes:
            if name in ("src", "href", "srcset", "action"):
                self.sources.append(value)

    def handle_startendtag(self, tag, attributes):
        pass

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)


@pytest.fixture(scope="module")
def face():
    painted = painted_reconstruction(5)
    failures = (
        PhotoReport(
            "<b>&.jpg", "no_face", "<b>&.jpg: no face was found.", *[np.nan] * 6
        ),
    )
    return dataclasses.replace(painted, reports=painted.reports + failures)


@pytest.fixture(scope="module")
def written(face, tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    return report.write_report(folder / "face.html", face)


def test_page_needs_nothing_from_outside(written):
    text = written.read_text("utf-8")
    page = Page(text)
    assert not page.open
    assert page.sources and all(s.startswith("data:image/") for s in page.sources)
    assert "<script" not in text and "@import" not in text and "url(" not in text
    assert "http:" not in text and "https:" not in text


def test_every_photo_is_there_with_its_reason(written, face):
    words = " ".join(Page(written.read_text("utf-8")).words)
    for entry in face.reports:
        assert entry.name in words and entry.reason in words
    assert "5 of 6" in words and face.warnings[0] in words


def test_every_used_photo_is_there_with_its_skin(written, face, tmp_path):
    text = written.read_text("utf-8")
    assert text.count(', skin" src=') == len(face.photos)
    bare = report.write_report(tmp_path / "a.html", face, textured=False)
    assert ', skin" src=' not in bare.read_text("utf-8")


def test_json_says_the_same(written, face):
    facts = json.loads(written.with_suffix(".json").read_text("utf-8"))
    assert facts["photos"] == {"all": 6, "used": 5}
    assert facts["files"] == ["face.html", "face.json", "face.png"]
    assert [e["name"] for e in facts["report"]] == [e.name for e in face.reports]
    assert facts["report"][-1]["yaw"] is None
    assert facts["residuals"] == {"reprojection_pct": 1.2, "intensity": 0.05}
    assert facts["settings"] == face.settings.to_dict()
    np.testing.assert_allclose(facts["cameras"][2]["R"], face.cameras[2].R)
    assert facts["seconds"] == {"photos": 1.5, "refine": 3.0}


@pytest.mark.parametrize("kind", ["whole", "bare", "failed", "batch"])
def test_json_is_that_of_the_schema(face, kind):
    facts = {
        "whole": lambda: result_facts(face, files=["face.npz"]),
        "bare": lambda: result_facts(bare_reconstruction(), timings=False),
        "failed": lambda: failure_facts("a.jpg is missing; copy it again."),
        "batch": lambda: batch_facts([Outcome("ann", "failed", "No photos.")]),
    }[kind]()
    assert not problems(json.loads(to_json(facts)), SCHEMA)


def test_schema_refuses_what_is_not_a_result(face):
    """The validator and the schema find a missing key, a surplus one, a wrong kind."""
    facts = json.loads(to_json(result_facts(face)))
    without = {key: value for key, value in facts.items() if key != "report"}
    assert problems(without, SCHEMA)
    assert problems(facts | {"outputs": []}, SCHEMA)
    assert problems(facts | {"schema": 2}, SCHEMA)
    assert problems(facts | {"control_points": ["a", "b"]}, SCHEMA)


def test_sheet_is_a_picture(written):
    sheet = cv2.imread(str(written.with_suffix(".png")))
    assert sheet.shape[1] == 1280 and (sheet != 255).mean() > 0.15
    assert len(list(written.parent.iterdir())) == 3


def test_equal_runs_give_equal_pages(face, tmp_path):
    later = dataclasses.replace(face, seconds={"photos": 99.0})
    pages = [
        report.write_report(
            tmp_path / f"{i}.html",
            r,
            title="face",
            timings=False,
            textured=False,
            companions=(),
        ).read_bytes()
        for i, r in enumerate((face, later))
    ]
    assert pages[0] == pages[1]


def test_what_is_not_known_is_left_out(tmp_path):
    path = report.write_report(tmp_path / "bare", bare_reconstruction())
    assert path.name == "bare.html"
    text = path.read_text("utf-8")
    for heading in ("Photos", "Coverage", "Convergence", "Texture", "trust"):
        assert f">{heading}" not in text
    assert "Depth and its derivatives" in text and not Page(text).open


def test_folder_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ReconstructionError, match="cannot be written"):
        report.write_report(tmp_path / "file" / "a.html", bare_reconstruction())


# --------------------------------------------------------------------- maps
def test_derivative_maps_are_the_derivatives():
    surface, h = face_surface(), 1e-4
    found = maps.derivative_maps(surface, 9)
    at = (np.arange(9) + 0.5) / 9
    u, v = np.meshgrid(at, at)

    def z(du=0.0, dv=0.0):
        return surface.evaluate(u + du, v + dv)[..., 2]

    np.testing.assert_allclose(found["z"], z())
    numeric = {
        "z_u": (z(h) - z(-h)) / (2 * h),
        "z_v": (z(0, h) - z(0, -h)) / (2 * h),
        "z_uu": (z(h) - 2 * z() + z(-h)) / h**2,
        "z_vv": (z(0, h) - 2 * z() + z(0, -h)) / h**2,
        "z_uv": (z(h, h) - z(h, -h) - z(-h, h) + z(-h, -h)) / (4 * h**2),
    }
    for name, expected in numeric.items():
        scale = np.abs(expected).max()
        np.testing.assert_allclose(found[name], expected, atol=2e-2 * scale)


def test_confidence_map_of_a_constant_is_constant():
    np.testing.assert_allclose(maps.confidence_map(np.full((8, 9), 0.7), 12), 0.7)


def test_residual_map_ignores_rejected_samples(face):
    assert maps.residual_map(None) is None
    weights, residual = np.ones((2, 50)), np.full((2, 50), 0.1)
    weights[1], residual[1] = 0, 9.0
    evidence = dataclasses.replace(face.photometric, weights=weights, residual=residual)
    found = maps.residual_map(evidence)
    np.testing.assert_allclose(found[np.isfinite(found)], 0.1)


# -------------------------------------------------------------------- plots
def test_light_directions_point_to_the_light():
    lights = np.zeros((3, 9))
    lights[:, 0] = 1
    lights[0, 3], lights[1, 1], lights[2, 2] = 0.5, 0.5, 0.5
    directions, strength = plots.light_directions(lights)
    np.testing.assert_allclose(directions[:, 1], [0, 90, 90], atol=1e-6)
    np.testing.assert_allclose(directions[1:, 0], [0, np.pi / 2])
    np.testing.assert_allclose(strength, 0.5)


def test_pose_zones_count_each_photo_once():
    rng = np.random.default_rng(1)
    yaw, pitch = rng.uniform(-74, 74, 200), rng.uniform(-39, 39, 200)
    zones = plots.pose_zones(yaw, pitch)
    assert len(zones) == 9 and sum(z[-1] for z in zones) == 200


@pytest.mark.parametrize(
    "values", [[3.0], [0.5, 0.5], [1e-6, 2e-6], [0.0606, 0.044], [0.0]]
)
def test_convergence_plot_takes_any_history(values):
    history = [HistoryEntry("a", v, 0.0) for v in values]
    history += [HistoryEntry("b", 1.0, 0.0), HistoryEntry("a", np.nan, 0.0)]
    assert plots.stage_residuals(history, "a") == values
    drawn = plots.convergence_plot(history, "a")
    assert drawn.count("<circle") == len(values) and "nan" not in drawn


def test_page_says_how_often_the_stated_deviation_holds(written):
    """With the figure that the benchmark printed for all sets."""
    pages = Path(__file__).resolve().parents[2] / "docs" / "accuracy.md"
    _, _, table = pages.read_text("utf-8").partition("<!-- table reliability -->")
    rows = [row.strip("| ").split(" | ") for row in table.strip().splitlines()]
    head, mean = rows[0], next(row for row in rows if row[0] == "mean")
    assert mean[head.index("68%")] == f"{page.WITHIN_DEVIATION}%"
    sentence = f"{page.WITHIN_DEVIATION} % of the skin lies within one standard"
    assert sentence in written.read_text("utf-8")


def test_a_face_that_was_loaded_has_a_page_too(tmp_path):
    """Its photos have names and no pixels: what needs those is left out."""
    path = painted_reconstruction(count=2, side=60).save(tmp_path / "a.npz")
    face = load_face(path)
    written = report.write_report(tmp_path / "a.html", face)
    assert "000.png" in written.read_text("utf-8")
    assert report.thumbnails(face) == {}
    with pytest.raises(ReconstructionError, match="needs the photos"):
        bake_texture(face)


@pytest.mark.parametrize("name", ["rep.pdf", "rep.png", "rep.json", "face.npz"])
def test_a_page_ends_in_html(tmp_path, name):
    with pytest.raises(ValueError, match=rf"{name}: the page must end in \.html"):
        report.write_report(tmp_path / name, bare_reconstruction())
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("axes", [(0, 0, 0), (1, 0, 0), (0, 1, 0)])
def test_a_collapsed_face_cannot_be_drawn(tmp_path, axes):
    face = bare_reconstruction()
    net = face.surface.control_points * axes
    collapsed = face.with_surface(type(face.surface)(net))
    with pytest.raises(ReconstructionError, match="collapsed to a point or a line"):
        report.write_report(tmp_path / "a.html", collapsed, textured=False)
    assert not list(tmp_path.iterdir())
