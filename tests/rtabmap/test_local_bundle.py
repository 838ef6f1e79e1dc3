# SPDX-License-Identifier: MIT
"""Closures adjusted with the nodes around the old place."""

from __future__ import annotations

import numpy as np
from visual_worlds import CAMERA, T_BASE_CAMERA, error, motion, signature, world

from slamcli.geometry import se3
from slamcli.rtabmap.local_bundle import Around, adjusted_locally
from slamcli.rtabmap.registration import refused
from slamcli.rtabmap.visual_registration import register_visual
from slamcli.rtabmap.visual_settings import VisualSettings

TRUTH = motion(0.3, 0.2, 0.0, (0.0, 0.02, 0.1))
SETTINGS = VisualSettings()


def places(seed):
    points, descriptors = world(seed)
    rng = np.random.default_rng(seed)
    beside = [motion(0.1 * k, -0.1 * k, 0.0, (0, 0, 0.03 * k)) for k in (-2, -1, 1, 2)]
    old, new, *others = (
        signature(k + 1, T, points, descriptors, rng=rng, noise_px=0.8, flips=0.05)
        for k, T in enumerate([np.eye(4), TRUTH, *beside])
    )
    around = [Around(signature=one, T_old_node=T) for one, T in zip(others, beside, strict=True)]
    return old, new, around


def test_more_views_make_the_closure_more_exact():
    alone, together = [], []
    for seed in range(12):
        old, new, around = places(seed)
        found = register_visual(old, new, CAMERA, T_BASE_CAMERA, SETTINGS, seed=0)
        better = adjusted_locally(found, old, new, around, CAMERA, T_BASE_CAMERA, SETTINGS, seed=0)
        alone.append(error(found.T_a_b, TRUTH))
        together.append(error(better.T_a_b, TRUTH))
        assert better.num_inliers == found.num_inliers
    assert (
        np.sqrt(np.mean(np.square(together), axis=0))[:3].sum()
        < 0.85 * np.sqrt(np.mean(np.square(alone), axis=0))[:3].sum()
    )


def test_without_others_or_a_motion_nothing_changes():
    old, new, around = places(0)
    found = register_visual(old, new, CAMERA, T_BASE_CAMERA, SETTINGS, seed=0)
    assert adjusted_locally(found, old, new, [], CAMERA, T_BASE_CAMERA, SETTINGS, seed=0) is found
    lost = refused("none")
    assert adjusted_locally(lost, old, new, around, CAMERA, T_BASE_CAMERA, SETTINGS, seed=0) is lost
    _, elsewhere, _ = places(1)
    apart = [Around(signature=elsewhere, T_old_node=se3.inverse(TRUTH))]
    assert adjusted_locally(found, old, new, apart, CAMERA, T_BASE_CAMERA, SETTINGS, seed=0) is found


def test_in_the_plane_it_stays_in_the_plane():
    old, new, around = places(2)
    flat = VisualSettings(force_3dof=True)
    found = register_visual(old, new, CAMERA, T_BASE_CAMERA, flat, seed=0)
    better = adjusted_locally(found, old, new, around, CAMERA, T_BASE_CAMERA, flat, seed=0)
    assert better.T_a_b[2, 3] == 0.0
