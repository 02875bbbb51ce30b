"""Parameters: one declaration, refused with a sentence that says what would be right."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from msls_ros.estimation import Configuration, EstimationError, Identifier, from_mapping
from msls_ros.estimation.configuration import as_mapping, items
from msls_ros.inputs.profiles import config_folder, read_profile, render_profile


@pytest.mark.parametrize("path", sorted(config_folder().glob("*.yaml")), ids=lambda p: p.stem)
def test_a_shipped_profile_is_the_whole_manual_and_up_to_date(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    head = text.split("\n\n/**:")[0]
    title = "\n".join(line[2:] for line in head.splitlines())
    assert render_profile(read_profile(path), title) == text


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"estimator.forgetting_factor": 1.5}, r"forgetting_factor' is 1.5; it must be in \[0.01, 1\]"),
        ({"estimator.forgetting_factor": math.nan}, "forgetting_factor' is nan; it must be in"),
        ({"estimator.method": "kalman"}, "must be one of bank, msls, rls"),
        ({"estimator": {"forgeting": 0.9}}, "'estimator.forgeting' does not exist"),
        ({"detector.window": 10.5}, "must be a whole number"),
        ({"dither.enabled": 1}, "must be true or false"),
        ({"states": "u"}, "must be a list"),
        ({"states": ["u", "u"]}, "names must differ"),
        ({"states": ["u", "P"]}, "needs Phi and Theta"),
        ({"states": ["u", "w", "q", "Phi", "Theta"]}, "names 'q' beside a velocity.*write 'Q' if it is that one"),
        ({"states": ["u", "P", "phi", "Theta"]}, "write 'Phi' if it is"),
        ({"states": ["Phi"]}, "no equation to identify"),
        ({"effectors": ["P"]}, "cannot be a name of both"),
        ({"dither.weights": [1.0]}, "one per effector, 7, or none"),
        ({"dither.position_low": [0.0] * 7}, "go together"),
        ({"dither.limit_boosted": 0.2}, r"in \[0, 0.05\] g"),
    ],
)
def test_a_wrong_value_is_refused_with_what_would_be_right(values: dict[str, object], sentence: str) -> None:
    with pytest.raises(EstimationError, match=sentence):
        from_mapping(values)


def test_whole_numbers_serve_as_floats_and_lists_as_tuples() -> None:
    c = from_mapping({"sample_rate": 100, "dither": {"weights": [1, 2, 1, 1, 1, 1, 1]}})
    assert c.sample_rate == 100.0
    assert c.dither.weights[1] == 2.0


def test_a_time_constant_replaces_the_forgetting_factor() -> None:
    assert from_mapping({"estimator.time_constant": 0.2, "sample_rate": 50.0}).forgetting == pytest.approx(
        math.exp(-0.1)
    )


def test_every_parameter_has_description_unit_and_range() -> None:
    for name, value, bounds in items(Configuration()):
        assert len(bounds.description) > 10, name
        assert bounds.unit, name
        assert not isinstance(value, float) or bounds.low < bounds.high, name


def test_what_may_change_in_flight_changes_and_the_rest_is_refused() -> None:
    identifier = Identifier(Configuration())
    identifier.configure({"estimator.forgetting_factor": 0.95, "dither.enabled": False})
    assert identifier.configuration.forgetting == 0.95
    with pytest.raises(EstimationError, match="cannot change while the estimator runs"):
        identifier.configure({"estimator.method": "rls"})
    assert as_mapping(identifier.configuration)["estimator.method"] == "bank"


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ("a: [", "is not YAML"),
        ("x: 1", "has no section"),
        ("identifier:\n  ros__parameters:\n    sample_rate: -1.0", "sample_rate' is -1; it must be in"),
    ],
)
def test_a_wrong_file_is_refused_by_name(tmp_path: Path, content: str, sentence: str) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(EstimationError, match=sentence) as caught:
        read_profile(path)
    assert "mine.yaml" in str(caught.value)


def test_a_missing_file_or_profile_is_named() -> None:
    with pytest.raises(EstimationError, match=r"'nowhere\.yaml' cannot be read: No such file"):
        read_profile("nowhere.yaml")
    with pytest.raises(EstimationError, match="'f17' does not exist; shipped are"):
        read_profile("f17")
