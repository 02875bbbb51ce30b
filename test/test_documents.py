"""The documents: the README fits on a page, links lead somewhere, quoted files are the files, every command is run.

A command stands in a fenced block ``sh``. Either a test runs it, and `RUN_BY` names the test, or a comment
``<!-- not run: why -->`` stands before its block. A block after ``<!-- file: PATH -->`` holds that file.
"""

from __future__ import annotations

import ast
import importlib
import os
import re
import runpy
import shlex
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import pytest
import yaml
from catkin_pkg.changelog import get_changelog_from_path
from catkin_pkg.package import parse_package

from msls_ros.commands import reference
from msls_ros.flights.scenarios import find_scenario
from msls_ros.inputs import InputMap
from msls_ros.inputs.profiles import read_inputs, read_profile
from msls_ros.testing import Bench

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
EXAMPLES = DOCS / "examples"
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.glob("*.md"))]
README_LINES = 130
PLAIN = ("commands", "report", "offline", "paper", "campaigns")
"""Rooms whose words people read."""

HERE = "test/test_documents.py"
DEMO = "test/commands/test_demo.py::test_the_same_seed_gives_the_same_numbers_and_the_same_messages"
CAMPAIGN = "test/campaigns/test_campaign.py"
BENCHMARK = "test/commands/test_benchmark.py"
LIVE = f"{HERE}::test_the_live_fault_is_flown_as_the_page_says"
BAG = f"{HERE}::test_the_commands_on_a_bag_run_one_after_the_other"
RUN_BY = {
    "./msls demo": DEMO,
    "./msls demo --scenario c172x_elevator_half": "test/commands/test_demo.py"
    "::test_another_aircraft_flies_is_judged_replayed_and_reported",
    "./msls demo --scenario docs/examples/my_flight.yaml": "test/flights/test_scenario_flights.py"
    "::test_the_demo_flies_an_own_file_and_judges_it_by_what_it_watches",
    "./msls test": "itself",
    "./msls test test/estimation -k detect": "itself",
    "./msls test docs/examples/test_my_aircraft.py": f"{HERE}::test_the_example_for_pytest_passes",
    "./msls identifier --ros-args --params-file docs/examples/my_stack.yaml": f"{HERE}"
    "::test_the_identifier_takes_the_example_of_a_stack",
    "./msls recorder --ros-args --params-file docs/examples/my_stack.yaml -p out:=out/flight": f"{HERE}"
    "::test_the_recorder_takes_the_example_of_a_stack",
    "./msls replay out/flight": "test/nodes/test_recorder.py"
    "::test_a_mapped_flight_is_recorded_and_replays_by_itself_to_the_bits_of_the_flight",
    "./msls inspect bags/tail_fault": BAG,
    "./msls replay bags/tail_fault": BAG,
    "./msls report bags/tail_fault": BAG,
    "./msls recorder --repair out/replay/tail_fault": BAG,
    "./msls replay bags/*/ --jobs 2 --every 10": "test/fleet/test_fleet.py"
    "::test_replay_of_many_bags_gives_the_same_with_two_jobs",
    "./msls python docs/examples/identify_arrays.py": f"{HERE}::test_the_example_with_arrays_finds_b",
    "./msls python docs/examples/identify_log.py bags/tail_fault": f"{HERE}"
    "::test_the_example_in_python_finds_what_was_lost_and_the_effect_of_an_own_log",
    "./msls pilot": LIVE,
    "./msls plant --ros-args -p mode:=real_time -p duration:=60.0": LIVE,
    "./msls identifier --ros-args --params-file config/f16.yaml -p use_sim_time:=true": LIVE,
    "./msls python docs/examples/inject_fault.py": LIVE,
    "./msls campaign roll_doublet_tail_fault docs/examples/my_flight.yaml --seeds 20 --noise none,low --jobs 2": (
        f"{CAMPAIGN}::test_two_jobs_give_the_same_table_as_one"
    ),
    "./msls campaign roll_doublet_tail_fault --seeds 10 --compare estimator.method=bank,msls": (
        f"{CAMPAIGN}::test_comparisons_fly_all_combinations_and_rls_has_the_same_lambda"
    ),
    "./msls demo --scenario nozzle_hard_over --law auto": "test/commands/test_demo.py"
    "::test_a_law_is_flown_beside_the_fixed_one_drawn_and_told",
    "./msls campaign nozzle_hard_over --seeds 10 --compare law=fixed,indi,auto": (
        f"{CAMPAIGN}::test_laws_are_compared_by_flights_kept_and_tracking"
    ),
    "./msls paper": "test/paper/test_command.py::test_json_is_one_object_with_the_table_the_claims_and_the_figures",
    "./msls benchmark kernel": f"{BENCHMARK}::test_kernel_prints_one_json_value_with_every_contender",
    "./msls benchmark stress": f"{BENCHMARK}::test_both_tables_name_what_is_missing",
    "./msls benchmark replay": "test/offline/test_blocks.py::test_the_benchmark_gives_both_rates_and_their_ratio",
    "./msls benchmark faults": f"{BENCHMARK}::test_damaged_bags_crash_nothing_and_lose_nothing_in_silence",
    "./msls benchmark campaign": f"{BENCHMARK}::test_campaign_prints_how_many_times_real_time_a_flight_takes",
}
"""The test that runs each command, with other seeds, folders or fewer flights where it would take long."""


class Block(NamedTuple):
    """A fenced block, with the comment before it."""

    page: Path
    language: str
    text: str
    comment: str

    @property
    def not_run(self) -> bool:
        found = re.fullmatch(r"not run: (.*)", self.comment)
        return found is not None and len(found[1]) > 10

    @property
    def commands(self) -> list[str]:
        """Commands, one each, without comments."""
        lines = self.text.replace("\\\n", " ").splitlines()
        parts = [part for line in lines for part in re.sub(r"(^|\s)#.*", "", line).split(" & ")]
        return [" ".join(part.split()) for part in parts if part.strip()]


def blocks(page: Path) -> Iterator[Block]:
    text = page.read_text(encoding="utf-8")
    for found in re.finditer(r"(?:<!-- (.*?) -->\n)?^```(\w+)\n(.*?)^```$", text, re.M | re.S):
        yield Block(page, found[2], found[3], found[1] or "")


ALL = [block for page in PAGES for block in blocks(page)]
SHELL = [block for block in ALL if block.language == "sh"]


def environment(**more: str) -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *filter(None, sys.path)]), **more}


def process(command: str, **more: str) -> subprocess.Popen[str]:
    """Start a command as ./msls does, once it has set up."""
    _, name, *rest = shlex.split(command)
    code = f"import sys; from msls_ros.commands.{name} import main; sys.exit(main())"
    return subprocess.Popen(
        [sys.executable, *([] if name == "python" else ["-c", code]), *rest],
        cwd=ROOT,
        env=environment(**more),
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )


def test_the_readme_fits_on_a_page() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= README_LINES


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_relative_link_leads_to_a_file_and_a_heading(page: Path) -> None:
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.S)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if re.match(r"https?://", target):
            continue
        name, _, anchor = target.partition("#")
        path = (page.parent / name).resolve() if name else page
        assert path.exists(), target
        if anchor and path.exists():
            assert anchor in anchors(path), target


def anchors(page: Path) -> set[str]:
    """Return what headings are called in links."""
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.S)
    heads = [re.sub(r"[`*]|\]\([^)]*\)|\[", "", head).strip().lower() for head in re.findall(r"(?m)^#+ (.*)$", text)]
    return {re.sub(r"[^\w\- ]", "", head).replace(" ", "-") for head in heads}


def test_documents_help_and_page_speak_plainly() -> None:
    rooms = [path for room in PLAIN for path in sorted((ROOT / "msls_ros" / room).rglob("*.py"))]
    for path in [*PAGES, *rooms, *sorted((ROOT / "msg_defs").rglob("*.msg"))]:
        found = re.search(
            r"(?i)\b(stray\w*|wander\w*|bend(s|ing)|bent|strangers?|tower|told|tells|every day)\b", path.read_text()
        )
        assert found is None, f"{path.name}: '{found[0]}'"


def test_every_page_is_in_the_index() -> None:
    index = (DOCS / "README.md").read_text(encoding="utf-8")
    assert not [page.name for page in DOCS.glob("*.md") if page.name != "README.md" and f"({page.name})" not in index]


def test_a_block_that_quotes_a_file_is_the_file() -> None:
    quoted = [(block, block.comment.removeprefix("file: ")) for block in ALL if block.comment.startswith("file: ")]
    for block, name in quoted:
        path = block.page.parent / name
        assert block.text == path.read_text(encoding="utf-8"), f"{block.page.name}: copy {name} into its block"
    shown = {(block.page.parent / name).resolve() for block, name in quoted}
    linked = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
    for path in EXAMPLES.iterdir():
        if path.suffix in (".py", ".yaml"):
            assert path in shown or f"examples/{path.name})" in linked, f"{path.name} is on no page"


@pytest.mark.parametrize("block", SHELL, ids=lambda block: f"{block.page.stem}: {block.text.splitlines()[0][:40]}")
def test_every_command_is_run_by_a_test_or_says_why_not(block: Block) -> None:
    for command in block.commands:
        words = shlex.split(command)
        if words[0] == "./msls" and words[1] in reference.TOOLS:
            reference.TOOLS[words[1]]().parse_args(words[2:])
        if not block.not_run:
            assert command in RUN_BY, (
                f"{command}: name the test that runs it in RUN_BY, or say why not before the block"
            )


def test_every_command_is_in_a_block_of_its_language() -> None:
    for block in ALL:
        assert block.language != "bash", f"{block.page.name}: a command stands in a block `sh`"
        if block.language != "sh":
            assert "./msls " not in block.text.replace("`./msls", ""), f"{block.page.name}: {block.text[:60]}"


def test_what_is_said_to_run_a_command_exists_and_is_asked_for() -> None:
    commands = {command for block in SHELL for command in block.commands}
    assert set(RUN_BY) <= commands
    for name in set(RUN_BY.values()) - {"itself"}:
        file, _, function = name.partition("::")
        tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
        assert function in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}, name


def test_the_reference_is_what_the_code_gives() -> None:
    found = (DOCS / "reference.md").read_text(encoding="utf-8")
    assert found == reference.reference(), (
        "write it again: ./msls python -m msls_ros.commands.reference docs/reference.md"
    )


def test_the_yaml_of_the_examples_is_accepted() -> None:
    for name in ("my_stack", "my_aircraft"):
        read_profile(EXAMPLES / f"{name}.yaml")
    assert read_inputs(EXAMPLES / "my_stack.yaml") is not None
    assert find_scenario(EXAMPLES / "my_flight.yaml").faults[1].effector == "nozzle_yaw"
    (short,) = [block for block in blocks(ROOT / "README.md") if block.language == "yaml"]
    InputMap.from_parameters(yaml.safe_load(short.text)["inputs"])


def test_the_example_with_arrays_finds_b(capsys: pytest.CaptureFixture[str]) -> None:
    runpy.run_path(str(EXAMPLES / "identify_arrays.py"))
    numbers = [float(word) for word in re.findall(r"-?\d+\.\d+", capsys.readouterr().out)][::2]
    assert numbers == pytest.approx([12.0, 1.5, -0.6, -5.0], rel=0.02)


def test_the_example_in_python_finds_what_was_lost_and_the_effect_of_an_own_log(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["identify_log.py", str(ROOT / "bags" / "tail_fault")])
    runpy.run_path(str(EXAMPLES / "identify_log.py"))
    out = capsys.readouterr().out
    assert "(4.3, 'ISOLATED', 'left_stabilator')" in out
    assert float(re.findall(r"-?\d+\.\d+", out)[-2]) == pytest.approx(12.0, rel=0.03)


def test_the_example_for_pytest_passes() -> None:
    command = [sys.executable, "-m", "pytest", "-q", "docs/examples/test_my_aircraft.py"]
    done = subprocess.run(command, cwd=ROOT, env=environment(), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    assert "2 passed" in done.stdout


def test_the_commands_on_a_bag_run_one_after_the_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "bags").symlink_to(ROOT / "bags")
    monkeypatch.chdir(tmp_path)
    for command in (command for command, test in RUN_BY.items() if test == BAG):
        _, name, *rest = shlex.split(command)
        assert importlib.import_module(f"msls_ros.commands.{name}").main(rest) == 0, command
    assert "was whole" in capsys.readouterr().out
    assert (tmp_path / "out" / "report" / "tail_fault" / "report.html").stat().st_size > 100_000


def test_the_identifier_takes_the_example_of_a_stack(bench: Bench) -> None:
    command = "./msls identifier --ros-args --params-file docs/examples/my_stack.yaml"
    node = process(command, ROS_DOMAIN_ID=str(bench.domain))
    try:
        for count, topic in (
            (bench.probe.count_subscribers, "/joint_states"),
            (bench.probe.count_publishers, "/dither"),
        ):
            bench.spin_until(lambda count=count, topic=topic: count(topic) or node.poll() is not None, command)  # type: ignore[misc]
            assert node.poll() is None, node.communicate()
    finally:
        node.kill()
        node.communicate()


def test_the_recorder_takes_the_example_of_a_stack(bench: Bench, tmp_path: Path) -> None:
    command = "./msls recorder --ros-args --params-file docs/examples/my_stack.yaml -p out:=out/flight"
    assert command in RUN_BY
    node = process(command.replace("out/flight", str(tmp_path / "flight")), ROS_DOMAIN_ID=str(bench.domain))
    bench.spin_until(lambda: bench.probe.count_subscribers("/joint_states") or node.poll() is not None, command)
    node.terminate()
    said, _ = node.communicate(timeout=60)
    assert node.returncode == 0 and "WARN" not in said and "ERROR" not in said, said
    files = (tmp_path / "flight" / "identifier.yaml", EXAMPLES / "my_stack.yaml")
    kept, given = (yaml.safe_load(file.read_text())["/**"]["ros__parameters"]["inputs"] for file in files)
    assert kept == given


def test_the_live_fault_is_flown_as_the_page_says(bench: Bench) -> None:
    """The commands of docs/live_fault.md, in the order of its terminals."""
    with ExitStack() as stack:
        for command in (command for command, test in RUN_BY.items() if test == LIVE):
            started = process(command, ROS_DOMAIN_ID=str(bench.domain))
            stack.callback(started.communicate)
            stack.callback(started.kill)
        out, _ = started.communicate(timeout=240)
    assert started.returncode == 0, out
    assert "left_stabilator lost, from 4.0" in out
    assert "abrupt change in" in out  # whether it is isolated in real time depends on the load of the machine


@pytest.mark.parametrize("folder", [ROOT, ROOT / "msg_defs"], ids=["msls_ros", "msls_msgs"])
def test_a_package_has_a_changelog_in_the_ros_form_and_links_that_exist(folder: Path) -> None:
    package = parse_package(str(folder / "package.xml"))
    get_changelog_from_path(str(folder / "CHANGELOG.rst"), package.name)
    title = f"Changelog for package {package.name}"
    lines = (folder / "CHANGELOG.rst").read_text(encoding="utf-8").splitlines()
    assert lines[:3] == ["^" * len(title), title, "^" * len(title)]
    (url,) = package.urls
    assert (folder / url.url).exists() or url.url.startswith("https://")
