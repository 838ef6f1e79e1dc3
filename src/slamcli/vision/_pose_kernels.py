# SPDX-License-Identifier: MIT
"""Pose of one camera from points: Levenberg-Marquardt with reclassification, all rounds in one kernel."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

MONO_BOUND = 5.991  # 95 % of chi2 with 2 degrees of freedom
STEREO_BOUND = 7.815  # with 3
NEAREST = 1e-6  # metres (or map units) ahead of the camera from which on a point counts as seen
BEHIND = 1e8  # chi2 of an active point behind the camera, so that no accepted step puts one there


@njit(cache=True, nogil=True)
def _rotation(phi, out):
    """Exponential of a rotation vector (3,) into `out` (3, 3)."""
    x, y, z = phi[0], phi[1], phi[2]
    square = x * x + y * y + z * z
    angle = math.sqrt(square)
    if angle < 1e-5:
        a, b = 1.0 - square / 6.0, 0.5 - square / 24.0
    else:
        a, b = math.sin(angle) / angle, (1.0 - math.cos(angle)) / square
    out[0, 0], out[0, 1], out[0, 2] = 1.0 - b * (y * y + z * z), b * x * y - a * z, b * x * z + a * y
    out[1, 0], out[1, 1], out[1, 2] = b * x * y + a * z, 1.0 - b * (x * x + z * z), b * y * z - a * x
    out[2, 0], out[2, 1], out[2, 2] = b * x * z - a * y, b * y * z + a * x, 1.0 - b * (x * x + y * y)


@njit(cache=True, nogil=True)
def _step(pose, delta, turn, out):
    """Write [Exp(phi) | rho] pose to `out` (4, 4), delta = (phi, rho)."""
    _rotation(delta[:3], turn)
    for i in range(3):
        for j in range(4):
            out[i, j] = turn[i, 0] * pose[0, j] + turn[i, 1] * pose[1, j] + turn[i, 2] * pose[2, j]
        out[i, 3] += delta[3 + i]


@njit(cache=True, nogil=True)
def _linearise(pose, points, pixels, right, sigmas, camera, active, robust, hessian, gradient):
    """Fill the normal equations (6, 6), (6,) of the active points; return half the sum of their losses.

    With p the point in the camera's frame and A = J'J of its projection by p, the blocks of the pose's increment
    (rotation phi, translation rho) are [p]x A [p]x', [p]x A and A.
    """
    fx, fy, cx, cy, bf = camera[0], camera[1], camera[2], camera[3], camera[4]
    r00, r01, r02, t0 = pose[0, 0], pose[0, 1], pose[0, 2], pose[0, 3]
    r10, r11, r12, t1 = pose[1, 0], pose[1, 1], pose[1, 2], pose[1, 3]
    r20, r21, r22, t2 = pose[2, 0], pose[2, 1], pose[2, 2], pose[2, 3]
    h00 = h01 = h02 = h11 = h12 = h22 = 0.0  # rotation
    m00 = m01 = m02 = m10 = m11 = m12 = m20 = m21 = m22 = 0.0  # rotation and translation
    a00 = a02 = a11 = a12 = a22 = 0.0  # translation; the part of x and y is 0
    g0 = g1 = g2 = g3 = g4 = g5 = 0.0
    cost = 0.0
    for n in range(len(points)):
        if not active[n]:
            continue
        px, py, pz = points[n, 0], points[n, 1], points[n, 2]
        x = r00 * px + r01 * py + r02 * pz + t0
        y = r10 * px + r11 * py + r12 * pz + t1
        z = r20 * px + r21 * py + r22 * pz + t2
        mono = math.isnan(right[n])
        bound = MONO_BOUND if mono else STEREO_BOUND
        if not z > NEAREST:
            cost += 0.5 * (2.0 * math.sqrt(bound * BEHIND) - bound) if robust else 0.5 * BEHIND
            continue
        inverse = 1.0 / z
        weight = 1.0 / (sigmas[n] * sigmas[n])
        u = fx * x * inverse + cx
        eu, ev = u - pixels[n, 0], fy * y * inverse + cy - pixels[n, 1]
        er = 0.0 if mono else u - bf * inverse - right[n]
        square = weight * (eu * eu + ev * ev + er * er)
        if robust and square > bound:
            norm = math.sqrt(square)
            delta = math.sqrt(bound)
            cost += 0.5 * (2.0 * delta * norm - bound)
            weight *= delta / norm
        else:
            cost += 0.5 * square
        jx, jy = fx * inverse, fy * inverse
        jxz, jyz = -jx * x * inverse, -jy * y * inverse
        b00, b02, b11, b12 = jx * jx, jx * jxz, jy * jy, jy * jyz
        b22 = jxz * jxz + jyz * jyz
        q0, q1, q2 = jx * eu, jy * ev, jxz * eu + jyz * ev
        if not mono:
            jrz = jxz + bf * inverse * inverse
            b00 += jx * jx
            b02 += jx * jrz
            b22 += jrz * jrz
            q0 += jx * er
            q2 += jrz * er
        b00, b02, b11, b12, b22 = weight * b00, weight * b02, weight * b11, weight * b12, weight * b22
        q0, q1, q2 = weight * q0, weight * q1, weight * q2
        a00 += b00
        a02 += b02
        a11 += b11
        a12 += b12
        a22 += b22
        c00, c01, c02 = y * b02, y * b12 - z * b11, y * b22 - z * b12
        c10, c11, c12 = z * b00 - x * b02, -x * b12, z * b02 - x * b22
        c20, c21, c22 = -y * b00, x * b11, x * b12 - y * b02
        m00 += c00
        m01 += c01
        m02 += c02
        m10 += c10
        m11 += c11
        m12 += c12
        m20 += c20
        m21 += c21
        m22 += c22
        h00 += y * c02 - z * c01
        h01 += z * c00 - x * c02
        h02 += x * c01 - y * c00
        h11 += z * c10 - x * c12
        h12 += x * c11 - y * c10
        h22 += x * c21 - y * c20
        g0 += y * q2 - z * q1
        g1 += z * q0 - x * q2
        g2 += x * q1 - y * q0
        g3 += q0
        g4 += q1
        g5 += q2
    hessian[0, 0], hessian[0, 1], hessian[0, 2] = h00, h01, h02
    hessian[1, 1], hessian[1, 2], hessian[2, 2] = h11, h12, h22
    hessian[0, 3], hessian[0, 4], hessian[0, 5] = m00, m01, m02
    hessian[1, 3], hessian[1, 4], hessian[1, 5] = m10, m11, m12
    hessian[2, 3], hessian[2, 4], hessian[2, 5] = m20, m21, m22
    hessian[3, 3], hessian[3, 4], hessian[3, 5] = a00, 0.0, a02
    hessian[4, 4], hessian[4, 5], hessian[5, 5] = a11, a12, a22
    for i in range(6):
        for j in range(i):
            hessian[i, j] = hessian[j, i]
    gradient[0], gradient[1], gradient[2], gradient[3], gradient[4], gradient[5] = g0, g1, g2, g3, g4, g5
    return cost


@njit(cache=True, nogil=True)
def _solve(hessian, damping, gradient, factor, delta):
    """Write the solution of (H + damping diag(H)) delta = -gradient; False where the sum is not positive definite."""
    size = len(gradient)
    largest = 0.0
    for i in range(size):
        largest = max(largest, hessian[i, i])
    for i in range(size):
        for j in range(i + 1):
            total = hessian[i, j]
            if i == j:
                total += damping * max(hessian[i, i], 1e-9 * largest)
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            if i == j:
                if not total > 0.0:
                    return False
                factor[i, i] = math.sqrt(total)
            else:
                factor[i, j] = total / factor[j, j]
    for i in range(size):
        total = -gradient[i]
        for k in range(i):
            total -= factor[i, k] * delta[k]
        delta[i] = total / factor[i, i]
    for i in range(size - 1, -1, -1):
        total = delta[i]
        for k in range(i + 1, size):
            total -= factor[k, i] * delta[k]
        delta[i] = total / factor[i, i]
    return True


@njit(cache=True, nogil=True)
def _classify(pose, points, pixels, right, sigmas, camera, chi2, inliers):
    """Fill chi2 (N,), inf behind the camera, and who is within the 95 % bound (N,); return how many."""
    count = 0
    for n in range(len(points)):
        px, py, pz = points[n, 0], points[n, 1], points[n, 2]
        x = pose[0, 0] * px + pose[0, 1] * py + pose[0, 2] * pz + pose[0, 3]
        y = pose[1, 0] * px + pose[1, 1] * py + pose[1, 2] * pz + pose[1, 3]
        z = pose[2, 0] * px + pose[2, 1] * py + pose[2, 2] * pz + pose[2, 3]
        if not z > NEAREST:
            chi2[n] = np.inf
            inliers[n] = False
            continue
        u = camera[0] * x / z + camera[2]
        eu, ev = u - pixels[n, 0], camera[1] * y / z + camera[3] - pixels[n, 1]
        square, bound = eu * eu + ev * ev, MONO_BOUND
        if not math.isnan(right[n]):
            er = u - camera[4] / z - right[n]
            square += er * er
            bound = STEREO_BOUND
        chi2[n] = square / (sigmas[n] * sigmas[n])
        inliers[n] = chi2[n] <= bound
        if inliers[n]:
            count += 1
    return count


@njit(cache=True, nogil=True)
def _orthonormalise(pose):
    """One Newton step of the rotation of `pose` towards the nearest orthonormal matrix: R (3 I - R'R) / 2."""
    square = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            total = 3.0 if i == j else 0.0
            for k in range(3):
                total -= pose[k, i] * pose[k, j]
            square[i, j] = 0.5 * total
    for i in range(3):
        a, b, c = pose[i, 0], pose[i, 1], pose[i, 2]
        for j in range(3):
            pose[i, j] = a * square[0, j] + b * square[1, j] + c * square[2, j]


@njit(cache=True, nogil=True)
def optimise(pose, points, pixels, right, sigmas, camera, rounds, iterations, inliers, chi2, information):
    """Move `pose` (4, 4) in place to the minimum; fill inliers, chi2 (N,) and information (6, 6); return iterations.

    Each round starts where the last one ended, from the points within the bound; the last one is without Huber loss.
    """
    hessian, gradient, factor = np.zeros((6, 6)), np.zeros(6), np.zeros((6, 6))
    trial_hessian, trial_gradient, delta = np.zeros((6, 6)), np.zeros(6), np.zeros(6)
    trial, turn = pose.copy(), np.empty((3, 3))
    active = np.ones(len(points), np.bool_)
    done = 0
    for round_ in range(rounds):
        robust = round_ < rounds - 1 or rounds == 1
        cost = _linearise(pose, points, pixels, right, sigmas, camera, active, robust, hessian, gradient)
        damping = 1e-6
        for _ in range(iterations):
            done += 1
            if not _solve(hessian, damping, gradient, factor, delta):
                damping = max(10.0 * damping, 1e-6)
                continue
            _step(pose, delta, turn, trial)
            other = _linearise(
                trial, points, pixels, right, sigmas, camera, active, robust, trial_hessian, trial_gradient
            )
            largest = 0.0
            for i in range(6):
                largest = max(largest, abs(delta[i]))
            if other <= cost:
                settled = cost - other <= 1e-6 * cost or largest < 1e-9
                pose[:], hessian[:], gradient[:] = trial, trial_hessian, trial_gradient
                cost = other
                damping = max(0.1 * damping, 1e-9)
                if settled:
                    break
            else:
                if largest < 1e-9:
                    break
                damping *= 10.0
        if _classify(pose, points, pixels, right, sigmas, camera, chi2, inliers) < 3:
            break
        active[:] = inliers
    _orthonormalise(pose)
    _classify(pose, points, pixels, right, sigmas, camera, chi2, inliers)
    _linearise(pose, points, pixels, right, sigmas, camera, inliers, False, information, gradient)
    return done
