"""Recording from the page: the cycles that the daemon publishes, into a new folder, with a person's markers."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

from ..errors import InsoleError
from ..recording.daemon_insole import insole_in_use
from ..recording.live import LiveRecorder
from ..recording.recorder import Progress, Session
from ..wire.client import Client, Subscription
from ..wire.messages import Raw


class PageRecorder:
    """At most one at a time; each begins a folder named by the time, in `folder`.

    `tell` is called with a line on how it goes, from a thread of its own: once a second, and when it is over.
    """

    def __init__(self, client: Client, folder: Path, tell: Callable[[str], None]) -> None:
        self._client, self._folder, self._tell = client, folder, tell
        self._lock = threading.Lock()
        self._running: _Running | None = None

    @property
    def running(self) -> bool:
        """Whether one is being made."""
        return self._running is not None and not self._running.over

    def start(self, feet: list[str]) -> str:
        """Begin; where it is written. Raises InsoleError where it cannot be, or one is running."""
        with self._lock:
            if self.running:
                raise InsoleError("a recording is being made: end it first")
            out = self._folder / datetime.now().strftime("%Y%m%d-%H%M%S")
            recorder = LiveRecorder(out, "free", [insole_in_use(self._client, foot) for foot in feet], 0, None)
            self._running = _Running(recorder, self._client.raws(), self._tell, out)
            return str(out)

    def stop(self) -> str:
        """End it; what there is of it. Raises InsoleError where nothing is being recorded."""
        with self._lock:
            if self._running is None or not self.running:
                raise InsoleError(self._running.said if self._running is not None else "nothing is being recorded")
            self._running.stop()
            said, self._running = self._running.said, None
            return said

    def mark(self, text: str) -> bool:
        """Note this moment; False where nothing is being recorded."""
        with self._lock:
            if self._running is None or not self.running:
                return False
            self._running.recorder.mark(time.time_ns(), text)
            return True


class _Running:
    """One recording, in a thread; `said` is how it goes, and `over` that it has ended, also by itself."""

    def __init__(self, recorder: LiveRecorder, raws: Subscription[Raw], tell: Callable[[str], None], out: Path) -> None:
        self.recorder, self.said, self.over = recorder, "", False
        self._raws, self._tell, self._out = raws, tell, out
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="recording")
        self._thread.start()

    def stop(self) -> None:
        """End it and wait for that."""
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        session = Session(self.recorder, self._stop, report_progress=self._count)
        try:
            progress = session.from_daemon(self._raws)
            self.recorder.close()
            self._count(progress)
            self.said += f"; insole report {self._out}"
        except InsoleError as error:
            self.said = f"the recording has ended: {error}"
        finally:
            self._raws.close()
            self.over = True
        self._tell(self.said)

    def _count(self, progress: Progress) -> None:
        self.said = f"{self._out}: {progress.seconds:.0f} s, {progress.bytes / 1e6:.1f} MB" + "".join(
            f"; {foot} {quality.sentence}" for foot, quality in progress.quality.items()
        )
        self._tell(self.said)
