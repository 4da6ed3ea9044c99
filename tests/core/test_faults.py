"""Interruptions, kills and cancels: old files or new ones, nothing between, no litter.

Signals at random moments of whole runs: ``python tools/faults.py``.
"""

import gc
import importlib.util
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from bsface import files
from bsface.batch.processes import hangup_held_back
from bsface.cli.stopping import stoppable
from bsface.errors import Cancelled, ReconstructionError, out_of_memory
from bsface.files import replacing, write_bytes
from bsface.report import report
from bsface.texture.bake import bake_texture
from fake_face import painted_reconstruction, person_folder
from needs import needs_signals

ROOT = Path(__file__).resolve().parents[2]


def tool():
    path = ROOT / "tools" / "faults.py"
    spec = importlib.util.spec_from_file_location("faults", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules["faults"] = module
    spec.loader.exec_module(module)
    return module


# --- files ---------------------------------------------------------------------------


def interrupted_at(line: int, action) -> bool:
    """Run the action, KeyboardInterrupt at the line-th line of files.py it comes to."""
    count = 0

    def trace(frame, event, argument):
        nonlocal count
        if frame.f_code.co_filename != files.__file__:
            return None
        # Tidying up is not interrupted: one signal, one interruption.
        if event == "line" and count >= 0:
            count += 1
            if count == line:
                count = -1
                raise KeyboardInterrupt
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        action()
    except KeyboardInterrupt:
        return True
    finally:
        sys.settrace(before)
    return False


def test_interrupted_at_every_line_of_writing(tmp_path):
    """Before the move the old file, after it the new one, never anything else."""
    path = tmp_path / "face.npz"
    found = []
    for line in range(1, 200):
        path.write_bytes(b"old")
        stopped = interrupted_at(line, lambda: write_bytes(path, b"the new one"))
        assert os.listdir(tmp_path) == ["face.npz"], line
        found.append(path.read_bytes())
        if not stopped:
            break
    assert not stopped and len(found) > 15
    change = found.index(b"the new one")
    assert found[:change] == [b"old"] * change
    assert set(found[change:]) == {b"the new one"}


def test_failure_inside_the_block_keeps_the_old_file(tmp_path):
    path = tmp_path / "face.npz"
    path.write_bytes(b"old")
    with pytest.raises(ZeroDivisionError), replacing(path) as temporary:
        temporary.write_bytes(b"half")
        raise ZeroDivisionError
    assert os.listdir(tmp_path) == ["face.npz"] and path.read_bytes() == b"old"


# --- signals -------------------------------------------------------------------------


@needs_signals
@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP", "SIGINT"])
def test_signals_interrupt_and_come_back(name):
    number = getattr(signal, name)
    usual = signal.default_int_handler if name == "SIGINT" else signal.SIG_DFL
    # the tests themselves may run under `nohup` or in the background
    found = signal.signal(number, usual)
    try:
        with pytest.raises(KeyboardInterrupt), stoppable():
            os.kill(os.getpid(), number)
        assert signal.getsignal(number) is usual
    finally:
        signal.signal(number, found)


class HalfMade:
    """As `zipfile.ZipFile` is when it is interrupted while it reads the directory."""

    def __init__(self):
        os.kill(os.getpid(), signal.SIGINT)
        self.whole = True

    def __del__(self):
        assert self.whole


class StoppedInDel:
    """The signal comes while Python throws something away."""

    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0)


@needs_signals
@pytest.mark.parametrize("kind", [HalfMade, StoppedInDel])
def test_nothing_is_printed_about_what_an_interrupt_left(kind, capfd):
    found = signal.signal(signal.SIGINT, signal.default_int_handler)
    hook, sys.unraisablehook = sys.unraisablehook, sys.__unraisablehook__
    try:
        with stoppable():
            try:
                kind()
                for _ in range(1000):
                    time.sleep(0.01)
                pytest.fail("the signal was lost")
            except KeyboardInterrupt:
                pass
            gc.collect()
        assert sys.unraisablehook is sys.__unraisablehook__
    finally:
        sys.unraisablehook = hook
        signal.signal(signal.SIGINT, found)
    assert capfd.readouterr().err == ""


@needs_signals
def test_what_others_handle_stays():
    """``nohup``, and programs with handlers of their own."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with stoppable():
            os.kill(os.getpid(), signal.SIGHUP)
            assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


@needs_signals
def test_other_threads_leave_signals_alone():
    inside = []

    def work():
        with stoppable():
            inside.append(signal.getsignal(signal.SIGTERM))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert inside == [signal.getsignal(signal.SIGTERM)]


@needs_signals
def test_what_starts_while_hangups_are_held_back_outlives_them():
    """As Python's tracker of semaphores must, when the terminal of a batch closes."""
    with hangup_held_back():
        process = subprocess.Popen(["cat"], stdin=subprocess.PIPE)
    process.send_signal(signal.SIGHUP)
    process.communicate(timeout=60)
    assert process.returncode == 0
    assert signal.SIGHUP not in signal.pthread_sigmask(signal.SIG_BLOCK, [])


@needs_signals
def test_batch_that_is_interrupted_leaves_whole_files_only(tmp_path):
    """Ctrl-C reaches the workers too; none of them says a word."""
    faults = tool()
    for person in ("ann", "bob", "eve"):
        person_folder(tmp_path / "people" / person, count=2, side=160)
    out = tmp_path / "out"
    words = ["batch", str(tmp_path / "people"), str(out), "--write=face.npz"]
    words += ["--workers=1", "--set=method=motion", "--set=detector=false"]
    with faults.start(words) as process:
        assert process.stderr.readline() == "[1/3] ann: done\n"
        _, code, said = faults.stop(process, "SIGINT", 0.3, whole_group=True)
    assert code == 130
    assert "bsface: interrupted" in said and "Traceback" not in said
    left = faults.contents(out)
    assert {"ann/face.npz", "ann/done.json"} <= set(left)
    for name, content in left.items():
        assert name.split("/")[1] in ("face.npz", "result.json", "done.json")
        assert content[:1] in (b"P", b"{")


# --- cancel --------------------------------------------------------------------------


@pytest.fixture(scope="module")
def painted():
    return painted_reconstruction(count=3, side=100)


def stopped_after(calls, action):
    """Whether the action stops when its progress raises at that call."""
    seen = []

    def progress(part):
        assert 0 <= part <= 1 and (not seen or part >= seen[-1])
        seen.append(part)
        if len(seen) == calls:
            raise Cancelled

    try:
        action(progress)
    except Cancelled:
        assert len(seen) == calls
        return True
    assert seen[-1] == 1
    return False


@pytest.mark.parametrize("calls", [1, 30, 150])
def test_texture_stops_at_any_call(painted, calls):
    assert stopped_after(calls, lambda tell: bake_texture(painted, 64, tell))


def test_page_stops_at_any_call_and_leaves_the_old_one(painted, tmp_path):
    page = tmp_path / "face.html"
    page.write_text("old")

    def write(tell):
        report.write_report(page, painted, textured=False, progress=tell)

    for calls in (1, 6):
        assert stopped_after(calls, write)
        assert page.read_text() == "old"
    assert not stopped_after(1000, write)
    assert page.read_text() != "old"


# --- memory --------------------------------------------------------------------------


@pytest.mark.parametrize(
    "error, short",
    [
        (MemoryError(), True),
        (RuntimeError("SUPERLU_MALLOC failed for buf in doubleCalloc()"), True),
        (OSError("std::bad_alloc"), True),
        (ValueError("Unable to allocate 3 GiB"), True),
        (ValueError("bad value"), False),
        (ReconstructionError("Unable to allocate photos"), False),
    ],
)
def test_want_of_memory_is_known_by_any_name(error, short):
    assert out_of_memory(error) == short
