"""Samples of rows that were held are not answered twice, and deflections are compared with what went on meanwhile."""

from __future__ import annotations

import numpy as np
import pytest

from msls_ros.estimation import Configuration, Dither, Identifier, Level
from msls_ros.inputs import PairedSample, Synchronizer
from msls_ros.inputs.answers import Answers

MS = 1_000_000


def dither(number: int) -> Dither:
    return Dither(np.full(2, 1e-3 * number), 0.0, 0.0, 0.0, Level.NOMINAL, "")


def sample(stamp: int, restarted: bool = False) -> PairedSample:
    return PairedSample(stamp, np.zeros(2), np.zeros(2), np.zeros(2), restarted)


def test_the_last_dither_goes_on_while_rows_are_held(monkeypatch: pytest.MonkeyPatch) -> None:
    configuration = Configuration().replace({"states": ("w", "Q"), "effectors": ("de", "ds"), "known_gravity": False})
    identifier = Identifier(configuration)
    published: list[tuple[int, float]] = []
    compared: list[int] = []
    answers = Answers(
        identifier,
        Synchronizer.of(configuration),
        lambda now, since: "",
        lambda stamp, one: published.append((stamp // MS, round(1e3 * one.delta[0]))),
        lambda text: None,
        lockstep=True,
    )
    monkeypatch.setattr(
        answers.echo, "take", lambda time, delta, command: compared.append(round(1e3 * float(command[0])))
    )
    monkeypatch.setattr(Identifier, "last_dither", dither(1))
    assert not answers.hold(20 * MS, 0), "nothing goes on before the first sample"
    assert answers.take(sample(100 * MS), dither(1), 0, 0)
    for number, held_for in enumerate((20 * MS, None, 40 * MS, 0)):
        assert answers.hold(held_for, 0) == bool(held_for), number
    for number, stamp in enumerate((120 * MS, 140 * MS, 160 * MS), 2):
        answers.take(sample(stamp), dither(number), 0, 0)
    assert published == [(100, 1), (120, 1), (140, 1), (160, 4)]
    assert compared == [1, 1, 1, 4], "what was published for each sample"
    answers.take(sample(50 * MS, restarted=True), dither(5), 0, 0)
    assert published[-1] == (50, 5), "time begins anew"
