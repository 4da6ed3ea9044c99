"""What the photos cannot tell: missing views and missing light, in sentences."""

from __future__ import annotations

import numpy as np

from .._types import Array

SIDE = 15.0  # degrees of yaw from which a photo shows a side of the face
FRONT = 45.0  # beyond this one eye and half of the mouth are hidden
FEW = 5
# Second singular value of the intensities, relative to the first, below which light
# hardly differs. Photos under different lights have 0.2 to 0.3, those whose main lights
# lie within 20 degrees 0.15 (`benchmarks/one_light.py`).
FLAT_LIGHT = 0.06


def shortcomings(
    poses: Array, singular_values: Array | None = None, *, copies: int = 0
) -> tuple[str, ...]:
    """Sentences on what is missing, empty if nothing is.

    Parameters
    ----------
    poses : (n, 3) array
        Yaw, pitch, roll of the used photos in degrees, yaw > 0 = head turned to the
        right of the picture.
    singular_values : (k,) array, optional
        Of the intensities, relative to the first.
    copies : int
        How many of the photos are copies of others.
    """
    out = []
    n = len(poses)
    if n - copies == 1:
        out.append(
            "With one photo depth and hidden parts come from the average face; add "
            "photos from other sides and under other light."
        )
    elif n - copies < FEW:
        photos = f"{n - copies} different photos" if copies else f"{n} photos"
        out.append(
            f"Only {photos} are used, so much of the shape comes from the average "
            "face; ten or more give a likeness."
        )
    yaw = poses[:, 0] if n else np.zeros(0)
    for side, seen, way in (
        ("left", (yaw < -SIDE).any(), "right"),
        ("right", (yaw > SIDE).any(), "left"),
    ):
        if n > 1 and not seen:
            out.append(
                f"No photo shows the head turned to the {side} of the picture; add one "
                f"turned by 20 to 40 degrees, or the cheek on the {way} of the picture "
                "stays a guess."
            )
    if n and (np.abs(yaw) > FRONT).all():
        out.append(
            "No photo shows the face from the front; add one turned by less than 30 "
            "degrees, or its width stays a guess."
        )
    spread = 1.0 if singular_values is None else float(singular_values[1:2].sum())
    if n > 2 and spread < FLAT_LIGHT:
        out.append(
            "The light hardly differs between the photos: the shape comes out all the "
            "same, only its fine relief is less sure; a few photos with light from "
            "another side make it surer."
        )
    return tuple(out)
