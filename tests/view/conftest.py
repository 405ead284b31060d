"""A server of the page as a process, and a headless Chromium that a test drives as a person would."""

from __future__ import annotations

import contextlib
import os
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from selenium import webdriver
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.by import By

from tests.conftest import PATIENCE_S, RunningDaemon
from tests.ports import free_port

INSOLE = Path(sys.executable).with_name("insole")


class Browser:
    """One window."""

    def __init__(self, width: int = 1400, height: int = 900) -> None:
        options = webdriver.ChromeOptions()
        options.binary_location = shutil.which("chromium") or ""
        for flag in (
            "--headless=new", "--disable-gpu", "--disable-dev-shm-usage", "--hide-scrollbars",
            "--force-color-profile=srgb", f"--window-size={width},{height}",
            *(("--no-sandbox",) if os.geteuid() == 0 else ()),
        ):  # fmt: skip
            options.add_argument(flag)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
        self.driver = webdriver.Chrome(options, Service(shutil.which("chromedriver")))

    def open(self, url: str) -> None:
        self.driver.get(url)

    def js(self, body: str, *arguments: Any) -> Any:
        return self.driver.execute_script(body, *arguments)

    def until(self, body: str, *arguments: Any) -> Any:
        """What `body` returns once it is true."""
        end = time.monotonic() + PATIENCE_S
        while not (value := self.js(body, *arguments)):
            assert time.monotonic() < end, f"it never became true: {body}"
            time.sleep(0.05)
        return value

    def find(self, selector: str) -> Any:
        return self.driver.find_element(By.CSS_SELECTOR, selector)

    def click(self, selector: str) -> None:
        self.find(selector).click()

    def complaints(self) -> list[str]:
        """Errors since it was last asked, as of the security policy; but not that a server was gone on purpose."""
        messages = [entry["message"] for entry in self.driver.get_log("browser") if entry["level"] == "SEVERE"]
        return [text for text in messages if "ERR_CONNECTION_REFUSED" not in text]


@pytest.fixture(scope="session")
def chromium() -> Iterator[Browser]:
    """Started once: that takes longer than most tests."""
    if not os.environ.get("CI") and (shutil.which("chromium") is None or shutil.which("chromedriver") is None):
        pytest.skip("needs Debian's chromium and chromium-driver: apt install chromium chromium-driver")
    browser = Browser()
    yield browser
    browser.driver.quit()


@pytest.fixture
def browser(chromium: Browser) -> Iterator[Browser]:
    chromium.driver.set_window_size(1400, 900)
    chromium.driver.get_log("browser")
    yield chromium
    chromium.open("about:blank")
    assert chromium.complaints() == []


Serve = Callable[..., str]


@pytest.fixture(scope="module")
def live_daemon(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningDaemon]:
    """A daemon for the tests of a module."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    config_file = tmp_path_factory.mktemp("daemon") / "config.yaml"
    config_file.write_text(f"format: insole-config/1\nrig: demo\nzenoh:\n  listen: [{endpoint}]\n")
    running = RunningDaemon(config_file, endpoint, free_port(socket.SOCK_DGRAM))
    running.start()
    yield running
    running.end()


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the page's recordings go."""
    return tmp_path_factory.mktemp("recordings")


@pytest.fixture(scope="module")
def serve(recordings: Path) -> Iterator[Serve]:
    """Starts `insole view` on a free port with further options; its address, as it prints it."""
    with contextlib.ExitStack() as ending:

        def start(endpoint: str, *options: str) -> str:
            process = subprocess.Popen(
                [INSOLE, "view", "--port", str(free_port()), "--connect", endpoint,
                 "--recordings", str(recordings), *options],
                stderr=subprocess.PIPE, text=True,
            )  # fmt: skip
            ending.callback(_end, process)
            assert process.stderr is not None
            line = process.stderr.readline()
            assert "the page is on" in line, line + process.stderr.read()
            return line.split("the page is on ")[1].split()[0]

        yield start


@pytest.fixture(scope="module")
def page(live_daemon: RunningDaemon, serve: Serve) -> str:
    """The address of a server on loopback."""
    return serve(live_daemon.endpoint)


def _end(process: subprocess.Popen[str]) -> None:
    process.terminate()
    assert process.wait(10) == 0
    assert process.stderr is not None
    process.stderr.close()
