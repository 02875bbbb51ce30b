"""Bags and parameter files that are damaged or meant to do harm: what reading them costs.

A flight is written in every format, and copies of it are changed: bytes flipped, cut off, overwritten, moved, doubled,
lengths made huge, inside and outside the compression. Each copy is read to the end, with its messages decoded, under a
small budget of memory and a limit of time. What may come is messages, warnings, or one sentence (`BagError`).
"""

from __future__ import annotations

import random
import shutil
import signal
import sqlite3
import struct
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from types import FrameType
from typing import Any

import numpy as np
import zstandard
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_typestore

from msls_ros.bags import BagError, BagReader, BagWriter, repair, typestore

STATE = "msls_msgs/msg/StateSample"
TIME_LIMIT = 20
"""Seconds after which a read has hung."""
HELD = 16 << 20
"""Budget of a read [bytes]."""
SAMPLES = 60


class HungError(BaseException):
    """A read has taken too long; not an `Exception`, so that nothing on the way takes it for damage."""


@dataclass
class Tally:
    """What came of the copies of one kind."""

    kind: str
    tried: int = 0
    whole: int = 0
    """All messages came, without a warning."""
    part: int = 0
    """Some came, or all with a warning."""
    refused: int = 0
    """One sentence, no message."""
    silent: int = 0
    """Messages are missing, and nothing was said."""
    crashed: int = 0
    hung: int = 0
    slowest_s: float = 0.0
    examples: list[str] = field(default_factory=list)
    """How the first crashes and hangs came about."""

    def row(self) -> dict[str, Any]:
        """Give it for JSON."""
        return {name: value for name, value in vars(self).items() if name != "examples" or value}


def measure(count: int, say: Callable[[str], None], seed: int = 0) -> list[dict[str, Any]]:
    """Read so many damaged bags; give a row for each kind, and one of repairs."""
    with TemporaryDirectory(prefix="msls_faults_") as folder:
        seeds = seed_bags(Path(folder) / "seeds")
        share = -(-count // (len(seeds) + 1))
        tallies = []
        for number, (kind, path) in enumerate(seeds.items()):
            say(f"{kind}: {share} damaged copies")
            tallies.append(read_copies(kind, path, share, Path(folder) / "copy", 1000 * seed + number))
        say(f"repair: {share} damaged copies")
        tallies.append(repair_copies(seeds["rosbag2 MCAP"], share, Path(folder) / "copy", 1000 * seed + 999))
    return [tally.row() for tally in tallies]


def seed_bags(folder: Path) -> dict[str, Path]:
    """Write one flight in every format."""
    folder.mkdir()
    rng = np.random.default_rng(0)
    store = typestore()
    messages = []
    with BagWriter(folder / "ours") as writer:
        for k in range(SAMPLES):
            stamp = 10**9 + k * 2 * 10**7
            content = {"states": list("uvwPQR"), "x": rng.normal(size=6), "xdot": rng.normal(size=6)}
            messages.append((stamp, writer.serialize(STATE, content)))
            writer.write("/state", STATE, *messages[-1])
            if k % 10 == 9:
                writer.flush()
    kinds = {
        "rosbag2 MCAP": folder / "ours",
        "rosbag2 MCAP, messages compressed": (StoragePlugin.MCAP, CompressionMode.MESSAGE),
        "rosbag2 MCAP, file compressed": (StoragePlugin.MCAP, CompressionMode.FILE),
        "rosbag2 sqlite3": (StoragePlugin.SQLITE3, CompressionMode.NONE),
        "rosbag2 sqlite3, file compressed": (StoragePlugin.SQLITE3, CompressionMode.FILE),
    }
    found: dict[str, Path] = {}
    for number, (kind, how) in enumerate(kinds.items()):
        if isinstance(how, Path):
            found[kind] = how
            continue
        found[kind] = folder / f"bag{number}"
        bag = Ros2Writer(found[kind], version=9, storage_plugin=how[0])
        bag.set_compression(how[1], CompressionFormat.ZSTD)
        with bag:
            connection = bag.add_connection("/state", STATE, typestore=store)
            for stamp, data in messages:
                bag.write(connection, stamp, data)
    found["metadata.yaml"] = found["rosbag2 MCAP"]
    return {**found, **_ros1(folder)}


def _ros1(folder: Path) -> dict[str, Path]:
    """Write bags of ROS 1."""
    old = get_typestore(Stores.ROS1_NOETIC)
    kind = "geometry_msgs/msg/Vector3"
    found = {}
    for name in ("none", "BZ2", "LZ4"):
        path = found[f"ROS 1, compression {name.lower()}"] = folder / f"{name}.bag"
        writer = Ros1Writer(path)
        if name != "none":
            writer.set_compression(Ros1Writer.CompressionFormat[name])
        with writer:
            writer.chunk_threshold = 600
            connection = writer.add_connection("/v", kind, typestore=old)
            for k in range(SAMPLES):
                vector = old.types[kind](1.0 * k, 2.0, 3.0)
                writer.write(connection, 10**9 + k, bytes(old.serialize_ros1(vector, kind)))
    return found


def storage(bag: Path) -> Path:
    """Give the storage file of a bag."""
    if bag.is_file():
        return bag
    return next(file for file in sorted(bag.iterdir()) if file.suffix in (".mcap", ".db3", ".zstd"))


def read_copies(kind: str, bag: Path, count: int, copy: Path, seed: int) -> Tally:
    """Read damaged copies of a bag."""
    tally = Tally(kind)
    rng = random.Random(seed)
    original = [message.data for message in BagReader(bag)]
    for _ in range(count):
        damaged, how = damage(bag, copy, kind, rng)
        _judge(tally, how, lambda path=damaged: _read(path, original))  # type: ignore[misc]
    return tally


def repair_copies(bag: Path, count: int, copy: Path, seed: int) -> Tally:
    """Repair damaged copies of a bag: what could be read is in the new one, and the old one is beside it."""
    tally = Tally("repair of rosbag2 MCAP")
    rng = random.Random(seed)
    for _ in range(count):
        damaged, how = damage(bag, copy, "", rng)
        before = storage(damaged).read_bytes()

        def once(path: Path = damaged, before: bytes = before) -> str:
            readable = Counter((message.topic, message.data) for message in BagReader(path, held=HELD))
            done = repair(path)
            if not done.changed:
                return "whole"
            again = Counter((message.topic, message.data) for message in BagReader(path, held=HELD))
            kept = [file for file in done.originals if ".mcap" in file.name and file.read_bytes() == before]
            if not kept or (again != readable and not done.lost):
                return "silent"
            return "part"

        _judge(tally, how, once)
    return tally


def _read(bag: Path, original: list[bytes]) -> str:
    """Read and decode all; say what came."""
    reader = BagReader(bag, held=HELD)
    found = []
    undecoded = 0
    for batch in reader.batches():
        for message in batch:
            found.append(message.data)
            try:
                reader.decode(message)
            except BagError:
                undecoded += 1
    if found == original and not reader.warnings:
        return "whole"
    return "part" if reader.warnings or undecoded or len(found) >= len(original) else "silent"


def _judge(tally: Tally, how: str, action: Callable[[], str]) -> None:
    """Count what came of one copy."""
    tally.tried += 1
    start = time.monotonic()
    try:
        with _limited():
            what = action()
    except BagError as error:
        what = "refused" if len(str(error).splitlines()) == 1 else "crashed"
    except HungError:
        what = "hung"
    except Exception as error:
        what = "crashed"
        how = f"{how}: {type(error).__name__}: {error}"
    tally.slowest_s = max(tally.slowest_s, round(time.monotonic() - start, 2))
    setattr(tally, what, getattr(tally, what) + 1)
    if what in ("crashed", "hung", "silent") and len(tally.examples) < 5:
        tally.examples.append(f"{what}: {how}")


@contextmanager
def _limited() -> Iterator[None]:
    """End what takes too long."""

    def late(number: int, frame: FrameType | None) -> None:
        raise HungError

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(TIME_LIMIT)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def damage(bag: Path, copy: Path, kind: str, rng: random.Random) -> tuple[Path, str]:
    """Make a damaged copy of a bag; give it and how it was damaged."""
    for old in (copy, copy.with_suffix(".bag")):
        if old.is_dir():
            shutil.rmtree(old)
        old.unlink(missing_ok=True)
    if bag.is_file():
        target = file = copy.with_suffix(".bag")
        shutil.copyfile(bag, target)
    else:
        target = copy
        shutil.copytree(bag, copy)
        file = copy / "metadata.yaml" if kind == "metadata.yaml" else storage(copy)
    blob = file.read_bytes()
    inside = ".zstd" in file.name and rng.random() < 0.5
    if inside:
        blob = zstandard.ZstdDecompressor().decompressobj().decompress(blob)
    changed, how = mutate(blob, rng)
    file.write_bytes(zstandard.ZstdCompressor(level=1).compress(changed) if inside else changed)
    return target, how


def mutate(blob: bytes, rng: random.Random) -> tuple[bytes, str]:
    """Change bytes in one to four ways, of which some aim at lengths."""
    hows = []
    for _ in range(rng.choice((1, 1, 2, 4))):
        how, change = rng.choice(list(CHANGES.items()))
        place = rng.randrange(max(1, len(blob)))
        blob = change(blob, place, rng)
        hows.append(f"{how} at {place}")
    return blob, ", ".join(hows)


def _put(blob: bytes, place: int, new: bytes) -> bytes:
    return blob[:place] + new + blob[place + len(new) :]


def _sql(blob: bytes, place: int, rng: random.Random) -> bytes:
    """Change a database by its own means, where it is one."""
    if not blob.startswith(b"SQLite"):
        return blob[:place] + blob[place + 1 :]
    connection = sqlite3.connect(":memory:")
    try:
        connection.deserialize(blob)
        connection.execute(rng.choice(SQL))
        connection.commit()
        return bytes(connection.serialize())
    except (sqlite3.Error, AttributeError):  # Python 3.10 cannot
        return blob[:place]
    finally:
        connection.close()


SQL = (
    "UPDATE messages SET data = 'text'",
    "UPDATE messages SET timestamp = -1 WHERE id % 2",
    "UPDATE messages SET topic_id = 99 WHERE id % 3 = 0",
    "UPDATE messages SET data = zeroblob(20000000) WHERE id = 7",
    "UPDATE topics SET type = x'ff00fe'",
    "UPDATE topics SET name = NULL",
    "UPDATE topics SET offered_qos_profiles = '&a [*a]'",
    "DROP TABLE message_definitions",
    "DELETE FROM topics",
    "UPDATE message_definitions SET encoded_message_definition = 'float64[2000000000] x'",
)
CHANGES: dict[str, Callable[[bytes, int, random.Random], bytes]] = {
    "a byte flipped": lambda b, p, r: _put(b, p, bytes([b[p] ^ (1 << r.randrange(8))])) if b else b,
    "cut off": lambda b, p, r: b[:p],
    "zeros": lambda b, p, r: _put(b, p, bytes(r.choice((4, 100, 1000)))),
    "noise": lambda b, p, r: _put(b, p, r.randbytes(r.choice((1, 8, 100)))),
    "a huge length": lambda b, p, r: _put(
        b, p, struct.pack("<Q", r.choice((2**31, 2**32 - 1, 2**40, 2**63, 2**64 - 1)))
    ),
    "a part left out": lambda b, p, r: b[:p] + b[p + r.choice((1, 9, 200)) :],
    "a part doubled": lambda b, p, r: b[:p] + b[max(0, p - 300) :],
    "parts exchanged": lambda b, p, r: b[: p // 2] + b[p:] + b[p // 2 : p],
    "a database changed": _sql,
}
