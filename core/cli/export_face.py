"""``python -m bsface export``: a finished face in other formats."""

from __future__ import annotations

from collections.abc import Sequence

from ..errors import ReconstructionError
from ..formats import (
    DISPLACEMENT_ENDINGS,
    HEAD_ENDINGS,
    MESH_ENDINGS,
    SOLID_ENDINGS,
    STAMPED_ENDINGS,
    TEXTURE_ENDINGS,
    ExportOptions,
    ending,
    export,
    load_face,
)
from ..report.outputs import check_outputs
from .arguments import Parser, check_held, check_named
from .terminal import say

# Options that keep their default where they are not given.
_VALUES = (
    "tolerance",
    "name",
    "texture",
    "normals",
    "displacement",
    "thickness",
    "author",
    "date",
)


def parser() -> Parser:
    """The command line."""
    p = Parser(
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
        metavar="MM",
        help="of triangles (.obj, .ply, .stl, .3mf), default "
        f"{ExportOptions.tolerance:g}",
    )
    p.add_argument(
        "--thickness",
        type=float,
        metavar="MM",
        help=f"of solids (.stl, .3mf), default {ExportOptions.thickness:g}",
    )
    p.add_argument("--texture", metavar="PICTURE", help="in .glb and .obj")
    p.add_argument(
        "--head", action="store_true", help="the whole head, in .glb and .obj"
    )
    p.add_argument("--normals", metavar="PICTURE", help="normal map in .glb and .obj")
    p.add_argument("--displacement", metavar="PICTURE", help="in .obj")
    p.add_argument("--author", help="in .step and .iges")
    p.add_argument("--date", help="in .step and .iges")
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
        names = ("face", "output", "texture", "normals", "displacement")
        check_named(args, *names)
        check_outputs(args.output, read=[args.face])
        if any(ending(name) == ".npz" for name in args.output):
            raise ValueError("The face is a .npz file already; copy it.")
        for option, given, endings in (
            ("--head", args.head or None, HEAD_ENDINGS),
            ("--texture", args.texture, TEXTURE_ENDINGS),
            ("--normals", args.normals, TEXTURE_ENDINGS),
            ("--displacement", args.displacement, DISPLACEMENT_ENDINGS),
            ("--tolerance", args.tolerance, MESH_ENDINGS),
            ("--thickness", args.thickness, SOLID_ENDINGS),
            ("--author", args.author, STAMPED_ENDINGS),
            ("--date", args.date, STAMPED_ENDINGS),
        ):
            if given is not None:
                check_held(option, endings, args.output)
        if args.head and args.whole and {*map(ending, args.output)} <= {*HEAD_ENDINGS}:
            raise ValueError("--whole is of no use with --head; leave one of them out.")
        values = {name: getattr(args, name) for name in _VALUES}
        options = ExportOptions(
            trimmed=not args.whole,
            head=args.head,
            **{name: value for name, value in values.items() if value is not None},
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
