"""Messages about faults: what happened, which area is lost, what to do."""

from __future__ import annotations

from ..geometry import PRESSURE_TAXELS
from ..layout import Layout

_OF_A_BOARD = {
    "board_silent": ("sends nothing", "look at its power and its CAN connector"),
    "board_reset": (
        "was silent and sends again, so it restarted or was unplugged: its readings are used, nothing is left out",
        "look at its power, and zero the insole while nobody stands on it",
    ),
    "board_address_clash": (
        "sends about twice as often as it should, so two boards use this address",
        "give one of them another address, or, if there is only one, correct its period in the configuration",
    ),
    "board_rezeroed": (
        "took a new zero while it was loaded, and is wrong by that load until it is zeroed again",
        "lift the foot and zero the insole",
    ),
}
_OF_A_TAXEL = {
    "taxel_dead": ("does not respond to load", "if more follow on this triangle, replace it"),
    "taxel_stuck": ("is constant while its neighbours change", "if more follow on this triangle, replace it"),
    "taxel_saturated": (
        "reads the end of its range",
        "if it stays there without load, zero the insole; if it comes with the load, raise the board's shift",
    ),
}
_HEALED = {
    "board_silent": "sends again",
    "board_reset": "has sent steadily since it came back",
    "board_address_clash": "is alone on its address again",
    "board_rezeroed": "reads its unloaded levels again and is used",
    "triangle_loose": "is connected again",
    "taxel_dead": "responds again",
    "taxel_stuck": "changes again",
    "taxel_saturated": "is back in its range",
}


def describe_fault(
    layout: Layout,
    kind: str,
    board: int,
    triangle: int | None,
    taxel: int | None,
    began: bool,
    lasted_s: float | None,
) -> str:
    """Return one sentence on a fault that began, or ended after `lasted_s`; None if its beginning was not reported."""
    subject = f"board {board}"
    if triangle is not None:
        subject += f" triangle {triangle}"
    if taxel is not None:
        subject += f" taxel {taxel}"
    if not began:
        return f"{subject} {_HEALED[kind]}, after {lasted_s:.1f} s" if lasted_s is not None else f"{subject} sends"
    of_a_triangle = int(PRESSURE_TAXELS.sum())
    of_all = 100.0 / (of_a_triangle * len(layout))  # per cent of the area that one taxel stands for
    if taxel is not None:
        problem, remedy = _OF_A_TAXEL[kind]
        return f"{subject} {problem}: it is left out, {of_all:.1f} % of the area; {remedy}"
    if triangle is not None:
        return (
            f"{subject} came loose: its {of_a_triangle} taxels are left out, {of_a_triangle * of_all:.1f} % of the "
            "area; check its connector"
        )
    problem, remedy = _OF_A_BOARD[kind]
    if kind == "board_reset":
        return f"{subject} {problem}; {remedy}"
    taxels = of_a_triangle * sum(t.board == board for t in layout.triangles)
    return f"{subject} {problem}: its {taxels} taxels are left out, {taxels * of_all:.1f} % of the area; {remedy}"
