"""Recordings started on the page: the published cycles with a person's markers, in a new folder."""

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
    """Makes one recording at a time; each is a new folder in `folder`, named by the time.

    It calls `report` with a line on the progress, from its own thread: once a second and at the end.
    """

    def __init__(self, client: Client, folder: Path, report: Callable[[str], None]) -> None:
        self._client, self._folder, self._report = client, folder, report
        self._lock = threading.Lock()
        self._running: _Running | None = None

    @property
    def running(self) -> bool:
        """Whether a recording is running."""
        return self._running is not None and not self._running.over

    def start(self, feet: list[str]) -> str:
        """Start a recording and return its folder; InsoleError if it cannot be written or one is running."""
        with self._lock:
            if self.running:
                raise InsoleError("a recording is being made: end it first")
            out = self._folder / datetime.now().strftime("%Y%m%d-%H%M%S")
            recorder = LiveRecorder(out, "free", [insole_in_use(self._client, foot) for foot in feet], 0, None)
            self._running = _Running(recorder, self._client.raws(), self._report, out)
            return str(out)

    def stop(self) -> str:
        """End the recording and return its summary; InsoleError if none is running."""
        with self._lock:
            if self._running is None or not self.running:
                raise InsoleError(self._running.message if self._running is not None else "nothing is being recorded")
            self._running.stop()
            message, self._running = self._running.message, None
            return message

    def mark(self, text: str) -> bool:
        """Add a marker at this moment; return False if no recording is running."""
        with self._lock:
            if self._running is None or not self.running:
                return False
            self._running.recorder.mark(time.time_ns(), text)
            return True


class _Running:
    """One recording in a thread; `message` is its progress, `over` is True when it has ended, also by itself."""

    def __init__(
        self, recorder: LiveRecorder, raws: Subscription[Raw], report: Callable[[str], None], out: Path
    ) -> None:
        self.recorder, self.message, self.over = recorder, "", False
        self._raws, self._report, self._out = raws, report, out
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="recording")
        self._thread.start()

    def stop(self) -> None:
        """End the recording and wait for its thread."""
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        session = Session(self.recorder, self._stop, report_progress=self._count)
        try:
            progress = session.from_daemon(self._raws)
            self.recorder.close()
            self._count(progress)
            self.message += f"; insole report {self._out}"
        except InsoleError as error:
            self.message = f"the recording has ended: {error}"
        finally:
            self._raws.close()
            self.over = True
        self._report(self.message)

    def _count(self, progress: Progress) -> None:
        self.message = f"{self._out}: {progress.seconds:.0f} s, {progress.bytes / 1e6:.1f} MB" + "".join(
            f"; {foot} {quality.sentence}" for foot, quality in progress.quality.items()
        )
        self._report(self.message)
