"""A page to look at: one HTML file that opens offline, its facts as JSON, one PNG.

What a reconstruction does not know is left out of the page. Nothing is loaded from
anywhere: pictures and plots are inside the file.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ..drawing import maps, plots
from ..drawing.pictures import colour_map, encode_png
from ..drawing.render import render_views
from ..files import write_bytes, write_text
from ..images.colour import to_picture
from ..json_text import to_json
from ..progress import CheckCancelled, never_cancelled
from ..result import PhotoReport, Reconstruction
from ..texture.bake import Texture, bake_texture
from ..threads import one_blas_thread
from ..versions import VERSION, library_versions
from .page import page
from .photos import thumbnails
from .sheet import summary_sheet

#: Texels a side of the texture that is made for the page.
TEXTURE_SIZE = 512


@one_blas_thread()
def write_report(
    path: str | os.PathLike,
    reconstruction: Reconstruction,
    *,
    title: str | None = None,
    texture: Texture | None = None,
    textured: bool = True,
    timings: bool = True,
    companions: bool = True,
    progress: Callable[[float], None] | None = None,
) -> Path:
    """Write the page of a reconstruction.

    Parameters
    ----------
    path : path-like
        The ``.html`` file; ``.json`` and ``.png`` of the same name are written beside.
    reconstruction : Reconstruction
    title : str, optional
        By default the name of the photos' folder, or of the file.
    texture : Texture, optional
        Already baked; else a small one is baked for the page.
    textured : bool
        False: no texture, which saves some seconds.
    timings : bool
        Leave out what differs between two equal runs when False.
    companions : bool
        Also write the JSON and the PNG.
    progress : callable, optional
        Called with the fraction done.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    ReconstructionError
        When a file cannot be written.
    """
    path = Path(path)
    tell = progress or (lambda fraction: None)
    if not path.suffix:
        path = path.with_suffix(".html")
    if texture is None and textured and reconstruction.photos:
        texture = bake_texture(reconstruction, TEXTURE_SIZE, lambda x: tell(0.5 * x))
    title = title or _title(reconstruction, path)
    facts = report_facts(reconstruction, title, timings)
    tell(0.5)
    pictures = report_pictures(reconstruction, texture, partial(tell, 0.5))
    tell(0.8)
    if companions:
        write_text(path.with_suffix(".json"), to_json(facts, indent=1) + "\n")
        sheet = summary_sheet(reconstruction, facts, pictures)
        tell(0.85)
        write_bytes(path.with_suffix(".png"), encode_png(sheet))
    drawn = report_plots(reconstruction)
    tell(0.9)
    text = page(facts, pictures, drawn, thumbnails(reconstruction))
    tell(0.95)
    written = write_text(path, text)
    tell(1.0)
    return written


def report_facts(
    reconstruction: Reconstruction, title: str = "face", timings: bool = True
) -> dict[str, Any]:
    """Everything of the page that is not a picture, as plain values."""
    reports = [_entry(report) for report in reconstruction.reports]
    used = [entry for entry in reports if entry["status"] == "used"]
    pushed = [e["reprojection_pct"] for e in used]
    facts: dict[str, Any] = {
        "title": title,
        "program": "bsface",
        "versions": versions(),
        "photos": {"all": len(reports), "used": len(used)},
        "control_points": list(reconstruction.surface.shape),
        "reprojection_pct": _median(pushed),
        "settings": reconstruction.settings.to_dict(),
        "report": reports,
        "warnings": list(reconstruction.warnings),
        "history": [step._asdict() for step in reconstruction.history],
    }
    if reconstruction.cameras:
        facts["cameras"] = [
            {"photo": photo.name, **asdict(camera)}
            for photo, camera in zip(
                reconstruction.photos, reconstruction.cameras, strict=True
            )
        ]
    photometric = reconstruction.photometric
    if photometric is not None and photometric.singular_values is not None:
        values = np.asarray(photometric.singular_values, float)
        facts["singular_values"] = values
        energy = np.cumsum(values**2) / max(float((values**2).sum()), 1e-30)
        facts["rank_4_share"] = float(energy[min(3, len(energy) - 1)])
    if reconstruction.deviation is not None:
        facts["confidence_mm"] = {
            "median": float(np.median(reconstruction.deviation)),
            "worst": float(np.max(reconstruction.deviation)),
        }
    if timings and reconstruction.seconds:
        facts["seconds"] = dict(reconstruction.seconds)
    return facts


def report_pictures(
    reconstruction: Reconstruction,
    texture: Texture | None = None,
    check_cancelled: CheckCancelled = never_cancelled,
) -> dict[str, npt.NDArray[np.uint8]]:
    """The page's pictures by name, (h, w, 3) uint8 arrays."""
    surface, template = reconstruction.surface, reconstruction.template
    pictures = {
        "views": render_views(
            surface, template, height=460, check_cancelled=check_cancelled
        )
    }
    if texture is not None:
        skin = to_picture(texture.mean)
        pictures["textured"] = render_views(
            surface,
            template,
            height=460,
            colours=skin,
            shading=0.15,
            check_cancelled=check_cancelled,
        )
        pictures["albedo"] = _square(to_picture(texture.albedo), 420)
        pictures["mean"] = _square(skin, 420)
    for name, values in maps.derivative_maps(surface).items():
        check_cancelled()
        pictures[f"map_{name}"] = _map_picture(values, name)
    on_face = partial(_on_face, surface, template, check_cancelled)
    check_cancelled()
    residual = maps.residual_map(reconstruction.photometric)
    if residual is None and texture is not None:
        residual = np.asarray(texture.residual, float)
    if residual is not None:
        pictures["residual"] = on_face(residual, 0.0, 0.2)
    if reconstruction.deviation is not None:
        spread = maps.confidence_map(reconstruction.deviation)
        pictures["confidence"] = on_face(spread, 0.0, 2.0)
    if texture is not None:
        seen = np.asarray(texture.photos_seen, float)
        top = max(float(np.nanmax(seen)), 1.0)
        pictures["seen"] = on_face(seen, 0.0, top, "viridis")
    return pictures


def report_plots(reconstruction: Reconstruction) -> dict[str, str]:
    """SVG plots by name."""
    used = [_entry(r) for r in reconstruction.reports]
    used = [e for e in used if e["status"] == "used" and np.isfinite(e["yaw"])]
    drawn = {}
    if used:
        drawn["pose"] = plots.pose_plot(
            np.array([e["yaw"] for e in used]),
            np.array([e["pitch"] for e in used]),
            [e["name"] for e in used],
        )
    photometric = reconstruction.photometric
    if photometric is not None and np.size(photometric.lights):
        names = [photo.name for photo in reconstruction.photos]
        drawn["light"] = plots.light_plot(photometric.lights, names)
        values = photometric.singular_values
        if values is not None and np.size(values):
            drawn["singular"] = plots.singular_plot(values)
    history = reconstruction.history
    for stage in dict.fromkeys(step.stage for step in history):
        if plots.stage_residuals(history, stage):
            drawn[f"convergence_{stage}"] = plots.convergence_plot(history, stage)
    return drawn


def versions() -> dict[str, str]:
    """Versions that a rerun needs."""
    return {"bsface": VERSION, **library_versions()}


def _title(reconstruction: Reconstruction, path: Path) -> str:
    for photo in reconstruction.photos:
        if getattr(photo, "path", None) is not None:
            folder = Path(photo.path).parent.name
            if folder:
                return folder.replace("_", " ")
    return path.stem


def _entry(report: PhotoReport) -> dict[str, Any]:
    return asdict(report)


def _median(values: list[float]) -> float | None:
    finite = [v for v in values if v is not None and np.isfinite(v)]
    return float(np.median(finite)) if finite else None


def _square(picture: npt.NDArray[np.uint8], side: int) -> npt.NDArray[np.uint8]:
    return np.asarray(
        cv2.resize(picture, (side, side), interpolation=cv2.INTER_AREA), np.uint8
    )


def _map_picture(values: npt.NDArray, name: str) -> npt.NDArray[np.uint8]:
    if name == "z":
        return colour_map(values)
    # The rim bends most and says least: the scale is that of the middle.
    middle = values[len(values) // 8 : -len(values) // 8]
    reach = float(np.percentile(np.abs(middle), 97)) or 1.0
    return colour_map(values, -reach, reach, "diverging")


def _on_face(
    surface: Any,
    template: Any,
    check_cancelled: CheckCancelled,
    values: npt.NDArray,
    low: float,
    high: float,
    name: str = "magma",
) -> npt.NDArray[np.uint8]:
    """A map drawn on the face, three views."""
    colours = colour_map(values, low, high, name)
    return render_views(
        surface,
        template,
        height=300,
        colours=colours,
        shading=0.35,
        check_cancelled=check_cancelled,
    )
