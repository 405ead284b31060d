"""Progress on a terminal while a command computes: the current step, the share done, and the time left."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from itertools import accumulate
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.progress import Task
    from rich.text import Text


class Work:
    """The progress of a command; calling it prints a line and begins the next stage."""

    def __init__(
        self, write: Callable[[str], None], stages: Sequence[float], show: Callable[[float], None] = lambda share: None
    ) -> None:
        self._write, self._show = write, show
        self._done_before = [0.0, *accumulate(stage / sum(stages) for stage in stages)]
        self._lines = 0
        self._began_s = time.monotonic()
        self._ends_s: float | None = None  # by its pace so far

    def __call__(self, line: str) -> None:
        """Print `line` on stderr; all stages before it count as done."""
        self._write(f"insole: {line}")
        self.done(self._done_before[min(self._lines, len(self._done_before) - 1)])
        self._lines += 1

    def done(self, share: float) -> None:
        """Report the share of the work that is done, from 0 to 1."""
        if 0 < share <= 1:
            now_s = time.monotonic()
            self._ends_s = now_s + (now_s - self._began_s) * (1 - share) / share
            self._show(share)

    def time_left(self) -> str:
        """Return minutes and seconds as text for a terminal; an empty text while they are unknown."""
        if self._ends_s is None:
            return ""
        left_s = max(1, round(self._ends_s - time.monotonic()))  # an overdue stage is about to end
        return f"{left_s // 60}:{left_s % 60:02d} left"


def _write_line(line: str) -> None:
    """Write `line` on stderr in one piece: `print` writes the end of a line apart, and Ctrl-C may come between."""
    sys.stderr.write(f"{line}\n")
    sys.stderr.flush()


@contextlib.contextmanager
def show_work(title: str, stages: Sequence[float] = ()) -> Iterator[Work]:
    """Show `title`, the elapsed time and the time left on a terminal; yield the Work that receives the progress.

    `stages`: how long each takes beside the others, where each begins with a line.
    """
    if not sys.stderr.isatty():
        yield Work(_write_line, stages)
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, ProgressColumn, TextColumn, TimeElapsedColumn
    from rich.text import Text

    console = Console(stderr=True)

    class TimeLeft(ProgressColumn):
        def render(self, task: Task) -> Text:
            return Text(work.time_left())

    columns = (TextColumn("{task.description}", markup=False), BarColumn(20), TimeElapsedColumn(), TimeLeft())
    progress = Progress(*columns, console=console, transient=True)
    bar = progress.add_task(title, total=None)  # it pulses until a share is known
    work = Work(
        lambda line: console.print(line, markup=False, highlight=False, soft_wrap=True),
        stages,
        lambda share: progress.update(bar, completed=share, total=1.0),
    )
    with progress:
        yield work
