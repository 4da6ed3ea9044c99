#!/usr/bin/env python3
"""One command for each thing to do with a checkout; needs only Python, git, an index.

    python3 dev.py demo     examples/photos/ -> out/demo/ (face.blend, .npz, page)
    python3 dev.py test     ruff, pyright; all tests on the wheel, with the lowest and
                            the newest versions; the Blender tests in both lines
    python3 dev.py setup    make .venv and fetch the face models, nothing else
    python3 dev.py build    the extension's zips into dist/
    python3 dev.py bench    the scripts of benchmarks/
    python3 dev.py docs     the tables and pictures of docs/, and the reference

Everything is installed into .venv inside the checkout (and .venv-5.2 or .venv-4.5
for the other Blender line, .venv-lowest and .venv-newest for the wheel); the face
models go to the user's cache. A second run installs only the wheel again. Versions are
pinned in requirements/, apart from those of .venv-newest.

Standard library only. The file itself also starts on older Pythons, to say so.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import NamedTuple, TextIO

from tools.environments import (
    LINES,
    ROOT,
    WHEELS,
    Stop,
    build_wheel,
    call,
    dotted,
    environment,
    find_python,
    main_line,
    models,
    say,
    wheel_environment,
)

# What is installed beside the checkout: requirements/*.txt.
GROUPS = ("run", "test", "readers", "check")
IN_BLENDER = ("tests/blender", "tests/extension")
# A file that cannot be read does not keep the others from being tested.
PYTEST = ("-m", "pytest", "--continue-on-collection-errors", "--durations=10")
PHOTOS = ROOT / "examples" / "photos"
DEMO = ROOT / "out" / "demo"


# ---------------------------------------------------------------- verbs


def setup(options: argparse.Namespace) -> int:
    python = environment(options.blender or main_line(), *GROUPS)
    models(python)
    say(f"ready: {python}")
    return 0


def demo(options: argparse.Namespace) -> int:
    python = environment(options.blender or main_line(), "run")
    models(python)
    DEMO.mkdir(parents=True, exist_ok=True)
    say(f"reconstructing a face from the pictures of {PHOTOS.relative_to(ROOT)}")
    headless = str(ROOT / "bsface_addon" / "headless.py")
    command = [python, headless, "--", str(PHOTOS), str(DEMO / "face.blend")]
    command += ["--npz", str(DEMO / "face.npz")]
    command += ["--report", str(DEMO / "report.html")]
    code = call(command, limit=3600)
    if code == 0:
        say(f"in {DEMO.relative_to(ROOT)}:")
        for path in sorted(p for p in DEMO.iterdir() if p.is_file()):
            print(f"   {path.name:24s} {path.stat().st_size / 1024:8.0f} KB")
    return code


def test(options: argparse.Namespace) -> int:
    started = time.monotonic()
    python = environment(options.blender or main_line(), *GROUPS)
    if options.rest:
        return call([python, "-m", "pytest", *options.rest])
    models(python)
    results = [Result("install", 0, time.monotonic() - started)]
    with tempfile.TemporaryDirectory(prefix="bsface-") as name:
        wheel = Wheel(build_wheel(python, Path(name)), Path(name) / "reference.npy")
        script = str(ROOT / "tests" / "wheel.py")
        reference = ("reference for the wheel", [python, script, str(wheel.reference)])
        static = (
            ("ruff", [python, "-m", "ruff", "check", "."]),
            ("pyright", [python, "-m", "pyright", "--pythonpath", python]),
        )
        results += _two_at_a_time(
            lambda log: [_stage(title, words, log) for title, words in static],
            lambda log: [_stage(*reference, log)],
        )
        # One Python in each: its Blender line, and its versions of the packages.
        results += _two_at_a_time(
            *(partial(_python_stages, each, wheel) for each in LINES)
        )
    print(f"\n== summary ({time.monotonic() - started:.0f} s)")
    for title, code, seconds in results:
        verdict = code if isinstance(code, str) else "FAILED" if code else "passed"
        print(f"   {title:28s} {seconds:6.1f} s  {verdict}")
    return 1 if any(code for _, code, _ in results if isinstance(code, int)) else 0


class Result(NamedTuple):
    """How a stage of the tests ended: its exit code, or a remark."""

    title: str
    code: int | str
    seconds: float


class Wheel(NamedTuple):
    """The wheel under test, and the control points that it has to reproduce."""

    path: Path
    reference: Path


def _two_at_a_time(
    first: Callable[[TextIO | None], list[Result]],
    second: Callable[[TextIO | None], list[Result]],
) -> list[Result]:
    """Run two lists of stages; the second one's output is shown when it is done."""
    with tempfile.TemporaryFile("w+", encoding="utf-8") as log:
        with ThreadPoolExecutor(1) as beside:
            others = beside.submit(second, log)
            results = first(None) + others.result()
        log.seek(0)
        sys.stdout.write(log.read())
    return results


def _stage(title: str, command: list[str], log: TextIO | None) -> Result:
    print(f"\n== {title}", flush=True, file=log)
    before = time.monotonic()
    # Two stages run at a time on machines that may have two cores: more threads of
    # OpenBLAS would wait for each other and make the tests four times as long.
    code = call(command, 1500, log, OPENBLAS_NUM_THREADS="1")
    return Result(title, code, time.monotonic() - before)


def _python_stages(line: str, wheel: Wheel, log: TextIO | None) -> list[Result]:
    """The tests with one Python: its wheel outside the checkout, and its Blender."""
    version = LINES[line]
    name = WHEELS[version]
    if find_python(version) is None:
        remark = f"skipped: no Python {dotted(version)} here"
        return [Result(f"{name} versions, Blender {line}", remark, 0.0)]
    before = time.monotonic()
    python = wheel_environment(version, wheel.path)
    results = [Result(f"install {name}", 0, time.monotonic() - before)]
    # isolated: neither the checkout nor the user's packages are on its path
    script = [python, "-I", str(ROOT / "tests" / "wheel.py"), str(wheel.reference)]
    results.append(_stage(f"wheel, {name} versions", script, log))
    tests = [python, *PYTEST, "tests"]
    results.append(_stage(f"tests, {name} versions", tests, log))
    before = time.monotonic()
    python = environment(line, "run", "test")
    results.append(Result(f"install {line}", 0, time.monotonic() - before))
    # The Blender tests run on the zip as it is installed.
    tests = [python, *PYTEST, "--from-zip", *IN_BLENDER]
    results.append(_stage(f"tests, Blender {line}", tests, log))
    return results


def build(options: argparse.Namespace) -> int:
    python = environment(options.blender or main_line(), "run")
    script = str(ROOT / "tools" / "build_extension.py")
    return call([python, script, *options.rest])


def bench(options: argparse.Namespace) -> int:
    return _scripts(ROOT / "benchmarks", options)


def docs(options: argparse.Namespace) -> int:
    return _scripts(ROOT / "docs", options, "docs")


def _scripts(folder: Path, options: argparse.Namespace, *groups: str) -> int:
    """Run the scripts of a folder: all of them, or `NAME [arguments]`."""
    scripts = {p.stem: p for p in sorted(folder.glob("*.py")) if p.stem[0] != "_"}
    if not scripts:
        raise Stop(f"there is no script in {folder.name}/.")
    if options.rest and options.rest[0] not in scripts:
        raise Stop(f"{folder.name}/ has no {options.rest[0]}: {', '.join(scripts)}.")
    line = options.blender or main_line()
    python = environment(line, *GROUPS, *groups)
    models(python)
    if options.rest:
        return call([python, str(scripts[options.rest[0]]), *options.rest[1:]])
    failed = 0
    for name, path in scripts.items():
        say(f"{folder.name}/{name}.py")
        failed += call([python, str(path)]) != 0
    return min(failed, 1)


VERBS = {f.__name__: f for f in (setup, demo, test, build, bench, docs)}


def main() -> int:
    """Run the command line; returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("verb", choices=VERBS)
    parser.add_argument(
        "--blender", choices=LINES, help="Blender line (default: what fits the Python)"
    )
    parser.epilog = (
        "Whatever else stands in the line goes on: with test to pytest (which alone is "
        "run then), with build to tools/build_extension.py; with bench and docs it is "
        "the name of one script and its arguments."
    )
    options, options.rest = parser.parse_known_args()
    if options.rest and options.verb in ("setup", "demo"):
        parser.error(f"{options.verb} takes no {' '.join(options.rest)}")
    try:
        return VERBS[options.verb](options)
    except Stop as stop:
        print(f"dev.py: {stop}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("dev.py: interrupted", file=sys.stderr)
        return 130


if __name__ == "__main__":
    raise SystemExit(main())
