"""Robustness of `insole diagnose` to randomly damaged recordings: it must answer or refuse each with a message.

    python -m benchmarks run diagnosis.mutated_recordings 1000 SEED --out FOLDER

Two simulated trials, a chamber and a walk, with one to three changes each: rows and frames that are lost, doubled,
reordered, shifted in time or changed, invalid numbers, other keys and values in the documents, files that are
truncated, empty or missing. An interrupted run continues where it stopped. Recordings that caused a defect are kept.

Takes about an hour for 1 000 on one core.
"""

from __future__ import annotations

import argparse
import collections
import json
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

COMMAND = [sys.executable, "-m", "insole_daemon"]
TRIALS = {"vacuum": 25, "walk": 12}  # s
MOST_S = 300.0  # of a diagnosis
MORE = 4  # times as often as a document, whose damage is refused before it is looked at
VALUES = (
    None,
    True,
    -1,
    0,
    1,
    1e9,
    10**30,
    float("nan"),
    float("inf"),
    "",
    "x",
    "left",
    "right",
    [],
    [[]],
    {},
    [1, 2],
    {"a": 1},
)
CELLS = ("", "nan", "inf", "-1e300", "1e9", "0", "x", "1,2", "-5")


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a diagnosis of a damaged recording ended."""

    number: int
    changes: tuple[str, ...]
    status: int  # of the command; −1: it took too long
    is_defect: bool
    said: str  # its last line


def simulate(folder: Path) -> list[Path]:
    """Write the trials into `folder`, where they are not there yet, and return their folders."""
    found = []
    for scenario, seconds in TRIALS.items():
        trial = folder / scenario
        if not trial.exists():
            arguments = ["simulate", scenario, "--out", str(trial), "--seconds", str(seconds)]
            subprocess.run([*COMMAND, *arguments], check=True, capture_output=True)
        found.append(trial)
    return found


def mutate(folder: Path, draws: random.Random) -> tuple[str, ...]:
    """Change the recording in `folder` in place; returns what was done."""
    done = []
    for _ in range(draws.randint(1, 3)):
        files = sorted(each for each in folder.iterdir() if not each.name.startswith("right"))
        if not files:
            break
        (path,) = draws.choices(files, [MORE if each.suffix in (".log", ".csv") else 1 for each in files])
        change = draws.choice(_changes(path, draws))
        change(path, draws)
        done.append(f"{path.name}: {change.__name__.strip('_').replace('_', ' ')}")
    return tuple(done)


def diagnose(number: int, trials: list[Path], seed: int, keep: Path | None = None) -> Outcome:
    """Diagnose mutation `number` of `seed`; a recording that shows a defect is kept in `keep`."""
    draws = random.Random(f"{seed}/{number}")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "trial"
        shutil.copytree(draws.choice(trials), folder)
        changes = mutate(folder, draws)
        try:
            done = subprocess.run(
                [*COMMAND, "diagnose", str(folder), "--foot", "left", "--out", str(Path(name) / "out")],
                capture_output=True, text=True, errors="replace", timeout=MOST_S, check=False,
            )  # fmt: skip
            status, said = done.returncode, done.stderr
        except subprocess.TimeoutExpired:
            status, said = -1, f"took more than {MOST_S:.0f} s"
        is_defect = not 0 <= status <= 4 or "Traceback" in said
        if is_defect and keep is not None:
            shutil.copytree(folder, keep / f"defect-{number}", dirs_exist_ok=True)
        last = said.strip().splitlines()[-1] if said.strip() else ""
        return Outcome(number, changes, status, is_defect, last.replace(str(folder), "trial")[:300])


Change = Callable[[Path, random.Random], None]


def _changes(path: Path, draws: random.Random) -> list[Change]:
    of_kind: list[Change] = []
    if path.suffix in (".yaml", ".json"):
        of_kind = [_another_value, _another_value, _a_key_less]
    elif path.suffix == ".csv":
        of_kind = [_other_cells, _a_column_less, _constant_column, _rows_in_another_order, _rows_lost, _rows_twice]
    elif path.suffix == ".log":
        of_kind = [_other_bytes, _other_identifiers, _rows_in_another_order, _rows_lost, _rows_twice, _other_times]
    return [*of_kind, draws.choice((_cut_off, _bytes_flipped, _empty, _gone))]


def _another_value(path: Path, draws: random.Random) -> None:
    document, places = _document(path)
    if places:
        parent, key = draws.choice(places)
        parent[key] = draws.choice(VALUES)
        _write(path, document)


def _a_key_less(path: Path, draws: random.Random) -> None:
    document, places = _document(path)
    if places:
        parent, key = draws.choice(places)
        del parent[key]
        _write(path, document)


def _document(path: Path) -> tuple[Any, list[tuple[Any, Any]]]:
    """The document, and every place in it as its map or list, and key."""
    try:
        document = yaml.safe_load(path.read_text(errors="replace"))
    except (yaml.YAMLError, ValueError):
        return None, []
    places: list[tuple[Any, Any]] = []
    stack = [document]
    while stack and len(places) < 5000:
        one = stack.pop()
        keys = list(one) if isinstance(one, dict) else range(len(one)) if isinstance(one, list) else ()
        places += [(one, key) for key in keys]
        stack += [one[key] for key in keys]
    return document, places


def _write(path: Path, document: Any) -> None:
    path.write_text(json.dumps(document) if path.suffix == ".json" else yaml.safe_dump(document, sort_keys=False))


def _other_cells(path: Path, draws: random.Random) -> None:
    def change(rows: list[list[str]]) -> None:
        for _ in range(draws.choice((1, 20, len(rows)))):
            row = draws.choice(rows)
            row[draws.randrange(len(row))] = draws.choice(CELLS)

    _with_cells(path, change)


def _a_column_less(path: Path, draws: random.Random) -> None:
    text = [line.split(",") for line in path.read_text(errors="replace").splitlines()]
    k = draws.randrange(max(len(text[0]), 1)) if text else 0
    path.write_text("".join(",".join(row[:k] + row[k + 1 :]) + "\n" for row in text))


def _constant_column(path: Path, draws: random.Random) -> None:
    def change(rows: list[list[str]]) -> None:
        k = draws.randrange(len(rows[0]))
        for row in rows:
            row[k : k + 1] = rows[0][k : k + 1]

    _with_cells(path, change)


def _with_cells(path: Path, change: Callable[[list[list[str]]], None]) -> None:
    """Change the rows below the head."""
    head, *rows = path.read_text(errors="replace").splitlines() or [""]
    cells = [row.split(",") for row in rows]
    if cells:
        change(cells)
    path.write_text("".join(line + "\n" for line in [head, *(",".join(row) for row in cells)]))


def _rows_in_another_order(path: Path, draws: random.Random) -> None:
    def change(rows: list[str]) -> list[str]:
        a = draws.randrange(len(rows))
        part = rows[a : a + draws.choice((2, 50, len(rows)))]
        draws.shuffle(part)
        return rows[:a] + part + rows[a + len(part) :]

    _with_rows(path, change)


def _rows_lost(path: Path, draws: random.Random) -> None:
    kept = draws.choice((0.01, 0.3, 0.9, 0.99))
    _with_rows(path, lambda rows: [row for row in rows if draws.random() < kept])


def _rows_twice(path: Path, draws: random.Random) -> None:
    twice = draws.choice((0.01, 0.3, 1.0))
    _with_rows(path, lambda rows: [row for row in rows for _ in range(1 + (draws.random() < twice))])


def _with_rows(path: Path, change: Callable[[list[str]], list[str]]) -> None:
    head, *rows = path.read_text(errors="replace").splitlines() or [""]
    path.write_text("".join(line + "\n" for line in [head, *(change(rows) if rows else rows)]))


def _other_bytes(path: Path, draws: random.Random) -> None:
    """Of the payloads of frames."""
    share, same = draws.choice((0.001, 0.1, 1.0)), draws.choice(("00", "FF", "F0", ""))

    def change(row: str) -> str:
        head, mark, payload = row.partition("#")
        if draws.random() >= share or not payload:
            return row
        pairs = [payload[k : k + 2] for k in range(0, len(payload), 2)]
        pairs[draws.randrange(len(pairs))] = same or f"{draws.randrange(256):02X}"
        return head + mark + "".join(pairs)

    _with_rows(path, lambda rows: [change(row) for row in rows])


def _other_identifiers(path: Path, draws: random.Random) -> None:
    one, other = (f" {draws.choice((0x358, 0x359, 0x365, 0x366, 0x305, 0x7FF)):03X}#" for _ in range(2))
    share = draws.choice((0.01, 1.0))
    _with_rows(path, lambda rows: [row.replace(one, other) if draws.random() < share else row for row in rows])


def _other_times(path: Path, draws: random.Random) -> None:
    """Of a candump: `(seconds) interface frame`."""
    by_s = draws.choice((-1e9, -0.5, 0.001, 5.0, 1e12))
    begin = draws.random()

    def change(k: int, n: int, row: str) -> str:
        stamp, _, rest = row.partition(") ")
        try:
            return f"({float(stamp[1:]) + by_s:.6f}) {rest}" if k > begin * n else row
        except ValueError:
            return row

    _with_rows(path, lambda rows: [change(k, len(rows), row) for k, row in enumerate(rows)])


def _cut_off(path: Path, draws: random.Random) -> None:
    data = path.read_bytes()
    path.write_bytes(data[: draws.randrange(len(data) + 1)])


def _bytes_flipped(path: Path, draws: random.Random) -> None:
    data = bytearray(path.read_bytes())
    for _ in range(draws.choice((1, 30)) if data else 0):
        data[draws.randrange(len(data))] ^= 1 << draws.randrange(8)
    path.write_bytes(data)


def _empty(path: Path, draws: random.Random) -> None:
    path.write_bytes(b"")


def _gone(path: Path, draws: random.Random) -> None:
    path.unlink()


def main() -> int:
    """Return 1 where there is a defect."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("number", type=int, help="of damaged recordings")
    parser.add_argument("seed", type=int)
    parser.add_argument("--out", type=Path, required=True, help="folder of the trials, the outcomes and the defects")
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    trials, log = simulate(asked.out), asked.out / f"outcomes-{asked.seed}.jsonl"
    outcomes = [json.loads(line) for line in log.read_text().splitlines()] if log.exists() else []
    with log.open("a") as written:
        for number in range(len(outcomes), asked.number):
            one = diagnose(number, trials, asked.seed, asked.out)
            outcomes.append({name: getattr(one, name) for name in one.__slots__})
            written.write(json.dumps(outcomes[-1]) + "\n")
            written.flush()
    by_status = collections.Counter(each["status"] for each in outcomes)
    defects = [each for each in outcomes if each["is_defect"]]
    print(f"{len(outcomes)} damaged recordings, seed {asked.seed}: " + ", ".join(
        f"{n} ended with status {status}" for status, n in sorted(by_status.items())
    ))  # fmt: skip
    for each in defects:
        print(f"defect {each['number']}: {'; '.join(each['changes'])}: {each['said']}")
    print(f"{len(defects)} defects")
    return 1 if defects else 0


if __name__ == "__main__":
    sys.exit(main())
