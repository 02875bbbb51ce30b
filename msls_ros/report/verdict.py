"""The verdict: what the flight shows, in a few sentences for somebody who reads nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from math import comb

import numpy as np

from msls_ros.report.knowledge import WELL, Knowledge, SlowChange
from msls_ros.report.recorded import Event, Recorded, Trust, TruthChange, joined
from msls_ros.report.style import derivative, number
from msls_ros.report.words import describe_drift, describe_truth, false_alarms, listed

_MOST = 3
_AGREE, _UNLIKELY = 0.95, 0.001
"""Share of numbers that agree with least squares where nothing changes, and the chance of fewer that is a warning."""


def verdict(
    flight: Recorded, known: Knowledge | None, slow: Sequence[SlowChange], changes: Sequence[TruthChange]
) -> list[str]:
    """Return what changed, what is known, and what the truth says of both where the log holds it.

    Parameters
    ----------
    flight
        All that was recorded.
    known
        None where there is no model.
    slow
        Changes without an alarm.
    changes
        Of the truth.
    """
    sentences = []
    if known is not None:
        sentences = [what_changed(joined(flight.events), slow), _what_is_known(flight, known)]
    else:
        sentences = ["No model: nothing was identified."]
    wrong = [f for f in flight.findings if f.level == "wrong"]
    if wrong:
        sentences.append(f"The data check finds {len(wrong)} wrong: {wrong[0].where}: {wrong[0].what}.")
    if not slow and flight.trust is not None:
        sentences += _disagreement(flight.trust)
    if flight.truth is not None and flight.models is not None:
        sentences += [s for change in changes[:_MOST] for s in describe_truth(flight, change)]
        if not changes:
            drift = describe_drift(flight.truth, flight.models)
            sentences.append(drift or "The plant's own model had no abrupt change.")
        false = false_alarms(flight, changes)
        when = f" ({listed(f'{e.time:.2f} s' for e in false[:6])})" if false else ""
        sentences.append(f"False alarms: {len(false)}{when}." if false else "No false alarm.")
    return [*sentences, *_dither(flight)]


def _disagreement(trust: Trust) -> list[str]:
    """Return a warning, where far fewer numbers agree with least squares over a span without a change than should."""
    if trust.batch_span is None or not trust.compared or _chance(trust.inside, trust.compared) >= _UNLIKELY:
        return []
    begin, end = trust.batch_span
    text = f"WARNING: only {trust.inside} of {trust.compared} numbers known agree with least squares over "
    text += f"{begin:.1f} to {end:.1f} s, in which no change is reported: the map or its delays may be wrong, "
    return [f"{text}error bars too narrow, or a change was not seen; run ./msls inspect before you rely on them."]


def _chance(inside: int, compared: int) -> float:
    """Return how probable it is that so few of the numbers compared agree within their 95 % bands, or fewer."""
    ways = (comb(compared, k) * _AGREE**k * (1.0 - _AGREE) ** (compared - k) for k in range(inside + 1))
    return sum(ways)


def what_changed(events: Sequence[Event], slow: Sequence[SlowChange]) -> str:
    """Return one sentence on what changed: alarms with the effectors that were named, then slow changes.

    Parameters
    ----------
    events
        Those of one change joined.
    slow
        Changes without an alarm.
    """
    parts = []
    alarms = [e for e in events if e.kind == "detected"]
    for number_of, alarm in enumerate(alarms[:_MOST]):
        end = alarms[number_of + 1].time if number_of + 1 < len(alarms) else np.inf
        named = [e for e in events if e.kind == "isolated" and alarm.time <= e.time < end]
        parts.append(_alarm(alarm, named))
    if len(alarms) > _MOST:
        parts.append(f"{len(alarms) - _MOST} more alarms followed")
    for change in slow:
        what = f"{change.name} {number(change.before)} → {number(change.after)}"
        parts.append(f"{what} between {change.begin:.1f} and {change.end:.1f} s, without an alarm")
    parts = [*parts[:1], *(part[:1].lower() + part[1:] if part[1:2].islower() else part for part in parts[1:])]
    return ("; ".join(parts) or "Nothing changed: no abrupt change, and no slow one that is sure") + "."


def _alarm(alarm: Event, named: Sequence[Event]) -> str:
    if not named:
        where = listed(derivative(name) for name in alarm.equations)
        return f"Abrupt change of {where} at {alarm.time:.2f} s, no effector named"
    left = listed(
        f"{e.effector} {100.0 * e.effectiveness:.0f} ± {number(100.0 * e.effectiveness_std, 1)} %"
        for e in {e.effector: e for e in named}.values()
    )
    after = named[0].time - alarm.time
    return f"Effect left from {alarm.time:.2f} s: {left}, named {after:.2f} s after the alarm"


def _what_is_known(flight: Recorded, known: Knowledge) -> str:
    begin, end = flight.span
    count, free = int(known.known.sum()), int(known.free.sum())
    now = int((known.known & known.now).sum())
    text = f"{known.well} of {free} numbers known to better than {100.0 * WELL:.0f} %"
    more = f" ({count} reliable, {count - now} of them not excited at the end)" if count else " (none reliable)"
    samples = f", {flight.samples:,} samples" if flight.samples is not None else ""
    return f"{text}{more}, from {end - begin:.1f} s of flight{samples}."


def _dither(flight: Recorded) -> list[str]:
    dither = flight.dither
    if dither is None or not len(dither.time) or not np.any(dither.delta):
        return []
    over = int(np.count_nonzero(dither.predicted > dither.limit * (1.0 + 1e-9)))
    kept = "within its limit at every sample" if over == 0 else f"OVER its limit at {over} samples"
    return [f"Dither: at most {float(np.nanmax(dither.predicted)):.3f} g rms predicted at the pilot, {kept}."]
