"""Reproduce the paper: Figs 1-9, its claims and the acceptance table, on many seeds."""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import sys
import textwrap
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

from msls_ros.commands.arguments import OneLineParser
from msls_ros.commands.compiling import compile_once
from msls_ros.commands.progress import Progress
from msls_ros.paper.claims import Claim, figures_of, judge_claims
from msls_ros.paper.flight_claims import (
    Row,
    claims_on_flights,
    flight_acceptance,
    render_rows,
    rows_of,
)
from msls_ros.paper.flight_experiments import count_flights, flights_of, run_flights
from msls_ros.paper.flight_figures import flight_figures
from msls_ros.paper.linear_experiments import Statistic, acceptance, run_experiments
from msls_ros.paper.linear_questions import (
    Finding,
    answer_breakdown,
    answer_information,
    answer_lag,
    answer_numerics,
    answer_precision,
)
from msls_ros.report.paper_figures import draw_figure

MOST_SEEDS = 1000
WIDTH = 116
STEPS = 8 + 1 + 5 + 1 + 9
"""Besides the flights: experiments, table, questions, claims, figures."""
ABOUT = (
    "Runs the two linear experiments of the paper (eqs 15-17) and its F-16 flights (without ROS) on many seeds; prints "
    "the acceptance table, the flights' numbers, the paper's claims with what was measured, and answers to further "
    "questions; draws Figs 1-9. The bounds of the table hold for 100 seeds. "
    "A row out of its bounds says so; that is a result, so the exit code is 0 (2 for wrong usage)."
)


def _seeds(text: str) -> int:
    value = int(text) if text.isascii() and text.isdigit() else 0
    if not 1 <= value <= MOST_SEEDS:
        message = f"'{text}': expected a whole number from 1 to {MOST_SEEDS}"
        raise argparse.ArgumentTypeError(message)
    return value


def parser() -> argparse.ArgumentParser:
    """Return the command line."""
    result = OneLineParser("paper", description=ABOUT)
    result.add_argument(
        "--seeds",
        type=_seeds,
        default=100,
        metavar="N",
        help="random numbers 0 to N-1 of the linear experiments; half as many flights, 3 or more (default: 100)",
    )
    result.add_argument(
        "--out", type=Path, default=Path("out/paper"), metavar="FOLDER", help="for the figures (default: out/paper)"
    )
    result.add_argument("--json", action="store_true", help="print one JSON object and nothing else on stdout")
    result.add_argument("--no-figures", action="store_true", help="draw and write nothing")
    return result


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Read the command line; exits with 2 and one line where it is wrong."""
    line = parser()
    options = line.parse_args(arguments)
    if not options.no_figures:
        try:
            options.out.mkdir(parents=True, exist_ok=True)
            probe = options.out / ".writable"
            probe.touch()
            probe.unlink()
        except OSError as error:
            line.error(f"--out '{options.out}' cannot be written: {error.strerror}")
    return options


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def row_of(one: Statistic) -> dict[str, Any]:
    """Give a statistic as JSON: a bound that is not there, or a number that is not finite, is null."""
    low, high = _finite(one.low), _finite(one.high)
    return {"statistic": one.statistic, "measured": _finite(one.measured), "low": low, "high": high, "ok": one.ok}


def render_table(table: list[Statistic]) -> str:
    """Write the acceptance table as text."""
    head = "medians over the seeds where nothing else is said"
    width = max(len(text) for text in [head, *(one.statistic for one in table)])
    lines = [f"{head:{width}}  {'measured':>10}  {'low':>10}  {'high':>10}"]
    for one in table:
        low, high = (f"{bound:.6g}" if math.isfinite(bound) else "" for bound in (one.low, one.high))
        verdict = "ok" if one.ok else "OUT OF BOUNDS"
        lines.append(f"{one.statistic:{width}}  {one.measured:>10.5g}  {low:>10}  {high:>10}  {verdict}")
    return "\n".join(lines)


def render_claims(claims: list[Claim]) -> str:
    """Write the claims as text."""
    lines = []
    for one in claims:
        lines += textwrap.wrap(f"{one.verdict:10}  {one.claim} [{one.where}]", WIDTH, subsequent_indent=" " * 12)
        lines += textwrap.wrap(one.number, WIDTH, initial_indent=" " * 12, subsequent_indent=" " * 12)
    return "\n".join(lines)


def render_findings(findings: list[Finding]) -> str:
    """Write the answers to the questions as text."""
    lines = []
    for question, group in groupby(findings, key=lambda one: one.question):
        lines.append(question)
        for one in group:
            value = f"{one.value:.4g}" if abs(one.value) < 1e4 else f"{one.value:.0f}"
            value = value if math.isfinite(one.value) else "not finite"
            lines.append(f"  {value:>10} {one.unit:13} {one.quantity}")
    return "\n".join(lines)


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What was measured, and the figures written."""

    table: list[Statistic] = dataclasses.field(default_factory=list)
    flights: list[Row] = dataclasses.field(default_factory=list)
    claims: list[Claim] = dataclasses.field(default_factory=list)
    findings: list[Finding] = dataclasses.field(default_factory=list)
    paths: list[Path] = dataclasses.field(default_factory=list)


def run(options: argparse.Namespace) -> Outcome:
    """Measure everything and draw the figures.

    Parameters
    ----------
    options
        Of `parse`.
    """
    compile_once("bank", "msls", "rls")
    steps, count = 0, flights_of(options.seeds)
    total = STEPS + count_flights(count)
    with Progress("paper", total, "steps") as progress:

        def step() -> None:
            nonlocal steps
            steps += 1
            progress.show(steps)

        runs = run_experiments(options.seeds, step)
        table = acceptance(runs, options.seeds)
        step()
        few = min(options.seeds, 20)
        findings = answer_lag(few)
        step()
        findings += answer_breakdown(few)
        step()
        for answer in (answer_numerics, answer_information, answer_precision):
            findings += answer()
            step()
        flights = run_flights(count, step)
        table += flight_acceptance(flights)
        claims = judge_claims(runs, findings, options.seeds) + claims_on_flights(flights)
        step()
        paths = []
        for figure in [] if options.no_figures else [*figures_of(runs), *flight_figures(flights)]:
            paths.append(options.out / f"figure_{figure.number}.png")
            draw_figure(figure, paths[-1])
            step()
        progress.show(total)
    return Outcome(table, rows_of(flights), claims, findings, paths)


def finite_only(value: Any) -> Any:
    """Give JSON with null in the place of every number that is not finite."""
    if isinstance(value, dict):
        return {key: finite_only(one) for key, one in value.items()}
    return _finite(value) if isinstance(value, float) else value


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    options = parse(arguments)
    try:
        found = run(options)
    except OSError as error:
        print(f"paper: a figure cannot be written: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    if options.json:
        result = {
            "seeds": options.seeds,
            "table": [row_of(one) for one in found.table],
            "flights": [finite_only(dataclasses.asdict(one)) for one in found.flights],
            "claims": [dataclasses.asdict(one) for one in found.claims],
            "questions": [finite_only(dataclasses.asdict(one)) for one in found.findings],
            "figures": [str(path) for path in found.paths],
        }
        print(json.dumps(result, allow_nan=False))
    else:
        print(
            f"The paper's linear experiments on {options.seeds} seeds, its flights on {flights_of(options.seeds)}\n",
            render_table(found.table),
            "\n\nThe flights of the F-16\n",
            render_rows(found.flights),
            "\n\nThe paper's claims\n",
            render_claims(found.claims),
            "",
            render_findings(found.findings),
            sep="\n",
        )
        if found.paths:
            print("", f"Figures: {found.paths[0]} to {found.paths[-1].name}", sep="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
