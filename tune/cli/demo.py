"""``haptune demo``: the whole path on a bundled log, with pictures, in the current folder."""

from __future__ import annotations

from pathlib import Path

from tune.cli.drawing import draw
from tune.cli.identify import DEVICE_COMMENT, identify_logs
from tune.cli.new import template
from tune.cli.options import Json, Quiet
from tune.cli.session import Session, run_command
from tune.cli.tune import read_request, tune_device

_FILES = ("device.yaml", "scene.yaml", "profile.yaml", "identification.png", "profile.png")


def demo(json: Json = False, quiet: Quiet = False) -> None:
    """Bundled log → device.yaml → scene.yaml → profile.yaml, with tables and two pictures."""

    def action(session: Session) -> None:
        from datasets_synthetic import bundled_path
        from identification import LogColumns, to_mapping, to_yaml

        for name in _FILES:
            session.target(Path(name))
        log = bundled_path("homerehab.csv")
        hardware = bundled_path("homerehab.hardware.yaml")
        session.say(f"log: {log}")
        found = identify_logs(session, [log], LogColumns(), hardware, "auto", [])
        session.write(Path("device.yaml"), to_yaml(to_mapping(found.device), DEVICE_COMMENT))
        scene = Path("scene.yaml")
        session.write(scene, template("scene"))
        profile = tune_device(session, found.device, read_request(scene, None))
        session.write(Path("profile.yaml"), profile.to_yaml())
        with session.progress() as say:
            say("drawing")
            from identification import fit_picture
            from tune.presentation.profile_picture import profile_picture

            fit = found.logs[0]
            picture = fit_picture(fit.trajectory, found.device, delay=fit.estimate.delay)
            draw(session, Path("identification.png"), picture)
            draw(session, Path("profile.png"), profile_picture(profile))

    run_command("demo", action, as_json=json, quiet=quiet)
