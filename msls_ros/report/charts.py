"""What the page draws: the flight, how well it is predicted, the detector, the dither; and what changed, as rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from msls_ros.report.chart import Line, Panel
from msls_ros.report.knowledge import SlowChange
from msls_ros.report.recorded import Detection, Dither, Flags, Models, Recorded, Signals, Trust
from msls_ros.report.style import UNITS, derivative, number

PARAMETER_CAPTION = (
    "Estimate with its 95 % band; dashed the truth, where the log holds it. The strip at the foot is filled where the "
    "number is published as reliable."
)
_AIR, _RATES, _ATTITUDE = ("u", "v", "w"), ("P", "Q", "R"), ("Phi", "Theta", "Psi")
_SETTLED = 2.0
"""After an alarm before a number counts as that after it, if it is reliable no earlier [s]."""
Row = tuple[str, str, str, str, str]


@dataclass(frozen=True)
class Drawn:
    """A figure to draw."""

    name: str
    title: str
    caption: str
    panels: Sequence[Panel]


def trust_sentences(trust: Trust) -> list[str]:
    """Return in words how well the flight is predicted and how the model agrees with a batch estimate."""
    r2 = [e.r2 for e in trust.equations if e.excited and e.r2 > 0.0]
    sentences = []
    if r2:
        sentences.append(
            f"One sample ahead the model predicts {100.0 * min(r2):.1f} to {100.0 * max(r2):.1f} % of the variance of "
            "the measured derivatives, equation by equation."
        )
    missed = [derivative(e.name) for e in trust.equations if e.excited and e.r2 <= 0.0]
    if missed:
        sentences.append(
            f"Not predicted, the mean is closer: {', '.join(missed)}. Reliable numbers may still be right there: the "
            "constant and what is not excited take part in a prediction."
        )
    if trust.batch_span is not None and trust.compared:
        begin, end = trust.batch_span
        share = 100.0 * trust.inside / trust.compared
        sentences.append(
            f"Against least squares over all samples from {begin:.1f} to {end:.1f} s, {trust.inside} of "
            f"{trust.compared} numbers known in it ({share:.0f} %; 95 are expected where nothing changes) agree within "
            "their 95 % bands."
        )
    return sentences


def draw_trust(trust: Trust) -> Drawn:
    """Draw each equation as measured and as predicted, and what is left."""
    panels = []
    for e in trust.equations:
        lines = [Line("measured", e.time, e.measured, 7), Line("predicted", e.time, e.predicted, 0)]
        panels.append(Panel(f"{derivative(e.name)} [{UNITS.get(e.name, 'x/s')}]", lines))
    caption = "Derivatives as measured, gravity taken off, and as the model of the sample before predicts them."
    return Drawn("trust", "Measured and predicted", caption, panels)


def draw_flight(flight: Recorded) -> Drawn:
    """Draw deflections, incidence, rates and attitude."""
    panels: list[Panel] = []
    deflections = flight.deflections
    if deflections is not None and len(deflections.time):
        lines = [
            Line(name, deflections.time, np.degrees(deflections.values[:, i]))
            for i, name in enumerate(deflections.names)
        ]
        panels += [Panel("deflections [deg]", lines[k : k + 4]) for k in range(0, len(lines), 4)]
    if flight.states is not None and len(flight.states.time):
        panels += _of_states(flight.states)
    caption = "Deflections and states as they reach the identifier."
    return Drawn("flight", "Inputs and states", caption, panels)


def _of_states(states: Signals) -> list[Panel]:
    of = {name: states.values[:, i] for i, name in enumerate(states.names)}
    time, panels = states.time, []
    rest = list(states.names)
    if set(_AIR) <= set(of):
        u, v, w = (of[name] for name in _AIR)
        speed = np.sqrt(u * u + v * v + w * w)
        beta = np.degrees(np.arcsin(np.divide(v, speed, out=np.zeros_like(v), where=speed > 0.0)))
        panels.append(Panel("airspeed [m/s]", [Line("V", time, speed)]))
        alpha = np.degrees(np.arctan2(w, u))
        panels.append(
            Panel("incidence [deg]", [Line("angle of attack α", time, alpha), Line("sideslip β", time, beta)])
        )
        rest = [name for name in rest if name not in _AIR]
    rates = [Line(n, time, np.degrees(of[n])) for n in rest if n in _RATES]
    label = {"Phi": "bank Φ", "Theta": "pitch Θ", "Psi": "heading Ψ"}
    attitude = [Line(label[n], time, np.degrees(np.unwrap(of[n]))) for n in rest if n in _ATTITUDE]
    other = [Line(n, time, of[n]) for n in rest if n not in (*_RATES, *_ATTITUDE)]
    groups = (("rates [deg/s]", rates), ("attitude [deg]", attitude), ("states [SI]", other))
    return [*panels, *(Panel(name, lines) for name, lines in groups if lines)]


def draw_detection(flight: Recorded, models: Models | None) -> Drawn | None:
    """Draw prediction errors and the detector; without them the residuals that were published."""
    if flight.detection is not None and len(flight.detection.time):
        return _detection(flight.detection, models)
    if models is None or not models.identified:
        return None
    panels = [
        Panel(f"{derivative(models.states[i])} [{UNITS.get(models.states[i], 'x/s')}]",
              [Line("residual standard deviation", models.time, models.residual_std[:, i])], low=0.0)
        for i in models.identified
    ]  # fmt: skip
    caption = "As published. The detector's statistic between the alarms is not in the messages."
    return Drawn("residuals", "Residuals", caption, panels)


def _detection(detection: Detection, models: Models | None) -> Drawn:
    panels = []
    for q, name in enumerate(detection.rows):
        error = detection.error[:, q]
        limit = 1.4 * float(np.quantile(np.abs(error), 0.995)) or 1.0
        lines = [Line("prediction error", detection.time, error, 0)]
        if models is not None and name in models.states:
            std = models.residual_std[:, models.states.index(name)]
            lines += [Line("± residual std", models.time, std, 9), Line("", models.time, -std, 9)]
        panels.append(Panel(f"{derivative(name)} [{UNITS.get(name, 'x/s')}]", lines, low=-limit, high=limit))
        if detection.enabled:
            values = np.where(detection.statistic[:, q] != 0.0, detection.statistic[:, q], np.nan)
            ends = detection.time[[0, -1]]
            top = 1.1 * max(detection.threshold, float(np.nanmax(values, initial=0.0)))
            lines = [Line("statistic", detection.time, values, 1)]
            lines.append(Line("threshold", ends, np.full(2, detection.threshold), 8))
            panels.append(Panel(f"detector, {derivative(name)} [1]", lines, low=0.0, high=top))
    caption = (
        "Prediction error of each equation before its update, and the statistic that is compared with the threshold; "
        "no line where the detector is not armed."
    )
    return Drawn("detection", "Prediction errors and detector", caption, panels)


def draw_dither(dither: Dither) -> Drawn:
    """Draw the dither of each effector, and the pilot's acceleration against its limit."""
    panels = [
        Panel(f"{name} [deg]", [Line("dither", dither.time, np.degrees(dither.delta[:, j]), 0)])
        for j, name in enumerate(dither.effectors)
        if np.any(dither.delta[:, j])
    ]
    lines = [Line("limit", dither.time, dither.limit, 8), Line("predicted", dither.time, dither.predicted, 0)]
    if dither.realised is not None:
        lines.append(Line("realised, rms of 1 s through the true B", dither.time, dither.realised, 2))
    panels.append(Panel("acceleration at the pilot, rms [g]", lines, low=0.0))
    caption = "The dither added to the commands; its rms acceleration at the pilot against the limit."
    return Drawn("dither", "Dither against its limit", caption, panels)


def changed_parameters(models: Models, flight: Recorded, slow: Sequence[SlowChange]) -> list[Row]:
    """Return the numbers that changed surely: name, when, before, after, ratio.

    Parameters
    ----------
    models
        The published ones.
    flight
        For its alarms.
    slow
        Changes without an alarm.
    """
    found: list[tuple[float, Row]] = []
    for k, alarm in enumerate(flight.alarms[:6]):
        later = [e.time for e in flight.alarms[k + 1 :] if set(e.equations) & set(alarm.equations)]
        end = min(later, default=np.inf)
        for name in alarm.equations:
            if name in models.states:
                found += _changed_row(models, models.states.index(name), alarm.time, end)
    found.sort(key=lambda one: -one[0])
    rows = [row for _, row in found[:8]]
    for c in slow:
        ratio = number(c.after / c.before, 2) if c.before else ""
        rows.append((c.name, f"{c.begin:.1f} to {c.end:.1f}", number(c.before), number(c.after), ratio))
    return rows


def _changed_row(models: Models, i: int, alarm: float, end: float) -> list[tuple[float, Row]]:
    """Return the numbers of an equation that are surely other ones after an alarm."""
    before = int(np.searchsorted(models.time, alarm - 1e-9)) - 1
    stop = int(np.searchsorted(models.time, end - 1e-9))
    if before < 0 or stop <= before + 2:
        return []
    found = []
    for j, column in enumerate(models.effectors):
        values, std, flags = models.b[:, i, j], models.b_std[:, i, j], models.b_reliable[:, i, j]
        early = _last(flags[: before + 1])
        first = before + 1 + int(np.argmax(flags[before + 1 : stop]))
        settled = int(np.searchsorted(models.time, models.time[first] + _SETTLED))
        after = min(settled, stop - 1)
        while after > first and not flags[after]:
            after -= 1
        if early is None or not flags[after]:
            continue
        apart = abs(values[after] - values[early]) / np.hypot(std[after], std[early])
        if apart > 4.0:
            cells = [f"{number(float(values[k]))} ± {number(float(std[k]), 2)}" for k in (early, after)]
            ratio = number(float(values[after] / values[early]), 2)
            found.append((float(apart), (f"{models.states[i]}/{column}", f"{alarm:.2f}", cells[0], cells[1], ratio)))
    return found


def _last(flags: Flags) -> int | None:
    """Return the last place that is true."""
    places = np.flatnonzero(flags)
    return int(places[-1]) if len(places) else None
