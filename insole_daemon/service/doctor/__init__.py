"""The doctor: list setup problems and how to fix each.

Each subject has a file. Nothing is changed: no interface is configured, no adapter opened, no file written. A running
daemon asks its boards for their identity, if its configuration allows that.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from . import boards, can, files, host, network
from .finding import CheckResult

__all__ = ["CheckResult", "examine"]


def examine(config_file: Path | None) -> Iterator[CheckResult]:
    """Check this host and `config_file` for running a daemon, and yield each result as soon as it is known."""
    clock = host.ClockWatch()
    settings, results = files.check_configuration(config_file)
    yield from results
    yield from host.check_receive_buffer()
    if settings is None:
        yield from clock.findings()
        return
    if any(bus.driver == "socketcan" for bus in settings.buses):
        yield from can.check_kernel()
    for bus in settings.buses:
        yield from can.check_interface(bus, settings.boards.configure)
    daemon, results = network.check_daemon(settings)
    yield from results
    yield from network.check_connects(settings)
    yield from network.check_exposure(settings)
    with boards.Running(settings, daemon, config_file) as running:
        for insole in settings.insoles:
            yield from files.check_foot(insole, settings.rig, running.meta(insole.foot))
        if daemon is None:
            yield from host.check_state_folder()
        yield from running.findings()
    yield from clock.findings()
