"""`benchmark`: Compare with C, peers, a relay, the truth: update, stream, replay, latency, damage, laws, errors."""

from __future__ import annotations

import argparse
import importlib
import json
import os
import sys
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from types import ModuleType
from typing import Any, TypeAlias

from msls_ros.commands.arguments import OneLineParser, count, seed
from msls_ros.commands.compiling import compile_once
from msls_ros.commands.interrupted import Interrupted
from msls_ros.fleet import FleetError
from msls_ros.plant import NOISE_LEVELS

CONTROL = ("failures", "random", "latency", "gusts", "no_dither", "intact", "learn", "beds")
"""Suites of `benchmarks.control`."""
PARTS = ("f16", "flight_test")
"""Parts of `benchmarks.accuracy`."""
ROOT = Path(__file__).resolve().parents[2]
FAULTS = ("bags", "messages", "nodes", "kills", "disks", "network", "soak")
FAULT_SIZES = (
    ("bags", 2000, "how many damaged copies"),
    ("messages", 100_000, "damaged messages through the gate, and as many through the maps of other stacks"),
    ("nodes", 5000, "damaged messages over DDS to each node"),
    ("kills", 20, "kills of each of four nodes"),
    ("network", 20, "seconds over a bad network"),
    ("soak", 3600, "seconds of flight in one go"),
)
Commands: TypeAlias = "argparse._SubParsersAction[OneLineParser]"
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


class Unfinished(Exception):
    """A table is not ended; one sentence that says why and what is kept.

    Parameters
    ----------
    message
        The sentence.
    code
        Of the exit.
    """

    def __init__(self, message: str, code: int) -> None:
        """See the class."""
        super().__init__(message)
        self.code = code


def parser() -> argparse.ArgumentParser:
    """Return the command line."""
    result = OneLineParser(prog="benchmark", description=__doc__.split(": ", 1)[1])
    commands = result.add_subparsers(dest="command", required=True, metavar="COMMAND")
    _add_speeds(commands)
    _add_control(commands)
    _add_errors(commands)
    for command in commands.choices.values():
        command.add_argument("--json", action="store_true", help="print one JSON value on stdout and nothing else")
    return result


def _add_speeds(commands: Commands) -> None:
    """Add what measures time, and what damage costs."""
    kernel = commands.add_parser("kernel", help="time per update at p = 17, 9 rows and p = 8, 3 rows, one thread")
    kernel.add_argument("--rounds", type=count, default=25, help="how often each is timed (default: 25)")
    stress = commands.add_parser("stress", help="two nearly collinear regressors: first NaN and peak error")
    stress.add_argument("--samples", type=count, default=100_000, help="length of the stream (default: 100000)")
    replay = commands.add_parser("replay", help="offline identification of a bag against reading it alone")
    replay.add_argument("--samples", type=count, default=300_000, help="length of the bag (default: 300000)")
    replay.add_argument("--every", type=count, default=10, help="samples per model (default: 10)")
    campaign = commands.add_parser("campaign", help="flights of a campaign: multiples of real time per core")
    campaign.add_argument("--flights", type=count, default=12, help="how many are timed (default: 12)")
    faults = commands.add_parser("faults", help="damaged bags and messages, kills, disks, network, soak: what was lost")
    faults.add_argument("--only", nargs="+", choices=FAULTS, default=FAULTS, help="parts (default: all, an hour)")
    for name, size, what in FAULT_SIZES:
        faults.add_argument(f"--{name}", type=count, default=size, help=f"{what} (default: {size})")
    faults.add_argument("--seed", type=seed, default=0, help="of the damage (default: 0)")
    latency = commands.add_parser("latency", help="state in to dither and model out, beside a bare relay")
    latency.add_argument("--seconds", type=count, default=10, help="length of a round (default: 10)")
    latency.add_argument("--rounds", type=count, default=3, help="rounds per rate (default: 3)")
    latency.add_argument("--rates", type=count, nargs="+", default=[50, 100, 200, 500, 1000], help="[Hz]")


def _add_control(commands: Commands) -> None:
    control = commands.add_parser("control", help="control laws side by side: flights kept, how well they track")
    control.add_argument("--suite", choices=CONTROL, default="failures", help="what is flown (default: failures)")
    control.add_argument(
        "--laws",
        nargs="+",
        default=["fixed", "frozen", "rls", "lq", "auto", "truth"],
        metavar="LAW",
        help="of fixed, frozen, rls, lq, entry, auto, bank, truth (default: all but entry and bank)",
    )
    control.add_argument("--noise", nargs="+", choices=list(NOISE_LEVELS), default=["low"], help="(default: low)")
    control.add_argument("--seeds", type=count, default=2, help="how many (default: 2)")
    control.add_argument("--first-seed", type=seed, default=100, help="(default: 100)")
    control.add_argument("--out", type=Path, help="JSON lines to append to, and to go on from")


def _add_errors(commands: Commands) -> None:
    """Add what measures errors, bars, alarms and names."""
    calibration = commands.add_parser("calibration", help="error bars, alarms and names against the truth, on all beds")
    which = calibration.add_mutually_exclusive_group()
    for kind, text in (
        ("quick", "a few beds, a minute"),
        ("others", "nineteen other aircraft, instead"),
        ("servos", "small aircraft by the commands to their servos, instead"),
        ("whole", "their flights from rest to rest, with spikes and without, instead"),
    ):
        which.add_argument(f"--{kind}", action="store_const", dest="kind", const=kind, default="", help=text)
    calibration.add_argument("--method", choices=("bank", "msls", "rls"), help="instead of the profiles' (bank)")
    accuracy = commands.add_parser("accuracy", help="errors beside MSLS and RLS, batch and the truth, on all beds")
    which = accuracy.add_mutually_exclusive_group()
    which.add_argument("--part", nargs="+", choices=PARTS, default=list(PARTS), help="(default: both)")
    which.add_argument("--others", action="store_true", help="nineteen other aircraft in flight test, instead")
    linear = commands.add_parser("linear", help="error bars, alarms and names on made-up linear aircraft")
    linear.add_argument("--flights", type=count, default=60, help="how many, each another aircraft (default: 60)")
    linear.add_argument("--first-seed", type=seed, default=1000, help="(default: 1000)")
    linear.add_argument(
        "--record",
        choices=("as drawn", "coarse", "late", "slow", "held", "damped", "vane", "old velocity", "elevons"),
        default="as drawn",
        help="deflections in steps of .1 deg; 20 ms late; commands to servos of 6 rad/s; deflections measured in every "
        "third row; dampers that are fed the measured rates, and 20 s of rest; a velocity that lags by 50 ms, or is 20 "
        "ms old; aircraft with two elevons (default: as drawn)",
    )
    for command in (calibration, accuracy):
        command.add_argument("--seeds", type=count, default=1, help="flights of each bed (default: 1)")
        command.add_argument("--first-seed", type=seed, default=201, help="the first one (default: 201)")
        command.add_argument(
            "--jobs", type=count, default=1, metavar="N", help="flights at a time, in as many processes (default: 1)"
        )
        command.add_argument(
            "--folder", type=Path, metavar="DIR", help="keep flights and results there: an interrupted run goes on"
        )


def main(argv: Sequence[str] | None = None) -> int:
    """Run a benchmark; return the exit code."""
    arguments = parser().parse_args(argv)
    for name in THREADS:
        os.environ[name] = "1"
    if not (ROOT / "benchmarks" / "__init__.py").is_file():
        print("benchmark: no folder 'benchmarks' beside msls_ros; run it from a checkout", file=sys.stderr)
        return 2
    sys.path.insert(0, str(ROOT))
    measures = {"kernel": _kernel, "stress": _stress, "replay": _replay, "campaign": _campaign}
    measures |= {"latency": _latency, "faults": _faults, "control": _control, "calibration": _calibration}
    measures |= {"accuracy": _accuracy, "linear": _linear}
    compile_once("bank", "msls", "rls")
    try:
        result = measures[arguments.command](arguments)
    except Unfinished as error:
        print(f"benchmark: {error}", file=sys.stderr)
        return error.code
    if result is None:
        return 1
    if arguments.json:
        print(json.dumps(result, indent=1))
    return 0


def _kernel(arguments: argparse.Namespace) -> Any:
    module = importlib.import_module("benchmarks.kernel")
    sizes = []
    for p, rows in module.SIZES:
        _say(f"{p} regressors, {rows} rows: {arguments.rounds} rounds")
        try:
            table = module.measure(p, rows, arguments.rounds)
        except module.MismatchError as error:
            print(f"benchmark: {error}", file=sys.stderr)
            return None
        sizes.append({"p": p, "rows": rows, "results": table})
        if not arguments.json:
            print(format_kernel(p, rows, table))
    return sizes


def _stress(arguments: argparse.Namespace) -> Any:
    table = importlib.import_module("benchmarks.stress").measure(arguments.samples, _say)
    if not arguments.json:
        print(format_stress(table, arguments.samples))
    return table


def _replay(arguments: argparse.Namespace) -> Any:
    result = importlib.import_module("benchmarks.replay").measure(arguments.samples, arguments.every, _say)
    if not arguments.json:
        print(format_replay(result))
    return result


def _campaign(arguments: argparse.Namespace) -> Any:
    result = importlib.import_module("benchmarks.campaign").measure(arguments.flights, _say)
    if not arguments.json:
        print(format_campaign(result))
    return result


def _faults(arguments: argparse.Namespace) -> Any:
    from msls_ros.nodes.loopback import stay_on_this_machine  # the other benchmarks need no messages

    stay_on_this_machine()
    module = importlib.import_module("benchmarks.faults")
    sizes = {name: getattr(arguments, name) for name, _, _ in FAULT_SIZES}
    result = module.measure(arguments.only, sizes, _say, arguments.seed)
    if not arguments.json:
        print(module.text(result))
    return result


def _calibration(arguments: argparse.Namespace) -> Any:
    module = importlib.import_module("benchmarks.calibration")
    return _fly_beds(module, arguments, kind=arguments.kind, method=arguments.method or "")


def _accuracy(arguments: argparse.Namespace) -> Any:
    module = importlib.import_module("benchmarks.accuracy")
    parts = ["flight_test"] if arguments.others else arguments.part
    return _fly_beds(module, arguments, parts=parts, others=arguments.others)


def _fly_beds(module: ModuleType, arguments: argparse.Namespace, **which: Any) -> Any:
    """Measure on beds; with several jobs an interrupt does not break into what worker processes have part in."""
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.seeds)
    folder, jobs, interrupted = arguments.folder, arguments.jobs, Interrupted()
    kept = "without --folder nothing is kept"
    if folder is not None:
        kept = f"what has ended is kept in '{folder}', the same command goes on"
    with interrupted.watched():
        try:
            with nullcontext() if jobs == 1 else interrupted.held():
                result = module.measure(seeds, folder, _say, **which, jobs=jobs, stopped=lambda: bool(interrupted))
        except FleetError as error:
            raise Unfinished(f"{error}; {kept}", 2) from error
        except (Exception, KeyboardInterrupt) as error:
            if not interrupted:
                raise
            raise Unfinished(f"interrupted; {kept}", 130) from error
    if not arguments.json:
        print(module.render(result))
    return result


def _linear(arguments: argparse.Namespace) -> Any:
    module = importlib.import_module("benchmarks.linear_beds")
    rows = []
    for row in module.run(arguments.flights, arguments.first_seed, os.cpu_count() or 1, arguments.record):
        rows.append(row)
        if len(rows) % 10 == 0:
            _say(f"{len(rows)} of {2 * arguments.flights} flights")
    if not arguments.json:
        print(module.render(rows))
    return rows


def _control(arguments: argparse.Namespace) -> Any:
    module = importlib.import_module("benchmarks.control")
    unknown = [law for law in arguments.laws if law not in module.LAWS]
    if unknown:
        print(f"benchmark: --laws {unknown[0]}; expected some of {', '.join(module.LAWS)}", file=sys.stderr)
        return None
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.seeds)
    rows = module.measure(arguments.suite, arguments.laws, arguments.noise, seeds, arguments.out, _say)
    if arguments.suite == "random":
        if "truth" not in arguments.laws:
            _say("all failures count: which can be survived, only the law 'truth' shows")
        rows = module.survivable(rows)
    result = module.summarise(rows)
    if not arguments.json:
        print(format_control(result))
    return result


def format_control(rows: Sequence[dict[str, Any]]) -> str:
    """Return the laws side by side as text."""
    lines = ["\nmedians from the fault on; well: alpha within 2 deg, sideslip 3 deg, roll rate 1.5 deg/s rms"]
    lines.append(f"{'noise':6}{'law':8}{'kept':>10}{'well':>6}{'roll rms':>10}{'alpha max':>11}{'recovered':>11}")
    for row in rows:
        back = "never" if row["recovery_s"] is None else f"{row['recovery_s']:.2f} s"
        kept = f"{row['kept']}/{row['flights']}"
        errors = f"{row['roll_rms']:>10.2f}{row['alpha_max']:>11.2f}"
        lines.append(f"{row['noise']:6}{row['law']:8}{kept:>10}{row['well']:>6}{errors}{back:>11}")
    return "\n".join(lines)


def _latency(arguments: argparse.Namespace) -> Any:
    module = importlib.import_module("benchmarks.latency")
    result = module.measure(arguments.rates, arguments.seconds, arguments.rounds, _say)
    if not arguments.json:
        print(format_latency(result))
    return result


def format_latency(result: dict[str, Any]) -> str:
    """Return the latencies as text."""
    pinned = "each on a core of its own" if result["pinned"] else "on one core"
    lines = [
        f"\nstate in to dither (model) out [ms], processor share; medians of {result['rounds']} rounds of "
        f"{result['seconds']:g} s; probe and measured {pinned}",
        f"{'Hz':>6} {'':11}{'p50':>15}{'p99':>15}{'p99.9':>15}{'max':>8}{'CPU':>7}{'MB':>7}{'lost':>6}",
    ]
    for row in result["rates"]:
        for who in ("relay", "identifier"):
            one = row[who]
            cells = [f"{one['dither'][n]:.2f} ({one['model'][n]:.2f})" for n in ("p50", "p99", "p99.9")]
            lines.append(
                f"{row['rate']:>6g} {who:11}"
                + "".join(f"{cell:>15}" for cell in cells)
                + f"{one['dither']['max']:8.1f}"
                f"{100 * one['cpu']:6.1f}%{one['memory']:7.0f}{one['lost']:>6}"
            )
        ratios = row["ratios"]
        cells = [f"{ratios[n]:.2f}" for n in ("p50", "p99", "p99.9")]
        lines.append(f"{'':6} {'ratio':11}" + "".join(f"{cell:>15}" for cell in cells) + f"{ratios['cpu']:15.2f}")
    best = [f"{who} {result.get(f'lossless_{who}', 0):g} Hz" for who in ("relay", "identifier")]
    return "\n".join([*lines, f"highest rate without loss: {', '.join(best)}"])


def format_campaign(result: dict[str, Any]) -> str:
    """Return the speed as text."""
    lines = [
        f"\n{result['flights']} flights of {result['scenario']}, noise {result['noise']}: {result['simulated_s']:g} s, "
        f"truth at {result['truth_hz']} Hz, one process",
        f"{'':45}{'median':>10}{'range':>18}",
    ]
    for name, label, digits in (("x_real_time", "x real time", 0), ("flight_ms", "ms per flight", 1)):
        found = result[name]
        span = f"{found['low']:.{digits}f}-{found['high']:.{digits}f}"
        lines.append(f"{label:45}{found['median']:>10.{digits}f}{span:>18}")
    return "\n".join(lines)


def format_replay(result: dict[str, Any]) -> str:
    """Return the rates as text."""
    lines = [
        f"\n{result['samples']} samples, two messages each, a model every {result['every']}: samples/s "
        "of processor time (of wall time), best round, one thread"
    ]
    for name, label in (("raw", "rosbags reads the bag, nothing decoded"), ("replay", "replay: read, identify, write")):
        rate, wall = result[f"{name}_samples_per_s"], result[f"{name}_samples_per_s_wall"]
        lines.append(f"{label:45}{rate:>10,} ({wall:,})")
    return "\n".join([*lines, f"{'replay / raw':45}{result['replay_to_raw']:>10.2f}"])


def format_kernel(p: int, rows: int, table: Sequence[dict[str, Any]]) -> str:
    """Return the table of one size as text."""
    lines = [
        f"\n{p} regressors, {rows} rows: us per update, fastest round (median), one thread",
        f"{'':45}{'us':>8}{'median':>9}{'/ C':>8}{'/ ours':>8}  does",
    ]
    for row in table:
        if row["us"] is None:
            lines.append(f"{row['name']:45}{row['note']}")
            continue
        to_c = f"{row['to_plain_c']:8.2f}" if row["to_plain_c"] else f"{'-':>8}"
        median, to_ours = row["us_median"], row["to_ours_per_call"]
        lines.append(f"{row['name']:45}{row['us']:8.2f}{median:9.2f}{to_c}{to_ours:8.2f}  {row['does']}")
    return "\n".join([*lines, "/ C: to plain C; / ours: to msls_ros MSLS per call"])


def format_stress(table: Sequence[dict[str, Any]], samples: int) -> str:
    """Return the table of all cases as text."""
    cases = list(dict.fromkeys((row["forgetting"], row["p"]) for row in table))
    names = dict.fromkeys(row["name"] for row in table)
    lines = [
        f"\nphi2 = phi1 + N(0, 0.01^2), {samples} samples: peak error, or the first sample that is not finite",
        f"{'':24}" + "".join(f"{f'lambda {forgetting}, p {p}':>20}" for forgetting, p in cases),
    ]
    for name in names:
        cells = []
        for row in (row for row in table if row["name"] == name):
            dead = row["first_not_finite"]
            cells.append(f"{row['peak_error']:.3g}" if dead is None and not row["note"] else f"NaN at {dead}")
        note = next(row["note"] for row in table if row["name"] == name)
        lines.append(f"{name:24}" + (note or "".join(f"{cell:>20}" for cell in cells)))
    return "\n".join(lines)


def _say(text: str) -> None:
    print(f"benchmark: {text}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
