"""``haptune simulate``: rehearse a calibration on a simulated device."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Optional

import typer

from tune.cli.options import Json, Quiet
from tune.cli.session import Session, run_command


def simulate(
    spec: Annotated[
        str, typer.Argument(help="Name of a scenario; an unknown name lists all of them.")
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Where to write the log (CSV).")
    ] = Path("log.csv"),
    seed: Annotated[
        Optional[int],  # noqa: UP045 - typer reads it at run time
        typer.Option("--seed", help="Seed of the noise; default the scenario's own."),
    ] = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Simulate a logged calibration of a known device with its faults. Drives no hardware."""

    def action(session: Session) -> None:
        from datasets_synthetic import log_text, run, scenario_named

        session.target(output)
        scenario = scenario_named(spec)
        with session.progress() as say:
            say(f"simulating {spec}")
            trajectory = run(scenario, seed=seed)
        session.details |= {
            "scenario": spec,
            "description": scenario.description,
            "samples": len(trajectory),
            "sample_time": trajectory.sample_time,
        }
        session.say(scenario.description)
        session.write(output, log_text(trajectory))

    run_command("simulate", action, as_json=json, quiet=quiet)
