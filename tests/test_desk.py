"""What lies on a desk: a report that one page of suffices, its trust in a few plain sentences."""

import itertools
import re
import shutil
import subprocess
from collections.abc import Mapping
from functools import cache
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from identification import Device, load_device
from tests.commands import haptune
from tune import SafeProfile, Scene, optimise
from tune.presentation.page import report_html

BROWSER = next(filter(None, map(shutil.which, ("chromium", "google-chrome"))), None)
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


class _Text(HTMLParser):
    """What is read of a page: paragraphs of text, without scripts and styles."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.words, self._silent = list[str](), 0
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self._silent += tag in {"script", "style"}

    def handle_endtag(self, tag: str) -> None:
        self._silent -= tag in {"script", "style"}

    def handle_data(self, data: str) -> None:
        if not self._silent and data.strip():
            self.words.append(" ".join(data.split()))


def test_the_documentation_is_short() -> None:
    """Words of the pages without benchmarks and decisions."""
    docs = Path(__file__).parents[1] / "docs"
    assert sum(len(page.read_text("utf-8").split()) for page in docs.glob("*.md")) <= 15_000
    assert not re.search(r"exit code|[A-Z]\w+Error", (docs / "calibrating.md").read_text("utf-8"))


@cache
def _page() -> str:
    device = load_device("homerehab").model_copy(update={"serial": 'HR-7" } </style> */'})
    elements = {"wall": {"stiffness": 800.0, "damping": 20.0}, "water": {"damping": 10.0}}
    return _report(device, elements)


def _report(device: Device, elements: Mapping[str, Mapping[str, float | str]]) -> str:
    """The report of some elements, without pictures."""
    profile = optimise(device, Scene.model_validate({"name": "room", "elements": elements}))
    assert isinstance(profile, SafeProfile)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tune.presentation.page._pictures", lambda *_: iter(()))
        return report_html(profile.signed(), None, None)


def test_the_first_page_tells_every_stated_fact_with_its_value() -> None:
    words = _Text(_page()).words
    first = words[: words.index("What limits it, and what would help")]
    assert any(each.startswith("safe: proved for every device") for each in first)
    facts = dict(itertools.pairwise(first))
    assert facts["encoder resolution"] == "6 µm"
    assert facts["sample time"].startswith("1 ms")
    assert facts["force limit, continuous and peak"] == "14 and 28 N"
    assert facts["wall stiffness"] == "800 N/m"
    assert any(each.startswith("as wanted; ") for each in first)


def test_a_limit_that_binds_is_shown_used_up() -> None:
    # Gain and delay together limit this spring; each alone would allow more of it.
    page = _report(load_device("stylus"), {"rubber": {"stiffness": "max"}})
    ((width, words),) = re.findall(r'class="binds" width="(.*?)" .*?</svg>(.*?)</td>', page)
    assert float(width) == pytest.approx(100.0, abs=1.0)
    assert words == "gain and delay 2 of 2 with 1 T more"


def test_trust_is_at_most_seven_plain_sentences() -> None:
    (part,) = re.findall(r"<h2>Taken on trust</h2>.*?<ol>(.*?)</ol>", _page(), re.DOTALL)
    sentences = re.findall(r"<li>(.*?)</li>", part)
    assert 4 <= len(sentences) <= 7
    for sentence in sentences:
        assert re.fullmatch(r"[A-Z][^.]*\.", sentence.replace("0.5", "")), sentence
        assert not re.search(r"\w_\w|\*|--\w", sentence), sentence
        assert len(sentence.split()) <= 40


def test_a_serial_number_stays_a_string_of_the_style_sheet() -> None:
    (style,) = re.findall(r"<style>(.*?)</style>", _page(), re.DOTALL)
    (running,) = re.findall(r"content: (\"serial .*?\"|\"serial[^;]*);", style)
    assert running.count('"') == 2
    assert "<" not in running


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
    lines = ended.out.splitlines()
    assert len(lines) <= LINES
    assert ended.out.startswith("safe: ")
    assert haptune("report", "profile.yaml").code == 0
    if BROWSER is None or shutil.which("pdfinfo") is None:
        pytest.skip("no browser, or no pdfinfo, to count the pages")
    options = ["--headless=new", "--no-sandbox", "--disable-gpu", f"--user-data-dir={here}/u"]
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
