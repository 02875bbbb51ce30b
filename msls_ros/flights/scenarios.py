"""Scenarios: flights as data, in ``config/scenarios/*.yaml`` and in anybody's own files of that form.

``config/scenarios/roll_doublet_tail_fault.yaml`` is the manual: it has every key, with meaning, unit and range.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from msls_ros.estimation import Configuration, EstimationError
from msls_ros.estimation.configuration import as_mapping
from msls_ros.flights.aircraft_files import DEFAULT, AircraftData, find_aircraft
from msls_ros.flights.closed_loop import Flight, Rates
from msls_ros.flights.random_failures import RandomFailures
from msls_ros.flights.scenario_law import LAW_KEYS, LawChoice, read_law, read_random_failures
from msls_ros.flights.scenario_yaml import ScenarioError, Section, load, shown, suggestion
from msls_ros.flights.sensors_yaml import first_word, read_sensors, rest
from msls_ros.flights.watch import ROLL_POWER, ROWS, Watch
from msls_ros.inputs.profiles import config_folder, read_profile
from msls_ros.plant import (
    MANOEUVRES,
    NOISE_LEVELS,
    OWN_MODEL,
    STATES,
    TURBULENCE,
    Airframe,
    Fault,
    FlightCondition,
    Instruments,
    Manoeuvre,
    PlantError,
    check_faults,
    parse_manoeuvre,
)

__all__ = ["Scenario", "ScenarioError", "find_scenario", "listing", "read_scenario", "shipped", "shipped_names"]

FIRST = ("roll_doublet_tail_fault", "roll_doublet")
"""The paper's; the other shipped ones follow in the order of the alphabet."""
KEYS = (
    *("description", "aircraft", "condition", "manoeuvre", "manoeuvre_scale", "duration", "noise", "turbulence"),
    *("gusts", "sensors", "rates", "faults", "watch", "identifier"),
)
RATES = ("flight_dynamics", "sensors", "truth")
FAULT = ("effector", "time", "effectiveness", "ramp", "stuck", "bias", "hard_over")
IDENTIFIER = ("profile", "parameters")
LONGEST = 36_000.0
"""[s]"""
OURS = {
    "sample_rate": "rates.sensors",
    "dither.seed": "the seed",
    "dither.enabled": "the command line",
    "states": "the plant",
    "effectors": "the plant",
}
"""Parameters of the identifier that a scenario does not set itself, and what does."""


LEAST_SAMPLES = 10
"""Of a flight."""


@dataclass(frozen=True)
class Scenario:
    """One flight: what is flown, what breaks, and the identifier that goes with it."""

    name: str
    description: str
    """One line."""
    condition: str
    """Of the aircraft."""
    manoeuvre: str
    """A name of `MANOEUVRES`, or segments of flight test separated by semicolons."""
    duration: float
    """[s]"""
    profile: str
    """Parameters of the identifier: a shipped profile, or the path of one."""
    noise: str = "low"
    """Of the sensors, where nothing else is asked for; a name of `NOISE_LEVELS`."""
    turbulence: str = "none"
    """A name of `TURBULENCE`."""
    rates: Rates = field(default_factory=Rates)
    faults: tuple[Fault, ...] = ()
    """In order of time."""
    watch: Watch = ROLL_POWER
    """The parameter whose error is followed."""
    parameters: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """What changes in the profile, by noise; nothing in the scenarios that ship but the dither of flight tests."""
    aircraft: AircraftData = field(default_factory=lambda: find_aircraft(DEFAULT))
    """What flies."""
    manoeuvre_scale: float = 1.0
    """Multiplies the inputs of flight test [1]."""
    gusts: float = 0.0
    """Rms of first-order gusts [m/s]."""
    instruments: Instruments | None = None
    """Sensors as they are on real aircraft."""
    law: LawChoice = field(default_factory=LawChoice)
    """Which control law flies."""
    random_failures: RandomFailures | None = None
    """Instead of `faults`: others with each seed."""

    @property
    def airframe(self) -> Airframe:
        """Of the aircraft."""
        return self.aircraft.airframe

    @property
    def flight_condition(self) -> FlightCondition:
        """Where it flies."""
        return self.aircraft.condition(self.condition)

    @property
    def flown(self) -> Manoeuvre:
        """What the pilot does."""
        return parse_manoeuvre(self.manoeuvre, self.airframe, self.manoeuvre_scale)

    @property
    def has_fault(self) -> bool:
        """Whether anything breaks."""
        return bool(self.faults) or self.random_failures is not None

    def faults_of(self, seed: int) -> tuple[Fault, ...]:
        """Return what breaks in the flight with a seed."""
        return self.faults if self.random_failures is None else self.random_failures.draw(seed, self.airframe)

    @property
    def fault_spans(self) -> tuple[tuple[float, float], ...]:
        """For each fault the time of the sample after which it strikes, and the end of its ramp [s]."""
        faults = self.faults_of(0)[:1] if self.random_failures is not None else self.faults
        starts = [(fault.sample(self.rates.period) / self.rates.sensors, fault.ramp) for fault in faults]
        return tuple((start, start + ramp) for start, ramp in starts)

    @property
    def fault_start(self) -> float | None:
        """When the first fault strikes [s]; None: nothing breaks."""
        return self.fault_spans[0][0] if self.has_fault else None

    @property
    def fault_end(self) -> float | None:
        """When everything that breaks has broken: the end of the last ramp [s]; None: nothing breaks."""
        return max(end for _, end in self.fault_spans) if self.has_fault else None

    def configuration(self, noise: str, seed: int, dither: bool) -> Configuration:
        """Return the identifier's configuration for a noise level, a seed, and with or without dither."""
        changes = {**self.parameters.get(noise, {}), "sample_rate": float(self.rates.sensors)}
        return read_profile(self.profile).replace({**changes, "dither.seed": seed, "dither.enabled": dither})

    def flight(self, noise: str, seed: int) -> Flight:
        """Return the flight without ROS for a noise level, and a seed of sensors and turbulence."""
        return Flight(
            noise,
            seed,
            self.duration,
            self.flown,
            self.faults_of(seed),
            self.flight_condition,
            self.turbulence,
            self.rates,
            instruments=self.instruments,
            gusts=self.gusts,
            law=self.law.plan,
            latency=self.law.latency,
            until_departure=self.law.law is not None,
        )


def shipped_names() -> tuple[str, ...]:
    """Return the names of the scenarios that ship, the paper's first."""
    found = {path.stem for path in (config_folder() / "scenarios").glob("*.yaml")}
    return (*(name for name in FIRST if name in found), *sorted(found - set(FIRST)))


def shipped() -> dict[str, Scenario]:
    """Read the scenarios that ship, by name, the paper's first."""
    return {name: find_scenario(name) for name in shipped_names()}


def listing() -> str:
    """Return a line for each scenario that ships, for --help."""
    found = shipped()
    width = max(len(name) for name in found)
    return "\n".join(f"  {name:<{width}}  {one.description}" for name, one in found.items())


def find_scenario(name: str | os.PathLike[str]) -> Scenario:
    """Read a scenario.

    Parameters
    ----------
    name
        Of a shipped one, or the path of a YAML file.

    Raises
    ------
    ScenarioError
        For a name that is not shipped, or a file that is wrong.
    """
    if Path(name).suffix in (".yaml", ".yml"):
        return read_scenario(Path(name))
    known = shipped_names()
    if str(name) not in known:
        message = f"scenario '{name}' does not exist; expected {suggestion(str(name), known)}, or a .yaml file"
        raise ScenarioError(message)
    return read_scenario(config_folder() / "scenarios" / f"{name}.yaml")


def read_scenario(file: Path) -> Scenario:
    """Read a scenario's file.

    Parameters
    ----------
    file
        Its name without the ending is the scenario's.

    Raises
    ------
    ScenarioError
        For a file that is missing or wrong; the sentence names file, key, what was found and what was expected.
    """
    top = Section(file, "", load(file), (*KEYS, *LAW_KEYS))
    description = top.text("description", "one line of text")
    aircraft = _read_aircraft(top)
    condition = top.word("condition", aircraft.condition_names, aircraft.condition_names[0])
    scale = top.number("manoeuvre_scale", -10.0, 10.0, "", 1.0)
    law = read_law(top)
    manoeuvre = _read_manoeuvre(top, aircraft.airframe, scale, law)
    duration = top.number("duration", 0.1, LONGEST, "s")
    profile, parameters = _read_identifier(top, aircraft.airframe)
    rates = _read_rates(top, aircraft.airframe)
    samples = round(duration / rates.period)
    if samples < LEAST_SAMPLES:
        least = f"at least {LEAST_SAMPLES} samples, {LEAST_SAMPLES * rates.period:g} s at {rates.sensors} Hz"
        top.refuse("duration", f"is {duration:g} s; expected {least}")
    return Scenario(
        file.stem,
        description,
        condition,
        manoeuvre,
        duration,
        profile,
        top.word("noise", NOISE_LEVELS, "low"),
        top.word("turbulence", TURBULENCE, "none"),
        rates,
        _read_faults(top, duration, rates.period, aircraft.airframe),
        _read_watch(top, aircraft.airframe.effectors),
        parameters,
        aircraft,
        scale,
        top.number("gusts", 0.0, 30.0, "m/s", 0.0),
        read_sensors(top),
        law,
        read_random_failures(top, duration, aircraft.airframe),
    )


def _read_aircraft(top: Section) -> AircraftData:
    name = top.text("aircraft", "a shipped aircraft or the path of a .yaml file", DEFAULT)
    try:
        return find_aircraft(name, top.file.parent)
    except ScenarioError as error:
        top.wrap("aircraft", error)


def _read_manoeuvre(top: Section, airframe: Airframe, scale: float, law: LawChoice) -> str:
    """Return a manoeuvre as a line: a word, or a list of segments."""
    value = top.get("manoeuvre", None, f"one of {', '.join(MANOEUVRES)}, or a list such as [quiet 10, elevator_3211 8]")
    if not isinstance(value, list):
        names = MANOEUVRES if airframe.model == OWN_MODEL or law.plan is not None else ("steady",)
        return top.word("manoeuvre", names)
    if law.plan is not None:
        top.refuse(
            "manoeuvre", f"is a list of inputs; expected one of {', '.join(MANOEUVRES)}, which law {law.law} flies"
        )
    text = "; ".join(map(str, value)) + ";"
    try:
        parse_manoeuvre(text, airframe, scale)
    except PlantError as error:
        top.wrap("manoeuvre", error)
    return text


def _read_rates(top: Section, airframe: Airframe) -> Rates:
    section = top.section("rates", RATES, {})
    default = Rates()
    values = {name: section.whole(name, 1, 1000, "Hz", getattr(default, name)) for name in RATES}
    least = airframe.least_rate
    if 50 <= values["flight_dynamics"] < least:
        found = f"is {values['flight_dynamics']} Hz"
        section.refuse("flight_dynamics", f"{found}; expected at least {least}, which {airframe.name} needs")
    try:
        return Rates(**values)
    except PlantError as error:
        section.refuse(first_word(error), rest(error))


def _read_faults(top: Section, duration: float, period: float, airframe: Airframe) -> tuple[Fault, ...]:
    faults = []
    for section in top.sections("faults", FAULT):
        effector = section.word("effector", dict.fromkeys((*airframe.surface_names, *airframe.effectors)))
        time = section.number("time", 0.0, LONGEST, "s")
        effectiveness = section.number("effectiveness", 0.0, 1.0, "(0 lost, 1 intact)")
        ramp = section.number("ramp", 0.0, 3600.0, "s", 0.0)
        bias = section.number("bias", -1.0, 1.0, "rad", 0.0)
        if time >= duration:
            section.refuse("time", f"is {time:g} s; expected less than the duration of the flight, {duration:g} s")
        try:
            driven = section.values.get("hard_over", "none") != "none"
            hard_over = section.number("hard_over", -1.0, 1.0, "rad, or none") if driven else None
            fault = Fault(effector, time, effectiveness, ramp, section.flag("stuck", False), bias, hard_over, airframe)
        except PlantError as error:
            section.refuse(first_word(error), rest(error))
        last = round(duration / period) - 1
        if fault.sample(period) >= last:
            latest = f"{(last - 1) * period:g} s or less, that a sample of the flight may feel it"
            section.refuse("time", f"is {time:g} s; expected {latest}")
        faults.append(fault)
    try:
        check_faults(faults)
    except PlantError as error:
        top.refuse(first_word(error), rest(error))
    return tuple(faults)


def _read_watch(top: Section, effectors: tuple[str, ...]) -> Watch:
    expected = f"ROW/COLUMN such as P/ddt: one of {' '.join(ROWS)}, and a state or an effector"
    default = ROLL_POWER if effectors == ROLL_POWER.effectors else Watch("Q", effectors[0], effectors)
    text = top.text("watch", expected, str(default))
    row, _, column = text.partition("/")
    if row not in ROWS or column not in (*STATES, *effectors):
        top.refuse("watch", f"is {shown(text)}; expected {expected} ({' '.join((*STATES, *effectors))})")
    return Watch(row, column, effectors)


def _read_identifier(top: Section, airframe: Airframe) -> tuple[str, dict[str, dict[str, Any]]]:
    section = top.section("identifier", IDENTIFIER)
    profile = section.text("profile", "a shipped profile or the path of a .yaml file")
    if Path(profile).suffix in (".yaml", ".yml"):
        profile = str((top.file.parent / profile).resolve())
    try:
        base = read_profile(profile)
    except EstimationError as error:
        section.wrap("profile", error)
    if base.states != STATES or base.effectors != airframe.effectors:
        names = " ".join((*base.states, *base.effectors))
        section.refuse(
            "profile", f"has {names}; expected those of the plant, {' '.join((*STATES, *airframe.effectors))}"
        )
    given = section.section("parameters", (), {})
    known = as_mapping(base)
    heads = {*known, *(name.split(".")[0] for name in known), *NOISE_LEVELS}
    for name in given.values:
        if name not in heads:
            expected = f"a parameter of the identifier, or a noise: {suggestion(name, heads)}"
            given.refuse(name, f"is unknown; expected {expected}")
    always = _read_changes(given, base, {})
    return profile, {
        level: _read_changes(given.section(level, (), {}), base, always) if level in given.values else always
        for level in NOISE_LEVELS
        if always or level in given.values
    }


def _read_changes(section: Section, base: Configuration, always: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters of the identifier by full name, that the profile takes; what goes with a noise comes last."""
    known = as_mapping(base)
    changes: dict[str, Any] = {}
    for name, value in _flat(section):
        if name in changes:
            section.refuse(name, "stands there twice, dotted and in a section; expected once")
        changes[name] = value
    for name, value in changes.items():
        if name in OURS:
            section.refuse(name, f"is {shown(value)}; expected none, {OURS[name]} gives it")
        if name not in known:
            section.refuse(name, f"is unknown; expected a parameter of the identifier: {suggestion(name, known)}")
        try:
            base.replace({name: value})
        except EstimationError as error:
            section.wrap(name, error)
    changes = {**always, **changes}
    try:
        base.replace(changes)
    except EstimationError as error:
        section.wrap("", error)
    return changes


def _flat(section: Section) -> Iterator[tuple[str, Any]]:
    """Yield parameters by full name, whether written ``estimator.penalty`` or in a section ``estimator``."""
    for name, value in section.values.items():
        if name in NOISE_LEVELS:
            continue
        if isinstance(value, Mapping):
            inner = section.section(name)
            yield from ((f"{name}.{leaf}", one) for leaf, one in _flat(inner))
        else:
            yield name, value
