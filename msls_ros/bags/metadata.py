"""`metadata.yaml` of a rosbag2 bag directory: written for version 9, read for every version."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from functools import lru_cache
from io import StringIO
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from msls_ros.bags.errors import BagError
from msls_ros.bags.small_yaml import YamlError, load

NAME = "metadata.yaml"
VERSION = 9
_MAX_METADATA, _MAX_PROFILES = 1 << 20, 1 << 16
_FOREVER = {"sec": 9223372036, "nsec": 854775807}


EXPECTED = "a bag directory, or a .mcap, .db3, .bag, .ulg or .bin file"
"""What can be read, for sentences."""


@dataclass(frozen=True)
class Qos:
    """Quality of service that the publisher of a topic offered.

    Attributes
    ----------
    depth : int
        Length of the queue (history: keep last).
    reliable : bool
        Reliable, else best effort.
    transient_local : bool
        A late subscriber gets the last messages, else volatile.
    """

    depth: int = 10
    reliable: bool = True
    transient_local: bool = False

    def profile(self) -> dict[str, Any]:
        """Give the mapping that rosbag2 version 9 stores.

        Returns
        -------
        dict
            Keys and words of `rmw_qos_profile_t`.
        """
        return {
            "history": "keep_last",
            "depth": self.depth,
            "reliability": "reliable" if self.reliable else "best_effort",
            "durability": "transient_local" if self.transient_local else "volatile",
            "deadline": dict(_FOREVER),
            "lifespan": dict(_FOREVER),
            "liveliness": "automatic",
            "liveliness_lease_duration": dict(_FOREVER),
            "avoid_ros_namespace_conventions": False,
        }


@dataclass
class TopicEntry:
    """One topic of a bag that is being written.

    Attributes
    ----------
    topic, msgtype, type_hash : str
        Name, type and hash of the type.
    qos_profiles : list of dict
        What publishers offered.
    count : int
        Messages so far.
    """

    topic: str
    msgtype: str
    type_hash: str
    qos_profiles: list[dict[str, Any]]
    count: int = 0


def dump(value: Any) -> str:
    """Write a value as block YAML.

    Parameters
    ----------
    value : object
        Mappings, lists and scalars.

    Returns
    -------
    str
        YAML without a final newline.
    """
    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = False
    yaml.width = 4096
    yaml.representer.ignore_aliases = lambda *_: True
    stream = StringIO()
    yaml.dump(value, stream)
    return stream.getvalue().strip()


def profiles(text: str) -> list[dict[str, Any]] | None:
    """Read the QoS profiles that a bag stores for a topic.

    Parameters
    ----------
    text : str
        YAML.

    Returns
    -------
    list of dict or None
        None: there are none, or they are damaged.
    """
    found = _profiles(text)
    return None if found is None else [dict(profile) for profile in found]


@lru_cache(maxsize=256)
def _profiles(text: str) -> list[dict[str, Any]] | None:
    try:
        found = load(text, _MAX_PROFILES)
    except YamlError:
        return None
    return found if isinstance(found, list) and all(isinstance(profile, dict) for profile in found) else None


def information(file_name: str, topics: Iterable[TopicEntry], start_ns: int, end_ns: int) -> dict[str, Any]:
    """Build what stands under `rosbag2_bagfile_information`.

    Parameters
    ----------
    file_name : str
        The one storage file of the bag.
    topics : iterable of TopicEntry
        Topics and counts.
    start_ns, end_ns : int
        First and last log time [ns].

    Returns
    -------
    dict
        For `dump`.
    """
    entries = list(topics)
    count = sum(entry.count for entry in entries)
    span = {
        "starting_time": {"nanoseconds_since_epoch": start_ns},
        "duration": {"nanoseconds": end_ns - start_ns},
        "message_count": count,
    }
    return {
        "version": VERSION,
        "storage_identifier": "mcap",
        **span,
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": entry.topic,
                    "type": entry.msgtype,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": entry.qos_profiles,
                    "type_description_hash": entry.type_hash,
                },
                "message_count": entry.count,
            }
            for entry in entries
        ],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file_name],
        "files": [{"path": file_name, **span}],
        "custom_data": None,
        "ros_distro": "jazzy",
    }


@dataclass(frozen=True)
class BagFiles:
    """The storage files of a bag, in the order to read them.

    Attributes
    ----------
    paths : tuple of Path
        Files that exist.
    message_compression : bool
        Every message is compressed on its own (zstd).
    warnings : tuple of str
        What was wrong with the metadata.
    """

    paths: tuple[Path, ...]
    message_compression: bool
    warnings: tuple[str, ...]


def bag_files(path: Path) -> BagFiles:
    """Find the storage files of a bag.

    Parameters
    ----------
    path : Path
        A bag directory, or one storage file.

    Returns
    -------
    BagFiles
        Without readable metadata all storage files of the directory, in the order of their numbers.

    Raises
    ------
    BagError
        Nothing there, or nothing that could be a bag.
    """
    if is_file(path):
        info, _ = _load(path.parent / NAME)
        listed = path.name in _listed(info)
        return BagFiles((path,), listed and _by_message(info), ())
    if not os.path.isdir(path):
        found = "not a file or directory" if os.path.lexists(path) else "no such file or directory"
        msg = f"{path}: {found}; expected {EXPECTED}{_near(path)}"
        raise BagError(msg)
    info, problem = _load(path / NAME)
    warnings = [problem] if problem else []
    files = [path / name for name in _listed(info)]
    missing = [file.name[:100] for file in files if not is_file(file)]
    if missing:
        more = f" and {len(missing) - 3} more" if len(missing) > 3 else ""
        warnings.append(f"{path / NAME}: lists {', '.join(missing[:3])}{more}, which is not there")
        files = [file for file in files if is_file(file)]
    if not files:
        pattern = re.compile(r"\.(mcap|db3|bag)(\.zstd)?$")
        try:
            found_here = [file for file in path.iterdir() if pattern.search(file.name) and is_file(file)]
        except OSError as error:
            msg = f"{path}: cannot be read: {error.strerror or error}"
            raise BagError(msg) from error
        files = sorted(found_here, key=_natural)
    if not files:
        msg = f"{path}: no bag in this directory; expected {NAME} with a .mcap or .db3 file"
        raise BagError(msg)
    return BagFiles(tuple(files), _by_message(info), tuple(warnings))


def _load(path: Path) -> tuple[Mapping[str, Any], str]:
    """Give the information mapping and what was wrong with it."""
    if not is_file(path):
        return {}, f"{path}: missing; the storage files of the directory are read without it"
    problem = ""
    try:
        with path.open(encoding="utf-8") as stream:
            found = load(stream.read(_MAX_METADATA + 1), _MAX_METADATA)
    except (YamlError, OSError, ValueError) as error:
        found, problem = None, f" ({error})"
    info = found.get("rosbag2_bagfile_information") if isinstance(found, dict) else None
    if not isinstance(info, dict):
        return {}, f"{path}: damaged{problem}; expected the YAML mapping rosbag2_bagfile_information"
    return info, ""


def is_file(path: Path) -> bool:
    """Whether there is a plain file, which can be opened without waiting.

    Parameters
    ----------
    path : Path
        Any.

    Returns
    -------
    bool
        False also where it cannot be known.
    """
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def _near(path: Path) -> str:
    """Return the end of a sentence that suggests what was probably meant, of the same folder."""
    try:
        found = get_close_matches(path.name, os.listdir(path.parent), 1, 0.6)
    except OSError:
        return ""
    return f"; did you mean '{path.parent / found[0]}'?" if found else ""


def _listed(info: Mapping[str, Any]) -> list[str]:
    """Names of the storage files; old versions list them with their directory."""
    names = info.get("relative_file_paths")
    if not isinstance(names, list):
        return []
    return list(dict.fromkeys(Path(name).name for name in names if isinstance(name, str) and Path(name).name))


def _by_message(info: Mapping[str, Any]) -> bool:
    return str(info.get("compression_mode") or "").lower() == "message"


def _natural(path: Path) -> list[tuple[int, str]]:
    """Order `bag_2` before `bag_10`."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", path.name)]
