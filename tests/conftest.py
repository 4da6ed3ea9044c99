"""Set-up for all tests: Blender's user folder, and an end that cannot hang."""

import importlib.util
import os
import shutil
import sys
import tempfile

import hypothesis
import pytest

# The same examples in each run, and no clock: a failure means a defect, not a slow
# machine. Look for new examples with `--hypothesis-profile=search`.
hypothesis.settings.register_profile("bsface", derandomize=True, deadline=None)
hypothesis.settings.register_profile("search", deadline=None, max_examples=1000)
hypothesis.settings.load_profile("bsface")

HAS_BPY = importlib.util.find_spec("bpy") is not None
# Without Blender's Python module these folders cannot even be imported.
collect_ignore = [] if HAS_BPY else ["blender", "extension"]

# Read by bpy when it is first imported: the tests leave the user's own Blender
# settings and extensions alone.
_resources = tempfile.mkdtemp(prefix="bsface-test-resources-")
os.environ["BLENDER_USER_RESOURCES"] = _resources


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--from-zip",
        action="store_true",
        help="tests/blender: build the extension's zip, install it and test that, "
        "instead of the checkout",
    )


def pytest_report_header() -> str:
    if HAS_BPY:
        return "bpy: installed"
    return "bpy: not installed, so tests/blender and tests/extension are left out"


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    session.config.stash[_exit_status] = int(exitstatus)


@pytest.hookimpl(trylast=True)
def pytest_unconfigure(config: pytest.Config) -> None:
    """End at once when bpy was imported: bpy 4.5 has hung at interpreter exit.

    The summary is printed and the reports are written by now.
    """
    shutil.rmtree(_resources, ignore_errors=True)
    status = config.stash.get(_exit_status, None)
    if "bpy" in sys.modules and status is not None:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)


_exit_status = pytest.StashKey[int]()
