"""The client for other programs: iterate over the messages of a daemon.

    with insole_daemon.connect() as insole:
        for wrench in insole.wrenches("left"):
            print(wrench.f_z_n, wrench.cop_x_m)

    async with insole_daemon.connect() as insole:
        async for wrench in insole.wrenches("left"):
            print(wrench.f_z_n, wrench.cop_x_m)

The session reconnects by itself when the daemon restarts. A message's `lost` is the number of cycles of its stream that
did not reach this program before it: dropped by the network, or by a full queue because they were not taken in time.
"""

from __future__ import annotations

import asyncio
import dataclasses
import logging
import threading
from collections import deque
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any, Generic, Self, TypeVar

import zenoh

from ..config import DEFAULT_ENDPOINT
from ..errors import WireError
from .keys import ROOT, key
from .messages import BY_KEY, CalibrationInUse, Event, Health, Message, Meta, Models, Pressure, Raw, Wrench
from .requests import REPLY_SCHEMA, REQUEST_SCHEMA, encoding, pack, unpack
from .session import full_endpoint, open_session

M = TypeVar("M", bound=Message)
S = TypeVar("S", bound="Subscription[Any]")

QUEUE_LENGTH = 500  # messages kept for a program that is busy: 10 s of one stream
_ANSWER_S = 10.0  # a daemon with too little CPU needs seconds; where nobody has the foot, that is said at once
_DONE_S = 60.0  # a request may take that long

_log = logging.getLogger(__name__)


class Gaps:
    """Counts the missing sequence numbers of every stream."""

    def __init__(self) -> None:
        self._next: dict[str, tuple[int, int]] = {}  # by key: start of the daemon, next expected number

    def mark(self, stream: str, message: M) -> M:
        """Return the message with `lost` filled in; it is 0 for the first message of a restarted daemon."""
        if not isinstance(message, (Raw, Pressure, Wrench, Models)):
            return message
        started_ns, expected = self._next.get(stream, (0, 0))
        self._next[stream] = message.started_ns, message.seq + 1
        if started_ns != message.started_ns or message.seq <= expected:
            return message
        return dataclasses.replace(message, lost=message.seq - expected)


def _kind(key_expression: str) -> str:
    """Return the last chunk of a key, which names the kind of message."""
    return key_expression.rpartition("/")[2]


def _unknown(key_expression: str) -> WireError:
    return WireError(
        f"{key_expression}: expected a key ending in one of {', '.join(BY_KEY)}, or in a wildcard; where a newer "
        "daemon publishes it, install the same insole-daemon here"
    )


def decode_sample(sample: zenoh.Sample) -> Message:
    """Decode a sample by the last chunk of its key; raises WireError if it is not a message of this package."""
    cls = BY_KEY.get(_kind(str(sample.key_expr)))
    if cls is None:
        raise _unknown(str(sample.key_expr))
    return cls.decode(sample.payload.to_bytes(), str(sample.encoding))


class Subscription(Generic[M]):
    """The messages of one key expression, for `for` and for `async for`; ends when its connection is closed."""

    def __init__(self, session: zenoh.Session, key_expression: str) -> None:
        self._samples: deque[zenoh.Sample] = deque(maxlen=QUEUE_LENGTH)
        self._arrived = threading.Condition()
        self._tell: Callable[[], object] | None = None  # wakes the event loop that waits in `async for`
        self._closed = False
        self._gaps = Gaps()
        self._subscriber = session.declare_subscriber(key_expression, self._receive)

    def _receive(self, sample: zenoh.Sample) -> None:
        with self._arrived:
            self._samples.append(sample)
            self._wake()

    def _wake(self) -> None:
        self._arrived.notify_all()
        if self._tell is not None:
            try:
                self._tell()
            except RuntimeError:  # the event loop has ended, and with it the task that waited
                self._tell = None

    def _decode(self, sample: zenoh.Sample) -> M | None:
        """Return the message in a sample; None skips it."""
        return self._gaps.mark(str(sample.key_expr), decode_sample(sample))  # type: ignore[return-value]

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> M:
        while True:
            with self._arrived:
                while not self._samples and not self._closed:
                    self._arrived.wait()
                if not self._samples:
                    raise StopIteration
                sample = self._samples.popleft()
            if (message := self._decode(sample)) is not None:
                return message

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> M:
        loop, arrived = asyncio.get_running_loop(), asyncio.Event()
        self._tell = lambda: loop.call_soon_threadsafe(arrived.set)
        while True:
            with self._arrived:
                sample = self._samples.popleft() if self._samples else None
                if sample is None:
                    if self._closed:
                        raise StopAsyncIteration
                    arrived.clear()
            if sample is None:
                await arrived.wait()
            elif (message := self._decode(sample)) is not None:
                return message

    def close(self) -> None:
        """End the iteration after the messages that have arrived."""
        with self._arrived:
            if self._closed:
                return
            self._closed = True
            self._wake()
        self._subscriber.undeclare()


class Messages(Subscription[Message]):
    """Messages of every kind under a key expression, whoever publishes them.

    Unknown content does not end the iteration. A kind that this version does not know is ignored, as protocol/README.md
    promises to newer daemons. A payload that does not match its key is skipped and logged once per key.
    """

    def __init__(self, session: zenoh.Session, key_expression: str) -> None:
        self.refused = 0  # payloads that were skipped
        self._told: set[str] = set()
        super().__init__(session, key_expression)

    def _decode(self, sample: zenoh.Sample) -> Message | None:
        own_key = str(sample.key_expr)
        if _kind(own_key) not in BY_KEY:
            return None
        try:
            return super()._decode(sample)
        except WireError as error:
            self.refused += 1
            if own_key not in self._told:
                self._told.add(own_key)
                _log.warning("%s: passed over, as will be what follows like it: %s", own_key, error)
            return None


class Payloads(Subscription[Any]):
    """Payloads of other programs under a key expression, as bytes."""

    def _decode(self, sample: zenoh.Sample) -> bytes:
        payload: bytes = sample.payload.to_bytes()
        return payload


class Client:
    """A connection to the daemons behind one endpoint; `rig` narrows it to one wearer.

    `endpoint` may leave out tcp/ and the port.
    It is open inside `with` or `async with`. `config_file`: Zenoh's own configuration, with this client's certificate.
    """

    def __init__(self, endpoint: str = DEFAULT_ENDPOINT, rig: str = "*", config_file: Path | None = None) -> None:
        self.endpoint, self.rig, self._config_file = full_endpoint(endpoint), rig, config_file
        self._opened: zenoh.Session | None = None
        self._subscriptions: list[Subscription[Any]] = []

    def raws(self, foot: str = "*") -> Subscription[Raw]:
        """Subscribe to the counts of every cycle of `foot` ("left", "right", "*" for both)."""
        return self._subscribe(key(self.rig, foot, "raw"))

    def pressures(self, foot: str = "*") -> Subscription[Pressure]:
        """Subscribe to the pressure map of every cycle."""
        return self._subscribe(key(self.rig, foot, "pressure"))

    def wrenches(self, foot: str = "*") -> Subscription[Wrench]:
        """Subscribe to f_z, m_x, m_y and CoP of every cycle."""
        return self._subscribe(key(self.rig, foot, "wrench"))

    def models(self, foot: str = "*") -> Subscription[Models]:
        """Subscribe to the estimates of both models in every cycle, of feet whose calibration has effects."""
        return self._subscribe(key(self.rig, foot, "models"))

    def healths(self, foot: str = "*", rig: str | None = None) -> Subscription[Health]:
        """Subscribe to the state and faults of the daemon, once a second; name the `rig` if several have the foot."""
        return self._subscribe(key(rig or self.rig, foot, "health"))

    def events(self, foot: str = "*") -> Subscription[Event]:
        """Subscribe to events as they happen."""
        return self._subscribe(key(self.rig, foot, "event"))

    def messages(self, key_expression: str = f"{ROOT}/**") -> Messages:
        """Subscribe to all messages under a key expression, each of its own type; other content is skipped.

        Raises WireError if the key expression names an unknown kind, of which no message would ever come.
        """
        kind = _kind(key_expression)
        if "*" not in kind and kind not in BY_KEY:
            raise _unknown(key_expression)
        return self._keep(Messages(self._session, key_expression))

    def payloads(self, key_expression: str) -> Payloads:
        """Subscribe to the payloads of other programs, such as a reference instrument."""
        return self._keep(Payloads(self._session, key_expression))

    def meta(self, foot: str, rig: str | None = None) -> Meta:
        """Return layout, boards and settings of `foot` (of `rig` if several have it); WireError if no daemon has it."""
        return self._get(key(rig or self.rig, foot, "meta"))  # type: ignore[return-value]

    def calibration(self, foot: str) -> CalibrationInUse:
        """Return the static curve in use for `foot`; raises WireError if no daemon has it."""
        return self._get(key(self.rig, foot, "calibration"))  # type: ignore[return-value]

    def request(self, foot: str, verb: str, **arguments: Any) -> dict[str, Any]:
        """Send the daemon of `foot` a request, such as `request("left", "boards", do="list")`; return its reply.

        Raises WireError if no daemon has that foot, several have it, or the request failed.
        """
        rig = self.rig_of(foot)
        own_key = key(rig or self.rig, foot, verb)
        if rig is not None:
            replies = self._session.get(
                own_key, payload=pack(arguments), encoding=encoding(REQUEST_SCHEMA), timeout=_DONE_S
            )
            for reply in replies:
                if reply.ok is not None:
                    content = unpack(reply.ok.payload.to_bytes(), REPLY_SCHEMA)
                    if "error" in content:
                        raise WireError(str(content["error"]))
                    return content
        raise WireError(
            f"nobody answered for {own_key}: is that foot in the daemon's config, the daemon of the same version, and "
            "may this client ask it (access_control of the daemon's Zenoh)? 'insole status' lists what runs"
        )

    def rig_of(self, foot: str) -> str | None:
        """Return the rig that has `foot`, None if none has; raises WireError if several have."""
        rigs = [rig for rig, published_foot in self.feet() if published_foot == foot]
        if len(rigs) > 1:
            raise WireError(
                f"{' and '.join(rigs)} have a {foot} foot: say which is meant with --rig, as --rig {rigs[0]} "
                f"(in Python, connect(…, rig={rigs[0]!r}))"
            )
        return rigs[0] if rigs else None

    def feet(self) -> list[tuple[str, str]]:
        """Return (rig, foot) of every foot that a daemon publishes now."""
        replies = self._session.liveliness().get(key(self.rig, "*", "alive"), timeout=_ANSWER_S)
        chunks = [str(reply.ok.key_expr).split("/") for reply in replies if reply.ok is not None]
        return sorted((rig, foot) for _, rig, foot, _ in chunks)

    def open(self) -> Self:
        """Connect; raises WireError if nobody answers on the endpoint."""
        self._opened = open_session("client", connect=[self.endpoint], config_file=self._config_file, rules=False)
        return self

    def close(self) -> None:
        """End every subscription and the session."""
        for subscription in self._subscriptions:
            subscription.close()
        self._session.close()

    def __enter__(self) -> Self:
        return self.open()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    async def __aenter__(self) -> Self:
        return await asyncio.to_thread(self.open)

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        await asyncio.to_thread(self.close)

    @property
    def _session(self) -> zenoh.Session:
        if self._opened is None:
            raise WireError("not connected: use 'with insole_daemon.connect() as insole:'")
        return self._opened

    def _subscribe(self, key_expression: str) -> Subscription[Any]:
        return self._keep(Subscription(self._session, key_expression))

    def _keep(self, subscription: S) -> S:
        """Register a subscription, so that it ends with the connection."""
        self._subscriptions.append(subscription)
        return subscription

    def _get(self, own_key: str) -> Message:
        for reply in self._session.get(own_key, timeout=_ANSWER_S):
            if reply.ok is not None:
                return decode_sample(reply.ok)
        raise WireError(
            f"nobody answered for {own_key} within {_ANSWER_S:g} s: is that foot in the daemon's config, "
            "and is the rig's name right? 'insole status' lists what runs"
        )
