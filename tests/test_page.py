"""The local page: who is refused, what its numbers are, what it leaves behind."""

import re
import socket
import threading
import time
from collections.abc import Generator
from pathlib import Path

import numpy as np
import pytest

from identification import load_device, to_mapping, to_yaml
from tests.commands import FLUID, haptune
from tests.pages import Answer, Served, served
from tune import Scene, optimise

OUTSIDE = "kept from all who ask"
REFUSED = {400, 403, 404, 422}
#: Two elements are enough to be told apart; tracking filters are none that options name.
SCENE = {
    "loop": {"velocity_filter_hz": 60.0, "velocity_filter": "tracking"},
    "elements": {"rubber": {"stiffness": 900.0, "damping": 20.0}, "water": {"damping": 10.0}},
}


#: Of which element a slider is.
STATE = {"device": "device.yaml", "profile": "profile.yaml", "element": "rubber"}


def command_of(state: dict[str, object], profile: str = "profile.yaml") -> list[str]:
    """The audit of gains as those of an element, in words."""
    options = {f"--{key.replace('_', '-')}": str(value) for key, value in state.items()}
    words = ["audit", "device.yaml", "--like", f"{profile},rubber", "--json"]
    return words + [word for pair in options.items() for word in pair]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a device and a profile, a secret beside it, and a link to that."""
    root = tmp_path_factory.mktemp("beside")
    (root / "secret.yaml").write_text(f"schema: haptune/device/1\nname: {OUTSIDE}\n")
    inside = root / "opened"
    inside.mkdir()
    (inside / "out.yaml").symlink_to(root / "secret.yaml")
    (inside / "up").symlink_to(root)
    device = load_device("homerehab")
    (inside / "device.yaml").write_text(to_yaml(to_mapping(device)))
    profile = optimise(device, Scene.model_validate(SCENE))
    (inside / "profile.yaml").write_text(profile.to_yaml())
    held = Scene.model_validate(SCENE | {"hand": {"mass": 0.01, "damping": 0.1, "stiffness": 5e3}})
    (inside / "held.yaml").write_text(optimise(device, held).to_yaml())
    plain = Scene.model_validate({"elements": {"rubber": {"stiffness": 900.0}}})
    (inside / "plain.yaml").write_text(optimise(device, plain).to_yaml())
    return inside


@pytest.fixture(scope="module")
def page(folder: Path) -> Generator[Served]:
    with served(folder) as page:
        yield page


def everything(folder: Path) -> dict[str, bytes]:
    """Every file beside and in the folder, with what it holds."""
    files = (path for path in folder.parent.rglob("*") if path.is_file())
    return {str(path): path.read_bytes() for path in files}


def test_the_page_is_there_for_who_has_its_address_only(page: Served) -> None:
    assert b"<title>haptune</title>" in page.ask("").body
    for root in ("/", "/token/", f"/{page.token[:-1]}/", f"/{page.token.lower()}x/", "//"):
        for path in ("", "page.js", "folder/", "file/device.yaml"):
            answer = page.ask(path, root=root)
            assert answer.status == 404
            assert b"homerehab" not in answer.body
    assert len(page.token) >= 32


@pytest.mark.parametrize("host", ["evil.example", "evil.example:80", "10.0.0.1", "localhost.evil"])
def test_another_host_is_refused(page: Served, host: str) -> None:
    assert page.ask("folder/", host=host).status == 400


def test_it_listens_on_the_loopback_address_alone(page: Served) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as outward:
        outward.connect(("192.0.2.1", 9))  # nothing is sent: it only tells this machine's address
        own = outward.getsockname()[0]
    assert own != "127.0.0.1"
    with pytest.raises(OSError, match="refused"):
        socket.create_connection((own, page.port), timeout=2)


@pytest.mark.parametrize(
    "path",
    [
        "../secret.yaml",
        "%2e%2e/secret.yaml",
        "..%2fsecret.yaml",
        "up/../../secret.yaml",
        "out.yaml",
        "up/secret.yaml",
        "/etc/hostname",
        "%00",
    ],
)
def test_no_path_leads_out_of_the_folder(page: Served, folder: Path, path: str) -> None:
    before = everything(folder)
    name = path.replace("%2e", ".").replace("%2f", "/").replace("%00", "\0")
    scene = {"schema": "haptune/scene/1", "elements": {"water": {"damping": 10.0}}}
    answers = [
        page.ask(f"file/{path}"),
        page.ask("show/document", {"file": name}),
        page.ask("show/log", {"file": name}),
        page.ask("show/moved", STATE | {"device": name, "damping": 1.0}),
        page.ask("show/moved", STATE | {"profile": name, "damping": 1.0}),
        page.ask(f"file/{path}", scene, method="PUT"),
        page.ask("file/own.yaml", scene | {"perception": name}, method="PUT"),
        page.ask("file/up/new.csv", b"time,force,position\n", method="PUT"),
        page.ask("run/", ["tune", "device.yaml", name]),
        page.ask("run/", ["tune", "device.yaml", "scene.yaml", "-o", name]),
        page.ask("run/", ["identify", "log.csv", "--hardware", name]),
    ]
    assert {answer.status for answer in answers} <= REFUSED
    assert not any(OUTSIDE.encode() in answer.body for answer in answers)
    assert everything(folder) == before


def test_only_logs_are_dropped_and_what_stood_there_is_kept(page: Served, folder: Path) -> None:
    before = (folder / "device.yaml").read_bytes()
    assert page.ask("file/.bashrc", b"x", method="PUT").status == 403
    assert page.ask("file/device.yaml", before, method="PUT").status == 422
    assert (folder / "device.yaml").read_bytes() == before
    assert page.ask("file/new.csv", b"one", method="PUT").json == {"backup": ""}
    assert page.ask("file/new.csv", b"two", method="PUT").json == {"backup": "new.csv.bak"}
    assert (folder / "new.csv.bak").read_bytes() == b"one"


@pytest.mark.parametrize(
    ("path", "body"),
    [
        ("run/", b"["),
        ("run/", []),
        ("run/", {}),
        ("run/", [5]),
        ("run/", ["export", "profile.yaml", "--to=c\0"]),
        ("run/", ["tune", "device.yaml", "scene.yaml", "--output=../p.yaml"]),
        ("run/", ["tune", "device.yaml", "scene.yaml", "-o../p.yaml"]),
        ("run/", ["tune", "device.yaml", "scene.yaml", "-o", "--what-if"]),
        ("run/", ["export", "profile.yaml", "--to=c", "--", "../x"]),
        ("run/", ["export", "profile.yaml", "-o", "--to=x/../../out"]),
        ("run/", ["identify", "log.csv", "--time=t", "-o", "-o", "../x"]),
        ("run/", ["simulate", "homerehab", "-o", "log.csv"]),
        ("run/", ["open", "."]),
        ("show/log", b"\xff"),
        ("show/log", []),
        ("show/log", {"file": "a" * 5000}),
        ("show/log", {"file": "device.yaml", "columns": {"time": [1]}}),
        ("show/nothing", {}),
        ("file/own.yaml", b"\xff"),
        ("file/device.yaml", b"elements: {water: {damping: 10.0}}"),
        (f"file/{'a' * 5000}", None),
    ],
)
def test_what_the_page_never_asks_is_refused(
    page: Served, folder: Path, path: str, body: object
) -> None:
    before = everything(folder)
    method = "PUT" if body is not None and path.startswith("file/") else None
    answer = page.ask(path, body, method=method)
    assert answer.status in REFUSED
    assert len(answer.body) > 5
    assert everything(folder) == before


def test_a_file_beyond_all_logs_is_refused_before_it_is_sent(page: Served, folder: Path) -> None:
    for size in ("Content-Length: 200000001", "Transfer-Encoding: chunked"):
        with socket.create_connection(("127.0.0.1", page.port), timeout=10) as line:
            head = f"PUT /{page.token}/file/huge.csv HTTP/1.1\r\nHost: 127.0.0.1\r\n{size}\r\n\r\n"
            line.sendall(head.encode())
            assert line.recv(4096).startswith(b"HTTP/1.1 413")
    assert not (folder / "huge.csv").exists()


def test_a_page_of_the_folder_can_run_nothing(page: Served, folder: Path) -> None:
    (folder / "page.html").write_text("<script>fetch('../folder/')</script>")
    with socket.create_connection(("127.0.0.1", page.port)) as line:
        line.sendall(
            f"GET /{page.token}/file/page.html HTTP/1.1\r\nHost: 127.0.0.1\r\n"
            "Connection: close\r\n\r\n".encode()
        )
        head = b"".join(iter(lambda: line.recv(4096), b"")).partition(b"\r\n\r\n")[0].lower()
    assert b"content-security-policy: sandbox; default-src 'none'" in head
    assert b"referrer-policy: no-referrer" in head


NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?%?")


def shown(row: str) -> list[tuple[float, float]]:
    """Numbers of a text, each with half of its last digit."""
    found: list[tuple[float, float]] = []
    for text in NUMBER.findall(row):
        part = 0.01 if text.endswith("%") else 1.0
        digits, _, exponent = text.rstrip("%").partition("e")
        last = 10.0 ** (int(exponent or 0) - len(digits.partition(".")[2]))
        found.append((float(text.rstrip("%")) * part, 0.5001 * last * part))
    return found


@pytest.mark.parametrize(
    "state",
    [
        {"stiffness": 1234.5, "damping": 33.3, "velocity_filter": 41.7},
        {"damping": -4.0, "margin": "conservative", "extra_delay_samples": 1.5},
        {"stiffness": 30000.0},
        {"mass": 0.4, "damping": 25.0, "acceleration_filter": 25.0, "margin": "firm"},
    ],
)
def test_every_number_is_that_of_the_command_in_all_digits(
    page: Served, folder: Path, monkeypatch: pytest.MonkeyPatch, state: dict[str, object]
) -> None:
    monkeypatch.chdir(folder)
    asked = STATE | state
    moving, resting = (
        page.ask("show/moved", asked | {"proved": each}).json for each in (False, True)
    )
    ended = haptune(*command_of(state))
    details = ended.result["details"]
    assert not moving["safe"]
    assert resting["safe"] is details["safe"] is (ended.code == 0)
    faults = [f"{each['limit']}: {each['seen']}" for each in details["faults"]]
    assert [each.partition("; needed")[0] for each in resting["faults"]] == faults
    wall, ripple = details["wall"], details["ripple"]
    known = [
        *(details[key] for key in ("gain_margin", "jitter", "sustained_force", "peak_force")),
        *(details[key] for key in ("slowest_decay", "damping_ratio", "phase_margin_degrees")),
        *(details[key] for key in ("disk_margin", "critical_frequency_hz", "speed")),
        *(*details["box"]["mass"], *details["box"]["damping"], *details["needed"].values()),
        *(details["one_count"].values()),
        *(wall["restitution"] or ()),
        *(wall[key] for key in ("depth_at_continuous_force", "depth_at_peak_force", "lead")),
        *(wall[key] for key in ("force_on_entry", "energy_per_entry", "net_damping")),
        *(details["passive_above_damping"], details["extra_delay_samples"], ripple),
    ]
    numbers = [abs(each) for each in known if each is not None]
    rows = [row for row in moving["table"]["rows"] if "not applicable" not in row[1]]
    seen = [pair for row in rows for text in row[1:] for pair in shown(text)]
    assert len(seen) > 12
    lost = [pair for pair in seen if not any(abs(abs(pair[0]) - n) <= pair[1] for n in numbers)]
    assert lost == []
    if not resting["safe"]:  # a proof may claim a little less of what is beyond the margin
        assert moving["table"] == resting["table"]


@pytest.mark.parametrize("profile", ["profile.yaml", "held.yaml"])
def test_the_region_is_where_the_margin_of_the_command_ends(
    page: Served, folder: Path, monkeypatch: pytest.MonkeyPatch, profile: str
) -> None:
    monkeypatch.chdir(folder)
    asked = STATE | {"profile": profile, "stiffness": 500.0, "damping": 20.0}
    told = page.ask("show/moved", asked).json
    damping, edge = told["region"][0][12], told["region"][3][12]
    assert damping > 0
    for factor, kept in ((0.995, True), (1.005, False)):
        ended = haptune(*command_of({"damping": damping, "stiffness": factor * edge}, profile))
        faults = {each["limit"] for each in ended.result["details"]["faults"]}
        assert ("delay-margin" not in faults and "gain-margin" not in faults) is kept


@pytest.mark.parametrize("effect", ["stiffness", "damping"])
def test_the_answer_to_a_step_is_that_of_the_difference_equation(page: Served, effect: str) -> None:
    """A mass with damping under held forces; the law acts a sample late, on v by its difference."""
    box = load_device("homerehab").simultaneous_box()
    m, b, T, gain = box.mass[0], box.damping[0], 1e-3, 2000.0 if effect == "stiffness" else 40.0
    asked = STATE | {"profile": "plain.yaml", effect: gain}
    told = page.ask("show/moved", asked).json
    assert told["force"] == pytest.approx(1.4)  # a tenth of what the actuator gives for long
    assert len(told["step"]) == len(set(box.mass)) * len(set(box.damping))
    across, up = (np.array(each) for each in told["step"][0])
    assert across.size > 100
    decay = np.exp(-b / m * T)
    position, speed, late = [0.0], [0.0], 0.0
    while len(position) * T < across[-1] + T / 2:
        x, v = position[-1], speed[-1]
        before = position[-2] if len(position) > 1 else 0.0
        final = (told["force"] - late) / b
        late = gain * (x if effect == "stiffness" else (x - before) / T)
        position.append(x + final * T + (v - final) * m / b * (1 - decay))
        speed.append(final + (v - final) * decay)
    seen = np.array(position if effect == "stiffness" else speed)
    np.testing.assert_allclose(up, seen[np.rint(across / T).astype(int)], rtol=1e-9, atol=1e-12)


def test_a_thinned_curve_has_every_extreme_and_a_finding_its_place(
    page: Served, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    time_ = np.arange(9_000) * 1e-3
    force = np.sin(7 * time_) + np.sin(31 * time_)
    position = 0.01 * np.sin(3 * time_)
    rows = np.array([1, 2_321, 5_007, 8_998])
    force[rows] = [50.0, -60.0, 70.0, -80.0]
    late = np.where(time_ > 4, time_ + 0.25, time_)
    table = np.column_stack([late, force, position])
    np.savetxt("long.csv", table, delimiter=",", header="time,force,position", comments="")
    told = page.ask("show/log", {"file": "long.csv"}).json
    across, up = (np.array(each) for each in told["curves"]["force"])
    assert across.size < 3000
    assert np.all(np.diff(across) > 0)
    for row in rows:
        assert up[np.flatnonzero(across == late[row])] == force[row]
    found = {each["code"]: each for each in page.run("doctor", "long.csv")["findings"]}
    assert found["dropped-samples"]["at"] == [[4.0, 4.251]]


def test_columns_are_offered_where_names_say_nothing(page: Served, folder: Path) -> None:
    rows = "\n".join(f"{k},{k % 7},{k % 11}" for k in range(400))
    (folder / "odd.csv").write_text(f"when,push,where\n{rows}\n")
    told = page.ask("show/log", {"file": "odd.csv"}).json
    assert told["names"] == ["when", "push", "where"]
    assert "no column" in told["reading"]
    assert told["curves"] == {}
    columns = {"time": "when", "force": "push", "position": "where", "time_gain": 1e-3}
    told = page.ask("show/log", {"file": "odd.csv", "columns": columns}).json
    assert told["curves"]["position"][0][-1] == pytest.approx(0.399)
    assert max(told["curves"]["position"][1]) == 10


def test_a_form_is_refused_in_words_and_else_written_with_a_backup(
    page: Served, folder: Path
) -> None:
    facts = {"schema": "haptune/hardware/1", "motion": "linear", "sample_time": 0.001}
    refused = page.ask("file/hardware.yaml", facts | {"sample_time": -1}, method="PUT")
    assert refused.status == 422
    assert b"sample_time" in refused.body
    assert not (folder / "hardware.yaml").exists()
    assert page.ask("file/hardware.yaml", facts, method="PUT").json["backup"] == ""
    later = page.ask("file/hardware.yaml", facts | {"delay": 0.0}, method="PUT").json
    assert later["backup"] == "hardware.yaml.bak"
    assert "delay: 0.0" in (folder / "hardware.yaml").read_text()


def test_a_scene_is_kept_as_it_was_written(page: Served, folder: Path) -> None:
    text = b"# why: to be felt\nelements:\n  water: {damping: 10.0}\n"
    assert page.ask("file/own.yaml", text, method="PUT").json["backup"] == ""
    assert page.ask("show/document", {"file": "own.yaml"}).json["text"] == text.decode()
    refused = page.ask("file/own.yaml", b"elements: {water: {damping: much}}", method="PUT")
    assert refused.status == 422
    assert (folder / "own.yaml").read_bytes() == text


def test_a_command_tells_its_stages_and_can_be_ended(page: Served, folder: Path) -> None:
    (folder / "fluid.yaml").write_text(FLUID)
    answers: list[Answer] = []

    def begin(name: str) -> threading.Thread:
        words = ("tune", "device.yaml", "fluid.yaml", "-o", name)
        running = threading.Thread(target=lambda: answers.append(page.ask("run/", list(words))))
        running.start()
        return running

    started = [begin(name) for name in ("1.yaml", "2.yaml", "3.yaml")]
    for each in started:
        each.join()
    assert sorted(each.status for each in answers) == [200, 409, 409]
    assert sum((folder / name).exists() for name in ("1.yaml", "2.yaml", "3.yaml")) == 1
    stages, running = set[str](), begin("a.yaml")
    for stage in page.stages():
        stages.add(stage)
        if not running.is_alive():
            break
    assert len(stages) > 2
    assert answers[-1].json["exit_code"] == 0
    running = begin("b.yaml")
    while not page.ask("stop/", {}).json["asked"]:
        time.sleep(0.01)
    running.join()
    assert answers[-1].json["exit_code"] in {130, -15}  # -15 before it was ready to be asked
    assert not (folder / "b.yaml").exists()
