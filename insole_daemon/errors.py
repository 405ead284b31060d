"""The one tree of errors.

    InsoleError                something a person can act on
    ├── DocumentError          a file that a person or a program wrote: config, layout, calibration
    ├── DocumentsError         several of them, everything at once
    │   └── RecordingError     those of a recording
    ├── FileError              a file that is not what it should be, or cannot be written
    ├── LogError               a candump log that cannot be read
    ├── BusError               a CAN interface that cannot be opened or read
    ├── EffectError            an effect that cannot do what it is asked to, or is not what its law allows
    ├── CalibrationError       data that cannot determine what is asked of them
    ├── SimulationError        something is asked of the simulator that it does not have, or its boards cannot carry
    ├── DiagnosisError         recordings that cannot be diagnosed together, or do not hold what a diagnosis needs
    │   └── UndecidableError   in order, but too little
    └── WireError              Zenoh: an endpoint that is taken, a daemon that is not there, a bad message

Every message says what was expected, what was found, where, and what to do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal


class InsoleError(Exception):
    """Root of the tree; `exit_status` is what a command ends with when it stops on this error."""

    exit_status = 3


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing that is wrong in a document: where it stands, and what was expected and found there."""

    line: int | None  # 1-based; None where the document has no lines to speak of
    key: str  # path of the key, as "insoles[0].boards[2].address"; empty: the whole file or folder
    message: str  # what was expected, what was found, what to do

    def __str__(self) -> str:
        where = [f"line {self.line}"] * bool(self.line) + [self.key] * bool(self.key)
        return ": ".join([*where, self.message])


class DocumentError(InsoleError):
    """A file is refused; `problems` lists everything that is wrong with it, all at once."""

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
    """A file or a folder is not what it should be, or cannot be written."""

    exit_status = 4


class RecordingError(DocumentsError):
    """A recording is refused; `errors` are those of all its files."""


class LogError(InsoleError):
    """A candump log cannot be read: the message names the file, the line and what was expected there."""

    exit_status = 4


class EffectError(InsoleError):
    """An effect has no inverse, is not what its law allows, or lacks something that it needs."""


class CalibrationError(InsoleError):
    """The data cannot determine what is asked of them: the message names what is missing, or does not fit."""

    exit_status = 4


class SimulationError(InsoleError):
    """The simulator is asked for something it does not have, or its boards cannot carry."""

    exit_status = 2


class DiagnosisError(InsoleError):
    """Recordings that cannot be diagnosed, together or at all."""

    exit_status = 4


class UndecidableError(DiagnosisError):
    """Recordings that are in order, but hold too little to tell anything from."""

    exit_status = 3


class BusError(InsoleError):
    """A CAN interface cannot be opened, read or written.

    `state` is the state it is in then; `permanent` says that trying again cannot help while this process runs.
    """

    def __init__(self, message: str, state: Literal["down", "missing"] = "down", permanent: bool = False) -> None:
        super().__init__(message)
        self.state: Literal["down", "missing"] = state
        self.permanent = permanent


class WireError(InsoleError):
    """Zenoh cannot do what was asked, or a message is not what its schema says."""
