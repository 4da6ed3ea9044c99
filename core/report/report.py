"""A page to look at: one HTML file that opens offline, its facts as JSON, one PNG.

What a reconstruction does not know is left out of the page. Nothing is loaded from
anywhere: pictures and plots are inside the file.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from ..drawing import maps, plots
from ..drawing.pictures import colour_map, encode_png
from ..drawing.render import View, face_views, side_by_side
from ..files import write_bytes, write_text
from ..images.colour import to_picture
from ..json_text import to_json
from ..kinds import CALLBACK, SWITCH, expect, expect_paths
from ..progress import CheckCancelled, never_cancelled
from ..result import Reconstruction
from ..texture.bake import Texture, bake_texture
from ..threads import one_blas_thread
from .facts import folder_name, result_facts
from .page import page
from .photos import skin_pictures, thumbnails
from .sheet import summary_sheet

#: Of the page itself.
PAGE_ENDINGS = (".html", ".htm")
#: Endings of what is written beside the page.
COMPANIONS = (".json", ".png")
#: Texels a side of the texture that is made for the page.
TEXTURE_SIZE = 512
#: Pixels of a map that is drawn on the face.
MAP_HEIGHT = 300


@one_blas_thread()
def write_report(
    path: str | os.PathLike,
    reconstruction: Reconstruction,
    *,
    title: str | None = None,
    texture: Texture | None = None,
    textured: bool = True,
    timings: bool = True,
    companions: Sequence[str] = COMPANIONS,
    progress: Callable[[float], None] | None = None,
) -> Path:
    """Write the page of a reconstruction.

    Parameters
    ----------
    path : path-like
        The ``.html`` file; its companions have the same name.
    reconstruction : Reconstruction
    title : str, optional
        By default the name of the photos' folder, or of the file.
    texture : Texture, optional
        Already baked; else a small one is baked for the page.
    textured : bool
        False: no texture, which saves some seconds.
    timings : bool
        Leave out what differs between two equal runs when False.
    companions : sequence of str
        Endings of what is written beside the page: ``.json`` (`facts.result_facts`)
        and ``.png`` (the page as one picture).
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
    ValueError
        When the page's name ends in something else than .html or .htm.
    """
    expect_paths(path=path)
    expect(Reconstruction, "a Reconstruction", reconstruction=reconstruction)
    expect(str | None, "a text", title=title)
    expect(Texture | None, "a Texture", texture=texture)
    expect(SWITCH, "true or false", textured=textured, timings=timings)
    expect(CALLBACK, "a function", progress=progress)
    expect(list | tuple, "a list of endings", companions=companions)
    if any(ending not in COMPANIONS for ending in companions):
        raise ValueError(
            f"companions must be some of {', '.join(COMPANIONS)}, not {companions!r}."
        )
    path = report_files(path)[0]
    if path.suffix.lower() not in PAGE_ENDINGS:
        raise ValueError(f"{path}: the page must end in .html.")
    tell = progress or (lambda fraction: None)
    if texture is None and textured and reconstruction.has_pixels:
        texture = bake_texture(
            reconstruction, TEXTURE_SIZE, lambda x: tell(0.5 * x), detail=False
        )
    facts = result_facts(
        reconstruction,
        title=title or folder_name(reconstruction) or path.stem,
        files=[file.name for file in report_files(path, companions)],
        timings=timings,
    )
    tell(0.5)
    pictures = report_pictures(reconstruction, texture, partial(tell, 0.5))
    tell(0.8)
    if ".json" in companions:
        write_text(path.with_suffix(".json"), to_json(facts, indent=1) + "\n")
    if ".png" in companions:
        sheet = summary_sheet(reconstruction, facts, pictures)
        tell(0.85)
        write_bytes(path.with_suffix(".png"), encode_png(sheet))
    drawn = report_plots(reconstruction)
    tell(0.9)
    skin = {}
    if texture is not None and reconstruction.has_pixels:
        skin = skin_pictures(reconstruction.photos, texture.skin)
    text = page(facts, pictures, drawn, thumbnails(reconstruction), skin)
    tell(0.95)
    written = write_text(path, text)
    tell(1.0)
    return written


def report_files(
    path: str | os.PathLike, companions: Sequence[str] = COMPANIONS
) -> tuple[Path, ...]:
    """The files that `write_report` writes for a page, the page first."""
    path = Path(path)
    if not path.suffix:
        path = path.with_suffix(".html")
    return (path, *(path.with_suffix(ending) for ending in companions))


def report_pictures(
    reconstruction: Reconstruction,
    texture: Texture | None = None,
    check_cancelled: CheckCancelled = never_cancelled,
) -> dict[str, npt.NDArray[np.uint8]]:
    """The page's pictures by name, (h, w, 3) uint8 arrays."""
    surface = reconstruction.surface
    views = face_views(
        surface, reconstruction.template, height=460, check_cancelled=check_cancelled
    )
    pictures = {"views": side_by_side(views)}
    if texture is not None:
        check_cancelled()
        skin = to_picture(texture.mean)
        pictures["textured"] = side_by_side(views, skin, 0.15)
        pictures["albedo"] = _square(to_picture(texture.albedo), 420)
        pictures["mean"] = _square(skin, 420)
    for name, values in maps.derivative_maps(surface).items():
        check_cancelled()
        pictures[f"map_{name}"] = _map_picture(values, name)
    on_face = partial(_on_face, views)
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
    used = [
        r for r in reconstruction.reports if r.status == "used" and np.isfinite(r.yaw)
    ]
    drawn = {}
    if used:
        drawn["pose"] = plots.pose_plot(
            np.array([r.yaw for r in used]),
            np.array([r.pitch for r in used]),
            [r.name for r in used],
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
    views: Sequence[View],
    values: npt.NDArray,
    low: float,
    high: float,
    name: str = "magma",
) -> npt.NDArray[np.uint8]:
    """A map drawn on the face, three views."""
    picture = side_by_side(views, colour_map(values, low, high, name), 0.35)
    width = round(picture.shape[1] * MAP_HEIGHT / picture.shape[0])
    small = cv2.resize(picture, (width, MAP_HEIGHT), interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.uint8)
