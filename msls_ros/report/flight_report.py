"""A flight's report, in the order of a reader's questions: the verdict, can I trust it, what changed, what is known."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Any

import numpy as np

from msls_ros.report import charts, model_tables, page, parameters, words
from msls_ros.report.chart import Marks, chart
from msls_ros.report.knowledge import Knowledge, SlowChange, gather_knowledge, slow_changes
from msls_ros.report.page import Head, Section
from msls_ros.report.parameters import Parameter, quality
from msls_ros.report.recorded import Models, Recorded, TruthChange, joined
from msls_ros.report.style import derivative, number
from msls_ros.report.verdict import verdict, what_changed

_SAVED_POINTS = 400
"""Of a parameter over time in the JSON that the page holds."""


@dataclass
class Report:
    """A page."""

    html: str
    verdict: list[str]
    parameters: list[str] = field(default_factory=list)
    """Which were shown."""
    sections: list[str] = field(default_factory=list)
    figures: list[charts.Drawn] = field(default_factory=list)
    marks: Marks = field(default_factory=lambda: Marks((0.0, 1.0)))
    """Of all figures."""


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
    return _Builder(flight, wanted).build()


class _Builder:
    """Collects the sections."""

    def __init__(self, flight: Recorded, wanted: Sequence[str]) -> None:
        self.flight = flight
        self.models: Models | None = flight.models if flight.models is not None and len(flight.models.time) else None
        self.changes: list[TruthChange] = []
        self.parameters: list[Parameter] = []
        self.known: Knowledge | None = None
        self.slow: list[SlowChange] = []
        if self.models is not None:
            names = list(wanted) or parameters.choose(self.models)
            self.parameters = [parameters.pick(self.models, flight.truth, name) for name in names]
            self.known = gather_knowledge(self.models, flight.alarms)
            self.slow = slow_changes(self.models, flight.alarms)
            if flight.truth is not None:
                self.changes = words.find_changes(flight.truth, self.models)
        alarms, changes = [e.time for e in flight.alarmed_changes], [c.time for c in self.changes]
        self.marks = Marks(flight.span, alarms, changes, [*alarms, *changes])
        self.sections: list[Section] = []
        self.figures: list[charts.Drawn] = []

    def build(self) -> Report:
        self._trust()
        self._changed()
        self._model()
        self._parameters()
        self._flight()
        self._events()
        self._detection()
        self._dither()
        self._refusals()
        self._configuration()
        sentences = verdict(self.flight, self.known, self.slow, self.changes)
        self._numbers(sentences)
        about = (self.flight.scenario, self.flight.origin, self.flight.models_source)
        head = Head(
            name=self.flight.name,
            about=" · ".join(part for part in about if part),
            verdict=sentences,
            notes=[*self.flight.warnings, *self.flight.missing],
        )
        names = [f"{p.row}/{p.column}" for p in self.parameters]
        html = page.render(head, self.sections)
        return Report(html, sentences, names, [s.anchor for s in self.sections], self.figures, self.marks)

    def _add(self, anchor: str, title: str, body: str) -> None:
        if body:
            self.sections.append(Section(anchor, title, body))

    def _draw(self, drawn: charts.Drawn | None, columns: int = 1) -> str:
        if drawn is None or not drawn.panels:
            return ""
        self.figures.append(drawn)
        return chart(drawn.name, drawn.title, drawn.caption, drawn.panels, self.marks, columns)

    def _trust(self) -> None:
        trust, body = self.flight.trust, ""
        if trust is not None and trust.equations:
            body += page.paragraphs(charts.trust_sentences(trust))
            rows = [
                [derivative(e.name), f"{e.r2:.3f}" if e.excited else "not excited", words.percent(e.white)]
                for e in trust.equations
            ]
            heads = ("equation", "R²: share predicted one sample ahead", "residual as white noise")
            body += page.table(heads, rows, numbers=(1, 2)) + self._draw(charts.draw_trust(trust), 2)
        if self.flight.agreement:
            body += page.paragraphs([self.flight.agreement])
        found = self.flight.findings
        if found:
            bad = [f for f in found if f.level != "note"]
            rows = [[f.level, f.where, f.what, f.change] for f in found]
            table = page.table(("", "where", "what was found", "what to change"), rows)
            said = f"{len(bad)} to look at" if bad else "nothing is wrong"
            body += f"<h3>Check of the data: {said}</h3>" + (table if bad else page.folded(f"{len(rows)} notes", table))
        self._add("trust", "Can I trust it?", body)

    def _changed(self) -> None:
        if self.models is None:
            return
        body = ""
        changed = charts.changed_parameters(self.models, self.flight, self.slow)
        if changed:
            rows = [[name, when, before, after, left] for name, when, before, after, left in changed]
            heads = ("number", "when [s]", "before", "after", "after / before")
            body += page.table(heads, rows, numbers=(2, 3, 4))
            picked = [parameters.pick(self.models, self.flight.truth, row[0]) for row in changed[:4]]
            panels = [parameters.panel_of(p) for p in picked]
            body += self._draw(charts.Drawn("changes", "What changed", charts.PARAMETER_CAPTION, panels), 2)
        else:
            said = what_changed(joined(self.flight.events), [])
            sure = "No number of A or B is surely another one than before."
            body = page.paragraphs([said, sure] if self.flight.alarms else ["Nothing that is sure."])
        self._add("changes", "What changed?", body)

    def _model(self) -> None:
        if self.known is None or self.models is None:
            return
        said = [model_tables.LEGEND]
        if self.models.lag > 0.0:
            said.append(model_tables.servo_text(self.models.lag, self.models.delay))
        if (abs(self.models.state_delay) > model_tables.TIMELY).any():
            said.append(model_tables.timing_text(self.models.states, self.models.state_delay))
        body = page.paragraphs(said) + model_tables.best_tables(self.known)
        truth = self.flight.truth
        if truth is not None and self.known.known.any():
            table = model_tables.truth_table(self.known, truth.a[-1], truth.b[-1])
            body += page.folded("beside the truth", table)
        self._add("model", "The best model of the flight", body)

    def _parameters(self) -> None:
        if not self.parameters or self.models is None:
            return
        panels = [parameters.panel_of(p) for p in self.parameters]
        title = "Parameters over time"
        body = self._draw(charts.Drawn("parameters", title, charts.PARAMETER_CAPTION, panels), 2)
        rows = []
        for p in self.parameters:
            at_end = "" if p.truth is None else number(float(p.truth[-1]))
            error = f" ± {number(float(p.std[-1]), 2)}" if np.isfinite(p.std[-1]) else ""
            cells = words.quality_cells(quality(p))
            rows.append([p.label, f"{number(float(p.value[-1]))}{error}", at_end, *cells])
        heads = ["parameter", "at the end", "truth", "rms error / rms truth", "truth within the 95 % band", "reliable",
                 "within the band while reliable"]  # fmt: skip
        if self.flight.truth is None:
            rows, heads = [[row[0], row[1], row[5]] for row in rows], [heads[0], heads[1], heads[5]]
        self._add("parameters", "Parameters", body + page.table(heads, rows, numbers=range(1, 7)))

    def _flight(self) -> None:
        self._add("flight", "Inputs and states", self._draw(charts.draw_flight(self.flight)))

    def _events(self) -> None:
        if not self.flight.events:
            return
        rows = [
            [
                f"{e.time:.2f}", e.kind, ", ".join(derivative(n) for n in e.equations),
                ", ".join(f"{s:.1f} / {t:g}" for s, t in zip(e.statistic, e.threshold, strict=False)),
                f"{e.effector} ×{e.effectiveness:.2f} ± {e.effectiveness_std:.2f}" if e.effector else "",
                e.description,
            ]
            for e in joined(self.flight.events)
        ]  # fmt: skip
        heads = ("time [s]", "event", "equations", "statistic / threshold", "effectiveness", "description")
        self._add("events", "Events", page.table(heads, rows, numbers=(0,)))

    def _detection(self) -> None:
        drawn = charts.draw_detection(self.flight, self.models)
        self._add("detection", "Prediction errors and detector", self._draw(drawn, 2))

    def _dither(self) -> None:
        dither = self.flight.dither
        if dither is None or not len(dither.time) or not np.any(dither.delta):
            return
        rows = [[reason or "(none given)", f"{count:,}"] for reason, count in dither.reasons.items()]
        table = page.table(("reason of the level", "commands"), rows, numbers=(1,))
        self._add(
            "dither", "Dither", self._draw(charts.draw_dither(dither)) + page.folded("reasons of the level", table)
        )

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
        self._add("refusals", "Refusals", body or page.paragraphs(["The log holds no record of refusals."]))

    def _configuration(self) -> None:
        flight = self.flight
        body = page.paragraphs([flight.settings_source or "The configuration is not known."])
        if flight.settings:
            rows = [[s.name, s.value, s.unit, s.description] for s in flight.settings]
            body += page.folded(f"all {len(rows)} parameters", page.table(("name", "value", "unit", "meaning"), rows))
        rows = [[name, kind, "not counted" if n is None else f"{n:,}"] for name, kind, n in flight.topics]
        body += page.folded(f"{len(rows)} topics", page.table(("topic", "type", "messages"), rows, numbers=(2,)))
        table = page.table(("program", "version"), list(flight.versions.items()))
        body += page.folded("versions on the machine that made this report", table)
        self._add("configuration", "Configuration, topics, versions", body)

    def _numbers(self, sentences: Sequence[str]) -> None:
        if self.known is None or self.models is None:
            return
        content: dict[str, Any] = {
            "flight": self.flight.name,
            "verdict": list(sentences),
            "states": list(self.models.states),
            "effectors": list(self.models.effectors),
            "best": [
                {"row": self.known.rows[i], "column": self.known.columns[j], "value": float(self.known.value[i, j]),
                 "std": float(self.known.std[i, j]), "time_s": float(self.known.time[i, j]),
                 "reliable_at_end": bool(self.known.now[i, j])}
                for i, j in np.argwhere(self.known.known).tolist()
            ],
            "events": [
                {"time_s": e.time, "kind": e.kind, "equations": list(e.equations), "effector": e.effector}
                for e in self.flight.events
            ],
            "parameters": {f"{p.row}/{p.column}": _saved(p) for p in self.parameters},
        }  # fmt: skip
        text = json.dumps(content, allow_nan=False, separators=(",", ":"))
        links = page.download("model.csv", "text/csv", model_tables.as_csv(self.known), "A and B (CSV)")
        links += page.download("flight.json", "application/json", text, "verdict, model, events, parameters (JSON)")
        self._add("numbers", "The numbers", f'<p class="files">{links}</p>')


def _saved(p: Parameter) -> dict[str, list[float | None]]:
    few = slice(None, None, max(1, -(-len(p.time) // _SAVED_POINTS)))
    columns = {"time_s": p.time[few], "value": p.value[few], "std": p.std[few]}
    return {
        name: [float(f"{v:.6g}") if np.isfinite(v) else None for v in column.tolist()]
        for name, column in columns.items()
    }
