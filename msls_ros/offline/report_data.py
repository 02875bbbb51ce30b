"""From a bag to what the report draws: what was recorded, and what can be computed again from its inputs."""

from __future__ import annotations

import json
import platform
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import datetime, timezone
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msls_ros.bags import BagError
from msls_ros.estimation import Configuration
from msls_ros.estimation.configuration import items
from msls_ros.inputs.profiles import read_profile
from msls_ros.offline.recompute import Recomputed, fitting, recompute
from msls_ros.offline.recording import Recording, Stamped, longest_stretch, record_of
from msls_ros.offline.replay import PARAMETERS, kept_parameters
from msls_ros.report.recorded import (
    Detection,
    Dither,
    Event,
    Models,
    Recorded,
    Refusals,
    Setting,
    Signals,
    Truth,
)

Array = NDArray[np.float64]
_KINDS = {1: "detected", 2: "isolated", 3: "recovered", 4: "reset"}
_EPOCH = 100_000_000_000_000
"""Stamps beyond this count from somewhere else than the flight's beginning [ns]."""
_PROGRAMS = ("numpy", "numba", "rosbags", "matplotlib")


def gather(
    bag: Path,
    params: str | None = None,
    namespace: str | None = None,
    progress: Callable[[str, float], None] = lambda what, share: None,
) -> Recorded:
    """Read a bag, and identify from its inputs again where the configuration is known or no model was recorded.

    Parameters
    ----------
    bag
        Directory or file.
    params
        Parameter file or shipped profile; None: the one kept in the bag's folder.
    namespace
        The aircraft, where the bag has several.
    progress
        Called with what is being done and the share that is done.

    Raises
    ------
    BagError
        If there is nothing to report.
    EstimationError
        If the configuration is wrong.
    """
    record = record_of(bag, namespace, lambda share: progress("reading", share))
    return _Gathering(bag, record, params).run(lambda share: progress("identifying", share))


class _Gathering:
    """Puts together what was recorded and what is computed again."""

    def __init__(self, bag: Path, record: Recording, params: str | None) -> None:
        self.bag, self.record = bag, record
        self.warnings = list(record.warnings)
        self.missing: list[str] = []
        self.recorded_models = bool(record.messages["model"])
        self.samples = {leaf: record.samples(leaf) for leaf in ("state", "effectors")}
        self.inputs = all(self.samples.values())
        self.configuration, self.source = self._configuration(params)

    def _configuration(self, params: str | None) -> tuple[Configuration | None, str]:
        """Return the configuration, if any, and where it is from."""
        if params is not None:
            return read_profile(params), f"The parameters given with --params {params}."
        try:
            kept = read_profile(str(kept_parameters(self.bag)))
        except BagError:
            if self.recorded_models or not self.inputs:
                return None, (
                    f"Not known: no {PARAMETERS} beside the bag. Give --params to compute the detector's statistic."
                )
            names = [tuple(self.samples[leaf][0][1].names) for leaf in ("state", "effectors")]
            return fitting(names[0], names[1]), "The identifier's defaults: there is no other configuration."
        return kept, f"{PARAMETERS} beside the bag."

    def run(self, progress: Callable[[float], None]) -> Recorded:
        computed = self._recompute(progress)
        streams = self._streams(computed)
        main = next((name for name in ("model", "computed model", "state") if streams.get(name)), "state")
        streams, stretches = longest_stretch(streams, main)
        if stretches > 1:
            self.warnings.append(
                f"time jumps back in this bag: of its {stretches} stretches the longest is shown; counts are of all"
            )
        stamps = [stream[0][0] for stream in streams.values() if stream]
        first = min(stamps, default=0)
        self.origin = first if first > _EPOCH else 0
        flight = self._recorded(streams, computed)
        self._say_what_is_missing(flight)
        return replace(flight, warnings=self.warnings, missing=self.missing)

    def _recompute(self, progress: Callable[[float], None]) -> Recomputed | None:
        if not self.inputs:
            return None
        names = [tuple(self.samples[leaf][0][1].names) for leaf in ("state", "effectors")]
        configuration = self.configuration or fitting(names[0], names[1])
        identify = self.configuration is not None
        found = recompute(self.record.inputs, configuration, identify=identify, progress=progress)
        if not found.paired:
            self.warnings.append("no sample passed the input checks: see the refusals")
        return found

    def _streams(self, computed: Recomputed | None) -> dict[str, Stamped[Any]]:
        """Return all that has stamps, by name; what was computed takes the place of what was not recorded."""
        streams: dict[str, Stamped[Any]] = {
            "model": [],
            "fault": [],
            "dither": [],
            "truth/model": [],
            **self.samples,
            **self.record.messages,
        }
        if computed is not None and computed.signals:
            streams["signals"] = computed.signals
            streams["computed model"] = computed.models.items
            if not self.recorded_models:
                streams.update({"fault": list(computed.events), "dither": list(computed.dithers)})
        return streams

    def _recorded(self, streams: dict[str, Stamped[Any]], computed: Recomputed | None) -> Recorded:
        models = self._models(streams["model"] or streams.get("computed model", []), computed)
        truth = self._truth(streams["truth/model"], models)
        dither = self._dither(streams["dither"], truth, models)
        return Recorded(
            name=f"{self.bag.resolve().parent.name}/{self.bag.resolve().name}",
            origin=self._origin_text(),
            topics=self.record.topics,
            states=self._signals(streams["state"]),
            deflections=self._signals(streams["effectors"]),
            models=models,
            models_source=self._models_source(models),
            truth=truth,
            dither=dither,
            events=[self._event(stamp, event) for stamp, event in streams["fault"]],
            detection=self._detection(streams.get("signals", [])),
            agreement=self._agreement(streams),
            refusals=self._refusals(computed),
            samples=computed.paired if computed is not None else None,
            settings=self._settings(),
            settings_source=self.source,
            scenario=flown(self.bag),
            versions=versions(),
        )

    def _time(self, stream: Stamped[Any]) -> Array:
        return np.array([(stamp - self.origin) * 1e-9 for stamp, _ in stream], dtype=np.float64)

    def _origin_text(self) -> str:
        if not self.origin:
            return "times are the stamps of the messages"
        begin = datetime.fromtimestamp(self.origin * 1e-9, timezone.utc)
        return f"time 0 is {begin:%Y-%m-%d %H:%M:%S.%f} UTC (stamp {self.origin * 1e-9:.3f} s)"

    def _signals(self, stream: Stamped[Any]) -> Signals | None:
        if not stream:
            return None
        names = stream[0][1].names
        same = [
            (stamp, sample) for stamp, sample in stream if sample.names == names and len(sample.values) == len(names)
        ]
        if not same:
            return None
        return Signals(self._time(same), tuple(names), np.array([sample.values for _, sample in same]))

    def _models(self, stream: Stamped[Any], computed: Recomputed | None) -> Models | None:
        if not stream:
            return None
        first = stream[0][1]
        states, effectors, p = tuple(first.states), tuple(first.effectors), len(first.regressors)
        n, m = len(states), len(effectors)
        sizes = {"a": n * n, "b": n * m, "a_std": n * n, "b_std": n * m, "a_known": n * n, "a_reliable": n * n,
                 "b_reliable": n * m, "excitation": p, "residual_std": n}  # fmt: skip
        good = [
            (stamp, model)
            for stamp, model in stream
            if tuple(model.states) == states and all(np.size(getattr(model, k)) == s for k, s in sizes.items())
        ]
        if len(good) < len(stream):
            self.warnings.append(f"{len(stream) - len(good)} models with other names or wrong lengths are left out")
        if not good or not n:
            return None
        columns = {k: np.array([np.ravel(getattr(model, k)) for _, model in good]) for k in sizes}
        square, wide = (-1, n, n), (-1, n, m)
        return Models(
            time=self._time(good),
            states=states,
            effectors=effectors,
            regressors=tuple(first.regressors),
            a=columns["a"].reshape(square),
            b=columns["b"].reshape(wide),
            a_std=columns["a_std"].reshape(square),
            b_std=columns["b_std"].reshape(wide),
            a_known=columns["a_known"][-1].reshape(n, n).astype(np.bool_),
            a_reliable=columns["a_reliable"].reshape(square).astype(np.bool_),
            b_reliable=columns["b_reliable"].reshape(wide).astype(np.bool_),
            excitation=columns["excitation"],
            residual_std=columns["residual_std"],
            stride=self.record.stride if self.recorded_models or computed is None else computed.models.stride,
        )

    def _models_source(self, models: Models | None) -> str:
        if models is None:
            return ""
        thinned = f", every {models.stride}th is drawn" if models.stride > 1 else ""
        return ("models as recorded" if self.recorded_models else "models computed from the recorded inputs") + thinned

    def _truth(self, stream: Stamped[Any], models: Models | None) -> Truth | None:
        if not stream or models is None:
            return None
        first = stream[0][1]
        states, effectors = list(first.states), list(first.effectors)
        lacking = [n for n in models.states if n not in states] + [e for e in models.effectors if e not in effectors]
        if lacking:
            self.warnings.append(f"truth/model has no '{lacking[0]}': it cannot be compared with the estimate")
            return None
        n, m = len(states), len(effectors)
        good = [(s, t) for s, t in stream if list(t.states) == states and len(t.a) == n * n and len(t.b) == n * m]
        if not good:
            return None
        rows = [states.index(name) for name in models.states]
        columns = [effectors.index(name) for name in models.effectors]
        a = np.array([t.a for _, t in good]).reshape(-1, n, n)[:, rows][:, :, rows]
        b = np.array([t.b for _, t in good]).reshape(-1, n, m)[:, rows][:, :, columns]
        return Truth(self._time(good), a, b)

    def _dither(self, stream: Stamped[Any], truth: Truth | None, models: Models | None) -> Dither | None:
        if not stream:
            return None
        names = tuple(getattr(stream[0][1], "effectors", models.effectors if models is not None else ()))
        same = [(stamp, d) for stamp, d in stream if len(d.delta) == len(names)]
        if not same:
            return None
        dither = Dither(
            time=self._time(same),
            effectors=names,
            delta=np.array([d.delta for _, d in same], dtype=np.float64),
            predicted=np.array([d.predicted_acceleration for _, d in same]),
            limit=np.array([d.acceleration_limit for _, d in same]),
            level=np.clip(np.array([int(d.level) for _, d in same], dtype=np.int64), 0, 3),
            reasons=dict(Counter(str(d.reason) for _, d in same).most_common()),
        )
        return replace(dither, realised=_realised(dither, truth, models, self.bag))

    def _event(self, stamp: int, e: Any) -> Event:
        return Event(
            time=(stamp - self.origin) * 1e-9,
            kind=_KINDS.get(int(e.kind), "detected"),
            equations=tuple(e.equations),
            statistic=tuple(float(v) for v in e.statistic),
            threshold=tuple(float(v) for v in e.threshold),
            effector=str(e.suspected_effector),
            effectiveness=float(e.effectiveness),
            effectiveness_std=float(e.effectiveness_std),
            description=str(e.description),
        )

    def _detection(self, stream: Stamped[Any]) -> Detection | None:
        if not stream or self.configuration is None:
            return None
        return Detection(
            time=self._time(stream),
            rows=self.configuration.rows,
            error=np.array([error for _, (error, _) in stream]),
            statistic=np.array([statistic for _, (_, statistic) in stream]),
            threshold=self.configuration.detector.threshold,
            enabled=self.configuration.detector.mode != "off",
        )

    def _agreement(self, streams: dict[str, Stamped[Any]]) -> str:
        """Compare the models computed again with the recorded ones of the same stamps."""
        if not self.recorded_models or not streams.get("computed model"):
            return ""
        again = dict(streams["computed model"])
        pairs = [(model, again[stamp]) for stamp, model in streams["model"] if stamp in again]
        pairs = [(one, two) for one, two in pairs if tuple(one.states) == two.states and len(one.b) == two.b.size]
        if not pairs:
            return "Recomputed from the inputs; no model of the bag has the stamp and the names of one of these."
        equal = sum(bool(np.array_equal(np.ravel(one.b), np.ravel(two.b))) for one, two in pairs)
        if equal == len(pairs):
            return f"Recomputed from the inputs: B equals the recorded one bit for bit in all {equal} models."
        most = max(float(np.nanmax(np.abs(np.ravel(one.b) - np.ravel(two.b)))) for one, two in pairs)
        return (
            f"Recomputed from the inputs: B equals the recorded one in {equal} of {len(pairs)} models and differs "
            f"by up to {most:.3g} in the others. The flight had another configuration, or it was changed in flight."
        )

    def _refusals(self, computed: Recomputed | None) -> list[Refusals]:
        found = []
        for name, values in sorted(self.record.diagnostics.items()):
            refused = {k.removeprefix("refused: "): v for k, v in values.items() if k.startswith("refused: ")}
            counts = {reason: int(count) for reason, count in refused.items() if count.isdecimal()}
            found.append(Refusals(f"Counted in flight by {name.split(':')[0]} (/diagnostics, the last)", counts))
        if computed is not None:
            found.append(
                Refusals(
                    "Counted by the identifier's input checks when the bag was read",
                    computed.refused,
                    computed.examples,
                )
            )
        return found

    def _settings(self) -> Sequence[Setting]:
        if self.configuration is None:
            return []
        return [Setting(name, _text(value), b.unit, b.description) for name, value, b in items(self.configuration)]

    def _say_what_is_missing(self, flight: Recorded) -> None:
        """List what the bag does not hold, and the consequence."""
        if not self.recorded_models:
            self.missing.append(
                "The bag holds no model: models, events and dither are identified offline from its inputs."
                if flight.models is not None
                else "The bag holds no model, and none can be computed from its inputs."
            )
        for leaf, what in (("state", "states"), ("effectors", "deflections")):
            if not self.samples[leaf]:
                self.missing.append(f"The bag holds no {what} (topic {leaf}): nothing can be recomputed.")
        if flight.dither is None:
            self.missing.append("The bag holds no dither.")
        if flight.truth is None:
            self.missing.append("The bag holds no truth (topic truth/model): estimates cannot be compared.")
        if self.recorded_models and self.configuration is None:
            self.missing.append(
                f"No {PARAMETERS} beside the bag and no --params: the detector's statistic is known at alarms only."
            )


def _text(value: Any) -> str:
    if isinstance(value, tuple):
        return ", ".join(_text(v) for v in value) or "(none)"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _realised(dither: Dither, truth: Truth | None, models: Models | None, bag: Path) -> Array | None:
    """Return the rms over 1 s of the acceleration by the dither alone, where the aircraft is our plant."""
    if truth is None or models is None or len(dither.time) < 3:
        return None
    from msls_ros.flights.comparison import realised_acceleration
    from msls_ros.offline.comparison import airframe_of
    from msls_ros.plant import STATES

    airframe = airframe_of(bag)
    effectors = airframe.effectors
    if models.states != tuple(STATES) or models.effectors != effectors or dither.effectors != effectors:
        return None
    flat = truth.b.reshape(len(truth.b), -1)
    held = np.stack([np.interp(dither.time, truth.time, column) for column in flat.T], axis=1)
    acceleration = realised_acceleration(dither.time, dither.delta, held.reshape(-1, *truth.b.shape[1:]), airframe)
    step = float(np.median(np.diff(dither.time)))
    width = int(np.clip(round(1.0 / step) if step > 0.0 else 1, 1, len(dither.time)))
    square = np.convolve(np.square(acceleration).sum(axis=1), np.ones(width) / width, mode="same")
    return np.sqrt(square)


def flown(bag: Path) -> str:
    """Return what the demo flew, from the summary that it leaves beside the bag; empty: not known."""
    try:
        summary = json.loads((bag.resolve().parent / "summary.json").read_text(encoding="utf-8"))
        if Path(summary["bag"]).name != bag.resolve().name:
            return ""
        text = str(summary.get("description", summary["scenario"]))
    except (OSError, ValueError, KeyError, TypeError):
        return ""
    noise = f", sensor noise {summary['noise']}, seed {summary['seed']}" if {"noise", "seed"} <= set(summary) else ""
    return f"{text}{noise}"


def versions() -> dict[str, str]:
    """Return the versions of what the report was made with."""
    found = {"msls_ros": _version("msls_ros"), "Python": platform.python_version()}
    return {**found, **{name: _version(name) for name in _PROGRAMS}}


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"
