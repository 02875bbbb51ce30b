"""A topic of which an inspection could use nothing although the log has messages of it: how many, and why."""

from __future__ import annotations

from dataclasses import replace

from msls_ros.bags import AnyReader, BagError
from msls_ros.inputs.findings import Finding
from msls_ros.inputs.input_map import InputMap
from msls_ros.offline.inspection import Inspection

_FIELD = "inputs.topics."


def explained(found: Inspection, reader: AnyReader, inputs: object) -> Inspection:
    """Return an inspection that says of messages which cannot be decoded that they are there.

    Parameters
    ----------
    found
        The inspection.
    reader
        Of the log.
    inputs
        Its map; an inspection of any other source is left as it is.
    """
    if not isinstance(inputs, InputMap) or all(one.kind != "empty" for one in found.findings):
        return found
    findings = [_explained(one, reader, inputs) if one.kind == "empty" else one for one in found.findings]
    return replace(found, findings=findings)


def _explained(finding: Finding, reader: AnyReader, inputs: InputMap) -> Finding:
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
