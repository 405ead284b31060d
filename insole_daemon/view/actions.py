"""What a person may do from the page, and nothing else: zero, mark, record, read the boards' temperatures."""

from __future__ import annotations

import asyncio
import time
from typing import Any

from ..errors import InsoleError
from ..untrusted import parse_json, quoted
from ..wire.client import Client
from .hub import Hub
from .recording import PageRecorder

_FEET = ("left", "right")
_TEXT_LENGTH = 200
_ZERO_S = 3.0


class Actions:
    """Does what a viewer's message asks for, and says what came of it."""

    def __init__(self, client: Client, hub: Hub, recording: PageRecorder) -> None:
        self._client, self._hub, self._recording = client, hub, recording

    async def reply(self, text: str) -> dict[str, Any]:
        """What to answer to a message: `number` is the message's own, `ok` whether it was done, `said` why not or what.

        Raises ValueError where it is none of those the page sends.
        """
        asked = parse_json(text)
        if not isinstance(asked, dict) or not isinstance(asked.get("number"), int):
            raise ValueError(f"expected a map with a number, found {quoted(text)}")
        do, foot, words = asked.get("do"), asked.get("foot", ""), asked.get("text", "")
        if do in ("zero", "temperature") and foot not in _FEET:
            raise ValueError(f"expected a foot, found {quoted(foot)}")
        if not isinstance(words, str) or len(words) > _TEXT_LENGTH or not words.isprintable():
            raise ValueError(f"expected a printable text of at most {_TEXT_LENGTH} characters, found {quoted(words)}")
        try:
            match do:
                case "zero":
                    said = await self._request(foot, "zero", seconds=_ZERO_S, force=False)
                case "temperature":
                    said = await self._request(foot, "boards", do="temperature")
                case "mark":
                    said = {"recorded": await asyncio.to_thread(self._recording.mark, words)}
                    self._hub.tell("mark", {"t_ns": time.time_ns(), "text": words, **said})
                case "record":
                    said = {"folder": await asyncio.to_thread(self._recording.start, self._hub.feet)}
                case "stop":
                    said = {"text": await asyncio.to_thread(self._recording.stop)}
                case _:
                    raise ValueError(f"expected zero, temperature, mark, record or stop, found {quoted(do)}")
        except InsoleError as error:
            return {"number": asked["number"], "ok": False, "said": {"text": str(error)}}
        if do in ("record", "stop"):
            self.tell_recording(said.get("text", ""))
        return {"number": asked["number"], "ok": bool(said.get("ok", True)), "said": said}

    def tell_recording(self, text: str) -> None:
        """Have all viewers see how the recording goes."""
        self._hub.stand("recording", {"running": self._recording.running, "text": text})

    async def _request(self, foot: Any, verb: str, **arguments: Any) -> dict[str, Any]:
        return await asyncio.to_thread(self._client.request, foot, verb, **arguments)
