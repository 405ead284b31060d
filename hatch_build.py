"""Builds the compiled kernel into the package if there is a C compiler with Python's headers.

Hatchling calls it for every wheel, editable ones too; by hand: `python hatch_build.py`. Without a compiler the package
is complete as well: the daemon then computes with numpy alone, at some more CPU time for the same results.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path
from typing import Any

try:
    from hatchling.builders.hooks.plugin.interface import BuildHookInterface
except ImportError:  # by hand, where hatchling is not installed
    BuildHookInterface = object  # type: ignore[assignment,misc]

SOURCE = Path(__file__).resolve().parent / "insole_daemon" / "kernel.c"
TARGET = SOURCE.with_name("_kernel.abi3.so")
# No contraction of a product and a sum into one step: the results would differ from numpy's in their last bit.
OPTIONS = ["-O2", "-std=c11", "-Wall", "-ffp-contract=off", "-shared", "-fPIC"]


def build() -> str | None:
    """Compile the kernel beside its source; None, or why it is left out."""
    TARGET.unlink(missing_ok=True)
    compiler = os.environ.get("CC") or shutil.which("cc") or shutil.which("gcc")
    headers = Path(sysconfig.get_path("include"))
    if compiler is None:
        return "there is no C compiler (cc)"
    if not (headers / "Python.h").exists():
        return f"Python's headers are not in {headers}"
    unfinished = TARGET.with_name(f"_kernel.{os.getpid()}.so")
    command = [compiler, *OPTIONS, f"-I{headers}", str(SOURCE), "-o", str(unfinished), "-lm"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            return f"{' '.join(command)} failed: {done.stderr.strip()}"
        unfinished.replace(TARGET)  # never written to where a process has it mapped
    except OSError as error:
        return f"{compiler} cannot be run: {error}"
    finally:
        unfinished.unlink(missing_ok=True)
    return None


class KernelHook(BuildHookInterface):
    """Adds the kernel to the wheel."""

    PLUGIN_NAME = "custom"

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Called by hatchling before it gathers the files."""
        why = build()
        if why is not None:
            print(f"insole-daemon is built without its compiled kernel: {why}", file=sys.stderr)
            return
        build_data["artifacts"].append(f"/insole_daemon/{TARGET.name}")
        build_data["pure_python"] = False
        platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
        build_data["tag"] = f"cp311-abi3-{platform}"


if __name__ == "__main__":
    sys.exit(build())
