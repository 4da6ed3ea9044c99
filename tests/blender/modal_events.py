"""Made-up events, and an operator driven by them to its end."""

import time
from types import SimpleNamespace

TIMER = SimpleNamespace(type="TIMER", value="NOTHING")
ESC = SimpleNamespace(type="ESC", value="PRESS")


def until_end(operator, window):
    """What the operator ends with."""
    for _ in range(400):
        result = operator.modal(window, TIMER)
        if result != {"PASS_THROUGH"}:
            return result
        time.sleep(0.01)
    raise AssertionError("the operator did not end")
