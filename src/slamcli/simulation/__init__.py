# SPDX-License-Identifier: MIT
"""Worlds, robots, sensors and people that make recordings with a known truth."""

from slamcli.simulation.contact import Contact
from slamcli.simulation.message import Message
from slamcli.simulation.parameters import SimulationParameters, resolve_settings
from slamcli.simulation.plant import Plant
from slamcli.simulation.simulate import Simulation
from slamcli.simulation.world import Walker, World
from slamcli.simulation.world_file import is_world_file, load_world

__all__ = [
    "Contact",
    "Message",
    "Plant",
    "Simulation",
    "SimulationParameters",
    "Walker",
    "World",
    "is_world_file",
    "load_world",
    "resolve_settings",
]
