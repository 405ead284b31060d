"""The seal: a salted SHA-256 of the truth and of every file handed out or kept back, printed before anybody looks."""

import hashlib
import json
import secrets
from pathlib import Path
from typing import Any

TRUTH, SEAL = "truth.json", "seal.json"


def document(value: Any) -> bytes:
    """The one way the truth is turned into bytes."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), default=float).encode()


def digest(salt: str, truth: bytes) -> str:
    return hashlib.sha256(salt.encode() + truth).hexdigest()


def digests(folder: Path) -> dict[str, str]:
    """SHA-256 of every file under `folder`, by its path in it."""
    found = sorted(p for p in folder.rglob("*") if p.is_file())
    return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in found}


def close(sealed: Path, cases: dict[str, Any], about: dict[str, Any]) -> str:
    """Writes truth and salt into `sealed`; returns the seal."""
    truth = document({"about": about, "cases": cases})
    salt = secrets.token_hex(16)
    (sealed / TRUTH).write_bytes(truth)
    (sealed / SEAL).write_text(json.dumps({"salt": salt, "sha256": digest(salt, truth)}) + "\n")
    return digest(salt, truth)


class BrokenSealError(Exception):
    """The truth is not the one that was sealed."""


def open_(sealed: Path, seal: str) -> dict[str, Any]:
    """The truth, if it is the one `seal` was printed for, and if what was kept back is what it was."""
    truth = (sealed / TRUTH).read_bytes()
    salt = json.loads((sealed / SEAL).read_text())["salt"]
    found = digest(salt, truth)
    if found != seal:
        raise BrokenSealError(f"{sealed / TRUTH}: expected the truth sealed as {seal}, found one that gives {found}")
    document_ = json.loads(truth)
    for name, case in document_["cases"].items():
        if (found_files := digests(sealed / name)) != case["kept_back"]:
            changed = sorted(set(found_files.items()) ^ set(case["kept_back"].items()))
            raise BrokenSealError(f"{sealed / name}: {changed[0][0]} is not what was sealed")
    return document_
