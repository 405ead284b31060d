"""What a mapping amounts to: a layout a foot, and what a person must know about it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping as Map
from collections.abc import Sequence

from .layout import Foot, Layout, assigned
from .mapping import Found, Identity


def layout_of(template: Layout, found: Sequence[Found]) -> Layout | None:
    """`template` with the boards and triangles that answered, without the positions in doubt; None: none is left.

    Place, rotation and mirroring of every position are the template's: a press says who lies there, not how.
    """
    triangles = tuple(
        dataclasses.replace(template.triangles[each.position.row], board=each.identity[0], triangle=each.identity[1])
        for each in found
        if each.position.foot == template.foot and each.state == "answered" and each.identity is not None
    )
    return assigned(template, triangles) if triangles else None


def summary(
    found: Sequence[Found], owners: Map[int, Foot], streaming: Sequence[Identity], faulty: Sequence[Identity]
) -> list[str]:
    """Everything that is not as it should be, a sentence each; `owners`: the configured foot of every board.

    `streaming`: the triangles that sent anything; `faulty`: those of them that report an open or dead sensor.
    """
    lines = []
    for each in found:
        if each.state == "missing":
            lines.append(f"missing: {each.position}: nothing answered; is its triangle enabled, and connected?")
        elif each.state == "unclear":
            lines.append(f"in doubt: {each.position}: two answered every time")
    told: set[Identity] = set()
    for each in found:
        if each.state == "doubled" and each.identity is not None and each.identity not in told:
            told.add(each.identity)
            where = "; ".join(map(str, (each.position, *each.rivals)))
            lines.append(
                f"doubled: {_name(each.identity)} answers at {where}: "
                "left out there; look for two triangles with one address"
            )
    lines += _swapped(found, owners)
    answered = {each.identity for each in found if each.identity is not None}
    if faulty:
        lines.append(f"open or dead by their own report: {_names(faulty)}")
    idle = sorted(set(streaming) - answered - set(faulty))
    if idle:
        lines.append(f"streaming, but found at no position: {_names(idle)}")
    return lines


def _swapped(found: Sequence[Found], owners: Map[int, Foot]) -> list[str]:
    """Boards that lie in another foot than the configuration says."""
    feet: dict[int, list[Foot]] = {}
    for each in found:
        if each.identity is not None:
            feet.setdefault(each.identity[0], []).append(each.position.foot)
    lines = []
    for board, where in sorted(feet.items()):
        owner = owners.get(board)
        wrong = sorted({foot for foot in where if foot != owner})
        if owner is None:
            feet_of_it = " and the ".join(wrong)
            lines.append(f"unknown: board {board} lies in the {feet_of_it} foot: add it to the boards there")
        elif wrong and owner not in where:
            lines.append(
                f"swapped: board {board} lies in the {wrong[0]} foot, the configuration gives it to the {owner} foot: "
                "move it there in the configuration, or plug the insoles the other way round"
            )
        elif wrong:
            n = len(where) - where.count(owner)
            lines.append(
                f"swapped: board {board} of the {owner} foot answered at {len(where)} positions, {n} of them "
                f"in the {wrong[0]} foot: was the other foot pressed, or is a patch plugged into the wrong board?"
            )
    return lines


def _name(identity: Identity) -> str:
    return f"board {identity[0]} triangle {identity[1]}"


def _names(identities: Sequence[Identity]) -> str:
    return ", ".join(map(_name, sorted(identities)))
