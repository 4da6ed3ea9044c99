"""What the tests of the add-on test: the checkout, or the zip as it is installed.

The checkout is a package of its own here, so that the add-on's relative imports
(`..core`) work as they do inside Blender.
"""

import importlib
import importlib.util
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
CHECKOUT = "bsface_checkout"
# Set by conftest.py for `--from-zip`, before any test file is read.
_installed = []


def use_zip():
    """From here on, install the zip and test that."""
    import zip_file

    _installed.append(zip_file.installed())


def is_installed():
    """Whether what is tested was installed from the zip, and so is registered."""
    return bool(_installed)


def package():
    """Name of the package that is tested."""
    if _installed:
        return _installed[0]
    if CHECKOUT not in sys.modules:
        spec = importlib.util.spec_from_file_location(
            CHECKOUT, ROOT / "__init__.py", submodule_search_locations=[str(ROOT)]
        )
        module = importlib.util.module_from_spec(spec)
        sys.modules[CHECKOUT] = module
        spec.loader.exec_module(module)
    return CHECKOUT


def load(name):
    """Import a module of what is tested, e.g. ``load("bsface_addon.scene")``."""
    return importlib.import_module(f"{package()}.{name}")
