"""Actuators of soft robots: cables and chambers of a case, placed on a mesh, and their control."""

from shared_schema.actuators.actuator import Actuator, Cable, Chamber, actuators_of
from shared_schema.actuators.control import KINDS, UNITS, Actuated, Control, pressed
from shared_schema.actuators.placed_actuators import PlacedActuators, placed_actuators

__all__ = [
    "KINDS",
    "UNITS",
    "Actuated",
    "Actuator",
    "Cable",
    "Chamber",
    "Control",
    "PlacedActuators",
    "actuators_of",
    "placed_actuators",
    "pressed",
]
