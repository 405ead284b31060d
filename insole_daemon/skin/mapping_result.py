"""The result of a mapping: a layout for each foot, and the problems to report."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping as Map
from collections.abc import Sequence

from .layout import Foot, Layout, assigned
from .mapping import Identity, PositionResult


def layout_of(template: Layout, results: Sequence[PositionResult]) -> Layout | None:
    """Return `template` with the responding boards and triangles, without positions in doubt; None if none remain.

    Place, rotation and mirroring are those of the template: a press identifies the triangle, not its orientation.
    """
    triangles = tuple(
        dataclasses.replace(
            template.triangles[result.position.row], board=result.identity[0], triangle=result.identity[1]
        )
        for result in results
        if result.position.foot == template.foot and result.state == "answered" and result.identity is not None
    )
    return assigned(template, triangles) if triangles else None


def summary(
    results: Sequence[PositionResult], owners: Map[int, Foot], streaming: Sequence[Identity], faulty: Sequence[Identity]
) -> list[str]:
    """Return every problem as a sentence; `owners` is the configured foot of every board.

    `streaming`: the triangles that sent anything; `faulty`: those of them that report an open or dead sensor.
    """
    lines = []
    for result in results:
        if result.state == "missing":
            lines.append(f"missing: {result.position}: nothing answered; is its triangle enabled, and connected?")
        elif result.state == "unclear":
            lines.append(f"in doubt: {result.position}: two answered every time")
    reported: set[Identity] = set()
    for result in results:
        if result.state == "doubled" and result.identity is not None and result.identity not in reported:
            reported.add(result.identity)
            where = "; ".join(map(str, (result.position, *result.rivals)))
            lines.append(
                f"doubled: {_name(result.identity)} answers at {where}: "
                "left out there; look for two triangles with one address"
            )
    lines += _swapped(results, owners)
    answered = {result.identity for result in results if result.identity is not None}
    if faulty:
        lines.append(f"open or dead by their own report: {_names(faulty)}")
    idle = sorted(set(streaming) - answered - set(faulty))
    if idle:
        lines.append(f"streaming, but found at no position: {_names(idle)}")
    return lines


def _swapped(results: Sequence[PositionResult], owners: Map[int, Foot]) -> list[str]:
    """Return sentences on boards that lie in another foot than the configured one."""
    feet: dict[int, list[Foot]] = {}
    for result in results:
        if result.identity is not None:
            feet.setdefault(result.identity[0], []).append(result.position.foot)
    lines = []
    for board, placed_in in sorted(feet.items()):
        owner = owners.get(board)
        wrong = sorted({foot for foot in placed_in if foot != owner})
        if owner is None:
            feet_of_it = " and the ".join(wrong)
            lines.append(f"unknown: board {board} lies in the {feet_of_it} foot: add it to the boards there")
        elif wrong and owner not in placed_in:
            lines.append(
                f"swapped: board {board} lies in the {wrong[0]} foot, the configuration gives it to the {owner} foot: "
                "move it there in the configuration, or plug the insoles the other way round"
            )
        elif wrong:
            n = len(placed_in) - placed_in.count(owner)
            lines.append(
                f"swapped: board {board} of the {owner} foot answered at {len(placed_in)} positions, {n} of them "
                f"in the {wrong[0]} foot: was the other foot pressed, or is a patch plugged into the wrong board?"
            )
    return lines


def _name(identity: Identity) -> str:
    return f"board {identity[0]} triangle {identity[1]}"


def _names(identities: Sequence[Identity]) -> str:
    return ", ".join(map(_name, sorted(identities)))
