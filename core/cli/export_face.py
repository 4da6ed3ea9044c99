"""``python -m bsface export``: a finished face in other formats."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from ..errors import ReconstructionError
from ..formats import (
    DISPLACEMENT_ENDINGS,
    HEAD_ENDINGS,
    TEXTURE_ENDINGS,
    ExportOptions,
    ending,
    export,
    load_face,
)
from ..formats.options import FIXED_DATE
from ..report.outputs import check_outputs
from .arguments import check_held
from .terminal import say


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = argparse.ArgumentParser(
        prog="bsface export", description="Write a finished face in other formats."
    )
    p.add_argument("face", help="face file (.npz)")
    p.add_argument(
        "-o",
        "--output",
        action="append",
        required=True,
        help="file to write; its ending is the format; may be given again",
    )
    p.add_argument(
        "--tolerance",
        type=float,
        default=0.25,
        metavar="MM",
        help="of triangles (.obj, .ply, .stl, .3mf), default 0.25",
    )
    p.add_argument(
        "--thickness",
        type=float,
        default=2.0,
        metavar="MM",
        help="of solids (.stl, .3mf), default 2",
    )
    p.add_argument("--texture", metavar="PICTURE", help="in .glb and .obj")
    p.add_argument(
        "--head", action="store_true", help="the whole head, in .glb and .obj"
    )
    p.add_argument("--normals", metavar="PICTURE", help="normal map in .glb and .obj")
    p.add_argument("--displacement", metavar="PICTURE", help="in .obj")
    p.add_argument("--author", default="", help="in .step and .iges")
    p.add_argument("--date", default=FIXED_DATE, help="in .step and .iges")
    p.add_argument(
        "--whole", action="store_true", help="do not trim to the outline of the face"
    )
    p.add_argument("--name", help="name of the object, by default that of the file")
    p.add_argument("-q", "--quiet", action="store_true", help="say nothing")
    return p


def main(argv: Sequence[str]) -> int:
    """Run the command.

    Returns
    -------
    int
        0 done, 1 the face cannot be read or a file not be written, 2 wrong call.
    """
    args = parser().parse_args(argv)
    try:
        check_outputs(args.output)
        if any(ending(name) == ".npz" for name in args.output):
            raise ValueError("The face is a .npz file already; copy it.")
        for option, given, endings in (
            ("--head", args.head, HEAD_ENDINGS),
            ("--texture", args.texture, TEXTURE_ENDINGS),
            ("--normals", args.normals, TEXTURE_ENDINGS),
            ("--displacement", args.displacement, DISPLACEMENT_ENDINGS),
        ):
            if given:
                check_held(option, endings, args.output)
        options = ExportOptions(
            trimmed=not args.whole,
            tolerance=args.tolerance,
            name=args.name,
            texture=args.texture,
            head=args.head,
            normals=args.normals,
            displacement=args.displacement,
            thickness=args.thickness,
            author=args.author,
            date=args.date,
        )
        for name in args.output:
            options.check(name)
    except (ReconstructionError, ValueError) as error:
        say(str(error))
        return 2
    try:
        face = load_face(args.face)
        for name in args.output:
            export(name, face, options=options)
    except ReconstructionError as error:
        say(str(error))
        return 1
    if not args.quiet:
        say(f"{', '.join(args.output)} written")
    return 0
