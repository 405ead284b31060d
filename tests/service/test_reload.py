"""SIGHUP while frames flow: the configuration is read again, and no cycle is lost over it."""

from __future__ import annotations

import contextlib
import itertools
import json
import signal
import socket
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import insole_daemon
from insole_daemon import config as configs
from insole_daemon.bus.recovering import RecoveringSource
from insole_daemon.config import Bus
from insole_daemon.errors import DocumentsError, InsoleError, WireError
from insole_daemon.mechanics.wrench import WrenchEstimator
from insole_daemon.physics import zero as zeros
from insole_daemon.physics.calibration import FORMAT
from insole_daemon.physics.dynamic import DynamicModel
from insole_daemon.physics.static_curve import StaticCurve
from insole_daemon.physics.zero import Zero
from insole_daemon.service import reload
from insole_daemon.service.daemon import Daemon
from insole_daemon.service.foot import Foot, load_feet
from insole_daemon.service.foot_pipeline import FootPipeline
from insole_daemon.service.foot_setup import FootSetup, load_setups
from insole_daemon.service.reload import Reloader, merge, read
from insole_daemon.service.state import zero_path
from insole_daemon.simulation.foot import Stand
from insole_daemon.skin.faults import FaultWatch
from insole_daemon.wire.client import Subscription
from insole_daemon.wire.session import open_session
from tests.conftest import PATIENCE_S

CONFIG = """\
format: insole-config/1
rig: test
insoles:
  - foot: left
    calibration: left.json
    boards: [{{address: 5, interface: can0}}, {{address: 6, interface: can0}}, {{address: 7, interface: can0}}]
contact: {{min_force_n: {min_force_n}}}
publish: {{stale_after_ms: {stale_after_ms}, rate_hz: {rate_hz}}}
zenoh:
  listen: [{endpoint}]
"""


def write(config_file: Path, endpoint: str, pa_per_count: float, **changes: float) -> None:
    """A configuration of the left foot, and its calibration."""
    values = {"min_force_n": 20, "stale_after_ms": 200, "rate_hz": 50} | changes
    config_file.write_text(CONFIG.format(endpoint=endpoint, **values))
    taxels = [
        {"board": board, "triangle": t, "taxel": i, "baseline_count": 240, "coefficients_pa": [0, pa_per_count]}
        for board, triangles in ((5, range(12)), (6, range(5)), (7, range(11)))
        for t in triangles
        for i in range(12)
        if i not in (6, 10)
    ]
    rows = {(t.board, t.triangle) for t in load_feet(configs.Config())[0].layout.triangles}
    taxels = [taxel for taxel in taxels if (taxel["board"], taxel["triangle"]) in rows]
    (config_file.parent / "left.json").write_text(json.dumps({"format": FORMAT, "foot": "left", "taxels": taxels}))


@pytest.fixture
def calibrated(daemon):
    """The daemon with a calibration from a file, 1000 Pa a count."""
    daemon.end()
    write(daemon.config_file, daemon.endpoint, 1000)
    daemon.start()
    return daemon


def next_of(events: Subscription, *kinds: str):
    return next(event for event in events if event.kind in kinds)


def test_a_new_calibration_counts_from_one_cycle_to_the_next(calibrated):
    with calibrated.boards(load=Stand), insole_daemon.connect(calibrated.endpoint) as insole:
        events, metas = insole.events("left"), insole.messages("insole/test/left/meta")
        raws, pressures = insole.raws("left"), insole.pressures("left")
        received = [*itertools.islice(pressures, 30)]
        write(calibrated.config_file, calibrated.endpoint, 3000, min_force_n=35)
        calibrated.process.send_signal(signal.SIGHUP)
        event = next_of(events, "reloaded", "reload_refused")
        received += itertools.takewhile(lambda pressure: pressure.t_published_ns <= event.t_ns, pressures)
        received += itertools.islice(pressures, 30)
        counts = {}
        while received[-1].seq not in counts:
            raw = next(raws)
            counts[raw.seq] = raw
        meta, calibration = insole.meta("left"), insole.calibration("left")
        republished = next(metas)
    assert event.kind == "reloaded"
    assert "calibration of the left foot" in event.text
    assert "contact.min_force_n" in event.text
    assert sorted(counts) == list(range(min(counts), max(counts) + 1))
    assert sum(pressure.lost for pressure in received) == 0
    factors = []
    for pressure in received:
        if pressure.seq in counts:
            activation = 240.0 - counts[pressure.seq].counts
            loaded = (counts[pressure.seq].valid == 1) & (activation > 1)
            if loaded.any():  # but for the first cycles
                factors.append(round(float(np.median(pressure.pressure_pa[loaded] / activation[loaded]))))
    assert len(factors) > 50
    assert set(factors) == {1000, 3000}
    assert factors == sorted(factors), "once, and never back"
    assert republished.min_force_n == 35
    assert meta.min_force_n == 35
    assert np.nanmax(calibration.coefficients_pa) == 3000


def test_a_wrong_file_changes_nothing_and_every_problem_is_reported(calibrated):
    with calibrated.boards(), insole_daemon.connect(calibrated.endpoint) as insole:
        events = insole.events("left")
        time.sleep(0.5)
        file = calibrated.config_file
        file.write_text(file.read_text().replace("min_force_n: 20", "min_force_n: many, slack_s: 1"))
        calibrated.process.send_signal(signal.SIGHUP)
        refused = next_of(events, "reloaded", "reload_refused")
        write(file, calibrated.endpoint, 1000)
        (file.parent / "left.json").write_text("{")
        calibrated.process.send_signal(signal.SIGHUP)
        refused_too = next_of(events, "reloaded", "reload_refused")
        assert insole.meta("left").min_force_n == 20
        assert len([w for w, _ in zip(insole.wrenches("left"), range(10), strict=False)]) == 10
    assert refused.kind == refused_too.kind == "reload_refused"
    assert "min_force_n" in refused.text
    assert "slack_s" in refused.text
    assert "line" in refused.text
    assert "left.json" in refused_too.text


def test_settings_that_need_a_restart_are_reported_and_the_others_applied(calibrated):
    with insole_daemon.connect(calibrated.endpoint) as insole:
        events = insole.events("left")
        time.sleep(0.3)
        write(calibrated.config_file, "tcp/127.0.0.1:1", 1000, rate_hz=40, stale_after_ms=150)
        calibrated.process.send_signal(signal.SIGHUP)
        reloaded, restart = next_of(events, "reloaded"), next_of(events, "restart_needed")
        meta = insole.meta("left")
    assert reloaded.text == "changed: publish.stale_after_ms"
    assert "zenoh" in restart.text
    assert "publish.rate_hz" in restart.text
    assert meta.stale_after_ms == 150
    assert meta.rate_hz == 50


def test_the_service_manager_is_notified_of_a_reload(calibrated, tmp_path):
    calibrated.end()
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.settimeout(PATIENCE_S)
        calibrated.environment = {"NOTIFY_SOCKET": str(tmp_path / "notify")}
        calibrated.start()
        calibrated.process.send_signal(signal.SIGHUP)
        notifications = [manager.recv(4096).decode()]
        while len(notifications) < 2 or "READY=1" not in notifications[-1]:
            notifications.append(manager.recv(4096).decode())
        calibrated.end()
    reloading = next(text for text in notifications if "RELOADING=1" in text)
    stamp_us = int(dict(line.split("=") for line in reloading.splitlines())["MONOTONIC_USEC"])
    assert abs(time.monotonic_ns() / 1000 - stamp_us) < 60e6
    assert notifications.index(reloading) < len(notifications) - 1


def test_boards_and_other_triangles_stay_until_a_restart(tmp_path):
    file = tmp_path / "config.yaml"
    write(file, "tcp/127.0.0.1:1", 1000)
    config, running = read(file)
    file.write_text(file.read_text().replace("address: 5,", "address: 5, shift: 2,"))
    reloaded = merge(running, *read(file))
    assert reloaded.needs_restart == ("insoles: left: boards",)
    assert reloaded.pipelines[0].setup.insole.boards[0].shift == config.insoles[0].boards[0].shift
    (tmp_path / "layout.yaml").write_text(
        "format: insole-layout/1\nfoot: left\ntaxel_area_mm2: 32.4\ntriangles:\n"
        "  - {board: 5, triangle: 0, patch: front, x_mm: 100, y_mm: 0, rotation_deg: 0, mirrored: false}\n"
    )
    write(file, "tcp/127.0.0.1:1", 1000)
    text = file.read_text()
    file.write_text(text.replace("calibration: left.json", "layout: layout.yaml"))
    reloaded = merge(running, *read(file))
    assert reloaded.needs_restart == ("insoles: left: a layout of other triangles",)
    assert reloaded.pipelines[0].setup.layout is running[0].layout
    file.write_text(text + "\nextensions: {}\n".lstrip("\n") + "# nothing new\n")
    reloaded = merge(running, *read(file))
    assert (reloaded.changed, reloaded.needs_restart) == ((), ())
    assert reloaded.events() == [("reloaded", "changed: nothing")]


def save_zero(path: Path, setup: FootSetup, baseline_count: float) -> None:
    baseline = np.where(setup.calibration.usable, baseline_count, np.nan)
    zeros.save(path, Zero("left", 1, baseline, np.where(np.isnan(baseline), np.nan, 1.0)), setup.layout)


@pytest.mark.parametrize("how", ["named", "stored"])
def test_a_zero_is_read_again(tmp_path, monkeypatch, how):
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    file = tmp_path / "config.yaml"
    write(file, "tcp/127.0.0.1:1", 1000)
    path, unzeroed = zero_path("test", "left"), read(file)[1][0]
    path.parent.mkdir()
    if how == "named":
        path = tmp_path / "zero.json"
        file.write_text(
            file.read_text().replace("calibration: left.json", "calibration: left.json\n    zero: zero.json")
        )
        save_zero(path, unzeroed, 238)
    _, running = read(file)
    foot = Foot(running[0])
    foot.seq, started_ns, survey = 7, foot.started_ns, foot.survey
    save_zero(path, running[0], 233)
    reloaded = merge(running, *read(file))
    assert reloaded.changed == ("zero of the left foot",)
    foot.replace_pipeline(reloaded.pipelines[0])
    assert np.nanmax(foot.calibration.baseline_count[foot.calibration.usable]) == 233
    assert foot.meta().zero_source == str(path)
    assert (foot.seq, foot.started_ns, foot.survey) == (7, started_ns, survey), "it goes on where it was"
    assert merge([pipeline.setup for pipeline in reloaded.pipelines], *read(file)).changed == ()
    path.unlink()
    if how == "named":
        with pytest.raises(InsoleError, match=r"zero\.json"):
            read(file)
    else:
        assert merge([pipeline.setup for pipeline in reloaded.pipelines], *read(file)).changed == (
            "zero of the left foot",
        )


def test_a_zero_that_is_taken_during_a_reload_is_not_undone(tmp_path, monkeypatch, endpoint):
    """What the reload has read by then is older, so it is read once more."""
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    file = tmp_path / "config.yaml"
    write(file, endpoint, 1000)
    bus = Bus("virtual", "reload")
    feet = load_feet(replace(configs.load(file), buses=(bus,)))
    zero_path("test", "left").parent.mkdir(parents=True)
    reads = []

    def read_and_zero(path):
        files = read(path)
        reads.append(path)
        if len(reads) == 1:
            save_zero(zero_path("test", "left"), feet[0].setup, 231)
            feet[0].replace_pipeline(FootPipeline.of(load_setups(feet[0].config)[0], feet[0].setup))
        return files

    monkeypatch.setattr(reload, "read", read_and_zero)
    with contextlib.closing(RecoveringSource([bus])) as source, open_session("peer", (endpoint,)) as session:
        daemon = Daemon(source, feet, session, file)
        thread = threading.Thread(target=daemon.run)
        thread.start()
        with insole_daemon.connect(endpoint) as insole:
            events = insole.events("left")
            time.sleep(0.3)
            daemon.reload()
            assert next_of(events, "reloaded", "reload_refused").text == "changed: nothing"
        daemon.stop()
        thread.join()
    assert len(reads) == 2
    assert feet[0].zero_source == str(zero_path("test", "left"))


def test_a_reloads_tables_are_prepared_outside_the_loop(tmp_path, monkeypatch, endpoint):
    """With effects it takes longer than a cycle lasts; the loop takes over what is whole."""
    file = tmp_path / "config.yaml"
    write(file, endpoint, 1000)
    calibration = tmp_path / "left.json"
    where = {"scope": "insole", "ids": []}
    lag = {"effect": "lag", "where": where, "parameters": {"tau_s": {"value": 0.02, "unit": "s"}}}
    calibration.write_text(json.dumps(json.loads(calibration.read_text()) | {"effects": [lag]}))
    bus = Bus("virtual", "beside")
    feet = load_feet(replace(configs.load(file), buses=(bus,)))
    makers = set()

    def noting(make):
        def noted(*args, **kwargs):
            makers.add(threading.current_thread().name)
            make(*args, **kwargs)

        return noted

    for part in (DynamicModel, WrenchEstimator, StaticCurve, FaultWatch):
        monkeypatch.setattr(part, "__init__", noting(part.__init__))
    with contextlib.closing(RecoveringSource([bus])) as source, open_session("peer", (endpoint,)) as session:
        daemon = Daemon(source, feet, session, file)
        thread = threading.Thread(target=daemon.run, name="loop")
        thread.start()
        with insole_daemon.connect(endpoint) as insole:
            events = insole.events("left")
            answers = False
            while not answers:  # once it answers it knows of the subscription; until then it is starting
                with contextlib.suppress(WireError):
                    answers = insole.meta("left") is not None
            calibration.write_text(calibration.read_text().replace("0.02", "0.03"))
            daemon.reload()
            assert next_of(events, "reloaded", "reload_refused").text == "changed: calibration of the left foot"
        daemon.stop()
        thread.join()
    assert feet[0].meta().effects
    assert makers == {"reload"}


def test_without_a_file_there_is_nothing_to_read(tmp_path):
    reloader = Reloader(None)
    reloader.start([foot.setup for foot in load_feet(configs.Config())])
    while (result := reloader.take()) is None:
        time.sleep(0.01)
    assert "without --config" in (result.refused or "")
    assert not reloader.busy


def test_a_starting_daemon_reports_the_problems_of_all_files(tmp_path: Path) -> None:
    (tmp_path / "left.json").write_text("{}")
    (tmp_path / "zero.json").write_text("[]")
    config = configs.Config()
    left, right = config.insoles
    config = replace(
        config,
        insoles=(
            replace(left, calibration=tmp_path / "left.json", zero=tmp_path / "zero.json"),
            replace(right, layout=tmp_path / "missing.yaml"),
        ),
    )
    with pytest.raises(DocumentsError) as refused:
        load_feet(config)
    assert refused.value.exit_status == 4
    for name in ("left.json", "zero.json", "missing.yaml"):
        assert name in str(refused.value)
