from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from bags.test_writing import EFFECTOR, EFFECTORS, SPECIAL, STATE, STATES, header

from msls_ros.bags import BagError, SampleDecoder, typestore
from msls_ros.bags.definitions import default_definitions
from msls_ros.bags.serde import serialize

STORE = typestore()


def encode(msgtype: str, content: dict[str, Any], little: bool = True) -> bytes:
    cdr = serialize(default_definitions(), msgtype, content)
    if little:
        return cdr
    return bytes(STORE.serialize_cdr(STORE.deserialize_cdr(cdr, msgtype), msgtype, little_endian=False))


def check(decoder: SampleDecoder, cdr: bytes) -> None:
    """Compare with the full decoder, to the last bit."""
    full: Any = STORE.deserialize_cdr(cdr, decoder.msgtype)
    sample = decoder.decode(cdr)
    stamp = full.header.stamp
    assert sample.stamp_ns == stamp.sec * 1_000_000_000 + stamp.nanosec
    names, values = (full.states, full.x) if decoder.msgtype == STATE else (full.effectors, full.delta)
    assert sample.names == tuple(names)
    assert sample.values.tobytes() == values.astype(np.float64).tobytes()
    assert sample.values.flags.aligned and sample.values.flags.writeable and sample.values.flags.c_contiguous
    rates = full.xdot if decoder.msgtype == STATE else np.zeros(0)
    if rates.size == 0:
        assert sample.rates is None
    else:
        assert sample.rates is not None
        assert sample.rates.tobytes() == rates.astype(np.float64).tobytes()


def random_content(rng: np.random.Generator, msgtype: str) -> dict[str, Any]:
    frame = {**header(int(rng.integers(2**31 * 10**9))), "frame_id": "f" * int(rng.integers(0, 9))}
    names = ["n" * int(rng.integers(0, 7)) for _ in range(rng.integers(0, 5))]
    values, rates = (rng.choice([*SPECIAL, *rng.normal(size=9)], rng.integers(0, 5)) for _ in range(2))
    if msgtype == STATE:
        return {"header": frame, "states": names, "x": values, "xdot": rates}
    return {"header": frame, "effectors": names, "delta": values}


@pytest.mark.parametrize("msgtype", [STATE, EFFECTOR])
def test_fast_decoder_equals_the_full_one_whatever_the_layout(msgtype: str) -> None:
    rng = np.random.default_rng(1)
    decoder = SampleDecoder(msgtype)
    for _ in range(300):
        content = random_content(rng, msgtype)
        little = bool(rng.integers(2))
        for _ in range(rng.integers(1, 4)):
            check(decoder, encode(msgtype, content, little))
            content["header"]["stamp"] = header(int(rng.integers(2**31 * 10**9)))["stamp"]


def test_the_layout_is_parsed_once_for_messages_of_one_source() -> None:
    rng = np.random.default_rng(2)
    decoder = SampleDecoder(STATE)
    names = set()
    for k in range(10):
        x, xdot = rng.normal(size=9), rng.normal(size=9)
        cdr = encode(STATE, {"header": header(k), "states": STATES, "x": x, "xdot": xdot})
        check(decoder, cdr)
        names.add(id(decoder.decode(cdr).names))
    assert len(names) == 1


def test_padding_is_garbage_and_does_not_matter() -> None:
    x = np.arange(9.0)
    cdr = encode(STATE, {"header": header(5), "states": STATES, "x": x, "xdot": x + 10})
    decoder = SampleDecoder(STATE)
    first = decoder.decode(cdr)
    meaning = bytes(STORE.serialize_cdr(STORE.deserialize_cdr(cdr, STATE), STATE))
    padding = []
    for place in range(12, len(cdr)):
        changed = bytearray(cdr)
        changed[place] ^= 0xA5
        try:
            same = bytes(STORE.serialize_cdr(STORE.deserialize_cdr(bytes(changed), STATE), STATE)) == meaning
        except Exception:
            same = False
        padding += [place] if same else []
    assert len(padding) >= 4
    for place in padding:
        changed = bytearray(cdr)
        changed[place] ^= 0xA5
        sample = decoder.decode(bytes(changed))
        assert sample.values.tobytes() == first.values.tobytes()
        assert sample.names is first.names, "padding made it parse the layout again"


def test_every_change_of_a_constant_byte_is_noticed() -> None:
    cdr = encode(EFFECTOR, {"header": header(5), "effectors": EFFECTORS, "delta": np.arange(7.0)})
    for place in range(12, len(cdr) - 56):
        decoder = SampleDecoder(EFFECTOR)
        decoder.decode(cdr)
        changed = bytearray(cdr)
        changed[place] ^= 0x01
        try:
            full: Any = STORE.deserialize_cdr(bytes(changed), EFFECTOR)
        except Exception:
            with pytest.raises(BagError):
                decoder.decode(bytes(changed))
            continue
        assert decoder.decode(bytes(changed)).names == tuple(full.effectors)


def test_bytes_that_are_no_sample_are_refused_in_a_sentence() -> None:
    cdr = encode(STATE, {"header": header(5), "states": STATES, "x": np.zeros(9)})
    decoder = SampleDecoder(STATE)
    for length in range(len(cdr) - 1):
        with pytest.raises(BagError, match=rf"{STATE}: {length} bytes that are not a message of this type"):
            decoder.decode(cdr[:length])
    with pytest.raises(BagError, match="not a sample"):
        SampleDecoder("msls_msgs/msg/LinearModel")


def test_random_bytes_never_raise_anything_else() -> None:
    rng = np.random.default_rng(3)
    cdr = encode(STATE, {"header": header(5), "states": STATES, "x": np.zeros(9), "xdot": np.ones(9)})
    decoder = SampleDecoder(STATE)
    refused = 0
    for _ in range(2000):
        changed = bytearray(cdr)
        for place in rng.integers(0, len(cdr), 3):
            changed[place] = rng.integers(256)
        try:
            decoder.decode(bytes(changed))
        except BagError:
            refused += 1
    assert 0 < refused < 2000
