"""The daemon's side of Zenoh: publish one foot."""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType
from typing import Any, Self

import zenoh
import zenoh.ext

from .keys import key
from .messages import CalibrationInUse, Event, Health, Message, Meta, Models, Pressure, Raw, Wrench


def _encoding(message: type[Message]) -> zenoh.Encoding:
    return zenoh.Encoding("application/msgpack").with_schema(message.SCHEMA)


class FootPublisher:
    """Publishes one foot's messages, answers queries for `meta` and `calibration`, and holds the liveliness token.

    A client that sees the token may query at once, so call `announce` last, when all answers are available. Cycle
    messages to a subscriber that does not read are dropped; the publisher never waits for it.
    """

    def __init__(self, session: zenoh.Session, rig: str, foot: str) -> None:
        self._session, self._rig, self.foot = session, rig, foot
        self._token: zenoh.LivelinessToken | None = None
        self._publishers: dict[type[Message], zenoh.Publisher] = {
            message: session.declare_publisher(
                key(rig, foot, what),
                encoding=_encoding(message),
                congestion_control=zenoh.CongestionControl.DROP,
                priority=zenoh.Priority.REAL_TIME,
            )
            for what, message in (("raw", Raw), ("pressure", Pressure), ("wrench", Wrench), ("models", Models))
        }
        self._publishers |= {
            message: session.declare_publisher(
                key(rig, foot, what),
                encoding=_encoding(message),
                congestion_control=zenoh.CongestionControl.DROP,
            )
            for what, message in (("health", Health), ("event", Event))
        }
        self._latched: dict[type[Message], tuple[Any, ...]] = {}
        self._payloads: dict[type[Message], bytes] = {}

    def publish(self, *messages: Message) -> None:
        """Put cycle messages, a health or an event on their keys."""
        self.put([(type(message), message.encode()) for message in messages])

    def put(self, payloads: Sequence[tuple[type[Message], bytes]]) -> None:
        """Put the payloads of messages on their keys.

        All are encoded before the first is put. Messages that are put in close succession leave in one packet, and
        Zenoh's sending thread wakes once.
        """
        for message, payload in payloads:
            self._publishers[message].put(payload)

    def publish_latched(self, what: str, message: Meta | CalibrationInUse) -> None:
        """Publish a message and keep it for late joiners: cached for advanced subscribers, returned to `get`.

        The next call replaces it; a query during that call gets the old or the new one.
        """
        kind, payload = type(message), message.encode()
        self._payloads[kind] = payload
        if kind not in self._latched:
            own_key, encoding = key(self._rig, self.foot, what), _encoding(kind)
            publisher = zenoh.ext.declare_advanced_publisher(
                self._session,
                own_key,
                encoding=encoding,
                cache=zenoh.ext.CacheConfig(max_samples=1),
                publisher_detection=True,
            )
            queryable = self._session.declare_queryable(
                own_key,
                lambda query: query.reply(own_key, self._payloads[kind], encoding=encoding),
                complete=True,
            )
            self._latched[kind] = (publisher, queryable)
        self._latched[kind][0].put(payload)

    def announce(self) -> None:
        """Declare the liveliness token of the foot."""
        self._token = self._session.liveliness().declare_token(key(self._rig, self.foot, "alive"))

    def close(self) -> None:
        """Undeclare everything; the liveliness token first, so that no client waits for a daemon that ends."""
        if self._token is not None:
            self._token.undeclare()
        for entities in self._latched.values():
            for entity in entities:
                entity.undeclare()
        self._latched.clear()
        for publisher in self._publishers.values():
            publisher.undeclare()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()
