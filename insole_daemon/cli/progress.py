"""What a person sees on a terminal while a command computes: what it does, and for how long it has."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator


@contextlib.contextmanager
def show_work(what: str) -> Iterator[Callable[[str], None]]:
    """Show `what` and the time since it began, on a terminal; gives what prints a line on stderr meanwhile."""
    if not sys.stderr.isatty():
        yield lambda line: print(f"insole: {line}", file=sys.stderr, flush=True)
        return
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        progress.add_task(what, total=None)
        yield lambda line: console.print(f"insole: {line}", markup=False, highlight=False, soft_wrap=True)
