"""``python -m bsface PHOTOS -o face.npz``: the job without Blender.

    python -m bsface PHOTOS -o OUT [--report PAGE.html] [--set NAME=VALUE ...]
    python -m bsface batch PEOPLE OUT [--workers 2] [--write FILE ...]
    python -m bsface export FACE.npz -o OUT [--tolerance MM]
    python -m bsface info FACE.npz [--json]

``OUT`` may be any format that a face can leave in (``.npz``, ``.step``, ``.igs``,
``.obj``, ``.ply``, ``.3dm``); give ``-o`` more than once for several.
Exit codes: 0 done, 1 the job failed, 2 the call is wrong, 130 interrupted.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from .cli import export_face, info
from .cli.arguments import check_outputs, parse_settings
from .cli.bar import Bar
from .cli.stopping import stoppable
from .errors import Cancelled, ReconstructionError, out_of_memory
from .formats import export
from .json_text import to_json
from .progress import Step
from .reconstruct import reconstruct
from .surface.template import load_template
from .threads import one_blas_thread, take_working_space

COMMANDS = """commands besides the reconstruction (`bsface COMMAND --help` tells more):
  batch    one face from each sub-folder of photos
  export   write a finished face in other formats
  info     say what a face file holds

A folder that has the name of a command is given as ./batch."""


def parser() -> argparse.ArgumentParser:
    """The command line of a reconstruction."""
    p = argparse.ArgumentParser(
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
    p.add_argument("--report", help="also write a page to look at (.html)")
    p.add_argument("--template", help="another template file (.npz)")
    p.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="a setting, such as method=paper or control_points=30,30",
    )
    p.add_argument("--ignore", action="append", default=[], metavar="PHOTO")
    p.add_argument("--json", action="store_true", help="print the result as JSON")
    p.add_argument("-q", "--quiet", action="store_true", help="no progress")
    return p


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    with stoppable():
        if words and words[0] in _COMMANDS:
            return _COMMANDS[words[0]](words[1:])
        return reconstruct_command(words)


def reconstruct_command(argv: Sequence[str]) -> int:
    """Photos in, files out; returns the exit code."""
    args = parser().parse_args(argv)
    bar = None if args.quiet else Bar()
    written: list[str] = []
    try:
        settings = parse_settings(args.set)
        template = load_template(args.template) if args.template else None
        check_outputs(args.output, args.report)
    except ValueError as error:
        sys.stderr.write(f"bsface: {error}\n")
        return 2
    try:
        take_working_space()
        # the same bytes on any number of cores
        with one_blas_thread():
            result = reconstruct(
                args.photos,
                settings,
                template=template,
                progress=bar,
                ignore=args.ignore,
            )
        for name in args.output:
            export(name, result)
            written.append(name)
        if args.report:
            from .report.report import write_report

            write_report(Path(args.report), result, progress=_telling(bar))
    except ReconstructionError as error:
        sys.stderr.write(f"\nbsface: {error}\n")
        return 1
    except (KeyboardInterrupt, Cancelled):
        done = f"; {', '.join(written)} written" if written else ", nothing written"
        sys.stderr.write(f"\nbsface: interrupted{done}\n")
        return 130
    except Exception as error:
        if not out_of_memory(error):
            raise
        sys.stderr.write(
            "\nbsface: There is not enough memory; use fewer photos or a smaller net "
            "(--set control_points=30,30).\n"
        )
        return 1
    finally:
        if bar is not None:
            bar.close()
    _tell(args, result)
    return 0


def _telling(bar: Bar | None) -> Callable[[float], None] | None:
    """Progress of the page on the terminal."""
    if bar is None:
        return None
    return lambda part: bar(Step("output", round(100 * part), 100, 1.0, "the page"))


def _tell(args: argparse.Namespace, result) -> None:
    """What came out, for a program or for people."""
    used = [r for r in result.reports if r.status == "used"]
    if args.json:
        summary = {
            "outputs": args.output,
            "used": len(used),
            "photos": len(result.reports),
            "seconds": dict(result.seconds),
            "warnings": list(result.warnings),
            "report": list(result.reports),
        }
        sys.stdout.write(to_json(summary, indent=1) + "\n")
    elif not args.quiet:
        for r in result.reports:
            if r.status != "used":
                sys.stderr.write(f"{r.name}: {r.reason}\n")
        for warning in result.warnings:
            sys.stderr.write(f"note: {warning}\n")
        sys.stderr.write(
            f"{len(used)} of {len(result.reports)} photos used; "
            f"{', '.join(args.output)} written\n"
        )


def _batch(argv: Sequence[str]) -> int:
    # imported here: it pulls in the texture and the report page
    from .cli.batch import main as run

    return run(argv)


_COMMANDS: dict[str, Callable[[Sequence[str]], int]] = {
    "batch": _batch,
    "export": export_face.main,
    "info": info.main,
}


if __name__ == "__main__":
    sys.exit(main())
