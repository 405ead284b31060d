"""docs/subscribers.md names all examples, and what it links to is there."""

from __future__ import annotations

import re

from processes import EXAMPLES, ROOT

PAGE = ROOT / "docs" / "subscribers.md"


def test_every_example_is_on_the_page_and_every_link_leads_somewhere():
    links = re.findall(r"\]\((?!https?:)([^)#]*)", PAGE.read_text())
    assert all((PAGE.parent / link).exists() for link in links)
    assert {f"examples/{file.name}" for file in EXAMPLES.iterdir() if file.is_file()} <= set(links)
