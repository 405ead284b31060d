"""Every relative link of the documents leads to a file, and to a heading where it names one; the README stays short."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("docs", "protocol", "benchmarks", "systemd", "locks", "tests")
DOCUMENTS = sorted([*ROOT.glob("*.md"), *(path for folder in FOLDERS for path in (ROOT / folder).rglob("*.md"))])


def anchors(document: Path) -> set[str]:
    """The anchors of the headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", document.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_link_leads_somewhere(document: Path) -> None:
    broken = []
    for link in re.findall(r"\]\(([^)\s]+)\)", document.read_text()):
        if link.startswith(("http://", "https://", "mailto:")):
            continue
        path, _, anchor = link.partition("#")
        target = (document.parent / path).resolve() if path else document
        if not target.exists() or (anchor and target.suffix == ".md" and anchor not in anchors(target)):
            broken.append(link)
    assert broken == []


def test_every_document_is_in_the_index_or_behind_one_of_its_pages() -> None:
    """A page that nothing links to is never read."""
    linked = {ROOT / "README.md"}
    waiting = [ROOT / "README.md", ROOT / "docs" / "README.md"]
    while waiting:
        document = waiting.pop()
        linked.add(document)
        for link in re.findall(r"\]\(([^)\s#]+)", document.read_text()):
            target = (document.parent / link).resolve()
            if target.suffix == ".md" and target.exists() and target not in linked:
                waiting.append(target)
    unlinked = {path for path in DOCUMENTS if path.is_relative_to(ROOT / "docs")} - linked
    assert sorted(str(path.relative_to(ROOT)) for path in unlinked) == []


def test_the_readme_is_a_page() -> None:
    lines = (ROOT / "README.md").read_text().splitlines()
    assert len(lines) <= 90
    assert any(line.startswith("![") for line in lines[:15]), "the picture is within the first screen"
