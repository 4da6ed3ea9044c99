"""``python -m bsface PHOTOS -o face.npz``: the job without Blender.

    python -m bsface PHOTOS -o OUT [--report PAGE.html] [--set NAME=VALUE ...]

``OUT`` may be any format that a face can leave in (``.npz``, ``.step``, ``.igs``,
``.obj``, ``.ply``, ``.3dm``); give ``-o`` more than once for several.
Exit codes: 0 done, 1 the job failed, 2 the call is wrong, 130 interrupted.
"""

from __future__ import annotations

import argparse
import json
import logging
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from .errors import Cancelled, ReconstructionError
from .progress import Step
from .reconstruct import reconstruct
from .settings import Settings
from .surface.template import load_template
from .threads import one_blas_thread


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = argparse.ArgumentParser(
        prog="bsface", description="Photos of one person in, a B-spline face out."
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


def parse_settings(pairs: Sequence[str]) -> Settings:
    """Settings from ``NAME=VALUE`` words.

    Raises
    ------
    ValueError
        With a sentence that names the word.
    """
    values = {}
    for pair in pairs:
        name, sign, text = pair.partition("=")
        if not sign:
            raise ValueError(f"--set takes NAME=VALUE, got {pair!r}.")
        try:
            values[name] = json.loads(text)
        except ValueError:
            numbers = text.split(",")
            if len(numbers) == 2 and all(x.strip().isdigit() for x in numbers):
                values[name] = [int(x) for x in numbers]
            else:
                values[name] = text
    return Settings.from_dict(values)


def check_outputs(outputs: Sequence[str], report: str | None) -> None:
    """Refuse what cannot be written before the work is done, not after it.

    Raises
    ------
    ValueError
        With a sentence that names the file.
    """
    from .output.formats import WRITERS, ending

    for name in outputs:
        if not ending(name):
            raise ValueError(
                f"{name}: unknown ending; choose one of "
                f"{', '.join(['.npz', *WRITERS])}."
            )
    if report is not None and Path(report).suffix.lower() not in (".html", ".htm"):
        raise ValueError(f"{report}: the page must end in .html.")
    for name in (*outputs, *([report] if report else [])):
        try:
            why = _why_not_writable(Path(name))
        except OSError as error:
            why = f"cannot be written ({error.strerror}); choose another name"
        if why:
            raise ValueError(f"{name}: {why}.")


def _why_not_writable(path: Path) -> str:
    if path.is_dir():
        return "is a folder; give the name of a file in it"
    folder = path.absolute().parent
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    if not folder.is_dir():
        return f"cannot be written ({folder} is a file); choose another folder"
    if not os.access(folder, os.W_OK):
        return f"cannot be written (no permission in {folder}); choose another folder"
    return ""


class _Bar:
    """One line a stage on the terminal, rewritten as it fills."""

    def __init__(self) -> None:
        self.stage = ""
        self.live = sys.stderr.isatty()

    def __call__(self, step: Step) -> None:
        new = step.stage != self.stage
        last = step.done >= step.total
        if not (self.live or last):
            return
        if new and self.stage and self.live:
            sys.stderr.write("\n")
        self.stage = step.stage
        full = round(24 * step.done / max(step.total, 1))
        bar = "#" * full + "." * (24 - full)
        line = f"{step.stage:<10} [{bar}] {step.done}/{step.total}  {step.message}"
        end = "" if self.live else "\n"
        sys.stderr.write(("\r\x1b[2K" if self.live else "") + line[:110] + end)
        sys.stderr.flush()

    def close(self) -> None:
        if self.live and self.stage:
            sys.stderr.write("\n")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    args = parser().parse_args(argv)
    logging.basicConfig(level=logging.WARNING, format="%(message)s")
    bar = None if args.quiet else _Bar()
    try:
        settings = parse_settings(args.set)
        template = load_template(args.template) if args.template else None
        check_outputs(args.output, args.report)
    except ValueError as error:
        sys.stderr.write(f"bsface: {error}\n")
        return 2
    try:
        # the same bytes on any number of cores
        with one_blas_thread():
            result = reconstruct(
                args.photos,
                settings,
                template=template,
                progress=bar,
                ignore=args.ignore,
            )
        from .output.formats import export

        for name in args.output:
            export(name, result)
        if args.report:
            from .output.report import write_report

            write_report(Path(args.report), result)
    except ReconstructionError as error:
        sys.stderr.write(f"\nbsface: {error}\n")
        return 1
    except MemoryError:
        sys.stderr.write(
            "\nbsface: not enough memory; use fewer photos or a smaller net "
            "(--set control_points=30,30)\n"
        )
        return 1
    except (KeyboardInterrupt, Cancelled):
        sys.stderr.write("\nbsface: interrupted, nothing written\n")
        return 130
    finally:
        if bar is not None:
            bar.close()
    used = [r for r in result.reports if r.status == "used"]
    if args.json:
        from .output.formats.npz import to_json

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
        sys.stderr.write(
            f"{len(used)} of {len(result.reports)} photos used; "
            f"{', '.join(args.output)} written\n"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
