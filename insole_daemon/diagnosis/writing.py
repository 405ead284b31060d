"""Write a diagnosis as the files of `insole diagnose`."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import Any

from ..errors import FileError
from ..files import write_text
from .reporting import wrench
from .result import Diagnosis

FILES = ("model.json", "report.html", "diagnosis.json")  # the last one is written after all others


def refuse_taken(out: Path) -> None:
    """Raise FileError if `out` is a file or a folder with a diagnosis."""
    if out.exists() and not out.is_dir():
        raise FileError(f"{out}: expected a folder, or nothing yet, found a file")
    present = [name for name in FILES if (out / name).exists()]
    if present:
        raise FileError(
            f"{out}: a diagnosis is already there ({', '.join(present)}); "
            "choose another name, or replace it with --force"
        )


def write(diagnosis: Diagnosis, out: Path) -> None:
    """Write FILES into `out`, all or none; raises FileError if that fails."""
    contents = dict(
        zip(FILES, (_json(diagnosis.model), wrench.html(diagnosis), _json(diagnosis.document())), strict=True)
    )
    try:
        for name in FILES:
            write_text(out / name, contents[name])
    except OSError as error:
        for name in FILES:
            with contextlib.suppress(OSError):
                (out / name).unlink(missing_ok=True)
        raise FileError(f"{out}: cannot be written: {error.strerror or error}") from error


def _json(content: Any) -> str:
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"
