"""A fleet of logs with its manifest: one kind of device, each a little different, one unlike."""

from pathlib import Path

import numpy as np

from datasets_synthetic import Rig, fit_to_limits, log_text, multisine, simulate
from tests.commands import FLUID

#: What is the same for all.
HARDWARE = (
    "name: arm\nmotion: linear\nsample_time: 0.001\ndelay: 0.001\nencoder_resolution: 1.0e-6\n"
    "force_limit: {continuous: 14.0, peak: 28.0}\n"
)


def fleet_logs(folder: Path, count: int, *, unlike: int | None = None, samples: int = 2500) -> None:
    """``logs/SN*.csv``, hardware.yaml, scene.yaml and manifest.csv of so many devices.

    Masses are spread by 2 %; one has half as much again where a place is given.
    """
    generator = np.random.default_rng(count)
    mass = 3.0 * np.exp(0.02 * generator.standard_normal(count))
    if unlike is not None:
        mass[unlike] *= 1.5
    rig = Rig(
        mass=mass,
        damping=10.0 * np.exp(0.03 * generator.standard_normal(count)),
        sample_time=1e-3,
        delay=1e-3,
        encoder_resolution=1e-6,
        force_limit=28.0,
        name="arm",
    )
    played = fit_to_limits(rig, multisine(rig, samples), travel=0.05, force=20.0)
    recorded = simulate(rig, played.force, seed=7, position=played.start)
    (folder / "logs").mkdir()
    for place in range(count):
        text = log_text(recorded.trajectory(place))
        (folder / "logs" / f"SN{place}.csv").write_text(text, encoding="utf-8")
    (folder / "hardware.yaml").write_text(HARDWARE, encoding="utf-8")
    (folder / "scene.yaml").write_text(FLUID, encoding="utf-8")
    rows = [f"SN{place},logs/SN{place}.csv" for place in range(count)]
    (folder / "manifest.csv").write_text("\n".join(["serial,log", *rows, ""]), encoding="utf-8")
