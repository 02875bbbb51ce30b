"""From a file to the scanner of its format; the first bytes say which."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import BinaryIO, cast

import zstandard

from msls_ros.bags.errors import BagError
from msls_ros.bags.mcap_scan import MAGIC as MCAP_MAGIC
from msls_ros.bags.mcap_scan import McapScanner
from msls_ros.bags.ros1_scan import MAGIC as ROS1_MAGIC
from msls_ros.bags.ros1_scan import Ros1Scanner
from msls_ros.bags.sqlite_scan import MAGIC as SQLITE_MAGIC
from msls_ros.bags.sqlite_scan import SqliteScanner
from msls_ros.bags.storage import BagMessage, Scanner, Summary, Topic

_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
_MAX_MESSAGE = 1 << 30


def open_storage(path: Path, message_compression: bool) -> Scanner:
    """Open one storage file.

    Parameters
    ----------
    path : Path
        The file.
    message_compression : bool
        Its messages are compressed one by one (zstd).

    Returns
    -------
    Scanner
        To be closed by the caller.

    Raises
    ------
    BagError
        Not a file that can be read, or not of a known format.
    """
    scanner = _open(path)
    return _PerMessage(scanner) if message_compression else scanner


def _open(path: Path) -> Scanner:
    try:
        stream: BinaryIO = path.open("rb")
        head = stream.read(len(SQLITE_MAGIC))
        stream.seek(0)
        size = os.fstat(stream.fileno()).st_size
    except OSError as error:
        msg = f"{path}: cannot be read: {error.strerror or error}"
        raise BagError(msg) from error
    try:
        if head.startswith(MCAP_MAGIC):
            return McapScanner(path, stream, size)
        if head.startswith(ROS1_MAGIC):
            return Ros1Scanner(path, stream, size)
        if head.startswith(_ZSTD_MAGIC):
            return _open_compressed(path, stream)
    except BaseException:
        stream.close()
        raise
    if head.startswith(SQLITE_MAGIC):
        return _open_sqlite(path, stream, size)
    stream.close()
    found = "it is empty" if not head else f"it starts with {head[:8]!r}"
    msg = f"{path}: not a bag; expected an MCAP, sqlite3 or ROS 1 bag file, {found}"
    raise BagError(msg)


def _open_sqlite(path: Path, stream: BinaryIO, size: int) -> Scanner:
    """Open a database; of one cut off in a page a copy of the whole pages, for sqlite fills up with zeros."""
    head = stream.read(18)
    page = int.from_bytes(head[16:18], "big")
    page = 65536 if page == 1 else page
    if page < 512 or size % page == 0:
        stream.close()
        return SqliteScanner(path)
    stream.seek(0)
    return _Unpacked(path, stream, size - size % page, f"cut off at byte {size}")


def _open_compressed(path: Path, stream: BinaryIO) -> Scanner:
    """Open a file that is compressed as a whole; MCAP as a stream, sqlite3 from a temporary copy."""
    try:
        inner = _decompressor(stream)
        head = inner.read(len(SQLITE_MAGIC))
        stream.seek(0)
        if head.startswith(MCAP_MAGIC):
            return McapScanner(path, _decompressor(stream), None)
        if head.startswith(SQLITE_MAGIC):
            return _Unpacked(path, _decompressor(stream))
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

    def __init__(self, path: Path, source: BinaryIO, length: int | None = None, damage: str = "") -> None:
        self._folder = TemporaryDirectory(prefix="msls_bag_")
        copy = Path(self._folder.name) / "bag.db3"
        self._damage = damage
        try:
            with source, copy.open("wb") as target:
                try:
                    shutil.copyfileobj(source, target, 1 << 20)
                except zstandard.ZstdError as error:
                    self._damage = f"its compression is damaged ({error})"
                target.truncate(length)
            super().__init__(copy, path)
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

    def close(self) -> None:
        super().close()
        self._folder.cleanup()


class _PerMessage:
    """Decompresses the messages of another scanner."""

    def __init__(self, scanner: Scanner) -> None:
        self._scanner = scanner

    @property
    def topics(self) -> list[Topic]:
        return self._scanner.topics

    @property
    def summary(self) -> Summary | None:
        return self._scanner.summary

    def progress(self) -> float:
        return self._scanner.progress()

    def close(self) -> None:
        self._scanner.close()

    def batches(self, wanted: Callable[[str], bool], warn: Callable[[str], None]) -> Iterator[list[BagMessage]]:
        decompressor = zstandard.ZstdDecompressor()
        damaged = 0
        for batch in self._scanner.batches(wanted, warn):
            whole = []
            for message in batch:
                try:
                    whole.append(message._replace(data=_expand(decompressor, message.data)))
                except (zstandard.ZstdError, MemoryError):
                    damaged += 1
            if whole:
                yield whole
        if damaged:
            warn(f"{damaged} messages that cannot be decompressed were skipped")


def _expand(decompressor: zstandard.ZstdDecompressor, data: bytes) -> bytes:
    if zstandard.frame_content_size(data) > _MAX_MESSAGE:
        what = "the size of a message is damaged"
        raise zstandard.ZstdError(what)
    return decompressor.decompressobj().decompress(data)
