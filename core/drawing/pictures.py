"""Numbers as colours, and pictures as PNG or JPEG. RGB order, row 0 at the top."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from ..files import write_bytes
from ..images.png import marked


# ---------------------------------------------------------------- colour maps
def colour_map(
    values: npt.ArrayLike,
    low: float | None = None,
    high: float | None = None,
    name: str = "viridis",
) -> npt.NDArray[np.uint8]:
    """Numbers as colours.

    Parameters
    ----------
    values : array
        NaN becomes light grey.
    low, high : float, optional
        Ends of the scale; 2 and 98 % of the values by default.
    name : "viridis", "magma" or "diverging"
        "diverging" is blue below the middle, white in it, red above.

    Returns
    -------
    (..., 3) uint8 array
    """
    values = np.asarray(values, float)
    finite = np.isfinite(values)
    if low is None:
        low = float(np.percentile(values[finite], 2)) if finite.any() else 0.0
    if high is None:
        high = float(np.percentile(values[finite], 98)) if finite.any() else 1.0
    span = high - low or 1.0
    position = np.clip((np.where(finite, values, low) - low) / span, 0, 1)
    index = np.round(position * 255).astype(np.uint8)
    coloured = _colour_table(name)[index]
    coloured[~finite] = (225, 225, 225)
    return coloured


def _colour_table(name: str) -> npt.NDArray[np.uint8]:
    """(256, 3) uint8 RGB table of a colour map."""
    if name == "diverging":
        stops = np.array([[33, 72, 160], [247, 247, 247], [178, 24, 43]], float)
        at = np.linspace(0, 2, 256)
        columns = [np.interp(at, [0, 1, 2], stops[:, c]) for c in range(3)]
        return np.round(np.stack(columns, axis=1)).astype(np.uint8)
    maps = {"viridis": cv2.COLORMAP_VIRIDIS, "magma": cv2.COLORMAP_MAGMA}
    if name not in maps:
        raise ValueError(f"colour map must be one of {[*maps, 'diverging']}: {name!r}")
    ramp = np.arange(256, dtype=np.uint8)[:, None]
    table = cv2.applyColorMap(ramp, maps[name])[:, 0, ::-1]
    return np.ascontiguousarray(table, np.uint8)


# ------------------------------------------------------------------- encoding
def encode_png(image: npt.NDArray) -> bytes:
    """PNG bytes of an (H, W), (H, W, 3) or (H, W, 4) uint8 or uint16 picture.

    They carry the note that bsface wrote them, by which a folder of photos passes
    them over.
    """
    if image.ndim == 3:
        order = cv2.COLOR_RGB2BGR if image.shape[2] == 3 else cv2.COLOR_RGBA2BGRA
        image = cv2.cvtColor(image, order)
    done, data = cv2.imencode(".png", image)
    if not done:
        raise ValueError(f"picture of shape {image.shape} cannot be encoded as PNG")
    return marked(data.tobytes())


def encode_jpeg(image: npt.NDArray[np.uint8], quality: int = 85) -> bytes:
    """JPEG bytes of an (H, W, 3) uint8 RGB picture."""
    done, data = cv2.imencode(
        ".jpg",
        cv2.cvtColor(image, cv2.COLOR_RGB2BGR),
        [cv2.IMWRITE_JPEG_QUALITY, quality],
    )
    if not done:
        raise ValueError(f"picture of shape {image.shape} cannot be encoded as JPEG")
    return data.tobytes()


def write_png(path: str | os.PathLike, image: npt.NDArray) -> Path:
    """Write a picture as PNG in one step.

    Raises
    ------
    ValueError
        When the name has another ending: readers go by it.
    """
    if Path(path).suffix.lower() != ".png":
        raise ValueError(f"{path}: the picture is a PNG; give it a name in .png.")
    return write_bytes(path, encode_png(image))
