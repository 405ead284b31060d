"""`insole doctor`: list setup problems and how to fix each."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import typer

from .options import ConfigFile, name_next
from .tables import fold

if TYPE_CHECKING:
    from ..service.doctor import CheckResult

_SUBJECT = 18  # characters


def doctor(config: ConfigFile = None) -> None:
    """List setup problems and how to fix each.

    Checks kernel, interfaces, Zenoh, clock and files, and the boards through the running daemon; changes nothing.
    Each finding is ok, a warning or a problem; the latter two have a remedy. Exit status 1: there is a problem.
    """
    from ..service.doctor import examine

    levels: list[str] = []
    runs = False
    for finding in examine(config):
        sys.stdout.write(finding_lines(finding))
        sys.stdout.flush()
        levels.append(finding.level)
        runs |= finding.subject == "daemon" and finding.level == "ok"
    problems, warnings = levels.count("problem"), levels.count("warning")
    print(f"{problems} problem{'s' * (problems != 1)}, {warnings} warning{'s' * (warnings != 1)}")
    sys.stdout.flush()
    if problems:
        name_next("the remedies after the arrows, from the top; then insole doctor")
        raise typer.Exit(1)
    name_next("insole status" if runs else f"insole run{f' --config {config}' if config else ''}")


def finding_lines(finding: CheckResult) -> str:
    """Format a finding and its remedy for the terminal."""
    indent = 8 + 1 + _SUBJECT + 1
    lines = fold(f"{finding.level:<8} {finding.subject:<{_SUBJECT}} {finding.text}", indent) + "\n"
    if finding.remedy:  # on one line, so that it can be copied
        lines += f"{'→ ':>{indent + 2}}{finding.remedy}\n"
    return lines
