# SPDX-License-Identifier: MIT
"""Residuals, derivatives, solver and resizing of timed elastic bands, against hand-computed values and naive twins."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from elastic_loop import window_of

from slamcli.navigation.footprint import padded_polygon
from slamcli.navigation.teb import _band_kernels as kernels
from slamcli.navigation.teb import _resize_kernels
from slamcli.navigation.teb.band import Band, band_along, resized, warm_start
from slamcli.navigation.teb.obstacle_field import obstacle_field
from slamcli.navigation.teb.optimise import BandOptimiser
from slamcli.navigation.teb.parameters import TebParameters
from slamcli.navigation.teb.robot_outline import robot_outline
from slamcli.navigation.teb.settings import SETTINGS, settings_vector
from slamcli.parameters import resolve

NO_INTS, NO_POINTS, NO_MOVING, NO_VIA = np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros((0, 4)), np.zeros((0, 3))
POINT = np.zeros((1, 5))
SQUARE = np.array(
    [[0.3, 0.2, -0.3, 0.2, 0], [-0.3, 0.2, -0.3, -0.2, 0], [-0.3, -0.2, 0.3, -0.2, 0], [0.3, -0.2, 0.3, 0.2, 0]]
)


def settings(**values):
    """Settings in which every weight is 0 but for those given."""
    base = dict.fromkeys(SETTINGS, 0.0) | {
        "obstacle_cost_exponent": 1.0,
        "circumscribed_radius": 10.0,
        "free_goal_vel": 1.0,
    }
    return np.array([float((base | values)[name]) for name in SETTINGS])


def evaluate(
    poses,
    dts,
    p,
    outline=POINT,
    closed=False,
    points=NO_POINTS,
    starts=None,
    near=NO_INTS,
    moving=NO_MOVING,
    via=NO_VIA,
):
    num = len(poses)
    H, b, costs = np.empty((4 * num, 11)), np.empty(4 * num), np.empty(4)
    starts = np.zeros(num + 1, np.int64) if starts is None else starts
    cost = kernels.linearise(poses, dts, p, outline, closed, points, starts, near, moving, via, H, b, costs)
    return cost, H, b, costs


def wavy(num=6, seed=3):
    rng = np.random.default_rng(seed)
    x = np.arange(num) * 0.25
    poses = np.column_stack([x, 0.3 * np.sin(2.0 * x), 0.5 * np.cos(9.0 * x)]) + 0.05 * rng.normal(size=(num, 3))
    return poses, 0.3 + 0.05 * rng.random(num - 1)


def gradient_naive(poses, dts, cost_of):
    """Half the gradient of the cost by central differences, in the kernel's order."""
    num, h = len(poses), 1e-6
    gradient = np.zeros(4 * num)
    for k in range(4 * num - 1):
        sides = []
        for step in (h, -h):
            moved, times = poses.copy(), dts.copy()
            if k % 4 < 3:
                moved[k // 4, k % 4] += step
            else:
                times[k // 4] += step
            sides.append(cost_of(moved, times))
        gradient[k] = (sides[0] - sides[1]) / (4.0 * h)
    return gradient


WEIGHTED = {
    "velocity": dict(weight_max_vel_x=2.0, weight_max_vel_theta=3.0, max_vel_x=0.4, max_vel_x_backwards=0.2, max_vel_theta=0.3),
    "arc": dict(weight_max_vel_x=2.0, max_vel_x=0.4, max_vel_x_backwards=0.2, max_vel_theta=9.0, exact_arc_length=1),
    "acceleration": dict(
        weight_acc_lim_x=2.0, weight_acc_lim_theta=3.0, acc_lim_x=0.1, acc_lim_theta=0.1, start_vx=0.1, free_goal_vel=0
    ),
    "holonomic": dict(
        weight_max_vel_x=1.0, weight_max_vel_y=2.0, weight_acc_lim_x=1.0, weight_acc_lim_y=2.0, max_vel_x=0.4, max_vel_y=0.1,
        max_vel_x_backwards=0.2, max_vel_trans=50.0, max_vel_theta=9.0, acc_lim_x=0.1, acc_lim_y=0.1, holonomic=1,
    ),
    "wheels": dict(weight_kinematics_nh=1000.0, weight_kinematics_forward_drive=1.0),
    "car": dict(weight_kinematics_turning_radius=1.0, min_turning_radius=5.0, carlike=1),
    "car on arcs": dict(weight_kinematics_turning_radius=1.0, min_turning_radius=5.0, carlike=1, exact_arc_length=1),
    "time and way": dict(weight_optimaltime=1.0, weight_shortest_path=2.0),
    "turn left": dict(weight_prefer_rotdir=50.0, prefer_rotdir=1),
    "turn right": dict(weight_prefer_rotdir=50.0, prefer_rotdir=-1),
    "obstacles": dict(weight_obstacle=50.0, weight_inflation=0.1, min_obstacle_dist=0.5, inflation_dist=0.9, penalty_epsilon=0.05),
    "obstacles squared": dict(weight_obstacle=50.0, min_obstacle_dist=0.5, obstacle_cost_exponent=2.0),
    "slow near obstacles": dict(
        weight_velocity_obstacle_ratio=1.0, obstacle_proximity_ratio_max_vel=0.9, obstacle_proximity_upper_bound=1.5,
        max_vel_x=0.4, max_vel_theta=0.3,
    ),
    "moving": dict(
        weight_dynamic_obstacle=50.0, weight_dynamic_obstacle_inflation=0.1, min_obstacle_dist=0.5,
        dynamic_obstacle_inflation_dist=0.9,
    ),
    "via": dict(weight_viapoint=1.0),
}  # fmt: skip


@pytest.mark.parametrize("case", WEIGHTED)
@pytest.mark.parametrize("outline", [(POINT, False), (SQUARE, True)], ids=["point", "square"])
def test_derivatives_are_those_of_the_cost(case, outline):
    poses, dts = wavy()
    p = settings(**WEIGHTED[case])
    points = np.array([[0.4, 0.75], [0.8, -0.5], [0.55, 0.1]])
    near, starts = np.tile(np.arange(3), 4), np.array([0, 0, 3, 6, 9, 12, 12])
    moving = np.array([[2.0, 0.6, 0.5, 0.1], [3.0, 0.7, -0.4, 0.2]])
    via = np.array([[1.0, 0.3, 0.2], [4.0, 0.9, 0.5]])
    rest = (*outline, points, starts, near, moving, via)
    _, H, b, _ = evaluate(poses, dts, p, *rest)
    expected = gradient_naive(poses, dts, lambda q, t: evaluate(q, t, p, *rest)[0])
    assert np.abs(expected).max() > 1e-3
    np.testing.assert_allclose(-b[:-1], expected[:-1], rtol=1e-5, atol=1e-5 * np.abs(expected).max())
    assert (H[:, 0] >= 0.0).all()


def test_penalties_by_hand():
    assert kernels.below(0.3, 0.5, 0.05) == (pytest.approx(0.25), -1.0)
    assert kernels.below(0.55, 0.5, 0.05) == (0.0, 0.0)
    assert kernels.outside(0.39, -0.2, 0.4, 0.05) == (pytest.approx(0.04), 1.0)
    assert kernels.outside(-0.2, -0.2, 0.4, 0.05) == (pytest.approx(0.05), -1.0)
    assert kernels.outside(0.1, -0.2, 0.4, 0.05) == (0.0, 0.0)


def test_costs_by_hand():
    poses = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.6, 0.0, 0.0], [0.9, 0.0, 0.0]])
    dts = np.array([0.5, 0.5, 0.5])
    assert evaluate(poses, dts, settings(weight_optimaltime=2.0))[0] == pytest.approx(2.0 * 3 * 0.25)
    assert evaluate(poses, dts, settings(weight_shortest_path=1.0))[0] == pytest.approx(3 * 0.09)
    # 0.6 m/s less the soft sign's 30/31, against 0.4 - 0.05
    speed = 0.6 * 30.0 / 31.0
    fast = settings(
        weight_max_vel_x=2.0, max_vel_x=0.4, max_vel_x_backwards=0.2, penalty_epsilon=0.05, max_vel_theta=1.0
    )
    assert evaluate(poses, dts, fast)[0] == pytest.approx(2.0 * 3 * (speed - 0.35) ** 2)
    # from 0.1 m/s to that speed, and from it to rest
    hurry = settings(weight_acc_lim_x=1.0, acc_lim_x=0.5, start_vx=0.1, free_goal_vel=0.0, acc_lim_theta=1.0)
    start, stop = (speed - 0.1) / 0.5 - 0.5, speed / 0.5 - 0.5
    assert evaluate(poses, dts, hurry)[0] == pytest.approx(start**2 + stop**2)
    # 0.1 m sideways, and both cosines are 1
    aside = poses + np.array([[0, 0, 0], [0, 0.1, 0], [0, 0.1, 0], [0, 0.1, 0]])
    assert evaluate(aside, dts, settings(weight_kinematics_nh=1000.0))[0] == pytest.approx(1000.0 * 0.2**2)
    back = poses * [-1.0, 1.0, 1.0]
    assert evaluate(back, dts, settings(weight_kinematics_forward_drive=1.0))[0] == pytest.approx(3 * 0.09)
    # an obstacle 0.3 m beside pose 1: 0.5 + 0.05 - 0.3, and 0.9 - 0.3
    p = settings(
        weight_obstacle=50.0, weight_inflation=0.1, min_obstacle_dist=0.5, inflation_dist=0.9, penalty_epsilon=0.05
    )
    near, starts, points = np.zeros(1, np.int64), np.array([0, 0, 1, 1, 1]), np.array([[0.3, 0.3]])
    cost, *_, costs = evaluate(poses, dts, p, points=points, starts=starts, near=near)
    assert cost == costs[kernels.OBSTACLE] == pytest.approx(50.0 * 0.25**2 + 0.1 * 0.6**2)
    assert evaluate(poses, dts, settings(weight_viapoint=1.0), via=np.array([[2.0, 0.6, 0.7]]))[0] == pytest.approx(
        0.49
    )


def test_a_turning_radius_is_the_chord_over_the_turn():
    poses = np.array([[0.0, 0.0, 0.0], [0.2, 0.0, 0.5], [0.4, 0.1, 0.5]])
    p = settings(weight_kinematics_turning_radius=1.0, min_turning_radius=1.0, carlike=1)
    assert evaluate(poses, np.ones(2), p)[0] == pytest.approx((1.0 - 0.2 / 0.5) ** 2)


@pytest.mark.parametrize(
    ("point", "distance"), [((0.5, 0.0), 0.2), ((0.0, 0.7), 0.5), ((0.6, 0.6), 0.5), ((0.0, 0.1), -0.1)]
)
def test_distances_to_a_rectangle(point, distance):
    assert kernels.distance_to(SQUARE, True, 0.0, 0.0, 0.0, *point, np.empty(3)) == pytest.approx(distance)
    assert kernels.distance_to(SQUARE, True, 1.0, 2.0, np.pi / 2, 1.0 - point[1], 2.0 + point[0], np.empty(3)) == (
        pytest.approx(distance)
    )


def dense(H):
    size = len(H)
    full = np.zeros((size, size))
    for r in range(size):
        for d in range(min(r, 10) + 1):
            full[r, r - d] = full[r - d, r] = H[r, d]
    return full


def test_the_banded_solver_is_the_dense_one():
    poses, dts = wavy(9)
    everything = {
        k: v for case in ("velocity", "acceleration", "wheels", "time and way") for k, v in WEIGHTED[case].items()
    }
    _, H, b, _ = evaluate(poses, dts, settings(**everything))
    kernels.fix_ends(H, b, 9)
    x = np.empty(36)
    assert kernels.solve(H, b, 35, 0.01, np.empty((36, 11)), x)
    np.testing.assert_allclose(
        x[:35], np.linalg.solve(dense(H)[:35, :35] + 0.01 * np.eye(35), b[:35]), rtol=1e-6, atol=1e-9
    )
    assert x[[0, 1, 2, 32, 33, 34]].tolist() == [0.0] * 6
    H[5, 0] = -1.0
    assert not kernels.solve(H, b, 35, 0.01, np.empty((36, 11)), x)


def resize_naive(band, dt_ref, hysteresis, low, high):
    poses, dts = [list(p) for p in band.poses], list(band.dts)
    for _ in range(100):
        changed, i = False, 0
        while i < len(dts):
            if dts[i] > dt_ref + hysteresis and len(dts) < high:
                if dts[i] > 2 * dt_ref:
                    a, b = poses[i], poses[i + 1]
                    turn = (b[2] - a[2] + np.pi) % (2 * np.pi) - np.pi
                    poses.insert(i + 1, [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2, a[2] + turn / 2])
                    dts[i : i + 1] = [dts[i] / 2] * 2
                    changed = True
                    continue
                if i < len(dts) - 1:
                    dts[i + 1] += dts[i] - dt_ref
                dts[i] = dt_ref
            elif dts[i] < dt_ref - hysteresis and len(dts) > low:
                changed = True
                if i < len(dts) - 1:
                    dts[i + 1] += dts[i]
                    del dts[i], poses[i + 1]
                else:
                    dts[i - 1] += dts[i]
                    del dts[i], poses[i]
                continue
            i += 1
        if not changed:
            break
    return np.array(poses), np.array(dts)


@pytest.mark.parametrize("seed", range(8))
def test_resizing_is_its_twin_and_keeps_ends(seed):
    rng = np.random.default_rng(seed)
    num = int(rng.integers(4, 30))
    band = Band(poses=rng.normal(size=(num, 3)), dts=rng.uniform(0.01, 1.5, num - 1))
    rules = replace(TebParameters().trajectory, max_samples=25)
    new = resized(band, rules)
    poses, dts = resize_naive(band, rules.dt_ref, rules.dt_hysteresis, rules.min_samples, rules.max_samples)
    np.testing.assert_allclose(new.poses, poses, atol=1e-12)
    np.testing.assert_allclose(new.dts, dts, atol=1e-12)
    np.testing.assert_array_equal(new.poses[[0, -1]], band.poses[[0, -1]])


def test_resizing_by_hand():
    poses = np.zeros((20, 3))
    poses[1, 0] = 1.2
    dts = np.zeros(20)
    dts[0] = 1.2
    assert _resize_kernels.resize(poses, dts, 2, 0.3, 0.1, 3, 19, False) == 4
    # halved once; then each step gives what it has over 0.3 to the next, and the last one loses it, as in the original
    np.testing.assert_allclose(poses[:4, 0], [0.0, 0.6, 0.9, 1.2])
    np.testing.assert_allclose(dts[:3], 0.3)


def test_a_first_band_takes_the_time_it_needs():
    p = TebParameters()
    band = band_along(np.array([[0.0, 0.0], [0.8, 0.0], [0.8, 0.4]]), np.zeros(3), np.array([0.8, 0.4, np.pi / 2]), p)
    np.testing.assert_allclose(band.dts, [np.pi / 2 / 0.3, 1.0])
    back = band_along(
        np.array([[0.0, 0.0], [-0.4, 0.0], [-0.8, 0.0]]),
        np.zeros(3),
        np.array([-0.8, 0.0, 0.0]),
        resolve(TebParameters, {"allow_init_with_backwards_motion": True}),
    )
    np.testing.assert_allclose(np.cos(back.poses[:, 2]), 1.0)
    assert len(band_along(np.array([[0.0, 0.0], [0.1, 0.0]]), np.zeros(3), np.zeros(3), p).poses) == 3


def test_a_warm_start_drops_what_was_passed():
    poses = np.column_stack([np.arange(8) * 0.1, np.zeros(8), np.zeros(8)])
    band = warm_start(
        Band(poses=poses, dts=np.full(7, 0.3)), np.array([0.22, 0.01, 0.1]), np.array([0.75, 0.0, 0.0]), 3
    )
    np.testing.assert_allclose(band.poses[:, 0], [0.22, 0.3, 0.4, 0.5, 0.6, 0.75])
    assert len(band.dts) == 5


def empty_window(corners=None, side=80):
    footprint = padded_polygon((), 0.18, 0.0) if corners is None else np.array(corners)
    return window_of(np.zeros((side, side), np.uint8), 0.05, footprint, (-2.0, -2.0))


def test_an_optimised_band_drives_straight_within_its_bounds():
    p = TebParameters()
    field = obstacle_field(empty_window(), np.zeros(3), behind_m=1.5)
    path = np.column_stack([np.linspace(0.0, 1.5, 31), np.zeros(31)])
    band = band_along(path, np.zeros(3), np.array([1.5, 0.0, 0.0]), p)
    for _ in range(5):
        band, costs = BandOptimiser(p, field, start_twist=np.zeros(3)).optimise(band)
    speeds = np.diff(band.poses[:, 0]) / band.dts
    assert speeds.max() == pytest.approx(0.4, abs=0.07)  # bounds are penalties, weighed against time
    assert (np.abs(band.poses[:, 1:]) < 1e-6).all()
    assert band.duration_s == pytest.approx(1.5 / 0.4, abs=0.3)
    assert costs.obstacles == 0.0


@pytest.mark.parametrize("kind", ["point", "circular", "two_circles", "line", "polygon", "auto"])
def test_outlines(kind):
    p = resolve(
        TebParameters,
        {
            "footprint_model.type": kind,
            "footprint_model.radius": 0.25,
            "footprint_model.front_offset": 0.3,
            "footprint_model.rear_offset": 0.4,
            "footprint_model.vertices": "[[0.3, 0.2], [-0.3, 0.2], [-0.3, -0.2], [0.3, -0.2]]",
        },
    )
    outline = robot_outline(p.footprint_model, empty_window())
    radius = {
        "point": 0.0,
        "circular": 0.25,
        "two_circles": 0.6,
        "line": 0.3,
        "polygon": np.hypot(0.3, 0.2),
        "auto": 0.18,
    }
    assert outline.radius_m == pytest.approx(radius[kind])
    assert outline.closed == (kind == "polygon")
    far = kernels.distance_to(outline.segments, outline.closed, 0.0, 0.0, 0.0, -1.0, 0.0, np.empty(3))
    assert far == pytest.approx({"two_circles": 0.4, "line": 0.7, "polygon": 0.7}.get(kind, 1.0 - radius[kind]))


def test_distances_to_keep_come_with_the_footprint():
    def kept(room=np.inf, **values):
        p = resolve(TebParameters, values)
        vector = settings_vector(p, robot_outline(p.footprint_model, empty_window()), np.zeros(3), 0, room)
        return vector[kernels.MIN_DIST], vector[kernels.INFLATION]

    assert kept() == (0.1, 0.35)
    assert kept(**{"footprint_model.type": "point"}) == (0.5, 0.6)
    assert kept(min_obstacle_dist=0.2, inflation_dist=0.3) == (0.2, 0.3)
    assert kept(room=0.1) == (pytest.approx(0.03), 0.35)
    assert kept(room=0.0) == (pytest.approx(-0.05), 0.35)
    assert kept(room=0.1, min_obstacle_dist=0.2) == (0.2, 0.35)
