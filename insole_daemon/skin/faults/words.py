"""What a fault means to a person: what happened, what it costs, what to do."""

from __future__ import annotations

from ..geometry import PRESSURE_TAXELS
from ..layout import Layout

_OF_A_BOARD = {
    "silent": ("sends nothing any more", "look at its power and its CAN connector"),
    "reset": (
        "was silent and sends again, so it restarted or was unplugged",
        "look at its power, and zero the insole while nobody stands on it",
    ),
    "address_clash": (
        "sends about twice as often as it should, so two boards use this address",
        "give one of them another address, or, if there is only one, correct its period in the configuration",
    ),
    "rezeroed": (
        "took its zero anew while it was loaded, and is wrong by that load until it is zeroed again",
        "lift the foot and zero the insole",
    ),
}
_OF_A_TAXEL = {
    "dead": ("does not answer to load", "if more follow on this triangle, replace it"),
    "stuck": ("stands still while its neighbours move", "if more follow on this triangle, replace it"),
    "saturated": (
        "stands at the end of its range",
        "if it stays there without load, zero the insole; if it comes with the load, raise the board's shift",
    ),
}
_HEALED = {
    "silent": "sends again",
    "reset": "has sent steadily since it came back",
    "address_clash": "is alone on its address again",
    "rezeroed": "stands at its rest levels again and is believed",
    "loose": "is connected again",
    "dead": "answers again",
    "stuck": "moves again",
    "saturated": "is back in its range",
}


def describe(
    layout: Layout, kind: str, board: int, triangle: int | None, taxel: int | None, began: bool, lasted_s: float
) -> str:
    """One sentence on a fault that began, or healed after `lasted_s`."""
    who = f"board {board}"
    if triangle is not None:
        who += f" triangle {triangle}"
    if taxel is not None:
        who += f" taxel {taxel}"
    if not began:
        return f"{who} {_HEALED[kind]}, after {lasted_s:.1f} s"
    pressure = int(PRESSURE_TAXELS.sum())
    of_all = 100.0 / (pressure * len(layout))
    if taxel is not None:
        what, remedy = _OF_A_TAXEL[kind]
        return f"{who} {what}: it is masked, {of_all:.1f} % of the area; {remedy}"
    if triangle is not None:
        return (
            f"{who} came loose: its {pressure} taxels are masked, {pressure * of_all:.1f} % of the area; "
            "check its connector"
        )
    what, remedy = _OF_A_BOARD[kind]
    taxels = pressure * sum(t.board == board for t in layout.triangles)
    cost = "" if kind == "reset" else f": its {taxels} taxels are masked, {taxels * of_all:.1f} % of the area"
    if kind == "silent":
        cost = cost.replace("are masked", "are invalid")
    return f"{who} {what}{cost}; {remedy}"
