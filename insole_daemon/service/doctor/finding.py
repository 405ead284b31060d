"""What the doctor says of one thing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True)
class CheckResult:
    """One thing that was looked at; `remedy` is a command or a line of a configuration."""

    level: Literal["ok", "warning", "problem"]  # problem: it does not work so; warning: it works, and a person may mind
    subject: str
    text: str
    remedy: str = ""


def ok(subject: str, text: str) -> CheckResult:
    """As it should be."""
    return CheckResult("ok", subject, text)


def warning(subject: str, text: str, remedy: str = "") -> CheckResult:
    """It works, and a person may mind."""
    return CheckResult("warning", subject, text, remedy)


def problem(subject: str, text: str, remedy: str) -> CheckResult:
    """It does not work so."""
    return CheckResult("problem", subject, text, remedy)
