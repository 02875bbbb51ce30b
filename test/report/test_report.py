"""The report: what the page shows, that it needs nothing from outside, and what wrong usage gets."""

from __future__ import annotations

import csv
import io
import json
import re
import shutil
import subprocess
from dataclasses import dataclass, field, replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import pytest
from report.report_bags import ALL, FAULT, INPUTS, STEP, record

from msls_ros import records
from msls_ros.bags import BagReader, BagWriter, typestore
from msls_ros.commands import report
from msls_ros.estimation import Configuration, Dither, Level
from msls_ros.estimation.bank.regression import BankRegression
from msls_ros.estimation.samples import Preparation
from msls_ros.report.knowledge import SlowChange
from msls_ros.report.recorded import Event, Models, Recorded, Trust, Truth, TruthChange, joined
from msls_ros.report.verdict import verdict
from msls_ros.report.words import describe_drift, describe_truth, false_alarms, find_changes

CHROMIUM = next((p for p in map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome")) if p), None)
LARGEST = 3_000_000
FEW = ("--parameter", "P/ddt")
"""Drawn faster than the eight of the default."""


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
    arguments = report.parser().parse_args([str(bag), "--out", str(out), "--png", str(out / "png")])
    return Made(report.run(arguments), out / report.PAGE)


def test_a_whole_flight_gets_every_section_in_the_order_of_the_readers_questions(whole: Made) -> None:
    assert whole.summary["sections"] == [
        "trust", "changes", "model", "parameters", "flight", "events", "detection", "dither", "refusals",
        "configuration", "numbers",
    ]  # fmt: skip
    assert whole.figures == {"trust", "changes", "parameters", "flight", "detection", "dither"}
    images = [Path(path) for path in whole.summary["png"]]
    assert {image.stem for image in images} == whole.figures
    assert all(image.read_bytes().startswith(b"\x89PNG") for image in images)
    page = whole.page
    assert page.unbalanced == []
    assert len(page.ids) == len(set(page.ids))
    assert {f"figure-{name}" for name in whole.figures} <= set(page.ids)
    anchors = {anchor for anchor in page.anchors if anchor.startswith("#")}
    assert {anchor.removeprefix("#") for anchor in anchors} <= set(page.ids)
    assert len(anchors) == 12


def test_the_verdict_says_what_happened_in_words(whole: Made) -> None:
    said = whole.summary["verdict"]
    assert re.search(r"Effect left from 4\.02 s: .*(de|ddt) \d+ ± [\d.]+ %|change of .*dP/dt.* at 4\.02 s", said[0])
    assert re.search(r"\d+ of \d+ numbers known to better than 10 %", said[1])
    joined = " ".join(said)
    assert f"At {FAULT:.2f} s the plant itself changed" in joined
    assert re.search(r"of de on dQ/dt to 0\.50", joined)
    assert re.search(r"ddt on dP/dt to 0\.50", joined)
    assert "Detected after 0.02 s, in dP/dt" in joined
    assert "No false alarm." in joined
    text = whole.page.text
    for sentence in said:
        assert sentence in text
    for needed in ("estimator.forgetting_factor", "numpy", "numba", "Python", "msls_msgs/msg/LinearModel", "b43"):
        assert needed in text
    assert "No message was refused." in text


def test_trust_is_measured(whole: Made) -> None:
    text = whole.page.text
    assert re.search(r"predicts \d+\.\d to (9\d\.\d|100\.0) % of the variance", text)
    assert re.search(r"Against least squares over all samples from 0\.0 to 4\.0 s, \d+ of \d+ numbers", text)
    assert "Check of the data" in text


def test_the_numbers_can_be_taken_out_of_the_page(whole: Made) -> None:
    links = {
        a.partition(";")[0]: unquote(a.partition(",")[2]) for a in whole.page.addresses if a.startswith("data:text/")
    }
    rows = list(csv.DictReader(io.StringIO(links["data:text/csv"])))
    assert len(rows) == 6 * 13
    p_ddt = next(r for r in rows if (r["row"], r["column"]) == ("P", "ddt"))
    assert float(p_ddt["at_end"]) == pytest.approx(0.8, abs=0.3)
    (saved,) = [unquote(a.partition(",")[2]) for a in whole.page.addresses if a.startswith("data:application/json")]
    assert json.loads(saved)["verdict"] == whole.summary["verdict"]


def test_the_detector_is_computed_again_and_equals_what_was_recorded(whole: Made) -> None:
    assert "equals the recorded one bit for bit in all 321 models" in whole.summary["agreement"]


def test_every_line_in_a_key_has_a_name(whole: Made) -> None:
    names = re.findall(r"</svg>([^<]*) <b data-line=", whole.path.read_text(encoding="utf-8"))
    assert len(names) > 40 and all(name.strip() for name in names)


def test_the_page_is_complete_in_itself_and_small(whole: Made) -> None:
    html = whole.path.read_text(encoding="utf-8")
    page = Page(html)
    assert len(html.encode()) == whole.summary["bytes"] < LARGEST
    assert page.policy.startswith("default-src 'none'")
    assert all(address.startswith(("#", "data:")) for address in page.addresses), page.addresses
    assert not re.search(r"https?:|//[a-z]+\.|@import|url\(", html)
    assert "<svg" in html and "<img" not in html


def test_the_same_bag_gives_the_same_bytes(bag: Path, whole: Made, tmp_path: Path) -> None:
    again = report.run(report.parser().parse_args([str(bag), "--out", str(tmp_path)]))
    assert Path(again["report"]).read_bytes() == whole.path.read_bytes()


def test_a_new_report_shows_what_is_asked_for(bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "mine.png").write_bytes(b"mine")
    made = make(capsys, bag, "--out", str(tmp_path), "--parameter", "P/ddt", "--parameter", "Q/w")
    assert made.summary["parameters"] == ["P/ddt", "Q/w"]
    assert "∂(dQ/dt) / ∂w" in made.page.text
    assert (tmp_path / "mine.png").read_bytes() == b"mine"


def test_by_default_b43_is_among_the_parameters_and_all_are_of_b(whole: Made) -> None:
    assert "P/ddt" in whole.summary["parameters"]
    assert 2 <= len(whole.summary["parameters"]) <= 8
    assert all(name.split("/")[1] in Configuration().effectors for name in whole.summary["parameters"])


def test_without_truth_and_configuration_it_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = record(tmp_path / "bag", ALL - {"truth/model"}, kept=False)
    made = make(capsys, bag, *FEW)
    assert made.path == tmp_path / "report" / "report.html"
    assert "residuals" in made.figures and "events" in made.summary["sections"]
    assert not {"detection", "trust"} & made.figures
    text = made.page.text
    assert "no truth" in text
    assert "--params" in text
    assert "4.0" in made.summary["verdict"][0]


def test_inputs_alone_are_identified_offline(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = make(capsys, record(tmp_path / "flown", INPUTS, kept=False), *FEW)
    assert made.path.parent == tmp_path / "flown_report"
    assert made.summary["models"] == "models computed from the recorded inputs"
    assert made.summary["samples"] == 321
    assert {"trust", "detection", "parameters"} <= made.figures
    assert "dither" not in made.summary["sections"], "none was injected"
    assert any("holds no model" in sentence for sentence in made.summary["missing"])
    assert "defaults" in made.page.text and "Gravity is not taken off" not in made.page.text


def test_without_phi_the_report_says_that_gravity_stays_and_how_to_add_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    along = Configuration().replace({"states": ("u", "w", "Q", "Theta"), "known_gravity": False})
    made = make(capsys, record(tmp_path / "bag", INPUTS, configuration=along, kept=False), "--parameter", "Q/de")
    assert re.search(r"Gravity is not taken off\. Better add .* of Phi and Theta .*scale=0", made.page.text)


def test_a_lag_that_was_found_is_written_beside_the_model(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(BankRegression, "lag", property(lambda self: 0.035))
    made = make(capsys, record(tmp_path / "flown", INPUTS, kept=False), *FEW)
    assert "like commands to servos: through a lag of 35 ms, 0 ms late" in made.page.text


def test_velocities_that_were_late_are_written_beside_the_model(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    late = np.array([0.0, 0.02, -0.012, *[0.0] * 6])
    monkeypatch.setattr(Preparation, "state_delay", property(lambda self: late))
    made = make(capsys, record(tmp_path / "flown", INPUTS, kept=False), *FEW)
    assert "later than their derivatives: v 20 ms, w -12 ms at the end" in made.page.text


def test_an_identifier_of_another_aircraft_gets_a_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = Configuration(states=("P", "Q", "R"), effectors=("de", "ddt"))
    epoch = 1_790_000_000 * 10**9
    bag = record(tmp_path / "bag", ALL, configuration=other, namespace="/drone_7/", start=epoch)
    made = make(capsys, bag)
    assert {"trust", "detection", "flight"} <= made.figures
    assert "2026-09-21" in made.page.text
    assert "/drone_7/model" in made.page.text


def test_models_alone_get_a_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = make(capsys, record(tmp_path / "bag", {"model", "fault"}), *FEW)
    assert {"parameters", "residuals"} <= made.figures
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
    assert 50 < made.summary["samples"] < 321
    assert made.summary["warnings"]
    assert made.summary["warnings"][0] in made.page.text


def test_of_a_bag_whose_time_jumps_back_one_stretch_is_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = make(capsys, record(tmp_path / "bag", passes=2), *FEW)
    (said,) = [warning for warning in made.summary["warnings"] if "time jumps back" in warning]
    assert "the longest is shown, 0.00 to 6.40 s as stamped" in said
    assert "Not shown: 0.00 to 6.40 s; there is no option" in said
    assert made.summary["alarms"] == 1
    assert "bit for bit in all 321 models" in made.summary["agreement"]


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
    assert make(capsys, tmp_path / "both", "--namespace", "b", *FEW).summary["samples"] == 321


PROBE = """
<script>
addEventListener('load', () => {
  const charts = [...document.querySelectorAll('figure.chart')], plots = [...document.querySelectorAll('.plot')];
  plots[0].scrollIntoView();
  const box = plots[0].getBoundingClientRect(), x = box.left + 0.5 * box.width;
  const at = { clientX: x, clientY: box.top + 20, bubbles: true, cancelable: true, pointerId: 1, pointerType: 'mouse' };
  plots[0].dispatchEvent(new PointerEvent('pointermove', at));
  const shown = plots.filter(p => p.querySelector('.cursor').style.display === 'block').length;
  const values = [...charts[0].querySelectorAll('b[data-line]')].slice(0, 2).map(b => b.textContent);
  charts[0].focus();
  plots[0].dispatchEvent(new WheelEvent('wheel', { ...at, deltaY: -400 }));
  for (const key of ['+', 'ArrowRight']) charts[0].dispatchEvent(new KeyboardEvent('keydown', { key, bubbles: true }));
  setTimeout(() => {
    const scale = [...document.querySelectorAll('g.zoom')].map(g => g.transform.baseVal[0].matrix.a);
    const result = {
      charts: charts.length, plots: plots.length, shown, values, scale: [Math.min(...scale), Math.max(...scale)],
      drawn: plots.filter(p => p.querySelector('path.line') && p.getBoundingClientRect().width > 200).length,
      requests: performance.getEntriesByType('resource').map(e => e.name).filter(n => !n.startsWith('data:')),
      overflow: document.documentElement.scrollWidth - innerWidth,
      smallest: Math.min(...[...document.querySelectorAll('p,td,figcaption,li,.ys span,.head')].map(
        e => parseFloat(getComputedStyle(e).fontSize))),
    };
    const note = document.createElement('pre');
    note.id = 'probe'; note.textContent = JSON.stringify(result); document.body.append(note);
  }, 300);
});
</script>
"""


def look(page: Path, folder: Path, width: int) -> tuple[dict[str, Any], str]:
    """Open a page in a headless Chromium; return what the probe saw, and the browser's log of the console."""
    probed = folder / "probed.html"
    probed.write_text(page.read_text(encoding="utf-8").replace("</body>", PROBE + "</body>"), encoding="utf-8")
    assert CHROMIUM is not None
    flags = [
        "--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-component-update",
        "--disable-sync", "--no-first-run", "--disable-dev-shm-usage", "--host-resolver-rules=MAP * ~NOTFOUND",
        f"--user-data-dir={folder / 'profile'}", f"--window-size={width},900", "--enable-logging=stderr",
    ]  # fmt: skip
    command = [CHROMIUM, *flags, "--virtual-time-budget=8000", "--dump-dom", probed.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    found = re.search(r'<pre id="probe">(.*?)</pre>', done.stdout, re.DOTALL)
    assert found is not None, done.stderr
    return json.loads(found.group(1).replace("&amp;", "&")), done.stderr


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")
@pytest.mark.parametrize("width", [1440, 500])
def test_a_browser_shows_one_cursor_and_one_zoom_over_all_charts_and_asks_no_network(
    whole: Made, tmp_path: Path, width: int
) -> None:
    seen, log = look(whole.path, tmp_path, width)
    assert seen["charts"] == len(whole.figures)
    assert seen["plots"] == seen["drawn"] == seen["shown"] > 20
    assert all(re.fullmatch(r"−?[\d.]+(e.\d+)?", value) for value in seen["values"]), seen
    assert seen["scale"][0] == seen["scale"][1] > 2.0
    assert seen["requests"] == []
    assert seen["overflow"] <= 0
    assert seen["smallest"] >= 12.0
    assert "CONSOLE" not in log, log


def test_without_script_every_chart_stands_drawn_with_its_ticks(whole: Made) -> None:
    html = re.sub(r"<script>.*?</script>", "", whole.path.read_text(encoding="utf-8"), flags=re.S)
    panels = html.split('<div class="panel"')[1:]
    assert len(panels) > 20
    for panel in panels:
        assert re.search(r'<path class="line s\d" d="M-?\d+ -?\d+[lh]', panel)
        assert len(re.findall(r'<span style="left:', panel)) >= 3 and len(re.findall(r'<span style="top:', panel)) >= 2


def test_an_axial_force_that_goes_with_the_deflection_is_no_change_of_the_plant() -> None:
    time = np.arange(0.0, 10.0, 0.1)
    b = np.zeros((len(time), 2, 1))
    b[:, 0, 0] = np.where(time < 5.0, 2.0, 1.0)
    b[:, 1, 0] = np.where(time < 7.0, -3.0, -1.5)
    empty = np.zeros((1, 2, 2))
    flags = np.zeros((1, 2, 2), np.bool_)
    models = Models(
        np.zeros(1), ("u", "Q"), ("dte",), (), empty, empty, empty, empty, flags[0], flags, flags, empty[0],
        np.ones((1, 2)),
    )  # fmt: skip
    (change,) = find_changes(Truth(time, np.zeros((len(time), 2, 2)), b), models)
    assert change.time == pytest.approx(6.9)
    assert change.effects == (("dte", "Q", 0.5),)


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


def event(time: float, kind: str, *equations: str, effector: str = "") -> Event:
    zeros = (5.0,) * len(equations)
    return Event(time, kind, equations, zeros, zeros, effector, 0.5, 0.1, f"{kind} at {time:g} s")


def test_alarms_of_one_change_in_several_equations_are_one() -> None:
    """Each equation shows a change after a time of its own; what is named, recovers or alarms again is a new one."""
    named = event(4.3, "isolated", "P", "R", effector="da")
    events = [event(4.02, "detected", "P"), event(4.06, "detected", "R"), named, event(4.4, "detected", "Q")]
    events += [event(5.0, "detected", "Q"), event(5.1, "detected", "w"), event(5.2, "detected", "w")]
    events += [event(5.8, "detected", "v")]
    found = joined(events)
    assert [(e.time, e.kind, e.equations) for e in found] == [
        (4.02, "detected", ("P", "R")), (4.3, "isolated", ("P", "R")), (4.4, "detected", ("Q",)),
        (5.0, "detected", ("Q", "w")), (5.2, "detected", ("w",)), (5.8, "detected", ("v",)),
    ]  # fmt: skip
    assert found[0].description == "detected at 4.02 s; dR/dt 0.04 s later"
    assert len(found[0].statistic) == len(found[0].threshold) == 2


def test_the_verdict_counts_changes_and_not_their_equations() -> None:
    events = [event(4.02, "detected", "P"), event(4.06, "detected", "R"), event(4.3, "isolated", "P", effector="da")]
    flight = Recorded("made/up", "", [], events=events)
    change = TruthChange(4.0, (("da", "P", 0.5),))
    (_, answer) = describe_truth(flight, change)
    assert answer.startswith("Detected after 0.02 s, in dP/dt and dR/dt; isolated to da after 0.30 s")
    assert [e.time for e in false_alarms(flight, [])] == [4.02]


@pytest.mark.parametrize(
    ("inside", "compared", "warned"),
    [(6, 13, True), (8, 13, True), (9, 13, False), (13, 13, False), (0, 2, False), (0, 3, True), (0, 0, False)],
)
def test_far_fewer_numbers_that_agree_with_least_squares_than_should_are_a_warning(
    inside: int, compared: int, warned: bool
) -> None:
    """8 of 13 or fewer agree by chance once in 3,500 flights, 9 or fewer once in 320."""
    flight = Recorded("made/up", "", [], trust=Trust([], (10.0, 150.0), inside, compared))
    found = [s for s in verdict(flight, None, [], []) if s.startswith("WARNING")]
    said = f"only {inside} of {compared} numbers known agree with least squares over 10.0 to 150.0 s"
    assert [said in one for one in found] == [True] * warned
    slow = SlowChange("P/da", 10.0, 40.0, 2.0, 1.0)
    assert not any(s.startswith("WARNING") for s in verdict(flight, None, [slow], []))


@pytest.mark.parametrize("added", [True, False])
def test_a_recorded_dither_that_nobody_added_is_a_warning(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], added: bool
) -> None:
    random, names = np.random.default_rng(0), {"effectors": ["de", "dr"]}
    sent = Dither(np.zeros(2), 0.0, 0.0, 0.0, Level.NOMINAL, "test")
    with BagWriter(tmp_path / "bag") as writer:
        for k in range(1000):
            stamp = k * STEP
            header = {"header": records.header_fields(stamp)}
            delta = 0.01 * np.sin(0.02 * k) + 2e-4 * random.normal(size=2) + (sent.delta if added else 0.0)
            state = {**header, "states": ["P", "Q", "R"], "x": random.normal(size=3), "xdot": random.normal(size=3)}
            sent = replace(sent, delta=0.003 * random.normal(size=2))
            for leaf, kind, fields in (
                ("state", "StateSample", state),
                ("effectors", "EffectorSample", {**header, **names, "delta": delta}),
                ("dither", "DitherCommand", {**header, **records.dither_fields(("de", "dr"), sent)}),
            ):
                writer.write_message(f"/{leaf}", f"msls_msgs/msg/{kind}", stamp, fields)
    warnings = make(capsys, tmp_path / "bag", "--parameter", "P/dr").summary["warnings"]
    said = "the dither commanded for de, dr does not come back in their deflections"
    assert any(warning.startswith(said) for warning in warnings) != added
