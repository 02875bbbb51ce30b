"""`watch`: an identifier in the terminal: parameters with 95 % bands, dither, events, rates; for ssh sessions."""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any

from msls_ros.commands.arguments import OneLineParser

DEFAULT = ("P/ddt", "P/de", "Q/de", "R/dr", "P/P", "Q/w")
BAR = 31
"""Characters of a bar, odd: zero is in the middle."""
MOMENT = 2.0
"""After which it is said what is waited for [s]."""
RATED = 1.5
"""Over which the rates of a single view are measured [s]; diagnostics, once a second, have come by then, too."""
SIGMAS = 1.96
"""Half of a 95 % band, in standard errors."""
LEVELS = {0: "off", 1: "nominal", 2: "boosted", 3: "inhibited"}


def parser() -> argparse.ArgumentParser:
    """Return the command line."""
    result = OneLineParser(prog="watch", description=__doc__.split(": ", 1)[1])
    result.add_argument("parameters", nargs="*", help=f"ROW/COLUMN, dROW/dt by COLUMN (default: {' '.join(DEFAULT)})")
    result.add_argument("--namespace", default="", help="of the identifier")
    result.add_argument("--node", default="identifier", help="name of the identifier (default: identifier)")
    result.add_argument("--rate", type=float, default=4.0, help="refreshes per second (default: 4)")
    result.add_argument(
        "--once",
        action="store_true",
        help="print one view when a model has come and its rate is known, and end; until then say what is missing",
    )
    return result


def main(argv: Sequence[str] | None = None) -> int:
    """Show the view until it is stopped; return the exit code."""
    arguments = parser().parse_args(argv)
    wrong = [p for p in arguments.parameters if len(p.split("/")) != 2 or not all(p.split("/"))]
    if wrong or not 0.1 <= arguments.rate <= 30.0:
        what = f"'{wrong[0]}' is not ROW/COLUMN, as P/ddt" if wrong else "--rate must be from 0.1 to 30"
        print(f"watch: {what}; see --help", file=sys.stderr)
        return 2
    import rclpy
    from rclpy.executors import ExternalShutdownException

    from msls_ros.nodes.watching import WatchNode

    rclpy.init(args=[])
    node = WatchNode(identifier=arguments.node, namespace=arguments.namespace)
    try:
        _show(node, arguments.parameters or DEFAULT, 1.0 / arguments.rate, arguments.once)
    except (KeyboardInterrupt, ExternalShutdownException):
        return 0
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    return 0


def _show(node: Any, parameters: Sequence[str], period: float, once: bool) -> None:
    from rclpy.executors import SingleThreadedExecutor
    from rich.console import Console
    from rich.live import Live

    executor = SingleThreadedExecutor()
    executor.add_node(node)
    if once:
        said, due = "", time.monotonic() + MOMENT
        while node.model is None:
            executor.spin_once(timeout_sec=0.5)
            if time.monotonic() >= due and node.model is None and node.waiting() != said:
                said = node.waiting()
                print(f"watch: {said}", file=sys.stderr, flush=True)
        node.rates()
        end = time.monotonic() + RATED
        while (left := end - time.monotonic()) > 0.0:
            executor.spin_once(timeout_sec=left)
        Console().print(render(node, parameters, node.rates()))
        return
    with Live(render(node, parameters, node.rates()), auto_refresh=False) as live:
        due = time.monotonic() + period
        while True:
            executor.spin_once(timeout_sec=max(due - time.monotonic(), 0.0))
            if time.monotonic() >= due:
                due = time.monotonic() + period
                live.update(render(node, parameters, node.rates()), refresh=True)


def render(seen: Any, parameters: Sequence[str], rates: Mapping[str, float]) -> Any:
    """Return the view.

    Parameters
    ----------
    seen
        With ``model``, ``dither``, ``status`` (None: not heard yet), ``events`` and ``waiting``, as `WatchNode`.
    parameters
        ROW/COLUMN each.
    rates
        By topic [Hz].
    """
    from rich.console import Group
    from rich.text import Text

    status = "no diagnostics yet" if seen.status is None else seen.status.message
    heard = ", ".join(f"{topic} {rate:.1f} Hz" for topic, rate in rates.items())
    lines = [Text(f"{status}   {heard}", style="bold"), _table(seen.model, parameters), Text(_dither(seen.dither))]
    if seen.model is None:
        lines.append(Text(seen.waiting()))
    lines += [Text(f"{_time(e):10.3f} s  {e.description}", style="red") for e in seen.events]
    return Group(*lines)


def _table(model: Any, parameters: Sequence[str]) -> Any:
    from rich.table import Table

    table = Table(box=None, padding=(0, 1))
    for name in ("parameter", "value", "95 % band", "", "reliable"):
        table.add_column(name, justify="right" if name in ("value", "95 % band") else "left")
    for parameter in parameters:
        found = entry(model, parameter)
        if found is None:
            table.add_row(parameter, "-", "-", "", "no model yet" if model is None else "no such parameter")
            continue
        value, std, reliable = found
        table.add_row(parameter, f"{value:.4g}", f"± {SIGMAS * std:.3g}", bar(value, std), "yes" if reliable else "no")
    return table


def entry(model: Any, parameter: str) -> tuple[float, float, bool] | None:
    """Return value, standard error and reliability of ROW/COLUMN of a `LinearModel`; None: there is none."""
    row, _, column = parameter.partition("/")
    if model is None or row not in model.states:
        return None
    i, n, m = list(model.states).index(row), len(model.states), len(model.effectors)
    if column in model.states:
        k = i * n + list(model.states).index(column)
        return model.a[k], model.a_std[k], model.a_reliable[k]
    if column in model.effectors:
        k = i * m + list(model.effectors).index(column)
        return model.b[k], model.b_std[k], model.b_reliable[k]
    return None


def bar(value: float, std: float) -> str:
    """Return a bar: ``|`` at zero, ``o`` at the value, ``=`` over its 95 % band; the far end is at three quarters."""
    half = SIGMAS * std
    if not (math.isfinite(value) and math.isfinite(half)):
        return ""
    middle = BAR // 2
    most = max(abs(value) + half, 1e-12) / (0.75 * middle)

    def place(x: float) -> int:
        return min(max(middle + round(x / most), 0), BAR - 1)

    cells = [" "] * BAR
    cells[place(value - half) : place(value + half) + 1] = "=" * (place(value + half) - place(value - half) + 1)
    cells[middle] = "|"
    cells[place(value)] = "o"
    return "".join(cells)


def _dither(dither: Any) -> str:
    if dither is None:
        return "dither: none yet"
    level = LEVELS.get(dither.level, str(dither.level))
    felt = f"{dither.predicted_acceleration:.4f} of {dither.acceleration_limit:.3f} g at the pilot"
    return f"dither: {level} ({dither.reason}), {1e3 * dither.rms:.2f} mrad rms, {felt}"


def _time(event: Any) -> float:
    return float(event.header.stamp.sec + event.header.stamp.nanosec * 1e-9)
