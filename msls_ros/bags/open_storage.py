"""From a file to the scanner of its format; the first bytes say which."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import BinaryIO, cast

import zstandard

from msls_ros.bags.errors import BagError
from msls_ros.bags.limits import HELD, PIECE, CountedStream, Expansion, TooLargeError, check_held
from msls_ros.bags.mcap_scan import MAGIC as MCAP_MAGIC
from msls_ros.bags.mcap_scan import McapScanner
from msls_ros.bags.ros1_scan import MAGIC as ROS1_MAGIC
from msls_ros.bags.ros1_scan import Ros1Scanner
from msls_ros.bags.sqlite_scan import MAGIC as SQLITE_MAGIC
from msls_ros.bags.sqlite_scan import SqliteScanner
from msls_ros.bags.storage import BagMessage, Scanner, Summary, Topic

_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"


def open_storage(path: Path, message_compression: bool, held: int = HELD) -> Scanner:
    """Open one storage file.

    Parameters
    ----------
    path : Path
        The file.
    message_compression : bool
        Its messages are compressed one by one (zstd).
    held : int
        What may be held at a time, and unpacked into the temporary folder [bytes].

    Returns
    -------
    Scanner
        To be closed by the caller.

    Raises
    ------
    BagError
        Not a file that can be read, or not of a known format.
    """
    scanner = _open(path, held)
    return _PerMessage(scanner, path.stat().st_size, held) if message_compression else scanner


def _open(path: Path, held: int) -> Scanner:
    try:
        if not path.is_file():
            msg = f"{path}: not a file; expected an MCAP, sqlite3 or ROS 1 bag file"
            raise BagError(msg)
        stream: BinaryIO = path.open("rb")
        head = stream.read(len(SQLITE_MAGIC))
        stream.seek(0)
        size = os.fstat(stream.fileno()).st_size
    except OSError as error:
        msg = f"{path}: cannot be read: {error.strerror or error}"
        raise BagError(msg) from error
    try:
        if head.startswith(MCAP_MAGIC):
            return McapScanner(path, stream, size, held)
        if head.startswith(ROS1_MAGIC):
            return Ros1Scanner(path, stream, size, held)
        if head.startswith(_ZSTD_MAGIC):
            return _open_compressed(path, stream, size, held)
    except BaseException:
        stream.close()
        raise
    if head.startswith(SQLITE_MAGIC):
        return _open_sqlite(path, stream, size, held)
    stream.close()
    found = "it is empty" if not head else f"it starts with {head[:8]!r}"
    msg = f"{path}: not a bag; expected an MCAP, sqlite3 or ROS 1 bag file, {found}"
    raise BagError(msg)


def _open_sqlite(path: Path, stream: BinaryIO, size: int, held: int) -> Scanner:
    """Open a database; of one cut off in a page a copy of the whole pages, for sqlite fills up with zeros."""
    head = stream.read(18)
    page = int.from_bytes(head[16:18], "big")
    page = 65536 if page == 1 else page
    if page < 512 or size % page == 0:
        stream.close()
        return SqliteScanner(path, held=held)
    stream.seek(0)
    return _Unpacked(path, stream, held, size - size % page, f"cut off at byte {size}")


def _open_compressed(path: Path, stream: BinaryIO, size: int, held: int) -> Scanner:
    """Open a file that is compressed as a whole; MCAP as a stream, sqlite3 from a temporary copy."""
    try:
        inner = _decompressor(stream)
        head = inner.read(len(SQLITE_MAGIC))
        stream.seek(0)
        if head.startswith(MCAP_MAGIC):
            return McapScanner(path, CountedStream(_decompressor(stream), Expansion(size, held)), None, held)
        if head.startswith(SQLITE_MAGIC):
            return _Unpacked(path, _decompressor(stream), held)
    except zstandard.ZstdError as error:
        msg = f"{path}: cannot be decompressed: {error}"
        raise BagError(msg) from error
    msg = f"{path}: not a bag; expected an MCAP or sqlite3 file inside the zstd compression"
    raise BagError(msg)


def _decompressor(stream: BinaryIO) -> BinaryIO:
    reader = zstandard.ZstdDecompressor().stream_reader(stream, read_across_frames=True)
    return cast("BinaryIO", reader)


class _Unpacked(SqliteScanner):
    """A copy of a sqlite3 file, decompressed or cut to length, until it is closed."""

    def __init__(self, path: Path, source: BinaryIO, held: int, length: int | None = None, damage: str = "") -> None:
        self._folder = TemporaryDirectory(prefix="msls_bag_")
        copy = Path(self._folder.name) / "bag.db3"
        self._damage = damage
        try:
            with source, copy.open("wb") as target:
                try:
                    _copy(source, target, held, length)
                except zstandard.ZstdError as error:
                    self._damage = f"its compression is damaged ({error})"
                target.truncate(length)
            super().__init__(copy, path, held=held)
        except TooLargeError as error:
            self._folder.cleanup()
            msg = f"{path}: {error}; unpack it with `zstd -d`, or allow more"
            raise BagError(msg) from error
        except OSError as error:
            self._folder.cleanup()
            msg = f"{path}: cannot be unpacked into {copy.parent}: {error.strerror or error}"
            raise BagError(msg) from error
        except BagError:
            self._folder.cleanup()
            raise

    def batches(self, wanted: Callable[[str], bool], warn: Callable[[str], None]) -> Iterator[list[BagMessage]]:
        if self._damage:
            warn(self._damage)
        yield from super().batches(wanted, warn)
        self.lost = self.lost or bool(self._damage)

    def close(self) -> None:
        super().close()
        self._folder.cleanup()


def _copy(source: BinaryIO, target: BinaryIO, held: int, length: int | None) -> None:
    """Copy so many bytes; where None, to the end, but no more than the temporary folder is to hold."""
    copied = 0
    most = held + 1 if length is None else length
    while piece := source.read(min(PIECE, most - copied)):
        copied += len(piece)
        if length is None:
            check_held("a database", copied, held)
        target.write(piece)


class _PerMessage:
    """Decompresses the messages of another scanner."""

    def __init__(self, scanner: Scanner, size: int, held: int) -> None:
        self._scanner = scanner
        self._held = held
        self._expansion = Expansion(size, held)
        self._damaged = 0
        self._first_damage = ""

    @property
    def topics(self) -> list[Topic]:
        return self._scanner.topics

    @property
    def summary(self) -> Summary | None:
        return self._scanner.summary

    @property
    def lost(self) -> bool:
        return bool(self._damaged) or self._scanner.lost

    def progress(self) -> float:
        return self._scanner.progress()

    def close(self) -> None:
        self._scanner.close()

    def batches(self, wanted: Callable[[str], bool], warn: Callable[[str], None]) -> Iterator[list[BagMessage]]:
        for batch in self._scanner.batches(wanted, warn):
            whole: list[BagMessage] = []
            size = 0
            for message in batch:
                try:
                    whole.append(message._replace(data=self._expand(message.data)))
                except (zstandard.ZstdError, TooLargeError, MemoryError) as error:
                    self._damaged += 1
                    self._first_damage = self._first_damage or str(error)
                    continue
                size += len(whole[-1].data)
                if size > PIECE:
                    yield whole
                    whole, size = [], 0
            if whole:
                yield whole
        if self._damaged:
            warn(f"{self._damaged} messages that cannot be decompressed were skipped ({self._first_damage})")

    def _expand(self, data: bytes) -> bytes:
        """Decompress one frame, no further than the budget and the size it declares."""
        declared = zstandard.frame_content_size(data)
        check_held("a message", max(declared, 0), self._held)
        most = declared if declared >= 0 else self._held
        with zstandard.ZstdDecompressor().stream_reader(data) as reader:
            pieces = []
            left = most + 1
            while left > 0 and (piece := reader.read(min(left, PIECE))):
                pieces.append(piece)
                left -= len(piece)
        check_held("a message", most + 1 - left, most)
        self._expansion.add(most + 1 - left)
        if declared >= 0 and left != 1:
            what = "the data end before the size that is declared"
            raise zstandard.ZstdError(what)
        return b"".join(pieces)
