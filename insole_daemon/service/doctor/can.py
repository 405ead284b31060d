"""Checks of CAN: support by the kernel; state, bit rate and permission of every interface."""

from __future__ import annotations

import errno
import json
import os
import shutil
import socket
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ...config import Bus
from ...skin.bus_load import BIT_RATE_HZ
from .finding import CheckResult, ok, problem, warning

_TYPE_CAN = "280"  # ARPHRD_CAN of linux/if_arp.h
_FLAG_UP = 1  # IFF_UP
_NETS = Path("/sys/class/net")


def check_kernel() -> Iterator[CheckResult]:
    """Check that the kernel has raw CAN sockets."""
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError as error:
        if error.errno in (errno.EPERM, errno.EACCES):
            yield _forbidden("kernel")
        else:
            yield problem("kernel", f"it has no raw CAN sockets ({error.strerror})", module_remedy(os.uname().release))
        return
    yield ok("kernel", "CAN and raw CAN sockets are there")


def module_remedy(release: str, modules: Path = Path("/lib/modules")) -> str:
    """Return the command that gives this kernel raw CAN sockets."""
    names = ("modules.dep", "modules.builtin")
    for name in names:
        try:
            if "/can-raw.ko" in (modules / release / name).read_text():
                return "sudo modprobe can-raw"
        except OSError:
            pass
    if not (modules / release).exists():
        return "sudo modprobe can-raw   # on the host, if this is a container; else boot a kernel with CONFIG_CAN"
    return f"sudo apt install linux-modules-extra-{release} && sudo modprobe can-raw   # or a kernel with CONFIG_CAN"


def check_interface(bus: Bus, configure: bool) -> Iterator[CheckResult]:
    """Check one bus of the configuration; `configure`: commands to boards are sent on it."""
    if bus.driver != "socketcan":
        yield from _driver(bus)
        return
    folder = _NETS / bus.channel
    if not folder.exists():
        yield problem(
            bus.channel,
            "there is no such interface: is the adapter plugged in, and its driver loaded?",
            "ip -brief link show type can   # lists those there are; name one under buses",
        )
        return
    if (folder / "type").read_text().strip() != _TYPE_CAN:
        yield problem(bus.channel, "is no CAN interface", "ip -brief link show type can   # lists those there are")
        return
    link = _link(bus.channel)
    yield from judge_interface(bus.channel, link if link is not None else _from_sysfs(folder), configure)
    yield from _permission(bus.channel)


def _link(name: str) -> dict[str, Any] | None:
    """Return the description of an interface by `ip`; None if it cannot be had."""
    program = shutil.which("ip", path=os.environ.get("PATH", os.defpath) + ":/usr/sbin:/sbin")
    if program is None:
        return None
    command = [program, "-json", "-details", "link", "show", "dev", name]
    done = subprocess.run(command, capture_output=True, text=True, timeout=10, check=False)
    try:
        link: dict[str, Any] = json.loads(done.stdout)[0]
    except (ValueError, LookupError):
        return None
    return link


def _from_sysfs(folder: Path) -> dict[str, Any]:
    """Return the part of that description that is in /sys."""
    up = int((folder / "flags").read_text(), 16) & _FLAG_UP
    return {"flags": ["UP"] if up else []}


def judge_interface(name: str, link: dict[str, Any], configure: bool) -> Iterator[CheckResult]:
    """Check an interface by `link`, its description by `ip -json -details link show`."""
    info = link.get("linkinfo", {})
    data = info.get("info_data", {})
    kind = info.get("info_kind")
    virtual = kind in ("vcan", "vxcan")
    up = f"sudo ip link set {name} up" + ("" if virtual else f" type can bitrate {BIT_RATE_HZ}")
    again = f"sudo ip link set {name} down && {up}"
    if "UP" not in link.get("flags", []):
        yield problem(name, "is down", up)
        return
    if virtual:
        yield ok(name, f"is up (virtual, {kind})")
        return
    if kind is None:
        yield warning(
            name,
            "is up; state and bit rate are not known without the program ip",
            "sudo apt install iproute2",
        )
        return
    bit_rate_hz = data.get("bittiming", {}).get("bitrate", data.get("bittiming_bitrate", 0))
    state = data.get("state", "UNKNOWN")
    if bit_rate_hz != BIT_RATE_HZ:
        yield problem(name, f"runs at {bit_rate_hz} bit/s, expected {BIT_RATE_HZ}", again)
    if state == "BUS-OFF":
        yield problem(
            name,
            "is bus-off: it gave up after too many errors; check wiring and termination",
            f"{again} restart-ms 100",
        )
    elif state in ("ERROR-WARNING", "ERROR-PASSIVE"):
        yield warning(
            name,
            f"is {state}: frames are destroyed or not acknowledged; check wiring, 120 Ω at both ends, power of boards",
            f"ip -details -statistics link show {name}",
        )
    if configure and "LISTEN-ONLY" in data.get("ctrlmode", []):
        yield problem(
            name, "only listens, but the configuration says boards: {configure: true}", f"{again} listen-only off"
        )
    if not data.get("restart_ms") and state != "BUS-OFF":
        yield warning(
            name, "stays off after a short circuit on the bus (restart-ms is 0)", f"{again} restart-ms 100"
        )  # fmt: skip
    if bit_rate_hz == BIT_RATE_HZ and state == "ERROR-ACTIVE":
        yield ok(name, f"is up at {bit_rate_hz} bit/s")


def _permission(name: str) -> Iterator[CheckResult]:
    """Check that this user may read the interface; the kernel requires no privilege, but a sandbox may."""
    try:
        with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as sock:
            sock.bind((name,))
    except OSError as error:
        if error.errno in (errno.EPERM, errno.EACCES):
            yield _forbidden(name)
        else:
            yield problem(name, f"cannot be opened: {error.strerror}", f"ip -details link show {name}")


def _forbidden(subject: str) -> CheckResult:
    return problem(
        subject,
        "this user may not open a raw CAN socket, which needs no privilege: a sandbox forbids it",
        "systemd: RestrictAddressFamilies=AF_CAN …   container: --network host and no seccomp rule against AF_CAN",
    )


def _driver(bus: Bus) -> Iterator[CheckResult]:
    """Check a driver of python-can; the adapter is not opened, which would take it from a running daemon."""
    import importlib

    from can.interfaces import BACKENDS

    if bus.driver not in BACKENDS:
        known = ", ".join(sorted(BACKENDS))
        yield problem(str(bus), f"python-can has no driver {bus.driver!r}", f"buses: one of {known}, as driver:channel")
        return
    try:
        importlib.import_module(BACKENDS[bus.driver][0])
    except Exception as error:  # drivers raise whatever their vendor's library does
        yield problem(str(bus), f"its driver cannot be loaded: {error}", f"pip install 'python-can[{bus.driver}]'")
        return
    if bus.driver == "virtual":
        yield warning(str(bus), "exists only within one process: a daemon reads nothing from it", "insole demo")
    else:
        yield ok(str(bus), "its driver is there; whether the adapter answers, only the daemon finds out")
