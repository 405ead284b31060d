"""Between a daemon and the browsers: what is published into packets and words, once for all who look."""

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
from .beside import Others, triple
from .packets import cycle_packet
from .viewer import Viewer

_EVENTS_KEPT = 50
_ASK_AGAIN_S = 0.5

_log = logging.getLogger(__name__)


class _Foot:
    """The last of everything of one foot."""

    def __init__(self) -> None:
        self.meta: Meta | None = None
        self.health: Health | None = None
        self.raw: Raw | None = None
        self.pressure: Pressure | None = None
        self.models: Models | None = None
        self.asked_s = -math.inf


class Hub:
    """Listens to one rig of `client`, and to what is published beside it; everything happens on the event loop."""

    def __init__(self, client: Client, rig: str, others: Others) -> None:
        self.viewers: set[Viewer] = set()
        self._client, self._rig, self._others = client, rig, others
        self._feet: dict[str, _Foot] = {"left": _Foot(), "right": _Foot()}
        self._standing: dict[str, str] = {}  # by kind: what a new viewer must know
        self._events: deque[str] = deque(maxlen=_EVENTS_KEPT)
        self._asking: set[asyncio.Task[None]] = set()

    async def run(self) -> None:
        """Until cancelled, or the client is closed."""
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._listen())
            for listening in self._others.listening(self._client):
                tasks.create_task(listening)

    async def _listen(self) -> None:
        for foot in self._feet:
            self._ask(foot)
        async for message in self._client.messages(key(self._rig, "*", "*")):
            self._take(message)

    def join(self, viewer: Viewer) -> None:
        """Let a viewer know what is known, and what comes from now on."""
        self.viewers.add(viewer)
        for words in (*self._standing.values(), *self._events):
            viewer.say(words)

    def leave(self, viewer: Viewer) -> None:
        """It has gone."""
        self.viewers.discard(viewer)

    def stand(self, kind: str, said: Mapping[str, Any]) -> None:
        """Tell all viewers, and every later one, until the next of the same kind."""
        self._standing[kind] = _text(kind, said)
        self._say(self._standing[kind])

    def tell(self, kind: str, said: Mapping[str, Any]) -> None:
        """Tell all viewers, and later ones too, as one of the last events."""
        text = _text(kind, said)
        self._events.append(text)
        self._say(text)

    @property
    def feet(self) -> list[str]:
        """Those that a daemon has described."""
        return [foot for foot, known in self._feet.items() if known.meta is not None]

    def _say(self, words: str) -> None:
        for viewer in self.viewers:
            viewer.say(words)

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
            self.stand(f"health {message.foot}", dataclasses.asdict(message))
        elif isinstance(message, Event) and message.figures:  # a step: soon there is another
            self._say(_text("event", dataclasses.asdict(message)))
        elif isinstance(message, Event):
            self.tell("event", dataclasses.asdict(message))
        elif isinstance(message, Meta):
            self._describe(message)

    def _cycle(self, foot: _Foot, wrench: Wrench) -> None:
        """The wrench is the last message of its cycle."""
        raw, pressure, meta = foot.raw, foot.pressure, foot.meta
        if meta is None or (meta.started_ns, meta.n_triangles) != (wrench.started_ns, wrench.n_triangles):
            self._ask(wrench.foot)  # the daemon is another one since
            return
        if raw is None or pressure is None or not _of(raw) == _of(pressure) == _of(wrench) or not self.viewers:
            return
        beside = self._others.at(wrench.foot, wrench.t_ns, raw.counts.shape)
        # Rather the model that is not in use than another rig.
        if foot.models is not None and foot.models.seq == wrench.seq:
            beside = dataclasses.replace(beside, model=_other(foot.models))
        packet = cycle_packet(meta, raw, pressure, wrench, beside)
        for viewer in self.viewers:
            viewer.show(0 if wrench.foot == "left" else 1, packet)

    def _ask(self, name: str) -> None:
        """Get the description of a foot, at most twice a second."""
        foot = self._feet[name]
        if time.monotonic() - foot.asked_s < _ASK_AGAIN_S:
            return
        foot.asked_s = time.monotonic()

        async def ask() -> None:
            try:
                self._describe(await asyncio.to_thread(self._client.meta, name, self._rig))
            except WireError as error:
                _log.info("%s", error)  # a foot that is not there, or a daemon on its way up: its cycles ask again

        task = asyncio.create_task(ask())
        self._asking.add(task)
        task.add_done_callback(self._asking.discard)

    def _describe(self, meta: Meta) -> None:
        self._feet[meta.foot].meta = meta
        said = {name: value for name, value in dataclasses.asdict(meta).items() if name != "zero"}
        said = {name: value for name, value in said.items() if not isinstance(value, np.ndarray)}
        said["xy_mm"] = np.round(np.nan_to_num(meta.xy_m).astype(np.float64) * 1e3, 2).reshape(-1).tolist()
        self.stand(f"meta {meta.foot}", said)


def _of(message: Raw | Pressure | Wrench) -> tuple[int, int, int]:
    """Which cycle of which daemon, and how large its arrays are."""
    return message.started_ns, message.seq, message.n_triangles


def _other(models: Models) -> tuple[float, float, float]:
    """The wrench by the model that is not in use."""
    if models.model == "dynamic":
        return triple((models.static_f_z_n, models.static_m_x_nm, models.static_m_y_nm))
    return triple((models.dynamic_f_z_n, models.dynamic_m_x_nm, models.dynamic_m_y_nm))


def _text(kind: str, said: Mapping[str, Any]) -> str:
    """The words of one kind, which is the first of `kind`'s own; an event's kind is its `what`."""
    what = {"what": said["kind"]} if "kind" in said else {}
    return json.dumps({**said, **what, "kind": kind.partition(" ")[0]}, ensure_ascii=False)
