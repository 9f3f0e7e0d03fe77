"""The example log that comes with haptune, beside its hardware file and its truth.

``python -m datasets_synthetic.bundle`` writes the files anew from their scenario.
"""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

import numpy as np

from datasets_synthetic.scenarios import SCENARIOS, Scenario, run
from identification import InvalidInputError, Trajectory, load_device, to_yaml

#: Decimals printed, trailing zeros dropped: a picometre, a piconewton, a picosecond.
_DECIMALS = 12
#: The scenario each bundled log comes from bears the log's name.
_BUNDLED = ("homerehab",)
#: What the truth file states of the rig.
_TRUE = (
    "mass",
    "damping",
    "coulomb_friction",
    "force_offset",
    "sample_time",
    "delay",
    "encoder_resolution",
)


def bundled_path(name: str) -> Path:
    """A bundled file: homerehab.csv, homerehab.hardware.yaml or homerehab.truth.yaml.

    Raises:
        InvalidInputError: no such file, with the names there are.
    """
    folder = Path(str(files("datasets_synthetic").joinpath("logs")))
    known = sorted(path.name for path in folder.iterdir() if path.is_file())
    if name not in known:
        raise InvalidInputError(name, "is not a bundled file", f"Bundled: {', '.join(known)}")
    return folder / name


def log_text(trajectory: Trajectory) -> str:
    """The log as CSV: a header of column names, then one row a sample in SI units."""
    columns = trajectory.columns()
    rows = zip(*(column for _, column in columns), strict=True)
    lines = [",".join(name for name, _ in columns)]
    lines += [",".join(_decimal(float(value)) for value in row) for row in rows]
    return "\n".join(lines) + "\n"


def bundle_texts(scenario: Scenario) -> dict[str, str]:
    """File name → text of the log, hardware and truth of one scenario."""
    return {
        f"{scenario.name}.csv": log_text(run(scenario)),
        f"{scenario.name}.hardware.yaml": _hardware_text(scenario),
        f"{scenario.name}.truth.yaml": _truth_text(scenario),
    }


def _truth_text(scenario: Scenario) -> str:
    """What the log was simulated from: scenario, seed and every true value."""
    rig, faults = scenario.rig(), scenario.faults
    values = {name: float(getattr(rig, name)[0]) for name in _TRUE}
    noise = {
        "position_noise": float(np.max(faults.position_noise)),
        "force_noise": float(np.max(faults.force_noise)),
    }
    return to_yaml(
        {"scenario": scenario.name, "seed": scenario.seed} | values | {"faults": noise},
        f"What {scenario.name}.csv was simulated from; SI units, noise rms.",
    )


def _hardware_text(scenario: Scenario) -> str:
    """What is known of the device before the log is taken, as hardware.yaml."""
    device = load_device(scenario.device).model_dump(mode="json", exclude_none=True)
    kept = ("name", "axis", "motion", "sample_time", "delay", "encoder_resolution", "force_limit")
    return to_yaml(
        {"schema": "haptune/hardware/1"} | {key: device[key] for key in kept},
        f"What is known before {scenario.name}.csv is looked at.",
    )


def _decimal(value: float) -> str:
    text = f"{value:.{_DECIMALS}f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def _write() -> None:
    folder = Path(str(files("datasets_synthetic").joinpath("logs")))
    for name in _BUNDLED:
        for file_name, text in bundle_texts(SCENARIOS[name]).items():
            (folder / file_name).write_text(text, encoding="utf-8", newline="\n")


if __name__ == "__main__":
    _write()
