"""Are the streams of a map fast enough, whole, and of one clock? Each check yields findings; see `findings`."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from msls_ros.estimation import Configuration
from msls_ros.estimation.repeats import SLOWEST, RepeatFilter, repeat_settings
from msls_ros.inputs.derivatives import usual_intervals
from msls_ros.inputs.findings import DOUBTFUL, NOTE, WRONG, Finding
from msls_ros.inputs.input_map import UNITS, InputMap, TopicInput
from msls_ros.inputs.input_plan import plan
from msls_ros.inputs.series import UNDECODED, Record, Series, TopicTimes

_SLOW, _TOO_SLOW = 20.0, 8.0
"""Rates of a servo record below which B is doubtful, and wrong: rigid-body modes are at 0.5 to 3 Hz [Hz]."""
_RATE_OFF, _RATE_WRONG = 0.1, 0.5
"""Deviation of the clock's rate from sample_rate, as a share."""
_SHORT = 0.7
"""Share of the usual window of derivatives below which one is short: the noise is 1.7 times as large."""
_MEASURED = 0.75
"""Share of the messages that measure a number, below which the others are of note."""
_EFFECTORS = "effectors."
_SELDOM = 1e-3
"""Of the messages: fewer that cannot be used are the link's doing or the sensor's, not the map's."""
_OF_THE_LINK = ("not_finite", "field_missing", "names")
_ARRIVAL = "stamp=arrival, or stamp=PATH of a number that counts s, ms, us or ns"


def check_fields(record: Record) -> Iterator[Finding]:
    """Yield what could not be read: fields, elements, joints, numbers that are none, quaternions of no length."""
    for where, reasons in record.failures.items():
        for reason, (count, text) in reasons.items():
            if where in record.inputs.compared and where in record.series:
                continue
            whole = where not in record.series and where.removeprefix("topics.") not in _filled(record)
            level = WRONG if whole or reason == "field" else DOUBTFUL
            if level == DOUBTFUL and reason in _OF_THE_LINK and count < _SELDOM * _messages(record, where):
                yield Finding(NOTE, reason, f"inputs.{where}", f"{text} (in {count} messages, that are refused)", "")
                continue
            what, change = f"{text} ({'in every message' if whole else f'in {count} messages'})", _mend_of(reason)
            if reason == UNDECODED:
                total = len(record.topics[where.removeprefix("topics.")].stamps) + sum(n for n, _ in reasons.values())
                what = f"{total:,} messages, {'none can' if count == total else f'{count:,} cannot'} be decoded: {text}"
                change = change if count == total else "record it again, or do without these"
            yield Finding(level, reason, f"inputs.{where}", what, change)
    for alias, topic in record.inputs.topics.items():
        if not len(record.topics[alias].stamps) and f"topics.{alias}" not in record.failures:
            what = f"topic {topic.topic} has no message in this log"
            yield Finding(WRONG, "empty", f"inputs.topics.{alias}", what, "map another topic, or record this one")


def _messages(record: Record, where: str) -> int:
    """Return how many good messages of a stream or a topic there are."""
    if where in record.series:
        return len(record.series[where].stamps)
    topic = record.topics.get(where.removeprefix("topics."))
    return 0 if topic is None else len(topic.stamps)


def _filled(record: Record) -> set[str]:
    return {alias for alias, times in record.topics.items() if len(times.stamps)}


def _mend_of(reason: str) -> str:
    return {
        UNDECODED: "record it again, or give the definition of its type",
        "names": "write names that the messages have into states and effectors",
        "field": "write one of the fields that exist",
        "field_missing": "write an element that the messages hold",
        "not_finite": "map a field that is measured",
        "quaternion": "map the field that holds the attitude; this one is not filled in",
    }.get(reason, "")


def check_rates(record: Record, configuration: Configuration) -> Iterator[Finding]:
    """Yield rate, jitter and gaps of each topic, and what does not fit sample_rate and maximum_age."""
    inputs = record.inputs
    for alias, times in record.topics.items():
        if len(times.stamps) < 3:
            continue
        yield from _check_topic(inputs.topics[alias], f"inputs.topics.{alias}", times, inputs.maximum_age)
    clock = record.topics[inputs.clock]
    rate = _rate(clock)
    if rate:
        off = rate / configuration.sample_rate - 1.0
        if abs(off) > _RATE_OFF:
            level = WRONG if abs(off) > _RATE_WRONG else DOUBTFUL
            what = f"the clock {inputs.topics[inputs.clock].topic} comes at {rate:.3g} Hz, sample_rate is "
            what += f"{configuration.sample_rate:g} Hz"
            yield Finding(level, "sample_rate", "sample_rate", what, f"sample_rate: {rate:.3g}")
        yield from _check_window(inputs, configuration, rate)
    for name, series in record.series.items():
        if name not in inputs.compared:
            yield from _check_age(name, series, rate)
            yield from _check_repeats(name, series)


def _check_window(inputs: InputMap, configuration: Configuration, rate: float) -> Iterator[Finding]:
    usual = usual_intervals(configuration.sample_rate)
    made = "differentiated" in plan(inputs, configuration.states, configuration.effectors).values()
    if made and 0 < inputs.intervals < _SHORT * usual:
        what = f"derivatives are made in a window of {inputs.intervals / rate:.2g} s: sensor noise in them is "
        what += f"{(usual / inputs.intervals) ** 1.5:.2g} times that of the usual one, of {usual} intervals"
        yield Finding(DOUBTFUL, "window", "inputs.intervals", what, "intervals: 0")


def _check_topic(topic: TopicInput, where: str, times: TopicTimes, age: int) -> Iterator[Finding]:
    steps = np.diff(times.stamps)
    steps = steps[steps > 0]
    if not len(steps):
        what = "all stamps are the same"
        yield Finding(WRONG, "stamps", where, what, "give stamp=PATH of the field that counts time, or stamp=arrival")
        return
    median = float(np.median(steps)) * 1e-9
    logged = float(np.median(np.diff(times.logged))) * 1e-9
    low, high = np.quantile(steps, [0.05, 0.95]) * 1e-9
    what = f"{1.0 / median:.4g} Hz, 90 % of the steps between {1e3 * low:.3g} and {1e3 * high:.3g} ms"
    yield Finding(NOTE, "rate", where, what)
    ratio = median / logged if logged > 0.0 else 1.0
    spans = [float(s[-1] - s[0]) for s in (times.stamps, times.logged)]
    whole = spans[0] / spans[1] if spans[1] > 0.0 else 1.0
    if min(ratio, whole) > 30.0 or max(ratio, whole) < 1.0 / 30.0:
        what = f"stamps go on {whole:.3g} times as fast as the log's own time"
        yield Finding(WRONG, "stamps", where, what, _unit(topic, whole) or _unit(topic, ratio) or _ARRIVAL)
    if times.repeated + times.back > 0.02 * len(times.stamps):
        what = f"{times.repeated} stamps repeat and {times.back} go back, of {len(times.stamps)}"
        level = WRONG if times.repeated + times.back > 0.5 * len(times.stamps) else DOUBTFUL
        yield Finding(level, "stamps", where, what, "give stamp=PATH of the instant of the measurement")
    gaps = steps[steps > max(5e9 * median, age)] * 1e-9
    if len(gaps):
        what = f"{len(gaps)} gaps, the longest {gaps.max():.3g} s"
        yield Finding(DOUBTFUL, "gaps", where, what, "nothing is learnt there; look at the recorder or the link")


def _unit(topic: TopicInput, speed: float) -> str:
    """Return the unit to write for stamps that go on so many times too fast as read; empty where no unit mends it."""
    if topic.stamp is not None and topic.stamp.text.rpartition(".")[2] == "stamp":
        return ""  # a time of ROS has its unit
    fits = (name for name, size in UNITS.items() if 0.3 < size * speed / topic.unit < 3.0)
    return next((f"unit={name}, as the stamps count" for name in fits), "")


def _rate(times: TopicTimes) -> float:
    steps = np.diff(times.stamps)
    steps = steps[steps > 0]
    return 1e9 / float(np.median(steps)) if len(steps) > 1 else 0.0


def _check_age(name: str, series: Series, clock_rate: float) -> Iterator[Finding]:
    if len(series.stamps) < 3:
        return
    period = float(np.median(np.diff(series.stamps))) * 1e-9
    age, where = series.stream.track.age * 1e-9, f"inputs.{name}"
    if period > age:
        what = f"a sample every {period:.3g} s is older than maximum_age allows, {age:g} s: most instants are refused"
        mend = f"maximum_age: {1.5 * period:.2g}, or age={1.5 * period:.2g} in this line; better: record it faster"
        yield Finding(WRONG, "age", where, what, mend)
    if not name.startswith(_EFFECTORS) or series.stream.track.held:
        return
    rate = 1.0 / period
    if rate < _TOO_SLOW or (rate < _SLOW and clock_rate > 2.0 * rate):
        what = f"{rate:.3g} Hz is too slow for a surface: what it does in between is not seen, and B comes out wrong"
        level = WRONG if rate < _TOO_SLOW else DOUBTFUL
        yield Finding(level, "servo_rate", where, what, f"record it at {max(25.0, min(clock_rate, 50.0)):g} Hz or more")


def _check_repeats(name: str, series: Series) -> Iterator[Finding]:
    if len(series.stamps) < 3:
        return
    rate = 1e9 / float(np.median(np.diff(series.stamps)))
    judge = RepeatFilter(repeat_settings([False] * series.values.shape[1], rate, SLOWEST))
    measured = [judge.measured(row) for row in series.values]
    share = float(np.mean(measured[len(measured) // 4 :]))  # it is known after eight changes
    if share < _MEASURED:
        what = f"it is measured at {share * rate:.3g} Hz: of the messages, at {rate:.3g} Hz, the others repeat it"
        yield Finding(DOUBTFUL, "repeats", f"inputs.{name}", what, "they are not used; measure it as often, if you can")


def check_clocks(record: Record) -> Iterator[Finding]:
    """Yield streams that share no time with the clock."""
    clock = record.topics[record.inputs.clock].stamps
    if not len(clock):
        return
    for alias, times in record.topics.items():
        if not len(times.stamps) or alias == record.inputs.clock:
            continue
        if times.stamps.max() < clock.min() or times.stamps.min() > clock.max():
            what = (
                f"stamps from {times.stamps[0] * 1e-9:.6g} to {times.stamps[-1] * 1e-9:.6g} s share no time with those "
                f"of the clock, {clock[0] * 1e-9:.6g} to {clock[-1] * 1e-9:.6g} s: two clocks, or another unit"
            )
            yield Finding(WRONG, "clocks", f"inputs.topics.{alias}", what, "stamp=arrival in both lines, or unit=...")
