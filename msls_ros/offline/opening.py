"""Which parameters a log is read with: those given, those kept beside it, or a map made from its own topics."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from msls_ros.bags import AnyReader, BagError
from msls_ros.estimation import Configuration
from msls_ros.inputs import InputMap
from msls_ros.inputs.profiles import profile_path, read_inputs, read_parameters, read_profile, read_warm_start
from msls_ros.offline.replay import kept_parameters
from msls_ros.offline.sources import STATE, InputTopics, find_topics
from msls_ros.offline.suggestion import suggest


@dataclass(frozen=True)
class Chosen:
    """How a log is read."""

    configuration: Configuration
    inputs: InputMap | InputTopics
    source: str
    """Where this is from, in words."""
    parameters: Path | str
    """The file, or the text of a map that was made."""
    warm_start: Path | None = None
    """The saved model to start from; None: from nothing."""


def chosen_parameters(reader: AnyReader, params: str | None, namespace: str | None = None) -> Chosen:
    """Return how a log is read.

    Parameters
    ----------
    reader
        Of the log.
    params
        A parameter file or the name of a shipped one; None: what is kept beside the log, otherwise a map of its topics.
    namespace
        The aircraft, where the log has several.

    Raises
    ------
    BagError
        If the log's topics give no map.
    EstimationError
        If the parameters are wrong.
    """
    if params is not None:
        return _of_file(reader, profile_path(params), f"parameters {params}", namespace)
    own = any(kind == STATE for kind in reader.topics.values())
    try:
        kept = kept_parameters(reader.path)
    except BagError:
        if not own:
            text = suggest(reader)
            configuration, inputs = read_parameters(text, f"{reader.path}: the suggested map")
            assert inputs is not None
            return Chosen(configuration, inputs, "a map made from the log's own topics (inspect --suggest)", text)
        raise
    return _of_file(reader, kept, f"parameters {kept}", namespace)


def _of_file(reader: AnyReader, file: Path, source: str, namespace: str | None) -> Chosen:
    configuration, warm_start = read_profile(file), read_warm_start(file)
    inputs = read_inputs(file)
    if inputs is None:
        found = find_topics(reader.path, reader.topics, namespace)
        return Chosen(configuration, found, source, file, warm_start)
    return Chosen(configuration, _resolved(inputs, reader.topics, namespace), source, file, warm_start)


def _resolved(inputs: InputMap, topics: Iterable[str], namespace: str | None) -> InputMap:
    """Return a map with relative names of topics in the namespace, as the node resolves them; those of logs stay."""
    prefix = "/".join(["", *filter(None, (namespace or "").split("/")), ""])
    moved = {
        alias: source if source.topic in topics else replace(source, topic=prefix + source.topic)
        for alias, source in inputs.topics.items()
        if source.topic[:1] not in ("/", "~")
    }
    return replace(inputs, topics={**inputs.topics, **moved})
