"""Every shell and Python block of the README and the documentation runs as printed, in order."""

import re
import shlex
import shutil
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from datasets_synthetic import Controller, bundled_path, log_text, named_rig, rig_of, simulate
from identification import load_mapping
from identification.findings import CODES
from tests.commands import FLUID, files, haptune
from tune import load_profile

ROOT = Path(__file__).parents[1]
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
#: Pages whose links have to resolve.
LINKING = (*PAGES, ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md")
#: Commands that install what runs here, the one that runs this test, and measurements of minutes.
LEFT_OUT = ("python -m pip", "python -m pytest", "python -m benchmarks")
#: The element that is played for ``haptune verify``, and its gain.
PLAYED, GAIN = "rubber", 0.3
#: Files that the demo writes.
DEMONSTRATED = {"device.yaml", "scene.yaml", "profile.yaml", "identification.png", "profile.png"}
_BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"\]\(([^)\s]+)\)")


def _blocks() -> Iterator[tuple[str, str, str]]:
    """Page, language and text of every fenced block."""
    for page in PAGES:
        for language, text in _BLOCK.findall(page.read_text(encoding="utf-8")):
            yield page.name, language, text


def _commands(text: str) -> Iterator[tuple[str, str]]:
    """Single commands of a shell block, each with its line, comment and all."""
    for line in text.splitlines():
        for command in line.partition(" #")[0].split("&&"):
            if command.strip() and not command.strip().startswith(LEFT_OUT):
                yield line, command.strip()


def _play(element: str, gain: float) -> None:
    """The handle 20 mm from rest, let go, while an element of the profile plays."""
    profile = load_profile("profile.yaml")
    chosen = profile.elements[element]
    controller = Controller(
        stiffness=gain * chosen.stiffness,
        damping=gain * chosen.damping,
        mass=gain * chosen.mass,
        velocity_filter_hz=profile.loop.velocity_filter_hz or np.inf,
        acceleration_filter_hz=profile.loop.acceleration_filter_hz or np.inf,
    )
    rig = rig_of(profile.device)
    run = simulate(rig, np.zeros(3000), controller=controller, position=0.02)
    Path("played.csv").write_text(log_text(run.trajectory()), encoding="utf-8")


def _edit_excitation(command: str) -> None:
    """As the comment says; the limits are the reader's: two seconds are planned sooner than ten."""
    spec = Path("excitation.yaml")
    text = spec.read_text(encoding="utf-8").replace("duration: 10.0", "duration: 2.0")
    for key in re.findall(r"# with (.*)", command):
        text = re.sub(r"^(gentle|device): .*$", key, text, flags=re.MULTILINE)
        assert f"\n{key}\n" in text
    spec.write_text(text, encoding="utf-8")


def _lay_out_fleet(manifest: str) -> None:
    """The manifest, and for each of its devices the log at hand."""
    Path("manifest.csv").write_text(manifest, encoding="utf-8")
    Path("logs").mkdir(exist_ok=True)
    for name in re.findall(r"logs/.*", manifest):
        shutil.copy("log.csv", name)


def _play_gently() -> None:
    """The gentle force, on a device whose mass and damping nobody guessed."""
    force = np.loadtxt("gentle.csv", delimiter=",", skiprows=1)[:, 1]
    known = named_rig("homerehab")
    rig = replace(known, mass=1.4 * known.mass, damping=0.7 * known.damping)
    Path("gentle_log.csv").write_text(log_text(simulate(rig, force).trajectory()), encoding="utf-8")


def test_every_block_is_run_or_shown() -> None:
    assert {language for _, language, _ in _blocks()} == {"sh", "python", "c", "text"}
    for page in PAGES:
        assert not re.search(r"^(    |\t)haptune ", page.read_text(encoding="utf-8"), re.MULTILINE)


def _resolves(page: Path, link: str) -> bool:
    if link.startswith(("https://", "http://")):
        return True
    name, _, anchor = link.partition("#")
    target = page.parent / name if name else page
    return target.exists() and (not anchor or anchor in _anchors(target))


def _anchors(page: Path) -> set[str]:
    """Names of the headings of a page, as links spell them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", each.lower()).replace(" ", "-") for each in headings}


def test_links_resolve() -> None:
    """Those to files or headings of the project."""
    links = ((page, link) for page in LINKING for link in _LINK.findall(page.read_text("utf-8")))
    assert [(page, link) for page, link in links if not _resolves(page, link)] == []


def test_every_finding_has_its_section_and_its_picture() -> None:
    text = (ROOT / "docs" / "findings.md").read_text(encoding="utf-8")
    told = re.findall(r"^### (.*)\n\n!\[(.*)\]\(findings/(.*)\.png\)$", text, re.MULTILINE)
    assert sorted(told) == [(code,) * 3 for code in sorted(CODES)]


@pytest.fixture
def _at_the_device(here: Path) -> None:
    shutil.copy(bundled_path("homerehab.csv"), "log.csv")


@pytest.mark.usefixtures("_at_the_device")
def test_every_block_of_the_readme_runs_as_printed() -> None:
    """The scene is the reader's: that of the form is tuned by the demo."""
    readme = (block for block in _blocks() if block[0] == "README.md")
    ran = _run_blocks(readme, scene=FLUID)
    assert ran >= {"demo", "calibrate", "check", "export"}


@pytest.mark.long
@pytest.mark.usefixtures("_at_the_device")
def test_every_block_runs_as_printed() -> None:
    ran = _run_blocks(_blocks())
    assert ran >= {"demo", "calibrate", "check", "export", "excite", "doctor", "audit", "verify"}
    assert Path("controller", "haptune_guard.c").is_file()
    page = Path("report.html").read_text(encoding="utf-8")
    assert "identified again for this report" in page
    elements = load_profile("profile.yaml").elements
    shown = 2 + 2 * len(elements)  # the region and the log; of each element its region and limits
    assert page.count("data:image/svg+xml") == shown


def _run_blocks(blocks: Iterable[tuple[str, str, str]], scene: str = "") -> set[str]:
    """Run blocks, each line once, in the current folder; the commands of haptune that ran.

    A scene takes the place of the one that a form fills in.
    """
    ran: set[str] = set()
    lines: set[str] = set()
    for page, language, text in blocks:
        if language == "python":
            exec(compile(text, page, "exec"), {})  # noqa: S102
        if text.startswith("serial,"):
            _lay_out_fleet(text)
        for line, command in _commands(text) if language == "sh" else ():
            if line in lines:  # a guide repeats what the README begins with
                continue
            lines.add(line)
            program, *arguments = shlex.split(command)
            assert program == "haptune", f"{page}: {command}"
            if arguments[0] == "excite":
                _edit_excitation(line)
            if "planar.csv" in arguments:
                shutil.copy(bundled_path("planar.csv"), "planar.csv")
            if "gentle_log.csv" in arguments:
                _play_gently()
            if arguments[0] == "verify":
                _play(PLAYED, GAIN)
            ended = haptune(*arguments)
            assert ended.code == 0, f"{page}: {command}: {ended.err}"
            ran.add(arguments[0])
            if scene and arguments == ["new", "scene"]:
                Path("scene.yaml").write_text(scene, encoding="utf-8")
            if arguments[0] == "demo":
                _compare_first_table(ended.out)
                # A terminal at a bench shows all of it at once.
                wrapped = [-(-max(len(line), 1) // 80) for line in ended.out.splitlines()]
                assert sum(wrapped) <= 25
                assert files() == {"log.csv", *DEMONSTRATED}
                assert Path("profile.png").read_bytes().startswith(b"\x89PNG")
    return ran


def _compare_first_table(printed: str) -> None:
    """The README's first table is what the command above it prints and writes, rounded."""
    profile = load_mapping("profile.yaml")
    wall = profile["elements"]["wall"]
    told = f"about {round(wall['stiffness'], -2):,.0f} N/m".replace(",", " ")
    told += f", limited by `{wall['limited_by']['stiffness']}`"
    assert told in (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    block = text.partition("|---|---|---|---|---|\n")[2].partition("\n\n")[0]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in block.splitlines()]
    found = {
        label.strip(): line
        for line in printed.splitlines()
        for label in [line[: line.find("  ", 2)]]
        if line.startswith("  ") and line.strip()
    }
    table = printed.partition("limited by")[2].partition("\n\n")[0]
    assert len(rows) == len([line for line in table.splitlines() if re.search(r"\w", line)])
    for label, value, steps, reason, _ in rows:
        cells = re.split(r"  +", found[label].strip())
        # Another linear algebra library ends a search within a part of a per cent.
        assert _number(value) == pytest.approx(_number(cells[1]), rel=0.01), label
        assert _number(steps) == pytest.approx(_number(cells[2]), rel=0.01), label
        assert reason.partition(",")[0] == cells[-1], label
        felt = re.findall(r"felt as ([\d.]+) kg and ([\d.]+)", value)
        for mass, damping in felt:
            seen = profile["elements"][label.split()[0]]["rendered"]
            assert float(mass) == pytest.approx(seen["mass"], rel=0.02)
            assert float(damping) == pytest.approx(seen["damping"], rel=0.02)
    stated = re.search(r"velocity ([\d.]+) Hz,\s+acceleration ([\d.]+) Hz", text)
    assert stated
    cutoffs = [profile["loop"][f"{name}_filter_hz"] for name in ("velocity", "acceleration")]
    assert [*map(float, stated.groups())] == pytest.approx(cutoffs, rel=0.01)


def _number(text: str) -> float:
    return float(text.split(maxsplit=1)[0])
