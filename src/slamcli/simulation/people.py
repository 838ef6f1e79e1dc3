# SPDX-License-Identifier: MIT
"""People that walk through the world, see the robot, and are seen by its scanner."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slamcli.simulation.drive import Motion
from slamcli.simulation.free_space import FreeSpace
from slamcli.simulation.parameters import SimulationParameters
from slamcli.simulation.ride import Ride
from slamcli.simulation.world import Walker, World

Array = NDArray[np.float64]

STEP_S = 0.05
BODY_RADIUS_M = 0.22
LEG_RADIUS_M = 0.06
LEGS_APART_M = 0.22
_HIP_M = 0.8
_TALL_M = 1.75
STRIDE_M = 0.7  # half a cycle of one leg: the way per step
_ROOM_M = 0.3
_WAIT_BEFORE_ROBOT_M = 0.9
_STEP_ASIDE_M = 0.25


class Crowd:
    """Everybody's way, walked beforehand in steps of 50 ms; `discs` gives what a scanner meets."""

    def __init__(
        self, world: World, motion: Motion, parameters: SimulationParameters, seeds: list[np.random.Generator]
    ) -> None:
        self._shape = parameters.people_shape
        self._tracks: Array = np.zeros((0, 2, 3))
        if not world.walkers and not parameters.people_count:
            return
        space = FreeSpace(world, _ROOM_M)
        robot = motion.at(np.arange(0.0, motion.duration_s + 2 * STEP_S, STEP_S))[:, :2]
        keep = parameters.robot_radius + BODY_RADIUS_M
        tracks = []
        for walker, rng in zip(world.walkers, seeds, strict=False):
            tracks.append(_walk(_to_and_fro(walker, space), walker.speed_m_s, robot, keep, space, rng))
        for rng in seeds[len(world.walkers) :]:
            speed = parameters.people_speed * float(rng.uniform(0.8, 1.2))
            way = _random_places(space, motion.poses[0, :2], speed * motion.duration_s + 1.0, rng)
            tracks.append(_walk(way, speed, robot, keep, space, rng))
        self._tracks = np.stack(tracks)

    @property
    def tracks(self) -> tuple[Array, ...]:
        """Position and walked way (T, 3) of everybody, metres, every 50 ms."""
        return tuple(self._tracks)

    def discs(self, time_s: float) -> Array:
        """Return discs (D, 5) x, y, radius (metres, map frame) and their velocity, at `time_s` from the start."""
        if not len(self._tracks):
            return np.zeros((0, 5))
        now, later = self._places(time_s), self._places(time_s + STEP_S)
        radius = LEG_RADIUS_M if self._shape == "legs" else BODY_RADIUS_M
        return np.column_stack([now, np.full(len(now), radius), (later - now) / STEP_S])

    def bodies(self, time_s: float, ride: Ride) -> Array:
        """Return upright cylinders (B, 7) x, y, radius, vx, vy, low, high (metres, map frame) at `time_s` from the start."""
        discs = self.discs(time_s)
        if self._shape == "legs" and len(discs):
            trunks = (discs[0::2] + discs[1::2]) / 2
            trunks[:, 2] = BODY_RADIUS_M
            heights = [[0.0, _HIP_M]] * len(discs) + [[_HIP_M, _TALL_M]] * len(trunks)
            discs = np.concatenate([discs, trunks])
        else:
            heights = [[0.0, _TALL_M]] * len(discs)
        ground = ride.ground_at(discs[:, :2])
        return np.column_stack([discs, np.array(heights).reshape(-1, 2) + ground[:, None]])

    def _places(self, time_s: float) -> Array:
        """Return the centres (P or 2 P, 2) of what of everybody touches the plane of the scanner."""
        last = self._tracks.shape[1] - 1
        at = min(max(time_s / STEP_S, 0.0), last - 0.000001)
        i, share = int(at), at - int(at)
        here = self._tracks[:, i] * (1 - share) + self._tracks[:, i + 1] * share
        if self._shape == "disc":
            return here[:, :2]
        ahead = self._tracks[:, min(i + 10, last), :2] - self._tracks[:, max(i - 10, 0), :2]
        length = np.hypot(ahead[:, 0], ahead[:, 1])[:, None]
        forward = np.where(length > 1e-3, ahead / np.maximum(length, 1e-3), [1.0, 0.0])
        left = np.column_stack([-forward[:, 1], forward[:, 0]])
        swing = 0.5 * STRIDE_M * 0.6 * np.sin(math.pi * here[:, 2:] / STRIDE_M)
        leg = left * LEGS_APART_M / 2 + forward * swing
        return np.stack([here[:, :2] + leg, here[:, :2] - leg], axis=1).reshape(-1, 2)


def _to_and_fro(walker: Walker, space: FreeSpace) -> Array:
    """Return one closed way through the walker's points and back."""
    points = np.concatenate([walker.points, walker.points[-2::-1]])
    way = [points[0]]
    for point in points[1:]:
        way.extend([point] if space.is_clear(way[-1], point, 0.0) else space.way(way[-1], point)[1:])
    return np.array(way)


def _random_places(space: FreeSpace, near: Array, length_m: float, rng: np.random.Generator) -> Array:
    """Return a way of at least `length_m` between places that can be reached from the robot's start."""
    places = space.places(near)
    way, length = [places[rng.integers(0, len(places))]], 0.0
    while length < length_m:
        leg = space.way(way[-1], places[rng.integers(0, len(places))])[1:]
        length += float(np.linalg.norm(np.diff(np.array([way[-1], *leg]), axis=0), axis=1).sum()) + 0.01
        way.extend(leg)
    return np.array(way)


def _walk(
    way: Array, speed_m_s: float, robot: Array, keep_m: float, space: FreeSpace, rng: np.random.Generator
) -> Array:
    """Return position and walked way (T, 3): along `way` over and over, waiting for the robot and stepping aside."""
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))])
    track = np.empty((len(robot), 3))
    at = float(rng.uniform(0.0, min(lengths[-1], 2.0)))
    aside = np.zeros(2)
    for k, machine in enumerate(robot):
        on_way = np.array([np.interp(at % lengths[-1], lengths, way[:, i]) for i in (0, 1)])
        aside *= 0.95  # back to the way over about a second
        gap = on_way + aside - machine
        far = float(np.hypot(*gap))
        if far < keep_m + _STEP_ASIDE_M:
            push = gap / far if far > 1e-6 else np.array([1.0, 0.0])
            moved = aside + push * min(keep_m + _STEP_ASIDE_M - far, 0.1)
            if space.room((on_way + moved)[None])[0] > BODY_RADIUS_M:
                aside = moved
        track[k] = *(on_way + aside), at
        coming = np.array([np.interp((at + 0.3) % lengths[-1], lengths, way[:, i]) for i in (0, 1)])
        nearer = float(np.hypot(*(coming - machine))) < far
        if far > _WAIT_BEFORE_ROBOT_M or not nearer:
            at += speed_m_s * STEP_S
    return track
