"""The report of a bring-up: one text file that a person can read and send."""

from __future__ import annotations

import platform
import time
from collections.abc import Sequence
from dataclasses import dataclass, field

from .. import __version__
from ..service.doctor.finding import CheckResult

STEPS = ("bus", "boards", "mapping", "zero", "recording", "force")


@dataclass(slots=True)
class Report:
    """The findings of each step; a step that was not done has a note with the reason."""

    configuration: str  # the text of config.yaml, or that it is the built-in one
    findings: dict[str, list[CheckResult]] = field(default_factory=dict)
    notes: dict[str, str] = field(default_factory=dict)

    def add(self, step: str, findings: Sequence[CheckResult], note: str = "") -> None:
        """Add the findings of `step`."""
        self.findings[step] = [*self.findings.get(step, []), *findings]
        if note:
            self.notes[step] = note

    @property
    def problems(self) -> list[CheckResult]:
        """All findings that are problems."""
        return [finding for findings in self.findings.values() for finding in findings if finding.level == "problem"]

    def text(self) -> str:
        """Return the whole report as Markdown."""
        n = len(self.problems)
        where = f"insole-daemon {__version__}, Python {platform.python_version()}, {platform.platform()}"
        lines = [
            "# Bring-up of an insole",
            "",
            f"{time.strftime('%Y-%m-%d %H:%M:%S %z')}, {where}",
            "",
            f"**{n} problem{'s' * (n != 1)}.**" + (" What to change:" if n else ""),
            "",
        ]
        lines += [
            f"{number}. {finding.subject}: {finding.text}\n   {finding.remedy}"
            for number, finding in enumerate(self.problems, start=1)
        ]
        for step in STEPS:
            lines += ["", f"## {step.capitalize()}", ""]
            if step in self.notes:
                lines.append(self.notes[step])
            elif step not in self.findings:
                lines.append("Not done.")
            elif not self.findings[step]:
                lines.append("Nothing to check here: see the boards.")
            for finding in self.findings.get(step, []):
                lines.append(
                    f"- {finding.level}: {finding.subject}: {finding.text}"
                    + (f" → {finding.remedy}" if finding.remedy else "")
                )
        return "\n".join([*lines, "", "## Configuration", "", "```yaml", self.configuration.rstrip(), "```", ""])
