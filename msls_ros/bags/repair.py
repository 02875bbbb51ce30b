"""Finishes a bag that a killed recorder left, or that is damaged."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from tempfile import mkdtemp

from msls_ros.bags import metadata
from msls_ros.bags.definitions import Definition
from msls_ros.bags.errors import BagError
from msls_ros.bags.reader import BagReader
from msls_ros.bags.storage import Topic
from msls_ros.bags.writer import BagWriter, remove_bag


@dataclass(frozen=True)
class Repair:
    """What `repair` did.

    Attributes
    ----------
    changed : bool
        False: the bag was whole, and is as it was.
    messages : int
        In the bag now.
    warnings : tuple of str
        What was wrong, one sentence each.
    """

    changed: bool
    messages: int
    warnings: tuple[str, ...]


def repair(path: str | Path) -> Repair:
    """Rewrite an unfinished or damaged MCAP bag as a finished one with all that is readable.

    Parameters
    ----------
    path : path
        A bag directory, or a single .mcap file.

    Returns
    -------
    Repair
        What was found and done.

    Raises
    ------
    BagError
        Not an MCAP bag, or it cannot be written. The bag is then as it was.

    Notes
    -----
    The new bag is written beside the old one and replaces it in one step per file: a kill while repairing
    loses nothing.
    """
    target = Path(path)
    reader = BagReader(target)
    old = metadata.bag_files(target).paths
    if any(".mcap" not in file.suffixes for file in old):
        msg = f"{target}: only MCAP bags can be repaired; this is {old[0].name}"
        raise BagError(msg)
    try:
        name = target.stem if target.is_file() else target.resolve().name
        draft = Path(mkdtemp(prefix=f".{name}.repair-", dir=target.resolve().parent))
    except OSError as error:
        msg = f"{target}: cannot be repaired in its folder: {error.strerror or error}"
        raise BagError(msg) from error
    bag = draft / name
    try:
        count = _copy(reader, bag)
        if reader.warnings:
            _replace(target, old, bag)
    except OSError as error:
        msg = f"{target}: cannot be replaced: {error.strerror or error}"
        raise BagError(msg) from error
    finally:
        if bag.is_dir():
            remove_bag(bag)
        draft.rmdir()
    return Repair(bool(reader.warnings), count, tuple(reader.warnings))


def _copy(reader: BagReader, bag: Path) -> int:
    count = 0
    known: set[str] = set()
    with BagWriter(bag) as writer:
        for batch in reader.batches():
            for message in batch:
                if message.topic not in known:
                    known.add(message.topic)
                    topic = reader.describe(message.topic)
                    writer.add_topic(
                        topic.name, topic.msgtype, qos=reader.qos(topic.name), definition=_definition(reader, topic)
                    )
                writer.write(*message)
            count += len(batch)
        for silent in sorted(reader.topics.keys() - known):
            _announce(writer, reader, silent)
    return count


def _definition(reader: BagReader, topic: Topic) -> Definition:
    """Give the definition of a topic; an empty one where there is none: the messages are saved all the same."""
    try:
        return reader.definition(topic.name)
    except BagError:
        return Definition(topic.msgtype, "ros2msg", "", "")


def _announce(writer: BagWriter, reader: BagReader, name: str) -> None:
    topic = reader.describe(name)
    writer.add_topic(name, topic.msgtype, qos=reader.qos(topic.name), definition=_definition(reader, topic))


def _replace(target: Path, old: tuple[Path, ...], bag: Path) -> None:
    new = next(bag.glob("*.mcap"))
    if target.is_file():
        os.replace(new, target)
        return
    os.replace(new, target / new.name)
    os.replace(bag / metadata.NAME, target / metadata.NAME)
    for file in old:
        if file.name != new.name:
            file.unlink()
