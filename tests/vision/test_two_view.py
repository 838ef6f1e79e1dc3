# SPDX-License-Identifier: MIT
"""The first motion of one camera: depth, planes, outliers, and input that has no answer."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from slamcli.errors import DataError, EstimationError
from slamcli.geometry import se3
from slamcli.vision import _two_view_kernels as kernels
from slamcli.vision import two_view_models as models
from slamcli.vision.pinhole import Pinhole
from slamcli.vision.two_view import initialise_two_view

pytestmark = pytest.mark.kernels

CAMERA = Pinhole(fx=520.0, fy=515.0, cx=318.0, cy=243.0, width=640, height=480)
T_B_A = se3.from_rotation_translation(Rotation.from_rotvec([0.03, -0.08, 0.02]).as_matrix(), [-0.4, 0.05, 0.1])


# most motions along a plane have a twin that explains the matches as well; this one has not
T_FAR = se3.from_rotation_translation(Rotation.from_rotvec([-0.2, 0.3, -0.1]).as_matrix(), [-2.1, -0.6, 0.0])


def views(points, T_b_a=T_B_A, noise=0.5, outliers=0.2, seed=0):
    """Pixels of points (N, 3) of camera a's frame in both, and which of them are wrong."""
    rng = np.random.default_rng(seed)
    moved = points @ T_b_a[:3, :3].T + T_b_a[:3, 3]
    a, b = (CAMERA.project(p) + noise * rng.normal(size=(len(points), 2)) for p in (points, moved))
    wrong = rng.random(len(points)) < outliers
    b[wrong] = rng.uniform(0, [640, 480], (wrong.sum(), 2))
    return a, b, wrong


def cloud(count=300, seed=1):
    rng = np.random.default_rng(seed)
    return CAMERA.back_project(rng.uniform(0, [640, 480], (count, 2)), rng.uniform(2, 8, count))


def plane(count=300, seed=1):
    rng = np.random.default_rng(seed)
    ones = CAMERA.back_project(rng.uniform(0, [640, 480], (count, 2)), np.ones(count))
    normal = np.array([0.3, 0.5, 1.0])
    return ones * (4.0 / (ones @ normal))[:, None]


def angle(a, b):
    return np.degrees(np.arccos(np.clip(a @ b / np.linalg.norm(a) / np.linalg.norm(b), -1, 1)))


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(("scene", "model", "T"), [(cloud, "fundamental", T_B_A), (plane, "homography", T_FAR)])
def test_motion_and_points(scene, model, T, seed):
    points = scene(seed=seed)
    a, b, wrong = views(points, T, seed=seed)
    got = initialise_two_view(a, b, CAMERA, seed=seed)
    assert got.model == model
    turn = Rotation.from_matrix(got.T_b_a[:3, :3] @ T[:3, :3].T).magnitude()
    assert np.degrees(turn) < 0.2
    assert angle(got.T_b_a[:3, 3], T[:3, 3]) < 1.0
    assert np.linalg.norm(got.T_b_a[:3, 3]) == pytest.approx(1.0)
    assert got.inliers[~wrong].mean() > 0.9
    assert got.inliers[wrong].mean() < 0.1
    assert np.isnan(got.points[~got.inliers]).all()
    scaled = got.points * np.linalg.norm(T[:3, 3])
    right = got.inliers & ~wrong
    assert np.median(np.linalg.norm(scaled[right] - points[right], axis=1) / points[right, 2]) < 0.05
    centre = se3.inverse(T)[:3, 3]
    angles = sorted((angle(point, point - centre) for point in points[right]), reverse=True)
    assert np.degrees(got.parallax_rad) == pytest.approx(angles[50], abs=0.3)


def test_two_motions_that_explain_a_plane_are_no_answer():
    a, b, _ = views(plane())
    with pytest.raises(EstimationError, match="two motions explain the matches"):
        initialise_two_view(a, b, CAMERA, seed=0)


def test_a_wider_pair_scores_higher():
    points, scores = cloud(), []
    for factor in (0.3, 1.0, 2.0):
        T = T_B_A.copy()
        T[:3, 3] *= factor
        a, b, _ = views(points, T, outliers=0.0)
        scores.append(initialise_two_view(a, b, CAMERA, seed=0).score)
    assert scores[0] < scores[1] < scores[2] < len(points)


def test_the_same_seed_gives_the_same_bytes():
    a, b, _ = views(cloud())
    first, second = (initialise_two_view(a, b, CAMERA, seed=4) for _ in range(2))
    assert first.T_b_a.tobytes() == second.T_b_a.tobytes()
    assert first.points.tobytes() == second.points.tobytes()
    assert first.score == second.score


def test_what_has_no_answer_is_said():
    points = cloud()
    a, b, _ = views(points[:30])
    with pytest.raises(EstimationError, match="30 matches, fewer than 50"):
        initialise_two_view(a, b, CAMERA, seed=0)
    turned = T_B_A.copy()
    turned[:3, 3] = 0.0
    a, b, _ = views(points, turned, outliers=0.0)
    with pytest.raises(EstimationError, match="two views: "):
        initialise_two_view(a, b, CAMERA, seed=0)
    hardly = T_B_A.copy()
    hardly[:3, 3] *= 0.1
    a, b, _ = views(points, hardly, noise=0.05, outliers=0.0)
    with pytest.raises(EstimationError, match="parallax"):
        initialise_two_view(a, b, CAMERA, seed=0)
    rng = np.random.default_rng(0)
    noise = rng.uniform(0, [640, 480], (2, 200, 2))
    with pytest.raises(EstimationError, match="two views: "):
        initialise_two_view(noise[0], noise[1], CAMERA, seed=0)
    same = np.tile([100.0, 100.0], (60, 1))
    with pytest.raises(EstimationError, match="two views: "):
        initialise_two_view(same, same, CAMERA, seed=0)
    with pytest.raises(DataError, match="not paired"):
        initialise_two_view(a, b[:-1], CAMERA, seed=0)


def test_models_are_exact_on_exact_pixels():
    a, b, _ = views(plane(), noise=0.0, outliers=0.0)
    H = models.homography_of(a[:20], b[:20])
    moved = np.column_stack([a, np.ones(len(a))]) @ H.T
    assert np.allclose(moved[:, :2] / moved[:, 2:], b, atol=1e-6)
    found = models.motions_of_homography(H, CAMERA.matrix)
    direction = T_B_A[:3, 3] / np.linalg.norm(T_B_A[:3, 3])
    assert len(found) == 8
    assert min(np.abs(T[:3, :3] - T_B_A[:3, :3]).max() + np.abs(T[:3, 3] - direction).max() for T in found) < 1e-6
    assert np.allclose(np.linalg.det(found[:, :3, :3]), 1.0)
    a, b, _ = views(cloud(), noise=0.0, outliers=0.0)
    F = models.fundamental_of(a[:20], b[:20])
    assert np.allclose(
        np.einsum("ni,ij,nj->n", np.column_stack([b, np.ones(len(b))]), F / np.abs(F).max(), np.c_[a, np.ones(len(a))]),
        0, atol=1e-5,
    )  # fmt: skip
    found = models.motions_of_fundamental(F, CAMERA.matrix)
    assert min(np.abs(T[:3, :3] - T_B_A[:3, :3]).max() + np.abs(T[:3, 3] - direction).max() for T in found) < 1e-6


def naive_scores(H, F, a, b, weight):
    """The scores of the paper (eq. 2 and 3), match by match."""
    total_h = total_f = 0.0
    for pa, pb in zip(np.c_[a, np.ones(len(a))], np.c_[b, np.ones(len(b))], strict=True):
        for M, p, q in ((H, pa, pb), (np.linalg.inv(H), pb, pa)):
            moved = M @ p
            chi2 = weight * ((moved[:2] / moved[2] - q[:2]) ** 2).sum()
            total_h += 5.991 - chi2 if chi2 <= 5.991 else 0.0
        for M, p, q in ((F, pa, pb), (F.T, pb, pa)):
            line = M @ p
            chi2 = weight * (q @ line) ** 2 / (line[:2] ** 2).sum()
            total_f += 5.991 - chi2 if chi2 <= 3.841 else 0.0
    return total_h, total_f


def test_kernels_equal_their_twins():
    a, b, _ = views(cloud(40), noise=1.0)
    rng = np.random.default_rng(3)
    samples = np.array([rng.permutation(40)[:8] for _ in range(6)])
    h, f = np.empty((6, 9)), np.empty((6, 9))
    kernels.hypotheses(a / 300 - 1, b / 300 - 1, samples, h, f)
    for k, sample in enumerate(samples):
        p, q = np.c_[a[sample] / 300 - 1, np.ones(8)], np.c_[b[sample] / 300 - 1, np.ones(8)]
        F = np.linalg.svd(np.einsum("ni,nj->nij", q, p).reshape(8, 9))[2][-1]
        assert min(np.abs(F - f[k]).max(), np.abs(F + f[k]).max()) < 1e-8
        H = h[k].reshape(3, 3)
        assert np.allclose(np.cross(p[:4] @ H.T, q[:4]), 0, atol=1e-9)
        assert np.linalg.norm(H) == pytest.approx(1.0)
    H, F = models.homography_of(a, b), models.fundamental_of(a, b)
    scores = np.empty((2, 1))
    kernels.score_homographies(H[None], np.linalg.inv(H)[None], a, b, 0.5, 5.991, scores[0])
    kernels.score_fundamentals(F[None].copy(), a, b, 0.5, 3.841, 5.991, scores[1])
    assert scores[:, 0].tolist() == pytest.approx(naive_scores(H, F, a, b, 0.5))
    kernels.hypotheses(np.zeros((8, 2)), np.zeros((8, 2)), np.arange(8)[None], h[:1], f[:1])
    assert not h[0].any()
    assert not f[0].any()
