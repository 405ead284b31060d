"""CPU time to read the most expensive documents that the size limits permit.

    python -m benchmarks.decode.documents

The documents are as large as permitted and consist of many small items. Prints the CPU time of one reading, the least
of five; the target is less than 1 s.

Takes about half a minute.
"""

from __future__ import annotations

import json
import time

from benchmarks.decode.fuzz import seeds
from benchmarks.decode.fuzz.targets import TARGETS
from insole_daemon.documents import JSON_BYTES, YAML_BYTES
from insole_daemon.errors import InsoleError

ROUNDS = 5
EFFECTS, TAXELS = json.loads(seeds.calibration()[-1]), json.loads(seeds.calibration()[0])
ZERO = json.loads(seeds.zero()[0])


def filled(most_bytes: int, head: str, entry: str, tail: str) -> bytes:
    """As many entries as there is room for."""
    n = (most_bytes - len(head) - len(tail)) // (len(entry) + 1)
    return (head + ",".join([entry] * n) + tail).encode()


def filled_json(document: dict, key: str, entry: object) -> bytes:
    """`document` with as many entries in the list `key` as there is room for."""
    rest = json.dumps({name: value for name, value in document.items() if name != key})
    return filled(JSON_BYTES, f'{rest[:-1]}, "{key}": [', json.dumps(entry, separators=(",", ":")), "]}")


DOCUMENTS = {
    "YAML, empty lists": ("config-yaml", filled(YAML_BYTES, "x: [", "[]", "]")),
    "YAML, lists of a number": ("config-yaml", filled(YAML_BYTES, "x: [", "[1]", "]")),
    "YAML, numbers": ("config-yaml", filled(YAML_BYTES, "x: [", "1", "]")),
    "YAML, nothing": ("config-yaml", filled(YAML_BYTES, "x: [", "~", "]")),
    "YAML, empty maps": ("config-yaml", filled(YAML_BYTES, "format: insole-config/1\ninsoles: [", "{}", "]")),
    "JSON, empty lists": ("calibration-json", filled(JSON_BYTES, "[", "[]", "]")),
    "JSON, empty taxels": ("calibration-json", filled_json(TAXELS, "taxels", {})),
    "JSON, taxels": ("calibration-json", filled_json(TAXELS, "taxels", TAXELS["taxels"][1])),
    "JSON, lags": ("calibration-json", filled_json(EFFECTS, "effects", EFFECTS["effects"][0])),
    "JSON, hysteresis": ("calibration-json", filled_json(EFFECTS, "effects", EFFECTS["effects"][1])),
    "JSON, taxels of a zero": ("zero-json", filled_json(ZERO, "taxels", ZERO["taxels"][0])),
}


def cpu_s(target: str, data: bytes) -> float:
    """Of reading `data` once."""
    began = time.process_time()
    try:
        TARGETS[target].take(data)
    except InsoleError:
        pass
    return time.process_time() - began


def main() -> None:
    for name, (target, data) in DOCUMENTS.items():
        took_s = min(cpu_s(target, data) for _ in range(ROUNDS))
        print(f"{name:26} {len(data) / 1e6:.2f} MB  {took_s:.3f} s of CPU", flush=True)


if __name__ == "__main__":
    main()
