"""The page as a whole: page one, then the reviewer's."""

from __future__ import annotations

from ...report import page
from ..diagnosing import Diagnosis
from ..places import said, where
from . import chance, first_page, numbers, physics
from .untouched import Untouched, untouched

MOST_GROUPS = 4  # that are drawn; all stand in the tables


def html(diagnosis: Diagnosis) -> str:
    """One file, complete in itself."""
    names = ", ".join(diagnosis.insole.recordings)
    title = f"Diagnosis of the {diagnosis.insole.foot} insole"
    return page.page(title, f"{first_page.verdict(diagnosis)} Recorded in {names}.", parts(diagnosis))


def parts(diagnosis: Diagnosis) -> list[str]:
    """Its sections."""
    seen = untouched(diagnosis)
    found = [first_page.facts(diagnosis), page.section("What was found", first_page.findings(diagnosis))]
    found.append(page.section("Where", first_page.maps(diagnosis)))
    found.append(page.section("Before and after, on data it had not seen", *_first(diagnosis, seen)))
    found.append(page.section("What these recordings cannot tell", numbers.limits(diagnosis)))
    for each in seen[:MOST_GROUPS]:
        found.append(page.section(f"The physics: {_place(diagnosis, each)}", *_physics(diagnosis, each)))
    found.append(page.section("Could it be chance?", chance.shown(chance.of(diagnosis, seen[0]), seen[0])))
    tables = [numbers.tried(diagnosis, each.named) for each in seen if each.named is not None]
    found.append(page.section("What was tried, and lost by how much", numbers.price(), *tables))
    found.append(page.section("Decoys", numbers.decoys(diagnosis)))
    if len(diagnosis.insole.recordings) > 1 and diagnosis.located.named:
        found.append(page.section("Recording by recording", numbers.recordings(diagnosis)))
    related = [numbers.correlations(seen[0].named)] if seen[0].named is not None else []
    found.append(page.section("Parameters", numbers.parameters(diagnosis), *related))
    found.append(page.section("Clocks", numbers.clocks(diagnosis)))
    found.append(page.section("Readings: noise and faults", numbers.audit(diagnosis)))
    return found


def _first(diagnosis: Diagnosis, seen: list[Untouched]) -> list[str]:
    """Of the greatest mismatch."""
    first = seen[0]
    if first.named is None:
        return [page.row(first_page.trace(first))]
    return [
        page.paragraph(f"Of {_place(diagnosis, first)}, where the mismatch is greatest."),
        page.row(first_page.trace(first)),
        page.row(first_page.staircase(diagnosis.insole, first.named)),
    ]


def _physics(diagnosis: Diagnosis, each: Untouched) -> list[str]:
    return [physics.loops(each), physics.regimes(each, diagnosis.observed)]


def _place(diagnosis: Diagnosis, each: Untouched) -> str:
    if each.named is None:
        return "all taxels"
    insole = diagnosis.insole
    return said(where(each.named.group.slots, insole.slots, insole.layout))
