"""The hub between a daemon and the browsers: it encodes each message once for all viewers."""

from __future__ import annotations

import asyncio
import dataclasses
import json
import logging
import math
import time
from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..errors import WireError
from ..wire.client import Client
from ..wire.keys import key
from ..wire.messages import Event, Health, Message, Meta, Models, Pressure, Raw, Wrench
from .other_sources import OtherSources, triple
from .packets import cycle_packet
from .viewer import Viewer

_EVENTS_KEPT = 50
_ASK_AGAIN_S = 0.5

_log = logging.getLogger(__name__)


class _Foot:
    """The last messages of one foot."""

    def __init__(self) -> None:
        self.meta: Meta | None = None
        self.health: Health | None = None
        self.raw: Raw | None = None
        self.pressure: Pressure | None = None
        self.models: Models | None = None
        self.asked_s = -math.inf


class Hub:
    """Subscribes to one rig of `client` and to the other sources; it runs on the event loop."""

    def __init__(self, client: Client, rig: str, other_sources: OtherSources) -> None:
        self.viewers: set[Viewer] = set()
        self._client, self._rig, self._other_sources = client, rig, other_sources
        self._feet: dict[str, _Foot] = {"left": _Foot(), "right": _Foot()}
        self._latched: dict[str, str] = {}  # by kind: text that a new viewer gets first
        self._events: deque[str] = deque(maxlen=_EVENTS_KEPT)
        self._meta_requests: set[asyncio.Task[None]] = set()

    async def run(self) -> None:
        """Receive until cancelled, or until the client is closed."""
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._listen())
            for listening in self._other_sources.listening(self._client):
                tasks.create_task(listening)

    async def _listen(self) -> None:
        for foot in self._feet:
            self._ask(foot)
        async for message in self._client.messages(key(self._rig, "*", "*")):
            self._take(message)

    def join(self, viewer: Viewer) -> None:
        """Add a viewer: it gets the latched texts and last events, and then everything new."""
        self.viewers.add(viewer)
        for words in (*self._latched.values(), *self._events):
            viewer.queue_text(words)

    def leave(self, viewer: Viewer) -> None:
        """Remove a viewer."""
        self.viewers.discard(viewer)

    def publish_latched(self, kind: str, content: Mapping[str, Any]) -> None:
        """Send a text to all viewers, and to every later one until the next of the same kind."""
        self._latched[kind] = _text(kind, content)
        self._send_text(self._latched[kind])

    def publish_event(self, kind: str, content: Mapping[str, Any]) -> None:
        """Send a text to all viewers, and to later ones as one of the last events."""
        text = _text(kind, content)
        self._events.append(text)
        self._send_text(text)

    @property
    def feet(self) -> list[str]:
        """The feet with `meta` from a daemon."""
        return [foot for foot, state in self._feet.items() if state.meta is not None]

    def _send_text(self, words: str) -> None:
        for viewer in self.viewers:
            viewer.queue_text(words)

    def _take(self, message: Message) -> None:
        foot = self._feet[message.foot]
        if isinstance(message, Raw):
            foot.raw = message
        elif isinstance(message, Pressure):
            foot.pressure = message
        elif isinstance(message, Models):
            foot.models = message
        elif isinstance(message, Wrench):
            self._cycle(foot, message)
        elif isinstance(message, Health):
            foot.health = message
            self.publish_latched(f"health {message.foot}", dataclasses.asdict(message))
        elif (
            isinstance(message, Event) and message.figures
        ):  # a step: not kept for later viewers, the next one follows soon
            self._send_text(_text("event", dataclasses.asdict(message)))
        elif isinstance(message, Event):
            self.publish_event("event", dataclasses.asdict(message))
        elif isinstance(message, Meta):
            self._describe(message)

    def _cycle(self, foot: _Foot, wrench: Wrench) -> None:
        """Send a cycle to the viewers; the wrench is the last message of its cycle."""
        raw, pressure, meta = foot.raw, foot.pressure, foot.meta
        if meta is None or (meta.started_ns, meta.n_triangles) != (wrench.started_ns, wrench.n_triangles):
            self._ask(wrench.foot)  # another daemon, or the layout changed
            return
        if (
            raw is None
            or pressure is None
            or not _cycle_key(raw) == _cycle_key(pressure) == _cycle_key(wrench)
            or not self.viewers
        ):
            return
        other_values = self._other_sources.at(wrench.foot, wrench.t_ns, raw.counts.shape)
        # The model that is not in use replaces that of another rig.
        if foot.models is not None and foot.models.seq == wrench.seq:
            other_values = dataclasses.replace(other_values, model=_unused_model(foot.models))
        packet = cycle_packet(meta, raw, pressure, wrench, other_values)
        for viewer in self.viewers:
            viewer.queue_cycle(0 if wrench.foot == "left" else 1, packet)

    def _ask(self, name: str) -> None:
        """Request `meta` of a foot, at most twice a second."""
        foot = self._feet[name]
        if time.monotonic() - foot.asked_s < _ASK_AGAIN_S:
            return
        foot.asked_s = time.monotonic()

        async def ask() -> None:
            try:
                self._describe(await asyncio.to_thread(self._client.meta, name, self._rig))
            except WireError as error:
                _log.info("%s", error)  # a missing foot, or a starting daemon: its cycles request it again

        task = asyncio.create_task(ask())
        self._meta_requests.add(task)
        task.add_done_callback(self._meta_requests.discard)

    def _describe(self, meta: Meta) -> None:
        self._feet[meta.foot].meta = meta
        content = {name: value for name, value in dataclasses.asdict(meta).items() if name != "zero"}
        content = {name: value for name, value in content.items() if not isinstance(value, np.ndarray)}
        content["xy_mm"] = np.round(np.nan_to_num(meta.xy_m).astype(np.float64) * 1e3, 2).reshape(-1).tolist()
        self.publish_latched(f"meta {meta.foot}", content)


def _cycle_key(message: Raw | Pressure | Wrench) -> tuple[int, int, int]:
    """Return what identifies a cycle: start of the daemon, number, and number of triangles."""
    return message.started_ns, message.seq, message.n_triangles


def _unused_model(models: Models) -> tuple[float, float, float]:
    """Return the wrench of the model that is not in use."""
    if models.model == "dynamic":
        return triple((models.static_f_z_n, models.static_m_x_nm, models.static_m_y_nm))
    return triple((models.dynamic_f_z_n, models.dynamic_m_x_nm, models.dynamic_m_y_nm))


def _text(kind: str, content: Mapping[str, Any]) -> str:
    """Return the JSON text of a message; the first word of `kind` is its kind, an event's own kind becomes `what`."""
    event_kind = {"what": content["kind"]} if "kind" in content else {}
    return json.dumps({**content, **event_kind, "kind": kind.partition(" ")[0]}, ensure_ascii=False)
