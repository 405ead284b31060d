"""The page as a person uses it, in a real browser: what its canvases show at known loads, and what its buttons do."""

from __future__ import annotations

import dataclasses
import re
import threading
import time

import numpy as np
import pytest
import yaml

import insole_daemon
from insole_daemon.simulation.faults import InjectedFault
from insole_daemon.skin.geometry import PRESSURE_TAXELS
from insole_daemon.wire.client import Client
from insole_daemon.wire.messages import Pressure, Wrench
from insole_daemon.wire.session import open_session
from tests.conftest import PATIENCE_S

PRESSED_PA = 200e3
# viridis and the diverging scale where the tests look, from their published tables.
VIRIDIS = {0.0: (68, 1, 84), 1 / 3: (49, 104, 142), 0.39: (42, 120, 142), 2 / 3: (53, 183, 121)}
SOLE = (232, 235, 239)  # of the style sheet, light
RED = (239, 138, 98)  # of the diverging scale, half way from 0 to its end


class Pressed:
    """`pressure_pa` on the forefoot (x from 150 mm on), nothing elsewhere."""

    def __init__(self, layouts, pressure_pa=PRESSED_PA):
        self._pressed = {
            layout.foot: pressure_pa * ((layout.xy_m[..., 0] > 0.15) & PRESSURE_TAXELS) for layout in layouts
        }

    def pressure_pa(self, foot, t_s):
        return np.broadcast_to(self._pressed[foot], (len(t_s), *self._pressed[foot].shape))


def unloaded(layouts):
    return Pressed(layouts, 0.0)


def look(browser, page):
    browser.open(page)
    browser.until("return window.insole.own.ready > 0")


def colour(browser, foot, x_mm, y_mm=0.0):
    """(r, g, b) of the map of `foot`, the mean of a few pixels around a place of it."""
    return np.array(
        browser.js(
            """const map = window.insole.maps[arguments[0]], [x, y] = map.at([arguments[1], arguments[2]]);
            const {data} = map.canvas.getContext("2d").getImageData(Math.round(x) - 2, Math.round(y) - 2, 5, 5);
            return [0, 1, 2].map((i) => data.filter((_, at) => at % 4 === i).reduce((a, b) => a + b) / 25);""",
            foot, x_mm, y_mm,
        )
    )  # fmt: skip


def becomes(browser, foot, wanted, x_mm, y_mm=0.0, within=22):
    """Wait until the map has that colour; sensors differ by some percent, and read to 8 kPa."""
    end = time.monotonic() + PATIENCE_S
    while np.abs(colour(browser, foot, x_mm, y_mm) - wanted).max() > within:
        shown = colour(browser, foot, x_mm, y_mm)
        assert time.monotonic() < end, f"{foot} at {x_mm}, {y_mm}: expected about {wanted}, found {shown}"
        time.sleep(0.1)


def text(browser, selector):
    return browser.js("return document.querySelector(arguments[0]).textContent", selector)


def scale_to(browser, most):
    browser.click(f"#range option[value='{most}']")


def choose(browser, quantity):
    browser.click(f"label:has([value={quantity}])")


def test_the_map_has_the_colours_of_a_known_load(browser, page, live_daemon):
    with live_daemon.boards(load=Pressed):
        look(browser, page)
        for foot in ("left", "right"):
            becomes(browser, foot, VIRIDIS[2 / 3], 205)
            becomes(browser, foot, VIRIDIS[0.0], 40, within=15)
        scale_to(browser, 600)
        becomes(browser, "left", VIRIDIS[1 / 3], 205)
        choose(browser, "counts")  # 8 kPa a count: 25 of 64
        becomes(browser, "left", VIRIDIS[0.39], 205, within=25)
        assert text(browser, "#scale-unit") == "counts below no-load"
        browser.click("#taxels")  # true taxels over a pale field
        x_mm, y_mm = browser.js("const {places} = window.insole.maps.left; return places.find(([x]) => x > 190)")
        becomes(browser, "left", VIRIDIS[0.39], x_mm, y_mm, within=40)
        browser.click("#taxels")


def test_the_scale_rises_to_the_peak_until_a_person_chooses_one(browser, page, live_daemon):
    with live_daemon.boards():  # a walk: some 600 kPa
        look(browser, page)
        browser.until("return Number(document.querySelector('#range').value) > 300")
        scale_to(browser, 100)
        peak = "return Math.max(...Object.values(window.insole.maps).flatMap((map) => [...(map.used ?? [])]))"
        browser.until(f"{peak} > 150")
        assert browser.js("return document.querySelector('#range').value") == "100"


def test_the_residual_is_measured_minus_simulated(browser, page, live_daemon):
    # Of one rig: a client of all rigs would receive what it publishes as a simulation, and publish it again.
    with live_daemon.boards(load=Pressed), Client(live_daemon.endpoint, rig="demo") as insole:
        look(browser, page)
        browser.find("body").send_keys("3")
        scale_to(browser, 200)
        becomes(browser, "left", SOLE, 205, within=3)  # nothing is simulated: nothing is drawn
        meta = insole.meta("left")
        simulated = np.where(meta.xy_m[..., 0] > 0.15, np.float32(PRESSED_PA - 100e3), np.float32(0))
        pressures = insole.pressures("left")
        with open_session("client", [], [live_daemon.endpoint]) as session:

            def simulate():  # apart from the browser, which is too slow to keep up with every cycle
                for measured in pressures:
                    put(session, dataclasses.replace(measured, pressure_pa=simulated))

            thread = threading.Thread(target=simulate)
            thread.start()
            try:
                becomes(browser, "left", RED, 205, within=35)
                becomes(browser, "left", (232, 232, 232), 40, within=25)  # where both are 0
            finally:
                pressures.close()
                thread.join()


def put(session, message):
    what = {Pressure: "pressure", Wrench: "wrench"}[type(message)]
    encoding = f"application/msgpack;{message.SCHEMA}"
    session.put(f"insole/simulation/{message.foot}/{what}", message.encode(), encoding=encoding)


def test_a_lost_board_is_hatched_and_named_and_comes_back(browser, page, live_daemon):
    silent = InjectedFault(kind="silent", t_s=5.0, until_s=14.0, board=5)
    with live_daemon.boards(load=Pressed, faults=[silent]):
        look(browser, page)
        becomes(browser, "left", VIRIDIS[2 / 3], 205)
        browser.until("return document.querySelector('#boards').textContent.includes('board 5 silent')")
        front = browser.js(
            """const {index, places, triangles} = window.insole.maps.left;
            return places.filter((_, k) => triangles[Math.floor(index[k] / 12)].board === 5)"""
        )
        shown = [colour(browser, "left", *place) for place in front[5:60:10]]
        assert all(np.abs(each - VIRIDIS[2 / 3]).max() > 40 for each in shown), "nothing of it looks like a pressure"
        assert all(np.abs(each - VIRIDIS[0.0]).max() > 40 for each in shown), "nor like none"
        assert "board 5" in text(browser, "#events")
        browser.until("return document.querySelector('#state').textContent.startsWith('degraded')")
        becomes(browser, "right", VIRIDIS[2 / 3], 205)
        browser.until("return document.querySelector('#state').textContent.startsWith('all boards stream')")
        becomes(browser, "left", VIRIDIS[2 / 3], 205)


def test_zero_is_taken_and_refused_in_words(browser, page, live_daemon):
    def zero():
        browser.click("#zero")
        browser.click("#zeroing [value=both]")
        return browser.until(
            "const note = document.querySelector('#note'); "
            "return !note.hidden && !note.textContent.startsWith('Keep still') && note.textContent"
        )

    with live_daemon.boards(load=unloaded):
        look(browser, page)
        browser.until("return document.querySelector('#state').textContent.startsWith('all boards stream')")
        assert re.search(r"left: zeroed 2\d\d taxels, .* right: zeroed 2\d\d taxels", zero())
    with live_daemon.boards(load=Pressed):
        look(browser, page)
        becomes(browser, "left", VIRIDIS[2 / 3], 205)
        assert "left: refused, nothing has changed" in zero()


def test_a_recording_with_its_marks_is_made_from_the_page(browser, page, live_daemon, recordings):
    with live_daemon.boards():
        look(browser, page)
        browser.click("#mark")
        browser.until("return document.querySelector('#note').textContent.includes('No recording is being made')")
        browser.click("#record")
        browser.until("return document.querySelector('#record').textContent === 'End recording'")
        browser.find("body").send_keys("m")
        browser.until("return document.querySelector('#note').textContent === 'Marked in the recording.'")
        time.sleep(1.0)
        browser.click("#record")
        browser.until("return document.querySelector('#record').textContent === 'Record'")
        browser.until("return document.querySelector('#note').textContent.startsWith('Recorded')")
    (folder,) = recordings.iterdir()
    recording = insole_daemon.load(folder)
    assert {foot.foot for foot in recording.feet} == {"left", "right"}
    assert len(recording["left"]) > 25
    (marker,) = yaml.safe_load((folder / "recording.yaml").read_text())["extensions"]["markers"]
    assert recording["left"].t_ns[0] - 2e9 < marker["t_ns"] < recording["left"].t_ns[-1] + 1e9


def test_a_refused_temperature_request_is_shown_with_its_reason(browser, page, live_daemon):
    with live_daemon.boards():
        look(browser, page)
        browser.click("#ask-temperature")
        span = "document.querySelector('#temperature span').textContent"
        reason = browser.until(f"return {span} !== 'asking …' && {span}")
        assert "nothing is sent to the boards" in reason, "unless it is configured"


PICTURE = "return window.insole.maps.left.canvas.toDataURL()"


def paint(browser):
    """Wait until a frame that was asked for before is painted."""
    browser.js("window.isPainted = false; "
               "requestAnimationFrame(() => requestAnimationFrame(() => { window.isPainted = true; }))")  # fmt: skip
    browser.until("return window.isPainted")


def test_a_pause_stands_still_and_is_looked_through_with_the_keyboard(browser, page, live_daemon):
    shown = "return window.insole.history.shown('left').seq"
    last_until = """const { cycles } = window.insole.history, end = window.insole.history.end();
        return cycles.left.filter((each) => each.t <= end - 1000 * arguments[0]).at(-1).seq"""
    with live_daemon.boards():
        look(browser, page)
        browser.until("return window.insole.history.live.left.length > 100")
        browser.find("body").send_keys(" ")
        assert text(browser, "#pause") == "Go on"
        first = browser.js(shown)
        newest = "return window.insole.history.live.left.at(-1).seq > arguments[0]"
        paint(browser)
        before = browser.js(PICTURE)
        browser.until(newest + " + 10", first)
        assert browser.js(PICTURE) == before
        for _ in range(5):
            browser.find("body").send_keys("\ue012")  # arrow left
        assert browser.js(shown) == browser.js(last_until, 0.1) < first
        browser.js("const scrub = document.querySelector('#scrub'); scrub.value = -1; "
                   "scrub.dispatchEvent(new Event('input'))")  # fmt: skip
        assert browser.js(shown) == browser.js(last_until, 1) < first
        browser.until("return document.querySelector('#ago').textContent === '−1.00 s'")
        browser.click("#pause")
        browser.until(shown + " > arguments[0] + 10", first)


def test_boards_that_go_silent_in_a_pause_leave_its_map_as_it_is(browser, page, live_daemon):
    with live_daemon.boards():
        look(browser, page)
        browser.until("return window.insole.history.live.left.length > 100")
        browser.find("body").send_keys(" ")
        assert text(browser, "#pause") == "Go on"
        paint(browser)
        before = browser.js(PICTURE)
    browser.until("return /silent/.test(document.querySelector('#boards').textContent)")
    paint(browser)
    assert browser.js(PICTURE) == before


def test_steps_and_a_reference_are_shown(browser, page, live_daemon):
    with live_daemon.boards(), open_session("client", [], [live_daemon.endpoint]) as session:
        look(browser, page)
        browser.until("return Number(document.querySelector('#figures td').textContent) > 80")  # cadence of the left
        end = time.monotonic() + PATIENCE_S
        while "reference" not in text(browser, "#lines"):
            session.put("reference/left", b'{"fz_n": 321.0, "mx_nm": 1.0, "my_nm": -20.0}')
            assert time.monotonic() < end
            time.sleep(0.02)
        assert browser.js("return window.insole.history.live.left.some((each) => each.refFz === 321)")
        assert browser.js("return window.insole.history.live.right.every((each) => Number.isNaN(each.refFz))")
        heel = browser.until(
            "const rows = [...document.querySelectorAll('#figures tr')].map((r) => r.textContent); "
            "const row = rows.find((r) => r.startsWith('heel')); return /\\d+ · \\d+/.test(row) && row"
        )
        assert 100 < int(re.search(r"(\d+) ·", heel).group(1)) < 1500


def test_a_reload_and_a_restart_of_the_daemon_are_survived_without_a_click(browser, page, live_daemon):
    with live_daemon.boards():
        look(browser, page)
        browser.driver.refresh()
        browser.until("return window.insole.own.ready > 0")
        live_daemon.end()
        browser.until("return document.querySelector('#state').textContent === 'no cycles come'")
        live_daemon.start()
        browser.until("return document.querySelector('#state').textContent.startsWith('all boards stream')")
        before = browser.js("return window.insole.own.cycles")
        browser.until("return window.insole.own.cycles > arguments[0] + 50", before)


def test_the_page_is_small_whole_and_its_own(browser, page, live_daemon):
    browser.driver.execute_cdp_cmd("Network.clearBrowserCache", {})
    with live_daemon.boards():
        look(browser, page)
        loaded = browser.js(
            "return performance.getEntries().filter((each) => each.transferSize !== undefined)"
            ".map(({name, transferSize}) => [name, transferSize])"
        )
    assert len(loaded) > 8
    assert all(name.startswith(page) for name, _ in loaded)
    assert 10e3 < sum(size for _, size in loaded) <= 150e3


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_words_can_be_read_in_light_and_dark(browser, page, live_daemon, scheme):
    """Contrast as WCAG 2 has it, 4.5 to 1; marks and lines 3 to 1."""
    look_at = [{"name": "prefers-color-scheme", "value": scheme}]
    browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": look_at})
    browser.open(page)
    colours = browser.until(  # the styles may come a moment after the page
        """const style = getComputedStyle(document.documentElement);
        const found = Object.fromEntries(
          ["ink", "soft", "card", "page", "accent", "on-accent", "alarm", "left", "right"]
            .map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
        return Object.values(found).every(Boolean) && found;"""
    )
    browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})

    def luminance(name):
        digits = colours[name].lstrip("#")
        digits = "".join(each * 2 for each in digits) if len(digits) == 3 else digits
        parts = np.array([int(digits[i : i + 2], 16) / 255 for i in (0, 2, 4)])
        return np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4) @ (0.2126, 0.7152, 0.0722)

    def contrast(one, other):
        low, high = sorted((luminance(one), luminance(other)))
        return (high + 0.05) / (low + 0.05)

    assert (luminance("ink") > luminance("card")) == (scheme == "dark")
    for one, other, least in [
        ("ink", "card", 7), ("ink", "page", 7), ("soft", "card", 4.5), ("on-accent", "accent", 4.5),
        ("alarm", "card", 3), ("left", "card", 3), ("right", "card", 3),
    ]:  # fmt: skip
        assert contrast(one, other) >= least, (one, other)


def test_everything_can_be_reached_with_the_keyboard_and_has_a_name(browser, page, live_daemon):
    look_for = "button, input, select, canvas"
    with live_daemon.boards():
        look(browser, page)
        nameless = browser.js(
            """return [...document.querySelectorAll(arguments[0])].filter((each) => !(each.textContent.trim()
              || each.getAttribute("aria-label") || each.labels?.length)).map((each) => each.outerHTML)""",
            look_for,
        )
        assert nameless == []
        reached = set()
        for _ in range(20):
            browser.driver.switch_to.active_element.send_keys("\ue004")  # tab
            reached.add(browser.js("const {id, name} = document.activeElement; return id || name"))
    assert {"zero", "mark", "record", "theme", "quantity", "taxels", "range", "pause", "mass"} <= reached


def test_a_phone_shows_all_of_it_without_scrolling_sideways(browser, page, live_daemon):
    metrics = {"width": 390, "height": 844, "deviceScaleFactor": 2, "mobile": True}
    browser.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    try:
        with live_daemon.boards():
            look(browser, page)
            assert browser.js("return document.documentElement.scrollWidth") <= 390
            width, height = browser.js("const box = window.insole.maps.left.canvas.getBoundingClientRect(); "
                                       "return [box.width, box.height]")  # fmt: skip
            assert width > 110
            assert height > 250
            assert browser.find("#map-left").location["y"] < 844 / 2, "the map is what is seen first"
    finally:
        browser.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


@pytest.mark.parametrize(("width", "height"), [(768, 1024), (1024, 768)])
def test_a_tablet_shows_the_map_large_and_wastes_no_room(width, height, browser, page, live_daemon):
    metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": True}
    browser.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    try:
        with live_daemon.boards():
            look(browser, page)
            assert browser.js("return document.documentElement.scrollWidth") <= width
            box = browser.js("return window.insole.maps.left.canvas.getBoundingClientRect().toJSON()")
            assert box["height"] > 0.4 * height
            assert box["bottom"] < height, "all of the map is seen at first"
            empty = browser.js(
                "const card = document.querySelector('#pressure').getBoundingClientRect();"
                "return card.bottom - document.querySelector('.time').getBoundingClientRect().bottom"
            )
            assert empty < 120
    finally:
        browser.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_a_page_that_lost_cycles_is_not_green_whatever_the_boards_do(browser, page, live_daemon):
    with live_daemon.boards():
        look(browser, page)
        browser.js(
            "const {history} = window.insole, last = history.live.left.at(-1);"
            "history.add({...last, seq: last.seq + 1001})"  # a thousand cycles between
        )
        browser.until("return document.querySelector('#state').textContent.includes('this page lost 1')")
        assert browser.js("return document.querySelector('#state').dataset.state") == "degraded"


def test_shortcuts_are_dead_behind_a_dialog_and_no_number_is_minus_zero(browser, page, live_daemon):
    with live_daemon.boards(load=unloaded):
        look(browser, page)
        browser.click("#zero")
        browser.until("return document.querySelector('#zeroing').open")
        browser.js("document.dispatchEvent(new KeyboardEvent('keydown', {key: 'p', bubbles: true}))")
        browser.js("document.body.dispatchEvent(new KeyboardEvent('keydown', {key: ' ', bubbles: true}))")
        assert browser.js("return document.querySelector('#pause').getAttribute('aria-pressed')") == "false"
        browser.js("document.querySelector('#zeroing').close('')")
        browser.js("document.body.dispatchEvent(new KeyboardEvent('keydown', {key: ' ', bubbles: true}))")
        assert browser.js("return document.querySelector('#pause').getAttribute('aria-pressed')") == "true"
    number = browser.driver.execute_async_script(
        "const done = arguments[0]; import('/panels.js').then(({number}) => done(number(-0.0004, 1, 1)))"
    )
    assert number == "0.0"
