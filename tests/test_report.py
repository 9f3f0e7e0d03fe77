"""A report is one page, complete in itself: what it holds, what it escapes, what it refuses."""

import json
import re
import shutil
import subprocess
from datetime import date
from functools import cache
from html.parser import HTMLParser
from pathlib import Path

import pytest

from datasets_synthetic import bundled_path
from identification import load_device
from tests.commands import FLUID, haptune, log_text
from tune import SafeProfile, Scene, optimise
from tune.exporters import NOT_A_SAFETY_FUNCTION
from tune.presentation.page import report_html

HOSTILE = '</script><script>alert(1)</script>"><img src=x onerror=alert(2)>$x^{$ {{ 7*7 }} &amp;'
BROWSER = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)


class _Parsed(HTMLParser):
    """Elements, attributes and text of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str]] = []
        self.words: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [(name, value or "") for name, value in attrs]

    def handle_data(self, data: str) -> None:
        self.words.append(data)


@cache
def _profile() -> SafeProfile:
    device = load_device("homerehab").model_copy(update={"name": HOSTILE, "serial": HOSTILE[:40]})
    scene = {"name": HOSTILE, "elements": {HOSTILE: {"damping": 10.0}}}
    return optimise(device, Scene.model_validate(scene)).signed()


@cache
def _page() -> str:
    """Without pictures, which would be drawn for longer than all else takes."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tune.presentation.page._pictures", lambda *_: iter(()))
        return report_html(_profile(), None, None)


def test_a_name_is_text_wherever_it_stands() -> None:
    parsed = _Parsed(_page())
    assert "script" not in parsed.tags
    assert "x" not in [value for name, value in parsed.attributes if name == "src"]
    assert not [name for name, _ in parsed.attributes if name.startswith("on")]
    text = "".join(parsed.words)
    assert HOSTILE in text


def test_the_page_needs_no_network_and_says_what_it_is_not() -> None:
    text = _page()
    parsed = _Parsed(text)
    for name, value in parsed.attributes:
        if name in {"src", "href"}:
            assert value.startswith("data:")
    assert not re.search(r"url\(|@import|https?://(?!www\.w3\.org)", text)
    words = re.sub(r"\s+", " ", "".join(parsed.words))
    assert words.count(NOT_A_SAFETY_FUNCTION) == 2
    profile = _profile()
    for said in (
        profile.digest,
        date.today().isoformat(),
        "10 N·s/m",
        *profile.certificate.assumes,
        *profile.certificate.not_assessed,
        "Taken on trust",
        "Signature",
    ):
        assert re.sub(r"\s+", " ", said) in words, said


def test_only_a_profile_that_passes_with_its_own_logs_gets_a_report(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The way from a log to a report, with every picture, is run by the blocks of the guides."""
    monkeypatch.setattr("tune.presentation.page._pictures", lambda *_: iter(()))
    text = _profile().to_yaml()
    Path("profile.yaml").write_text(text, encoding="utf-8")
    ended = haptune("report", "profile.yaml", "--json")
    assert ended.code == 0, ended.err
    told = json.loads(ended.out)
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


def test_a_log_is_read_for_a_report_as_it_was_read_for_its_device(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A force far below the limit is asked for its unit once, and not taken for another later."""
    monkeypatch.setattr("tune.presentation.page._pictures", lambda *_: iter(()))
    Path("log.csv").write_bytes(bundled_path("homerehab.csv").read_bytes())
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
def test_a_browser_opens_and_prints_it(width: int, tmp_path: Path) -> None:
    page = tmp_path / "report.html"
    page.write_text(_page(), encoding="utf-8")
    options = [f"--user-data-dir={tmp_path / 'user'}", f"--window-size={width},900"]
    options += ["--headless=new", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr"]

    def browse(*more: str) -> subprocess.CompletedProcess[str]:
        command = [str(BROWSER), *options, *more, page.as_uri()]
        return subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)

    assert "CONSOLE" not in browse("--dump-dom").stderr
    browse(f"--print-to-pdf={tmp_path / 'report.pdf'}")
    assert (tmp_path / "report.pdf").read_bytes().startswith(b"%PDF")
