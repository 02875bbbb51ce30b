"""The section ``sensors`` of a scenario: instruments as they are on real aircraft."""

from __future__ import annotations

from msls_ros.flights.scenario_yaml import Section, shown
from msls_ros.plant import CHANNELS, SUITES, Instruments, PlantError
from msls_ros.plant.instruments import BY_CHANNEL, FIELDS


def read_sensors(top: Section) -> Instruments | None:
    """Return what a scenario says of its sensors; None: nothing, or that all is off."""
    if "sensors" not in top.values:
        return None
    section = top.section("sensors", ("suite", *FIELDS))
    suite = SUITES[section.word("suite", SUITES, "plain")]
    changes: dict[str, object] = {}
    for name in section.values:
        if name in BY_CHANNEL:
            channels = section.section(name, CHANNELS)
            changes[name] = tuple((one, channels.number(one, -100.0, 100.0, "")) for one in channels.values)
        elif name in ("vanes", "differentiated"):
            changes[name] = section.flag(name, False)
        elif name == "accelerometer_position":
            changes[name] = _three(section, name)
        elif name != "suite":
            changes[name] = section.number(name, -100.0, 1000.0, "")
    try:
        found = suite.changed(changes)
    except PlantError as error:
        section.refuse(first_word(error), rest(error))
    return None if found == Instruments() else found


def _three(section: Section, name: str) -> tuple[float, float, float]:
    value = section.values[name]
    if not isinstance(value, list) or len(value) != 3 or not all(isinstance(one, (int, float)) for one in value):
        section.refuse(name, f"is {shown(value)}; expected three numbers [m]: forward, right, down")
    return float(value[0]), float(value[1]), float(value[2])


def first_word(error: PlantError) -> str:
    """Return the key that a sentence of the plant begins with."""
    return str(error).split(" ", 1)[0]


def rest(error: PlantError) -> str:
    """Return the sentence without the key, as those of the file are."""
    return "is " + str(error).split(" ", 1)[1].replace(": expected", "; expected", 1)
