"""The plant: any JSBSim aircraft, and an F-16 with thrust vectoring, with sensors, damage, truth and a pilot.

SI units and radians. This room imports jsbsim and no other room. Begin with `aircraft.Aircraft`; `definition` says
what an aircraft is as data, `derive` how it is made of a JSBSim model, `airframe` the same of the F-16/MATV.
"""

from msls_ros.plant.aircraft import Aircraft
from msls_ros.plant.airframe import ACTUATORS, F16_MATV, SURFACE_ACTUATORS
from msls_ros.plant.attitude_pilot import AnyPilot, make_pilot
from msls_ros.plant.conditions import CONDITIONS, FlightCondition
from msls_ros.plant.definition import OPEN_LOOP, OWN_MODEL, Airframe, AttitudeHold, Surface
from msls_ros.plant.derive import digest_of
from msls_ros.plant.faults import Fault, FaultSchedule, check_faults
from msls_ros.plant.flight_test import KINDS, FlightTest, Segment, multisines, parse_manoeuvre, peak_factor
from msls_ros.plant.instruments import (
    CHANNELS,
    SUITES,
    Instruments,
    instrument_lines,
    make_sensors,
    parse_instruments,
)
from msls_ros.plant.interface import (
    EFFECTORS,
    PILOT_STATION,
    STATES,
    SURFACES,
    SURFACES_OF,
    TURBULENCE,
    Actuator,
    LinearTruth,
    PlantError,
    Sample,
    actuator_gain,
)
from msls_ros.plant.manoeuvres import MANOEUVRES, Manoeuvre, RollDoublet, Steady, StrongManoeuvre
from msls_ros.plant.pilot import Pilot
from msls_ros.plant.sensors import NOISE_LEVELS, NoiseLevel, Sensors
from msls_ros.plant.trim import Trim, find_trim

__all__ = [
    "ACTUATORS",
    "CHANNELS",
    "CONDITIONS",
    "EFFECTORS",
    "F16_MATV",
    "KINDS",
    "MANOEUVRES",
    "NOISE_LEVELS",
    "OPEN_LOOP",
    "OWN_MODEL",
    "PILOT_STATION",
    "STATES",
    "SUITES",
    "SURFACES",
    "SURFACES_OF",
    "SURFACE_ACTUATORS",
    "TURBULENCE",
    "Actuator",
    "Aircraft",
    "Airframe",
    "AnyPilot",
    "AttitudeHold",
    "Fault",
    "FaultSchedule",
    "FlightCondition",
    "FlightTest",
    "Instruments",
    "LinearTruth",
    "Manoeuvre",
    "NoiseLevel",
    "Pilot",
    "PlantError",
    "RollDoublet",
    "Sample",
    "Segment",
    "Sensors",
    "Steady",
    "StrongManoeuvre",
    "Surface",
    "Trim",
    "actuator_gain",
    "check_faults",
    "digest_of",
    "find_trim",
    "instrument_lines",
    "make_pilot",
    "make_sensors",
    "multisines",
    "parse_instruments",
    "parse_manoeuvre",
    "peak_factor",
]
