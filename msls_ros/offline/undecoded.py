"""A topic of which an inspection could use nothing although the log has messages of it: how many, and why."""

from __future__ import annotations

from dataclasses import replace

from msls_ros.bags import AnyReader, BagError
from msls_ros.inputs.findings import Finding
from msls_ros.inputs.input_map import InputMap

_FIELD = "inputs.topics."


def explain_empty(finding: Finding, reader: AnyReader, inputs: InputMap) -> Finding:
    """Return a finding; if it says of a topic that it is empty, what there is where its messages cannot be decoded.

    Parameters
    ----------
    finding
        Any.
    reader
        Of the log.
    inputs
        Its map.
    """
    if finding.kind != "empty":
        return finding
    topic = inputs.topics[finding.where.removeprefix(_FIELD)].topic
    count, why = 0, ""
    own = reader.only([topic])
    for batch in own.batches():
        count += len(batch)
        try:
            if not why:
                own.decode(batch[0])
        except BagError as error:
            why = str(error)
    if not why:
        return finding
    what = f"{count:,} messages, none can be decoded: {why}"
    return replace(finding, kind="undecoded", what=what, change="record it again, or give the definition of its type")
