"""Connects to the workers of a Dask scheduler, on which cases are made and run."""

import contextlib
from collections.abc import Iterator
from concurrent.futures import Executor


@contextlib.contextmanager
def dask_executor(scheduler: str) -> Iterator[Executor]:
    """An executor on the workers of the scheduler at this address; the workers need to see the same files.

    Certificates for TLS are those of Dask's own configuration.
    """
    from distributed import Client

    with Client(scheduler) as client:
        yield client.get_executor(pure=False)
