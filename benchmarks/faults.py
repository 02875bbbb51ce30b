"""What goes wrong, all of it in one run: damaged bags and messages, kills, disks, a bad network, a long flight."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any

PARTS = ("bags", "messages", "nodes", "kills", "disks", "network", "soak")
BAG_COLUMNS = ("tried", "whole", "part", "refused", "silent", "crashed", "hung")
MESSAGE_COLUMNS = ("tried", "refused", "unlogged", "crashed", "not_finite", "other_bits")
Say = Callable[[str], None]


def measure(parts: Sequence[str], sizes: Mapping[str, int], say: Say, seed: int = 0) -> dict[str, Any]:
    """Measure the parts that are asked for.

    Parameters
    ----------
    parts
        Some of `PARTS`.
    sizes
        How many bags, messages, messages to each of the nodes, kills of each; seconds of the soak and over the network.
    say
        Told what is going on.
    seed
        Of the damage.
    """

    def of(name: str) -> Any:
        return importlib.import_module(f"benchmarks.fault_{name}")

    ways: dict[str, Callable[[], Any]] = {
        "bags": lambda: of("bags").measure(sizes["bags"], say, seed),
        "messages": lambda: of("messages").measure(sizes["messages"], say, seed),
        "nodes": lambda: of("nodes").measure(sizes["nodes"], say),
        "kills": lambda: of("processes").kills(sizes["kills"], say),
        "disks": lambda: of("disks").measure(say),
        "network": lambda: _network(of("network"), float(sizes["network"]), say),
        "soak": lambda: of("soak").measure(float(sizes["soak"]), say),
    }
    return {part: ways[part]() for part in PARTS if part in parts}


def _network(module: Any, seconds: float, say: Say) -> dict[str, Any]:
    say(f"{seconds + module.CUT:g} s over a bad network")
    try:
        found: dict[str, Any] = module.measure(seconds)
    except module.NotAllowedError as error:
        return {"skipped": f"network namespaces cannot be made here: {error}"}
    return found


def text(found: Mapping[str, Any]) -> str:
    """Return all tables as text."""
    lines: list[str] = []
    for part, result in found.items():
        lines += ["", *TEXTS[part](result)]
    return "\n".join(lines)


def _table(title: str, rows: Sequence[Mapping[str, Any]], columns: Sequence[str], ends: str = "") -> list[str]:
    """Return rows of counts, with their sum, and the examples of what went wrong."""
    lines = [title, f"{'':40}" + "".join(f"{name.replace('_', ' '):>12}" for name in columns)]
    for row in rows:
        cells = row.get("skipped") or "".join(f"{row[name]:>12}" for name in columns)
        lines.append(f"{row['kind']:40}{cells}")
    counted = [row for row in rows if not row.get("skipped")]
    lines.append(f"{'all':40}" + "".join(f"{sum(row[name] for row in counted):>12}" for name in columns) + ends)
    return [*lines, *(f"{row['kind']}: {example}" for row in rows for example in row.get("examples", []))]


def _bags(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    title = "damaged bags: read whole; in part, with a warning; refused in one line; with a silent loss; crashed; hung"
    return _table(title, rows, BAG_COLUMNS, f"   slowest {max(row['slowest_s'] for row in rows):.2f} s")


def _messages(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    counted = [{**row, "other_bits": int(not row["same_bits"])} for row in rows]
    return _table("damaged messages among good ones; answers of other bits than without them", counted, MESSAGE_COLUMNS)


def _kills(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    title = "kill -9: messages lost that were sent 1 s before; wrong commands; others that ended"
    return _table(title, rows, ("tried", "lost", "wrong", "crashed"))


def _disks(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    title = "disks: writers tried, ended with one line, destroyed what was there, crashed"
    return _table(title, rows, ("tried", "refused", "lost", "crashed"))


def _network_text(found: Mapping[str, Any]) -> list[str]:
    if "skipped" in found:
        return [f"network: {found['skipped']}"]
    return [
        f"network: {found['lost']} of {found['frames']} frames lost; {found['steps']} steps, "
        f"{found['with_dither']} with dither before the cut and {found['with_dither_again']} after it; "
        f"{found['dither_in_the_cut']} of {found['steps_in_the_cut']} in it; {found['too_old']} with one too old; "
        f"estimates of the {found['samples']} samples that came: {'the same' if found['same_bits'] else 'OTHER'} bits"
    ]


def _soak(found: Mapping[str, Any]) -> list[str]:
    memory, busy, wall = (found[name] for name in ("memory_mb", "cpu_ms_per_sample", "ms_per_sample"))
    return [
        f"{found['seconds']:g} s in lockstep over DDS: {found['samples']} samples, {found['time_outs']} time-outs; "
        f"memory {memory[0]:g} to {memory[1]:g} MB; ms of processor per sample {busy[0]:g} to {busy[1]:g}, "
        f"of wall time {wall[0]:g} to {wall[1]:g}; "
        f"replayed, {found['compared']} messages: {'the same' if found['same_bits'] else 'OTHER'} bits"
    ]


TEXTS: dict[str, Callable[[Any], list[str]]] = {
    "bags": _bags,
    "messages": _messages,
    "nodes": _messages,
    "kills": _kills,
    "disks": _disks,
    "network": _network_text,
    "soak": _soak,
}
