"""Counts where no frames were kept: `counts.npz`, and the folder `counts/` while a recording grows.

counts.npz has t_s (n,) and counts (n, n_triangles, 12); where two insoles were recorded, the names begin with
left_ and right_. OPTIONAL arrays may follow, further ones are ignored. The folder has one left.npy and/or right.npy:
a structured array of the same names, one record a cycle, that is appended to; `numpy.load` reads it at any moment.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DocumentError, Problem
from ..files import unfinished, unreadable
from ..skin.geometry import N_TAXELS

# Beside t_s and counts, what a daemon says of every cycle: name → type and axes; n is the cycle, k the triangle.
OPTIONAL: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "t_ns": ("<i8", ("n",)),  # t_s without rounding
    "seq": ("<i8", ("n",)),  # the daemon's number of the cycle: a gap is cycles that were lost
    "status": ("<u2", ("n", "k")),
    "age_ms": ("<f4", ("n", "k")),  # NaN: never received
    "missing": ("|u1", ("n", "k")),
    "valid": ("|u1", ("n", "k", "taxel")),
    "late": ("|u1", ("n",)),
    "repeated": ("|u1", ("n",)),
}
_LATEST_S = 9.2e9  # what 64 bits hold of nanoseconds
_MAGIC = b"\x93NUMPY\x01\x00"


@dataclass(frozen=True, slots=True, eq=False)
class CountsTable:
    """The cycles of one foot as they were written down; what was not is None."""

    t_ns: NDArray[np.int64]  # (n,)
    counts: NDArray[np.uint8]  # (n, n_triangles, 12)
    seq: NDArray[np.int64] | None = None  # (n,)
    status: NDArray[np.uint16] | None = None  # (n, n_triangles)
    age_ms: NDArray[np.float32] | None = None  # (n, n_triangles)
    missing: NDArray[np.uint8] | None = None  # (n, n_triangles)
    valid: NDArray[np.uint8] | None = None  # (n, n_triangles, 12)
    late: NDArray[np.uint8] | None = None  # (n,)
    repeated: NDArray[np.uint8] | None = None  # (n,)


def read(path: Path, n_triangles: Mapping[str, int]) -> dict[str, CountsTable]:
    """By foot, the tables of the feet in `n_triangles`; DocumentError lists all that is wrong with the file."""
    try:
        if path.is_dir():
            named = {
                _name(foot, name, n_triangles): array
                for foot in n_triangles
                for name, array in _grown(path / f"{foot}.npy").items()
            }
        else:
            with open(path, "rb") as file, np.load(file, allow_pickle=False) as archive:
                named = {name: archive[name] for name in archive.files}
    except OSError as error:
        raise DocumentError(str(path), [Problem(None, "", unreadable(error))]) from error
    except Exception as error:  # zip, zlib and numpy each have errors of their own
        what = f"expected arrays that numpy wrote (.npz), found something else: {error}"
        raise DocumentError(str(path), [Problem(None, "", what)]) from error
    problems: list[Problem] = []
    tables = {}
    for foot, k in n_triangles.items():
        own = {name: named.get(_name(foot, name, n_triangles)) for name in ("t_s", "counts", *OPTIONAL)}
        wrong = list(_problems(own, k, foot, n_triangles))
        problems += wrong
        if not wrong:
            tables[foot] = _table(own)
    if problems:
        raise DocumentError(str(path), problems)
    return tables


def arrays(tables: Mapping[str, CountsTable]) -> dict[str, NDArray[Any]]:
    """What counts.npz holds for `tables`, by foot."""
    found: dict[str, NDArray[Any]] = {}
    for foot, table in tables.items():
        found[_name(foot, "t_s", tables)] = table.t_ns * 1e-9
        found[_name(foot, "counts", tables)] = table.counts
        for name in OPTIONAL:
            array = getattr(table, name)
            if array is not None:
                found[_name(foot, name, tables)] = array
    return found


class GrowingCounts:
    """One foot's .npy, appended to cycle by cycle; every append is one write, so that none is torn by a kill."""

    def __init__(self, path: Path, n_triangles: int) -> None:
        """Create the file; raises OSError where that cannot be."""
        self.dtype = cycle_type(n_triangles)
        self._descr = repr(np.lib.format.dtype_to_descr(self.dtype))
        self._file = open(path, "wb", buffering=0)  # noqa: SIM115 - closed by close()
        self._n = 0
        self._file.write(self._header(0))

    def append(self, cycles: NDArray[np.void]) -> None:
        """Add records of `dtype`."""
        self._file.write(cycles.tobytes())
        self._n += len(cycles)
        os.pwrite(self._file.fileno(), self._header(self._n), 0)

    @property
    def size(self) -> int:
        """Bytes so far."""
        return self._file.tell()

    def fileno(self) -> int:
        """Of the file, for whoever makes it durable."""
        return self._file.fileno()

    def close(self) -> None:
        """Close the file; idempotent."""
        self._file.close()

    def _header(self, n: int) -> bytes:
        """NPY format 1.0, in a room that a larger number of records does not change."""
        said = f"{{'descr': {self._descr}, 'fortran_order': False"
        room = -(-(len(said) + 65) // 64) * 64 + 64 - len(_MAGIC) - 2
        text = f"{said}, 'shape': ({n},)}}".ljust(room - 1) + "\n"
        return _MAGIC + len(text).to_bytes(2, "little") + text.encode()


def cycle_type(n_triangles: int) -> np.dtype[np.void]:
    """The record of one cycle in the file that grows."""
    axes = {"n": (), "k": (n_triangles,), "taxel": (N_TAXELS,)}
    fields: list[tuple[str, str, tuple[int, ...]]] = [("counts", "|u1", (n_triangles, N_TAXELS))]
    fields += [(name, kind, sum((axes[axis] for axis in shape), ())) for name, (kind, shape) in OPTIONAL.items()]
    return np.dtype(fields)


def _grown(path: Path) -> dict[str, NDArray[Any]]:
    """The arrays of a file that grows or was left by a kill, by name."""
    with open(path, "rb") as file:
        if np.lib.format.read_magic(file) != (1, 0):
            raise ValueError("an .npy of another version")
        _, _, dtype = np.lib.format.read_array_header_1_0(file)
        whole = (os.fstat(file.fileno()).st_size - file.tell()) // dtype.itemsize
        # More may be there than the header says: it is written after the records.
        records = np.fromfile(file, dtype, whole)
    found = {name: np.ascontiguousarray(records[name]) for name in dtype.names or ()}
    if "t_ns" in found:
        found["t_s"] = found["t_ns"] * 1e-9
    return found


def _name(foot: str, name: str, feet: Mapping[str, Any] | Sequence[str]) -> str:
    return name if len(feet) == 1 else f"{foot}_{name}"


def _problems(own: Mapping[str, NDArray[Any] | None], k: int, foot: str, feet: Mapping[str, int]) -> Iterator[Problem]:
    """What is wrong with the arrays of one foot of k triangles."""
    counts, t_s = own["counts"], own["t_s"]
    for name, expected in (("t_s", "(n,)"), ("counts", f"(n, {k}, {N_TAXELS})")):
        if own[name] is None:
            yield Problem(None, _name(foot, name, feet), f"missing array: expected {expected}")
    if counts is None or t_s is None:
        return
    if counts.ndim != 3 or counts.shape[1:] != (k, N_TAXELS):
        yield Problem(
            None, _name(foot, "counts", feet),
            f"expected (n, {k}, {N_TAXELS}) for the {k} triangles of the layout, found {counts.shape}",
        )  # fmt: skip
    elif counts.dtype != np.uint8:
        yield Problem(None, _name(foot, "counts", feet), f"expected whole numbers of one byte, found {counts.dtype}")
    if t_s.shape != counts.shape[:1] or t_s.dtype.kind != "f" or not (np.abs(t_s) <= _LATEST_S).all():
        yield Problem(
            None, _name(foot, "t_s", feet),
            f"expected a finite time in seconds for each of the {counts.shape[0] if counts.ndim else 0} cycles, "
            f"found {t_s.dtype} {t_s.shape}",
        )  # fmt: skip
    sizes = {"n": counts.shape[:1], "k": (k,), "taxel": (N_TAXELS,)}
    for name, (kind, axes) in OPTIONAL.items():
        array = own[name]
        shape = sum((sizes[axis] for axis in axes), ())
        if array is not None and (array.shape != shape or array.dtype != np.dtype(kind)):
            yield Problem(None, _name(foot, name, feet), f"expected {kind} {shape}, found {array.dtype} {array.shape}")


def _table(own: Mapping[str, Any]) -> CountsTable:
    t_ns = own["t_ns"] if own["t_ns"] is not None else np.round(own["t_s"] * 1e9).astype(np.int64)
    rest = {name: own[name] for name in ("seq", "status", "age_ms", "missing", "valid", "late", "repeated")}
    return CountsTable(t_ns, own["counts"], **rest)


def write(path: Path, tables: Mapping[str, CountsTable]) -> None:
    """Write counts.npz, all or nothing; raises OSError where it cannot be written."""
    with unfinished(path) as beside, open(beside, "wb") as file:
        np.savez_compressed(file, **arrays(tables))  # type: ignore[arg-type]
