"""All checks of a log's record against its map and configuration, the worst finding first."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from msls_ros.estimation import Configuration
from msls_ros.estimation.errors import nearest
from msls_ros.inputs.check_effectors import check_effectors, check_sizes
from msls_ros.inputs.check_motion import check_motion
from msls_ros.inputs.check_response import check_derivatives, check_response
from msls_ros.inputs.check_timing import check_clocks, check_fields, check_rates
from msls_ros.inputs.field_paths import listed
from msls_ros.inputs.findings import DOUBTFUL, WRONG, Finding, ordered
from msls_ros.inputs.input_map import InputMap
from msls_ros.inputs.profiles import ADD_ATTITUDE, lacks_attitude
from msls_ros.inputs.series import Record


def check_topics(inputs: InputMap, topics: Mapping[str, str]) -> Iterator[Finding]:
    """Yield topics of a map that a log does not have, or has with another type."""
    for alias, topic in inputs.topics.items():
        where, found = f"inputs.topics.{alias}", topics.get(topic.topic)
        if found is None:
            same = [name for name, kind in topics.items() if kind == topic.msgtype]
            near = nearest(topic.topic, topics) or (f"; of its type there is {listed(same)}" if same else "")
            what = f"no topic {topic.topic} ({topic.msgtype}) in this log{near}"
            yield Finding(WRONG, "topic", where, what, f"write one that exists: {listed(sorted(topics))}")
        elif found != topic.msgtype:
            what = f"topic {topic.topic} has type {found}; the map expects {topic.msgtype}"
            yield Finding(WRONG, "type", where, what, f"write the type {found}, and its fields below")


def check_gravity(configuration: Configuration) -> Iterator[Finding]:
    """Yield that gravity is identified as effects of the states, for want of an angle among them."""
    if not configuration.known_gravity and lacks_attitude(configuration.states):
        what = "false: gravity and the turning of the axes are learnt as effects of the states, which they are not"
        yield Finding(DOUBTFUL, "gravity", "known_gravity", what, f"true. {ADD_ATTITUDE}")


def findings_of(record: Record, configuration: Configuration) -> list[Finding]:
    """Return what the checks find, the worst first.

    Parameters
    ----------
    record
        What was read of the log.
    configuration
        Of the identifier that is to use it.
    """
    found = [*check_fields(record), *check_rates(record, configuration), *check_clocks(record)]
    found += check_gravity(configuration)
    if any(f.kind == "clocks" for f in found):
        return ordered(found)
    sizes = list(check_sizes(record, configuration.reference_speed))
    found += [*check_effectors(record, configuration.effectors_of_thrust), *sizes, *check_derivatives(record)]
    motion = list(check_motion(record, configuration.reference_speed))
    found += motion
    if not any(f.level == WRONG for f in (*motion, *sizes)):
        found += check_response(record, configuration)
    return ordered(found)
