"""The result of one check of the doctor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True)
class CheckResult:
    """The result of one check; `remedy` is a command or a line of a configuration."""

    level: Literal["ok", "warning", "problem"]  # problem: does not work; warning: works with a limitation
    subject: str
    text: str
    remedy: str = ""


def ok(subject: str, text: str) -> CheckResult:
    """Return a result without a defect."""
    return CheckResult("ok", subject, text)


def warning(subject: str, text: str, remedy: str = "") -> CheckResult:
    """Return a result for something that works with a limitation."""
    return CheckResult("warning", subject, text, remedy)


def problem(subject: str, text: str, remedy: str) -> CheckResult:
    """Return a result for something that does not work."""
    return CheckResult("problem", subject, text, remedy)
