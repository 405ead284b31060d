"""The doctor: why it does not work, or will not, with the remedy of each finding.

One file for each thing that is looked at. Nothing is changed: no interface is set up, no adapter opened, no file
written. Boards are asked what they are by the running daemon, if it may.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from . import boards, can, files, host, network
from .finding import CheckResult

__all__ = ["CheckResult", "examine"]


def examine(config_file: Path | None) -> Iterator[CheckResult]:
    """Everything there is to say about running a daemon here with this configuration, as it is found."""
    clock = host.ClockWatch()
    settings, found = files.check_configuration(config_file)
    yield from found
    yield from host.check_receive_buffer()
    if settings is None:
        yield from clock.findings()
        return
    if any(bus.driver == "socketcan" for bus in settings.buses):
        yield from can.check_kernel()
    for bus in settings.buses:
        yield from can.check_interface(bus, settings.boards.configure)
    daemon, found = network.check_daemon(settings)
    yield from found
    yield from network.check_connects(settings)
    yield from network.check_exposure(settings)
    with boards.Running(settings, daemon, config_file) as running:
        for insole in settings.insoles:
            yield from files.check_foot(insole, settings.rig, running.meta(insole.foot))
        if daemon is None:
            yield from host.check_state_folder()
        yield from running.findings()
    yield from clock.findings()
