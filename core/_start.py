"""What is done before anything else when the program is started.

Importing NumPy, SciPy and OpenCV takes a second, in which Ctrl-C would show where in
them Python was. As a program bsface ends there without a word; nothing is open yet.
The workers of a batch end so at any time; the batch itself tidies up after them.
"""

import os
import signal
import sys

#: In the environment of a batch's workers.
WORKER = "BSFACE_WORKER"

# Python writes the program's path there once it has found the package it shall run.
if sys.argv[:1] == ["-m"] or WORKER in os.environ:
    signal.signal(signal.SIGINT, signal.SIG_DFL)
