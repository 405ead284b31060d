"""A study on real Dask workers: resumed, killed, broken."""

from __future__ import annotations

import asyncio
import json
import logging
import os
import resource
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pandas as pd
import pytest

from insole_daemon.config import Config
from insole_daemon.errors import DocumentError, FileError, InsoleError
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.trial import Trial
from insole_daemon.study import scheduling
from insole_daemon.study.collecting import collect_rows, write_tables
from insole_daemon.study.document import load_study
from insole_daemon.study.page import study_page
from insole_daemon.study.scheduling import cluster, describe_failure, run_tasks
from insole_daemon.study.tasks import Given, TaskResult, describe_problems, do_tasks
from tests.conftest import PATIENCE_S

INSOLE = Path(sys.executable).with_name("insole")
SECONDS = 8.0


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Three persons, two sessions each, the last person without steps in the second."""
    folder = tmp_path_factory.mktemp("recordings")
    config = Config()
    layouts = [load_layout(insole) for insole in config.insoles]
    lines = []
    for person in range(3):
        for session, task in (("slow", "t4"), ("fast", "t5")):
            name = f"p{person}-{session}"
            still = (person, session) == (2, "fast")
            Trial("t1" if still else task, config, layouts, seed=person).write(folder / name, SECONDS)
            lines.append(f"  - {{folder: {name}, person: p{person}, session: {session}}}")
    (folder / "study.yaml").write_text(
        "format: insole-study/1\ntasks: [steps]\nrecordings:\n" + "\n".join(lines) + "\n"
    )
    return folder


@pytest.fixture(scope="module")
def certificates(tmp_path_factory):
    """A lab's certificate authority and a certificate of it; and those of a stranger."""
    if not shutil.which("openssl"):
        assert not os.environ.get("CI"), "apt-get install openssl"
        pytest.skip("needs openssl")
    folder = tmp_path_factory.mktemp("certificates")
    key = "-newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days 9"
    for who in ("lab", "stranger"):
        commands = [f"openssl req -x509 {key} -subj /CN={who} -keyout {who}-ca.key -out {who}-ca.pem"]
        commands.append(
            f"openssl req -x509 {key} -subj /CN={who}-member -CA {who}-ca.pem -CAkey {who}-ca.key "
            f"-addext basicConstraints=critical,CA:FALSE -keyout {who}.key -out {who}.pem"
        )
        for command in commands:
            subprocess.run(command.split(), cwd=folder, check=True, capture_output=True)
    return folder


@pytest.fixture
def folder(recorded, tmp_path):
    return Path(shutil.copytree(recorded, tmp_path / "study"))


@pytest.fixture(scope="module")
def worker():
    """A client with one worker, for the tests of results, which do not depend on the workers."""
    with cluster(None, 1) as client:
        yield client


@pytest.fixture(scope="module")
def computed(recorded, worker, tmp_path_factory):
    """The recordings with their results, tables and page."""
    folder = Path(shutil.copytree(recorded, tmp_path_factory.mktemp("computed") / "study"))
    analysed(folder, worker)
    return folder


@pytest.fixture
def computed_folder(computed, tmp_path):
    return Path(shutil.copytree(computed, tmp_path / "study"))


def analysed(folder, client, told=lambda number, found: None, told_absent=lambda seconds: None):
    """The bytes of the tables and the page."""
    study = load_study(folder)
    found = run_tasks(client, folder, study, folder / "results", told, told_absent)
    rows, every = collect_rows(study, folder / "results", found)
    write_tables(study, rows, every, folder)
    (folder / "study.html").write_text(study_page("x", study, rows, every))
    names = ("table.csv", "table.parquet", "steps.csv", "steps.parquet", "study.html")
    return {name: (folder / name).read_bytes() for name in names}, found


def files_of(folder):
    whole = (path for path in (folder / "results").rglob("*.npz") if not path.name.startswith("."))  # written as "."
    return {path: path.stat().st_mtime_ns for path in whole}


def test_any_number_of_workers_gives_the_same_bytes_and_what_is_done_is_not_done_again(folder, tmp_path):
    other = Path(shutil.copytree(folder, tmp_path / "other"))
    with cluster(None, 1) as client:
        one, _ = analysed(folder, client)
    before = files_of(folder)
    with cluster(None, 2) as client:
        two, _ = analysed(other, client)
        again, _ = analysed(folder, client)
        assert files_of(folder) == before, "resumed: nothing is written anew"
        with open(folder / "p0-slow" / "recording.yaml", "a") as file:
            file.write("# changed\n")
        analysed(folder, client)
    assert one == two == again
    changed = files_of(folder).keys() - before.keys()
    assert [path.parent.name for path in changed] == ["p0-slow"], "worked out anew, since its content changed"


def test_a_line_before_the_others_computes_its_recording_alone(folder, worker):
    study = folder / "study.yaml"
    head, _, listed = study.read_text().partition("recordings:\n")
    lines = listed.splitlines(keepends=True)
    study.write_text(head + "recordings:\n" + "".join(lines[1:3]))
    analysed(folder, worker)
    before = files_of(folder)
    study.write_text(head + "recordings:\n" + "".join(lines[:3]))
    analysed(folder, worker)
    after = files_of(folder)
    assert before.items() <= after.items()
    assert [path.parent.name for path in after.keys() - before.keys()] == ["p0-slow"]
    assert pd.read_csv(folder / "table.csv").recording.tolist() == ["p0-slow", "p0-fast", "p1-slow"]


def test_a_worker_has_one_thread_of_arithmetic_and_keeps_its_memory():
    with cluster(None, 1) as client:
        (environment,) = client.run(lambda: dict(os.environ)).values()
    assert environment["OMP_NUM_THREADS"] == environment["OPENBLAS_NUM_THREADS"] == "1"
    assert "MALLOC_TRIM_THRESHOLD_" not in environment, "a third of the CPU time would be page faults"


def test_a_worker_that_is_killed_loses_nothing_and_doubles_nothing(folder, tmp_path):
    other = Path(shutil.copytree(folder, tmp_path / "other"))
    with cluster(None, 2) as client:
        undisturbed, _ = analysed(other, client)
        pids = list(client.run(os.getpid).values())
        killed = threading.Event()

        def kill_one(number, found):
            if not killed.is_set():
                killed.set()
                os.kill(pids[0], signal.SIGKILL)

        disturbed, _ = analysed(folder, client, kill_one)
    assert killed.is_set()
    assert disturbed == undisturbed
    table = pd.read_csv(folder / "table.csv")
    assert sorted(table.recording) == sorted({*table.recording})


def test_damaged_recordings_are_reported_and_the_others_analysed(folder):
    (folder / "p0-slow" / "recording.yaml").write_text("format: insole-recording/9\n")
    shutil.rmtree(folder / "p1-slow")
    done = subprocess.run([INSOLE, "study", folder, "--workers", "2"], capture_output=True, text=True, check=False)
    assert done.returncode == 1, done.stderr
    assert "Traceback" not in done.stderr
    table = pd.read_csv(folder / "table.csv").set_index("recording")
    assert len(table) == 6
    assert "insole-recording/9" in table.missing["p0-slow"]
    assert "p1-slow: there is no such folder; check its line in study.yaml" in table.missing["p1-slow"]
    assert "Error" not in " ".join(table.missing.dropna())
    assert "insole: next: open" in done.stderr
    assert table.left_steady_steps["p2-fast"] == 0
    assert pd.isna(table.missing["p1-fast"])
    assert table.left_steady_steps["p1-fast"] >= 3
    page = (folder / "study.html").read_text()
    assert "p1-slow" in page
    assert "<script" not in page


def test_sessions_are_compared(computed):
    page = (computed / "study.html").read_text()
    assert "fast less slow" in page
    assert "left, p0" in page, "two persons have both sessions: each is compared alone"
    assert "p0, p1: the sessions have different calibrations" not in page


def test_a_person_without_steps_in_both_sessions_does_not_give_another_one_their_name(computed_folder, worker):
    lines = [f"  - {{folder: p{n}-{of}, person: p{n}, session: {of}}}" for n in (2, 0) for of in ("slow", "fast")]
    (computed_folder / "study.yaml").write_text(
        "format: insole-study/1\ntasks: [steps]\nrecordings:\n" + "\n".join(lines) + "\n"
    )
    analysed(computed_folder, worker)
    page = (computed_folder / "study.html").read_text()
    assert "f_z over stance, left, p0" in page
    assert "f_z over stance, left, p2" not in page


def test_sessions_with_different_calibrations_are_reported(computed_folder, worker):
    path = computed_folder / "p1-fast" / "left-calibration.json"
    path.write_text(path.read_text().replace("[0.0, ", "[0.5, "))
    analysed(computed_folder, worker)
    page = (computed_folder / "study.html").read_text()
    assert "p1: the sessions have different calibrations" in page


def test_a_study_that_cannot_be_is_refused(tmp_path):
    (tmp_path / "study.yaml").write_text(
        "format: insole-study/1\ntasks: [validation]\nrecordings:\n"
        "  - {folder: a, person: p, session: s}\n  - {folder: x/../a, person: p, session: s}\n"
    )
    with pytest.raises(DocumentError, match=r"(?s)validation judges calibrations.*each recording once"):
        load_study(tmp_path)


@pytest.mark.parametrize(
    "address", ["tcp://10.0.0.5:8786", "tls://10.0.0.5:8786", "tcp://0.0.0.0:8786", "tcp://127.0.0.1"]
)
def test_a_scheduler_beyond_loopback_needs_tls(address):
    with pytest.raises(InsoleError, match="Dask exchanges pickles"), cluster(address, 1):
        pass


def test_a_certificate_that_is_not_there_is_named(tmp_path):
    files = tuple(tmp_path / name for name in ("ca.pem", "member.pem", "member.key"))
    with pytest.raises(FileError, match="ca.pem: there is no such file"), cluster("tls://127.0.0.1:1", 1, files):
        pass


def test_a_scheduler_with_tls_accepts_only_certificates_of_its_authority(folder, certificates):
    from distributed import LocalCluster, Security

    ca, certificate, key = (str(certificates / name) for name in ("lab-ca.pem", "lab.pem", "lab.key"))
    security = Security(
        tls_ca_file=ca, require_encryption=True, tls_scheduler_cert=certificate, tls_scheduler_key=key,
        tls_worker_cert=certificate, tls_worker_key=key, tls_client_cert=certificate, tls_client_key=key,
    )  # fmt: skip
    with LocalCluster(
        n_workers=1, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0", security=security,
        silence_logs=logging.CRITICAL,
    ) as existing:  # fmt: skip
        assert existing.scheduler_address.startswith("tls://")

        def study(who):
            command = [INSOLE, "study", folder, "--scheduler", existing.scheduler_address]
            command += ["--tls-ca", certificates / "lab-ca.pem"]
            command += ["--tls-cert", certificates / f"{who}.pem", "--tls-key", certificates / f"{who}.key"]
            return subprocess.run(command, capture_output=True, text=True, check=False)

        done = study("lab")
        assert "6 recordings" in done.stdout, done.stderr
        shutil.rmtree(folder / "results")
        refused = study("stranger")
    assert refused.returncode == 3
    assert "no Dask scheduler answers" in refused.stderr
    assert "do not trust each other's certificate" in refused.stderr
    assert "Traceback" not in refused.stderr
    assert not (folder / "results").exists(), "nothing was done for a stranger"


def test_a_full_disk_is_reported_and_complete_files_are_kept(folder):
    def smaller_files():
        resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))

    text = lines_of("folder: p0-slow, person: p0, session: slow", "folder: p0-fast, person: p0, session: fast")
    (folder / "study.yaml").write_text(text.replace("[steps]", "[steps, report]"))
    command = [INSOLE, "study", folder, "--workers", "1"]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, preexec_fn=smaller_files,
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},  # Python would leave half of a compiled module
    )  # fmt: skip
    assert done.returncode == 1, done.stderr
    assert "Traceback" not in done.stderr
    table = pd.read_csv(folder / "table.csv").set_index("recording")
    assert table.missing["p0-slow"] == "report: File too large"
    assert table.left_steady_steps["p0-slow"] >= 3
    assert not list((folder / "results").rglob(".*")), "nothing half-written stays"
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert pd.isna(pd.read_csv(folder / "table.csv").set_index("recording").missing["p0-slow"]), done.stderr


def children_of(pid):
    return [int(word) for path in Path(f"/proc/{pid}/task").glob("*/children") for word in path.read_text().split()]


def has_started_workers(process, lines):
    return sum(b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes() for pid in children_of(process.pid)) == 2


def has_finished_a_recording(process, lines):
    return ": done" in lines.read_text()


@pytest.mark.parametrize("moment", [has_started_workers, has_finished_a_recording])
def test_ctrl_c_ends_the_command_and_its_workers_with_one_line_and_the_next_run_goes_on(folder, tmp_path, moment):
    of = [f"folder: p{n}-{session}, person: p{n}, session: {session}" for n in (0, 1) for session in ("slow", "fast")]
    (folder / "study.yaml").write_text(lines_of(*of))
    command = [INSOLE, "study", folder, "--workers", "2"]
    lines = tmp_path / "stderr"
    with open(lines, "w") as stderr:
        # As a terminal does; whoever runs the tests in the background has SIGINT ignored.
        on_terminal = ["env", "--default-signal=INT", *command]
        process = subprocess.Popen(on_terminal, stdout=stderr, stderr=stderr, start_new_session=True)
    deadline_s = time.monotonic() + PATIENCE_S
    while not moment(process, lines):
        assert process.poll() is None, lines.read_text()
        assert time.monotonic() < deadline_s
        time.sleep(0.005)
    workers = children_of(process.pid)
    os.killpg(process.pid, signal.SIGINT)
    assert process.wait() == 130
    assert [line for line in lines.read_text().splitlines() if not line.endswith(": done")] == ["insole: interrupted"]
    while any(Path(f"/proc/{pid}").exists() for pid in workers):
        assert time.monotonic() < deadline_s, "a worker outlives the command"
        time.sleep(0.01)
    made = files_of(folder)
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert "4 recordings, 0 with something missing" in done.stdout, done.stderr
    assert made.items() <= files_of(folder).items()


def test_a_scheduler_without_workers_is_waited_for_and_one_that_dies_is_named(folder, tmp_path):
    dask = [sys.executable, "-m", "dask"]
    contact = tmp_path / "scheduler.json"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    options = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", contact]
    scheduler = subprocess.Popen([*dask, "scheduler", *options], **quiet)
    processes = [scheduler]
    try:
        deadline_s = time.monotonic() + PATIENCE_S
        while not (contact.exists() and contact.read_text()):  # created first, then written
            assert time.monotonic() < deadline_s
            time.sleep(0.05)
        address = json.loads(contact.read_text())["address"]
        study = subprocess.Popen(
            [INSOLE, "study", folder, "--scheduler", address], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        processes.append(study)
        assert (
            study.stderr.readline()
            == f"insole: {address} has no workers: waiting for one; dask worker {address} starts one\n"
        )
        worker = [*dask, "worker", address, "--nthreads", "1", "--no-dashboard"]
        processes.append(subprocess.Popen(worker, **quiet))
        assert study.stderr.readline().endswith(": done\n")
        scheduler.kill()
        printed, told = study.communicate(timeout=PATIENCE_S)
    finally:
        for process in reversed(processes):
            process.terminate()
            process.wait()
    assert study.returncode == 1
    assert "6 recordings" in printed
    assert all(line.startswith("insole: ") for line in told.splitlines()), told
    missing = pd.read_csv(folder / "table.csv").set_index("recording").missing
    assert missing["p2-slow"].startswith("steps: the scheduler does not answer any more: start it and this command")
    assert missing.isna().any(), "what was done before stays"


def leave_at_p1(folder, *arguments):
    """Do the tasks; at the first recording of p1, its worker and the nanny leave for good."""
    left = Path(folder).with_name("left")
    if Path(folder).name == "p1-slow" and not left.exists():
        from distributed import get_worker

        left.touch()
        leaving = get_worker()
        leaving.loop.add_callback(leaving.close, nanny=True, executor_wait=False)
        threading.Event().wait()
    return do_tasks(folder, *arguments)


async def leave(dask_worker):
    asyncio.get_running_loop().create_task(dask_worker.close(nanny=True))


def test_an_absence_of_all_workers_is_reported_until_one_joins(folder, monkeypatch):
    """The worker leaves with results that were not read yet."""
    from distributed import LocalCluster

    monkeypatch.setattr(scheduling, "_ABSENCE_REPORTED_S", 0.5)
    monkeypatch.setattr(scheduling, "_ASKED_EVERY_S", 0.1)
    absences_s, left = [], threading.Event()

    def leave_once_when_all_is_done(number, results):
        if not left.is_set():
            left.set()
            deadline_s = time.monotonic() + PATIENCE_S
            while len(files_of(folder)) < 6:
                assert time.monotonic() < deadline_s
                time.sleep(0.05)
            client.run(leave)
            while existing.scheduler.workers:  # until it has left, it still hands results out
                assert time.monotonic() < deadline_s
                time.sleep(0.05)

    def start_worker_after_three_reports(seconds):
        absences_s.append(seconds)
        if len(absences_s) == 3:
            existing.scale(2)

    local = {"threads_per_worker": 1, "host": "127.0.0.1", "dashboard_address": "127.0.0.1:0"}
    with LocalCluster(n_workers=1, **local) as existing, cluster(existing.scheduler_address, 1) as client:
        analysed(folder, client, leave_once_when_all_is_done, start_worker_after_three_reports)
    assert all(seconds >= least for seconds, least in zip(absences_s, (0.5, 1, 2), strict=False)), absences_s
    assert len(absences_s) >= 3
    assert pd.read_csv(folder / "table.csv").missing.isna().all()


def test_recordings_are_given_up_when_local_workers_do_not_come_back(folder, monkeypatch):
    monkeypatch.setattr(scheduling, "do_tasks", leave_at_p1)
    monkeypatch.setattr(scheduling, "LOCAL_WORKERS_TIMEOUT_S", 1.0)
    with cluster(None, 1) as client:
        analysed(folder, client)
    missing = pd.read_csv(folder / "table.csv").set_index("recording").missing
    assert missing["p1-slow"].startswith("steps: all workers ended, and none started within 1 s: check")
    with cluster(None, 1) as client:
        analysed(folder, client)
    assert pd.read_csv(folder / "table.csv").missing.isna().all()


def test_a_recording_that_workers_die_with_is_named_in_plain_words():
    with cluster(None, 1) as client:
        error = client.submit(os._exit, 1).exception()
        assert describe_failure(error).startswith("3 workers died with it, the last on tcp://127.0.0.1:")


def test_a_worker_that_is_just_being_started_again_does_not_disturb_the_end(monkeypatch):
    from distributed import LocalCluster

    real_close = LocalCluster.close

    def close(local, *arguments, **keywords):
        real_close(local, *arguments, **keywords)
        raise AssertionError("can only join a started process")

    monkeypatch.setattr(LocalCluster, "close", close)
    with cluster(None, 1) as client:
        assert client.submit(abs, -1).result() == 1


def test_a_worker_with_other_code_than_the_command_is_refused(folder):
    (outcome,) = do_tasks(str(folder / "p0-slow"), str(folder / "results"), ["steps"], Given(), "another digest")
    assert outcome.file is None
    assert "runs other code of insole-daemon than this command" in outcome.problem


def test_a_scheduler_that_exists_is_used(folder):
    from distributed import LocalCluster

    with LocalCluster(n_workers=1, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0") as existing:
        command = [INSOLE, "study", folder, "--scheduler", existing.scheduler_address]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert "6 recordings" in done.stdout, done.stderr


def lines_of(*recordings):
    lines = "".join(f"  - {{{words}}}\n" for words in recordings)
    return "format: insole-study/1\ntasks: [steps]\nrecordings:\n" + lines


def test_a_mass_scales_the_steps_and_other_calibrations_replace_the_recordings_own(folder, worker):
    shutil.copy(folder / "p1-fast" / "left-calibration.json", folder / "copy.json")
    text = lines_of("folder: p0-fast, person: p0, session: fast", "folder: p1-fast, person: p1, session: fast")
    (folder / "study.yaml").write_text(text)
    analysed(folder, worker)
    measured, made = pd.read_csv(folder / "table.csv").set_index("recording"), files_of(folder)
    text = lines_of(
        "folder: p0-fast, person: p0, session: fast, mass_kg: 66",
        "folder: p1-fast, person: p1, session: fast, analysed_with: [copy.json], mass_kg: 20",
    )
    (folder / "study.yaml").write_text(text)
    analysed(folder, worker)
    table = pd.read_csv(folder / "table.csv").set_index("recording")
    ratio = table.left_peak_force_n["p0-fast"] / measured.left_peak_force_n["p0-fast"]
    assert f"times {ratio:.3f}: both feet bear 66 kg" in table.remarks["p0-fast"]
    assert ratio > 1.02
    assert table.left_stance_s["p0-fast"] == measured.left_stance_s["p0-fast"]
    assert "% of the weight of 20 kg" in table.missing["p1-fast"]
    assert "without mass_kg in study.yaml" in table.missing["p1-fast"]
    assert len(files_of(folder)) == len(made) + 1, "the unscaled steps stay beside the scaled ones"


def test_a_recording_without_calibration_is_analysed_with_the_one_that_is_given(folder, worker):
    path = folder / "p0-slow" / "recording.yaml"
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(line for line in lines if "calibration:" not in line))
    (folder / "study.yaml").write_text(lines_of("folder: p0-slow, person: p0, session: slow"))
    analysed(folder, worker)
    assert "has no calibration" in pd.read_csv(folder / "table.csv").missing[0]
    given = ", ".join(f"p0-slow/{foot}-calibration.json" for foot in ("left", "right"))
    text = lines_of(f"folder: p0-slow, person: p0, session: slow, analysed_with: [{given}]")
    (folder / "study.yaml").write_text(text)
    analysed(folder, worker)
    table = pd.read_csv(folder / "table.csv")
    assert table.missing.isna().all()
    assert table.left_steady_steps[0] >= 3


def test_conditions_are_compared_within_a_session_and_repeats_are_named(computed_folder, worker):
    shutil.copytree(computed_folder / "p0-slow", computed_folder / "p0-again")
    text = lines_of(
        "folder: p0-slow, person: p0, session: day, condition: slow",
        "folder: p0-again, person: p0, session: day, condition: slow",
        "folder: p0-fast, person: p0, session: day, condition: fast",
        "folder: p1-slow, person: p1, session: other, condition: alone",
    )
    (computed_folder / "study.yaml").write_text(text)
    analysed(computed_folder, worker)
    page = (computed_folder / "study.html").read_text()
    assert "day, fast less day, slow" in page
    assert "an earlier recording of the same: p0-again" in page
    assert "other, alone" not in page, "nobody has both"


def test_the_same_reason_of_several_tasks_is_stated_once():
    outcomes = [TaskResult("report", None, "broken"), TaskResult("steps", None, "broken"),
                TaskResult("validation", None, "no reference"), TaskResult("diagnosis", "d.json", "")]  # fmt: skip
    assert describe_problems(outcomes) == "report, steps: broken; validation: no reference"


def test_masses_of_some_recordings_of_a_person_and_files_that_are_not_there_are_refused(tmp_path):
    text = lines_of(
        "folder: a, person: p, session: s, mass_kg: 63",
        "folder: b, person: p, session: t, analysed_with: [none.json]",
    )
    (tmp_path / "study.yaml").write_text(text + "calibrations: [nowhere.json]\n")
    with pytest.raises(DocumentError) as refused:
        load_study(tmp_path)
    message = str(refused.value)
    assert "expected mass_kg in every recording of p, or in none" in message
    assert "analysed_with[0]: expected a calibration, found that there is no file" in message
    assert "calibrations[0]: expected a calibration" in message
