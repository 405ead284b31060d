"""The exception hierarchy.

    InsoleError                an error that a person can act on
    ├── DocumentError          a file that a person or a program wrote: config, layout, calibration
    ├── DocumentsError         several such files
    │   └── RecordingError     those of a recording
    ├── FileError              a file that is not as expected, or cannot be written
    ├── LogError               a candump log that cannot be read
    ├── BusError               a CAN interface that cannot be opened or read
    ├── EffectError            an effect without an inverse, or with parameters that its law does not allow
    ├── CalibrationError       data that do not determine a calibration
    ├── SimulationError        a request that the simulator or its boards cannot fulfil
    ├── DiagnosisError         recordings that cannot be diagnosed together, or lack data that a diagnosis needs
    │   └── UndecidableError   valid recordings with too little data
    └── WireError              Zenoh: an endpoint that is in use, a missing daemon, an invalid message

Every message says what was expected, what was found, where, and what to do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal


class InsoleError(Exception):
    """Root of the hierarchy; `exit_status` is the exit status of a command that ends with this error."""

    exit_status = 3


@dataclass(frozen=True, slots=True)
class Problem:
    """One problem of a document: its place, and what was expected and found there."""

    line: int | None  # 1-based; None if the document has no lines
    key: str  # path of the key, as "insoles[0].boards[2].address"; empty: the whole file or folder
    message: str  # what was expected, what was found, what to do

    def __str__(self) -> str:
        where = [f"line {self.line}"] * bool(self.line) + [self.key] * bool(self.key)
        return ": ".join([*where, self.message])


class DocumentError(InsoleError):
    """A file is refused; `problems` lists all its problems."""

    exit_status = 4

    def __init__(self, path: str, problems: Sequence[Problem]) -> None:
        self.path = path
        self.problems = tuple(problems)
        super().__init__("\n".join(f"{path}: {problem}" for problem in problems))


class DocumentsError(InsoleError):
    """Several files are refused; `errors` are those of each."""

    exit_status = 4

    def __init__(self, errors: Sequence[InsoleError]) -> None:
        self.errors = tuple(errors)
        super().__init__("\n".join(map(str, errors)))


class FileError(InsoleError):
    """A file or a folder is not as expected, or cannot be written."""

    exit_status = 4


class RecordingError(DocumentsError):
    """A recording is refused; `errors` are those of all its files."""


class LogError(InsoleError):
    """A candump log cannot be read: the message names the file, the line and what was expected there."""

    exit_status = 4


class EffectError(InsoleError):
    """An effect has no inverse, has parameters that its law does not allow, or lacks data that it needs."""


class CalibrationError(InsoleError):
    """The data do not determine the calibration: the message names what is missing or inconsistent."""

    exit_status = 4


class SimulationError(InsoleError):
    """The simulator or its boards cannot fulfil a request."""

    exit_status = 2


class DiagnosisError(InsoleError):
    """Recordings that cannot be diagnosed, together or at all."""

    exit_status = 4


class UndecidableError(DiagnosisError):
    """The recordings are valid, but contain too little data for a diagnosis."""

    exit_status = 3


class BusError(InsoleError):
    """A CAN interface cannot be opened, read or written.

    `state` is the state of the interface; with `permanent`, another attempt cannot succeed while this process runs.
    """

    def __init__(self, message: str, state: Literal["down", "missing"] = "down", permanent: bool = False) -> None:
        super().__init__(message)
        self.state: Literal["down", "missing"] = state
        self.permanent = permanent


class WireError(InsoleError):
    """Zenoh cannot fulfil a request, or a message does not follow its schema."""
