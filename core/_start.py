"""Ctrl-C while the program is still being imported.

Importing NumPy, SciPy and OpenCV takes half a second, in which Ctrl-C would show where
in them Python was.  A process that was started as bsface ends there without a word;
nothing is open yet.  The workers of a batch end so at any time; the batch tidies up
after them.  A process that only imports the library is left as it is.
"""

import os
import signal
import sys

#: In the environment of a batch's workers.
WORKER = "BSFACE_WORKER"


def _started_as_bsface() -> bool:
    """Whether this process is ``python -m bsface``, or a worker of a batch."""
    if WORKER in os.environ:
        return True
    # Python writes the program's path into argv[0] once it has found the package.
    words = sys.orig_argv
    if sys.argv[:1] != ["-m"] or "-m" not in words:
        return False
    return words[words.index("-m") + 1 : words.index("-m") + 2] == ["bsface"]


if _started_as_bsface():
    signal.signal(signal.SIGINT, signal.SIG_DFL)
