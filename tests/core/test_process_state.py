"""Settings of the process that several threads hold at once."""

import threading

import pytest
from bsface.process_state import WhileAnyone


class Level:
    """A number of the process, which is to be 1 inside the block."""

    def __init__(self):
        self.value, self.changes = 4, 0

    def change(self):
        before, self.value = self.value, 1
        self.changes += 1

        def undo():
            self.value = before

        return undo


def test_the_setting_comes_back_after_the_block_and_after_an_error():
    level = Level()
    quiet = WhileAnyone(level.change)
    with quiet(), quiet():
        assert level.value == 1
    assert (level.value, level.changes) == (4, 1)
    with pytest.raises(KeyError), quiet():
        raise KeyError
    assert (level.value, level.changes) == (4, 2)


@pytest.mark.parametrize("first_out", [0, 1])
def test_blocks_of_two_threads_that_overlap(first_out):
    level = Level()
    quiet = WhileAnyone(level.change)
    inside = [threading.Event(), threading.Event()]
    leave = [threading.Event(), threading.Event()]

    def hold(k):
        with quiet():
            inside[k].set()
            leave[k].wait(10)

    threads = [threading.Thread(target=hold, args=(k,)) for k in range(2)]
    for thread, entered in zip(threads, inside, strict=True):
        thread.start()
        assert entered.wait(10)
    for k, expected in ((first_out, 1), (1 - first_out, 4)):
        leave[k].set()
        threads[k].join(10)
        assert level.value == expected
    assert level.changes == 1
