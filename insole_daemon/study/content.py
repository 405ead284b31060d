"""Digests of what a result depends on: the recording, the calibrations, the mass and the program."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Sequence
from pathlib import Path

from ..documents import read
from ..errors import InsoleError
from ..recording.document import FILE, FORMAT, Document

_KEY_DIGITS = 16
_OF_RECORDINGS = (".yaml", ".log", ".gz", ".zst", ".csv", ".json", ".npz")  # not a report.html that is in the folder
_COMPILED = (".pyc", ".so", ".c")  # the kernel computes the same as the Python code beside its calls


@functools.cache  # a process goes on with the code that it has imported
def program_digest() -> str:
    """Return a digest of this package's files; a clone changes its code without changing its version."""
    package = Path(__file__).parents[1]
    files = sorted(path for path in package.rglob("*") if path.is_file() and path.suffix not in _COMPILED)
    return _digest("", [(path.relative_to(package).as_posix(), path) for path in files])


def content_key(folder: Path, parameters: str, others: Sequence[Path]) -> str:
    """Return a digest of the recording in `folder`, of `parameters` and of `others`; InsoleError: there is no folder.

    It covers every file that recording.yaml names, wherever it is and whatever its name ends with.
    """
    if not folder.is_dir():
        raise InsoleError(f"{folder}: there is no such folder; check its line in study.yaml")
    inside = sorted(path for path in folder.iterdir() if path.is_file() and path.suffix in _OF_RECORDINGS)
    files = dict.fromkeys([*inside, *_named_files(folder), *others])
    return _digest(f"{program_digest()} {parameters}", [(path.name, path) for path in files])[:_KEY_DIGITS]


def _named_files(folder: Path) -> list[Path]:
    """Return the files that recording.yaml names and that exist; none if it is invalid, which loading reports."""
    try:
        document = read(folder / FILE, Document, FORMAT)
    except InsoleError:
        return []
    return [
        file for path in document.files for file in (sorted(path.rglob("*")) if path.is_dir() else [path])
        if file.is_file()
    ]  # fmt: skip


def _digest(start: str, files: Sequence[tuple[str, Path]]) -> str:
    digest = hashlib.sha256(start.encode())
    for name, path in files:
        content = path.read_bytes()
        digest.update(f"{name} {len(content)}\n".encode())
        digest.update(content)
    return digest.hexdigest()
