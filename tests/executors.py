"""The simplest executor there is, for the tests of batches."""

from concurrent.futures import Executor, Future


class InThisProcess(Executor):
    """Runs each job at once where it is given."""

    def submit(self, function, /, *args, **kwargs):
        future = Future()
        try:
            future.set_result(function(*args, **kwargs))
        except BaseException as error:
            future.set_exception(error)
        return future
