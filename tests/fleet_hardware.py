"""What is known of the devices of a random fleet before their logs are taken."""

from __future__ import annotations

from identification import ForceLimit, Hardware, quantity
from tests.simulated.fleet import Fleet


def data_sheet(fleet: Fleet, member: int) -> Hardware:
    """What a data sheet would say; no force limit, so that stability is what binds."""
    rig = fleet.rig
    return Hardware(
        sample_time=quantity(float(rig.sample_time[member])),
        delay=quantity(float(rig.delay[member])),
        encoder_resolution=quantity(float(rig.encoder_resolution[member])),
        force_limit=ForceLimit(continuous=1e6, peak=1e6),
    )
