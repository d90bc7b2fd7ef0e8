"""Work for a pool of threads, also while the interpreter ends."""

from concurrent.futures import Future

__all__ = ["begin"]


def begin(pool, work, *arguments):
    """Hand work over to a pool, or do it here and now where none takes any more.

    From the end of the main thread on pools refuse what is new, though other threads may go on for
    long, and handlers of `atexit` run after it.

    Parameters
    ----------
    pool : concurrent.futures.Executor
    work : callable
    *arguments

    Returns
    -------
    future : concurrent.futures.Future

    Raises
    ------
    Exception
        What the work fails with, if it is done here.
    """
    try:
        return pool.submit(work, *arguments)
    except RuntimeError:
        now = Future()
        now.set_result(work(*arguments))
        return now
