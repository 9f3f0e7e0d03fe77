"""What is known of the devices of a random fleet before their logs are taken."""

from __future__ import annotations

from dataclasses import replace

from datasets_synthetic import Recording
from identification import ForceLimit, Hardware, Trajectory, quantity
from tests.simulated.fleet import Fleet


def data_sheet(fleet: Fleet, member: int) -> Hardware:
    """What a data sheet would say; a force limit so large that stability is what binds."""
    rig = fleet.rig
    return Hardware(
        motion="linear",
        sample_time=quantity(float(rig.sample_time[member])),
        delay=quantity(float(rig.delay[member])),
        encoder_resolution=quantity(float(rig.encoder_resolution[member])),
        force_limit=ForceLimit(continuous=1e6, peak=1e6),
    )


def log_of(recording: Recording, member: int) -> Trajectory:
    """One log, said to be in newtons: the limit of the data sheet is larger than any of them."""
    return replace(recording.trajectory(member), stated_units=frozenset({"force"}))
