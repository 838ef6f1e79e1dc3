# SPDX-License-Identifier: MIT
"""Compiled loops of triangulation; see `slamcli.vision.triangulation`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def _solve_3(a, b, x):
    """Solve the symmetric positive system a (3, 3) x = b by cofactors; False where it is singular."""
    c00 = a[1, 1] * a[2, 2] - a[1, 2] * a[1, 2]
    c01 = a[0, 2] * a[1, 2] - a[0, 1] * a[2, 2]
    c02 = a[0, 1] * a[1, 2] - a[0, 2] * a[1, 1]
    determinant = a[0, 0] * c00 + a[0, 1] * c01 + a[0, 2] * c02
    if not determinant > 0.0:
        return False
    c11 = a[0, 0] * a[2, 2] - a[0, 2] * a[0, 2]
    c12 = a[0, 1] * a[0, 2] - a[0, 0] * a[1, 2]
    c22 = a[0, 0] * a[1, 1] - a[0, 1] * a[0, 1]
    x[0] = (c00 * b[0] + c01 * b[1] + c02 * b[2]) / determinant
    x[1] = (c01 * b[0] + c11 * b[1] + c12 * b[2]) / determinant
    x[2] = (c02 * b[0] + c12 * b[1] + c22 * b[2]) / determinant
    return True


@njit(cache=True, nogil=True)
def _add(normal, gradient, j0, j1, j2, residual, weight):
    """Add one row of the least squares problem."""
    normal[0, 0] += weight * j0 * j0
    normal[0, 1] += weight * j0 * j1
    normal[0, 2] += weight * j0 * j2
    normal[1, 1] += weight * j1 * j1
    normal[1, 2] += weight * j1 * j2
    normal[2, 2] += weight * j2 * j2
    gradient[0] -= weight * j0 * residual
    gradient[1] -= weight * j1 * residual
    gradient[2] -= weight * j2 * residual


@njit(cache=True, nogil=True)
def _chi2(T, fx, fy, cx, cy, bf, u, v, rho, pa, ra, sa, pb, rb, sb, out):
    """Fill out with chi2 in a and in b of the point (u, v, 1) / rho of a's frame; False where it is behind b."""
    out[0] = ((fx * u + cx - pa[0]) ** 2 + (fy * v + cy - pa[1]) ** 2) / (sa * sa)
    if not math.isnan(ra):
        out[0] += (fx * u + cx - bf * rho - ra) ** 2 / (sa * sa)
    z = T[2, 0] * u + T[2, 1] * v + T[2, 2] + T[2, 3] * rho  # times rho: depth in b
    if not z > 0.0:
        return False
    x = (T[0, 0] * u + T[0, 1] * v + T[0, 2] + T[0, 3] * rho) / z
    y = (T[1, 0] * u + T[1, 1] * v + T[1, 2] + T[1, 3] * rho) / z
    out[1] = ((fx * x + cx - pb[0]) ** 2 + (fy * y + cy - pb[1]) ** 2) / (sb * sb)
    if not math.isnan(rb):
        out[1] += (fx * x + cx - bf * rho / z - rb) ** 2 / (sb * sb)
    return True


@njit(cache=True, nogil=True)
def _step(T, fx, fy, cx, cy, bf, u, v, rho, pa, ra, sa, pb, rb, sb, normal, gradient):
    """Fill the normal equations of the reprojection errors in (u, v, rho); False where the point is behind b."""
    normal[:] = 0.0
    gradient[:] = 0.0
    wa, wb = 1.0 / (sa * sa), 1.0 / (sb * sb)
    _add(normal, gradient, fx, 0.0, 0.0, fx * u + cx - pa[0], wa)
    _add(normal, gradient, 0.0, fy, 0.0, fy * v + cy - pa[1], wa)
    if not math.isnan(ra):
        _add(normal, gradient, fx, 0.0, -bf, fx * u + cx - bf * rho - ra, wa)
    z = T[2, 0] * u + T[2, 1] * v + T[2, 2] + T[2, 3] * rho
    if not z > 1e-12:
        return False
    x = (T[0, 0] * u + T[0, 1] * v + T[0, 2] + T[0, 3] * rho) / z
    y = (T[1, 0] * u + T[1, 1] * v + T[1, 2] + T[1, 3] * rho) / z
    x0, x1, x2 = (T[0, 0] - x * T[2, 0]) / z, (T[0, 1] - x * T[2, 1]) / z, (T[0, 3] - x * T[2, 3]) / z
    y0, y1, y2 = (T[1, 0] - y * T[2, 0]) / z, (T[1, 1] - y * T[2, 1]) / z, (T[1, 3] - y * T[2, 3]) / z
    _add(normal, gradient, fx * x0, fx * x1, fx * x2, fx * x + cx - pb[0], wb)
    _add(normal, gradient, fy * y0, fy * y1, fy * y2, fy * y + cy - pb[1], wb)
    if not math.isnan(rb):
        q = rho / z  # inverse depth in b
        j0 = fx * x0 + bf * q * T[2, 0] / z
        j1 = fx * x1 + bf * q * T[2, 1] / z
        j2 = fx * x2 - bf * (1.0 - q * T[2, 3]) / z
        _add(normal, gradient, j0, j1, j2, fx * x + cx - bf * q - rb, wb)
    normal[1, 0], normal[2, 0], normal[2, 1] = normal[0, 1], normal[0, 2], normal[1, 2]
    return True


@njit(cache=True, nogil=True)
def _cos_stereo(right, column, bf, baseline):
    """Cosine of the angle between the rays of a stereo pair to its point, 2 where there is no depth."""
    if math.isnan(right) or not column - right > 0.0:
        return 2.0
    depth = bf / (column - right)
    return math.cos(2.0 * math.atan2(0.5 * baseline, depth))


@njit(cache=True, nogil=True)
def _start(T, fx, fy, cx, cy, bf, pa, ra, pb, rb, max_cos, start):
    """Fill start with (u, v, rho) of a's frame from the rays or from a stereo pair, whichever has more parallax."""
    ua, va = (pa[0] - cx) / fx, (pa[1] - cy) / fy
    ub, vb = (pb[0] - cx) / fx, (pb[1] - cy) / fy
    r0 = T[0, 0] * ua + T[0, 1] * va + T[0, 2]
    r1 = T[1, 0] * ua + T[1, 1] * va + T[1, 2]
    r2 = T[2, 0] * ua + T[2, 1] * va + T[2, 2]
    lengths = math.sqrt((ua * ua + va * va + 1.0) * (ub * ub + vb * vb + 1.0))
    cos_rays = (r0 * ub + r1 * vb + r2) / lengths
    baseline = bf / fx
    cos_a, cos_b = _cos_stereo(ra, pa[0], bf, baseline), _cos_stereo(rb, pb[0], bf, baseline)
    cos_stereo = min(cos_a, cos_b)
    start[0], start[1] = ua, va
    if 0.0 < cos_rays < cos_stereo and (cos_stereo < 2.0 or cos_rays < max_cos):
        # the point on a's ray nearest to b's pixel: two equations (R ray + t rho) x (ub, vb, 1) = 0 in rho
        a0, a1 = T[0, 3] - ub * T[2, 3], T[1, 3] - vb * T[2, 3]
        b0, b1 = r0 - ub * r2, r1 - vb * r2
        square = a0 * a0 + a1 * a1
        if square == 0.0:
            return False
        start[2] = -(a0 * b0 + a1 * b1) / square
    elif cos_a < 2.0 and cos_a <= cos_b:
        start[2] = (pa[0] - ra) / bf
    elif cos_b < 2.0:
        depth = bf / (pb[0] - rb)
        q0, q1, q2 = depth * ub - T[0, 3], depth * vb - T[1, 3], depth - T[2, 3]
        x = T[0, 0] * q0 + T[1, 0] * q1 + T[2, 0] * q2
        y = T[0, 1] * q0 + T[1, 1] * q1 + T[2, 1] * q2
        z = T[0, 2] * q0 + T[1, 2] * q1 + T[2, 2] * q2
        if not z > 0.0:
            return False
        start[0], start[1], start[2] = x / z, y / z, 1.0 / z
    else:
        return False
    return start[2] > 0.0


@njit(cache=True, nogil=True)
def triangulate(T, camera, pa, ra, sa, pb, rb, sb, max_cos, ratio_limit, iterations, points, ok):
    """Fill points (N, 3) in a's frame and ok (N,): T is T_b_a, sigmas stand for the scales of the octaves."""
    fx, fy, cx, cy, bf = camera[0], camera[1], camera[2], camera[3], camera[4]
    state, delta, chi2 = np.empty(3), np.empty(3), np.empty(2)
    normal, gradient = np.empty((3, 3)), np.empty(3)
    c0 = -(T[0, 0] * T[0, 3] + T[1, 0] * T[1, 3] + T[2, 0] * T[2, 3])  # centre of b in a's frame
    c1 = -(T[0, 1] * T[0, 3] + T[1, 1] * T[1, 3] + T[2, 1] * T[2, 3])
    c2 = -(T[0, 2] * T[0, 3] + T[1, 2] * T[1, 3] + T[2, 2] * T[2, 3])
    for i in range(pa.shape[0]):
        ok[i] = False
        points[i] = math.nan
        if not _start(T, fx, fy, cx, cy, bf, pa[i], ra[i], pb[i], rb[i], max_cos, state):
            continue
        for _ in range(iterations):
            if not _step(
                T,
                fx,
                fy,
                cx,
                cy,
                bf,
                state[0],
                state[1],
                state[2],
                pa[i],
                ra[i],
                sa[i],
                pb[i],
                rb[i],
                sb[i],
                normal,
                gradient,
            ) or not _solve_3(normal, gradient, delta):
                break
            state += delta
        u, v, rho = state[0], state[1], state[2]
        if not rho > 0.0 or not _chi2(T, fx, fy, cx, cy, bf, u, v, rho, pa[i], ra[i], sa[i], pb[i], rb[i], sb[i], chi2):
            continue
        if not chi2[0] <= (5.991 if math.isnan(ra[i]) else 7.815):
            continue
        if not chi2[1] <= (5.991 if math.isnan(rb[i]) else 7.815):
            continue
        x, y, z = u / rho, v / rho, 1.0 / rho
        distance_a = math.sqrt(x * x + y * y + z * z)
        distance_b = math.sqrt((x - c0) ** 2 + (y - c1) ** 2 + (z - c2) ** 2)
        ratio, scales = distance_b / distance_a, sa[i] / sb[i]
        # what is twice as far appears at half the scale: d_b / d_a should be s_a / s_b
        if not math.isfinite(z) or ratio * ratio_limit < scales or ratio > scales * ratio_limit:
            continue
        points[i, 0], points[i, 1], points[i, 2] = x, y, z
        ok[i] = True
