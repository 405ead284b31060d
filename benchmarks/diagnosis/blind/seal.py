"""The seal: a salted SHA-256 of the truth and of the digests of all files, printed before a case can be seen."""

import hashlib
import json
import secrets
from pathlib import Path
from typing import Any

TRUTH, SEAL = "truth.json", "seal.json"


def document(value: Any) -> bytes:
    """Canonical JSON of the truth, as bytes."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), default=float).encode()


def digest(salt: str, truth: bytes) -> str:
    """SHA-256 of salt and truth, in hexadecimal."""
    return hashlib.sha256(salt.encode() + truth).hexdigest()


def digests(folder: Path) -> dict[str, str]:
    """SHA-256 of every file under `folder`, by its path in it."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def close(sealed: Path, cases: dict[str, Any], description: dict[str, Any]) -> str:
    """Write truth and salt into `sealed`; return the seal."""
    truth = document({"about": description, "cases": cases})
    salt = secrets.token_hex(16)
    (sealed / TRUTH).write_bytes(truth)
    (sealed / SEAL).write_text(json.dumps({"salt": salt, "sha256": digest(salt, truth)}) + "\n")
    return digest(salt, truth)


class BrokenSealError(Exception):
    """The truth or a sealed file differs from what was sealed."""


def open_(sealed: Path, seal_sha256: str) -> dict[str, Any]:
    """Read the truth; BrokenSealError if it or a sealed file does not match the seal."""
    truth = (sealed / TRUTH).read_bytes()
    salt = json.loads((sealed / SEAL).read_text())["salt"]
    actual = digest(salt, truth)
    if actual != seal_sha256:
        raise BrokenSealError(
            f"{sealed / TRUTH}: expected the truth sealed as {seal_sha256}, found one that gives {actual}"
        )
    content = json.loads(truth)
    for name, case in content["cases"].items():
        if (actual_digests := digests(sealed / name)) != case["kept_back"]:
            changed = sorted(set(actual_digests.items()) ^ set(case["kept_back"].items()))
            raise BrokenSealError(f"{sealed / name}: {changed[0][0]} is not what was sealed")
    return content
