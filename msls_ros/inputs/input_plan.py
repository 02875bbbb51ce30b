"""Where every number comes from: checked once, before a message is read; the sentences name what is missing."""

from __future__ import annotations

from collections.abc import Mapping

from msls_ros.estimation.errors import EstimationError, nearest
from msls_ros.inputs.field_paths import listed
from msls_ros.inputs.input_map import AIR_DATA, VECTORS, WIND, InputMap

_ANGLES = ("Phi", "Theta", "Psi")
_VELOCITY = ("u", "v", "w")
_RATES = ("P", "Q", "R")


def plan(inputs: InputMap, states: tuple[str, ...], effectors: tuple[str, ...]) -> dict[str, str]:
    """Check that everything comes from one place; return the derivative's method per state."""
    given = _given(inputs)
    for name in [*states, *(f"effectors.{e}" for e in effectors)]:
        if name not in given:
            entry = name if name.startswith("effectors.") else f"states.{name}"
            vector = next((f" or inputs.{v}" for v, names in VECTORS.items() if name in names), "")
            message = f"'{name}' comes from nowhere: give inputs.{entry}{vector}"
            raise EstimationError(message)
    unused = [n for n in inputs.streams if n.startswith("effectors.") and n[10:] not in effectors]
    unused += [n for n in inputs.streams if n.startswith("derivatives.") and n[12:] not in states]
    if unused:
        message = f"inputs.{unused[0]}: the identifier has no such name; states are {listed(states)}, "
        close = nearest(unused[0].partition(".")[2], (*states, *effectors))
        raise EstimationError(f"{message}effectors {listed(effectors)}{close}")
    kinematic = {*_RATES, "Phi", "Theta"} <= given.keys()
    velocity = inputs.streams.get("velocity")
    needs = {"specific_force": {*_RATES, *_VELOCITY, "Phi", "Theta"}}
    if velocity is not None and velocity.earth:
        needs["velocity"] = set(_ANGLES)
    needs[WIND] = {*_ANGLES, *_VELOCITY}
    needs["airspeed"] = set(_RATES) if any(inputs.vane_position) else set()
    if any(inputs.vane_position) and "alpha" not in inputs.streams:
        message = "inputs.vane_position is given, but no inputs.airspeed, alpha and beta"
        raise EstimationError(message)
    for name, needed in needs.items():
        missing = sorted(needed - given.keys())
        if name in inputs.streams and missing:
            message = f"inputs.{name} cannot be used without {listed(missing)}: map them too, or leave it out"
            raise EstimationError(message)
    methods = {}
    for name in states:
        if f"derivatives.{name}" in given or f"d{name}" in given:
            methods[name] = "measured"
        elif name in _VELOCITY and "specific_force" in inputs.streams:
            methods[name] = "accelerometer"
        else:
            methods[name] = "kinematics" if name in _ANGLES and kinematic else "differentiated"
    return methods


def _given(inputs: InputMap) -> dict[str, str]:
    """Return what is mapped, by the name of the number, and the entry that maps it."""
    given: dict[str, str] = {}
    air = [name for name in AIR_DATA if name in inputs.streams]
    alone = air == ["airspeed"] and not {"velocity", "states.u"}.isdisjoint(inputs.streams)  # `inspect` compares it
    if air and len(air) < len(AIR_DATA) and not alone:
        missing = [name for name in AIR_DATA if name not in air]
        message = f"inputs.{air[0]} cannot be used without {listed(missing)}: map them too, or use inputs.velocity"
        raise EstimationError(message)
    gives = {**VECTORS, **dict.fromkeys(AIR_DATA, ()), "airspeed": () if alone else _VELOCITY, WIND: ()}
    for name in inputs.streams:
        for number in gives.get(name, (name.removeprefix("states."),)):
            if number in given:
                message = f"'{number}' comes from both inputs.{given[number]} and inputs.{name}: leave one out"
                raise EstimationError(message)
            given[number] = name
    return given


def arm(inputs: InputMap, methods: Mapping[str, str]) -> tuple[float, float, float]:
    """Return where the accelerometer is from the centre of mass; refuse a place that nothing is measured at."""
    if any(inputs.imu_position) and "accelerometer" not in methods.values():
        message = "inputs.imu_position is given, but no derivative is made from inputs.specific_force"
        raise EstimationError(message)
    return inputs.imu_position
