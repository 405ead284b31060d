"""The page with the table, from the rows as they were measured."""

from __future__ import annotations

import os
from typing import Any

from benchmarks.faults.matrix.rows import ROWS

HEAD = """# The fault matrix

Written by `python -m benchmarks.faults.matrix --out docs/evidence/fault-matrix.md`, which does every fault below to
`insole run` on a real vcan, with boards, daemon and subscriber in a process each and Zenoh between them. {where}

Boards number every reading, in the lowest two bits of the counts, so the table says exactly what was on the bus and
never published. The left foot has three boards; where a bus fails, the right one has one board on a bus of its own too.

- **back**: from the fault's end until cycles come at 50 Hz again, the newest reading of every board in each. Wanted:
  1 s after a fault of board, bus or network, 3 s after the process had to be started again.
- **believed**: … and as much of it is valid as before. That can take longer on purpose: a board that had been wrong is
  trusted only after it was right for a while.
- **lost inside**: ticks of a board that were on the bus and never published, from the fault's beginning until it was
  back. **lost outside**: the same before it and after, of so many cycles. Wanted: 0.

What subscribers saw is of the time of the fault; events until 4 s after it; counters of `health` that moved by its end.

Two figures are that kernel's own. It stops for up to a second when an interface goes, the other bus with it. And
Python takes 5 s to start on it; on an ordinary kernel subscribers are without cycles for 0.65 s
(`python -m benchmarks.faults.restart`, which has the restart of the unit in it).

| fault | what subscribers saw | back | believed | lost inside | lost outside | |
|---|---|---|---|---|---|---|
"""


def page(rows: list[dict[str, Any]], took_s: float, before: str = "") -> str:
    """The whole of it; `rows` as inside.py prints them, each with the machine's `load` at its end.

    Rows that were not run keep their line of the page `before`.
    """
    kept = {line.split(" | ")[0].removeprefix("| "): line + "\n" for line in before.splitlines() if line[:2] == "| "}
    fresh = {row["fault"]: _line(row) for row in rows}
    there = [row for row in ROWS if row.name in fresh or row.name in kept]
    loads = sorted(row["load"] for row in rows)
    favoured = ", of which it ran ahead (`chrt -f 1`)" if os.sched_getscheduler(0) == os.SCHED_FIFO else ""
    others = "; the others are of runs before" if len(there) > len(rows) else ""
    where = (
        f"This run: {len(rows)} of the faults in {took_s / 60:.0f} min{others}, on User Mode Linux, a kernel whose one"
        " processor all of it shares and whose system calls take ten times as long as elsewhere, on a machine with a"
        f" load of {loads[len(loads) // 2]:.0f} (median) from other work{favoured}. So times are upper bounds, and"
        " `slack_ms` is 20 instead of 5: what that processor brings late is not lost."
    )
    lines = [HEAD.format(where=where)]
    group = ""
    for row in there:
        if row.group != group:
            group = row.group
            lines.append(f"| **{group}** | | | | | | |\n")
        lines.append(fresh.get(row.name) or kept[row.name])
    missed = sum("**missed**" in line for line in lines)
    lines.append(f"\n{len(there) - missed} of {len(there)} as wanted.\n")
    return "".join(lines)


def _line(row: dict[str, Any]) -> str:
    if "failed" in row:
        why = row["failed"].strip().splitlines()[-1]
        return f"| {row['fault']} | could not be done: {_cell(why)} | | | | | **missed** |\n"
    saw = row["saw"] + (f". {row['note'][:1].upper()}{row['note'][1:]}" if row["note"] else "")
    cells = (
        row["fault"], _cell(saw), _seconds(row["back_s"]), _seconds(row["believed_s"]), str(row["lost_in"]),
        f"{row['lost_out']} of {row['cycles']}", "" if row["met"] else "**missed**",
    )  # fmt: skip
    return f"| {' | '.join(cells)} |\n"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


def _seconds(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f} s"
