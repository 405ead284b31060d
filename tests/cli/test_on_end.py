"""How a signal ends a verb."""

import signal
import threading
from collections.abc import Iterator

import pytest

from insole_daemon.cli.options import on_end
from tests.conftest import PATIENCE_S


@pytest.fixture(autouse=True)
def handlers() -> Iterator[None]:
    """The handlers of before, afterwards."""
    numbers = (signal.SIGTERM, signal.SIGINT)
    before = [signal.getsignal(number) for number in numbers]
    yield
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_while_the_main_thread_holds_the_lock_that_stop_takes_ends_it(number: int) -> None:
    lock, stopped = threading.Lock(), threading.Event()

    def stop() -> None:
        if lock.acquire(timeout=PATIENCE_S):
            stopped.set()

    on_end(stop)
    with lock:
        signal.raise_signal(number)
        assert not stopped.wait(0.05)
    assert stopped.wait(PATIENCE_S)
