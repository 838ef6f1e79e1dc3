# SPDX-License-Identifier: MIT
"""amcl's motion models against naive twins and numbers by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slamcli.localization.motion_model import MotionModel, turn_way_turn

ALPHAS = (0.1, 0.2, 0.3, 0.4, 0.5)


def naive_move(model: MotionModel, poses, motion, noise):
    moved = []
    for (x, y, yaw), drawn in zip(poses, noise, strict=True):
        if model.kind.startswith("diff"):
            first, way, second = turn_way_turn(motion) - model.turning_sigmas(motion) * drawn
            x, y = x + way * math.cos(yaw + first), y + way * math.sin(yaw + first)
            yaw = yaw + first + second
        else:
            along, across, about = model.sideways_sigmas(motion) * drawn
            bearing = yaw + math.atan2(motion[1], motion[0])
            along += math.hypot(motion[0], motion[1])
            x, y = (
                x + along * math.cos(bearing) + across * math.sin(bearing),
                y + along * math.sin(bearing) - across * math.cos(bearing),
            )
            yaw = yaw + motion[2] + about
        moved.append([x, y, math.remainder(yaw, 2.0 * math.pi)])
    return np.array(moved)


@pytest.mark.kernels
@pytest.mark.parametrize("kind", ["diff", "omni", "diff-corrected", "omni-corrected"])
@pytest.mark.parametrize("motion", [[0.3, 0.1, 0.4], [-0.3, 0.02, -0.1], [0.001, 0.0, 1.0], [0.0, 0.0, 0.0]])
def test_particles_move_as_the_naive_twin_does(kind, motion):
    poses = np.array([[0.0, 0.0, 0.0], [5.0, -2.0, 3.0], [1.0, 1.0, -3.1]])
    model, motion = MotionModel(kind, ALPHAS), np.array(motion)
    expected = naive_move(model, poses, motion, np.random.default_rng(3).standard_normal(poses.shape))
    model.move(poses, motion, np.random.default_rng(3))
    np.testing.assert_allclose(poses, expected, atol=1e-12)


def test_corrected_models_take_the_root():
    motion = np.array([0.3, 0.1, 0.4])
    for kind, sigmas in (("diff", MotionModel.turning_sigmas), ("omni", MotionModel.sideways_sigmas)):
        as_it_was, corrected = (sigmas(MotionModel(name, ALPHAS), motion) for name in (kind, f"{kind}-corrected"))
        np.testing.assert_allclose(corrected**2, as_it_was, rtol=1e-12)


def test_sigmas_by_hand():
    # Straight on by 1 m: no turns; trans: alpha3, rot: alpha2.
    np.testing.assert_allclose(MotionModel("diff", ALPHAS).turning_sigmas(np.array([1.0, 0.0, 0.0])), [0.2, 0.3, 0.2])
    # On the spot by 1 rad: the direction of the way says nothing, all of it is the second turn.
    np.testing.assert_allclose(
        MotionModel("diff", ALPHAS).turning_sigmas(np.array([0.0, 0.0, 1.0])), [0.0, 0.4, 0.1], atol=1e-15
    )
    np.testing.assert_allclose(
        MotionModel("omni", ALPHAS).sideways_sigmas(np.array([0.0, 2.0, 0.5])), [1.225, 2.025, 0.9]
    )


def test_backwards_is_no_half_turn():
    model = MotionModel("diff-corrected", ALPHAS)
    ahead, back = (model.turning_sigmas(np.array([way, 0.0, 0.0])) for way in (0.5, -0.5))
    np.testing.assert_allclose(back, ahead, atol=1e-12)


def test_without_noise_the_motion_is_exact():
    from slamcli.geometry import se2

    poses = np.array([[1.0, 2.0, 0.5], [-1.0, 0.0, -2.0]])
    motion = np.array([-0.4, 0.3, 0.2])
    for kind in ("diff", "omni"):
        moved = poses.copy()
        MotionModel(kind, (0.0,) * 5).move(moved, motion, np.random.default_rng(0))
        np.testing.assert_allclose(moved, se2.compose(poses, motion), atol=1e-12)
