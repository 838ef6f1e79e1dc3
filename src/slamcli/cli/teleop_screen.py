# SPDX-License-Identifier: MIT
"""A person at the keyboard drives a simulated robot: keys in, picture out, in step with the clock on the wall."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from slamcli.cli.teleop_keys import Teleoperator, keys_of
from slamcli.cli.terminal import Terminal
from slamcli.grids import OccupancyGrid
from slamcli.grids.crop import crop, known_box
from slamcli.pipelines.teleop_robot import TeleopRobot
from slamcli.reports.terminal_picture import TerminalScene, draw_terminal

_FRAME_S = 0.1
_SLICE_S = 0.05
_LATE_S = 0.5
_HELP = (
    "u i o   SHIFT: strafe   q/z both speeds +-10 %   k or any other key: stop",
    "j k l                   w/x linear, e/c angular",
    "m , .                   CTRL-C: end and save",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Pace:
    """How a drive keeps time."""

    speed: float = 1.0
    """Simulated over real time."""
    key_timeout_s: float = 0.0
    """The robot stops so long (real time) after the last key; 0: it goes on until another key."""
    max_time_s: float = math.inf
    """Simulated seconds after which the drive ends."""


def drive_by_keys(
    robot: TeleopRobot,
    terminal: Terminal,
    pace: Pace,
    world_map: OccupancyGrid,
    clock: Callable[[], float] = time.monotonic,
) -> None:
    """Let somebody drive until CTRL-C, a signal, the end of the terminal or of the time.

    Without a system that maps, `world_map` is drawn. Where the machine is too slow, simulated time falls behind and does not
    catch up.
    """
    driver, pressed_at, drawn_at = Teleoperator(), clock(), -math.inf
    picture = _Picture(world_map)
    anchor = clock() - robot.time_s / pace.speed
    while not (driver.ended or terminal.ended) and robot.time_s < pace.max_time_s:
        now = clock()
        if now - drawn_at >= _FRAME_S:
            terminal.show(draw_terminal(picture.scene(robot, driver), *terminal.size))
            drawn_at = now
        before = driver
        for key in keys_of(terminal.read(max(_SLICE_S - (clock() - now), 0.0))):
            driver, pressed_at = driver.pressed(key), clock()
        if pace.key_timeout_s and clock() - pressed_at > pace.key_timeout_s:
            driver = replace(driver, move=(0, 0, 0))
        if driver.twist != before.twist:
            robot.command(np.array(driver.twist))
        target = (clock() - anchor) * pace.speed
        if target - robot.time_s > _LATE_S * pace.speed:
            target = robot.time_s + _LATE_S * pace.speed
            anchor = clock() - target / pace.speed
        robot.advance_to(min(target, pace.max_time_s))
    last = replace(picture.scene(robot, driver), below=("saving ...",))
    terminal.show(draw_terminal(last, *terminal.size))


class _Picture:
    """Remembers what part of the newest map is known."""

    def __init__(self, world_map: OccupancyGrid) -> None:
        self._world_map = _known_part(world_map)
        self._newest: OccupancyGrid | None = None
        self._shown: OccupancyGrid | None = None

    def scene(self, robot: TeleopRobot, driver: Teleoperator) -> TerminalScene:
        """Return what is to be drawn."""
        maps = robot.localiser is not None
        if robot.grid is not self._newest:
            self._newest = robot.grid
            self._shown = None if robot.grid is None else _known_part(robot.grid)
        return TerminalScene(
            grid=self._shown if maps else self._world_map,
            pose=robot.pose,
            radius_m=robot.plant.parameters.robot_radius,
            beam_ends=robot.seen_m,
            discs=np.zeros((0, 5)) if maps else robot.plant.discs(),  # who maps sees only what the scanner does
            above=(_status(robot),),
            below=(f"speed {driver.speed:.2f} m/s   turn {driver.turn:.2f} rad/s", *_HELP),
        )


def _status(robot: TeleopRobot) -> str:
    x, y, yaw = robot.pose.tolist()
    forward, left, turn = robot.plant.twist.tolist()
    touched = len(robot.plant.collisions)
    parts = [
        f"{robot.time_s:6.1f} s", f"{math.copysign(math.hypot(forward, left), forward):+.2f} m/s {turn:+.2f} rad/s",
        f"x {x:.2f} y {y:.2f} {math.degrees(yaw):.0f} deg", f"{robot.length_m:.1f} m driven",
    ]  # fmt: skip
    if robot.plant.clearance_m <= 0.0:
        parts.append("TOUCHING")
    elif touched:
        parts.append(f"{touched} contact{'s' if touched != 1 else ''}")
    return "   ".join(parts)


def _known_part(grid: OccupancyGrid) -> OccupancyGrid:
    box = known_box(grid)
    return grid if box is None else crop(grid, box)
