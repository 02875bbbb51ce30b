r"""Reads bags of every kind: rosbag2 (MCAP, sqlite3; directory or single file; compressed) and ROS 1.

::

    flight = BagReader("flight.bag", topics=["state", "effectors"])
    for message in flight:              # BagMessage: topic, msgtype, stamp_ns, data (CDR)
        state = flight.decode(message)  # or a SampleDecoder, five times as fast
    print(*flight.warnings, sep="\n")   # empty: nothing was damaged

Messages come in the order in which they were written, which is by log time up to the jitter of the
recorder: nothing is sorted, so memory stays at one chunk whatever the length of the bag.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

from msls_ros.bags.decoding import TypeDecoders
from msls_ros.bags.definitions import Definition
from msls_ros.bags.errors import BagError, one_line
from msls_ros.bags.limits import HELD
from msls_ros.bags.metadata import bag_files, profiles
from msls_ros.bags.open_storage import open_storage
from msls_ros.bags.storage import BagMessage, Scanner, Summary, Topic


class BagReader:
    """A bag to read, as often as wanted.

    Parameters
    ----------
    path : path
        A bag directory, or a .mcap, .db3 (also .zstd) or ROS 1 .bag file.
    topics : iterable of str, optional
        Only these; all by default.
    definition_paths : iterable of path
        Where to look for definitions that the bag does not hold, see `definitions`.
    held : int
        What a read may hold at a time [bytes]: a chunk, a message, or the copy of a compressed database. What is
        larger is left out, with a warning, and so is what a file unpacks to beyond a thousand times its size.

    Raises
    ------
    BagError
        Nothing there, or not a bag.

    Attributes
    ----------
    path : Path
        The bag.
    warnings : list of str
        Damage, one sentence for each file, complete when the file has been read; an iteration starts it anew.
    lost : bool
        Whether anything was written that the last iteration could not read; a file that is cut off has lost nothing.
    """

    def __init__(
        self,
        path: str | Path,
        topics: Iterable[str] | None = None,
        *,
        definition_paths: Iterable[str | Path] = (),
        held: int = HELD,
    ) -> None:
        self.path = Path(path)
        self._wanted = None if topics is None else frozenset(topics)
        self._definition_paths = tuple(definition_paths)
        self._held = held
        self.lost = False
        self._decoders = TypeDecoders(self._definition_paths)
        self._bag = bag_files(self.path)
        self._files: list[Path] = []
        self._topics: dict[str, Topic] = {}
        self._summaries: list[Summary | None] = []
        self._progress = 0.0
        self._unreadable: list[str] = []
        self._look()
        self.warnings: list[str] = self._opening_warnings()

    @property
    def topics(self) -> dict[str, str]:
        """Types by topic: all of a finished bag; of one without an index those of its first chunk, then those met."""
        return {name: topic.msgtype for name, topic in self._topics.items()}

    @property
    def summary(self) -> Summary | None:
        """Counts and times from the index; None where the bag has none."""
        whole = [summary for summary in self._summaries if summary is not None]
        if len(whole) != len(self._summaries):
            return None
        counts: dict[str, int] = {}
        for summary in whole:
            for topic, count in summary.counts.items():
                counts[topic] = counts.get(topic, 0) + count
        filled = [summary for summary in whole if any(summary.counts.values())]
        start = min((summary.start_ns for summary in filled), default=0)
        return Summary(counts, start, max((summary.end_ns for summary in filled), default=0))

    @property
    def progress(self) -> float:
        """Share of the bag that the iteration has read, 0 to 1."""
        return self._progress

    def __iter__(self) -> Iterator[BagMessage]:
        """Yield the messages from the start."""
        for batch in self.batches():
            yield from batch

    def batches(self) -> Iterator[list[BagMessage]]:
        """Yield the messages from the start, a chunk at a time: the fastest way.

        Yields
        ------
        list of BagMessage
            Not empty.
        """
        self.warnings[:] = self._opening_warnings()
        self._progress = 0.0
        self._decoders.refused.clear()
        self.lost = bool(self._unreadable)
        for number, path in enumerate(self._files):
            problems: list[str] = []
            with closing(open_storage(path, self._bag.message_compression, self._held)) as scanner:
                for batch in scanner.batches(self._is_wanted, problems.append):
                    self._learn(scanner)
                    self._progress = (number + scanner.progress()) / len(self._files)
                    converted = self._decoders.to_cdr(batch, self._topics, problems.append)
                    if converted:
                        yield converted
                self._learn(scanner)
                self.lost = self.lost or scanner.lost or bool(self._decoders.refused)
            if problems:
                self.warnings.append(one_line(f"{path}: {'; '.join(problems)}"))
        self._progress = 1.0
        for name in sorted((self._wanted or frozenset()) - self._topics.keys()):
            has = ", ".join(sorted(self._topics)) or "none"
            self.warnings.append(one_line(f"{self.path}: no topic {name}; it has {has}"))

    def only(self, topics: Iterable[str]) -> BagReader:
        """Give a reader of the same bag for some topics.

        Parameters
        ----------
        topics : iterable of str
            Their names.

        Returns
        -------
        BagReader
            On its own.
        """
        return BagReader(self.path, topics, definition_paths=self._definition_paths, held=self._held)

    def decode(self, message: BagMessage) -> Any:
        """Deserialise a message.

        Parameters
        ----------
        message : BagMessage
            Of this bag.

        Returns
        -------
        object
            A `rosbags` message: a dataclass with numpy arrays.

        Raises
        ------
        BagError
            No definition of its type, in the bag or elsewhere; or its bytes do not fit the type.
        """
        try:
            return self._decoders.decode(message, self._topics.get(message.topic))
        except BagError as error:
            msg = f"{self.path}: topic {message.topic}: {error}"
            raise BagError(msg) from error

    def decoded(self) -> Iterator[tuple[BagMessage, Any]]:
        """Yield every message with its deserialised form.

        Yields
        ------
        tuple of BagMessage and object
            As `__iter__` and `decode`.

        Raises
        ------
        BagError
            As `decode`.
        """
        for message in self:
            yield message, self.decode(message)

    def describe(self, topic: str) -> Topic:
        """Give what the bag says of a topic.

        Parameters
        ----------
        topic : str
            Name.

        Returns
        -------
        Topic
            Type, definition and offered QoS.

        Raises
        ------
        BagError
            There is no such topic, as far as the bag has been read.
        """
        if topic not in self._topics:
            msg = f"{self.path}: no topic {topic}; it has {', '.join(sorted(self._topics)) or 'none'}"
            raise BagError(msg)
        return self._topics[topic]

    def definition(self, topic: str) -> Definition:
        """Give the definition to write into another bag for the messages of a topic.

        Parameters
        ----------
        topic : str
            Name.

        Returns
        -------
        Definition
            For `BagWriter.add_topic`.

        Raises
        ------
        BagError
            There is no such topic, or no definition of its type.
        """
        described = self.describe(topic)
        try:
            return self._decoders.definition(described)
        except BagError as error:
            msg = f"{self.path}: topic {topic}: {error}"
            raise BagError(msg) from error

    def qos(self, topic: str) -> list[dict[str, Any]] | None:
        """Give the offered QoS profiles of a topic, to write into another bag.

        Parameters
        ----------
        topic : str
            Name.

        Returns
        -------
        list of dict or None
            None: not known.

        Raises
        ------
        BagError
            There is no such topic.
        """
        return profiles(self.describe(topic).qos)

    def _is_wanted(self, topic: str) -> bool:
        return self._wanted is None or topic in self._wanted

    def _opening_warnings(self) -> list[str]:
        return [one_line(warning) for warning in (*self._bag.warnings, *self._unreadable)]

    def _look(self) -> None:
        """Open every file once: for its topics, and to refuse what is no bag."""
        errors: list[BagError] = []
        for path in self._bag.paths:
            try:
                with closing(open_storage(path, self._bag.message_compression, self._held)) as scanner:
                    if not scanner.topics:
                        next(scanner.batches(lambda _: True, lambda _: None), None)
                    self._learn(scanner)
                    self._summaries.append(scanner.summary)
                self._files.append(path)
            except BagError as error:
                errors.append(error)
        if not self._files:
            raise errors[0]
        self._unreadable = [str(error) for error in errors]

    def _learn(self, scanner: Scanner) -> None:
        for topic in scanner.topics:
            if topic.name not in self._topics:
                self._topics[topic.name] = topic


def read(path: str | Path, topics: Iterable[str] | None = None) -> BagReader:
    """Open a bag to iterate over its messages; see `BagReader`.

    Parameters
    ----------
    path : path
        A bag directory, or a .mcap, .db3 (also .zstd) or ROS 1 .bag file.
    topics : iterable of str, optional
        Only these; all by default.

    Returns
    -------
    BagReader
        An iterable of `BagMessage`.

    Raises
    ------
    BagError
        Nothing there, or not a bag.
    """
    return BagReader(path, topics)
