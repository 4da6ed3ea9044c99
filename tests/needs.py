"""What a test needs of the system, as marks that skip it elsewhere."""

import os
import sys

import pytest

needs_full_device = pytest.mark.skipif(
    not os.path.exists("/dev/full"), reason="needs /dev/full"
)
needs_permissions = pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may read everything"
)
needs_signals = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
