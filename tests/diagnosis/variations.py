"""Recordings of the tests' generators changed in ways that leave what is wrong with their insole as it was."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from insole_daemon.recording import counts as counts_file
from insole_daemon.recording.counts import CountsTable

Change = Callable[[Path], None]
ADDRESSES = {5: 9, 6: 3, 7: 12}  # whose order is another one, too
LATER_S = 1_000_000  # of a clock that is set anew
JITTER_S = 0.001  # as stamps have
SPIKES = 0.01  # of the readings of every taxel
MASKED = 5


def varied(folder: Path, out: Path, change: Change) -> Path:
    """A copy of the recording in `folder`, changed."""
    shutil.copytree(folder, out)
    change(out)
    return out


def decimated(folder: Path) -> None:
    """Every second cycle is left, and the boards say so."""
    _with_table(folder, lambda table: _rows(table, slice(None, None, 2)))
    _with_document(folder, "recording.yaml", lambda said: _with_boards(said, period_ms=40))


def held(folder: Path) -> None:
    """The converters have new values half as often as the boards send."""

    def hold(table: CountsTable) -> CountsTable:
        return replace(table, counts=table.counts[np.arange(len(table.counts)) // 2 * 2])

    _with_table(folder, hold)


def jittered(folder: Path) -> None:
    """Stamps are off by a millisecond."""
    rng = np.random.default_rng(1)

    def jitter(table: CountsTable) -> CountsTable:
        off_ns = np.rint(1e9 * rng.normal(0.0, JITTER_S, len(table.t_ns))).astype(np.int64)
        return replace(table, t_ns=table.t_ns + off_ns)

    _with_table(folder, jitter)


def with_other_boards(folder: Path) -> None:
    """Boards bear other addresses, and stand in another order."""

    def change(said: Any) -> Any:
        if isinstance(said, Mapping):
            return {key: _address(key, change(each)) for key, each in said.items()}
        return [change(each) for each in said] if isinstance(said, list) else said

    for name in ("recording.yaml", "layout.yaml", "calibration.json"):
        _with_document(folder, name, change)


def with_another_epoch(folder: Path) -> None:
    """Both clocks are set to another time of day."""
    _with_table(folder, lambda table: replace(table, t_ns=table.t_ns + LATER_S * 10**9))
    _with_times(folder, lambda t_s: t_s + LATER_S)


def with_own_clock(folder: Path) -> None:
    """The reference has a clock of its own, which begins some seconds apart and runs 20 ppm slower."""
    _with_times(folder, lambda t_s: 7.0 + (t_s - t_s[0]) * (1.0 - 20e-6))
    _with_document(folder, "recording.yaml", lambda said: _with_reference(said, clock="own"))


def with_spikes(folder: Path) -> None:
    """One reading of a hundred of every taxel says anything."""
    rng = np.random.default_rng(2)

    def spoil(table: CountsTable) -> CountsTable:
        struck = rng.random(table.counts.shape) < SPIKES
        anything = rng.integers(0, 256, table.counts.shape, dtype=np.uint8)
        return replace(table, counts=np.where(struck, anything, table.counts))

    _with_table(folder, spoil)


def without_a_board(folder: Path) -> None:
    """The calibration does not list the taxels of board 5."""

    def mask(model: Any) -> Any:
        return {**model, "taxels": [each for each in model["taxels"] if each["board"] != MASKED]}

    _with_document(folder, "calibration.json", mask)


def twice_as_noisy(folder: Path) -> None:
    """The noise of readings, about a count, is doubled."""
    rng = np.random.default_rng(3)

    def add(table: CountsTable) -> CountsTable:
        noisy = table.counts + rng.normal(0.0, np.sqrt(3.0), table.counts.shape)
        return replace(table, counts=np.clip(np.rint(noisy), 0, 255).astype(np.uint8))

    _with_table(folder, add)


VARIATIONS: Mapping[str, Change] = {
    "decimated": decimated,
    "held": held,
    "jittered": jittered,
    "other boards": with_other_boards,
    "another epoch": with_another_epoch,
    "own clock": with_own_clock,
    "spikes": with_spikes,
    "a board masked": without_a_board,
    "twice the noise": twice_as_noisy,
}


def with_reference(folder: Path, change: Callable[[dict[str, np.ndarray]], None]) -> None:
    """Apply `change` to the columns of the reference, in place."""
    path = folder / "reference.csv"
    head, *rows = path.read_text().splitlines()
    table = np.array([[float(cell) for cell in row.split(",")] for row in rows])
    columns = {name: table[:, k] for k, name in enumerate(head.split(","))}
    change(columns)
    path.write_text("\n".join([head, *(",".join(map(repr, row)) for row in table.tolist())]) + "\n")


def with_taxels(folder: Path, change: Callable[[dict[str, Any]], None]) -> None:
    """Apply `change` to every taxel of the calibration, in place."""

    def each(model: Any) -> Any:
        for taxel in model["taxels"]:
            change(taxel)
        return model

    _with_document(folder, "calibration.json", each)


def _with_times(folder: Path, change: Callable[[np.ndarray], np.ndarray]) -> None:
    def times(columns: dict[str, np.ndarray]) -> None:
        columns["time_s"][:] = change(columns["time_s"].copy())

    with_reference(folder, times)


def _with_table(folder: Path, change: Callable[[CountsTable], CountsTable]) -> None:
    path = folder / "counts.npz"
    n = len(yaml.safe_load((folder / "layout.yaml").read_text())["triangles"])
    table = counts_file.read(path, {"left": n})["left"]
    counts_file.write(path, {"left": change(table)})


def _with_document(folder: Path, name: str, change: Callable[[Any], Any]) -> None:
    path = folder / name
    said = change(yaml.safe_load(path.read_text()))
    path.write_text(json.dumps(said) if path.suffix == ".json" else yaml.safe_dump(said, sort_keys=False))


def _rows(table: CountsTable, rows: slice) -> CountsTable:
    return CountsTable(
        table.t_ns[rows], table.counts[rows], age_ms=None if table.age_ms is None else table.age_ms[rows]
    )


def _address(key: str, value: Any) -> Any:
    return ADDRESSES[value] if key in ("board", "address") else value


def _with_boards(said: Any, **settings: int) -> Any:
    for insole in said["insoles"]:
        insole["boards"] = [{**board, **settings} for board in insole["boards"]]
    return said


def _with_reference(said: Any, **settings: str) -> Any:
    said["reference"] = [{**each, **settings} for each in said["reference"]]
    return said
