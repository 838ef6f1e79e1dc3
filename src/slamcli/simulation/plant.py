# SPDX-License-Identifier: MIT
"""A simulated robot that obeys velocities: the part of a closed loop that is not software on a real robot."""

from __future__ import annotations

import math
import zlib

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import UsageError
from slamcli.grids import OccupancyGrid
from slamcli.measurements import LaserScan, Odometry
from slamcli.simulation import _plant_kernels
from slamcli.simulation.body import Body
from slamcli.simulation.contact import Contact
from slamcli.simulation.drive_limits import drive_limits, odometry_errors
from slamcli.simulation.live_scanner import LiveScanner, poses_at
from slamcli.simulation.parameters import SimulationParameters, resolve_settings
from slamcli.simulation.site import site_of
from slamcli.simulation.social_force import STEP_S
from slamcli.simulation.traffic import Traffic
from slamcli.simulation.world import World

Array = NDArray[np.float64]

TICK_S = 0.01
ODOM_FRAME, ODOM_TOPIC = "odom", "/odom"
_HISTORY_S = 2.56
_MOST_COMMANDS = 4096
_MOST_EVENTS = 256
_FARTHEST_CLEARANCE_M = 3.0
_TICK_NS = 10_000_000
_STEP_TICKS = round(STEP_S / TICK_S)


class Plant:
    """A robot in a world; it stands until `command`, and time stands until `advance`.

    Everything is drawn as time goes, each sensor from its own stream, which depends on the seed and the sensor's name
    only: people change neither the noise of scans nor that of odometry. The plan is flat: worlds with `relief` count with
    what stands on the floor.
    """

    def __init__(
        self,
        world: World,
        parameters: SimulationParameters,
        *,
        start: Array,
        seed: int = 0,
        odometry_start: Array | None = None,
    ) -> None:
        """Place the robot at `start` (3,): x, y (metres) and yaw (radians) of base_link in the map.

        `odometry_start` (3,) is what odometry says there; None: the origin.

        Raises
        ------
        UsageError
            If `start` is not finite or lies in a wall, or the limits of ranges make no sense.
        ConfigError
            If `robot.footprint` is no outline.
        """
        p = parameters
        self.world, self.parameters, self._seed = world, parameters, seed
        self._walls = site_of(world).walls()
        self._barriers = self._walls if p.robot_unknown_is_floor else site_of(world).walls(unknown_is_wall=True)
        self._body = Body(p)
        self._state, self._counters = np.zeros(16), np.zeros(5, np.int64)
        self._queue, self._wanted = np.zeros((_MOST_COMMANDS, 4)), np.zeros(3)
        self._history = np.zeros((round(_HISTORY_S / TICK_S), 6))
        self._events = np.zeros((_MOST_EVENTS, 6))
        self._limits, self._told = drive_limits(p), odometry_errors(p, TICK_S)
        self._slips = p.slip_rate > 0.0 or p.slip_drift > 0.0
        self._no_slips = np.zeros((256, 3))
        self._scanner = LiveScanner(p, self.stream("laser"))
        self._poses = np.empty((p.laser_beams, 3))
        self._odometry_rng, self._slip_rng = self.stream("odometry"), self.stream("slip")
        self._laser_clock_rng, self._odometry_clock_rng = self.stream("laser clock"), self.stream("odometry clock")
        self._start_ns = round(p.clock_start * 1e9)
        self._contacts: list[Contact] = []
        if odometry_start is not None:
            self._state[7:10] = odometry_start
            self._history[:, 3:6] = odometry_start
        self.teleport(start)
        self._traffic = Traffic(world, p, self._state[:3], self._body, self.stream)
        self._movers, self._seen = self._traffic.bodies, self._traffic.seen
        self._touching = np.zeros(1 + len(self._movers), np.int64)

    def stream(self, name: str) -> np.random.Generator:
        """Return a new generator of random numbers that depends on the seed and `name` only."""
        return np.random.default_rng([self._seed, zlib.crc32(name.encode())])

    @property
    def time_s(self) -> float:
        """Seconds from the start."""
        return float(self._counters[0]) * TICK_S

    @property
    def stamp_ns(self) -> int:
        """The same as a stamp: `clock.start` and what has passed since."""
        return self._start_ns + int(self._counters[0]) * _TICK_NS

    @property
    def pose(self) -> Array:
        """float64 (3,): where base_link truly is in the map."""
        return _wrapped(self._state[:3])

    @property
    def twist(self) -> Array:
        """float64 (3,): true velocity, forward and leftward m/s and rad/s."""
        return self._state[3:6].copy()

    @property
    def odom_pose(self) -> Array:
        """float64 (3,): where the wheels say base_link is, in odom, which began where the robot did."""
        return _wrapped(self._state[7:10])

    @property
    def odom_twist(self) -> Array:
        """float64 (3,): velocity as the wheels tell it; scale errors and slip are in it, the random walk is not."""
        return self._state[10:13].copy()

    @property
    def T_base_laser(self) -> Array:  # noqa: N802 - frames as everywhere
        """float64 (3,): the scanner on base_link, seen from above."""
        return self._scanner.T_base_laser

    @property
    def sweep_s(self) -> float:
        """Seconds from the first to the last beam of a scan."""
        return self._scanner.sweep_s

    @property
    def collisions(self) -> tuple[Contact, ...]:
        """All contacts so far, in the order in which they began."""
        return tuple(self._contacts)

    @property
    def clearance_m(self) -> float:
        """Distance of the body to the nearest wall or moving thing now, metres; at most 3, 0 in contact."""
        pose = self._state[:3]
        gap = self._body.wall_gap(pose, self._barriers, _FARTHEST_CLEARANCE_M)
        return max(min(gap, self._body.mover_gap(pose, self._movers)), 0.0)

    def command(self, twist: Array) -> None:
        """Ask for forward, leftward (m/s) and turning (rad/s) velocity (3,); it acts `robot.latency` later.

        Raises
        ------
        UsageError
            If `twist` is not three finite numbers.
        """
        wanted = np.asarray(twist, dtype=np.float64)
        if wanted.shape != (3,) or not np.isfinite(wanted).all():
            raise UsageError(f"command {twist!r}: not three finite velocities")
        head, count = int(self._counters[1]), int(self._counters[2])
        if count == _MOST_COMMANDS:
            raise UsageError(f"{count} commands wait for robot.latency {self.parameters.robot_latency:g} s: too many")
        row = self._queue[(head + count) % _MOST_COMMANDS]
        row[0] = int(self._counters[0]) + 1 + round(self.parameters.robot_latency / TICK_S)
        row[1:] = wanted
        self._counters[2] += 1

    def advance(self, seconds: float) -> None:
        """Let time pass, in ticks of 10 ms.

        Raises
        ------
        UsageError
            If `seconds` is no whole number of ticks, or negative.
        """
        ticks = round(seconds / TICK_S)
        if ticks < 0 or abs(ticks * TICK_S - seconds) > 1e-6:
            raise UsageError(f"advance {seconds:g} s: give a multiple of {TICK_S:g} s")
        while ticks > 0:
            count = min(ticks, len(self._no_slips))
            if not self._traffic.is_empty:
                passed = int(self._counters[0]) % _STEP_TICKS
                if passed == 0:
                    self._let_traffic_decide()
                count = min(count, _STEP_TICKS - passed)
            self._run(count)
            ticks -= count

    def _let_traffic_decide(self) -> None:
        x, y, yaw, forward, left, turn = self._state[:6].tolist()
        c, s = math.cos(yaw), math.sin(yaw)
        robot = np.array([x, y, yaw, c * forward - s * left, s * forward + c * left, turn])
        self._traffic.step(self.time_s, robot)
        self._movers, self._seen = self._traffic.bodies, self._traffic.seen

    def _run(self, ticks: int) -> None:
        w, b = self._barriers, self._body
        draws = self._odometry_rng.standard_normal((ticks, 2))
        slips = self._no_slips
        if self._slips:
            slips = self._slip_rng.standard_normal((ticks, 3))
            slips[:, 2] = 0.5 * (1.0 + np.array([math.erf(v / math.sqrt(2.0)) for v in slips[:, 2]]))
        begun = _plant_kernels.advance(
            ticks, TICK_S, self._state, self._counters, self._queue, self._wanted, self._limits, b.outline,
            b.radius_m, b.around_m, w.field, w.frame, w.shapes, self._movers, self._touching, self._told, draws,
            slips, self._history, self._events,
        )  # fmt: skip
        for tick, what, x, y, speed, approach in self._events[:begun].tolist():
            self._contacts.append(
                Contact(
                    time_s=tick * TICK_S,
                    x_m=x,
                    y_m=y,
                    kind=self._kind(int(what)),
                    speed_m_s=speed,
                    approach_m_s=approach,
                )
            )

    def _kind(self, what: int) -> str:
        if what < 0:
            return "wall"
        return "person" if what < self._traffic.num_people else "cart"

    def teleport(self, pose: Array) -> None:
        """Put the robot elsewhere (kidnap it): the truth jumps to `pose` (3,), odometry does not notice, it stands still.

        Raises
        ------
        UsageError
            If `pose` is not finite or the body would touch a wall there.
        """
        there = np.asarray(pose, dtype=np.float64)
        if there.shape != (3,) or not np.isfinite(there).all():
            raise UsageError(f"pose {pose!r} is not three finite numbers x, y, yaw")
        if self._body.wall_gap(there, self._barriers, 0.1) <= 0.0:
            x, y, yaw = there.tolist()
            raise UsageError(f"world {self.world.name}: the robot at {x:g}, {y:g} (yaw {yaw:g} rad) touches a wall")
        self._state[:3] = there
        self._state[3:7] = 0.0
        self._state[15] = 0.0
        self._wanted[:] = 0.0
        self._history[:, :3] = there

    def odometry(self) -> Odometry:
        """Return what the wheels say now, under a stamp moved by `clock.odometry_offset` and its jitter."""
        x, y, yaw = self._state[7:10].tolist()
        vx, vy, w = self._state[10:13].tolist()
        p = self.parameters
        late_ns = round(p.clock_odometry_offset * 1e9) + _jitter_ns(p.clock_odometry_jitter, self._odometry_clock_rng)
        return Odometry(
            stamp_ns=self.stamp_ns + late_ns,
            frame_id=ODOM_FRAME,
            child_frame_id=p.robot_base_frame,
            position_m=np.array([x, y, 0.0]),
            quat_xyzw=np.array([0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)]),
            linear_m_s=np.array([vx, vy, 0.0]),
            angular_rad_s=np.array([0.0, 0.0, w]),
            topic=ODOM_TOPIC,
        )

    def odom_pose_at(self, stamp_ns: int) -> Array:
        """Return the told pose (3,) at a stamp of the last 2.5 s, as a tf buffer would; the nearest one beyond."""
        poses = np.empty((1, 3))
        at = (stamp_ns - self._start_ns) / _TICK_NS
        poses_at(self._history[:, 3:], at, int(self._counters[0]), 0.0, poses)
        return _wrapped(poses[0])

    def true_pose_at(self, time_s: float) -> Array:
        """Return where base_link truly was (3,) at a time of the last 2.5 s; the nearest one beyond."""
        poses = np.empty((1, 3))
        poses_at(self._history[:, :3], time_s / TICK_S, int(self._counters[0]), 0.0, poses)
        return _wrapped(poses[0])

    def scan(self) -> LaserScan:
        """Return the scan whose last beam is measured now; its stamp is that of its first beam (`sweep_s` ago)."""
        late_ns = _jitter_ns(self.parameters.clock_laser_jitter, self._laser_clock_rng)
        return self._scanner.scan(self.true_ranges(), self.stamp_ns + late_ns)

    def true_ranges(self) -> Array:
        """Return the exact distances (N,) along the beams of the scan that ends now; inf beyond `laser.range_max`."""
        now = int(self._counters[0])
        first = now - self._scanner.sweep_s / TICK_S
        poses_at(self._history[:, :3], first, now, self._scanner.beam_step_s / TICK_S, self._poses)
        return self._scanner.true_ranges(self._poses, self._walls, self._seen, self._since_step_s())

    def discs(self) -> Array:
        """Return float64 (D, 5) x, y, radius (metres, map frame), vx, vy (m/s) around everybody and every cart there is."""
        there = self._movers[self._traffic.present]
        return np.column_stack([there[:, :2], np.hypot(there[:, 4], there[:, 5]) + there[:, 6], there[:, 7:]])

    def boxes(self) -> Array:
        """Return float64 (D, 9) of the same as rounded boxes: x, y, cos, sin, half length, half width, radius, vx, vy."""
        return self._movers[self._traffic.present]

    def _since_step_s(self) -> float:
        """Return how long ago people and carts last decided, at most a whole step: they decide anew when time goes on."""
        now = int(self._counters[0])
        return ((now - 1) % _STEP_TICKS + 1) * TICK_S if now else 0.0


def _jitter_ns(deviation_s: float, rng: np.random.Generator) -> int:
    return round(deviation_s * float(rng.standard_normal()) * 1e9) if deviation_s > 0.0 else 0


def _wrapped(pose: Array) -> Array:
    x, y, yaw = pose.tolist()
    return np.array([x, y, math.pi - (math.pi - yaw) % (2.0 * math.pi)])


def warm() -> None:
    """Compile the kernels of this module."""
    cells = np.zeros((60, 60), np.int8)
    cells[0] = 100
    parameters = resolve_settings({"laser.beams": 3})
    plant = Plant(World(name="warm", grid=OccupancyGrid(cells, 0.05)), parameters, start=np.array([1.5, 1.5, 0.0]))
    plant.command(np.zeros(3))
    plant.advance(TICK_S)
    plant.scan()
    plant.odom_pose_at(plant.stamp_ns)
    _ = plant.clearance_m
