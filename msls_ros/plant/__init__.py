"""The plant: an F-16 with thrust vectoring (F-16/MATV) over JSBSim, with sensors, damage, truth and a pilot.

SI units and radians. This room imports jsbsim and no other room. Begin with `aircraft.Aircraft`; `airframe` tells how
the aircraft is derived and what it leaves out.
"""

from msls_ros.plant.aircraft import Aircraft
from msls_ros.plant.airframe import ACTUATORS, SURFACE_ACTUATORS
from msls_ros.plant.conditions import CONDITIONS, FlightCondition
from msls_ros.plant.faults import Fault, FaultSchedule, check_faults
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
    "CONDITIONS",
    "EFFECTORS",
    "MANOEUVRES",
    "NOISE_LEVELS",
    "PILOT_STATION",
    "STATES",
    "SURFACES",
    "SURFACES_OF",
    "SURFACE_ACTUATORS",
    "TURBULENCE",
    "Actuator",
    "Aircraft",
    "Fault",
    "FaultSchedule",
    "FlightCondition",
    "LinearTruth",
    "Manoeuvre",
    "NoiseLevel",
    "Pilot",
    "PlantError",
    "RollDoublet",
    "Sample",
    "Sensors",
    "Steady",
    "StrongManoeuvre",
    "Trim",
    "actuator_gain",
    "check_faults",
    "find_trim",
]
