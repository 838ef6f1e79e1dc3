# SPDX-License-Identifier: MIT
"""The graph of nodes and landmarks, and which closures stay in it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from visual_worlds import motion

from slamcli.errors import EstimationError
from slamcli.geometry import se3
from slamcli.rtabmap.closure_check import ClosureCheck, closure_link, closure_record, least_variances, limited
from slamcli.rtabmap.graph import GraphOptimiser, graph_root, graph_settings, link_ratios, optimise_graph
from slamcli.rtabmap.links import Link, LinkKind
from slamcli.rtabmap.parameters import GtsamGroup, OptimizerGroup, RgbdGroup
from slamcli.rtabmap.registration import Registration, refused

RGBD = RgbdGroup()
SIGMA = 0.02


def settings(*, planar=False, gtsam=None, **optimizer):
    return graph_settings(OptimizerGroup(**optimizer), gtsam or GtsamGroup(), planar=planar)


def link(poses, a, b, kind=LinkKind.GLOBAL_CLOSURE, *, off=(0.0, 0.0, 0.0), sigma=SIGMA):
    T = se3.inverse(poses[a]) @ poses[b]
    T[:3, 3] += off
    return Link(from_id=a, to_id=b, kind=kind, T_from_to=T, information=np.eye(6) / sigma**2)


def square(*, side=5, noise=0.0, seed=0):
    """Poses around a square of nodes 1 m apart, by id; odometry as links, drifting poses to begin with."""
    rng = np.random.default_rng(seed)
    poses, T = {}, np.eye(4)
    for k in range(4 * side + 1):
        poses[k + 1] = T
        T = T @ motion(1.0, rotvec=(0, 0, np.pi / 2 if (k + 1) % side == 0 else 0.0))
    links = [
        link(poses, i, i + 1, LinkKind.NEIGHBOR, off=noise * rng.normal(size=3) * (1, 1, 0))
        for i in range(1, len(poses))
    ]
    start = {1: np.eye(4)}
    for one in links:
        start[one.to_id] = start[one.from_id] @ one.T_from_to
    return poses, links, start


def run(start, links, told=None, root=1):
    return optimise_graph(list(start), np.array(list(start.values())), links, told or settings(), root=root)


def optimiser(start, told=None):
    held = GraphOptimiser(told or settings())
    return lambda links: held.optimise(list(start), np.array(list(start.values())), links, root=1)


def test_a_closure_spreads_the_drift():
    poses, links, start = square(noise=0.05)
    drift = np.linalg.norm(start[21][:3, 3] - poses[21][:3, 3])
    graph = run(start, [*links, link(poses, 1, 21)])
    assert drift > 0.09
    assert np.linalg.norm(graph.pose(21)[:3, 3] - poses[21][:3, 3]) < 0.15 * drift
    assert np.array_equal(graph.pose(1), start[1]) or np.allclose(graph.pose(1), start[1], atol=1e-12)
    assert graph.moved == 21
    assert graph.max_ratio < 3.0


def test_only_what_hangs_together_with_the_root_moves():
    poses, links, start = square(noise=0.05)
    elsewhere = {100: motion(50.0), 101: motion(52.0)}
    apart = link({100: np.eye(4), 101: motion(1.0)}, 100, 101, LinkKind.NEIGHBOR)
    graph = run({**start, **elsewhere}, [*links, link(poses, 1, 21), apart])
    assert np.array_equal(graph.pose(101), elsewhere[101])
    assert graph.moved == 21
    other = run({**start, **elsewhere}, [*links, link(poses, 1, 21), apart], root=100)
    assert np.array_equal(other.pose(21), start[21])
    assert np.allclose(other.pose(101), motion(51.0))


@pytest.mark.parametrize("turn", [0.0, 1.0, 2.0, 3.1])
def test_a_session_with_a_frame_of_its_own_is_joined_from_wherever_it_is(turn):
    poses, links, start = square(noise=0.01)
    elsewhere = motion(40.0, -7.0, 2.0, (0.3, 0.1, turn))
    second = {i + 100: elsewhere @ T for i, T in start.items()}
    own = [replace(one, from_id=one.from_id + 100, to_id=one.to_id + 100) for one in links]
    poses = {**poses, **{i + 100: T for i, T in poses.items()}}
    for joined in (link(poses, 7, 112), link(poses, 112, 7)):
        graph = run({**start, **second}, [*links, *own, joined])
        assert max(np.linalg.norm(graph.pose(i + 100)[:3, 3] - start[i][:3, 3]) for i in start) < 0.3
        assert graph.moved == 42
        assert graph.error < 1e-6


def test_roots():
    assert graph_root([-3, 4, 9, 7], from_end=False) == 4
    assert graph_root([-3, 4, 9, 7], from_end=True) == 9
    poses, links, start = square(noise=0.05)
    graph = run(start, [*links, link(poses, 1, 21)], root=21)
    assert np.allclose(graph.pose(21), start[21], atol=1e-9)
    assert np.linalg.norm(graph.pose(1)[:3, 3]) > 0.05


def test_a_landmark_ties_what_it_is_seen_from():
    poses, links, start = square(noise=0.05)
    poses = {**poses, -7: motion(2.0, 1.0)}
    seen = [link(poses, 2, -7, LinkKind.LANDMARK), link(poses, 21, -7, LinkKind.LANDMARK)]
    begun = {**start, -7: start[2] @ seen[0].T_from_to}
    graph = run(begun, [*links, *seen])
    assert np.linalg.norm(graph.pose(21)[:3, 3] - poses[21][:3, 3]) < 0.06
    ignored = run(begun, [*links, *seen], settings(landmarks_ignored=True))
    assert np.allclose(ignored.pose(21), start[21], atol=1e-6)
    assert np.array_equal(ignored.pose(-7), begun[-7])


def test_settings_do_what_they_say():
    poses, links, start = square(noise=0.05)
    closed = [*links, link(poses, 1, 21, sigma=1.0)]
    drift = start[21][:3, 3] - poses[21][:3, 3]
    by_variance, alike = run(start, closed), run(start, closed, settings(variance_ignored=True))
    share = [np.linalg.norm(g.pose(21)[:3, 3] - poses[21][:3, 3]) / np.linalg.norm(drift) for g in (by_variance, alike)]
    assert share[0] > 0.8
    assert share[1] < 0.1
    prior = Link(
        from_id=21, to_id=21, kind=LinkKind.POSE_PRIOR, T_from_to=motion(30.0) @ start[21], information=1e4 * np.eye(6)
    )
    assert np.allclose(run(start, [*links, prior]).pose(21), start[21], atol=1e-6)
    placed = run(start, [*links, prior], settings(priors_ignored=False))
    assert np.allclose(placed.pose(21), prior.T_from_to, atol=1e-3)
    assert placed.pose(1)[0, 3] == pytest.approx(30.0, abs=0.01)
    for method in (0, 1, 2):
        one = run(start, closed, settings(gtsam=GtsamGroup(optimizer=method)))
        assert np.allclose(one.T_map_base, by_variance.T_map_base, atol=1e-4)
    grown = run(start, closed, settings(gtsam=GtsamGroup(incremental=True)))
    assert np.allclose(grown.T_map_base, by_variance.T_map_base, atol=5e-3)


def test_gravity_levels_in_space_and_is_nothing_in_the_plane():
    poses, links, start = square()
    tilted = {i: motion(rotvec=(0.1, 0.0, 0.0)) @ T for i, T in start.items()}
    gravity = [
        Link(from_id=i, to_id=i, kind=LinkKind.GRAVITY, T_from_to=poses[i], information=np.eye(6)) for i in poses
    ]
    level = run(tilted, [*links, *gravity])
    assert level.T_map_base[:, 2, 2].min() > 0.99999
    assert run(tilted, [*links, *gravity], settings(gravity_sigma=0.0)).pose(1)[2, 2] < 0.996
    flat = run(start, [*links, *gravity], settings(planar=True))
    assert np.allclose(flat.T_map_base[:, 2, 3], 0.0)


def test_ratios_are_errors_over_standard_deviations():
    poses, _, _ = square()
    turned = replace(link(poses, 1, 3), T_from_to=motion(2.0, rotvec=(0, 0.05, 0)), information=np.eye(6) / 0.01**2)
    links = [link(poses, 1, 2, off=(0.05, -0.1, 0.2), sigma=0.1), turned]
    row_of = {node: row for row, node in enumerate(poses)}
    translation, rotation = link_ratios(links, np.array(list(poses.values())), row_of, planar=False)
    assert translation == pytest.approx([2.0, 0.0], abs=1e-9)
    assert rotation == pytest.approx([0.0, 5.0], abs=1e-9)
    translation, rotation = link_ratios(links, np.array(list(poses.values())), row_of, planar=True)
    assert translation == pytest.approx([1.0, 0.0], abs=1e-9)
    assert rotation == pytest.approx([0.0, 0.0], abs=1e-9)


def test_a_closure_that_strains_the_graph_is_refused_with_a_sentence():
    poses, links, start = square(noise=0.02)
    check = ClosureCheck(RGBD, robust=False)
    good = link(poses, 1, 21)
    verdict = check.judge(optimiser(start), links, [good])
    assert verdict.accepted == (good,)
    assert verdict.ratio == verdict.graph.max_ratio < 3.0
    wrong = link(poses, 3, 20, off=(2.0, 1.0, 0.0))
    verdict = check.judge(optimiser(start), [*links, good], [wrong])
    assert verdict.accepted == ()
    assert verdict.graph is None
    ((which, why),) = verdict.refused
    assert which is wrong
    assert "would be wrong by" in why
    assert "RGBD/OptimizeMaxError 3" in why
    assert verdict.ratio > 3.0
    off = ClosureCheck(replace(RGBD, optimize_max_error=0.0), robust=False)
    assert off.judge(optimiser(start), [*links, good], [wrong]).accepted == (wrong,)


def test_robust_optimisation_takes_the_weight_of_wrong_ones():
    poses, links, start = square(noise=0.02)
    good = [link(poses, 1, 21), link(poses, 2, 20)]
    wrong = link(poses, 3, 20, off=(2.0, 1.0, 0.0))
    verdict = ClosureCheck(RGBD, robust=True).judge(optimiser(start, settings(robust=True)), [*links, *good], [wrong])
    assert [one for one, _ in verdict.refused] == [wrong]
    assert "contradict" in verdict.refused[0][1]
    assert np.linalg.norm(verdict.graph.pose(21)[:3, 3] - poses[21][:3, 3]) < 0.1


def test_long_closures_are_refused():
    poses, links, start = square()
    check = ClosureCheck(replace(RGBD, max_loop_closure_distance=2.0), robust=False)
    short, long = link(poses, 1, 21), link(poses, 4, 15)
    verdict = check.judge(optimiser(start), links, [long, short])
    assert verdict.accepted == (short,)
    assert "more than RGBD/MaxLoopClosureDistance 2 m" in verdict.refused[0][1]
    assert check.judge(optimiser(start), links, [long]).graph is None


def test_an_old_closure_that_is_in_the_way_twice_is_dropped():
    poses, links, start = square(noise=0.02)
    old = link(poses, 3, 19, off=(1.5, 0.0, 0.0), sigma=0.2)
    new = [[link(poses, 1, 21)], [link(poses, 2, 21)]]
    check = ClosureCheck(replace(RGBD, optimize_max_error_repair_radius=5.0), robust=False)
    first = check.judge(optimiser(start), [*links, old], new[0])
    assert first.accepted == ()
    second = check.judge(optimiser(start), [*links, old], new[1])
    assert second.accepted == tuple(new[1])
    assert second.dropped == (old,)
    without = ClosureCheck(RGBD, robust=False)
    assert all(without.judge(optimiser(start), [*links, old], one).accepted == () for one in new)


def test_localisation_is_tried_again_without_proximity_links():
    poses, links, start = square(noise=0.02)
    loop = link(poses, 1, 21)
    near = link(poses, 3, 20, LinkKind.LOCAL_SPACE_CLOSURE, off=(2.0, 1.0, 0.0))
    judge = {
        localising: ClosureCheck(RGBD, robust=False, localising=localising).judge(optimiser(start), links, [loop, near])
        for localising in (True, False)
    }
    assert judge[True].accepted == (loop,)
    assert [one for one, _ in judge[True].refused] == [near]
    assert judge[False].accepted == ()


def test_closures_are_limited_to_the_certainty_of_odometry():
    poses, links, start = square()
    least = least_variances(links)
    assert np.allclose(least, SIGMA**2)
    sharp = link(poses, 1, 21, sigma=0.001)
    assert np.allclose(limited(sharp, least).information, np.eye(6) / SIGMA**2)
    dull = link(poses, 1, 21, sigma=0.1)
    assert limited(dull, least) is dull
    assert limited(sharp, least_variances([])) is sharp
    verdict = ClosureCheck(replace(RGBD, loop_cov_limited=True), robust=False).judge(optimiser(start), links, [sharp])
    assert verdict.accepted[0].information[0, 0] == pytest.approx(1 / SIGMA**2)


def test_what_cannot_be_solved_is_refused():
    poses, links, start = square()
    bad = replace(link(poses, 1, 21), T_from_to=np.full((4, 4), np.nan))
    verdict = ClosureCheck(RGBD, robust=False).judge(optimiser(start), links, [bad])
    assert verdict.graph is None
    assert "not finite" in verdict.refused[0][1]


def test_records_and_links_of_registrations():
    T = motion(0.1)
    found = Registration(
        T_a_b=T, covariance=0.01 * np.eye(6), num_matches=50, num_inliers=40, matches=np.zeros((0, 2), np.int64)
    )
    one = closure_link(3, 9, LinkKind.GLOBAL_CLOSURE, found)
    assert np.allclose(one.information, 100 * np.eye(6))
    record = closure_record(one, 5, found, posterior=0.4, ratio=1.5)
    assert (record.accepted, record.reason, record.num_inliers, record.from_id) == (True, "", 40, 3)
    assert not closure_record(one, 5, found, reason="strained").accepted
    lost = closure_record((3, 9, LinkKind.LOCAL_SPACE_CLOSURE), 5, refused("too few", num_matches=4))
    assert (lost.accepted, lost.reason, lost.num_matches) == (False, "too few", 4)
    with pytest.raises(EstimationError, match="nodes 3 and 9 are not registered: too few"):
        closure_link(3, 9, LinkKind.GLOBAL_CLOSURE, refused("too few"))
