"""Bags that are meant to do harm cost neither memory nor time, and give one sentence."""

from __future__ import annotations

import os
import re
import sqlite3
from pathlib import Path

import pytest
import zstandard
from bags.hostile import (
    MAGIC,
    METADATA,
    MIB,
    channel,
    chunk,
    database,
    mcap,
    mcap_of_type,
    message,
    peak,
    record,
    ros1_bomb,
    schema,
    zeros,
)
from bags.test_damage import write_ros1
from bags.test_reading import write_old_database
from bags.test_writing import mcap_file, write_flight

from msls_ros.bags import BagError, BagReader, BagWriter, decoding, metadata, read, repair
from msls_ros.bags.definitions import Definitions

HELD = 4 * MIB
BOMB = 24 * MIB
ENDING = 50
"""Bytes from the end of the data on."""
DAMAGED_TYPE = re.compile(r"t\.mcap: topic /t: a/msg/B: ")


def read_all(path: Path, held: int = HELD) -> tuple[int, list[str]]:
    """Read a bag to the end; give the bytes of its messages and the warnings."""
    reader = BagReader(path, held=held)
    return sum(len(m.data) for m in reader), reader.warnings


@pytest.mark.parametrize("compression", ["bz2", "lz4"])
@pytest.mark.parametrize("declared", [1000, BOMB], ids=["small", "large"])
def test_a_chunk_of_ros1_unpacks_to_what_it_declares_and_no_further(
    tmp_path: Path, compression: str, declared: int
) -> None:
    path = tmp_path / "old.bag"
    path.write_bytes(ros1_bomb(compression, BOMB, declared))
    (size, (warning,)), most = peak(lambda: read_all(path))
    assert (size, most < 3 * HELD) == (0, True)
    assert ("more than the 1000 bytes it declares" if declared == 1000 else "what a read may hold") in warning


@pytest.mark.parametrize("declared", [1000, BOMB], ids=["small", "large"])
def test_a_chunk_unpacks_to_what_it_declares_and_no_further(tmp_path: Path, declared: int) -> None:
    path = tmp_path / "t.mcap"
    good = [schema(1, b"std_msgs/msg/String", b"string data"), channel(1, 1, b"/t"), message(1, 7, b"1234")]
    path.write_bytes(mcap(chunk(zeros(BOMB), declared, b"zstd"), *good))
    (size, (warning,)), most = peak(lambda: read_all(path))
    assert (size, most < 3 * HELD) == (4, True), "what stands behind it is read"
    assert "one damaged part skipped" in warning


def test_many_chunks_that_fit_are_read_no_further_than_a_file_unpacks_to(tmp_path: Path) -> None:
    path = tmp_path / "t.mcap"
    said = schema(1, b"std_msgs/msg/String", b"string data"), channel(1, 1, b"/t")
    large = message(1, 7, bytes(MIB))
    packed = chunk(zstandard.ZstdCompressor().compress(large), len(large), b"zstd")
    path.write_bytes(mcap(*said, *[packed] * 20))
    size, (warning,) = read_all(path)
    assert 0 < size <= HELD and "unpack to more than" in warning


def test_a_compressed_file_is_read_no_further_than_a_file_unpacks_to(tmp_path: Path) -> None:
    path = tmp_path / "t.mcap.zstd"
    begin = mcap(schema(1, b"std_msgs/msg/String", b"string data"), channel(1, 1, b"/t"), message(1, 7, b"1234"))
    endless = begin[:-ENDING] + b"\x80" + (1 << 60).to_bytes(8, "little")
    path.write_bytes(zstandard.ZstdCompressor().compress(endless) + zeros(BOMB))
    (size, (warning,)), most = peak(lambda: read_all(path))
    assert (size, most < 20 * MIB) == (4, True)
    assert "unpack to more than" in warning
    path.write_bytes(zstandard.ZstdCompressor().compress(begin[:-ENDING] + b"\x05" + (1 << 60).to_bytes(8, "little")))
    size, (warning,) = read_all(path)
    assert size == 4 and "what a read may hold" in warning


@pytest.mark.parametrize("declares", [True, False])
def test_messages_compressed_one_by_one_are_held_one_by_one(tmp_path: Path, declares: bool) -> None:
    bag = tmp_path / "bag"
    bag.mkdir()
    (bag / "metadata.yaml").write_text(METADATA + "  compression_mode: MESSAGE\n")
    bomb = zstandard.ZstdCompressor().compress(bytes(BOMB)) if declares else zeros(BOMB)
    good = zstandard.ZstdCompressor().compress(os.urandom(2 * MIB))
    said = [schema(1, b"std_msgs/msg/String", b"string data"), channel(1, 1, b"/t")]
    (bag / "bag_0.mcap").write_bytes(mcap(*said, message(1, 1, bomb), *[message(1, 2, good)] * 8))
    (size, (warning,)), most = peak(lambda: read_all(bag))
    assert (size, most < 10 * HELD) == (16 * MIB, True)
    assert "1 messages that cannot be decompressed were skipped (a message of" in warning


def test_a_compressed_database_fills_no_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    plain = database(tmp_path / "plain.db3").read_bytes()
    path = tmp_path / "t.db3.zstd"
    path.write_bytes(zstandard.ZstdCompressor().compress(plain) + zeros(BOMB))
    with pytest.raises(BagError, match=r"t\.db3\.zstd: a database of .* unpack it with `zstd -d`"):
        read_all(path)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["plain.db3", "t.db3.zstd"]
    assert BagReader(path, held=2 * BOMB).topics == {"/t": "std_msgs/msg/String"}


ENDLESS = "WITH RECURSIVE n(i) AS (VALUES(1) UNION ALL SELECT i + 1 FROM n) SELECT"
DATABASES = {
    "a view of messages": [
        "DROP TABLE messages",
        f"CREATE VIEW messages AS {ENDLESS} i AS id, 1 AS topic_id, 2 AS timestamp, x'00' AS data FROM n WHERE i < 0",
    ],
    "a view of topics": [
        "DROP TABLE topics",
        f"CREATE VIEW topics AS {ENDLESS} i AS id, 'a' AS name, 'b' AS type, 'cdr' AS serialization_format FROM n",
    ],
    "a view of definitions": [
        f"CREATE VIEW message_definitions AS {ENDLESS} 'a/msg/B' AS topic_type, 'ros2msg' AS "
        "encoding, '' AS encoded_message_definition, '' AS type_description_hash FROM n"
    ],
    "a computed column": [
        "DROP TABLE messages",
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, "
        "timestamp INTEGER, data BLOB AS (zeroblob(900000000)))",
    ],
}


@pytest.mark.parametrize("what", DATABASES)
def test_only_plain_tables_of_a_database_are_read(tmp_path: Path, what: str) -> None:
    path = database(tmp_path / "t.db3", *DATABASES[what])
    with pytest.raises(BagError, match=r"t\.db3: not a readable rosbag2 database: expected (a|the) table "):
        read(path)


def test_large_rows_of_a_database_are_handed_on_alone_or_skipped(tmp_path: Path) -> None:
    path = tmp_path / "t.db3"
    write_old_database(path, 20, "std_msgs/msg/String", bytes(MIB))
    with sqlite3.connect(path) as connection:
        connection.execute("INSERT INTO messages VALUES(NULL, 1, 5, ?)", (bytes(HELD + 1),))
    connection.close()
    reader = BagReader(path, held=HELD)
    assert max(sum(len(m.data) for m in batch) for batch in reader.batches()) <= HELD + MIB
    (warning,) = reader.warnings
    assert "1 damaged rows, or rows of more than 4 MiB, skipped" in warning and reader.lost


BRANCHES = "".join(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]\n" for k in range(1, 12))
MERGES = "".join(f"m{k}: &m{k} {{<<: [*m{k - 1}, *m{k - 1}, *m{k - 1}], k{k}: 1}}\n" for k in range(1, 16))
YAML = {
    "aliases": "a0: &a0 [x]\n" + BRANCHES,
    "merge keys": "m0: &m0 {k: 1}\n" + MERGES,
    "an alias of itself": "a: &a [*a]\n",
    "depth": "a: " + "[" * 20_000 + "]" * 20_000,
    "block depth": "".join(" " * k + "a:\n" for k in range(1200)),
    "a number": "a: " + "9" * 20_000,
    "a date": "a: 2001-99-99\n",
    "a tag": "a: !!python/object:os.system x\n",
    "length": "# " + "x" * 2_000_000,
    "bytes": "a: \x00\x01\n",
    "a list": "- a\n",
}


@pytest.mark.parametrize("what", YAML)
def test_strange_metadata_is_a_warning_and_the_bag_is_read(tmp_path: Path, what: str) -> None:
    messages = write_flight(tmp_path / "bag", samples=3)
    (tmp_path / "bag" / "metadata.yaml").write_text(YAML[what])
    reader = read(tmp_path / "bag")
    assert list(reader) == messages
    (warning,) = reader.warnings
    assert "metadata.yaml: damaged" in warning and len(warning.splitlines()) == 1


@pytest.mark.parametrize("what", YAML)
def test_strange_profiles_are_none(what: str) -> None:
    profiles = YAML[what].replace("a:", "- a:", 1)
    assert metadata.profiles(profiles) is None or what in ("block depth", "a list")


def test_an_alias_that_unfolds_to_little_is_read() -> None:
    assert metadata.profiles("- a: &t {sec: 1}\n  b: *t\n- c: {<<: *t}\n") == [
        {"a": {"sec": 1}, "b": {"sec": 1}},
        {"c": {"sec": 1}},
    ]


def test_a_file_listed_many_times_is_read_once(tmp_path: Path) -> None:
    messages = write_flight(tmp_path / "bag", samples=3)
    listed = ", ".join(["bag_0.mcap"] * 5000 + ["x" * 300, '"\\0"'])
    (tmp_path / "bag" / "metadata.yaml").write_text(METADATA.replace("bag_0.mcap", listed))
    assert list(read(tmp_path / "bag")) == messages


def test_a_pipe_is_never_opened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "t.mcap")
    with pytest.raises(BagError, match=r"t\.mcap: not a file or directory; expected"):
        read(tmp_path / "t.mcap")
    bag = tmp_path / "bag"
    messages = write_flight(bag, samples=3)
    (bag / "metadata.yaml").unlink()
    for name in ("bag_1.mcap", "metadata.yaml"):
        os.mkfifo(bag / name)
    assert list(read(bag)) == messages
    path = database(tmp_path / "t.db3")
    os.mkfifo(tmp_path / "t.db3-wal")
    assert list(read(path)) == []


NESTED = "\n".join(["B1 b", *(f"{'=' * 80}\nMSG: a/B{k}\nB{k + 1} b" for k in range(1, 300))])
PARTS = f"C c\n{'=' * 80}\nMSG: a/C\nB b\n"
TYPES = {
    "a bound of 2e9 numbers": ("float64[2000000000] x\n", "field x: an array of 2000000000; expected"),
    "a bound of 2e9 texts": ("string[2000000000] x\n", "field x: an array of 2000000000 messages or texts"),
    "a bound of 2e9 messages": (f"C[2000000000] x\n{'=' * 80}\nMSG: a/C\nint8 y\n", "field x: an array of 2000000000"),
    "many bounds": ("\n".join(f"string[4000] x{k}" for k in range(9)), "arrays of 36000 messages or texts"),
    "20,000 fields": ("\n".join(f"float64 x{k}" for k in range(20_000)), "a definition of 20000 lines"),
    "a long text": ("# " + "x" * 2_000_000, "a definition of 2000002 characters"),
    "itself": ("B b\n", "its type a/msg/B holds itself"),
    "itself by another": (PARTS, "its type a/msg/B holds itself"),
    "300 deep": (NESTED, "types more than 32 deep in one another"),
    "a type that is missing": ("C c\n", "damaged definition of this type"),
    "a constant without a name in Python": ("float64 X=1e999\nint8 y\n", "damaged definition of this type"),
    "nonsense": ("nonsense here and there\n", "damaged definition of this type"),
}


@pytest.mark.parametrize("what", TYPES)
def test_a_strange_definition_is_one_sentence_and_its_messages_are_read(tmp_path: Path, what: str) -> None:
    definition, sentence = TYPES[what]
    path = tmp_path / "t.mcap"
    path.write_bytes(mcap_of_type("a/msg/B", definition))
    reader = read(path)
    (found,) = reader
    with pytest.raises(BagError, match=re.escape(sentence)) as caught:
        reader.decode(found)
    assert DAMAGED_TYPE.search(str(caught.value)) and len(str(caught.value).splitlines()) == 1


def test_a_damaged_definition_is_parsed_once_for_all_its_messages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Found by coverage-guided fuzzing: it was parsed again for each, 10 ms a time."""
    path = tmp_path / "t.mcap"
    path.write_bytes(mcap_of_type("a/msg/B", TYPES["nonsense"][0]))
    parsed = []
    parse = vars(decoding)["_parse"]

    def count(definition: object) -> object:
        parsed.append(definition)
        return parse(definition)

    monkeypatch.setattr(decoding, "_parse", count)
    reader = read(path)
    (found,) = reader
    for _ in range(3):
        with pytest.raises(BagError, match="damaged definition"):
            reader.decode(found)
    assert len(parsed) == 1


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("IDL: a/msg/B", "damaged definition"),
        ("module a { module msg { struct B { long x[1 << 40]; }; }; };", "shifted or enormous number"),
        ("module a { " * 3000, "damaged definition"),
        ("module a { module msg { struct B { B b; }; }; };", "holds itself"),
    ],
    ids=["no newline", "a shift", "depth", "itself"],
)
def test_a_strange_definition_in_idl_is_one_sentence(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "t.mcap"
    path.write_bytes(mcap_of_type("a/msg/B", text, "ros2idl"))
    reader = read(path)
    (found,) = reader
    with pytest.raises(BagError, match=words) as caught:
        reader.decode(found)
    assert len(str(caught.value).splitlines()) == 1


def test_a_definition_in_a_folder_that_holds_itself_is_one_sentence(tmp_path: Path) -> None:
    folder = tmp_path / "a" / "msg"
    folder.mkdir(parents=True)
    (folder / "B.msg").write_text("C c\n")
    (folder / "C.msg").write_text("B[] b\n")
    with pytest.raises(BagError, match="its type a/msg/B holds itself"):
        Definitions([tmp_path]).require("a/msg/B")
    for k in range(300):
        (folder / f"D{k}.msg").write_text(f"D{k + 1} d\n" if k < 299 else "int8 x\n")
    with pytest.raises(BagError, match="deep in one another"):
        Definitions([tmp_path]).require("a/msg/D0")


def test_a_folder_whose_name_is_no_utf8_is_written_read_and_repaired(tmp_path: Path) -> None:
    folder = Path(os.fsdecode(os.fsencode(tmp_path) + b"/fl\xfcge"))
    folder.mkdir()
    messages = write_flight(folder / os.fsdecode(b"b\xe4g"), samples=3)
    bag = folder / os.fsdecode(b"b\xe4g")
    assert list(read(bag)) == messages and read(bag).warnings == []
    assert not repair(bag).changed
    path = database(tmp_path / "t.db3", "INSERT INTO messages VALUES(1, 1, 2, x'0001')").rename(folder / "t.db3")
    assert len(list(read(path))) == 1


def test_a_byte_that_is_no_utf8_in_a_definition_costs_nothing(tmp_path: Path) -> None:
    path = tmp_path / "t.mcap"
    said = schema(1, b"std_msgs/msg/String", b"# [\xb0C]\nstring data"), channel(1, 1, b"/t\xe4")
    path.write_bytes(mcap(chunk(b"".join([*said, message(1, 7, b"1234"), message(1, 8, b"5678")]))))
    reader = read(path)
    assert [m.data for m in reader] == [b"1234", b"5678"] and reader.warnings == [] and not reader.lost


def test_an_index_that_names_places_behind_the_file_is_not_followed(tmp_path: Path) -> None:
    """Found by coverage-guided fuzzing: such a place cannot even be sought."""
    path = tmp_path / "t.mcap"
    described = [schema(1, b"std_msgs/msg/String", b"string data"), channel(1, 1, b"/t"), message(1, 7, b"1234")]
    begin = mcap(*described, b"\0" * 9)[:-ENDING]
    index = record(8, bytes(16) + (1 << 63).to_bytes(8, "little") + bytes(40))
    footer = record(2, len(begin).to_bytes(8, "little") + bytes(12))
    path.write_bytes(begin + index + footer + MAGIC)
    reader = read(path)
    assert [m.data for m in reader] == [b"1234"] and len(reader.warnings) == 1


def test_a_chunk_that_has_become_another_record_is_missed(tmp_path: Path) -> None:
    """Found by `benchmark faults`: records of unknown kinds are skipped, and with one the messages of a chunk were."""
    bag = tmp_path / "bag"
    messages = write_flight(bag, samples=60)
    file = mcap_file(bag)
    blob = bytearray(file.read_bytes())
    blob[37] = 0x80
    file.write_bytes(blob)
    reader = read(bag)
    assert list(reader) == messages[40:]
    (warning,) = reader.warnings
    assert "at byte 37 is no chunk, but the index says so" in warning and reader.lost


def test_an_index_of_ros1_that_leads_to_messages_is_not_used(tmp_path: Path) -> None:
    """Found by `benchmark faults`: it was an AttributeError."""
    path = tmp_path / "old.bag"
    blob, words = write_ros1(path, 5)
    place = blob.index(b"index_pos=") + len(b"index_pos=")
    first = blob.index(b"\x05\x00\x00\x00op=\x02") - 4 if b"\x05\x00\x00\x00op=\x02" in blob else 4096
    path.write_bytes(blob[:place] + first.to_bytes(8, "little") + blob[place + 8 :])
    reader = read(path)
    assert len(list(reader)) == len(words) and len(reader.warnings) == 1


def test_a_name_cannot_break_a_line_or_steer_a_terminal(tmp_path: Path) -> None:
    """Found by coverage-guided fuzzing: a type's name with a line break made two lines of one."""
    path = tmp_path / "t.mcap"
    path.write_bytes(
        mcap(schema(1, b"a/msg/B\r\n\x1b[2J", b"int8 x"), channel(1, 1, b"/t\x1b]0;x\x07"), message(1, 7, b"1"))
    )
    reader = BagReader(path, ["/u"])
    assert list(reader) == [] and all(warning.isprintable() for warning in reader.warnings) and reader.warnings
    reader = read(path)
    with pytest.raises(BagError) as caught:
        reader.decode(next(iter(reader)))
    assert str(caught.value).isprintable() and r"\x1b[2J" in str(caught.value)


@pytest.mark.parametrize("bad", ["schema", "channel"])
def test_a_damaged_description_costs_its_own_messages_alone(tmp_path: Path, bad: str) -> None:
    path = tmp_path / "t.mcap"
    broken = schema(2, b"a/msg/B", b"int8 x") if bad == "schema" else channel(2, 1, b"/u")
    broken = broken[:11] + b"\xff\xff\xff\x7f" + broken[15:]
    described = [schema(1, b"std_msgs/msg/String", b"string data"), channel(1, 1, b"/t")]
    path.write_bytes(mcap(chunk(b"".join([*described, message(1, 7, b"1234"), broken, message(1, 8, b"5678")]))))
    reader = read(path)
    assert [m.data for m in reader] == [b"1234", b"5678"]
    assert reader.lost and len(reader.warnings) == 1 and f"a {bad} cannot be read" in reader.warnings[0]


def test_repair_keeps_the_original_and_says_what_was_lost(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    messages = write_flight(bag, samples=60)
    file = mcap_file(bag)
    blob = bytearray(file.read_bytes())
    blob[blob.index(b"zstd") + 100] ^= 0xFF
    file.write_bytes(blob)
    done = repair(bag)
    assert done.changed and done.lost and 0 < done.messages < len(messages)
    assert [kept.name for kept in done.originals] == ["bag_0.mcap.original", "metadata.yaml.original"]
    assert done.originals[0].read_bytes() == blob
    again = read(bag)
    assert len(list(again)) == done.messages and again.warnings == []
    with pytest.raises(BagError, match="holds more than a bag"):
        BagWriter(bag, overwrite=True)
    file.write_bytes(blob[: len(blob) // 3])
    assert repair(bag).originals[0].name == "bag_0.mcap.original2"
    assert done.originals[0].read_bytes() == blob


def test_repair_of_a_cut_file_has_lost_nothing(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    write_flight(bag, samples=60)
    mcap_file(bag).write_bytes(mcap_file(bag).read_bytes()[:9000])
    done = repair(bag)
    assert done.changed and not done.lost and done.messages > 0


def test_repair_leaves_out_and_counts_what_no_bag_can_hold(tmp_path: Path) -> None:
    path = tmp_path / "t.mcap"
    path.write_bytes(
        mcap(
            schema(1, b"std_msgs/msg/String", b"string data"),
            schema(2, b"std_msgs/msg/Bool", b"bool data"),
            channel(1, 1, b"/t"),
            channel(2, 2, b"/t"),
            *(message(1, 7, b"1234"), message(1, 1 << 63, b"1234"), message(2, 8, b"5678")),
        )
    )
    done = repair(path)
    assert (done.messages, done.lost) == (1, True)
    assert "2 messages left out" in " ".join(done.warnings)
