"""The actions that the page permits: zero, mark, record, read the boards' temperatures."""

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
    """Performs the action that a viewer's message requests, and returns the reply."""

    def __init__(self, client: Client, hub: Hub, recording: PageRecorder) -> None:
        self._client, self._hub, self._recording = client, hub, recording

    async def reply(self, text: str) -> dict[str, Any]:
        """Return the reply to a message: its `number`, `ok` whether it was done, and `said`, the result or reason.

        Raises ValueError if the page never sends such a message.
        """
        message = parse_json(text)
        if not isinstance(message, dict) or not isinstance(message.get("number"), int):
            raise ValueError(f"expected a map with a number, found {quoted(text)}")
        do, foot, words = message.get("do"), message.get("foot", ""), message.get("text", "")
        if do in ("zero", "temperature") and foot not in _FEET:
            raise ValueError(f"expected a foot, found {quoted(foot)}")
        if not isinstance(words, str) or len(words) > _TEXT_LENGTH or not words.isprintable():
            raise ValueError(f"expected a printable text of at most {_TEXT_LENGTH} characters, found {quoted(words)}")
        try:
            match do:
                case "zero":
                    result = await self._request(foot, "zero", seconds=_ZERO_S, force=False)
                case "temperature":
                    result = await self._request(foot, "boards", do="temperature")
                case "mark":
                    result = {"recorded": await asyncio.to_thread(self._recording.mark, words)}
                    self._hub.publish_event("mark", {"t_ns": time.time_ns(), "text": words, **result})
                case "record":
                    result = {"folder": await asyncio.to_thread(self._recording.start, self._hub.feet)}
                case "stop":
                    result = {"text": await asyncio.to_thread(self._recording.stop)}
                case _:
                    raise ValueError(f"expected zero, temperature, mark, record or stop, found {quoted(do)}")
        except InsoleError as error:
            return {"number": message["number"], "ok": False, "said": {"text": str(error)}}
        if do in ("record", "stop"):
            self.publish_recording_state(result.get("text", ""))
        return {"number": message["number"], "ok": bool(result.get("ok", True)), "said": result}

    def publish_recording_state(self, text: str) -> None:
        """Send the state of the recording to all viewers."""
        self._hub.publish_latched("recording", {"running": self._recording.running, "text": text})

    async def _request(self, foot: Any, verb: str, **arguments: Any) -> dict[str, Any]:
        return await asyncio.to_thread(self._client.request, foot, verb, **arguments)
