# SPDX-License-Identifier: MIT
"""Bundle adjustment: normal equations with the points eliminated, steps of points, and residuals.

Observations are sorted by point; those by free cameras stand first among a point's own, by increasing rank (turn of the
camera's elimination). Increments are (phi, rho) in the camera's axes: a pose becomes [Exp(phi) | rho] pose. Work is given
in ranges of points with sums of their own, so that ranges can run on threads and be added up in a fixed order.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

MONO_BOUND = 5.991  # 95 % of chi2 with 2 degrees of freedom
STEREO_BOUND = 7.815  # with 3
NEAREST = 1e-6  # units of the map ahead of the camera from which on a point counts as seen
SHORTER = 2  # quarters of its step that a point tries before it stays
BEHIND = 1e8  # chi2 of a point behind the camera, so that no step gains by putting one there


@njit(cache=True, nogil=True)
def _loss(chi2, bound, robust):
    """Huber's loss of a squared residual, or the square."""
    if robust and chi2 > bound:
        return 2.0 * math.sqrt(bound * chi2) - bound
    return chi2


@njit(cache=True, nogil=True)
def _point_cost(begin, end, cameras, measured, weights, poses, x, y, z, camera, robust):
    """Half the losses of one point at (x, y, z)."""
    total = 0.0
    for m in range(begin, end):
        k = cameras[m]
        cz = poses[k, 2, 0] * x + poses[k, 2, 1] * y + poses[k, 2, 2] * z + poses[k, 2, 3]
        mono = math.isnan(measured[m, 2])
        chi2 = BEHIND
        if cz > NEAREST:
            inverse = 1.0 / cz
            cx = poses[k, 0, 0] * x + poses[k, 0, 1] * y + poses[k, 0, 2] * z + poses[k, 0, 3]
            cy = poses[k, 1, 0] * x + poses[k, 1, 1] * y + poses[k, 1, 2] * z + poses[k, 1, 3]
            u = camera[0] * cx * inverse + camera[2]
            eu, ev = u - measured[m, 0], camera[1] * cy * inverse + camera[3] - measured[m, 1]
            er = 0.0 if mono else u - camera[4] * inverse - measured[m, 2]
            chi2 = weights[m] * (eu * eu + ev * ev + er * er)
        total += _loss(chi2, MONO_BOUND if mono else STEREO_BOUND, robust)
    return 0.5 * total


@njit(cache=True, nogil=True)
def _observe(pose, x, y, z, measured, weight, camera, robust, out):
    """Projection of one point: A = J'J (a00, a02, a11, a12, a22; a01 is 0) and J'e by the point in the camera's frame.

    `out` (21,) takes these eight, weighted, the point there, the weight, 1 or 0 for a right column, the three errors, and
    the derivatives by x, y and z of column, row and right column that are neither 0 nor the same.
    Returns half the loss; behind the camera all is 0.
    """
    cx = pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3]
    cy = pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3]
    cz = pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3]
    mono = math.isnan(measured[2])
    bound = MONO_BOUND if mono else STEREO_BOUND
    if not cz > NEAREST:
        out[:] = 0.0
        return 0.5 * _loss(BEHIND, bound, robust)
    inverse = 1.0 / cz
    u = camera[0] * cx * inverse + camera[2]
    eu, ev = u - measured[0], camera[1] * cy * inverse + camera[3] - measured[1]
    er = 0.0 if mono else u - camera[4] * inverse - measured[2]
    chi2 = weight * (eu * eu + ev * ev + er * er)
    cost = 0.5 * _loss(chi2, bound, robust)
    if robust and chi2 > bound:
        weight *= math.sqrt(bound / chi2)
    jx, jy = camera[0] * inverse, camera[1] * inverse
    jxz, jyz = -jx * cx * inverse, -jy * cy * inverse
    out[8], out[9], out[10] = cx, cy, cz
    jr, jrz = (0.0, 0.0) if mono else (jx, jxz + camera[4] * inverse * inverse)
    out[0] = weight * (jx * jx + jr * jr)
    out[1] = weight * (jx * jxz + jr * jrz)
    out[2] = weight * (jy * jy)
    out[3] = weight * (jy * jyz)
    out[4] = weight * (jxz * jxz + jyz * jyz + jrz * jrz)
    out[5] = weight * (jx * eu + jr * er)
    out[6] = weight * (jy * ev)
    out[7] = weight * (jxz * eu + jyz * ev + jrz * er)
    out[11], out[12], out[13], out[14], out[15] = weight, 0.0 if mono else 1.0, eu, ev, er
    out[16], out[17], out[18], out[19], out[20] = jx, jy, jxz, jyz, jrz
    return cost


@njit(cache=True, nogil=True)
def _add_camera(seen, hessian, gradient):
    """Add one observation to its camera's block (6, 6), upper part, and gradient (6,)."""
    a00, a02, a11, a12, a22 = seen[0], seen[1], seen[2], seen[3], seen[4]
    q0, q1, q2, x, y, z = seen[5], seen[6], seen[7], seen[8], seen[9], seen[10]
    c00, c01, c02 = y * a02, y * a12 - z * a11, y * a22 - z * a12  # [p]x A
    c10, c11, c12 = z * a00 - x * a02, -x * a12, z * a02 - x * a22
    c20, c21, c22 = -y * a00, x * a11, x * a12 - y * a02
    hessian[0, 0] += y * c02 - z * c01
    hessian[0, 1] += z * c00 - x * c02
    hessian[0, 2] += x * c01 - y * c00
    hessian[0, 3] += c00
    hessian[0, 4] += c01
    hessian[0, 5] += c02
    hessian[1, 1] += z * c10 - x * c12
    hessian[1, 2] += x * c11 - y * c10
    hessian[1, 3] += c10
    hessian[1, 4] += c11
    hessian[1, 5] += c12
    hessian[2, 2] += x * c21 - y * c20
    hessian[2, 3] += c20
    hessian[2, 4] += c21
    hessian[2, 5] += c22
    hessian[3, 3] += a00
    hessian[3, 5] += a02
    hessian[4, 4] += a11
    hessian[4, 5] += a12
    hessian[5, 5] += a22
    gradient[0] += y * q2 - z * q1
    gradient[1] += z * q0 - x * q2
    gradient[2] += x * q1 - y * q0
    gradient[3] += q0
    gradient[4] += q1
    gradient[5] += q2


@njit(cache=True, nogil=True)
def _add_point(seen, pose, block, coupling):
    """Add one observation to its point's sums (9,): six of the block's upper part and three of the gradient.

    `coupling` (3, 6) takes the transposed block of camera and point: A R below [p]x A R.
    """
    a00, a02, a11, a12, a22 = seen[0], seen[1], seen[2], seen[3], seen[4]
    q0, q1, q2, x, y, z = seen[5], seen[6], seen[7], seen[8], seen[9], seen[10]
    for j in range(3):
        r0, r1, r2 = pose[0, j], pose[1, j], pose[2, j]
        b0, b1, b2 = a00 * r0 + a02 * r2, a11 * r1 + a12 * r2, a02 * r0 + a12 * r1 + a22 * r2
        coupling[j, 0], coupling[j, 1], coupling[j, 2] = y * b2 - z * b1, z * b0 - x * b2, x * b1 - y * b0
        coupling[j, 3], coupling[j, 4], coupling[j, 5] = b0, b1, b2
        block[6 + j] += r0 * q0 + r1 * q1 + r2 * q2
    b00, b10, b20 = coupling[0, 3], coupling[0, 4], coupling[0, 5]
    b01, b11, b21 = coupling[1, 3], coupling[1, 4], coupling[1, 5]
    b02, b12, b22 = coupling[2, 3], coupling[2, 4], coupling[2, 5]
    block[0] += pose[0, 0] * b00 + pose[1, 0] * b10 + pose[2, 0] * b20
    block[1] += pose[0, 0] * b01 + pose[1, 0] * b11 + pose[2, 0] * b21
    block[2] += pose[0, 0] * b02 + pose[1, 0] * b12 + pose[2, 0] * b22
    block[3] += pose[0, 1] * b01 + pose[1, 1] * b11 + pose[2, 1] * b21
    block[4] += pose[0, 1] * b02 + pose[1, 1] * b12 + pose[2, 1] * b22
    block[5] += pose[0, 2] * b02 + pose[1, 2] * b12 + pose[2, 2] * b22


@njit(cache=True, nogil=True)
def _add_shared(seen, pose, wanted, rows, coupling, hessian, gradient):
    """Add one observation to the sums of the shared intrinsics (fx, fy, cx, cy, bf and one unused).

    `wanted` (6,) is 1 for those that are refined, else 0. `rows` (6, 3) takes their products with the point in the camera's
    frame; `coupling` (3, 6), `hessian` (6, 6), upper part, and `gradient` (6,) are added to.
    """
    x, y, z, weight, stereo = seen[8], seen[9], seen[10], seen[11], seen[12]
    rows[:] = 0.0
    if weight == 0.0:
        return
    a, b = wanted[0] * x / z, wanted[1] * y / z
    c, d, e = wanted[2], wanted[3], -stereo * wanted[4] / z
    f = a * (1.0 + stereo)
    hessian[0, 0] += weight * f * a
    hessian[0, 2] += weight * f * c
    hessian[0, 4] += weight * a * e
    hessian[1, 1] += weight * b * b
    hessian[1, 3] += weight * b * d
    hessian[2, 2] += weight * (1.0 + stereo) * c * c
    hessian[2, 4] += weight * c * e
    hessian[3, 3] += weight * d * d
    hessian[4, 4] += weight * e * e
    gradient[0] += weight * a * (seen[13] + seen[15])
    gradient[1] += weight * b * seen[14]
    gradient[2] += weight * c * (seen[13] + seen[15])
    gradient[3] += weight * d * seen[14]
    gradient[4] += weight * e * seen[15]
    jx, jy, jxz, jyz, jrz = seen[16], seen[17], seen[18], seen[19], seen[20]
    both, depth = jx * (1.0 + stereo), jxz + stereo * jrz
    rows[0, 0], rows[0, 2] = weight * a * both, weight * a * depth
    rows[1, 1], rows[1, 2] = weight * b * jy, weight * b * jyz
    rows[2, 0], rows[2, 2] = weight * c * both, weight * c * depth
    rows[3, 1], rows[3, 2] = weight * d * jy, weight * d * jyz
    rows[4, 0], rows[4, 2] = weight * e * jx, weight * e * jrz
    for i in range(5):
        for j in range(3):
            coupling[j, i] += rows[i, 0] * pose[0, j] + rows[i, 1] * pose[1, j] + rows[i, 2] * pose[2, j]


@njit(cache=True, nogil=True)
def _add_pair(seen, rows, block):
    """Add one observation to the block (6, 6) of its camera and the shared intrinsics."""
    x, y, z = seen[8], seen[9], seen[10]
    for i in range(5):
        k0, k1, k2 = rows[i, 0], rows[i, 1], rows[i, 2]
        block[0, i] += y * k2 - z * k1
        block[1, i] += z * k0 - x * k2
        block[2, i] += x * k1 - y * k0
        block[3, i] += k0
        block[4, i] += k1
        block[5, i] += k2


@njit(cache=True, nogil=True)
def _factorise_point(block, damping, factor):
    """Cholesky factor of a point's damped block into `factor` (9,): l10, l20, l21, 1/l00, 1/l11, 1/l22, L^-1 gradient."""
    largest = max(block[0], block[3], block[5])
    floor = 1e-6 * largest
    d0 = block[0] + damping * max(block[0], floor)
    d1 = block[3] + damping * max(block[3], floor)
    d2 = block[5] + damping * max(block[5], floor)
    least = 1e-14 * largest
    l00 = math.sqrt(max(d0, least))
    l10, l20 = block[1] / l00, block[2] / l00
    l11 = math.sqrt(max(d1 - l10 * l10, least))
    l21 = (block[4] - l10 * l20) / l11
    l22 = math.sqrt(max(d2 - l20 * l20 - l21 * l21, least))
    factor[0], factor[1], factor[2] = l10, l20, l21
    factor[3], factor[4], factor[5] = 1.0 / l00, 1.0 / l11, 1.0 / l22
    factor[6] = block[6] * factor[3]
    factor[7] = (block[7] - l10 * factor[6]) * factor[4]
    factor[8] = (block[8] - l20 * factor[6] - l21 * factor[7]) * factor[5]


@njit(cache=True, nogil=True)
def _solve_coupling(couplings, m, factor, gradients, rank):
    """Turn the transposed block W = couplings[m] (3, 6) into that of W L^-T, and subtract its part of the gradient."""
    l10, l20, l21, i0, i1, i2 = factor[0], factor[1], factor[2], factor[3], factor[4], factor[5]
    y0, y1, y2 = factor[6], factor[7], factor[8]
    for r in range(6):
        z0 = couplings[m, 0, r] * i0
        z1 = (couplings[m, 1, r] - l10 * z0) * i1
        z2 = (couplings[m, 2, r] - l20 * z0 - l21 * z1) * i2
        couplings[m, 0, r], couplings[m, 1, r], couplings[m, 2, r] = z0, z1, z2
        gradients[rank, r] -= z0 * y0 + z1 * y1 + z2 * y2


@njit(cache=True, nogil=True)
def _subtract_product(left, right, block):
    """Subtract left' right from `block` (6, 6); both (3, 6)."""
    x0, x1, x2, x3, x4, x5 = right[0, 0], right[0, 1], right[0, 2], right[0, 3], right[0, 4], right[0, 5]
    y0, y1, y2, y3, y4, y5 = right[1, 0], right[1, 1], right[1, 2], right[1, 3], right[1, 4], right[1, 5]
    z0, z1, z2, z3, z4, z5 = right[2, 0], right[2, 1], right[2, 2], right[2, 3], right[2, 4], right[2, 5]
    for r in range(6):
        a, b, c = left[0, r], left[1, r], left[2, r]
        b0 = block[r, 0] - (a * x0 + b * y0 + c * z0)
        b1 = block[r, 1] - (a * x1 + b * y1 + c * z1)
        b2 = block[r, 2] - (a * x2 + b * y2 + c * z2)
        b3 = block[r, 3] - (a * x3 + b * y3 + c * z3)
        b4 = block[r, 4] - (a * x4 + b * y4 + c * z4)
        b5 = block[r, 5] - (a * x5 + b * y5 + c * z5)
        block[r, 0], block[r, 1], block[r, 2] = b0, b1, b2
        block[r, 3], block[r, 4], block[r, 5] = b3, b4, b5


@njit(cache=True, nogil=True)
def _eliminate(begin, end, ranks, slots, couplings, factor, blocks, gradient):
    """Subtract one point's part from the reduced system; `couplings` become W L^-T (transposed)."""
    for m in range(begin, end):
        _solve_coupling(couplings, m, factor, gradient, ranks[m])
    # most of the work: written out, this is three times as fast as with `_subtract_product`
    for n in range(begin, end):
        x0, x1, x2 = couplings[n, 0, 0], couplings[n, 0, 1], couplings[n, 0, 2]
        x3, x4, x5 = couplings[n, 0, 3], couplings[n, 0, 4], couplings[n, 0, 5]
        y0, y1, y2 = couplings[n, 1, 0], couplings[n, 1, 1], couplings[n, 1, 2]
        y3, y4, y5 = couplings[n, 1, 3], couplings[n, 1, 4], couplings[n, 1, 5]
        z0, z1, z2 = couplings[n, 2, 0], couplings[n, 2, 1], couplings[n, 2, 2]
        z3, z4, z5 = couplings[n, 2, 3], couplings[n, 2, 4], couplings[n, 2, 5]
        for m in range(begin, n + 1):
            block = blocks[slots[ranks[m], ranks[n]]]
            for r in range(6):
                a, b, c = couplings[m, 0, r], couplings[m, 1, r], couplings[m, 2, r]
                b0 = block[r, 0] - (a * x0 + b * y0 + c * z0)
                b1 = block[r, 1] - (a * x1 + b * y1 + c * z1)
                b2 = block[r, 2] - (a * x2 + b * y2 + c * z2)
                b3 = block[r, 3] - (a * x3 + b * y3 + c * z3)
                b4 = block[r, 4] - (a * x4 + b * y4 + c * z4)
                b5 = block[r, 5] - (a * x5 + b * y5 + c * z5)
                block[r, 0], block[r, 1], block[r, 2] = b0, b1, b2
                block[r, 3], block[r, 4], block[r, 5] = b3, b4, b5
            if ranks[m] == ranks[n] and m != n:  # one camera saw the point twice: both orders fall into its own block
                _subtract_product(couplings[n], couplings[m], block)


@njit(cache=True, nogil=True)
def _eliminate_shared(p, begin, end, ranks, slots, couplings, shared, factor, blocks, gradient):
    """As `_eliminate`, after it, for the block of point p and the shared intrinsics, whose rank is the last."""
    last = len(gradient) - 1
    _solve_coupling(shared, p, factor, gradient, last)
    for m in range(begin, end):
        _subtract_product(couplings[m], shared[p], blocks[slots[ranks[m], last]])
    _subtract_product(shared[p], shared[p], blocks[slots[last, last]])


@njit(cache=True, nogil=True)
def build(
    first, last, starts, free_ends, cameras, ranks, slots, measured, weights, poses, points, held, camera, wanted, robust,
    damping, couplings, shared, factors, costs, hessians, gradients, blocks, reduced,
):  # fmt: skip
    """Linearise points first to last and subtract them from the reduced system.

    Cameras' own blocks go to `hessians` (F, 6, 6), upper parts, and `gradients` (F, 6); what the points take away to
    `blocks` (B, 6, 6) at slots [rank, rank], and `reduced` (F, 6). Per point: `factors` (P, 9), `costs` (P,); per
    observation: `couplings` (M, 3, 6). `held` (P,): points that do not move. With any of `wanted` (6,) the intrinsics are
    refined: theirs is the last row of all sums, and `shared` (P, 3, 6) takes their couplings.
    """
    calibrate = wanted.max() > 0.0
    rows, own = np.empty((6, 3)), len(gradients) - 1
    seen, block, unused = np.empty(21), np.empty(9), np.empty((3, 6))
    for p in range(first, last):
        begin, middle, end = starts[p], free_ends[p], starts[p + 1]
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        block[:] = 0.0
        if calibrate:
            shared[p] = 0.0
        cost = 0.0
        for m in range(begin, end):
            pose = poses[cameras[m]]
            cost += _observe(pose, x, y, z, measured[m], weights[m], camera, robust, seen)
            if m < middle:
                _add_camera(seen, hessians[ranks[m]], gradients[ranks[m]])
                _add_point(seen, pose, block, couplings[m])
            else:
                _add_point(seen, pose, block, unused)
            if calibrate:
                _add_shared(seen, pose, wanted, rows, shared[p], hessians[own], gradients[own])
                if m < middle:
                    _add_pair(seen, rows, blocks[slots[ranks[m], own]])
        costs[p] = cost
        if held[p] or block[0] + block[3] + block[5] <= 0.0:
            factors[p] = 0.0
            continue
        _factorise_point(block, damping, factors[p])
        _eliminate(begin, middle, ranks, slots, couplings, factors[p], blocks, reduced)
        if calibrate:
            _eliminate_shared(p, begin, middle, ranks, slots, couplings, shared, factors[p], blocks, reduced)


@njit(cache=True, nogil=True)
def move_points(
    first, last, starts, free_ends, cameras, ranks, measured, weights, poses, points, camera, calibrate, robust, couplings, shared,
    factors, costs, steps, moved,
):  # fmt: skip
    """Write where points first to last go with the cameras' `steps` (F, 6) to `moved`; return the cost there.

    `poses` and `camera` are those after the steps, of which the last is the intrinsics' if `calibrate`. A point whose own cost rose stays where it was if that is the better place: one point
    that runs away along its ray must not spoil the step of all.
    """
    total = 0.0
    for p in range(first, last):
        begin, end = starts[p], starts[p + 1]
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        factor = factors[p]
        if factor[3] == 0.0:
            moved[p] = points[p]
            total += _point_cost(begin, end, cameras, measured, weights, poses, x, y, z, camera, robust)
            continue
        s0, s1, s2 = factor[6], factor[7], factor[8]
        for m in range(begin, free_ends[p]):
            rank = ranks[m]
            for r in range(6):
                step = steps[rank, r]
                s0 += couplings[m, 0, r] * step
                s1 += couplings[m, 1, r] * step
                s2 += couplings[m, 2, r] * step
        if calibrate:
            for r in range(6):
                step = steps[len(steps) - 1, r]
                s0 += shared[p, 0, r] * step
                s1 += shared[p, 1, r] * step
                s2 += shared[p, 2, r] * step
        d2 = -s2 * factor[5]
        d1 = (-s1 - factor[2] * d2) * factor[4]
        d0 = (-s0 - factor[0] * d1 - factor[1] * d2) * factor[3]
        cost = _point_cost(begin, end, cameras, measured, weights, poses, x + d0, y + d1, z + d2, camera, robust)
        if not cost <= costs[p]:
            stays = _point_cost(begin, end, cameras, measured, weights, poses, x, y, z, camera, robust)
            for _ in range(SHORTER):
                if cost <= stays:
                    break
                d0, d1, d2 = 0.25 * d0, 0.25 * d1, 0.25 * d2
                cost = _point_cost(
                    begin, end, cameras, measured, weights, poses, x + d0, y + d1, z + d2, camera, robust
                )
            if not cost <= stays:
                d0, d1, d2, cost = 0.0, 0.0, 0.0, stays
        moved[p, 0], moved[p, 1], moved[p, 2] = x + d0, y + d1, z + d2
        total += cost
    return total
