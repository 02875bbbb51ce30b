"""Parameter files: find a shipped profile or the user's own, read it into a configuration, write one as a manual.

``python -m msls_ros.inputs.profiles`` writes the shipped profiles again, after a parameter was added or described anew.
"""

from __future__ import annotations

import os
import re
import textwrap
from collections.abc import Iterable, Iterator, Mapping
from copy import deepcopy
from functools import lru_cache
from pathlib import Path
from typing import Any

import yaml

from msls_ros.estimation import Configuration, EstimationError, from_mapping
from msls_ros.estimation.configuration import items
from msls_ros.estimation.errors import nearest
from msls_ros.estimation.sections import Bounds
from msls_ros.inputs import InputMap

WIDTH = 116
_WILD = {"**": r"(/[^/]+)*", "*": r"/[^/]+"}
"""Words of a section's name that stand for others, as regular expressions."""
OTHER = (
    *("autostart", "publish_every", "use_sim_time", "inputs"),
    *("frame_id", "queue", "lockstep", "model_file", "warm_start", "qos_overrides"),
)
"""Entries of a parameter file that are the node's, not of the `Configuration`."""


BESIDE_A_BAG = "identifier.yaml"
"""Name of the file, in a bag's folder, of the identifier's parameters in that flight."""
MODEL_BESIDE = "warm_start_model.yaml"
"""Name of the file beside it of the model that the flight began with, where there was one."""
RENAMED = {"f16_high_alpha": "f16", "f16_cruise": "f16", "A4_25hz": "A4", "c172x_25hz": "c172x"}
"""Shipped profiles as they were called while each condition and rate had one of its own."""


ADD_ATTITUDE = (
    "Better add what is missing of Phi and Theta to the states: a mapped attitude gives both; where bank is not "
    "measured and the wings stay level, states.Phi: 'ALIAS PATH scale=0', of any number there, takes it as zero"
)
"""What to do about velocities without an attitude among the states."""


def lacks_attitude(states: Iterable[str]) -> bool:
    """Return whether there are velocities among the states without the angles that gravity needs."""
    return bool({"u", "v", "w"} & set(states)) and not {"Phi", "Theta"} <= set(states)


def config_folder() -> Path:
    """Return the folder of the shipped parameter files, in the source tree or where the package is installed."""
    here = Path(__file__).resolve().parents[2] / "config"
    candidates = [
        here,
        *(Path(p) / "share/msls_ros/config" for p in os.environ.get("AMENT_PREFIX_PATH", "").split(":") if p),
    ]
    for candidate in candidates:
        if candidate.is_dir() and any(candidate.glob("*.yaml")):
            return candidate
    message = f"the shipped parameter files are nowhere: looked in {', '.join(map(str, candidates))}"
    raise EstimationError(message)


def read_profile(name: str | os.PathLike[str]) -> Configuration:
    """Read the identifier's parameters from a parameter file.

    Parameters
    ----------
    name
        A shipped profile's name (``f16``) or the path of a YAML file of ROS parameters.

    Raises
    ------
    EstimationError
        For a file that is missing or wrong; the sentence names the file.
    """
    path, section = _load(name)
    return _configuration(section, f"parameter file '{path}'")


def _configuration(section: Mapping[str, Any], name: str) -> Configuration:
    try:
        return from_mapping({k: v for k, v in section.items() if k not in OTHER})
    except EstimationError as error:
        states = section.get("states")
        advice = ""
        if isinstance(states, list) and section.get("known_gravity", True) is True and lacks_attitude(states):
            advice = f". {ADD_ATTITUDE}"
        message = f"{name}: {error}{advice}"
        raise EstimationError(message) from error


def read_inputs(name: str | os.PathLike[str]) -> InputMap | None:
    """Read the section ``inputs`` of a parameter file: where other message types have states and deflections.

    Parameters
    ----------
    name
        As `read_profile` takes it.

    Returns
    -------
    InputMap or None
        None where the file has no such section: the inputs are ``msls_msgs`` on the topics of the identifier.

    Raises
    ------
    EstimationError
        As `read_profile`.
    """
    path, section = _load(name)
    entries = section.get("inputs")
    if entries is None:
        return None
    try:
        if not isinstance(entries, Mapping):
            message = f"'inputs' is {entries!r}; it must be a section of its own"
            raise EstimationError(message)
        return InputMap.from_parameters(entries)
    except EstimationError as error:
        message = f"parameter file '{path}': {error}"
        raise EstimationError(message) from error


def read_warm_start(name: str | os.PathLike[str]) -> Path | None:
    """Return the saved model that the identifier of a parameter file starts from, there or not; None: it has none.

    Beside parameters that were kept with a bag it is the copy that was kept with them: the file that they name may hold
    the model of a later flight by now.

    Parameters
    ----------
    name
        As `read_profile` takes it.

    Raises
    ------
    EstimationError
        As `read_profile`.
    """
    path, section = _load(name)
    model = warm_start_of(section, f"parameter file '{path}'")
    beside = path.with_name(MODEL_BESIDE)
    return beside if model is not None and path.name == BESIDE_A_BAG and beside.is_file() else model


def warm_start_of(section: Mapping[str, Any], name: str) -> Path | None:
    """Take ``warm_start`` of parameters as they stand below ``ros__parameters``.

    Raises
    ------
    EstimationError
        If it is no text.
    """
    found = section.get("warm_start", "")
    if not isinstance(found, str):
        message = f"{name}: warm_start is {found!r}; expected the path of a file that ~/save_model has written"
        raise EstimationError(message)
    return Path(found) if found else None


def read_parameters(text: str, name: str) -> tuple[Configuration, InputMap | None]:
    """Read the text of a parameter file: the identifier's parameters, and its section ``inputs``.

    Parameters
    ----------
    text
        YAML of ROS parameters.
    name
        For sentences.

    Raises
    ------
    EstimationError
        As `read_profile`.
    """
    return parameters_of(_section_of(text, name), name)


def parameters_of(section: Mapping[str, Any], name: str) -> tuple[Configuration, InputMap | None]:
    """Take parameters as they stand below ``ros__parameters``; as `read_parameters`."""
    try:
        inputs = InputMap.from_parameters(section["inputs"]) if "inputs" in section else None
    except EstimationError as error:
        message = f"{name}: {error}"
        raise EstimationError(message) from error
    return _configuration(section, name), inputs


def profile_path(name: str | os.PathLike[str]) -> Path:
    """Return the path of a parameter file.

    Parameters
    ----------
    name
        As `read_profile` takes it.

    Raises
    ------
    EstimationError
        For a name that is not shipped.
    """
    path = Path(name)
    if path.suffix in (".yaml", ".yml"):
        return path
    folder = config_folder()
    shipped = {p.stem: p for p in sorted([*folder.glob("*.yaml"), *folder.glob("inputs/*.yaml")])}
    name = RENAMED.get(str(name), name)
    if str(name) not in shipped:
        message = f"parameter file '{name}' does not exist; shipped are {', '.join(shipped)}, or give a .yaml file"
        message += nearest(str(name), shipped)
        raise EstimationError(message)
    return shipped[str(name)]


def _load(name: str | os.PathLike[str]) -> tuple[Path, Mapping[str, Any]]:
    """Find a parameter file and return the identifier's section of it."""
    path = profile_path(name)
    name = f"parameter file '{path}'"
    try:
        return path, _section_of(path.read_text(encoding="utf-8"), name)
    except OSError as error:
        message = f"{name} cannot be read: {error.strerror}"
        raise EstimationError(message) from error
    except UnicodeDecodeError as error:
        message = f"{name} is not YAML: {' '.join(str(error).split())}"
        raise EstimationError(message) from error


@lru_cache(maxsize=8)
def _parse(text: str) -> Any:
    """Return what YAML holds; a profile takes 30 ms, and every scenario and node reads one."""
    return yaml.safe_load(text)


def _section_of(text: str, name: str) -> Mapping[str, Any]:
    """Return the identifier's section of a parameter file's text."""
    try:
        content = deepcopy(_parse(text))
    except yaml.YAMLError as error:
        message = f"{name} is not YAML: {' '.join(str(error).split())}"
        raise EstimationError(message) from error
    if isinstance(content, Mapping):
        sections = dict(_sections(content))
        for node in ("identifier", "/identifier", "/**"):
            if node in sections:
                return sections[node]
    message = f"{name}: has no section '/**: ros__parameters:' or 'identifier: ros__parameters:'"
    raise EstimationError(message)


def _sections(content: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield the sections of a parameter file: the name of their nodes and what is below ``ros__parameters``."""
    for name, below in content.items():
        if not isinstance(below, Mapping):
            continue
        full = f"{prefix}/{str(name).lstrip('/')}" if prefix else str(name)
        if isinstance(below.get("ros__parameters"), Mapping):
            yield full, below["ros__parameters"]
        yield from _sections({k: v for k, v in below.items() if k != "ros__parameters"}, full)


def matches_node(path: str | os.PathLike[str], node: str) -> bool:
    """Whether a parameter file that ROS can read has a section for a node.

    Parameters
    ----------
    path
        Of the file.
    node
        Fully qualified name, as ``/left/identifier``. In the file ``*`` stands for one word of it, ``**`` for any
        number of them.
    """
    content = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    for name, _ in _sections(content if isinstance(content, Mapping) else {}):
        words = [_WILD.get(word, "/" + re.escape(word)) for word in name.split("/") if word]
        if re.fullmatch("".join(words), node):
            return True
    return False


def render_parameters(
    configuration: Configuration, inputs: Mapping[str, Any], title: str, warm_start: Path | None = None
) -> str:
    """Write a configuration, and the entries of the section ``inputs`` by their dotted names, as a parameter file.

    Parameters
    ----------
    configuration, inputs
        What to write.
    title
        First lines of the file, without ``#``.
    warm_start
        The saved model that the identifier starts from; None: there is none.
    """
    text = render_profile(configuration, title)
    if warm_start is not None:
        entry = yaml.safe_dump({"warm_start": str(warm_start)}, width=1000, allow_unicode=True)
        text += "\n" + textwrap.indent(entry, "    ")
    nested: dict[str, Any] = {}
    for name, value in inputs.items():
        *groups, leaf = name.split(".", 1)
        below = nested
        for group in groups:
            below = below.setdefault(group, {})
        below[leaf] = value
    section = yaml.safe_dump({"inputs": nested}, sort_keys=False, width=1000, allow_unicode=True) if nested else ""
    return text + ("\n" + textwrap.indent(section, "    ") if section else "")


def render_profile(configuration: Configuration, title: str) -> str:
    """Write a configuration as a parameter file with every parameter's meaning, unit and range: the manual.

    Parameters
    ----------
    configuration
        What to write.
    title
        First lines of the file, without ``#``.
    """
    lines = [f"# {line}".rstrip() for line in title.strip().splitlines()]
    lines += ["", "/**:", "  ros__parameters:"]
    section = ""
    for name, value, bounds in items(configuration):
        head, _, leaf = name.rpartition(".")
        indent = "      " if head else "    "
        if head != section:
            section = head
            lines += ["", f"    {head}:"]
        lines += textwrap.wrap(
            _about(bounds, value), WIDTH, initial_indent=f"{indent}# ", subsequent_indent=f"{indent}#   "
        )
        lines.append(f"{indent}{leaf}: {_yaml(value)}")
    return "\n".join(lines) + "\n"


def _about(bounds: Bounds, value: Any) -> str:
    text = bounds.description
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if number or (isinstance(value, tuple) and not any(isinstance(v, str) for v in value)):
        text += f" [{bounds.unit}], {bounds.low:g} to {bounds.high:g}"
    return text if bounds.in_flight else f"{text} (fixed at the start)"


def _yaml(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, tuple):
        return "[" + ", ".join(_yaml(v) for v in value) + "]"
    if isinstance(value, str):
        plain = value and value not in ("1", "off", "on", "yes", "no") and ":" not in value
        return value if plain else f'"{value}"'
    if isinstance(value, float):
        text = repr(value)
        return text.replace("e", ".0e") if "e" in text and "." not in text else text
    return repr(value)


def refresh() -> None:
    """Write every shipped profile again: its values and title as they are, the manual as it is now."""
    for path in sorted(config_folder().glob("*.yaml")):
        head = path.read_text(encoding="utf-8").split("\n\n/**:")[0]
        title = "\n".join(line[2:] for line in head.splitlines())
        path.write_text(render_profile(read_profile(path), title), encoding="utf-8")


if __name__ == "__main__":
    refresh()
