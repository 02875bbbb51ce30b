"""From a bag to what the report draws: what was recorded, and what can be computed again from its inputs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msls_ros.bags import BagError, open_any
from msls_ros.estimation import Configuration
from msls_ros.estimation.configuration import items
from msls_ros.inputs import InputMap
from msls_ros.inputs.profiles import ADD_ATTITUDE, BESIDE_A_BAG, lacks_attitude, read_profile, read_warm_start
from msls_ros.inputs.series import Collector
from msls_ros.offline.best import origin_of
from msls_ros.offline.inspection import MOST, Inspection, inspect
from msls_ros.offline.mapped import is_own, mapped_recording
from msls_ros.offline.opening import Chosen, chosen_parameters
from msls_ros.offline.recompute import Recomputed, fitting, recompute
from msls_ros.offline.recording import Recording, Stamped, longest_stretch, record_of, spans_of
from msls_ros.offline.replay import kept_parameters
from msls_ros.offline.report_series import (
    dither_of,
    event_of,
    flown,
    missing_dither,
    models_of,
    signals_of,
    times,
    truth_of,
    versions,
)
from msls_ros.offline.sources import InputTopics
from msls_ros.offline.trust import trust_of
from msls_ros.report.recorded import Detection, Finding, Models, Recorded, Refusals, Setting

Array = NDArray[np.float64]


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
    reader = open_any(bag)
    if is_own(reader):
        record = record_of(bag, namespace, lambda share: progress("reading", share))
        gathering = _Gathering(bag, record, params)
    else:
        chosen = chosen_parameters(reader, params, namespace)
        assert isinstance(chosen.inputs, InputMap)
        first = _First(chosen.inputs)
        record = mapped_recording(reader, chosen.configuration, chosen.inputs, lambda s: progress("reading", s), first)
        gathering = _Gathering(bag, record, params, chosen)
        seen = first.collector.record(), first.count
        gathering.inspection = inspect(reader, chosen.configuration, chosen.inputs, seen=seen)
    return gathering.run(lambda share: progress("identifying", share))


class _First:
    """Collects what an inspection looks at, while a log is read for another purpose."""

    def __init__(self, inputs: InputMap) -> None:
        self.collector, self.count = Collector(inputs), 0

    def take(self, topic: str, logged: int, message: Any) -> None:
        """Take a message, of the first of a log."""
        if self.count < MOST:
            self.collector.take(topic, logged, message)
            self.count += 1

    def undecoded(self, topic: str, why: str) -> None:
        """Take note of one that cannot be decoded."""
        if self.count < MOST:
            self.collector.undecoded(topic, why)
            self.count += 1


class _Gathering:
    """Puts together what was recorded and what is computed again."""

    def __init__(self, bag: Path, record: Recording, params: str | None, chosen: Chosen | None = None) -> None:
        self.bag, self.record = bag, record
        self.warnings = list(record.warnings)
        self.missing: list[str] = []
        self.recorded_models = bool(record.messages["model"])
        self.samples = {leaf: record.samples(leaf) for leaf in ("state", "effectors")}
        self.inputs = all(self.samples.values())
        self.inspection: Inspection | None = None
        self.configuration: Configuration | None
        self.warm_start: Path | None = None
        if chosen is not None:
            self.configuration, self.source = chosen.configuration, f"Read with {chosen.source}."
            self.warm_start = chosen.warm_start
        else:
            self.configuration, self.source = self._configuration(params)

    def _configuration(self, params: str | None) -> tuple[Configuration | None, str]:
        """Return the configuration, if any, and where it is from."""
        if params is not None:
            self.warm_start = read_warm_start(params)
            return read_profile(params), f"The parameters given with --params {params}."
        try:
            file = kept_parameters(self.bag)
            kept, self.warm_start = read_profile(file), read_warm_start(file)
        except BagError:
            if self.recorded_models or not self.inputs:
                return None, (
                    f"Not known: no {BESIDE_A_BAG} beside the bag. Give --params to compute the detector's statistic."
                )
            names = [tuple(self.samples[leaf][0][1].names) for leaf in ("state", "effectors")]
            configuration, text = (
                fitting(names[0], names[1]),
                "The identifier's defaults: there is no other configuration.",
            )
            if not configuration.known_gravity and lacks_attitude(names[0]):
                text += f" Gravity is not taken off. {ADD_ATTITUDE}."
            return configuration, text
        return kept, f"{BESIDE_A_BAG} beside the bag."

    def run(self, progress: Callable[[float], None]) -> Recorded:
        computed = self._recompute(progress)
        streams = self._streams(computed)
        main = next((name for name in ("model", "computed model", "state") if streams.get(name)), "state")
        spans = spans_of(streams[main])
        streams, stretches = longest_stretch(streams, main)
        if stretches > 1:
            shown = streams[main][0][0], streams[main][-1][0]
            spans.remove(shown)
            others = ", ".join(f"{begin * 1e-9:.2f} to {end * 1e-9:.2f} s" for begin, end in spans)
            self.warnings.append(
                f"time jumps back in this bag: of its {stretches} stretches the longest is shown, "
                f"{shown[0] * 1e-9:.2f} to {shown[1] * 1e-9:.2f} s as stamped; counts are of all. Not shown: {others}; "
                "there is no option that shows them; record each run in a bag of its own"
            )
        stamps = [stream[0][0] for stream in streams.values() if stream]
        first = min(stamps, default=0)
        self.origin = origin_of(first)
        flight = self._recorded(streams, computed)
        self._say_what_is_missing(flight)
        return replace(flight, warnings=self.warnings, missing=self.missing)

    def _recompute(self, progress: Callable[[float], None]) -> Recomputed | None:
        if not self.inputs:
            return None
        names = [tuple(self.samples[leaf][0][1].names) for leaf in ("state", "effectors")]
        configuration = self.configuration or fitting(names[0], names[1])
        identify = self.configuration is not None
        found = recompute(
            self.record.inputs,
            configuration,
            identify=identify,
            straddle=self.record.straddle,
            servos=self.record.servos,
            warm_start=self.warm_start,
            progress=progress,
        )
        self.warnings += found.warnings
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
                streams["fault"] = list(computed.events)
        return streams

    def _recorded(self, streams: dict[str, Stamped[Any]], computed: Recomputed | None) -> Recorded:
        stride = self.record.stride if self.recorded_models or computed is None else computed.models.stride
        stream = streams["model"] or streams.get("computed model", [])
        models = models_of(stream, self.origin, stride, self.warnings)
        truth = truth_of(streams["truth/model"], self.origin, models, self.warnings)
        dither = dither_of(streams["dither"], self.origin, truth, models, self.bag)
        deflections = signals_of(streams["effectors"], self.origin)
        if said := missing_dither(deflections, dither, self.record.straddle):
            self.warnings.append(said)
        events = [event_of(stamp, self.origin, event) for stamp, event in streams["fault"]]
        alarms = [e for e in events if e.kind == "detected"]
        return Recorded(
            name=f"{self.bag.resolve().parent.name}/{self.bag.resolve().name}",
            origin=self._origin_text(),
            topics=self.record.topics,
            states=signals_of(streams["state"], self.origin),
            deflections=deflections,
            models=models,
            models_source=self._models_source(models),
            truth=truth,
            dither=dither,
            events=events,
            detection=self._detection(streams.get("signals", [])),
            agreement=self._agreement(streams),
            trust=trust_of(self.configuration, computed, models, alarms, self.origin),
            findings=self._findings(),
            refusals=self._refusals(computed),
            samples=computed.paired if computed is not None else None,
            settings=self._settings(),
            settings_source=self.source,
            scenario=flown(self.bag),
            versions=versions(),
        )

    def _findings(self) -> list[Finding]:
        """Return what the check of the data finds."""
        found = self.inspection
        if found is None and self.inputs and self.configuration is not None:
            reader = open_any(self.bag)
            found = inspect(reader, self.configuration, InputTopics(self.record.prefix))
        return [Finding(f.level, f.where, f.what, f.change) for f in found.findings] if found is not None else []

    def _origin_text(self) -> str:
        if not self.origin:
            return "times are the stamps of the messages"
        begin = datetime.fromtimestamp(self.origin * 1e-9, timezone.utc)
        return f"time 0 is {begin:%Y-%m-%d %H:%M:%S.%f} UTC (stamp {self.origin * 1e-9:.3f} s)"

    def _models_source(self, models: Models | None) -> str:
        if models is None:
            return ""
        thinned = f", every {models.stride}th is drawn" if models.stride > 1 else ""
        return ("models as recorded" if self.recorded_models else "models computed from the recorded inputs") + thinned

    def _detection(self, stream: Stamped[Any]) -> Detection | None:
        if not stream or self.configuration is None:
            return None
        return Detection(
            time=times(stream, self.origin),
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
                    "Counted by the identifier's input checks when the log was read",
                    {**self.record.refused, **computed.refused},
                    {**self.record.examples, **computed.examples},
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
                "The log holds no model: models and events are identified from its inputs."
                if flight.models is not None
                else "The log holds no model, and none can be computed from its inputs."
            )
        for leaf, what in (("state", "states"), ("effectors", "deflections")):
            if not self.samples[leaf]:
                self.missing.append(f"The bag holds no {what} (topic {leaf}): nothing can be recomputed.")
        if flight.truth is None and self.recorded_models:
            self.missing.append("The bag holds no truth (topic truth/model): estimates cannot be compared.")
        if self.recorded_models and self.configuration is None:
            self.missing.append(
                f"No {BESIDE_A_BAG} beside the bag and no --params: the detector's statistic is known at alarms only."
            )


def _text(value: Any) -> str:
    if isinstance(value, tuple):
        return ", ".join(_text(v) for v in value) or "(none)"
    return f"{value:g}" if isinstance(value, float) else str(value)
