"""Read and write counts without frames: `counts.npz`, and the folder `counts/` while a recording grows.

counts.npz has t_s (n,) and counts (n, n_triangles, 12). With two insoles the names begin with left_ and right_.
OPTIONAL arrays may follow; others are ignored. The folder has left.npy, right.npy or both: a structured array with the
same names and one record per cycle, which `numpy.load` can read while it grows.
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
from .columns import LATEST_S

# What a daemon publishes with every cycle besides t_s and counts: name → type and axes; n: cycles, k: triangles.
OPTIONAL: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "t_ns": ("<i8", ("n",)),  # t_s without rounding
    "seq": ("<i8", ("n",)),  # the daemon's cycle number; a gap means lost cycles
    "status": ("<u2", ("n", "k")),
    "age_ms": ("<f4", ("n", "k")),  # NaN: never received
    "missing": ("|u1", ("n", "k")),
    "valid": ("|u1", ("n", "k", "taxel")),
    "late": ("|u1", ("n",)),
    "repeated": ("|u1", ("n",)),
}
_MAGIC = b"\x93NUMPY\x01\x00"


@dataclass(frozen=True, slots=True, eq=False)
class CountsTable:
    """The recorded cycles of one foot; arrays that were not recorded are None."""

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
    """Read the tables of the feet in `n_triangles`, by foot; DocumentError lists all problems of the file."""
    try:
        if path.is_dir():
            named = {
                _array_name(foot, name, n_triangles): array
                for foot in n_triangles
                for name, array in _read_growing(path / f"{foot}.npy").items()
            }
        else:
            with open(path, "rb") as file, np.load(file, allow_pickle=False) as archive:
                named = {name: archive[name] for name in archive.files}
    except OSError as error:
        raise DocumentError(str(path), [Problem(None, "", unreadable(error))]) from error
    except Exception as error:  # zip, zlib and numpy raise different errors
        what = f"expected arrays that numpy wrote (.npz), found something else: {error}"
        raise DocumentError(str(path), [Problem(None, "", what)]) from error
    problems: list[Problem] = []
    tables = {}
    for foot, k in n_triangles.items():
        foot_arrays = {name: named.get(_array_name(foot, name, n_triangles)) for name in ("t_s", "counts", *OPTIONAL)}
        wrong = list(_find_problems(foot_arrays, k, foot, n_triangles))
        problems += wrong
        if not wrong:
            tables[foot] = _build_table(foot_arrays)
    if problems:
        raise DocumentError(str(path), problems)
    return tables


def arrays(tables: Mapping[str, CountsTable]) -> dict[str, NDArray[Any]]:
    """Return the arrays of counts.npz for `tables`, a table by foot."""
    named: dict[str, NDArray[Any]] = {}
    for foot, table in tables.items():
        named[_array_name(foot, "t_s", tables)] = table.t_ns * 1e-9
        named[_array_name(foot, "counts", tables)] = table.counts
        for name in OPTIONAL:
            array = getattr(table, name)
            if array is not None:
                named[_array_name(foot, name, tables)] = array
    return named


class GrowingCounts:
    """One foot's .npy file that cycles are appended to; each append is one write, so that a kill leaves no
    half cycle.
    """

    def __init__(self, path: Path, n_triangles: int) -> None:
        """Create the file; OSError if that fails."""
        self.dtype = cycle_type(n_triangles)
        self._descr = repr(np.lib.format.dtype_to_descr(self.dtype))
        self._file = open(path, "wb", buffering=0)  # noqa: SIM115 - closed by close()
        self._n = 0
        self._file.write(self._header(0))

    def append(self, cycles: NDArray[np.void]) -> None:
        """Append records of `dtype`."""
        self._file.write(cycles.tobytes())
        self._n += len(cycles)
        os.pwrite(self._file.fileno(), self._header(self._n), 0)

    @property
    def size(self) -> int:
        """Return the bytes so far."""
        return self._file.tell()

    def fileno(self) -> int:
        """Return the descriptor, for syncing the file to the disk."""
        return self._file.fileno()

    def close(self) -> None:
        """Close the file; idempotent."""
        self._file.close()

    def _header(self, n: int) -> bytes:
        """Return an NPY 1.0 header, padded so that its length is the same for any number of records."""
        entries = f"{{'descr': {self._descr}, 'fortran_order': False"
        n_bytes = -(-(len(entries) + 65) // 64) * 64 + 64 - len(_MAGIC) - 2
        text = f"{entries}, 'shape': ({n},)}}".ljust(n_bytes - 1) + "\n"
        return _MAGIC + len(text).to_bytes(2, "little") + text.encode()


def cycle_type(n_triangles: int) -> np.dtype[np.void]:
    """Return the dtype of one cycle's record in the growing file."""
    axes = {"n": (), "k": (n_triangles,), "taxel": (N_TAXELS,)}
    fields: list[tuple[str, str, tuple[int, ...]]] = [("counts", "|u1", (n_triangles, N_TAXELS))]
    fields += [(name, kind, sum((axes[axis] for axis in shape), ())) for name, (kind, shape) in OPTIONAL.items()]
    return np.dtype(fields)


def _read_growing(path: Path) -> dict[str, NDArray[Any]]:
    """Read the arrays of a file that is growing or was left by a kill, by name."""
    with open(path, "rb") as file:
        if np.lib.format.read_magic(file) != (1, 0):
            raise ValueError("an .npy of another version")
        _, _, dtype = np.lib.format.read_array_header_1_0(file)
        n_complete = (os.fstat(file.fileno()).st_size - file.tell()) // dtype.itemsize
        # The header is written after the records, so the file may hold more than it says.
        records = np.fromfile(file, dtype, n_complete)
    named = {name: np.ascontiguousarray(records[name]) for name in dtype.names or ()}
    if "t_ns" in named:
        named["t_s"] = named["t_ns"] * 1e-9
    return named


def _array_name(foot: str, name: str, feet: Mapping[str, Any] | Sequence[str]) -> str:
    """Return the array's name in the file, prefixed with the foot if there are two feet."""
    return name if len(feet) == 1 else f"{foot}_{name}"


def _find_problems(
    foot_arrays: Mapping[str, NDArray[Any] | None], k: int, foot: str, feet: Mapping[str, int]
) -> Iterator[Problem]:
    """Yield the problems of the arrays of one foot with k triangles."""
    counts, t_s = foot_arrays["counts"], foot_arrays["t_s"]
    for name, expected in (("t_s", "(n,)"), ("counts", f"(n, {k}, {N_TAXELS})")):
        if foot_arrays[name] is None:
            yield Problem(None, _array_name(foot, name, feet), f"missing array: expected {expected}")
    if counts is None or t_s is None:
        return
    if counts.ndim != 3 or counts.shape[1:] != (k, N_TAXELS):
        yield Problem(
            None, _array_name(foot, "counts", feet),
            f"expected (n, {k}, {N_TAXELS}) for the {k} triangles of the layout, found {counts.shape}",
        )  # fmt: skip
    elif counts.dtype != np.uint8:
        yield Problem(
            None, _array_name(foot, "counts", feet), f"expected whole numbers of one byte, found {counts.dtype}"
        )
    if t_s.shape != counts.shape[:1] or t_s.dtype.kind != "f" or not (np.abs(t_s) <= LATEST_S).all():
        yield Problem(
            None, _array_name(foot, "t_s", feet),
            f"expected a finite time in seconds for each of the {counts.shape[0] if counts.ndim else 0} cycles, "
            f"found {t_s.dtype} {t_s.shape}",
        )  # fmt: skip
    sizes = {"n": counts.shape[:1], "k": (k,), "taxel": (N_TAXELS,)}
    for name, (kind, axes) in OPTIONAL.items():
        array = foot_arrays[name]
        shape = sum((sizes[axis] for axis in axes), ())
        if array is not None and (array.shape != shape or array.dtype != np.dtype(kind)):
            yield Problem(
                None, _array_name(foot, name, feet), f"expected {kind} {shape}, found {array.dtype} {array.shape}"
            )


def _build_table(foot_arrays: Mapping[str, Any]) -> CountsTable:
    t_ns = (
        foot_arrays["t_ns"] if foot_arrays["t_ns"] is not None else np.round(foot_arrays["t_s"] * 1e9).astype(np.int64)
    )
    optional = {name: foot_arrays[name] for name in ("seq", "status", "age_ms", "missing", "valid", "late", "repeated")}
    return CountsTable(t_ns, foot_arrays["counts"], **optional)


def write(path: Path, tables: Mapping[str, CountsTable]) -> None:
    """Write counts.npz, all or nothing; OSError if it cannot be written."""
    with unfinished(path) as beside, open(beside, "wb") as file:
        np.savez_compressed(file, **arrays(tables))  # type: ignore[arg-type]
