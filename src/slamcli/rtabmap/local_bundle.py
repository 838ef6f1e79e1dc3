# SPDX-License-Identifier: MIT
"""A closure adjusted together with the nodes around the old place (``RGBD/LocalBundleOnLoopClosure``)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3
from slamcli.rtabmap.registration import Registration, flat_motion
from slamcli.rtabmap.signature import Signature
from slamcli.rtabmap.visual_motion import sigma_px
from slamcli.rtabmap.visual_registration import register_visual
from slamcli.rtabmap.visual_settings import VisualSettings
from slamcli.vision.bundle_adjustment import adjust_in_rounds
from slamcli.vision.bundle_problem import BundleProblem
from slamcli.vision.pinhole import Pinhole

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Around:
    """A node beside the old place of a closure."""

    signature: Signature
    T_old_node: Floats
    """float64 (4, 4), pose of its base in that of the old place, by the graph."""


def adjusted_locally(
    found: Registration, old: Signature, new: Signature, around: Sequence[Around], camera: Pinhole, T_base_camera: Floats,
    settings: VisualSettings, *, seed: int,
) -> Registration:  # fmt: skip
    """Return a registration of the new place in the old one, adjusted to what the nodes around the old one see of it too.

    Those are matched around where the registration puts their points, and stay where the graph has them, as the old place does; points and
    the new place move. The covariance stays that of the old place alone: the errors of the graph around it are not known here.
    """
    if found.T_a_b is None:
        return found
    views = [(old, np.eye(4), found.matches)]
    for one in around:
        guess = se3.inverse(one.T_old_node) @ found.T_a_b
        seen = register_visual(one.signature, new, camera, T_base_camera, settings, seed=seed, guess=guess)
        if seen.T_a_b is not None:
            views.append((one.signature, one.T_old_node, seen.matches))
    if len(views) == 1:
        return found
    result = adjust_in_rounds(_problem(views, new, found.T_a_b, camera, T_base_camera, sigma_px(settings)))
    T_old_new = se3.inverse(result.T_camera_map[-1]) @ se3.inverse(T_base_camera)
    return replace(found, T_a_b=flat_motion(T_old_new) if settings.force_3dof else T_old_new)


def _problem(
    views: Sequence[tuple[Signature, Floats, NDArray[np.int64]]], new: Signature, T_old_new: Floats, camera: Pinhole,
    T_base_camera: Floats, sigma: float,
) -> BundleProblem:  # fmt: skip
    """Return each match as a point of its own, seen from its node and from the new one, which is the last camera."""
    known = [matches[np.isfinite(node.points[matches[:, 0]]).all(axis=1)] for node, _, matches in views]
    points = [node.points[rows[:, 0]] @ T[:3, :3].T + T[:3, 3] for (node, T, _), rows in zip(views, known, strict=True)]
    counts = [len(rows) for rows in known]
    total = sum(counts)
    observed = [(node.features, rows[:, 0]) for (node, _, _), rows in zip(views, known, strict=True)]
    observed += [(new.features, rows[:, 1]) for rows in known]
    poses = np.array([se3.inverse(T @ T_base_camera) for T in (*(T for _, T, _ in views), T_old_new)])
    return BundleProblem(
        T_camera_map=poses, fixed=np.arange(len(poses)) < len(poses) - 1, points=np.concatenate(points),
        camera_index=np.concatenate([np.repeat(np.arange(len(views)), counts), np.full(total, len(views))]),
        point_index=np.tile(np.arange(total), 2),
        pixels=np.concatenate([features.pixels[rows] for features, rows in observed]),
        right=np.concatenate([features.right[rows] for features, rows in observed]),
        sigmas=sigma * np.concatenate([features.sigmas[rows] for features, rows in observed]), camera=camera,
    )  # fmt: skip
