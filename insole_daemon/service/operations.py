"""Run requests as generators on the main loop, which alone owns the buses and all state.

An operation is a generator. The loop resumes it once an iteration with a `Step`, and what it returns is the reply:

    def blink(request: dict[str, Any]) -> Operation:
        step = yield
        step = yield from pause(step, 100_000_000)
        return {"done": True}

    desk.offer("blink", blink)        # answers queries on insole/<rig>/<foot>/blink

An operation raises an InsoleError if it cannot do what was requested; its text is the reply's `error`.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Any

import zenoh

from ..bus.frames import FrameBatch
from ..errors import InsoleError, WireError
from ..skin.cycles import Cycles
from ..wire.keys import key
from ..wire.requests import REPLY_SCHEMA, REQUEST_SCHEMA, encoding, pack, unpack

_HELD_UP_NS = 100_000_000  # as long as the loop may wait for frames


@dataclass(frozen=True, slots=True)
class Step:
    """The input of an operation in one iteration of the loop."""

    now_mono_ns: int  # on the clock of the source of frames
    closed: list[Cycles]  # of this foot, in order
    frames: FrameBatch  # of all buses, other traffic included
    attended_ns: int  # the clock for waits, see AttendedClock


class AttendedClock:
    """A clock that excludes stalls of the loop: of the time between two turns, at most _HELD_UP_NS count.

    After a stall of the host, answers that the boards sent meanwhile may still be waiting to be read.
    """

    def __init__(self) -> None:
        self._before_ns: int | None = None
        self._held_up_ns = 0

    def turn(self, now_mono_ns: int) -> int:
        """Return the attended time at a turn of the loop."""
        if self._before_ns is not None:
            self._held_up_ns += max(0, now_mono_ns - self._before_ns - _HELD_UP_NS)
        self._before_ns = now_mono_ns
        return now_mono_ns - self._held_up_ns


Operation = Generator[None, Step, dict[str, Any]]
Handler = Callable[[dict[str, Any]], Operation]  # from the request's map


def pause(step: Step, wait_ns: int) -> Generator[None, Step, Step]:
    """Wait for at least `wait_ns`; return the step in which they have passed."""
    until_ns = step.attended_ns + wait_ns
    while step.attended_ns < until_ns:
        step = yield
    return step


class RequestDesk:
    """Takes one foot's requests from Zenoh's threads, and runs at most one of each verb on the loop."""

    def __init__(self, session: zenoh.Session, rig: str, foot: str) -> None:
        self.done = self.refused = 0
        self._session, self._rig, self._foot = session, rig, foot
        self._arrived: SimpleQueue[tuple[str, zenoh.Query]] = SimpleQueue()
        self._handlers: dict[str, Handler] = {}
        self._running: dict[str, tuple[Operation, zenoh.Query]] = {}
        self._background: list[Operation] = []
        self._queryables: list[Any] = []

    @property
    def idle(self) -> bool:
        """Whether no request waits and no operation runs."""
        return not (self._running or self._background) and self._arrived.empty()

    @property
    def busy(self) -> bool:
        """Whether a request runs or waits; the loop then iterates more often than frames require."""
        return bool(self._running) or not self._arrived.empty()

    def offer(self, verb: str, handler: Handler) -> None:
        """Answer queries on the foot's key `verb` with the operation that `handler` returns for each."""
        self._handlers[verb] = handler
        own_key = key(self._rig, self._foot, verb)
        self._queryables.append(
            self._session.declare_queryable(own_key, lambda query: self._arrived.put((verb, query)), complete=True)
        )

    def keep(self, operation: Operation) -> None:
        """Run an operation without a request, until it returns."""
        next(operation)
        self._background.append(operation)

    def step(self, step: Step) -> None:
        """Start the requests that have arrived, and resume every running operation."""
        while not self._arrived.empty():  # only this thread takes from the queue
            self._begin(*self._arrived.get())
        for verb, (operation, query) in list(self._running.items()):
            reply = _resume(operation, step)
            if reply is not None:
                del self._running[verb]
                self._reply(verb, query, reply)
        self._background = [operation for operation in self._background if _resume(operation, step) is None]

    def close(self) -> None:
        """Take no more requests, and reply to open ones that the daemon ends."""
        for queryable in self._queryables:
            queryable.undeclare()
        waiting = [(verb, query) for verb, (_, query) in self._running.items()]
        while not self._arrived.empty():
            waiting.append(self._arrived.get())
        for operation, _ in self._running.values():
            operation.close()
        for operation in self._background:
            operation.close()
        self._running, self._background = {}, []
        for verb, query in waiting:
            self._reply(verb, query, {"error": "the daemon ends"})

    def _begin(self, verb: str, query: zenoh.Query) -> None:
        if verb in self._running:
            text = f"a request for '{verb}' of the {self._foot} foot is still running: try again when it is done"
            self._reply(verb, query, {"error": text})
            return
        try:
            if query.payload is None:
                raise WireError(f'{REQUEST_SCHEMA}: expected a msgpack map such as {{"do": …}}, found no payload')
            operation = self._handlers[verb](unpack(query.payload.to_bytes(), REQUEST_SCHEMA))
            next(operation)
        except StopIteration as done:
            self._reply(verb, query, done.value)
        except Exception as error:
            self._reply(verb, query, _apology(error))
        else:
            self._running[verb] = operation, query

    def _reply(self, verb: str, query: zenoh.Query, reply: dict[str, Any]) -> None:
        if "error" in reply or reply.get("ok") is False:
            self.refused += 1
        else:
            self.done += 1
        try:
            query.reply(key(self._rig, self._foot, verb), pack(reply), encoding=encoding(REPLY_SCHEMA))
        except zenoh.ZError:
            pass  # the client has gone
        query.drop()  # ends the answer; without it the client waits until its time-out


def _resume(operation: Operation, step: Step) -> dict[str, Any] | None:
    """Return the reply of an operation that has ended, with an error if it failed; None while it runs."""
    try:
        operation.send(step)
    except StopIteration as done:
        reply: dict[str, Any] = done.value
        return reply
    except Exception as error:
        return _apology(error)
    return None


def _apology(error: Exception) -> dict[str, Any]:
    """Return an exception as a reply. No exception of an operation may end the acquisition."""
    if isinstance(error, InsoleError):
        return {"error": str(error)}
    return {"error": f"a mistake in insole-daemon, please report it: {type(error).__name__}: {error}"}
