"""Tests marked `vcan` need a kernel with vcan: skipped in the ordinary run, never under tests/vcan/run."""

from __future__ import annotations

import os
from collections.abc import Generator

import pytest

INTERFACE = os.environ.get("INSOLE_VCAN")  # set by tests/vcan/run


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    if INTERFACE:
        return
    skip = pytest.mark.skip(reason="needs a kernel with vcan; tests/vcan/run gives it one")
    for item in items:
        if item.get_closest_marker("vcan"):
            item.add_marker(skip)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    refuse_skip(report)
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    report = yield
    refuse_skip(report)
    return report


def refuse_skip(report: pytest.TestReport | pytest.CollectReport) -> None:
    """Under tests/vcan/run a skip would pass for a proof, so it fails."""
    if INTERFACE and report.outcome == "skipped" and not hasattr(report, "wasxfail"):
        report.outcome = "failed"
        report.longrepr = f"{report.nodeid} is skipped, which tests/vcan/run does not allow: {report.longrepr}"


@pytest.fixture
def vcan() -> str:
    """The name of the vcan interface."""
    assert INTERFACE, "without tests/vcan/run the test should have been skipped"
    return INTERFACE
