# SPDX-License-Identifier: MIT
"""How the robot moves: along its route or at random, within its limits, clear of walls."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import ConfigError, UsageError
from slamcli.geometry.se2 import wrap_angle
from slamcli.simulation import _drive_kernels, raycast
from slamcli.simulation.free_space import FreeSpace
from slamcli.simulation.parameters import SimulationParameters
from slamcli.simulation.world import World

Array = NDArray[np.float64]

TICK_S = 0.01
"""Step of the simulated motion; between ticks it is interpolated linearly."""
_PATH_STEP_M = 0.02
_SPARE_S = 1.0
_MAX_DURATION_S = 86_400.0
_CANDIDATES = 30
_CAUTIONS = (1.0, 0.5, 0.25, 0.1)
"""Shares of lookahead and (root of) speed with which a random way is tried until the robot keeps clear of walls."""


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Where the robot truly was at every tick."""

    poses: Array
    """float64 (T, 3), x, y, yaw of base_link in map; metres, radians; the yaw is not wrapped."""
    speeds: Array
    """float64 (T, 2), forward m/s and turn rad/s."""

    @property
    def times_s(self) -> Array:
        """float64 (T,), seconds from the start."""
        return np.arange(len(self.poses), dtype=np.float64) * TICK_S

    @property
    def duration_s(self) -> float:
        """Seconds from the first tick to the last."""
        return (len(self.poses) - 1) * TICK_S

    @property
    def length_m(self) -> float:
        """Way that was driven."""
        return float(np.linalg.norm(np.diff(self.poses[:, :2], axis=0), axis=1).sum())

    def at(self, times_s: Array) -> Array:
        """Return poses (N, 3) at `times_s` (N,), seconds from the start, held beyond both ends."""
        return _interpolated(self.poses, times_s)

    def speeds_at(self, times_s: Array) -> Array:
        """Return forward and turn speed (N, 2) at `times_s` (N,)."""
        return _interpolated(self.speeds, times_s)


def _interpolated(values: Array, times_s: Array) -> Array:
    at = np.clip(np.asarray(times_s) / TICK_S, 0.0, len(values) - 1)
    before = np.minimum(at.astype(np.int64), max(len(values) - 2, 0))
    share = (at - before)[:, None]
    return values[before] * (1 - share) + values[np.minimum(before + 1, len(values) - 1)] * share


def drive(world: World, parameters: SimulationParameters, duration_s: float | None, rng: np.random.Generator) -> Motion:
    """Return the robot's motion.

    Parameters
    ----------
    world
        With waypoints: they are driven through in order, straight where there is room, else around what is in the way.
        Without: the robot drives at random, preferring places where it has not been.
    parameters
        Limits of the robot.
    duration_s
        Length of the recording; None: as long as the route takes (random: 120 s).
    rng
        Draws of the random drive.

    Raises
    ------
    PlanningError
        If there is no way.
    ConfigError
        If the robot would hit a wall; the message says where and when.
    UsageError
        If the recording would be longer than a day.
    """
    if duration_s is not None and duration_s > _MAX_DURATION_S:
        raise UsageError(f"a duration of {duration_s:.0f} s is too long: one recording holds at most a day")
    space = FreeSpace(world, parameters.robot_radius + parameters.robot_margin)
    start = start_pose(world, space)
    if len(world.waypoints):
        path = _route(world, space, start[:2], parameters)
    else:
        duration_s = 120.0 if duration_s is None else duration_s
        path = _random_way(space, start[:2], parameters.robot_speed * duration_s, rng)
        if world.start is None:
            start[2] = math.atan2(*(path[1] - path[0])[::-1])
    hit = 0
    cautions = (1.0,) if len(world.waypoints) else _CAUTIONS
    for caution in cautions:
        careful = dataclasses.replace(
            parameters,
            robot_lookahead=max(parameters.robot_lookahead * caution, 0.05),
            robot_speed=parameters.robot_speed * math.sqrt(caution),
        )
        motion = _follow(path, start, careful, duration_s, world.name)
        touched = _first_hit(world, space, motion, parameters.robot_radius)
        if touched is None:
            return motion
        hit = touched
    x, y, yaw = motion.poses[hit]
    raise ConfigError(
        f"world {world.name}: the robot (robot.radius {parameters.robot_radius:g} m) hits a wall at {x:.2f}, {y:.2f} (heading "
        f"{math.degrees(float(wrap_angle(yaw))):.0f} deg) after {hit * TICK_S:.1f} s: move start or waypoints away from it, "
        "or give a shorter robot.lookahead"
    )


def start_pose(world: World, space: FreeSpace) -> Array:
    """Return where the robot starts, (3,)."""
    if world.start is not None:
        return np.array(world.start)
    if len(world.waypoints):
        ahead = world.waypoints[1] - world.waypoints[0]
        return np.array([*world.waypoints[0], math.atan2(ahead[1], ahead[0])])
    return np.array([*space.roomiest(), 0.0])


def _route(world: World, space: FreeSpace, start: Array, parameters: SimulationParameters) -> Array:
    stops = np.tile(world.waypoints, (world.rounds, 1))
    straight = parameters.robot_radius + parameters.robot_margin / 2
    way = [start]
    for stop in stops:
        if np.linalg.norm(stop - way[-1]) > 1e-6:
            clear = space.is_clear(way[-1], stop, straight)
            way.extend([stop] if clear else space.way(way[-1], stop)[1:])
    return np.array(way)


def _random_way(space: FreeSpace, start: Array, length_m: float, rng: np.random.Generator) -> Array:
    """Return a way of at least `length_m` through places that are far from all that it has passed."""
    places = space.places(start)
    seen = np.full(len(places), np.inf)
    way, length = [start], 0.0
    while length < length_m:
        drawn = rng.integers(0, len(places), _CANDIDATES)
        far = np.linalg.norm(places[drawn] - way[-1], axis=1)
        gain = np.minimum(seen[drawn], 5.0) - 0.15 * far - np.where(far < 1.0, 10.0, 0.0)
        leg = space.way(way[-1], places[drawn[np.argmax(gain)]])[1:]
        for point in leg:
            length += float(np.linalg.norm(point - way[-1]))
            seen = np.minimum(seen, _distances_to_line(places, way[-1], point))
            way.append(point)
        if len(places) < 2:
            break
    if length == 0.0:
        raise UsageError(f"world {space.world_name}: there is no room to drive around {start[0]:.2f}, {start[1]:.2f}")
    return np.array(way)


def _distances_to_line(points: Array, a: Array, b: Array) -> Array:
    along = np.clip((points - a) @ (b - a) / max(float((b - a) @ (b - a)), 1e-12), 0.0, 1.0)
    return np.linalg.norm(points - (a + along[:, None] * (b - a)), axis=1)


def _follow(way: Array, start: Array, parameters: SimulationParameters, duration_s: float | None, name: str) -> Motion:
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))])
    at = np.arange(0.0, lengths[-1], _PATH_STEP_M)
    path = np.column_stack([np.interp(at, lengths, way[:, i]) for i in (0, 1)])
    path = np.concatenate([path, way[-1:]])
    p = parameters
    if duration_s is None:
        corners = len(way) * (2 * math.pi / p.robot_turn_rate + 2 * p.robot_speed / p.robot_acceleration + 5)
        ticks = int(min(3 * lengths[-1] / p.robot_speed + corners + p.robot_rest + 60, _MAX_DURATION_S) / TICK_S)
    else:
        ticks = round(duration_s / TICK_S) + 1
    states = np.zeros((ticks, 5))
    states[0, :3] = start
    limits = (
        p.robot_speed, p.robot_acceleration, p.robot_turn_rate, p.robot_turn_acceleration,
        max(p.robot_lookahead / _PATH_STEP_M, 2.0),
    )  # fmt: skip
    spare = round(_SPARE_S / TICK_S) if duration_s is None else ticks
    caps = _corner_caps(way, lengths, np.append(at, lengths[-1]), parameters)
    used = _drive_kernels.follow(path, caps, limits, round(p.robot_rest / TICK_S), spare, TICK_S, states)
    if used < 0 and duration_s is None:
        raise ConfigError(
            f"world {name}: the robot does not get to the end of its route: it is at {states[-1, 0]:.2f}, "
            f"{states[-1, 1]:.2f} after {ticks * TICK_S:.0f} s; give a lower robot.lookahead, fewer rounds, or --duration"
        )
    states = states[: abs(used)]
    return Motion(states[:, :3].copy(), states[:, 3:].copy())


def _corner_caps(way: Array, lengths: Array, at: Array, parameters: SimulationParameters) -> Array:
    """Return the speeds (N,) at path lengths `at` from which the robot can slow down for every corner of `way` ahead.

    A corner is rounded on the circle that touches both legs half a lookahead from it.
    """
    p = parameters
    steps = np.diff(way, axis=0)
    headings = np.arctan2(steps[:, 1], steps[:, 0])
    bends = np.abs(wrap_angle(np.diff(headings)))
    radii = p.robot_lookahead / 2 / np.maximum(np.tan(np.minimum(bends, 3.0) / 2), 1e-6)
    speeds = np.clip(0.7 * p.robot_turn_rate * radii, 0.1, p.robot_speed)
    braking = 2 * 0.7 * p.robot_acceleration
    squares = np.append(speeds**2 + braking * lengths[1:-1], np.inf)
    ahead = np.minimum.accumulate(squares[::-1])[::-1]
    following = np.searchsorted(lengths[1:-1], at, side="left")
    return np.sqrt(np.maximum(ahead[following] - braking * at, 0.0))


def _first_hit(world: World, space: FreeSpace, motion: Motion, radius_m: float) -> int | None:
    """Return the first checked tick (every fifth is) at which the robot touches a wall, None if it never does."""
    poses = motion.poses[::5]
    room = raycast.clearance(world, poses[:, :2])
    if world.grid is not None:
        room = np.minimum(room, space.room(poses[:, :2]))
    hits = np.flatnonzero(room < radius_m)
    return int(hits[0]) * 5 if len(hits) else None


def warm() -> None:
    """Compile the kernel of this module."""
    states = np.zeros((3, 5))
    _drive_kernels.follow(
        np.array([[0.0, 0.0], [0.02, 0.0]]), np.ones(2), (1.0, 1.0, 1.0, 1.0, 2.0), 0, 1, TICK_S, states
    )
