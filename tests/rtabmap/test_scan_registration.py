# SPDX-License-Identifier: MIT
"""One scan in another: rooms, corridors, rooms with two equal ends; what refuses a motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scan_worlds import box, corridor, furnished_room, seen

from slamcli.geometry import se2, se3
from slamcli.parameters import as_dict, resolve
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.rtabmap.registration import Registration
from slamcli.rtabmap.scan_registration import refined_by_scans, refined_motion, register_scans
from slamcli.rtabmap.scan_settings import ScanSettings
from slamcli.rtabmap.signature import NodeScan

A, B = np.array([3.0, 3.0, 0.0]), np.array([3.6, 3.3, 0.4])
TRUE = se2.between(A, B)


def settings(**native: object) -> ScanSettings:
    chosen = {"Reg/Strategy": 1, "Reg/Force3DoF": True} | {k.replace("_", "/"): v for k, v in native.items()}
    return ScanSettings.of(resolve(RtabmapParameters, as_dict(RtabmapParameters()), chosen))


def scans(seed: int = 1) -> tuple[NodeScan, NodeScan]:
    rng = np.random.default_rng(seed)
    return seen(furnished_room(), A, rng), seen(furnished_room(), B, rng)


def off(guess_error: tuple[float, float, float]) -> np.ndarray:
    return se3.from_se2(TRUE + np.array(guess_error))


def error_of(found: Registration) -> np.ndarray:
    assert found.T_a_b is not None, found.reason
    return se2.between(TRUE, se3.to_se2(found.T_a_b))


def test_two_scans_of_a_room_from_a_guess() -> None:
    found = register_scans(*scans(), off((0.08, -0.06, 0.03)), settings())
    assert np.abs(error_of(found)[:2]).max() < 0.015
    assert abs(error_of(found)[2]) < 0.005
    assert found.num_inliers > 0.8 * found.num_matches
    assert np.linalg.eigvalsh(found.covariance)[0] > 0.0


def test_a_poor_guess_is_searched_around() -> None:
    found = register_scans(*scans(), off((0.9, -0.7, 0.3)), settings(), sigma_m=0.5, sigma_rad=0.2)
    assert np.abs(error_of(found)[:2]).max() < 0.02


def test_errors_have_the_size_that_covariances_tell() -> None:
    normalised = []
    for seed in range(2, 22):
        found = register_scans(*scans(seed), off((0.0, 0.0, 0.0)), settings())
        error = error_of(found)
        plane = np.ix_([0, 1, 5], [0, 1, 5])
        normalised.append(float(error @ np.linalg.solve(found.covariance[plane], error)))
    # 3 for exact covariances; walls as straight as these are rare, and covariances are for rooms with people in them.
    assert 0.03 < np.mean(normalised) < 12.0


def test_scans_of_different_rooms_are_refused() -> None:
    rng = np.random.default_rng(5)
    other = np.array([*box(-3.0, -2.0, 2.5, 9.0), *box(0.0, 2.0, 1.4, 2.4), *box(-2.0, 4.0, -1.0, 6.0)])
    a, b = seen(furnished_room(), A, rng), seen(other, np.zeros(3), rng)
    found = register_scans(a, b, np.eye(4), settings(), sigma_m=0.3, sigma_rad=0.2)
    assert found.T_a_b is None
    assert found.reason


def test_a_correction_beyond_its_limit_is_refused() -> None:
    found = register_scans(*scans(), off((0.06, 0.06, 0.0)), settings(Icp_MaxTranslation=0.03))
    assert found.T_a_b is None
    assert "Icp/MaxTranslation 0.03" in found.reason
    turned = register_scans(*scans(), off((0.0, 0.0, 0.04)), settings(Icp_MaxRotation=0.01))
    assert "Icp/MaxRotation 0.01" in turned.reason


def test_in_a_corridor_the_guess_holds_along_it() -> None:
    rng = np.random.default_rng(2)
    a, b = (seen(corridor(), np.array([x, 0.1, 0.0]), rng, reach=8.0) for x in (0.0, 0.5))
    found = register_scans(a, b, se3.from_se2([0.55, 0.05, 0.02]), settings())
    assert found.T_a_b is not None
    x, y, yaw = se3.to_se2(found.T_a_b)
    assert x == pytest.approx(0.55, abs=0.03)
    assert (y, yaw) == pytest.approx((0.0, 0.0), abs=0.01)
    assert found.covariance[0, 0] > 100.0 * found.covariance[1, 1]
    refused = register_scans(a, b, se3.from_se2([0.55, 0.05, 0.02]), settings(Icp_PointToPlaneLowComplexityStrategy=0))
    assert "structural complexity" in refused.reason


def test_ranges_and_steps_thin_the_scans() -> None:
    a, b = scans()
    near = settings(Icp_RangeMax=2.0)
    assert near.planar(a).points.shape[0] < 0.8 * len(a.points)
    assert settings(Icp_DownsamplingStep=4).planar(a).points.shape[0] == -(-len(a.points) // 4)
    assert (np.linalg.norm(settings(Icp_RangeMin=1.5).cloud(a), axis=1) >= 1.5).all()
    few = register_scans(a, replace(b, points=b.points[:9]), off((0.0, 0.0, 0.0)), settings())
    assert few.reason == "9 points within range: at least 20 are needed"


def test_what_the_camera_saw_is_corrected_or_refused() -> None:
    a, b = scans()
    seen_by_camera = Registration(
        T_a_b=off((0.05, -0.05, 0.02)), covariance=np.diag([1e-3] * 3 + [1e-4] * 3), num_matches=90, num_inliers=40,
        matches=np.ones((40, 2), np.int64),
    )  # fmt: skip
    mended = refined_by_scans(seen_by_camera, a, b, settings())
    assert np.abs(error_of(mended)[:2]).max() < 0.015
    assert (mended.num_inliers, len(mended.matches)) == (40, 40)
    assert refined_by_scans(seen_by_camera, None, b, settings()) is seen_by_camera
    wrong = replace(seen_by_camera, T_a_b=off((1.5, 0.9, 1.0)))
    assert refined_by_scans(wrong, a, b, settings()).reason.startswith("the scans: ")


def test_odometry_between_neighbours_is_refined_or_kept() -> None:
    covariance = np.diag([1e-3] * 3 + [1e-4] * 3)
    guess = off((0.05, 0.03, -0.02))
    motion, spread = refined_motion(scans(), guess, covariance, settings())
    assert np.abs(se2.between(TRUE, se3.to_se2(motion))[:2]).max() < 0.015
    assert spread[0, 0] < covariance[0, 0]
    kept, same = refined_motion((None, scans()[1]), guess, covariance, settings())
    assert kept is guess
    assert same is covariance
