"""``python -m bsface PHOTOS -o face.npz``: photos in, files out."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from ..errors import Cancelled, PhotoFailure, ReconstructionError, out_of_memory
from ..formats import HEAD_ENDINGS, ending, export, load_face
from ..formats.textured import exported_files, textured
from ..progress import Step
from ..report.facts import failure_facts, result_facts, versions
from ..report.log_file import log_file, logged
from ..report.outputs import check_outputs
from ..report.report import report_files, write_report
from ..result import PhotoReport, Reconstruction
from ..settings import Settings
from ..surface.template import load_template
from ..threads import one_blas_thread, take_working_space
from .arguments import Parser, check_held, check_named, parse_settings
from .bar import Bar
from .terminal import say, tell, write_json, write_out

COMMANDS = """commands besides the reconstruction (`bsface COMMAND --help` tells more):
  batch    one face from each sub-folder of photos
  export   write a finished face in other formats
  info     say what a face file holds
  models   say where the face models are, or fetch them

A folder that has the name of a command is given as ./batch."""


class _Version(argparse.Action):
    """``--version``: of bsface and of what it runs on."""

    def __init__(self, option_strings: Sequence[str], dest: str) -> None:
        super().__init__(option_strings, dest, nargs=0, help="versions, and end")

    def __call__(self, parser, namespace, values, option_string=None) -> None:
        own, *others = versions().items()
        words = ", ".join(f"{name} {version}" for name, version in others)
        parser.exit(write_out(f"bsface {own[1]} ({words})\n"))


def parser() -> Parser:
    """The command line of a reconstruction."""
    p = Parser(
        prog="bsface",
        description="Photos of one person in, a B-spline face out.",
        epilog=COMMANDS,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument("photos", help="folder with photos of one person")
    p.add_argument(
        "-o",
        "--output",
        action="append",
        required=True,
        help="file to write; its ending is the format; may be given again",
    )
    p.add_argument(
        "--recursive", action="store_true", help="also the photos of the sub-folders"
    )
    p.add_argument(
        "--head", action="store_true", help="the whole head, in .glb and .obj"
    )
    p.add_argument("--report", help="also write a page to look at (.html)")
    p.add_argument("--template", help="another template file (.npz)")
    p.add_argument(
        "--start",
        metavar="FACE",
        help="go on from this face (.npz); control points that it holds stay",
    )
    p.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="a setting, such as method=paper or control_points=30,30",
    )
    p.add_argument("--ignore", action="append", default=[], metavar="PHOTO")
    p.add_argument("--json", action="store_true", help="print the result as JSON")
    p.add_argument("--log", metavar="FILE", help="write a log of the run")
    p.add_argument("-q", "--quiet", action="store_true", help="no progress")
    p.add_argument("--version", action=_Version)
    return p


def main(argv: Sequence[str], run: Callable[..., Reconstruction]) -> int:
    """Photos in, files out.

    Parameters
    ----------
    argv : sequence of str
    run : callable
        What makes the face, with the arguments of `reconstruct`.

    Returns
    -------
    int
        0 done, 1 the job failed, 2 the call is wrong, 130 interrupted.
    """
    args = parser().parse_args(argv)
    try:
        settings = parse_settings(args.set)
        check_named(args, "output", "report", "template", "start")
        if args.start and args.template:
            raise ValueError("--start and --template cannot be given together.")
        template, constraint = None, None
        if args.template:
            template = load_template(args.template)
        if args.start:
            before = load_face(args.start)
            template, constraint = before.surface, before.constraint
            settings = _going_on(settings, args.set, args.start, before)
        check_outputs(
            args.output,
            report=args.report,
            log=args.log,
            photos=args.photos,
            read=[name for name in (args.template, args.start) if name is not None],
            recursive=args.recursive,
        )
        if args.head:
            check_held("--head", HEAD_ENDINGS, args.output)
    except (ReconstructionError, ValueError) as error:
        say(str(error))
        return 2
    bar = None if args.quiet else Bar()
    written: list[Path] = []
    log = Path(args.log) if args.log else None
    try:
        with log_file(log, shlex.join(["bsface", *argv])) as logger:
            take_working_space()
            # the same bytes on any number of cores
            with one_blas_thread():
                face = run(
                    args.photos,
                    settings,
                    template=template,
                    constraint=constraint,
                    recursive=args.recursive,
                    progress=logged(bar),
                    ignore=args.ignore,
                )
            for line in _remarks(face.reports):
                logger.info("%s", line)
            with textured(face, args.output) as plain:
                options = replace(plain, head=args.head)
                # The face file first: what fails after it can be exported again.
                for name in sorted(args.output, key=lambda n: ending(n) != ".npz"):
                    written += exported_files(export(name, face, options=options))
                    logger.info("%s written", name)
            if args.report:
                page = Path(args.report)
                write_report(page, face, progress=_page_progress(bar))
                written += report_files(page)
                logger.info("%s written", args.report)
    except ReconstructionError as error:
        return _failed(args, bar, str(error), written, error.photos)
    except (KeyboardInterrupt, Cancelled):
        done = f"{_names(written)} written" if written else "nothing written"
        _close(bar)
        say(f"interrupted, {done}")
        return 130
    except Exception as error:
        if not out_of_memory(error):
            raise
        return _failed(
            args,
            bar,
            "There is not enough memory; use fewer photos or a smaller net "
            "(--set control_points=30,30).",
            written,
        )
    _close(bar)
    if args.json:
        files = [*written, *([log] if log else [])]
        return write_json(result_facts(face, files=files))
    if not args.quiet:
        _tell(face, written)
    return 0


def _going_on(
    settings: Settings, asked: Sequence[str], name: str, face: Reconstruction
) -> Settings:
    """The settings with what ``--start`` keeps of a face: its net and its size.

    Raises
    ------
    ValueError
        When ``--set`` asks for another net, or for another size than that of control
        points that stay.
    """
    named = {word.partition("=")[0] for word in asked}
    m, n = face.surface.shape
    if "control_points" in named and settings.control_points != (m, n):
        raise ValueError(
            f"{name} has {m} x {n} control points, which --start keeps; leave "
            "control_points out."
        )
    size = face.settings.eye_distance_mm
    if "eye_distance_mm" not in named:
        return replace(settings, eye_distance_mm=size)
    if face.constraint is not None and settings.eye_distance_mm != size:
        raise ValueError(
            f"{name} holds control points of a face with {size:g} mm between the eyes; "
            "leave eye_distance_mm out."
        )
    return settings


def _failed(
    args: argparse.Namespace,
    bar: Bar | None,
    sentence: str,
    written: Sequence[Path],
    photos: Sequence[PhotoFailure] = (),
) -> int:
    """Say why the job failed, for a program too if it asked for JSON."""
    _close(bar)
    if written:
        tell(f"{_names(written)} written\n")
    if not args.json:
        for failure in photos:
            tell(f"{failure.name}: {failure.reason}\n")
    say(sentence)
    if args.json:
        write_json(failure_facts(sentence, photos))
    return 1


def _close(bar: Bar | None) -> None:
    if bar is not None:
        bar.close()


def _page_progress(bar: Bar | None) -> Callable[[float], None] | None:
    """Progress of the page on the terminal."""
    if bar is None:
        return None
    return lambda part: bar(Step("output", round(100 * part), 100, 1.0, "the page"))


def _tell(face: Reconstruction, written: Sequence[Path]) -> None:
    """What came out, for people."""
    used = [row for row in face.reports if row.status == "used"]
    for line in _remarks(face.reports):
        tell(f"{line}\n")
    for warning in face.warnings:
        tell(f"note: {warning}\n")
    tell(f"{len(used)} of {len(face.reports)} photos used; {_names(written)} written\n")


def _remarks(reports: Sequence[PhotoReport]) -> list[str]:
    """What there is to say of single photos: why they are left out, and notes."""
    return [f"{row.name}: {row.reason}" for row in reports if row.reason]


def _names(files: Sequence[Path]) -> str:
    return ", ".join(map(str, files))
