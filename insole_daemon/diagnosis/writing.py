"""A diagnosis as the folder that `insole diagnose` leaves, all or nothing."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

from ..errors import FileError
from ..files import write_text
from .diagnosing import Diagnosis


def write(diagnosis: Diagnosis, out: Path) -> None:
    """Write diagnosis.json and model.json into the new folder `out`; FileError where that fails."""
    beside = out.with_name(f".{out.name}.{os.getpid()}")
    try:
        for name, content in (("diagnosis.json", diagnosis.document()), ("model.json", diagnosis.model)):
            write_text(beside / name, json.dumps(content, indent=1, ensure_ascii=False) + "\n")
        os.rename(beside, out)
    except OSError as error:
        raise FileError(f"{out}: cannot be written: {error.strerror or error}") from error
    finally:
        shutil.rmtree(beside, ignore_errors=True)
