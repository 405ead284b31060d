#!/usr/bin/env python3
"""Run a command on a kernel that has vcan, whatever kernel this machine has.

Boots User Mode Linux, a Linux kernel that is an ordinary process and needs no privilege, on the files of
this machine (hostfs, read-only), makes vcan0, runs the command and ends with the command's exit status.

    tests/vcan/uml.py [--timeout SECONDS] [--memory SIZE] -- COMMAND...
"""

from __future__ import annotations

import argparse
import contextlib
import os
import select
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

KERNEL = "linux.uml"
MODULES = Path("/usr/lib/uml/modules")
WHOLE_XSTATE = Path(__file__).with_name("whole_xstate.c")
PACKAGES = "user-mode-linux kmod iproute2"
# CAN, and what else tests need, in the order they need each other. A newer package may compress them (.ko.xz).
MODULE_FILES = (
    "net/can/can.ko*",
    "net/can/can-raw.ko*",
    "drivers/net/can/dev/can-dev.ko*",
    "drivers/net/can/vcan.ko*",
    "drivers/net/veth.ko*",  # a cable between two networks
)
SYSTEM_PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"

TIMED_OUT = 124  # as timeout(1)

# The console also carries the kernel's own words; these two bytes frame the command's.
BEGIN, END = b"\x02", b"\x03"

INIT = """\
#!/bin/sh
mount -t proc proc /proc
mount -t sysfs sysfs /sys
mountpoint -q /dev || mount -t devtmpfs dev /dev
mkdir -p /dev/shm && mount -t tmpfs shm /dev/shm   # Zenoh opens it
mount -t tmpfs run /run
mount -t hostfs -o {scratch} none {scratch}        # the only place that can be written
stty -onlcr
{environment}
vcan() {{
    {insmod}
    ip link set lo up &&
    ip link add dev vcan0 type vcan &&
    ip link set vcan0 up
}}
if vcan && cd {cwd}; then
    printf '\\002'
    {command} </dev/null
    echo $? >{scratch}/status   # the kernel's own exit status says nothing
    printf '\\003'
fi
{python} -c 'import ctypes; ctypes.CDLL(None).reboot(0x4321FEDC)'
"""


class UmlError(Exception):
    """The kernel cannot be booted; the message says what is missing."""


def boot(
    command: Sequence[str],
    *,
    cwd: Path | None = None,
    env: Mapping[str, str] | None = None,
    timeout_s: float = 600.0,
    memory: str = "1G",
) -> int:
    """Run `command` on a kernel with an interface vcan0, its output shown as it comes; its exit status.

    Inside, everything is read-only but TMPDIR, which is gone afterwards.
    """
    if not shutil.which(KERNEL):
        raise UmlError(
            f"expected the User Mode Linux kernel {KERNEL}, found none; on Debian (amd64, i386): "
            f"apt-get install {PACKAGES}"
        )
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))  # a cancelled CI job: kill the kernel too
    with tempfile.TemporaryDirectory(prefix="insole-uml-") as scratch:
        environment = {**(os.environ if env is None else env), "TMPDIR": scratch}
        environment["PATH"] = environment.get("PATH", "") + ":" + SYSTEM_PATH  # insmod and ip are in sbin
        init = Path(scratch, "init")
        init.write_text(init_script(command, cwd or Path.cwd(), environment, scratch))
        init.chmod(0o700)
        finished, console = run_kernel(init, memory, timeout_s)
        status = Path(scratch, "status")
        if status.exists():
            return int(status.read_text())
    if not finished:
        print(f"uml: killed after {timeout_s:g} s", file=sys.stderr)
        return TIMED_OUT
    raise UmlError("the kernel ended without an exit status of the command; at first it said:\n" + console)


def init_script(command: Sequence[str], cwd: Path, environment: Mapping[str, str], scratch: str) -> str:
    """The first process of that kernel."""
    exports = (f"export {name}={shlex.quote(value)}" for name, value in environment.items() if name.isidentifier())
    return INIT.format(
        scratch=shlex.quote(scratch),
        environment="\n".join(exports),
        insmod="\n    ".join(f"insmod {shlex.quote(str(module))} &&" for module in module_files()),
        cwd=shlex.quote(str(cwd)),
        command=shlex.join(command),
        python=shlex.quote(sys.executable),
    )


def module_files() -> list[Path]:
    """The CAN modules of the kernel that will boot."""
    version = subprocess.run([KERNEL, "--version"], capture_output=True, text=True, check=True).stdout.strip()
    files = []
    for pattern in MODULE_FILES:
        match = sorted((MODULES / version / "kernel").glob(pattern))
        if not match:
            raise UmlError(
                f"expected the module {pattern} under {MODULES / version}, found none; reinstall: {PACKAGES}"
            )
        files.append(match[0])
    return files


def run_kernel(init: Path, memory: str, timeout_s: float) -> tuple[bool, str]:
    """Boot and pass the command's output on; whether it halted in time, and what the console said before."""
    arguments = [KERNEL, "rootfstype=hostfs", "rootflags=/", "ro", f"mem={memory}", f"init={init}"]
    arguments += [f"uml_dir={init.parent}", "con=null", "con0=fd:0,fd:1", "quiet"]
    kernel = subprocess.Popen(
        arguments,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env={**os.environ, "TMPDIR": memory_folder(init.parent), **preloaded(init.parent)},
        start_new_session=True,  # its processes are killed together
    )
    try:
        return pass_on(kernel, time.monotonic() + timeout_s)
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(kernel.pid, signal.SIGKILL)
        kernel.wait()


def preloaded(folder: Path) -> dict[str, str]:
    """The environment that User Mode Linux needs on this processor; what it preloads is built in `folder`."""
    if " amx_tile" not in Path("/proc/cpuinfo").read_text():
        return {}
    library = folder / "whole_xstate.so"
    command = ["gcc", "-shared", "-fPIC", "-O1", "-o", str(library), str(WHOLE_XSTATE)]
    try:
        subprocess.run(command, capture_output=True, text=True, check=True)
    except FileNotFoundError as error:
        raise UmlError("a processor with AMX needs a C compiler for User Mode Linux: apt install gcc") from error
    except subprocess.CalledProcessError as error:
        raise UmlError(f"{WHOLE_XSTATE.name} cannot be compiled:\n{error.stderr}") from error
    return {"LD_PRELOAD": str(library)}


def pass_on(kernel: subprocess.Popen[bytes], deadline: float) -> tuple[bool, str]:
    """Write to stdout what comes between BEGIN and END; return what came before, for when nothing does."""
    assert kernel.stdout is not None
    console = bytearray()
    begun = ended = False
    while select.select([kernel.stdout], [], [], max(0.0, deadline - time.monotonic()))[0]:
        chunk = os.read(kernel.stdout.fileno(), 65536)
        if not chunk:
            return True, console.decode(errors="replace")
        if not begun:
            before, mark, chunk = chunk.partition(BEGIN)
            console += before
            begun = bool(mark)
        if begun and not ended:
            output, mark, _ = chunk.partition(END)
            ended = bool(mark)
            sys.stdout.buffer.write(output)
            sys.stdout.buffer.flush()
    return False, console.decode(errors="replace")


def memory_folder(fallback: Path) -> str:
    """Where that kernel's memory is mapped from: RAM, but a container's /dev/shm is often only 64 MB."""
    with contextlib.suppress(OSError):
        space = os.statvfs("/dev/shm")
        if space.f_bavail * space.f_frsize > 2 << 30:
            return "/dev/shm"
    return str(fallback)


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="Run a command on a kernel that has vcan (User Mode Linux).")
    parser.add_argument("--timeout", type=float, default=600.0, metavar="SECONDS", help="kill it then (600)")
    parser.add_argument("--memory", default="1G", metavar="SIZE", help="memory of that kernel (1G)")
    parser.add_argument("command", nargs="+", help="what to run, after --")
    options = parser.parse_args()
    try:
        return boot(options.command, timeout_s=options.timeout, memory=options.memory)
    except UmlError as error:
        print(f"uml: {error}", file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main())
