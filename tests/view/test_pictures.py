"""The page as pictures: what the README shows, of a simulated walk with its truth beside.

SCREENSHOTS=docs python3 bootstrap.py test tests/view/test_pictures.py
"""

from __future__ import annotations

import io
import os
import threading
from pathlib import Path

import pytest
from PIL import Image

from insole_daemon.cli.demo_page import tell_truth
from insole_daemon.config import Config
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.foot import Walk
from insole_daemon.wire.session import open_session

PICTURES = [
    ("page", "light", 1440, 900, False),
    ("page-dark", "dark", 1440, 900, False),
    ("page-phone", "dark", 390, 844, True),
]
LARGEST_BYTES = 200_000
LAYOUTS = [load_layout(insole) for insole in Config().insoles]


@pytest.fixture(scope="module")
def walk(live_daemon):
    """Somebody walks, and what really presses is published."""
    person, stop = Walk(LAYOUTS), threading.Event()
    with (
        live_daemon.boards(load=lambda layouts: person) as emulator,
        open_session("client", [], [live_daemon.endpoint]) as session,
    ):
        thread = threading.Thread(target=tell_truth, args=(session, emulator, person, LAYOUTS, stop))
        thread.start()
        yield
        stop.set()
        thread.join()


@pytest.mark.parametrize(("name", "scheme", "width", "height", "phone"), PICTURES, ids=[name for name, *_ in PICTURES])
def test_picture(walk, browser, page, tmp_path, name, scheme, width, height, phone):
    cdp = browser.driver.execute_cdp_cmd
    cdp("Emulation.setEmulatedMedia", {"features": [{"name": "prefers-color-scheme", "value": scheme}]})
    cdp("Emulation.setDeviceMetricsOverride", {
        "width": width, "height": height, "deviceScaleFactor": 2 if phone else 1, "mobile": phone,
    })  # fmt: skip
    try:
        browser.open(page)
        seconds = 10 if os.environ.get("SCREENSHOTS") else 1  # a picture to show has its courses filled
        browser.until("return window.insole.history.live.left.length > arguments[0] * 50", seconds)
        browser.until("return document.querySelector('#lines').textContent.includes('reference')")
        # Both feet on the ground: each has its heel or its forefoot to show.
        browser.until("const {left, right} = window.insole.history.live; "
                      "if (left.at(-1).fz < 200 || right.at(-1).fz < 200) return false; "
                      "document.querySelector('#pause').click(); return true")  # fmt: skip
        browser.js("return new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
        file = Path(os.environ.get("SCREENSHOTS", tmp_path)) / f"{name}.png"
        picture = Image.open(io.BytesIO(browser.driver.get_screenshot_as_png())).convert("RGB")
        picture.quantize(256, Image.Quantize.FASTOCTREE).save(file, optimize=True)  # a third of the bytes
    finally:
        cdp("Emulation.clearDeviceMetricsOverride", {})
        cdp("Emulation.setEmulatedMedia", {"features": []})
    assert 20_000 < file.stat().st_size <= LARGEST_BYTES
