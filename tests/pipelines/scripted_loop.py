# SPDX-License-Identifier: MIT
"""A drive that is told to listeners as a closed loop tells it: true scans of a world, and made-up plans, costmaps and people."""

from __future__ import annotations

import numpy as np

from slamcli.geometry import se2
from slamcli.navigation.cost_window import CostWindow
from slamcli.pipelines.generate import open_world
from slamcli.pipelines.loop_listener import LoopListener
from slamcli.simulation import Simulation, resolve_settings

START_NS = 1_700_000_000_000_000_000
SQUARE = np.array([[0.2, 0.2], [0.2, -0.2], [-0.2, -0.2], [-0.2, 0.2]])


def costmap(name: str, centre=(0.0, 0.0), size: int = 80) -> CostWindow:
    """Return a costmap of a ramp of costs with an obstacle and something unknown in it."""
    costs = np.tile(np.arange(size, dtype=np.uint8), (size, 1))
    costs[3, 4], costs[5, 6], costs[7, 8] = 253, 254, 255
    x, y = centre
    half = size * 0.05 / 2
    return CostWindow(
        costs=costs, origin_m=(x - half, y - half), resolution_m=0.05, frame="map" if name == "global" else "odom",
        footprint=SQUARE, inscribed_radius_m=0.2, circumscribed_radius_m=0.29,
    )  # fmt: skip


def play(listeners: list[LoopListener], *, seconds: float = 4.0, world: str = "office", people: int = 2) -> Simulation:
    """Tell listeners of a drive through `world`; the localiser is right but for 2 cm, the goal is reached at the end."""
    simulation = Simulation(open_world(world), resolve_settings({}, {"laser.beams": 91}), seed=3, duration_s=seconds)
    poses = simulation.motion
    goal = np.append(np.asarray(poses.poses)[-1, :2], 0.5)

    def tell(name: str, *arguments) -> None:
        for listener in listeners:
            getattr(listener, name)(*arguments)

    grid = simulation.true_map()
    tell("on_map", 0.0, grid)
    tell("on_goal", 0.0, goal)
    tell("on_status", 0.0, "planning", "")
    truth = odometry = None
    for message in simulation.messages():
        time_s = (message.log_time_ns - START_NS) / 1e9
        measured = message.measurement
        if message.topic == "/ground_truth":
            truth = measured.pose_se2
            tell("on_truth", time_s, truth, np.array([measured.linear_m_s[0], 0.0, measured.angular_rad_s[2]]))
            phase = time_s / 3
            discs = [
                [truth[0] + 1 + i, truth[1] + np.sin(phase + i), 0.25, 0.0, np.cos(phase + i) / 3]
                for i in range(people)
            ]
            tell("on_people", time_s, np.array(discs).reshape(-1, 5))
            tell("on_command", time_s, np.array([0.4, 0.0, 0.1]))
        elif message.topic == "/odom":
            odometry = measured.pose_se2
            tell("on_odometry", time_s, measured)
        elif message.topic == "/scan" and odometry is not None and truth is not None:
            tell("on_scan", time_s, measured)
            believed = truth + np.array([0.02, 0.0, 0.01])
            particles = believed + 0.1 * np.random.default_rng(round(time_s * 10)).standard_normal((700, 3))
            T_map_odom = se2.compose(believed, se2.inverse(odometry))
            tell("on_localisation", time_s, T_map_odom, np.diag([0.01, 0.02, 0.03]), particles)
            tell("on_costmap", time_s, "local", costmap("local", tuple(odometry[:2])))
            tell("on_costmap", time_s, "global", costmap("global", size=120))
            steps = np.linspace(0, 1, 20)[:, None]
            tell("on_plan", time_s, truth + steps * (goal - truth))
            tell("on_local_plan", time_s, odometry + steps[:10] * [0.5, 0.0, 0.3])
            tell("on_status", time_s, "controlling", "")
    tell("on_status", seconds, "succeeded", "goal reached")
    return simulation
