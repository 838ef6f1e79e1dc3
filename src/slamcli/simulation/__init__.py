# SPDX-License-Identifier: MIT
"""Worlds, robots, sensors and people that make recordings with a known truth."""

from slamcli.simulation.message import Message
from slamcli.simulation.parameters import SimulationParameters, resolve_settings
from slamcli.simulation.simulate import Simulation
from slamcli.simulation.world import Walker, World
from slamcli.simulation.world_file import is_world_file, load_world

__all__ = [
    "Message",
    "Simulation",
    "SimulationParameters",
    "Walker",
    "World",
    "is_world_file",
    "load_world",
    "resolve_settings",
]
