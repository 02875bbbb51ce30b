"""The report: what the page shows, that it needs nothing from outside, and what wrong usage gets."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from report.report_bags import ALL, FAULT, INPUTS, record

from msls_ros.bags import BagReader, BagWriter, typestore
from msls_ros.commands import report
from msls_ros.estimation import Configuration
from msls_ros.report.recorded import Models, Truth
from msls_ros.report.words import describe_drift, find_changes

CHROMIUM = next((p for p in map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome")) if p), None)
LARGEST = 3_000_000
FEW = ("--parameter", "P/ddt")
"""Drawn faster than the eight of the default."""
PNG = b"\x89PNG\r\n\x1a\n"


@dataclass
class Page(HTMLParser):
    """What stands in a page."""

    html: str
    images: list[dict[str, str]] = field(default_factory=list)
    anchors: list[str] = field(default_factory=list)
    ids: list[str] = field(default_factory=list)
    addresses: list[str] = field(default_factory=list)
    policy: str = ""
    text: str = ""

    def __post_init__(self) -> None:
        super().__init__()
        self._open: list[str] = []
        self.unbalanced: list[str] = []
        self.feed(self.html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = {name: value or "" for name, value in attrs}
        if tag not in ("meta", "link", "img", "br"):
            self._open.append(tag)
        if tag == "img":
            self.images.append(values)
        if tag == "meta" and values.get("http-equiv") == "Content-Security-Policy":
            self.policy = values["content"]
        if "id" in values:
            self.ids.append(values["id"])
        self.addresses += [values[name] for name in ("href", "src", "action", "srcset", "data") if name in values]
        if tag == "a":
            self.anchors.append(values["href"])

    def handle_endtag(self, tag: str) -> None:
        if not self._open or self._open.pop() != tag:
            self.unbalanced.append(tag)

    def handle_data(self, data: str) -> None:
        if not self._open or self._open[-1] not in ("style", "script"):
            self.text += data


@dataclass
class Made:
    """A report that was made."""

    summary: dict[str, Any]
    path: Path

    @property
    def page(self) -> Page:
        return Page(self.path.read_text(encoding="utf-8"))

    @property
    def figures(self) -> set[str]:
        return {Path(figure).stem for figure in self.summary["figures"]}


def make(capsys: pytest.CaptureFixture[str], bag: Path, *arguments: str) -> Made:
    assert report.main([str(bag), "--json", *arguments]) == 0
    summary = json.loads(capsys.readouterr().out)
    return Made(summary, Path(summary["report"]))


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("whole") / "bag")


@pytest.fixture(scope="module")
def whole(bag: Path, tmp_path_factory: pytest.TempPathFactory) -> Made:
    out = tmp_path_factory.mktemp("report")
    arguments = report.parser().parse_args([str(bag), "--out", str(out)])
    return Made(report.run(arguments), out / report.PAGE)


def test_a_whole_flight_gets_every_figure(whole: Made) -> None:
    assert whole.figures == {
        "events", "flight", "model", "model_before_alarm", "model_truth", "parameters", "parameters_alarm",
        "detection", "dither", "excitation",
    }  # fmt: skip
    for figure in whole.summary["figures"]:
        assert Path(figure).read_bytes().startswith(PNG)
        assert Path(figure).parent == whole.path.parent
    page = whole.page
    assert page.unbalanced == []
    assert len(page.ids) == len(set(page.ids))
    assert {f"figure-{name}" for name in whole.figures} <= set(page.ids)
    assert {anchor.removeprefix("#") for anchor in page.anchors} <= set(page.ids)
    assert len(page.anchors) == 10


def test_the_page_tells_what_happened_in_words(whole: Made) -> None:
    told = " ".join(whole.summary["headline"])
    assert f"At {FAULT:.2f} s the plant itself changed" in told
    assert re.search(r"of de on dQ/dt to 0\.50", told)
    assert re.search(r"ddt on dP/dt to 0\.50", told)
    assert "Detected after 0.02 s, in dP/dt" in told
    assert "No false alarm." in told
    text = whole.page.text
    for sentence in whole.summary["headline"]:
        assert sentence in text
    for needed in ("estimator.forgetting_factor", "numpy", "numba", "Python", "msls_msgs/msg/LinearModel", "b43"):
        assert needed in text
    assert "No message was refused." in text


def test_the_detector_is_computed_again_and_equals_what_was_recorded(whole: Made) -> None:
    assert "equals the recorded one bit for bit in all 261 models" in whole.summary["agreement"]


def test_the_page_is_complete_in_itself_and_small(whole: Made) -> None:
    html = whole.path.read_text(encoding="utf-8")
    page = Page(html)
    assert len(html.encode()) == whole.summary["bytes"] < LARGEST
    assert page.policy.startswith("default-src 'none'")
    assert all(address.startswith(("#", "data:")) for address in page.addresses), page.addresses
    assert not re.search(r"https?:|//[a-z]+\.|@import|url\(", html)
    drawings = [image["src"] for image in page.images if image["src"].startswith("data:image/svg+xml;base64,")]
    assert len(drawings) == len(whole.figures)
    for drawing in drawings:
        svg = base64.b64decode(drawing.split(",")[1]).decode()
        outside = [a for a in re.findall(r'(?:href|src)="([^"]*)"', svg) if not a.startswith(("#", "data:"))]
        assert svg.startswith("<?xml")
        assert outside == []
        assert "<script" not in svg
        assert not re.search(r"url\((?!#)|<metadata|<!DOCTYPE", svg)


def test_the_same_bag_gives_the_same_bytes(bag: Path, whole: Made, tmp_path: Path) -> None:
    again = report.run(report.parser().parse_args([str(bag), "--out", str(tmp_path)]))
    assert Path(again["report"]).read_bytes() == whole.path.read_bytes()
    for one, two in zip(whole.summary["figures"], again["figures"], strict=True):
        assert Path(one).read_bytes() == Path(two).read_bytes()


def test_a_new_report_shows_what_is_asked_for_and_takes_old_figures_away(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "residuals.png").write_bytes(b"old")
    (tmp_path / "mine.png").write_bytes(b"mine")
    made = make(capsys, bag, "--out", str(tmp_path), "--parameter", "P/ddt", "--parameter", "Q/w")
    assert made.summary["parameters"] == ["P/ddt", "Q/w"]
    assert "∂(dQ/dt) / ∂w" in made.page.text
    assert not (tmp_path / "residuals.png").exists()
    assert (tmp_path / "mine.png").read_bytes() == b"mine"


def test_by_default_b43_is_among_the_parameters_and_all_are_of_b(whole: Made) -> None:
    assert "P/ddt" in whole.summary["parameters"]
    assert 2 <= len(whole.summary["parameters"]) <= 8
    assert all(name.split("/")[1] in Configuration().effectors for name in whole.summary["parameters"])


def test_without_truth_and_configuration_it_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = record(tmp_path / "bag", ALL - {"truth/model"}, kept=False)
    made = make(capsys, bag, *FEW)
    assert made.path == tmp_path / "report" / "report.html"
    assert {"residuals", "events"} <= made.figures
    assert not {"detection", "model_truth"} & made.figures
    text = made.page.text
    assert "no truth" in text
    assert "--params" in text
    assert any(sentence.startswith("Alarm at 4.0") for sentence in made.summary["headline"])


def test_inputs_alone_are_identified_offline(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = make(capsys, record(tmp_path / "flown", INPUTS, kept=False), *FEW)
    assert made.path.parent == tmp_path / "flown_report"
    assert made.summary["models"] == "models computed from the recorded inputs"
    assert made.summary["samples"] == 261
    assert {"model", "detection", "dither", "parameters"} <= made.figures
    assert any("holds no model" in sentence for sentence in made.summary["missing"])
    assert "defaults" in made.page.text


def test_an_identifier_of_another_aircraft_gets_a_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = Configuration(states=("P", "Q", "R"), effectors=("de", "ddt"))
    epoch = 1_790_000_000 * 10**9
    bag = record(tmp_path / "bag", ALL, configuration=other, namespace="/drone_7/", start=epoch)
    made = make(capsys, bag)
    assert {"model", "model_truth", "detection", "flight"} <= made.figures
    assert "2026-09-21" in made.page.text
    assert "/drone_7/model" in made.page.text


def test_models_alone_get_a_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = make(capsys, record(tmp_path / "bag", {"model", "fault"}), *FEW)
    assert {"model", "parameters", "residuals", "excitation", "events"} <= made.figures
    assert not {"flight", "dither"} & made.figures
    assert any("holds no states" in sentence for sentence in made.summary["missing"])


def test_a_bag_that_was_cut_off_is_shown_as_far_as_it_goes(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = next(bag.glob("*.mcap"))
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size * 2 // 3])
    made = make(capsys, cut, *FEW)
    assert made.path.parent == tmp_path / "cut_report"
    assert 50 < made.summary["samples"] < 261
    assert made.summary["warnings"]
    assert made.summary["warnings"][0] in made.page.text


def test_of_a_bag_whose_time_jumps_back_one_stretch_is_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = make(capsys, record(tmp_path / "bag", passes=2), *FEW)
    assert any("time jumps back" in warning for warning in made.summary["warnings"])
    assert made.summary["alarms"] == 1
    assert "bit for bit in all 261 models" in made.summary["agreement"]


def test_what_the_gate_refuses_is_counted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = Configuration(states=("P", "Q", "R"), effectors=("de", "ddt"))
    made = make(capsys, record(tmp_path / "bag", INPUTS, configuration=other, kept=False), "--params", "f16")
    assert made.summary["samples"] == 0
    assert "no 'u' among the names" in made.page.text
    assert any("no sample passed" in warning for warning in made.summary["warnings"])
    assert made.figures == {"flight"}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nowhere"], "nowhere"),
        (["{text}"], "text"),
        (["{bag}", "--out", "{text}/below"], "cannot be written"),
        (["{bag}", "--parameter", "P/xyz"], "P/xyz"),
        (["{bag}", "--parameter", "xyz"], "ROW/COLUMN"),
        (["{bag}", "--params", "no_such"], "no_such"),
        (["{bag}", "--namespace", "other"], "other"),
        (["{bag}", "--speed"], "--speed"),
        ([], "BAG"),
    ],
)
def test_wrong_usage_gets_one_line_and_exit_code_2(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], said: str
) -> None:
    text = tmp_path / "text"
    text.write_text("no bag\n")
    filled = [argument.format(bag=bag, text=text) for argument in arguments]
    try:
        code = report.main(filled)
    except SystemExit as error:
        code = int(str(error.code))
    captured = capsys.readouterr()
    assert code == 2
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert captured.err.startswith("report: ")
    assert said in captured.err


def test_refusals_counted_in_flight_are_shown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    types = typestore().types
    value, status = (types[f"diagnostic_msgs/msg/{name}"] for name in ("KeyValue", "DiagnosticStatus"))
    told = [
        value(key="samples", value="301"),
        value(key="refused: stamp_back", value="17"),
        value(key="refused: x", value="?"),
    ]
    of_node = status(level=1, name="/identifier: messages", message="", hardware_id="", values=told)
    flown = record(tmp_path / "flown", {"model"})
    with BagWriter(tmp_path / "bag") as writer:
        for message in BagReader(flown):
            writer.write(*message)
        array = {"header": {"stamp": {"sec": 1, "nanosec": 0}, "frame_id": ""}, "status": [of_node]}
        writer.write_message("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", 10**9, array)
    text = make(capsys, tmp_path / "bag", *FEW).page.text
    assert "Counted in flight by /identifier" in text
    assert "stamp_back17" in text


def test_two_aircraft_must_be_told_apart(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    one = record(tmp_path / "one", INPUTS, namespace="/a/")
    two = record(tmp_path / "two", INPUTS, namespace="/b/")
    with BagWriter(tmp_path / "both") as writer:
        for source in (one, two):
            for message in BagReader(source):
                writer.write(*message)
    assert report.main([str(tmp_path / "both")]) == 2
    assert "--namespace" in capsys.readouterr().err
    assert make(capsys, tmp_path / "both", "--namespace", "b", *FEW).summary["samples"] == 261


PROBE = """
<script>
addEventListener('load', () => {
  const seen = [...document.querySelectorAll('figure img')];
  seen[0].closest('button').click();
  const box = document.querySelector('dialog'), big = box.querySelector('img');
  const before = big.getBoundingClientRect().width;
  const turn = { deltaY: -500, clientX: 300, clientY: 300, bubbles: true, cancelable: true };
  box.dispatchEvent(new WheelEvent('wheel', turn));
  const result = {
    figures: seen.length,
    rendered: seen.filter(i => i.complete && i.naturalWidth > 0 && i.getBoundingClientRect().width > 600).length,
    requests: performance.getEntriesByType('resource').map(e => e.name).filter(n => !n.startsWith('data:')),
    opened: box.open, zoom: big.getBoundingClientRect().width / before,
    overflow: document.documentElement.scrollWidth - innerWidth,
    smallest: Math.min(...[...document.querySelectorAll('p,td,figcaption,li')].map(
      e => parseFloat(getComputedStyle(e).fontSize))),
  };
  const note = document.createElement('pre');
  note.id = 'probe'; note.textContent = JSON.stringify(result); document.body.append(note);
});
</script>
"""


def look(page: Path, folder: Path) -> tuple[dict[str, Any], str]:
    """Open a page in a headless Chromium; return what the probe saw, and the browser's log of the console."""
    probed = folder / "probed.html"
    probed.write_text(page.read_text(encoding="utf-8").replace("</body>", PROBE + "</body>"), encoding="utf-8")
    assert CHROMIUM is not None
    flags = [
        "--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-component-update",
        "--disable-sync", "--no-first-run", "--disable-dev-shm-usage", "--host-resolver-rules=MAP * ~NOTFOUND",
        f"--user-data-dir={folder / 'profile'}", "--window-size=1366,900", "--enable-logging=stderr",
    ]  # fmt: skip
    command = [CHROMIUM, *flags, "--virtual-time-budget=8000", "--dump-dom", probed.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    found = re.search(r'<pre id="probe">(.*?)</pre>', done.stdout, re.DOTALL)
    assert found is not None, done.stderr
    return json.loads(found.group(1).replace("&amp;", "&")), done.stderr


def test_a_browser_renders_every_figure_and_asks_no_network(whole: Made, tmp_path: Path) -> None:
    page = whole.page
    shown = [image for image in page.images if image["src"].startswith("data:image/svg+xml")]
    assert len(shown) == len(whole.figures)
    assert all(image["alt"] and int(image["width"]) > 600 and int(image["height"]) > 100 for image in shown)
    if CHROMIUM is None:
        return
    seen, log = look(whole.path, tmp_path)
    assert seen["figures"] == seen["rendered"] == len(whole.figures)
    assert seen["requests"] == []
    assert seen["opened"] is True
    assert seen["zoom"] > 2.0
    assert seen["overflow"] <= 0
    assert seen["smallest"] >= 14.0
    assert "CONSOLE" not in log, log


@pytest.mark.parametrize(("left", "told"), [(0.5, True), (0.9, False)])
def test_a_slow_change_of_the_plant_is_described_with_its_effectiveness(left: float, told: bool) -> None:
    time = np.arange(0.0, 10.0, 0.1)
    b = np.zeros((len(time), 2, 2))
    b[:, 0], b[:, 1] = [0.1, 1.6], [-3.0, 0.05]
    b[:, 0, 1] *= np.interp(time, [4.0, 8.0], [1.0, left])
    empty = np.zeros((1, 2, 2))
    flags = np.zeros((1, 2, 2), np.bool_)
    models = Models(
        np.zeros(1), ("P", "Q"), ("de", "ddt"), (), empty, empty, empty, empty, flags[0], flags, flags, empty[0],
        np.ones((1, 2)),
    )  # fmt: skip
    truth = Truth(time, np.zeros((len(time), 2, 2)), b)
    assert find_changes(truth, models) == []
    sentence = describe_drift(truth, models)
    assert ("changed slowly: effectiveness of ddt on dP/dt to 0.50" in sentence) == told
    assert sentence.startswith("From about 4.2 to 7.8 s") == told
