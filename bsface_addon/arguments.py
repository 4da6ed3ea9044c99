"""The arguments of the command line.

No option begins with ``--c``: Blender's Cycles add-on reads the same arguments and
stops at those.
"""

from __future__ import annotations

import argparse


def parser():
    """The parser of all verbs."""
    top = argparse.ArgumentParser(
        prog="bsface",
        description="Photos of one person in, an editable NURBS face out.",
    )
    add = top.add_subparsers(metavar="VERB", required=True)
    for name, parent in verbs().items():
        add.add_parser(name, parents=[parent], add_help=False, help=parent.description)
    return top


def verbs():
    """Name -> parser of its arguments."""
    add = argparse.ArgumentParser(description="photos -> .blend; the usual verb")
    add.add_argument("photos", metavar="PHOTOS", help="folder with the photos")
    add.add_argument("out", metavar="OUT.blend", nargs="?", help="file to write")
    add.add_argument("-o", "--output", metavar="OUT.blend", help="the same")
    add.add_argument("--npz", metavar="FILE", help="write the face file too")
    add.add_argument("--report", metavar="FILE", help="write the report page too")
    add.add_argument("--name", default="", help="name of the face object")
    add.add_argument("--method", help="joint, imls, paper or motion")
    add.add_argument("--points", metavar="MxN", help="control points, such as 40x40")
    add.add_argument(
        "--settings", metavar="JSON", default="", help="further settings as JSON object"
    )
    add.add_argument(
        "--texture",
        default="AUTO",
        choices=("AUTO", "512", "1024", "2048", "4096"),
        help="pixels along a side of the skin texture",
    )
    add.add_argument(
        "--ignore", metavar="PHOTO", action="append", default=[], help="leave one out"
    )
    add.add_argument(
        "--size", type=_scale, default=1.0, help="1 is life size in metres (default)"
    )
    add.add_argument("--quiet", action="store_true", help="no progress")
    add.set_defaults(verb="reconstruct")
    send = argparse.ArgumentParser(description="a face as STEP, IGES, OBJ, 3dm...")
    send.add_argument("file", metavar="FILE", help=".blend or .npz")
    send.add_argument("out", metavar="OUT", help="file to write; its ending decides")
    send.add_argument("--name", default="", help="which face of the .blend")
    send.add_argument(
        "--untrimmed", action="store_true", help="the whole patch, not only the face"
    )
    send.add_argument(
        "--tolerance", type=float, default=0.25, help="of meshes, in mm (0.25)"
    )
    send.set_defaults(verb="export")
    show = argparse.ArgumentParser(description="what a .blend or .npz file holds")
    show.add_argument("file", metavar="FILE")
    show.set_defaults(verb="info")
    found = {"reconstruct": add, "export": send, "info": show}
    for verb in found.values():
        verb.add_argument(
            "--json", action="store_true", help="the result as one line of JSON"
        )
    return found


def _scale(text):
    """A factor that Blender can show."""
    value = float(text)
    if not 1e-3 <= value <= 1e3:
        raise argparse.ArgumentTypeError(f"give 0.001 to 1000, not {text}")
    return value


def points(text):
    """Two numbers written as 40x44; one number counts for both."""
    from ..core.errors import ReconstructionError

    across, _, down = text.lower().partition("x")
    try:
        return int(across), int(down or across)
    except ValueError:
        raise ReconstructionError(
            f"--points wants two numbers such as 40x40, not {text!r}."
        ) from None
