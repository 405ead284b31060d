"""Robustness of `insole diagnose` to randomly damaged recordings: it must answer or refuse each with a message.

    python -m benchmarks run diagnosis.mutated_recordings 1000 SEED --out FOLDER

Simulated trials (a bag, a chamber, a walk, a walk beside its simulation), each of another insole, with one to three
changes each: rows and frames that are lost, doubled, reordered, shifted in time, from other boards or with other bytes,
numbers that are invalid, too large or of another unit, other keys and values in the documents, other encodings, files
of another trial, and files that are truncated, empty or missing. More than 120 s of CPU or 1 GB is a defect, too. An
interrupted run continues where it stopped. Recordings that caused a defect are kept.

Takes about an hour for 1 000 on one core.
"""

from __future__ import annotations

import argparse
import collections
import json
import os
import random
import resource
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

COMMAND = [sys.executable, "-m", "insole_daemon"]
MEMORY = """format: insole-effects/1
effects:
  - effect: viscoelasticity
    where: {scope: insole}
    parameters: {a: {value: 0.2, unit: "1"}, tau_s: {value: 0.4, unit: s}}
"""
CYCLES = """format: insole-trial/1
chamber: {max_pressure_pa: 90000, speeds_pa_s: [90000, 180000], cycles: 3, hold_s: 1, minor: [0.7, 0.2, 0.7, 1]}
"""
# Trial: its recordings, each a scenario with its length in seconds, None: all of it, and its documents.
TRIALS: dict[str, dict[str, tuple[str, float | None, dict[str, str]]]] = {
    "bag": {"recording": ("vacuum", None, {"--trial": CYCLES})},
    "walk": {"recording": ("walk", 10, {})},
    "chamber": {"recording": ("plenum", None, {"--trial": CYCLES, "--effects": MEMORY})},
    "paired": {"recording": ("walk", 10, {"--effects": MEMORY}), "simulation": ("walk", 10, {})},
}
MOST_CPU_S, MOST_MB = 120.0, 1024.0  # of a diagnosis
STOPPED_CPU_S, STOPPED_S, STOPPED_BYTES = 180, 900.0, 4 << 30  # where it is stopped: of CPU, of the clock, of memory
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
CELLS = ("", "nan", "inf", "-1e300", "1e9", "0", "x", "1,2", "-5", "1e-300", "9" * 400)
UNITS = (-1.0, 1e-3, 9.81, 1e3, 1e6, 0.0)
SETTINGS = {
    "address": (0, 1, 5, 6, 7, 8, 15, 16, 128),
    "period_ms": (0, 1, 5, 50, 255, 1000, 60000),
    "shift": (0, 1, 2, 4, 7, 8, 15),
    "no_load": (0, 1, 128, 239, 255, 256),
    "skin_type": (0, 1, 2, 255),
    "interface": ("can0", "can1", "", "vcan9"),
}
ENCODINGS = ("utf-8-sig", "utf-16", "utf-32", "cp037")


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a diagnosis of a damaged recording ended."""

    number: int
    trial: str
    changes: tuple[str, ...]
    status: int  # of the command; below 0: the signal that ended it
    cpu_s: float
    peak_mb: float
    is_defect: bool
    last_line: str


def simulate(folder: Path) -> list[Path]:
    """Write the trials into `folder`, where they are not there yet, and return their folders."""
    folder.mkdir(parents=True, exist_ok=True)
    for seed, (name, recordings) in enumerate(TRIALS.items()):
        for part, (scenario, seconds, documents) in recordings.items():
            out = folder / name / part
            if out.exists():
                continue
            options = ["--out", str(out), "--seed", str(seed)]
            if seconds is not None:
                options += ["--seconds", str(seconds)]
            for option, text in documents.items():
                path = folder / f"{name}{option}.yaml"
                path.write_text(text)
                options += [option, str(path)]
            subprocess.run([*COMMAND, "simulate", scenario, *options], check=True, capture_output=True)
    return [folder / name for name in TRIALS]


def mutate(folder: Path, draws: random.Random, trials: Sequence[Path]) -> tuple[str, ...]:
    """Change the trial in `folder` in place, with files of the other `trials`; returns what was done."""
    done = []
    for _ in range(draws.randint(1, 3)):
        files = sorted(each for each in folder.glob("*/*") if not each.name.startswith("right"))
        if not files:
            break
        (path,) = draws.choices(files, [MORE if each.suffix in (".log", ".csv") else 1 for each in files])
        change = draws.choice(_changes(path, draws, trials))
        change(path, draws)
        done.append(f"{path.relative_to(folder)}: {change.__name__.strip('_').replace('_', ' ')}")
    return tuple(done)


def diagnose(number: int, trials: list[Path], seed: int, keep: Path | None = None) -> Outcome:
    """Diagnose mutation `number` of `seed`; a recording that shows a defect is kept in `keep`."""
    draws = random.Random(f"{seed}/{number}")
    with tempfile.TemporaryDirectory() as name:
        trial, folder = draws.choice(trials), Path(name) / "trial"
        shutil.copytree(trial, folder)
        changes = mutate(folder, draws, trials)
        options = ["--simulation", str(folder / "simulation")] if (folder / "simulation").exists() else []
        options += ["--foot", "left", "--out", str(Path(name) / "out")]
        status, used, output = _run([*COMMAND, "diagnose", str(folder / "recording"), *options])
        cpu_s, peak_mb = used.ru_utime + used.ru_stime, used.ru_maxrss / 1024
        is_defect = not 0 <= status <= 4 or "Traceback" in output or cpu_s > MOST_CPU_S or peak_mb > MOST_MB
        if is_defect and keep is not None:
            shutil.copytree(folder, keep / f"defect-{seed}-{number}", dirs_exist_ok=True)
        last = output.strip().splitlines()[-1] if output.strip() else ""
        return Outcome(
            number, trial.name, changes, status, round(cpu_s, 1), round(peak_mb), is_defect,
            last.replace(str(folder), "trial")[:300],
        )  # fmt: skip


def _run(command: list[str]) -> tuple[int, resource.struct_rusage, str]:
    """The exit status of `command`, what it used, and what it wrote."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (STOPPED_BYTES, STOPPED_BYTES))
        resource.setrlimit(resource.RLIMIT_CPU, (STOPPED_CPU_S, STOPPED_CPU_S))

    with tempfile.TemporaryFile() as output:
        child = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=output, stderr=output, preexec_fn=limit,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        )  # fmt: skip
        stop = threading.Timer(STOPPED_S, child.kill)
        stop.start()
        _, status, used = os.wait4(child.pid, 0)
        stop.cancel()
        child.returncode = os.waitstatus_to_exitcode(status)
        output.seek(0)
        return child.returncode, used, output.read().decode(errors="replace")


Change = Callable[[Path, random.Random], None]


def _changes(path: Path, draws: random.Random, trials: Sequence[Path]) -> list[Change]:
    def of_another_trial(path: Path, draws: random.Random) -> None:
        others = [file for trial in trials for file in trial.glob(f"*/{path.name}")]
        path.write_bytes(draws.choice(sorted(others)).read_bytes())

    of_kind: list[Change] = []
    if path.suffix in (".yaml", ".json"):
        of_kind = [_another_value, _another_value, _a_key_less]
        if path.name == "recording.yaml":
            of_kind += [_other_boards, _other_boards]
    elif path.suffix == ".csv":
        of_kind = [
            _other_cells, _a_column_less, _constant_column, _column_in_another_unit, _rows_in_another_order,
            _rows_lost, _rows_twice, _no_rows,
        ]  # fmt: skip
    elif path.suffix == ".log":
        of_kind = [
            _other_bytes, _constant_counts, _other_identifiers, _one_identifier, _one_board_slower, _a_board_silent,
            _rows_in_another_order, _rows_lost, _rows_twice, _no_rows, _other_times, _constant_time, _other_pace,
        ]  # fmt: skip
    every = (_cut_off, _bytes_flipped, _empty, _file_removed, _another_encoding, _other_line_ends, of_another_trial)
    return [*of_kind, draws.choice(every)]


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


def _column_in_another_unit(path: Path, draws: random.Random) -> None:
    factor, begin = draws.choice(UNITS), draws.choice((0.0, draws.random()))

    def change(rows: list[list[str]]) -> None:
        k = draws.randrange(len(rows[0]))
        for row in rows[int(begin * len(rows)) :]:
            try:
                row[k : k + 1] = [repr(float(cell) * factor) for cell in row[k : k + 1]]
            except ValueError:
                continue

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


def _no_rows(path: Path, draws: random.Random) -> None:
    _with_rows(path, lambda rows: rows[: draws.choice((0, 1, 2, 20))])


def _other_boards(path: Path, draws: random.Random) -> None:
    """Boards are missing, or have other addresses and settings."""
    document, _ = _document(path)
    try:
        boards = document["insoles"][0]["boards"]
        k = draws.randrange(len(boards))
        if draws.random() < 0.3:
            del boards[k]
        else:
            key, values = draws.choice(tuple(SETTINGS.items()))
            boards[k][key] = draws.choice(values)
    except (TypeError, KeyError, IndexError, ValueError):
        return
    _write(path, document)


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


def _constant_counts(path: Path, draws: random.Random) -> None:
    """All frames of an identifier, or all, repeat the payload of the first one."""
    every, first = draws.random() < 0.5, dict[str, str]()

    def change(row: str) -> str:
        head, mark, payload = row.partition("#")
        identifier = head[-3:]
        # The two halves of a triangle have the same identifier; the first byte tells them apart.
        half = payload[:2] if not every and identifier in chosen else ""
        if every:
            return head + mark + first.setdefault(payload[:2], payload)
        return head + mark + first.setdefault(identifier + half, payload) if half else row

    rows = path.read_text(errors="replace").splitlines()
    identifiers = sorted({row.partition("#")[0][-3:] for row in rows}) or [""]
    chosen = set(draws.sample(identifiers, draws.randint(1, len(identifiers))))
    _with_rows(path, lambda rows: [change(row) for row in rows])


def _one_identifier(path: Path, draws: random.Random) -> None:
    def change(rows: list[str]) -> list[str]:
        of = draws.choice(rows).partition("#")[0][-3:]
        return [row for row in rows if f"{of}#" in row]

    _with_rows(path, change)


def _one_board_slower(path: Path, draws: random.Random) -> None:
    every, number = draws.choice((2, 3, 5, 50, 1000)), collections.Counter[str]()

    def change(rows: list[str]) -> list[str]:
        board = draws.choice(rows).partition("#")[0][-2:-1]
        kept = []
        for row in rows:
            identifier = row.partition("#")[0][-3:]
            number[identifier] += 1
            # Two frames are a reading.
            if identifier[1:2] != board or (number[identifier] - 1) // 2 % every == 0:
                kept.append(row)
        return kept

    _with_rows(path, change)


def _a_board_silent(path: Path, draws: random.Random) -> None:
    """From some moment on, or for a while."""

    def change(rows: list[str]) -> list[str]:
        board = draws.choice(rows).partition("#")[0][-2:-1]
        begin, end = sorted((draws.random(), draws.choice((draws.random(), 1.1))))
        return [
            row
            for k, row in enumerate(rows)
            if row.partition("#")[0][-2:-1] != board or not begin * len(rows) <= k < end * len(rows)
        ]

    _with_rows(path, change)


def _constant_time(path: Path, draws: random.Random) -> None:
    def change(rows: list[str]) -> list[str]:
        stamp = rows[0].partition(") ")[0]
        begin = draws.choice((0.0, draws.random()))
        return [row if k < begin * len(rows) else f"{stamp}) {row.partition(') ')[2]}" for k, row in enumerate(rows)]

    _with_rows(path, change)


def _other_pace(path: Path, draws: random.Random) -> None:
    by = draws.choice((1e-6, 0.01, 0.5, 1.001, 1.1, 3.0, 1000.0))

    def change(rows: list[str]) -> list[str]:
        try:
            times = [float(row.partition(") ")[0][1:]) for row in rows]
        except ValueError:
            return rows
        return [
            f"({times[0] + by * (t - times[0]):.6f}) {row.partition(') ')[2]}"
            for t, row in zip(times, rows, strict=True)
        ]

    _with_rows(path, change)


def _another_encoding(path: Path, draws: random.Random) -> None:
    path.write_bytes(path.read_text(errors="replace").encode(draws.choice(ENCODINGS), errors="replace"))


def _other_line_ends(path: Path, draws: random.Random) -> None:
    path.write_bytes(path.read_bytes().replace(b"\n", draws.choice((b"\r\n", b"\r", b"\n\n", b"\x00\n", b" \n"))))


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


def _file_removed(path: Path, draws: random.Random) -> None:
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
        print(f"defect {each['number']}: {'; '.join(each['changes'])}: {each['last_line']}")
    print(f"{len(defects)} defects")
    return 1 if defects else 0


if __name__ == "__main__":
    sys.exit(main())
