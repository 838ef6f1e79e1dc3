# SPDX-License-Identifier: MIT
"""Compiled pose from three points (Persson and Nordberg, ECCV 2018) and the RANSAC loop; see `slamcli.vision.pnp`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def _real_root(c3, c2, c1, c0):
    """One real root of c3 x^3 + c2 x^2 + c1 x + c0, the largest of three; c3 is not 0."""
    a, b, c = c2 / c3, c1 / c3, c0 / c3
    p = b - a * a / 3.0
    q = a * (2.0 * a * a / 27.0 - b / 3.0) + c
    discriminant = 0.25 * q * q + p * p * p / 27.0
    if discriminant >= 0.0:
        w = -0.5 * q - math.copysign(math.sqrt(discriminant), q)
        u = math.copysign(abs(w) ** (1.0 / 3.0), w)
        x = (u - p / (3.0 * u) if u != 0.0 else 0.0) - a / 3.0
    else:
        cosine = 1.5 * q / p * math.sqrt(-3.0 / p)
        x = 2.0 * math.sqrt(-p / 3.0) * math.cos(math.acos(min(1.0, max(-1.0, cosine))) / 3.0) - a / 3.0
    for _ in range(3):  # the closed form loses digits where terms cancel
        slope = (3.0 * x + 2.0 * a) * x + b
        if slope == 0.0:
            break
        x -= (((x + a) * x + b) * x + c) / slope
    return x


@njit(cache=True, nogil=True)
def _null_direction(m, value, out):
    """Fill out with the unit vector v of (m - value I) v = 0, m symmetric (3, 3); False where there is no single one."""
    a, b, c = m[0, 0] - value, m[1, 1] - value, m[2, 2] - value
    d, e, f = m[0, 1], m[0, 2], m[1, 2]
    best = 0.0
    for k in range(3):  # cross products of two rows; the longest is the safest
        if k == 0:
            x, y, z = d * f - e * b, e * d - a * f, a * b - d * d
        elif k == 1:
            x, y, z = d * c - e * f, e * e - a * c, a * f - d * e
        else:
            x, y, z = b * c - f * f, f * e - d * c, d * f - b * e
        square = x * x + y * y + z * z
        if square > best:
            best = square
            scale = 1.0 / math.sqrt(square)
            out[0], out[1], out[2] = x * scale, y * scale, z * scale
    return best > 0.0


@njit(cache=True, nogil=True)
def _polish(lengths, a, b):
    """Two Newton steps on l_i^2 + l_j^2 + b_ij l_i l_j = a_ij for (12, 13, 23)."""
    for _ in range(2):
        r0 = lengths[0] * lengths[0] + lengths[1] * lengths[1] + b[0] * lengths[0] * lengths[1] - a[0]
        r1 = lengths[0] * lengths[0] + lengths[2] * lengths[2] + b[1] * lengths[0] * lengths[2] - a[1]
        r2 = lengths[1] * lengths[1] + lengths[2] * lengths[2] + b[2] * lengths[1] * lengths[2] - a[2]
        j00, j01 = 2.0 * lengths[0] + b[0] * lengths[1], 2.0 * lengths[1] + b[0] * lengths[0]
        j10, j12 = 2.0 * lengths[0] + b[1] * lengths[2], 2.0 * lengths[2] + b[1] * lengths[0]
        j21, j22 = 2.0 * lengths[1] + b[2] * lengths[2], 2.0 * lengths[2] + b[2] * lengths[1]
        determinant = -j00 * j12 * j21 - j01 * j10 * j22
        if determinant == 0.0:
            return
        lengths[0] -= (-j12 * j21 * r0 - j01 * j22 * r1 + j01 * j12 * r2) / determinant
        lengths[1] -= (-j10 * j22 * r0 + j00 * j22 * r1 - j00 * j12 * r2) / determinant
        lengths[2] -= (j10 * j21 * r0 - j00 * j21 * r1 - j01 * j10 * r2) / determinant


@njit(cache=True, nogil=True)
def _frame(p0, p1, p2, out):
    """Fill out (3, 3) with the orthonormal columns that a triangle spans; False for points on a line."""
    d0, d1, d2 = p1[0] - p0[0], p1[1] - p0[1], p1[2] - p0[2]
    e0, e1, e2 = p2[0] - p0[0], p2[1] - p0[1], p2[2] - p0[2]
    n0, n1, n2 = d1 * e2 - d2 * e1, d2 * e0 - d0 * e2, d0 * e1 - d1 * e0
    length, height = math.sqrt(d0 * d0 + d1 * d1 + d2 * d2), math.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
    if not height > 1e-9 * length * length:
        return False
    out[0, 0], out[1, 0], out[2, 0] = d0 / length, d1 / length, d2 / length
    out[0, 2], out[1, 2], out[2, 2] = n0 / height, n1 / height, n2 / height
    out[0, 1] = out[1, 2] * out[2, 0] - out[2, 2] * out[1, 0]
    out[1, 1] = out[2, 2] * out[0, 0] - out[0, 2] * out[2, 0]
    out[2, 1] = out[0, 2] * out[1, 0] - out[1, 2] * out[0, 0]
    return True


@njit(cache=True, nogil=True)
def _pose(lengths, rays, points, frame, pose):
    """Fill pose (3, 4) with what lays the triangle on its rays at these distances; False for a flat triangle."""
    camera, turned = np.empty((3, 3)), np.empty((3, 3))
    for i in range(3):
        for c in range(3):
            camera[i, c] = lengths[i] * rays[i, c]
    if not _frame(camera[0], camera[1], camera[2], turned):
        return False
    for i in range(3):
        for j in range(3):
            pose[i, j] = turned[i, 0] * frame[j, 0] + turned[i, 1] * frame[j, 1] + turned[i, 2] * frame[j, 2]
    for i in range(3):
        mean = 0.0
        for k in range(3):
            mean += camera[k, i]
            for c in range(3):
                mean -= pose[i, c] * points[k, c]
        pose[i, 3] = mean / 3.0
    return True


@njit(cache=True, nogil=True)
def _on_plane(n, g, a, b, rays, points, frame, poses, count):
    """Append to poses those of the distances on the plane n . l = 0: their number then."""
    if not abs(n[0]) > 1e-12:
        return count
    a12, a13, a23, b12, b13, b23 = a[0], a[1], a[2], b[0], b[1], b[2]
    w0, w1 = -n[1] / n[0], -n[2] / n[0]  # l1 = w0 l2 + w1 l3
    if abs(g) < 1.0:  # on the plane D1 = -g D2: the larger of the two
        qa = a23 * (w1 * w1 + 1.0 + b13 * w1) - a13
        qb = a23 * (2.0 * w0 * w1 + b13 * w0) - a13 * b23
        qc = a23 * w0 * w0 - a13
    else:
        qa = a23 * w1 * w1 - a12
        qb = a23 * (2.0 * w0 * w1 + b12 * w1) - a12 * b23
        qc = a23 * (w0 * w0 + 1.0 + b12 * w0) - a12
    discriminant = qb * qb - 4.0 * qa * qc
    if not discriminant >= 0.0:
        return count
    h = -0.5 * (qb + math.copysign(math.sqrt(discriminant), qb))
    lengths = np.empty(3)
    for k in range(2):
        if (qa if k == 0 else h) == 0.0:
            continue
        ratio = h / qa if k == 0 else qc / h  # l3 / l2
        if not ratio > 0.0:
            continue
        lengths[1] = math.sqrt(a23 / (1.0 + ratio * (ratio + b23)))
        lengths[2] = ratio * lengths[1]
        lengths[0] = w0 * lengths[1] + w1 * lengths[2]
        if not lengths[0] > 0.0:
            continue
        _polish(lengths, a, b)
        if count < 4 and _pose(lengths, rays, points, frame, poses[count]):
            count += 1
    return count


@njit(cache=True, nogil=True)
def p3p(rays, points, poses):
    """Fill poses (4, 3, 4) with those [R | t] that lay three points (rows of (3, 3)) on three unit rays: their number.

    l_i are the distances along the rays: l_i^2 + l_j^2 + b_ij l_i l_j = a_ij (eq. 3). Two differences of these without right
    side are quadrics D1, D2; one degenerate member D1 + g D2 of their pencil falls into two planes (section 3.2).
    """
    a, b = np.empty(3), np.empty(3)
    for k in range(3):
        i, j = (0, 0, 1)[k], (1, 2, 2)[k]
        a[k], b[k] = 0.0, 0.0
        for c in range(3):
            a[k] += (points[i, c] - points[j, c]) ** 2
            b[k] -= 2.0 * rays[i, c] * rays[j, c]
    frame = np.empty((3, 3))
    if not _frame(points[0], points[1], points[2], frame):
        return 0
    a12, a13, a23, b12, b13, b23 = a[0], a[1], a[2], b[0], b[1], b[2]
    # D1 = a23 M12 - a12 M23, D2 = a23 M13 - a13 M23 as (xx, yy, zz, xy, xz, yz)
    p0, p1, p2, p3, p4, p5 = a23, a23 - a12, -a12, 0.5 * a23 * b12, 0.0, -0.5 * a12 * b23
    q0, q1, q2, q3, q4, q5 = a23, -a13, a23 - a13, 0.0, 0.5 * a23 * b13, -0.5 * a13 * b23
    # det(D1 + g D2) by the adjugates
    s0, s1, s2 = p1 * p2 - p5 * p5, p0 * p2 - p4 * p4, p0 * p1 - p3 * p3
    s3, s4, s5 = p4 * p5 - p3 * p2, p3 * p5 - p1 * p4, p3 * p4 - p0 * p5
    t0, t1, t2 = q1 * q2 - q5 * q5, q0 * q2 - q4 * q4, q0 * q1 - q3 * q3
    t3, t4, t5 = q4 * q5 - q3 * q2, q3 * q5 - q1 * q4, q3 * q4 - q0 * q5
    c3 = q0 * t0 + q3 * t3 + q4 * t4
    c2 = p0 * t0 + p1 * t1 + p2 * t2 + 2.0 * (p3 * t3 + p4 * t4 + p5 * t5)
    c1 = q0 * s0 + q1 * s1 + q2 * s2 + 2.0 * (q3 * s3 + q4 * s4 + q5 * s5)
    c0 = p0 * s0 + p3 * s3 + p4 * s4
    if not abs(c3) > 1e-14 * (abs(c2) + abs(c1) + abs(c0)):
        return 0
    g = _real_root(c3, c2, c1, c0)
    m = np.empty((3, 3))
    m[0, 0], m[1, 1], m[2, 2] = p0 + g * q0, p1 + g * q1, p2 + g * q2
    m[0, 1], m[0, 2], m[1, 2] = p3 + g * q3, p4 + g * q4, p5 + g * q5
    trace = m[0, 0] + m[1, 1] + m[2, 2]
    minors = m[0, 0] * (m[1, 1] + m[2, 2]) + m[1, 1] * m[2, 2] - m[0, 1] ** 2 - m[0, 2] ** 2 - m[1, 2] ** 2
    root = math.sqrt(max(0.0, trace * trace - 4.0 * minors))
    first = 0.5 * (trace + math.copysign(root, trace))
    if first == 0.0:
        return 0
    second = minors / first  # the third eigenvalue is 0
    v0, v1, plane = np.empty(3), np.empty(3), np.empty(3)
    if not (_null_direction(m, first, v0) and _null_direction(m, second, v1)):
        return 0
    s, count = math.sqrt(max(0.0, -second / first)), 0
    for k in range(3):
        plane[k] = v0[k] - s * v1[k]
    count = _on_plane(plane, g, a, b, rays, points, frame, poses, count)
    for k in range(3):
        plane[k] = v0[k] + s * v1[k]
    return _on_plane(plane, g, a, b, rays, points, frame, poses, count)


@njit(cache=True, nogil=True)
def _cost(pose, points, pixels, weights, fx, fy, cx, cy, limit, bar):
    """Sum of min(chi2, limit) and the number of inliers; given up (inf) where the sum passes `bar`."""
    total, inliers = 0.0, 0
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        depth = pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3]
        chi2 = limit
        if depth > 0.0:
            du = fx * (pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3]) / depth + cx - pixels[i, 0]
            dv = fy * (pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3]) / depth + cy - pixels[i, 1]
            chi2 = (du * du + dv * dv) * weights[i]
        if chi2 < limit:
            inliers += 1
            total += chi2
        else:
            total += limit
        if total >= bar:
            return math.inf, 0
    return total, inliers


@njit(cache=True, nogil=True)
def ransac(points, pixels, weights, camera, samples, limit, log_miss, best):
    """Fill best (3, 4) with the pose of least truncated cost (Torr and Zisserman's MSAC): (iterations, inliers).

    Stops as soon as a sample without outlier has been drawn with the probability 1 - exp(log_miss), at the latest with the
    last row of `samples` (K, 3).
    """
    fx, fy, cx, cy = camera[0], camera[1], camera[2], camera[3]
    count = points.shape[0]
    rays, three, poses = np.empty((3, 3)), np.empty((3, 3)), np.empty((4, 3, 4))
    bar, best_inliers, needed, done = limit * count, 0, samples.shape[0], 0
    while done < needed:
        for k in range(3):
            i = samples[done, k]
            x, y = (pixels[i, 0] - cx) / fx, (pixels[i, 1] - cy) / fy
            norm = math.sqrt(x * x + y * y + 1.0)
            rays[k, 0], rays[k, 1], rays[k, 2] = x / norm, y / norm, 1.0 / norm
            three[k, 0], three[k, 1], three[k, 2] = points[i, 0], points[i, 1], points[i, 2]
        done += 1
        for k in range(p3p(rays, three, poses)):
            cost, inliers = _cost(poses[k], points, pixels, weights, fx, fy, cx, cy, limit, bar)
            if cost < bar:
                bar, best_inliers = cost, inliers
                best[:] = poses[k]
                good = (inliers / count) ** 3
                if good >= 1.0:
                    needed = done
                elif good > 0.0:
                    needed = min(needed, max(done, math.ceil(log_miss / math.log1p(-good))))
    return done, best_inliers
