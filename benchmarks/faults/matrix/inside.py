"""Runs rows on this kernel, which must have vcan and obey root: a JSON line each on stdout.

python -m benchmarks.faults.matrix.inside [WORD...]     rows whose group or name has one of the words; else all
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import traceback
from pathlib import Path

from benchmarks.faults.matrix.judge import judge
from benchmarks.faults.matrix.rig import Rig
from benchmarks.faults.matrix.rows import ROWS, Row


def main(words: list[str]) -> None:
    modules = Path("/usr/lib/uml/modules", os.uname().release, "kernel")
    for module in ("drivers/net/veth.ko", "net/sched/sch_netem.ko"):  # elsewhere the kernel loads them by itself
        if (modules / module).exists():
            subprocess.run(["insmod", str(modules / module)], capture_output=True, check=False)
    for row in ROWS:
        if not words or any(word in f"{row.group} {row.name}" for word in words):
            print(json.dumps(_run(row)), flush=True)


def _run(row: Row) -> dict[str, object]:
    with tempfile.TemporaryDirectory(prefix="row-", ignore_cleanup_errors=True) as name:
        folder = Path(name)
        run = row.run(folder)
        log = ""
        try:
            with Rig(folder, **next(run)) as rig:
                rig.start()
                note = ""
                try:
                    run.send(rig)
                except StopIteration as done:
                    note = done.value or ""
                if rig.boards.poll() is None:
                    rig.finish()
                log = rig.log()
                verdict = judge(rig, row.group, row.name, row.bar_s, note, row.heals)
                return verdict.document() | {"met": verdict.met, "log_lines": len(log.splitlines()) - 1}
        except Exception:
            return {"group": row.group, "fault": row.name, "failed": traceback.format_exc(), "log": log[-2000:]}


if __name__ == "__main__":
    main(sys.argv[1:])
