"""docs/effects.md lists the laws and parameters of the code."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from insole_daemon.config import Config
from insole_daemon.physics.effects import laws
from insole_daemon.physics.effects_document import load
from insole_daemon.physics.law import SCOPES
from insole_daemon.service.foot_setup import load_layout

PAGE = Path(__file__).parents[3] / "docs" / "effects.md"


def rows() -> Iterator[str]:
    """Return the lines of both tables without their headers."""
    for law in laws().values():
        order = "–" if law.order is None else law.order
        where = "" if law.scopes == SCOPES else " ".join(law.scopes)
        yield f"| {order} | `{law.word}` | {cell(law.equation)} | {where} |"
    for law in laws().values():
        for parameter in law.parameters:
            size = "" if parameter.size == "one" else f", a {parameter.size}"
            (low, high), (least, most) = (parameter.low, parameter.high), parameter.prior
            yield (
                f"| `{law.word}` | `{parameter.name}`{size} | {parameter.unit} | {low:g} to {high:g} "
                f"| {least:g} to {most:g} | {cell(parameter.meaning)} |"
            )


def cell(text: str) -> str:
    return text.replace("|", "\\|")


def test_the_page_has_a_row_for_every_law_and_parameter() -> None:
    lines = PAGE.read_text().splitlines()
    missing = [row for row in rows() if row not in lines]
    assert not missing, "docs/effects.md lacks:\n" + "\n".join(missing)


def test_the_example_of_the_page_is_a_valid_file(tmp_path: Path) -> None:
    example = tmp_path / "effects.yaml"
    example.write_text(PAGE.read_text().partition("```yaml\n")[2].partition("```")[0])
    layout = load_layout(Config().insoles[0])
    assert [effect.law.word for effect in load(example, layout)] == ["creep", "lag"]
