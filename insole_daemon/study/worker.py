"""Set-up of a local worker, which Dask calls when the worker has started."""

from __future__ import annotations

import signal
from typing import Any


def dask_setup(worker: Any) -> None:
    """Leave Ctrl-C, which a terminal sends to workers too, to the command; programs that a task starts still end.

    The worker inherits SIGINT as blocked, so that it does not end with a traceback while it starts.
    """
    signal.signal(signal.SIGINT, lambda number, frame: None)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
