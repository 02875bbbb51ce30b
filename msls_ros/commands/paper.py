"""Reproduce the paper's linear experiments: Figs 1-6, its claims and the acceptance table, on many seeds."""

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
from typing import Any, NoReturn

from msls_ros.commands.linear_experiments import Statistic, acceptance, run_experiments
from msls_ros.commands.linear_questions import (
    Finding,
    answer_breakdown,
    answer_information,
    answer_lag,
    answer_numerics,
    answer_precision,
)
from msls_ros.commands.paper_claims import Claim, figures_of, judge_claims
from msls_ros.commands.progress import Progress
from msls_ros.report.paper_figures import draw_figure

MOST_SEEDS = 1000
WIDTH = 116
STEPS = 8 + 1 + 5 + 1 + 6
ABOUT = (
    "Runs the two linear experiments of the paper (eqs 15-17) on many seeds; prints the acceptance table, the paper's "
    "claims with what was measured, and answers to colder questions; draws Figs 1-6. The bounds of the table hold for "
    "100 seeds. "
    "Exit code: 0 if every row of the table is within its bounds, 1 if not, 2 for wrong usage."
)


class _Parser(argparse.ArgumentParser):
    """An argument parser that refuses in one line."""

    def error(self, message: str) -> NoReturn:
        """Print the message and exit with 2."""
        self.exit(2, f"{self.prog}: {message}\n")


def _seeds(text: str) -> int:
    value = int(text) if text.isascii() and text.isdigit() else 0
    if not 1 <= value <= MOST_SEEDS:
        message = f"'{text}': expected a whole number from 1 to {MOST_SEEDS}"
        raise argparse.ArgumentTypeError(message)
    return value


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Read the command line; exits with 2 and one line where it is wrong."""
    parser = _Parser("paper", description=ABOUT, allow_abbrev=False)
    parser.add_argument("--seeds", type=_seeds, default=100, metavar="N", help="random numbers 0 to N-1 (default: 100)")
    parser.add_argument(
        "--out", type=Path, default=Path("out/paper"), metavar="FOLDER", help="for the figures (default: out/paper)"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else on stdout")
    parser.add_argument("--no-figures", action="store_true", help="draw and write nothing")
    options = parser.parse_args(arguments)
    if not options.no_figures:
        try:
            options.out.mkdir(parents=True, exist_ok=True)
            probe = options.out / ".writable"
            probe.touch()
            probe.unlink()
        except OSError as error:
            parser.error(f"--out '{options.out}' cannot be written: {error.strerror}")
    return options


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def row_of(one: Statistic) -> dict[str, Any]:
    """Give a statistic as JSON: a bound that is not there, or a number that is not finite, is null."""
    low, high = _finite(one.low), _finite(one.high)
    return {"statistic": one.statistic, "measured": _finite(one.measured), "low": low, "high": high, "ok": one.ok}


def render_table(table: list[Statistic]) -> str:
    """Write the acceptance table for people."""
    head = "medians over the seeds where nothing else is said"
    width = max(len(text) for text in [head, *(one.statistic for one in table)])
    lines = [f"{head:{width}}  {'measured':>10}  {'low':>10}  {'high':>10}"]
    for one in table:
        low, high = (f"{bound:.6g}" if math.isfinite(bound) else "" for bound in (one.low, one.high))
        verdict = "ok" if one.ok else "OUT OF BOUNDS"
        lines.append(f"{one.statistic:{width}}  {one.measured:>10.5g}  {low:>10}  {high:>10}  {verdict}")
    return "\n".join(lines)


def render_claims(claims: list[Claim]) -> str:
    """Write the claims for people."""
    lines = []
    for one in claims:
        lines += textwrap.wrap(f"{one.verdict:10}  {one.claim} [{one.where}]", WIDTH, subsequent_indent=" " * 12)
        lines += textwrap.wrap(one.number, WIDTH, initial_indent=" " * 12, subsequent_indent=" " * 12)
    return "\n".join(lines)


def render_findings(findings: list[Finding]) -> str:
    """Write the answers to the questions for people."""
    lines = []
    for question, group in groupby(findings, key=lambda one: one.question):
        lines.append(question)
        for one in group:
            value = f"{one.value:.4g}" if abs(one.value) < 1e4 else f"{one.value:.0f}"
            value = value if math.isfinite(one.value) else "not finite"
            lines.append(f"  {value:>10} {one.unit:13} {one.quantity}")
    return "\n".join(lines)


def run(options: argparse.Namespace) -> tuple[list[Statistic], list[Claim], list[Finding], list[Path]]:
    """Measure everything and draw the figures.

    Parameters
    ----------
    options
        Of `parse`.
    """
    steps = 0
    with Progress("paper", STEPS, "steps") as progress:

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
        claims = judge_claims(runs, findings, options.seeds)
        step()
        paths = []
        for figure in [] if options.no_figures else figures_of(runs):
            paths.append(options.out / f"figure_{figure.number}.png")
            draw_figure(figure, paths[-1])
            step()
        progress.show(STEPS)
    return table, claims, findings, paths


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    options = parse(arguments)
    try:
        table, claims, findings, paths = run(options)
    except OSError as error:
        print(f"paper: a figure cannot be written: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    if options.json:
        result = {
            "seeds": options.seeds,
            "table": [row_of(one) for one in table],
            "claims": [dataclasses.asdict(one) for one in claims],
            "questions": [{**dataclasses.asdict(one), "value": _finite(one.value)} for one in findings],
            "figures": [str(path) for path in paths],
        }
        print(json.dumps(result, allow_nan=False))
    else:
        print(f"The paper's linear experiments on {options.seeds} seeds\n")
        print(
            render_table(table),
            "\n\nThe paper's claims\n",
            render_claims(claims),
            "",
            render_findings(findings),
            sep="\n",
        )
        if paths:
            print("", f"Figures: {paths[0]} to {paths[-1].name}", sep="\n")
    return 0 if all(one.ok for one in table) else 1


if __name__ == "__main__":
    sys.exit(main())
