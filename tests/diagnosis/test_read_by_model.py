"""Findings of a walk that was read by the model of a chamber."""

from __future__ import annotations

from insole_daemon.diagnosis.finding import Finding
from insole_daemon.diagnosis.read_by_model import with_bursts_as_read
from insole_daemon.physics.effect import Where


def finding(effect: str, sentence: str = "") -> Finding:
    return Finding(effect=effect, foot="left", where=Where(), sentence=sentence, recordings=("walk",))


def test_bursts_of_noise_are_those_of_the_readings_and_not_of_what_undoing_a_memory_amplifies():
    delay, amplified, burst = finding("delay"), finding("noise_burst", "amplified"), finding("noise_burst", "read")
    assert with_bursts_as_read([delay, amplified], [finding("gain")]) == (delay,)
    assert with_bursts_as_read([delay], [burst, finding("gain")]) == (delay, burst)
