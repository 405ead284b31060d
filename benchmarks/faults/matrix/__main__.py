"""Fault matrix: what subscribers see, how long recovery takes and what is lost, for each fault on a real vcan.

    python -m benchmarks.faults.matrix [WORD...] [--out docs/evidence/fault-matrix.md]

Needs User Mode Linux (apt-get install user-mode-linux kmod iproute2): a kernel of its own, whose clock may be set and
whose interfaces may go. A WORD chooses the rows with it in their group or name; the others keep their line of the page
that is there.

Takes about a quarter of an hour.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path

from benchmarks.faults.matrix.table import page

CHECKOUT = Path(__file__).parents[3]
TIMEOUT_S = 3000


def main() -> int:
    parser = argparse.ArgumentParser(description="Every fault on a real vcan, as a table.")
    parser.add_argument("words", nargs="*", help="only rows with one of them in their group or name")
    parser.add_argument("--out", type=Path, help="the page to write, or to renew")
    options = parser.parse_args()
    rows = []
    began = time.monotonic()
    inside = [sys.executable, "-m", "benchmarks.faults.matrix.inside", *options.words]
    kernel = [sys.executable, "tests/vcan/uml.py", "--timeout", str(TIMEOUT_S), "--memory", "512M", "--"]
    with subprocess.Popen([*kernel, *inside], cwd=CHECKOUT, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            rows.append(json.loads(line) | {"load": os.getloadavg()[0]})
            print(_in_short(rows[-1]), file=sys.stderr, flush=True)
    before = options.out.read_text() if options.out and options.out.exists() else ""
    text = page(rows, time.monotonic() - began, before)
    if options.out:
        options.out.write_text(text)
    else:
        print(text)
    return int(process.returncode != 0 or not all(each.get("met") for each in rows))


def _in_short(row: dict) -> str:
    if "failed" in row:
        return f"FAILED {row['group']}: {row['fault']}\n{row['failed']}\n{row['log']}"
    verdict = "met   " if row["met"] else "MISSED"
    return f"{verdict} {row['group']}: {row['fault']}: back {row['back_s']}, lost {row['lost_out']}"


if __name__ == "__main__":
    sys.exit(main())
