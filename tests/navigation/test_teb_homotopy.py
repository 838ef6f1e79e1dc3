# SPDX-License-Identifier: MIT
"""Homotopy classes of paths and obstacles out of costmaps, against hand-computed values and naive twins."""

from __future__ import annotations

import cmath
import itertools

import numpy as np
import pytest
from elastic_loop import costs_of, still, window_of

from slamcli.navigation.footprint import padded_polygon
from slamcli.navigation.local_planner import NoCommandError
from slamcli.navigation.teb import TebPlanner, _obstacle_kernels, _roadmap_kernels
from slamcli.navigation.teb.alternatives import Alternatives
from slamcli.navigation.teb.homotopy import Classes
from slamcli.navigation.teb.obstacle_field import obstacle_field
from slamcli.navigation.teb.optimise import BandOptimiser
from slamcli.navigation.teb.parameters import TebParameters
from slamcli.parameters import resolve

P = TebParameters()
ROUND = padded_polygon((), 0.18, 0.0)
START, GOAL = np.array([-1.5, 0.0, 0.0]), np.array([1.5, 0.0, 0.0])


def window_with(*blocks, inflated=True):
    """A window of 4 m about the origin with blocks x1, x2, y1, y2 in it."""
    occupied = np.zeros((80, 80), bool)
    for x1, x2, y1, y2 in blocks:
        c1, c2, r1, r2 = (round((v + 2.0) / 0.05) for v in (x1, x2, y1, y2))
        occupied[r1:r2, c1:c2] = True
    costs = costs_of(occupied, 0.05, 0.18) if inflated else np.where(occupied, 254, 0).astype(np.uint8)
    return window_of(costs, 0.05, ROUND, (-2.0, -2.0))


def field_of(window, **more):
    return obstacle_field(window, START, behind_m=1.5, **more)


def over(height):
    return np.array([[-1.5, 0.0], [0.0, height], [1.5, 0.0]])


def signature_naive(path, points, prescaler=1.0):
    """Bhattacharya 2010, eq. 6, with the original's choice of the analytic function."""
    most = max(len(points) - 1, 5)
    a = int(np.ceil(most / 2))
    b = most - a
    begin, end = complex(*path[0]), complex(*path[-1])
    low, high = begin + complex(0, -3), begin + complex(3, 3)
    if abs(end - begin) >= 3.0:
        normal = (end - begin) * 1j
        low, high = begin - normal, end + normal
    total = 0j
    for k, point in enumerate(points):
        here = complex(*point)
        value = prescaler * a * (here - low) * b * (here - high)
        for j, other in enumerate(points):
            if j != k:
                value /= here - complex(*other)
        for p, q in itertools.pairwise(path):
            total += value * cmath.log((complex(*q) - here) / (complex(*p) - here))
    return total


def test_two_classes_about_one_obstacle():
    field = field_of(window_with((-0.2, 0.2, -0.2, 0.2)))
    assert field.group_points.shape == (1, 2)
    classes = Classes(P, field, START, GOAL)
    left, right, farther = classes.mark(over(0.8)), classes.mark(over(-0.8)), classes.mark(over(1.3))
    assert classes.are_same(left, farther)
    assert not classes.are_same(left, right)
    point = field.group_points[0]
    assert left.value == pytest.approx(signature_naive(over(0.8), [point]), rel=1e-9)
    assert right.value == pytest.approx(signature_naive(over(-0.8), [point]), rel=1e-9)
    # the two differ by one turn: 2 pi i times the residue
    residue = np.empty(1, complex)
    _roadmap_kernels.residues(field.group_points, START[:2].copy(), GOAL[:2].copy(), 1.0, residue)
    assert right.value - left.value == pytest.approx(2j * np.pi * residue[0], rel=1e-9)


def test_signatures_are_their_naive_twins():
    rng = np.random.default_rng(0)
    points = rng.uniform(-1.0, 1.0, (7, 2))
    path = np.vstack([[-2.0, 0.0], rng.uniform(-1.5, 1.5, (6, 2)), [2.0, 0.3]])
    values = np.empty(7, complex)
    _roadmap_kernels.residues(points, path[0].copy(), path[-1].copy(), 0.5, values)
    assert _roadmap_kernels.signature(path, points, values) == pytest.approx(
        signature_naive(path, points, 0.5), rel=1e-9
    )


def test_a_gap_too_narrow_for_the_robot_makes_no_class():
    narrow = field_of(window_with((-0.1, 0.1, 0.15, 0.8), (-0.1, 0.1, -0.8, -0.15)))
    wide = field_of(window_with((-0.1, 0.1, 0.3, 0.8), (-0.1, 0.1, -0.8, -0.3)))
    assert len(narrow.group_points) == 1
    assert len(wide.group_points) == 2


def test_a_path_through_an_obstacle_point_is_of_no_class_of_two_sides():
    field = field_of(window_with((-0.2, 0.2, -0.2, 0.2)))
    classes = Classes(P, field, START, GOAL)
    through = np.vstack([START[:2], field.group_points[0], GOAL[:2]])
    assert classes.mark(through).is_valid


def test_sides_of_what_moves():
    disc = np.array([[0.0, -1.0, 0.3, 0.0, 0.25]])  # crosses the straight way when the robot is there
    classes = Classes(P, field_of(window_with(), discs=disc), START, GOAL)
    behind, before = classes.mark(over(-0.5)), classes.mark(over(0.8))
    assert behind.sides[0] > 0.1  # the disc is on its left
    assert before.sides[0] < -0.1
    assert not classes.are_same(behind, before)
    times = np.array([0.0, 4.0, 8.0])
    sweep = 0.0
    for i in range(2):
        a, b = (over(0.8)[k] - disc[0, :2] - times[k] * disc[0, 3:] for k in (i, i + 1))
        sweep += np.arctan2(a[0] * b[1] - a[1] * b[0], a @ b)
    assert classes.mark(over(0.8), times).sides[0] == pytest.approx(sweep / (2 * np.pi))


@pytest.mark.parametrize("simple", [False, True])
def test_both_ways_round_are_found(simple):
    p = resolve(TebParameters, {"simple_exploration": simple})
    field = field_of(window_with((-0.2, 0.2, -0.2, 0.2)))
    classes = Classes(p, field, START, GOAL)
    paths = classes.explore([], 5, np.random.default_rng(0))
    heights = sorted(path[np.abs(path[:, 0]).argmin(), 1] for path in paths)
    assert heights[0] < 0.0 < heights[-1]
    for path in paths:
        for a, b in itertools.pairwise(path):
            assert field.is_visible(a, b)
    again = classes.explore([classes.mark(over(0.8)), classes.mark(over(-0.8))], 5, np.random.default_rng(0))
    assert again == []


def explore_brute(nodes, linked, classes):
    """All ways through the graph, the shortest of each class."""
    best: list = []

    def walk(way):
        for nxt in range(1, len(nodes)):
            if nxt in way or not linked[way[-1], nxt]:
                continue
            if nxt < len(nodes) - 1:
                walk([*way, nxt])
                continue
            path = nodes[[*way, nxt]]
            length, mark = np.hypot(*np.diff(path, axis=0).T).sum(), classes.mark(path)
            for entry in best:
                if classes.are_same(entry[1], mark):
                    if length < entry[0]:
                        entry[:] = [length, mark]
                    break
            else:
                best.append([length, mark])

    walk([0])
    return sorted(length for length, _ in best)


@pytest.mark.parametrize("seed", range(4))
def test_exploring_is_its_brute_twin(seed):
    p = resolve(
        TebParameters, {"roadmap_graph_no_samples": 7, "max_number_classes": 20, "roadmap_graph_area_width": 2.5}
    )
    field = field_of(window_with((-0.4, -0.2, -0.2, 0.2), (0.2, 0.5, -0.6, -0.2), (0.2, 0.4, 0.5, 0.7)))
    classes = Classes(p, field, START, GOAL)
    nodes = np.vstack([START[:2], classes._samples(np.random.default_rng(seed)), GOAL[:2]])
    lengths = [
        np.hypot(*np.diff(path, axis=0).T).sum() for path in classes.explore([], 20, np.random.default_rng(seed))
    ]
    assert lengths == pytest.approx(explore_brute(nodes, classes._links(nodes), classes))


def test_surface_and_groups_against_naive_twins():
    rng = np.random.default_rng(1)
    costs = rng.choice(np.array([0, 0, 0, 100, 253, 254, 254, 255], np.uint8), (30, 40))
    cells = np.empty(costs.size, np.int64)
    cells = cells[: _obstacle_kernels.surface_cells(costs, cells)]
    around = np.pad(costs == 254, 1)
    inner = around[:-2, 1:-1] & around[2:, 1:-1] & around[1:-1, :-2] & around[1:-1, 2:]
    assert cells.tolist() == np.flatnonzero((costs == 254) & ~inner).tolist()
    labels = np.empty(costs.shape, np.int64)
    from scipy import ndimage

    expected, groups = ndimage.label((costs == 253) | (costs == 254), np.ones((3, 3)))
    assert _obstacle_kernels.label(costs, labels, np.empty(costs.size, np.int64)) == groups
    np.testing.assert_array_equal(labels, expected)


def test_cells_behind_and_under_discs_do_not_count():
    window = window_with((-1.9, -1.8, -0.1, 0.1), (0.5, 0.6, -0.1, 0.1))
    assert len(obstacle_field(window, START, behind_m=1.5).group_points) == 2
    assert len(obstacle_field(window, START, behind_m=0.2).group_points) == 1
    disc = np.array([[0.55, 0.0, 0.1, 0.0, 0.0]])
    assert len(obstacle_field(window, START, behind_m=0.2, discs=disc).points) == 0
    assert len(obstacle_field(window, START, behind_m=9.0, use_cells=False).points) == 0


def associate_naive(poses, points, force, cutoff):
    rows = [[] for _ in poses]
    for i in range(1, len(poses) - 1):
        away = np.hypot(*(points - poses[i, :2]).T)
        side = (
            np.cos(poses[i, 2]) * (points - poses[i, :2])[:, 1] - np.sin(poses[i, 2]) * (points - poses[i, :2])[:, 0]
            > 0
        )
        rows[i] = list(np.flatnonzero(away < force))
        for which in (side, ~side):
            rest = np.flatnonzero(which & (away >= force) & (away <= cutoff))
            if len(rest):
                rows[i].append(rest[away[rest].argmin()])
    return rows


def test_association_is_its_naive_twin():
    rng = np.random.default_rng(2)
    poses, points = rng.normal(size=(8, 3)), rng.normal(size=(40, 2)) * 2.0
    starts, near = np.zeros(9, np.int64), np.empty(320, np.int64)
    _obstacle_kernels.associate(poses, np.zeros((1, 5)), False, 0.0, points, 0.75, 2.5, starts, near)
    expected = associate_naive(poses, points, 0.75, 2.5)
    assert [sorted(near[starts[i] : starts[i + 1]]) for i in range(8)] == [sorted(row) for row in expected]


def test_legacy_association_by_hand():
    poses = np.column_stack([np.arange(8.0), np.zeros(8), np.zeros(8)])
    starts, near = np.zeros(9, np.int64), np.empty(80, np.int64)
    total = _obstacle_kernels.associate_legacy(poses, np.array([[4.1, 1.0], [0.2, 1.0]]), 4, starts, near)
    assert [i for i in range(8) if starts[i + 1] > starts[i]] == [3, 4, 5]
    assert near[:total].tolist() == [0, 0, 0]


def test_collisions_between_poses():
    field = field_of(window_with((-0.05, 0.05, -2.0, 2.0)))
    poses = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    assert field.collision(poses, 3.2) == 0
    assert field.collision(poses[:1], 3.2) == -1
    assert field.collision(np.array([[-1.0, 0.0, 0.0], [-0.5, 0.0, 0.0], [-0.2, 0.0, 0.0]]), 3.2) == 2


def planned(alternatives, window, path, cycles=5, p=P, **more):
    bands = ()
    for k in range(cycles):
        field = field_of(window, **more)
        bands = alternatives.plan(path, BandOptimiser(p, field, start_twist=np.zeros(3)), field, 0.05 * k)
    return bands


def test_alternatives_pass_on_either_side_and_the_shorter_one_is_chosen():
    window = window_with((-0.2, 0.2, -0.5, 0.2))
    path = np.column_stack([np.linspace(-1.5, 1.5, 61), np.zeros((61, 2))])
    alternatives = Alternatives(P, seed=1)
    bands = planned(alternatives, window, path)
    heights = [band.poses[np.abs(band.poses[:, 0]).argmin(), 1] for band in bands]
    assert heights[0] > 0.35
    assert min(heights) < -0.65
    assert [kept.chosen for kept in alternatives.kept] == [True] + [False] * (len(bands) - 1)
    twin = planned(Alternatives(P, seed=1), window, path)
    assert [band.poses.tobytes() for band in twin] == [band.poses.tobytes() for band in bands]


def test_one_band_without_homotopy_classes():
    p = resolve(TebParameters, {"enable_homotopy_class_planning": False})
    path = np.column_stack([np.linspace(-1.5, 1.5, 61), np.zeros((61, 2))])
    assert len(planned(Alternatives(p), window_with((-0.2, 0.2, -0.5, 0.2)), path, p=p)) == 1


def test_room_and_clearance_against_naive_twins():
    field = field_of(window_with((-0.1, 0.1, 0.3, 0.8), (-0.1, 0.1, -0.9, -0.4)))
    path = np.column_stack([np.linspace(-1.5, 1.5, 31), np.full((31, 1), -0.02), np.zeros((31, 1))])
    naive = []
    for a, b in itertools.pairwise(path[:, :2]):
        away = field.points - a
        far = np.hypot(*away.T)
        left = ((b - a)[0] * away[:, 1] - (b - a)[1] * away[:, 0] > 0.0) & (
            far <= 0.5 + field.costmap.inscribed_radius_m
        )
        right = ~left & (far <= 0.5 + field.costmap.inscribed_radius_m)
        if left.any() and right.any():
            naive.append(0.5 * (far[left].min() + far[right].min()) - field.costmap.inscribed_radius_m)
    assert field.room_m(path) == pytest.approx(min(naive), abs=1e-12)
    # the passage is 0.7 m wide; its cells' centres are 0.75 m apart
    assert field.room_m(path) == pytest.approx(0.375 - field.costmap.inscribed_radius_m, abs=0.005)
    assert field_of(window_with((-0.1, 0.1, 0.3, 0.8))).room_m(path) == np.inf
    poses = np.array([[0.0, 0.0, 0.0], [0.0, 0.4, 0.0], [-1.0, 0.5, 0.3]])
    clearances = field.clearance_m(poses)
    distances = np.hypot(*(field.points[None] - poses[:, None, :2]).T).min(axis=0)
    np.testing.assert_allclose(clearances[[0, 2]], distances[[0, 2]] - 0.18, atol=0.004)  # 16 corners for a circle
    assert -0.18 < clearances[1] < 0.0
    assert field.room_m(np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]), to_goal=True) == pytest.approx(clearances[0])


def test_ways_through_obstacles():
    field = field_of(window_with((-0.1, 0.1, 0.0, 0.6)))
    assert not field.is_blocked(over(-0.5))
    assert field.is_blocked(over(0.3))
    # within the inscribed radius of it: too near on the way, forgiven at its end
    assert field.is_blocked(over(-0.1))
    assert not field.is_blocked(np.array([[-1.0, -0.1], [-0.3, -0.1], [-0.2, -0.1]]))


def test_a_robot_in_touch_with_an_obstacle_may_leave_it():
    window = window_with((0.15, 0.3, -2.0, 2.0))
    plan = np.column_stack([np.linspace(0.0, -1.5, 31), np.zeros(31), np.full(31, np.pi)])
    planner = TebPlanner(P)
    planner.set_plan(plan)
    away = planner.compute_command(still((0.0, 0.0, np.pi)), window)
    assert away.twist[0] > 0.0
    planner.reset()
    planner.set_plan(plan * [-1.0, 1.0, 1.0] + [0.0, 0.0, np.pi])
    with pytest.raises(NoCommandError):
        planner.compute_command(still((0.0, 0.0, 0.0)), window)
