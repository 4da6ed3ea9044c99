"""What a user may choose when a face is written, for all formats together."""

from __future__ import annotations

import os
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from ..errors import ReconstructionError
from ..kinds import SWITCH, expect, expect_number
from ..rig.mesh import DENSITIES
from .exchange import ExchangeCurve, NamedCurves
from .mtl import Source, lost_picture

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
    texture : path or bytes, optional
        A PNG or JPEG picture over (u, v), row 0 at v = 0: ``.obj``, ``.glb``.
    head : bool
        The whole head instead of the face: ``.glb``, and ``.obj`` as quads.
    normals : path or bytes, optional
        A tangent-space normal map over (u, v), green up: ``.obj``, ``.glb``.
    displacement : path or bytes, optional
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
    texture: Source | None = None
    head: bool = False
    normals: Source | None = None
    displacement: Source | None = None
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
        self._check_kinds()
        if self.density not in DENSITIES:
            raise ReconstructionError(
                f"{path}: density must be one of {', '.join(DENSITIES)}, not "
                f"{self.density!r}."
            )
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

    def _check_kinds(self) -> None:
        expect(str | None, "a text", name=self.name)
        expect(str, "a text", author=self.author, date=self.date, density=self.density)
        expect(
            SWITCH,
            "true or false",
            trimmed=self.trimmed,
            head=self.head,
            keys=self.keys,
            openings=self.openings,
        )
        expect_number(tolerance=self.tolerance, thickness=self.thickness)
        # A whole number would be taken for an open file of the process.
        expect(
            (str, os.PathLike, bytes, type(None)),
            "a path or the content of a picture",
            texture=self.texture,
            normals=self.normals,
            displacement=self.displacement,
        )
        expect(tuple | list, "pairs of a name and a curve", curves=self.curves)
        for pair in self.curves:
            whole = isinstance(pair, tuple | list) and len(pair) == 2
            if not (
                whole
                and isinstance(pair[0], str)
                and isinstance(pair[1], ExchangeCurve)
            ):
                raise TypeError(
                    "curves must be pairs of a name and an ExchangeCurve, such as "
                    '(("seal", curve),).'
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
