"""`demo`: fly the closed loop over DDS, record it, compare with truth and peers, draw it."""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import textwrap
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import msls_ros.messages  # noqa: F401  first of what needs msls_msgs: says what to do where that is not built

# isort: split
from rclpy.logging import LoggingSeverity, set_logger_level

from msls_ros.bags import check_replaceable
from msls_ros.commands.arguments import OneLineParser, seed
from msls_ros.commands.compiling import compile_once
from msls_ros.commands.demo_end import write_page
from msls_ros.commands.law_demo import show_law
from msls_ros.commands.progress import Progress
from msls_ros.commands.report import default_folder, remove_report
from msls_ros.control import LAWS, ControlError
from msls_ros.flights.aircraft_files import shipped_aircraft
from msls_ros.flights.comparison import Comparison, summarise
from msls_ros.flights.judging import LABELS
from msls_ros.flights.scenario_law import changed_law
from msls_ros.flights.scenarios import Scenario, ScenarioError, find_scenario, listing
from msls_ros.nodes.flight import FlightError, fly
from msls_ros.nodes.loopback import stay_on_this_machine
from msls_ros.nodes.running import bad_input
from msls_ros.offline.comparison import compare
from msls_ros.plant import NOISE_LEVELS

NEVER = 0.1
"""An error that is too large so near the end has never settled [s]."""


def parser() -> argparse.ArgumentParser:
    """Return the command line."""
    result = OneLineParser(
        prog="demo",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Fly an aircraft in closed loop with the identifier, over DDS; record, compare, draw.",
        epilog=lambda: f"scenarios:\n{listing()}\n\nThey are files in config/scenarios/, where each key is explained.",
    )
    result.add_argument(
        "--scenario",
        default="roll_doublet_tail_fault",
        metavar="NAME_OR_FILE",
        help="what to fly: one of those below, or a .yaml file of your own (default: the first)",
    )
    result.add_argument("--noise", choices=list(NOISE_LEVELS), help="sensor noise (default: the scenario's)")
    result.add_argument("--seed", type=seed, default=0, help="of sensor noise, turbulence and dither (default: 0)")
    result.add_argument("--out", type=Path, help="folder for bag, summary and figures (default: out/SCENARIO)")
    result.add_argument("--law", choices=LAWS, help="control law (default: the scenario's, else the fixed one)")
    result.add_argument("--no-dither", action="store_true", help="fly without active noise injection")
    result.add_argument("--json", action="store_true", help="print summary.json on stdout and nothing else")
    return result


def main(argv: Sequence[str] | None = None) -> int:
    """Run the demo; return the exit code."""
    arguments = parser().parse_args(argv)
    try:
        scenario = find_scenario(arguments.scenario)
        if arguments.law is not None:
            scenario = replace(scenario, law=changed_law(scenario.law, {"law": arguments.law}))
    except (ScenarioError, ControlError) as error:
        print(f"demo: {error}", file=sys.stderr)
        return 2
    stay_on_this_machine()
    noise = arguments.noise or scenario.noise
    out = arguments.out or Path("out") / scenario.name
    interrupted: list[int] = []

    def interrupt(number: int, _: object) -> None:
        interrupted.append(number)
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, interrupt)
    try:
        _prepare(out)
        check_replaceable(out / "bag")
        remove_report(default_folder(out / "bag"))  # it shows the flight that is replaced now
        summary = run(scenario, out, noise=noise, seed=arguments.seed, dither=not arguments.no_dither)
    except (Exception, KeyboardInterrupt) as error:
        if interrupted:  # compiled code swallows an interrupt and fails in ways of its own
            print(f"\ndemo: interrupted; what was flown so far is in '{out / 'bag'}'", file=sys.stderr)
            return 130
        if not isinstance(error, (*bad_input(), FlightError, OSError)):
            raise
        print(f"demo: {error}", file=sys.stderr)
        return 2
    finally:
        signal.signal(signal.SIGINT, before)
    print(json.dumps(summary, indent=2) if arguments.json else describe(scenario, summary))
    return 0


def _prepare(out: Path) -> None:
    """Make the folder, or say why it cannot be written."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        probe = out / ".probe"
        probe.touch()
        probe.unlink()
    except OSError as error:
        message = f"the folder '{out}' cannot be written: {error.strerror}"
        raise OSError(message) from error


def run(scenario: Scenario, out: Path, *, noise: str, seed: int, dither: bool) -> dict[str, Any]:
    """Fly, compare, draw; write ``summary.json`` into ``out`` and return what it holds."""
    set_logger_level("rcl", LoggingSeverity.ERROR)
    configuration = scenario.configuration(noise, seed, dither)
    compile_once(configuration.estimator.method, "msls", "rls")  # those it is compared with
    with Progress(f"flying {scenario.name}", scenario.duration, "s") as progress:
        record = fly(
            scenario, configuration, out / "bag", noise=noise, seed=seed, overwrite=True, progress=progress.show
        )
    print("comparing with truth, drawing, writing the page ...", file=sys.stderr, flush=True)
    comparison = compare(record.bag, configuration, scenario.watch, scenario.airframe)
    found = {
        "scenario": scenario.name,
        "aircraft": scenario.aircraft.file
        if scenario.aircraft.name not in shipped_aircraft()
        else scenario.aircraft.name,
        "description": scenario.description,
        "seed": seed,
        "noise": noise,
        "samples": record.samples,
        **summarise(scenario, comparison),
        "refused": dict(record.refused),
        "time_outs": record.time_outs,
        "real_time_factor": round((record.samples - 1) * scenario.rates.period / record.wall_time, 2),
        "bag": str(record.bag),
        "figures": [str(p) for p in draw(scenario, comparison, out, noise, seed)],
        **write_page(record.bag),
    }
    if scenario.law.plan is not None:
        found["law"] = show_law(scenario, configuration, comparison, out, noise, seed)
        found["figures"].append(found["law"]["figure"])
    summary: dict[str, Any] = json.loads(json.dumps(found), parse_constant=lambda _: None)  # JSON knows no NaN
    (out / "summary.json").write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    return summary


def draw(scenario: Scenario, c: Comparison, out: Path, noise: str, seed: int) -> list[Path]:
    """Write the figures; return their paths."""
    from msls_ros.report import flight_figures as figures  # matplotlib takes a second to import

    alarms = [t for t, kind, _ in c.events if kind == "detected"]
    watch = scenario.watch
    about = f"{scenario.description}; sensor noise {noise}, seed {seed}"
    flown = figures.Flown(about, scenario.fault_spans, alarms)
    parameter, states, dither = paths = [out / f"{name}.png" for name in (watch.symbol, "states", "dither")]
    names = scenario.airframe.effectors
    what, label = f"{watch.symbol} = {watch.derivative}, estimated and true", f"{watch.symbol} [{watch.unit}]"
    figures.plot_parameter(parameter, c.time, c.truth, c.estimates, c.std, flown, what, label)
    figures.plot_states(states, c.time, c.x, c.alpha, c.beta, c.delta, names, flown)
    figures.plot_dither(dither, c.time, c.dither, names, c.predicted, c.limit, c.realised, flown)
    return paths


def describe(scenario: Scenario, s: dict[str, Any]) -> str:
    """Return the summary as a short table."""
    watch = scenario.watch
    watched, dither = s[watch.symbol], s["dither"]
    lines = [f"{scenario.description}", f"sensor noise {s['noise']}, seed {s['seed']}, {s['samples']} samples", ""]
    lines += [*(textwrap.fill(sentence, 98) for sentence in s["verdict"]), ""]
    for (start, end), found in zip(scenario.fault_spans, s["detections"], strict=True):
        seen = "NOT detected"
        if found["time_s"] is not None:
            seen = f"seen after {found['delay_s']:.2f} s, in {', '.join(found['equations'])}"
        grown = f"; it grows until {end:.2f} s" if end > start else ""
        lines.append(f"{f'fault at {start:.2f} s':<22}{seen}{grown}")
    lines.append(f"false alarms          {s['false_alarms']}")
    after = "" if watched["truth_after"] is None else f" -> {watched['truth_after']:.3f}"
    name = f"{watch.symbol} ({watch.derivative})"
    lines += [f"{name:<22}{watched['truth_before']:.3f}{after} {watch.unit} in truth", ""]
    lines.append(f"  {f'error of {watch.symbol}':<24}{'before':>9}{'peak':>9}{'after':>9}{'settled in':>13}")
    for name, label in LABELS.items():
        if name not in watched:
            continue
        e = watched[name]
        settle = "-" if e["settle_s"] is None else f"{e['settle_s']:.2f} s"
        if e["settle_s"] is not None and e["settle_s"] > scenario.duration - (scenario.fault_end or 0.0) - NEVER:
            settle = "never"
        lines.append(
            f"  {label:<24}{_percent(e['rms_before'])}{_percent(e['peak_error'])}{_percent(e['rms_after'])}{settle:>13}"
        )
    if "law" in s:
        lines += ["", *_law_lines(s["law"])]
    lines.append("")
    if dither["predicted_g_max"] > 0.0:
        lines += [
            f"dither at the pilot   predicted {dither['predicted_g_max_nominal']:.4f} g rms nominal (limit 0.012), "
            f"{dither['predicted_g_max']:.4f} at most (limit 0.04)",
            f"{'':<22}realised {dither['realised_g_rms']:.4f}, boosted {dither['realised_g_rms_boosted']:.4f}; "
            f"{dither['realised_of_limit']:.2f} of the limit, {dither['realised_of_limit_1s_max']:.2f} "
            "in the worst second",
        ]
    lines += [
        f"speed                 {s['real_time_factor']:.1f} x real time",
        f"page                  {s['report']}",
        f"written               {os.path.dirname(s['bag']) or '.'}: bag/, summary.json, "
        + ", ".join(os.path.basename(f) for f in s["figures"]),
    ]
    return "\n".join(lines)


def _law_lines(law: dict[str, Any]) -> list[str]:
    """Return how the law flew, beside the fixed one."""
    columns = ("roll_rms_deg", "alpha_max_deg", "beta_max_deg")
    lines = [f"  {'control law':<24}{'kept':>9}{'roll rms':>10}{'alpha max':>11}{'beta max':>10}{'recovered':>12}"]
    for name in dict.fromkeys((law["name"], "fixed")):
        one = law[name]
        roll, alpha, beta = (one[key] for key in columns)
        back = "never" if one["recovery_s"] is None else f"{one['recovery_s']:.2f} s"
        kept = "yes" if one["kept"] else f"{one['departed_s']:.1f} s"
        lines.append(f"  {name:<24}{kept:>9}{roll:>8.2f}/s{alpha:>11.2f}{beta:>10.2f}{back:>12}")
    lines.append("  [deg, deg/s, s]; kept: or when it departed")
    return lines


def _percent(value: float | None) -> str:
    return f"{'-':>9}" if value is None else f"{100.0 * value:>8.1f}%"
