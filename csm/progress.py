"""What a command is doing, on stderr: a moving line on a terminal, plain lines elsewhere."""

import sys
import time
from contextlib import contextmanager

__all__ = ["Progress"]


class Progress:
    """Names the stages of a job as they run and, at the end of each, how long it took.

    Parameters
    ----------
    stream : file, optional
        Where to write; ``sys.stderr`` by default. On a terminal, with rich installed, a running
        stage shows a spinner and a bar.
    quiet : bool
        Write nothing.
    """

    def __init__(self, stream=None, *, quiet=False):
        self._stream = stream or sys.stderr
        self._quiet = quiet

    @contextmanager
    def stage(self, text):
        """Run a stage.

        Parameters
        ----------
        text : str
            What is being done, e.g. ``"tracing the truth"``.

        Yields
        ------
        advance : callable
            Takes the share done, 0 to 1; need not be called.
        """
        start = time.perf_counter()
        bar = None if self._quiet else _rich_bar(self._stream)
        if bar is not None:
            with bar:
                task = bar.add_task(text, total=None)
                yield lambda share: bar.update(task, completed=share, total=1.0)
            self._write(f"{text} …")
        else:
            self._write(f"{text} …")
            try:
                yield lambda share: None
            except BaseException:
                self._write("\n")  # what is said about it must not share the line
                raise
        self._write(f" {time.perf_counter() - start:.1f} s\n")

    def _write(self, text):
        if not self._quiet:
            self._stream.write(text)
            self._stream.flush()


def _rich_bar(stream):
    """Return rich's bar for a terminal, None where there is no terminal or no rich."""
    if not stream.isatty():
        return None
    try:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
    except ImportError:
        return None
    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    return Progress(*columns, console=Console(file=stream), transient=True)
