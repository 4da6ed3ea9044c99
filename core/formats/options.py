"""What a user may choose when a face is written, for all formats together."""

from __future__ import annotations

import os
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from ..errors import ReconstructionError
from ..kinds import SWITCH, expect
from ..settings import NUMBER
from .exchange import NamedCurves
from .mtl import lost_picture

#: The date of files that name none, so that equal faces give equal bytes.
FIXED_DATE = "1970-01-01T00:00:00"
#: Largest tolerance and thickness: beyond any head.
MAX_MM = 1000.0
#: Smallest thickness: files of single precision hold a head to 0.00001 mm.
MIN_THICKNESS = 0.01


@dataclass(frozen=True)
class ExportOptions:
    """Options of `export`; every format takes those that it knows.

    Parameters
    ----------
    trimmed : bool
        Trim to the face's outline where the format can.
    tolerance : float
        Largest distance between surface and triangles, mm: ``.obj``, ``.ply``,
        ``.stl``, ``.3mf``.
    name : str, optional
        Name of the object in the file; by default the file's own.
    texture : path, optional
        A PNG or JPEG picture over (u, v), row 0 at v = 0: ``.obj``, ``.glb``.
    head : bool
        The whole head instead of the face: ``.glb``, and ``.obj`` as quads.
    normals : path, optional
        A tangent-space normal map over (u, v), green up: ``.obj``, ``.glb``.
    displacement : path, optional
        A 16-bit displacement over (u, v), see `write_displacement`: ``.obj``.
    density : str
        "low", "medium" or "high", of the quads in ``.glb`` and of the head.
    keys : bool
        The ARKit keys in ``.glb``.
    openings : bool
        Eyes and an open line between the lips in ``.glb``.
    thickness : float
        Of the closed solids ``.stl`` and ``.3mf``, inwards, mm.
    author : str
        In ``.step`` and ``.iges``.
    date : str
        ISO 8601, in ``.step`` and ``.iges``; fixed by default.
    curves : tuple of (name, ExchangeCurve)
        More curves in space, such as a seal: ``.step``, ``.iges``, ``.3dm``.
    """

    trimmed: bool = True
    tolerance: float = 0.25
    name: str | None = None
    texture: str | os.PathLike | None = None
    head: bool = False
    normals: str | os.PathLike | None = None
    displacement: str | os.PathLike | None = None
    density: str = "medium"
    keys: bool = True
    openings: bool = True
    thickness: float = 2.0
    author: str = ""
    date: str = FIXED_DATE
    curves: NamedCurves = ()

    def check(self, path: str | os.PathLike) -> None:
        """Refuse values that no format can use.

        Raises
        ------
        ReconstructionError
            One sentence with the file, the value and the remedy.
        TypeError
            A value is of another kind.
        """
        expect(str | None, "a text", name=self.name)
        expect(SWITCH, "true or false", trimmed=self.trimmed)
        expect(NUMBER, "a number", tolerance=self.tolerance, thickness=self.thickness)
        for what, value in (
            ("tolerance", self.tolerance),
            ("thickness", self.thickness),
        ):
            if not 0 < value <= MAX_MM:
                raise ReconstructionError(
                    f"{path}: the {what} must be a positive length in millimetres, at "
                    f"most {MAX_MM:g}, not {value:g}."
                )
        if self.thickness < MIN_THICKNESS:
            raise ReconstructionError(
                f"{path}: a thickness of {self.thickness:g} mm is less than the file "
                f"can hold; give at least {MIN_THICKNESS:g} mm."
            )
        check_date(path, self.date)
        if Path(path).suffix.lower() == ".obj":
            pictures = (self.texture, self.normals, self.displacement)
            lost = lost_picture(Path(path), pictures, remade=self.head)
            if lost is not None:
                raise ReconstructionError(
                    f"{path}: {lost} is read and would be written over with another "
                    "picture; choose another name."
                )


def check_date(path: str | os.PathLike, date: str) -> None:
    """Refuse what is no date in ISO 8601.

    Raises
    ------
    ReconstructionError
        One sentence with the file, the date and the remedy.
    """
    try:
        datetime.fromisoformat(date)
    except ValueError:
        raise ReconstructionError(
            f"{path}: {date!r} is not a date; write it as "
            "2026-11-22 or 2026-11-22T10:30:00."
        ) from None


@dataclass(frozen=True)
class Stamp:
    """Who made a CAD file and when.

    Attributes
    ----------
    author : str
    date : str
        ISO 8601.
    """

    author: str = ""
    date: str = FIXED_DATE


#: Equal faces give equal bytes.
ANONYMOUS = Stamp()
