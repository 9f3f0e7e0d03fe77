"""A report is one page, complete in itself: what it holds, what it escapes, what it refuses."""

import itertools
import re
import shutil
import subprocess
from collections.abc import Mapping
from datetime import date
from functools import cache
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from datasets_synthetic import bundled_path
from identification import Device, load_device
from tests.commands import FLUID, bundled_log, haptune, log_text
from tune import SafeProfile, Scene, optimise
from tune.exporters import NOT_A_SAFETY_FUNCTION
from tune.presentation.page import report_html

HOSTILE = '</script><script>alert(1)</script>"><img src=x onerror=alert(2)>$x^{$ {{ 7*7 }} &amp;'
#: As a serial number it stands in the style sheet too.
SERIAL = 'HR-7" } </style> */'
BROWSER = next(filter(None, map(shutil.which, ("chromium", "google-chrome"))), None)
OPTIONS = ("--headless=new", "--no-sandbox", "--disable-gpu")
#: Lines and columns of a terminal at a bench.
LINES, COLUMNS = 25, 80
#: Elements by name, as scenes of thirty profiles draw them.
KINDS = (
    "{stiffness: max, damping: max, one_sided: true}",
    "{damping: 10.0}",
    "{mass: max, damping: 30.0, fade_time: 0.1}",
    "{stiffness: {min: 100.0, max: 1500.0}}",
    "{mass: min, damping: 20.0, fade_time: 0.1}",
)


class _Parsed(HTMLParser):
    """Elements, attributes and text of a page; scripts and styles are not read."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str]] = []
        self.words: list[str] = []
        self._silent = 0
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [(name, value or "") for name, value in attrs]
        self._silent += tag in {"script", "style"}

    def handle_endtag(self, tag: str) -> None:
        self._silent -= tag in {"script", "style"}

    def handle_data(self, data: str) -> None:
        if not self._silent and data.strip():
            self.words.append(" ".join(data.split()))


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without pictures, which the blocks of the guides draw, for longer than all else takes."""
    monkeypatch.setattr("tune.presentation.page._pictures", lambda *_: iter(()))


def _tuned(device: Device, elements: Mapping[str, Mapping[str, float | str]]) -> SafeProfile:
    content = {"name": HOSTILE, "elements": elements, "loop": {"velocity_filter_hz": 50.0}}
    return optimise(device, Scene.model_validate(content)).signed()


@cache
def _profile() -> SafeProfile:
    device = load_device("homerehab").model_copy(update={"name": HOSTILE, "serial": SERIAL})
    elements = {"wall": {"stiffness": 800.0, "damping": 20.0}, HOSTILE: {"damping": 10.0}}
    return _tuned(device, elements)


@pytest.fixture
def page(quick: None) -> str:
    return report_html(_profile(), None, None)


def test_the_page_needs_no_network_and_a_name_is_text_wherever_it_stands(page: str) -> None:
    parsed = _Parsed(page)
    assert "script" not in parsed.tags
    for name, value in parsed.attributes:
        assert not name.startswith("on")
        assert name not in {"src", "href"} or value.startswith("data:")
    assert not re.search(r"url\(|@import|https?://(?!www\.w3\.org)", page)
    (style,) = re.findall(r"<style>(.*?)</style>", page, re.DOTALL)
    (running,) = re.findall(r"content: (\"serial .*?\"|\"serial[^;]*);", style)
    assert running.count('"') == 2
    assert "<" not in running
    words = " ".join(parsed.words)
    assert words.count(NOT_A_SAFETY_FUNCTION) == 2
    seal = _profile().certificate
    told = (_profile().digest, date.today().isoformat(), HOSTILE, "Taken on trust", "Signature")
    for said in (*told, *seal.assumes, *seal.not_assessed):
        assert " ".join(said.split()) in words, said


def test_the_first_page_tells_every_stated_fact_with_its_value(page: str) -> None:
    words = _Parsed(page).words
    first = words[: words.index("What limits it, and what would help")]
    assert any(each.startswith("safe: proved for every device") for each in first)
    facts = dict(itertools.pairwise(first))
    assert facts["encoder resolution"] == "6 µm"
    assert facts["sample time"].startswith("1 ms")
    assert facts["force limit, continuous and peak"] == "14 and 28 N"
    assert facts["wall stiffness"] == "800 N/m"
    assert any(each.startswith("as wanted; ") for each in first)


@pytest.mark.usefixtures("quick")
def test_a_limit_that_binds_is_shown_used_up() -> None:
    # Gain and delay together limit this spring; each alone would allow more of it.
    profile = _tuned(load_device("stylus"), {"rubber": {"stiffness": "max"}})
    page = report_html(profile, None, None)
    ((width, words),) = re.findall(r'class="binds" width="(.*?)" .*?</svg>(.*?)</td>', page)
    assert float(width) == pytest.approx(100.0, abs=1.0)
    assert words == "gain and delay 2 of 2 with 1 T more"


@pytest.mark.usefixtures("quick")
def test_only_a_profile_that_passes_with_its_own_logs_gets_a_report(here: Path) -> None:
    text = _profile().to_yaml()
    Path("profile.yaml").write_text(text, encoding="utf-8")
    told = haptune("report", "profile.yaml", "--json").result
    assert told["outputs"] == ["report.html"]
    assert told["details"]["profile"]["digest"] == _profile().digest
    assert _profile().digest in Path("report.html").read_text(encoding="utf-8")

    Path("other.csv").write_text(log_text(), encoding="utf-8")
    refused = haptune("report", "profile.yaml", "other.csv", "-o", "other.html")
    assert refused.code == 3
    assert "is not what the device of profile.yaml was identified from" in refused.err
    Path("changed.yaml").write_text(text.replace("10.0", "11.0"), encoding="utf-8")
    assert haptune("report", "changed.yaml", "-o", "other.html").code == 6
    assert not Path("other.html").exists()
    assert haptune("report", "profile.yaml", "-o", "profile.yaml").code == 2


@pytest.mark.usefixtures("quick")
def test_a_log_is_read_for_a_report_as_it_was_read_for_its_device(here: Path) -> None:
    """A force far below the limit is asked for its unit once, and not taken for another later."""
    Path("log.csv").write_text(bundled_log(), encoding="utf-8")
    hardware = bundled_path("homerehab.hardware.yaml").read_text(encoding="utf-8")
    strong = re.sub("(continuous|peak): [0-9.]+", r"\1: 100.0", hardware)
    Path("hardware.yaml").write_text(strong, encoding="utf-8")
    Path("scene.yaml").write_text(FLUID, encoding="utf-8")
    calibrate = ("calibrate", "log.csv", "--hardware", "hardware.yaml", "--scene", "scene.yaml")
    assert haptune(*calibrate).code == 4
    assert haptune(*calibrate, "--force-gain", "1").code == 0
    refused = haptune("report", "profile.yaml", "log.csv", "--force-gain", "2")
    assert refused.code == 3
    assert "is read as force from 'force' times 2, but" in refused.err
    assert haptune("report", "profile.yaml", "log.csv").code == 0


@pytest.mark.long
@pytest.mark.skipif(BROWSER is None, reason="no browser is installed")
@pytest.mark.parametrize("width", [360, 1200])
def test_a_browser_opens_it(width: int, page: str, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    path.write_text(page, encoding="utf-8")
    options = [f"--user-data-dir={tmp_path / 'user'}", f"--window-size={width},900"]
    options += [*OPTIONS, "--enable-logging=stderr", "--dump-dom", path.as_uri()]
    seen = subprocess.run(
        [str(BROWSER), *options], capture_output=True, text=True, timeout=120, check=True
    )
    assert "CONSOLE" not in seen.stderr


@pytest.mark.long
@pytest.mark.parametrize("seed", range(30))
def test_thirty_profiles_fit_a_terminal_and_six_pages(seed: int, here: Path) -> None:
    draw = np.random.default_rng(seed)
    chosen = draw.permutation(len(KINDS))[: draw.integers(2, 1 + len(KINDS))]
    elements = "".join(f"  thing{k}: {KINDS[k]}\n" for k in chosen)
    margin = draw.choice(["conservative", "balanced", "firm"])
    Path("scene.yaml").write_text(f"margin: {margin}\nelements:\n{elements}", encoding="utf-8")
    ended = haptune("tune", "homerehab", "scene.yaml", COLUMNS=str(COLUMNS))
    assert ended.code in {0, 5}, ended.err
    if ended.code == 5:
        return
    assert len(ended.out.splitlines()) <= LINES
    assert ended.out.startswith("safe: ")
    assert haptune("report", "profile.yaml").code == 0
    if BROWSER is None or shutil.which("pdfinfo") is None:
        pytest.skip("no browser, or no pdfinfo, to count the pages")
    options = [*OPTIONS, f"--user-data-dir={here}/u"]
    options += ["--no-pdf-header-footer", "--print-to-pdf=report.pdf"]
    page = Path("report.html").resolve().as_uri()
    subprocess.run([BROWSER, *options, page], check=True, capture_output=True, timeout=120)
    told = subprocess.run(["pdfinfo", "report.pdf"], check=True, capture_output=True, text=True)
    assert int(re.findall(r"Pages:\s+(\d+)", told.stdout)[0]) <= 6
    text = subprocess.run(
        ["pdftotext", "-layout", "report.pdf", "-"], check=True, capture_output=True, text=True
    ).stdout
    for number, each in enumerate(text.split("\f")[:-1], 1):
        assert "sha256:" in each
        assert f"page {number} of" in each
        assert "serial" in each
