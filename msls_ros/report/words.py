"""What the truth did, as far as the log holds it, and how the identifier answered it, in sentences."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np

from msls_ros.report.parameters import Quality
from msls_ros.report.recorded import Array, Event, Models, Recorded, Truth, TruthChange, joined
from msls_ros.report.style import derivative

ALARM_WINDOW = 1.0
"""An alarm within this time after a true change is its detection; any other is false [s]."""
_JUMP = 0.2
"""A change of an entry of the true B by this share of the largest of its row, between two models, is abrupt."""
_CLOSE = 0.3
"""Two models further apart than this do not show abruptness [s]."""
_CLEARER = 1.2
"""So much more a moment counts than a force where both show one change."""
_MATTERS = 0.25
"""Effects of at least this share of the largest of their row are named."""


def find_changes(truth: Truth, models: Models) -> list[TruthChange]:
    """Return the abrupt changes of the plant's own B.

    Parameters
    ----------
    truth
        Of the plant.
    models
        For the names, and for which equations are identified.
    """
    rows = models.identified
    if len(truth.time) < 2 or not rows:
        return []
    b = truth.b[:, rows]
    scale = np.abs(b).max(axis=(0, 2))[:, None]
    scale[scale == 0.0] = 1.0
    moments = [i for i, row in enumerate(rows) if models.states[row] in ("P", "Q", "R")]
    judged = moments or list(range(len(rows)))  # a force along an axis changes with its own deflection too
    found = []
    for k, (begin, end) in enumerate(pairwise(truth.time)):
        jump = (np.abs(b[k + 1] - b[k]) / scale)[judged]
        if end - begin > _CLOSE or jump.max() < _JUMP:
            continue
        effects = _effects(b[k], b[k + 1], scale, models)
        if effects:
            found.append(TruthChange(float(begin), effects))
    return found


def _effects(before: Array, after: Array, scale: Array, models: Models) -> tuple[tuple[str, str, float], ...]:
    """Return the effectors whose effect changed from one B to another, where it shows best and what is left of it."""
    rows = models.identified
    clear = np.array([_CLEARER if models.states[i] in ("P", "Q", "R") else 1.0 for i in rows])
    effects = []
    for j, effector in enumerate(models.effectors):
        matters = np.abs(before[:, j]) >= _MATTERS * scale[:, 0]
        own = np.abs(after[:, j] - before[:, j])
        change = np.divide(own, np.abs(before[:, j]), out=np.zeros(len(rows)), where=matters)
        i = int((change * clear).argmax())
        if change[i] >= _JUMP:
            effects.append((effector, models.states[rows[i]], float(after[i, j] / before[i, j])))
    return tuple(effects)


def describe_drift(truth: Truth, models: Models) -> str:
    """Return a sentence on what changed slowly in the plant's own B, from the first model to the last, or nothing."""
    rows = models.identified
    if len(truth.time) < 2 or not rows:
        return ""
    b = truth.b[:, rows]
    scale = np.abs(b).max(axis=(0, 2))[:, None]
    scale[scale == 0.0] = 1.0
    effects = _effects(b[0], b[-1], scale, models)
    if not effects:
        return ""
    effector, row, _ = effects[0]
    series = truth.b[:, models.states.index(row), models.effectors.index(effector)]
    done = (series - series[0]) / (series[-1] - series[0])
    begin, end = truth.time[int((done > 0.05).argmax())], truth.time[int((done > 0.95).argmax())]
    what = listed(f"{name} on {derivative(of)} to {ratio:.2f}" for name, of, ratio in effects)
    when = f"From about {begin:.1f} to {end:.1f} s"
    return f"{when} the plant itself changed slowly: effectiveness of {what} of its first value."


def false_alarms(flight: Recorded, changes: Sequence[TruthChange]) -> list[Event]:
    """Return the alarms that no true change explains."""
    windows = [(c.time, c.time + ALARM_WINDOW) for c in changes]
    return [e for e in flight.alarmed_changes if not any(begin < e.time <= end for begin, end in windows)]


def describe_truth(flight: Recorded, change: TruthChange) -> list[str]:
    """Describe one true change and how the identifier answered it."""
    what = listed(f"{effector} on {derivative(row)} to {ratio:.2f}" for effector, row, ratio in change.effects)
    begin = f"At {change.time:.2f} s the plant itself changed: effectiveness of {what} of its value before"
    first = next((e for e in flight.alarmed_changes if change.time < e.time <= change.time + ALARM_WINDOW), None)
    if first is None:
        return [f"{begin}. This was NOT detected within {ALARM_WINDOW:g} s."]
    found = f"Detected after {first.time - change.time:.2f} s, in {_equations(first.equations)}"
    return [f"{begin}.", "; ".join([found, *_followed(flight, first, change.time)]) + "."]


def _followed(flight: Recorded, alarm: Event, since: float) -> list[str]:
    """Describe what followed an alarm, up to its recovery or the next alarm."""
    parts = []
    for event in joined(flight.events):
        if event.time < alarm.time:
            continue
        if event.kind == "detected" and event.time > alarm.time:
            break
        if event.kind == "isolated":
            parts.append(
                f"isolated to {event.effector} after {event.time - since:.2f} s "
                f"(effectiveness {event.effectiveness:.2f} ± {event.effectiveness_std:.2f} "
                f"on {_equations(event.equations)})"
            )
        elif event.kind == "recovered":
            parts.append(f"recovered, at normal settings, after {event.time - since:.2f} s")
            break
    return parts


def percent(value: float | None) -> str:
    """Return a share for a table."""
    return "—" if value is None else f"{100.0 * value:.0f} %" if value >= 0.1 else f"{100.0 * value:.1f} %"


def quality_cells(found: Quality) -> list[str]:
    """Return the cells of a parameter's row in the table."""
    return [percent(found.rms), percent(found.covered), percent(found.reliable), percent(found.covered_reliable)]


def _equations(names: Sequence[str]) -> str:
    return listed(derivative(name) for name in names)


def listed(parts: Iterable[str]) -> str:
    """Return words for a sentence: a, b and c."""
    items = list(parts)
    return ", ".join(items[:-1]) + " and " + items[-1] if len(items) > 1 else "".join(items)
