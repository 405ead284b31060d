"""The page of a chamber and walks explained together: what is said of both, then each half as it has it by itself."""

from __future__ import annotations

from ...report import page
from ..together import Together
from . import first_page, numbers, report, walk


def html(diagnosis: Together) -> str:
    """One file, complete in itself."""
    counts, force = diagnosis.heldout, diagnosis.heldout["f_z"]
    parts = [
        page.facts(
            (f"{counts['before']:.2f} → {counts['after']:.2f} counts", "error of a reading in the chamber"),
            (f"{counts['floor']:.2f} counts", "its noise"),
            (f"{force['before']:.1f} → {force['after']:.1f} N", "error of the force in the shoe"),
            (f"{force['floor']:.1f} N", "its noise"),
        ),
        page.section("What was found", first_page.findings(diagnosis)),
        page.section("What these recordings cannot tell", numbers.limits(diagnosis)),
        page.section("Parameters", numbers.parameters(diagnosis)),
        page.section("The chamber by itself"),
        *report.parts(diagnosis.chamber),
        page.section("The shoe, with what the chamber shows"),
        *walk.parts(diagnosis.walks),
    ]
    foot = diagnosis.chamber.insole.foot
    lead = f"{first_page.verdict(diagnosis)} Recorded in {', '.join(diagnosis.recordings)}."
    return page.page(f"Diagnosis of the {foot} insole", lead, parts)
