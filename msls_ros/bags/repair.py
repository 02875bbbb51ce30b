"""Finishes a bag that a killed recorder left, or that is damaged; what was there stays beside it."""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass
from itertools import count as count_from
from pathlib import Path
from tempfile import mkdtemp

from msls_ros.bags import metadata
from msls_ros.bags.definitions import Definition
from msls_ros.bags.errors import BagError
from msls_ros.bags.reader import BagReader
from msls_ros.bags.storage import Topic
from msls_ros.bags.writer import LAST_STAMP, BagWriter, remove_bag


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
    lost : bool
        Something was written that could not be read, and is not in the bag now.
    originals : tuple of Path
        The files as they were, beside the bag's.
    """

    changed: bool
    messages: int
    warnings: tuple[str, ...]
    lost: bool
    originals: tuple[Path, ...]


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
    loses nothing. The old files stay as `NAME.mcap.original`; nothing here ever deletes or replaces one of them.
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
    originals: list[Path] = []
    try:
        count, dropped = _copy(reader, bag)
        warnings = [*reader.warnings, *_dropped(target, dropped)]
        if warnings:
            _replace(target, old, bag, originals)
    except OSError as error:
        msg = f"{target}: cannot be replaced: {error.strerror or error}"
        raise BagError(msg) from error
    finally:
        if bag.is_dir():
            remove_bag(bag)
        draft.rmdir()
    return Repair(bool(warnings), count, tuple(warnings), reader.lost or dropped > 0, tuple(originals))


def _dropped(target: Path, dropped: int) -> list[str]:
    if not dropped:
        return []
    return [f"{target}: {dropped} messages left out, with a log time beyond 2^63 - 1 or of a second type on a topic"]


def _copy(reader: BagReader, bag: Path) -> tuple[int, int]:
    """Copy what can be read; give how many messages were written, and how many no bag can hold."""
    count = dropped = 0
    known: dict[str, str] = {}
    with BagWriter(bag) as writer:
        for batch in reader.batches():
            for message in batch:
                if message.topic not in known:
                    known[message.topic] = reader.describe(message.topic).msgtype
                    _announce(writer, reader, message.topic)
                if message.stamp_ns > LAST_STAMP or message.msgtype != known[message.topic]:
                    dropped += 1
                    continue
                writer.write(*message)
                count += 1
        for silent in sorted(reader.topics.keys() - known.keys()):
            _announce(writer, reader, silent)
    return count, dropped


def _definition(reader: BagReader, topic: Topic) -> Definition:
    """Give the definition of a topic; an empty one where there is none: the messages are saved all the same."""
    try:
        return reader.definition(topic.name)
    except BagError:
        return Definition(topic.msgtype, "ros2msg", "", "")


def _announce(writer: BagWriter, reader: BagReader, name: str) -> None:
    topic = reader.describe(name)
    writer.add_topic(name, topic.msgtype, qos=reader.qos(topic.name), definition=_definition(reader, topic))


def _replace(target: Path, old: tuple[Path, ...], bag: Path, originals: list[Path]) -> None:
    """Put the new files in the place of the old ones, of which each keeps a name of its own."""
    new = next(bag.glob("*.mcap"))
    if target.is_file():
        originals.append(_keep(target))
        os.replace(new, target)
        return
    described = target / metadata.NAME
    originals += [_keep(file) for file in (*old, described) if file.is_file()]
    os.replace(new, target / new.name)
    os.replace(bag / metadata.NAME, described)
    for file in old:
        if file.name != new.name:
            file.unlink()


def _keep(file: Path) -> Path:
    """Give a file a second name, which no file has, and return it."""
    for number in count_from(1):
        kept = file.with_name(f"{file.name}.original{'' if number == 1 else number}")
        try:
            os.link(file, kept)
        except FileExistsError:
            continue
        except OSError:  # a file system without links
            if kept.exists():
                continue
            shutil.copyfile(file, kept)
        return kept
    raise AssertionError
