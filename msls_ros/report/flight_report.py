"""A flight's report: draws what there is, says what is missing, puts it on a page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape

import numpy as np

from msls_ros.report import model_maps, overview, page, parameters, signals, words
from msls_ros.report.page import Head, Section
from msls_ros.report.parameters import Parameter, quality
from msls_ros.report.recorded import Models, Recorded, TruthChange
from msls_ros.report.style import Drawn, derivative, house_style

FIGURES = (
    "events", "flight", "model", "model_before_alarm", "model_truth", "parameters", "parameters_alarm", "detection",
    "residuals", "dither", "excitation",
)  # fmt: skip
"""Names of all figures that there can be."""
_BEFORE, _AFTER = 0.5, 2.0
"""The window about an alarm [s]."""


@dataclass
class Report:
    """A page and its figures."""

    html: str
    figures: list[Drawn]
    headline: list[str]
    parameters: list[str] = field(default_factory=list)
    """Which were shown."""


def make_report(flight: Recorded, wanted: Sequence[str] = ()) -> Report:
    """Draw and write the report of a flight.

    Parameters
    ----------
    flight
        What was recorded.
    wanted
        Parameters to show, ``row/column``; empty: what is worth showing.

    Raises
    ------
    ReportError
        For a parameter that does not exist.
    """
    with house_style():
        return _Builder(flight, wanted).build()


class _Builder:
    """Collects figures and sections."""

    def __init__(self, flight: Recorded, wanted: Sequence[str]) -> None:
        self.flight = flight
        self.models: Models | None = flight.models if flight.models is not None and len(flight.models.time) else None
        self.changes: list[TruthChange] = []
        self.parameters: list[Parameter] = []
        if self.models is not None:
            names = list(wanted) or parameters.choose(self.models)
            self.parameters = [parameters.pick(self.models, flight.truth, name) for name in names]
            if flight.truth is not None:
                self.changes = words.find_changes(flight.truth, self.models)
        self.figures: list[Drawn] = []
        self.sections: list[Section] = []

    def build(self) -> Report:
        self._events()
        self._flight()
        self._model()
        self._parameters()
        self._detection()
        self._dither()
        self._excitation()
        self._refusals()
        self._configuration()
        self._bag()
        summary = words.headline(self.flight, self.changes)
        summary = [f"Flown: {self.flight.scenario}.", *summary] if self.flight.scenario else summary
        head = Head(
            name=self.flight.name,
            about=self._about(),
            summary=summary,
            tiles=self._tiles(),
            notes=[*self.flight.warnings, *self.flight.missing],
        )
        html = page.render(head, self.sections)
        return Report(html, self.figures, summary, [f"{p.row}/{p.column}" for p in self.parameters])

    def _draw(self, drawn: Drawn | None) -> str:
        if drawn is None:
            return ""
        self.figures.append(drawn)
        return page.figure(drawn)

    def _add(self, anchor: str, title: str, body: str) -> None:
        if body:
            self.sections.append(Section(anchor, title, body))

    def _about(self) -> str:
        return " · ".join(part for part in (self.flight.origin, self.flight.models_source) if part)

    def _tiles(self) -> list[tuple[str, str]]:
        flight = self.flight
        begin, end = flight.span
        tiles = [(f"{end - begin:.1f} s", "of flight" if flight.samples is None else f"{flight.samples:,} samples")]
        if flight.models is not None:
            tiles.append((str(len(flight.alarms)), "alarm" if len(flight.alarms) == 1 else "alarms"))
        if self.changes:
            first = self.changes[0].time
            alarm = next((e.time for e in flight.alarms if first < e.time <= first + words.ALARM_WINDOW), None)
            tiles.append(("missed" if alarm is None else f"{alarm - first:.2f} s", "from true change to alarm"))
        named = [e for e in flight.events if e.kind == "isolated"]
        if named:
            tiles.append((", ".join(dict.fromkeys(e.effector for e in named)), "isolated"))
        if flight.dither is not None and len(flight.dither.time):
            tiles.append(
                (f"{float(np.nanmax(flight.dither.predicted)):.3f} g", "largest predicted dither at the pilot (rms)")
            )
        if flight.refusals:
            tiles.append((f"{max(sum(r.counts.values()) for r in flight.refusals):,}", "messages refused"))
        return tiles

    def _events(self) -> None:
        flight = self.flight
        if self.models is None and not flight.events:
            return
        body = self._draw(overview.draw_timeline(flight, self.changes))
        if flight.events:
            rows = [
                [
                    f"{e.time:.2f}", e.kind, ", ".join(derivative(n) for n in e.equations),
                    ", ".join(f"{s:.1f} / {t:g}" for s, t in zip(e.statistic, e.threshold, strict=False)),
                    f"{e.effector} ×{e.effectiveness:.2f} ± {e.effectiveness_std:.2f}" if e.effector else "",
                    e.description,
                ]
                for e in flight.events
            ]  # fmt: skip
            heads = ("time [s]", "event", "equations", "statistic / threshold", "effectiveness", "description")
            body += page.table(heads, rows, numbers=(0,))
        self._add("events", "Events", body)

    def _flight(self) -> None:
        self._add("flight", "The flight", self._draw(overview.draw_overview(self.flight, self.changes)))

    def _model(self) -> None:
        models = self.models
        if models is None:
            return
        last = len(models.time) - 1
        body = self._draw(model_maps.draw_model(models, last, "model", "A and B at the end"))
        if self.flight.alarms:
            before = int(np.searchsorted(models.time, self.flight.alarms[0].time - 1e-9)) - 1
            if before >= 0:
                title = "A and B just before the first alarm"
                body += self._draw(model_maps.draw_model(models, before, "model_before_alarm", title))
        if self.flight.truth is not None:
            title = "A and B at the end against truth"
            body += self._draw(model_maps.draw_model(models, last, "model_truth", title, self.flight.truth))
        self._add("model", "Model", body)

    def _parameters(self) -> None:
        if not self.parameters:
            return
        flight = self.flight
        body = self._draw(
            parameters.draw_parameters(flight, self.parameters, self.changes, "parameters", "Parameters over time")
        )
        if flight.alarms:
            first = flight.alarms[0].time
            window = (max(first - _BEFORE, flight.span[0]), min(first + _AFTER, flight.span[1]))
            title = f"The same around the first alarm, {first:.2f} s"
            body += self._draw(
                parameters.draw_parameters(flight, self.parameters, self.changes, "parameters_alarm", title, window)
            )
        rows = []
        for p in self.parameters:
            at_end = "" if p.truth is None else f"{p.truth[-1]:.3f}"
            error = f" ± {p.std[-1]:.3f}" if np.isfinite(p.std[-1]) else ""
            rows.append([p.label, f"{p.value[-1]:.3f}{error}", at_end, *words.quality_cells(quality(p))])
        heads = ("parameter", "at the end", "truth", "rms error / rms truth", "truth within the 95 % band", "reliable",
                 "within the band while reliable")  # fmt: skip
        self._add("parameters", "Parameters", body + page.table(heads, rows, numbers=range(1, 7)))

    def _detection(self) -> None:
        flight = self.flight
        body = page.paragraphs([flight.agreement]) if flight.agreement else ""
        if flight.detection is not None and len(flight.detection.time):
            body += self._draw(signals.draw_detection(flight, flight.detection, self.changes))
        elif self.models is not None and self.models.identified:
            body += self._draw(signals.draw_residuals(flight, self.models, self.changes))
        self._add("detection", "Prediction errors and detector", body)

    def _dither(self) -> None:
        dither = self.flight.dither
        if dither is None or not len(dither.time):
            return
        body = self._draw(signals.draw_dither(self.flight, dither, self.changes))
        rows = [[reason or "(none given)", f"{count:,}"] for reason, count in dither.reasons.items()]
        self._add("dither", "Dither", body + page.table(("reason of the level", "commands"), rows, numbers=(1,)))

    def _excitation(self) -> None:
        if self.models is not None and len(self.models.regressors):
            drawn = signals.draw_excitation(self.flight, self.models, self.changes)
            self._add("excitation", "Excitation", self._draw(drawn))

    def _refusals(self) -> None:
        body = ""
        for refusals in self.flight.refusals:
            body += f"<h3>{escape(refusals.source)}</h3>"
            if refusals.counts:
                heads = ("reason", "messages", "first example") if refusals.examples else ("reason", "messages")
                rows = [[r, f"{count:,}", refusals.examples.get(r, "")] for r, count in sorted(refusals.counts.items())]
                body += page.table(heads, [row[: len(heads)] for row in rows], numbers=(1,))
            else:
                body += page.paragraphs(["No message was refused."])
        self._add("refusals", "Refusals", body or page.paragraphs(["The bag holds no record of refusals."]))

    def _configuration(self) -> None:
        flight = self.flight
        body = page.paragraphs([flight.settings_source or "The configuration is not known."])
        if flight.settings:
            rows = [[s.name, s.value, s.unit, s.description] for s in flight.settings]
            body += page.folded(f"all {len(rows)} parameters", page.table(("name", "value", "unit", "meaning"), rows))
        self._add("configuration", "Configuration", body)

    def _bag(self) -> None:
        rows = [[name, kind, f"{count:,}"] for name, kind, count in self.flight.topics]
        body = page.table(("topic", "type", "messages"), rows, numbers=(2,))
        body += "<h3>Versions on the machine that made this report</h3>"
        body += page.table(("program", "version"), list(self.flight.versions.items()))
        self._add("bag", "Bag and versions", body)
