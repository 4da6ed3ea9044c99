"""``python -m bsface info``: what a face file holds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..errors import ReconstructionError
from ..formats import load_face
from ..json_text import plain
from ..report.facts import failure_facts
from ..result import Reconstruction
from .arguments import Parser, check_named
from .terminal import say, write_json, write_out


def parser() -> Parser:
    """The command line."""
    p = Parser(prog="bsface info", description="Say what a face file holds.")
    p.add_argument("face", help="face file (.npz)")
    p.add_argument("--json", action="store_true", help="print it as JSON")
    return p


def main(argv: Sequence[str]) -> int:
    """Run the command.

    Returns
    -------
    int
        0 done, 1 the file is no face, 2 wrong call.
    """
    args = parser().parse_args(argv)
    try:
        check_named(args, "face")
    except ValueError as error:
        say(str(error))
        return 2
    try:
        face = load_face(args.face)
    except ReconstructionError as error:
        say(str(error))
        if args.json:
            write_json(failure_facts(str(error)))
        return 1
    facts = summary(face)
    if args.json:
        return write_json(facts)
    return write_out("\n".join(_lines(facts)) + "\n")


def summary(face: Reconstruction) -> dict[str, Any]:
    """The facts about a face file: size, run, photos.

    Parameters
    ----------
    face : Reconstruction

    Returns
    -------
    dict
        Plain values: ``control_points`` (M, N), ``size_mm`` (width, height, depth of
        the surface), ``method``, ``eye_distance_mm``, ``used``, ``photos``,
        ``confidence_mm`` (median standard deviation, or None), ``lit`` (whether lights
        and albedo are stored), ``warnings``, ``settings``, ``program`` (its version),
        ``date`` (when the file was written) and ``report``.
    """
    points = face.surface.grid(60, 60).reshape(-1, 3)
    spread = None if face.deviation is None else float(np.median(face.deviation))
    rows = plain(face.reports)
    settings = face.settings.to_dict()
    return {
        "control_points": list(face.surface.shape),
        "size_mm": [round(float(x), 2) for x in np.ptp(points, axis=0)],
        "method": face.settings.method,
        "eye_distance_mm": face.settings.eye_distance_mm,
        "used": face.used,
        "photos": len(rows),
        "confidence_mm": spread,
        "lit": face.photometric is not None,
        "warnings": list(face.warnings),
        "settings": settings,
        "program": face.provenance.program,
        "date": face.provenance.date,
        "report": rows,
    }


def _lines(facts: dict[str, Any]) -> list[str]:
    m, n = facts["control_points"]
    width, height, depth = facts["size_mm"]
    lines = [
        f"surface   {m} x {n} control points, bicubic, uniform knots",
        f"size      {width:.1f} x {height:.1f} x {depth:.1f} mm",
        f"method    {facts['method']}",
        f"photos    {facts['used']} of {facts['photos']} used",
    ]
    if facts["eye_distance_mm"] is not None:
        lines.insert(2, f"eyes      {facts['eye_distance_mm']:g} mm apart")
    if facts["confidence_mm"] is not None:
        lines.append(f"deviation {facts['confidence_mm']:.2f} mm (median)")
    lines += [f"warning   {sentence}" for sentence in facts["warnings"]]
    names = [str(row.get("name", "")) for row in facts["report"]]
    width = max(map(len, names), default=0)
    for name, row in zip(names, facts["report"], strict=True):
        status = str(row.get("status", ""))
        if status == "used":
            angles = [row.get(k) for k in ("yaw", "pitch", "roll")]
            shown = " ".join("     " if a is None else f"{a:5.0f}" for a in angles)
            lines.append(f"  {name:<{width}}  used  yaw, pitch, roll {shown}")
        else:
            lines.append(f"  {name:<{width}}  {status}: {row.get('reason', '')}")
    return lines
