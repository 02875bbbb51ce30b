"""`benchmark faults` in small: what it measures holds; its full size is for docs/reliability.md."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = str(Path(__file__).resolve().parents[2])
if ROOT not in sys.path:
    sys.path.insert(0, ROOT)

from benchmarks import fault_disks, fault_network, fault_processes, fault_soak, faults  # noqa: E402

SIZES = {"bags": 10, "messages": 2400, "nodes": 130, "kills": 1, "network": 4, "soak": 22}


def measured(part: str) -> Any:
    found = faults.measure([part], SIZES, lambda _: None)
    assert faults.text(found)
    return found[part]


@pytest.mark.parametrize("part", ["messages", "nodes"])
def test_damaged_messages_are_refused_with_a_word_and_leave_the_answers_as_they_were(part: str) -> None:
    rows = measured(part)
    assert len(rows) == (4 if part == "messages" else 5)
    for row in rows:
        found = (row["unlogged"], row["crashed"], row["not_finite"], row["same_bits"])
        assert found == (0, 0, 0, True), row
        assert row["refused"] == row["tried"] >= (SIZES[part] if part == "nodes" else 700)


def test_a_node_that_is_killed_costs_nothing_that_was_on_disk_and_no_command() -> None:
    rows = fault_processes.kills(1, lambda _: None, ("identifier", "recorder"))
    assert [row["tried"] for row in rows] == [1, 1]
    assert not any(row["lost"] + row["wrong"] + row["crashed"] for row in rows), rows


def test_a_disk_that_cannot_be_written_is_one_line_and_what_was_there_stays() -> None:
    kind = next(iter(fault_disks.DISKS))
    (row,) = fault_disks.measure(lambda _: None, ("replay", "recorder"), (kind,))
    if "skipped" in row:
        pytest.skip(row["skipped"])
    assert (row["tried"], row["refused"]) == (2, 2), row
    assert all("cannot be written: No space left" in line for line in row["said"].values()), row


def test_over_a_bad_network_no_dither_is_applied_late_and_none_in_a_cut() -> None:
    found = measured("network")
    if "skipped" in found:
        pytest.skip(found["skipped"])
    assert found["codes"] == dict.fromkeys(("identifier", "plant", "pilot"), 0)
    assert found["steps_in_the_cut"] > 50 and found["lost"] > 0.1 * found["frames"]
    assert (found["dither_in_the_cut"], found["too_old"], found["same_bits"]) == (0, 0, True)
    assert found["with_dither"] + found["with_dither_again"] > 0 and found["samples"] > 0
    assert found["largest_state"] < 200.0


def test_where_namespaces_are_not_allowed_it_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(fault_network.NotAllowedError):
        fault_network.measure(1.0)
    assert "cannot be made here" in measured("network")["skipped"]


def test_a_flight_replays_to_the_same_bits_and_its_cost_is_told() -> None:
    found = fault_soak.measure(SIZES["soak"], lambda _: None)
    assert found["same_bits"] and found["compared"] == 2 * found["samples"] == 2202
    assert (found["time_outs"], found["refused"]) == (0, 0)
