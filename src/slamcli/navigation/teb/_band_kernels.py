# SPDX-License-Identifier: MIT
"""Kernels for the least-squares problem of a timed elastic band; see `slamcli.navigation.teb.band`.

Unknowns stand in the order x, y, yaw, dt of pose 0, of pose 1, ...; the last pose has no dt. No residual touches more than
three poses and two times in a row, eleven unknowns, so the normal equations are banded. One file, a long one, because
a kernel calls only what stands in its own.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

# Places in the vector of settings, in the order of `slamcli.navigation.teb.settings.SETTINGS`.
MAX_X, MAX_BACK, MAX_Y, MAX_TRANS, MAX_THETA, ACC_X, ACC_Y, ACC_THETA, MIN_RADIUS, EPSILON = range(10)
W_MAX_X, W_MAX_Y, W_MAX_THETA, W_ACC_X, W_ACC_Y, W_ACC_THETA, W_NH, W_FORWARD, W_RADIUS = range(10, 19)
W_TIME, W_PATH, W_OBSTACLE, W_INFLATION, W_DYNAMIC, W_DYNAMIC_INFLATION, W_RATIO, W_VIA, W_ROTDIR = range(19, 28)
MIN_DIST, INFLATION, DYNAMIC_INFLATION, EXPONENT, RATIO_MAX, RATIO_LOWER, RATIO_UPPER = range(28, 35)
START_X, START_Y, START_THETA, FREE_GOAL, ROTDIR, HOLONOMIC, EXACT_ARC, CARLIKE, CIRCUMSCRIBED = range(35, 44)

# Kinds of cost that are told apart.
TIME, OBSTACLE, VIA, OTHER = range(4)
BAND = 10
MIN_DT, MAX_STEP = 1e-3, 0.3
_SIGN_STEEPNESS = 100.0
"""The sign of a speed is the soft v / (1 + |v|) of this many times the way ahead in metres, as in the original."""


@njit(cache=True, nogil=True)
def below(value: float, bound: float, epsilon: float) -> tuple[float, float]:
    """Return the penalty, and its slope, of a value under bound + epsilon."""
    if value >= bound + epsilon:
        return 0.0, 0.0
    return bound + epsilon - value, -1.0


@njit(cache=True, nogil=True)
def outside(value: float, low: float, high: float, epsilon: float) -> tuple[float, float]:
    """Return the penalty, and its slope, of a value outside low + epsilon to high - epsilon."""
    if value < low + epsilon:
        return low + epsilon - value, -1.0
    if value <= high - epsilon:
        return 0.0, 0.0
    return value - (high - epsilon), 1.0


@njit(cache=True, nogil=True)
def wrapped(angle: float) -> float:
    """Return the angle in -pi to pi."""
    return angle - 2.0 * np.pi * np.floor((angle + np.pi) / (2.0 * np.pi))


@njit(cache=True, nogil=True)
def segment(poses: Floats, dts: Floats, i: int, exact: bool, holonomic: bool, speed: Floats, slope: Floats) -> None:
    """Write the speeds forward, sideways and turning between poses i and i + 1, and their slopes by its seven unknowns.

    speed : float64 (3, N); slope : float64 (3, N, 7), x, y, yaw, dt, x', y', yaw'.
    """
    dt = dts[i]
    dx, dy = poses[i + 1, 0] - poses[i, 0], poses[i + 1, 1] - poses[i, 1]
    c, s = np.cos(poses[i, 2]), np.sin(poses[i, 2])
    ahead, left = dx * c + dy * s, dy * c - dx * s
    turn = wrapped(poses[i + 1, 2] - poses[i, 2])
    by_x, by_y, by_turn, by_yaw = c, s, 0.0, left
    way = ahead
    if not holonomic:
        distance = np.sqrt(dx * dx + dy * dy)
        stretch, stretch_slope = 1.0, 0.0
        if exact:  # from the chord to the arc
            half = 0.5 * turn
            if abs(half) < 1e-4:
                stretch, stretch_slope = 1.0 + half * half / 6.0, half / 6.0
            else:
                sine = np.sin(half)
                stretch = half / sine
                stretch_slope = 0.5 * (sine - half * np.cos(half)) / (sine * sine)
        soft = 1.0 + _SIGN_STEEPNESS * abs(ahead)
        sign, sign_slope = _SIGN_STEEPNESS * ahead / soft, _SIGN_STEEPNESS / (soft * soft)
        ux, uy = (dx / distance, dy / distance) if distance > 1e-12 else (0.0, 0.0)
        length = distance * stretch
        way = length * sign
        by_x = ux * stretch * sign + length * sign_slope * c
        by_y = uy * stretch * sign + length * sign_slope * s
        by_yaw = length * sign_slope * left
        by_turn = distance * stretch_slope * sign
    speed[0, i], speed[1, i], speed[2, i] = way / dt, left / dt, turn / dt
    slope[0, i, 0], slope[0, i, 1], slope[0, i, 2] = -by_x / dt, -by_y / dt, (by_yaw - by_turn) / dt
    slope[0, i, 3] = -way / dt / dt
    slope[0, i, 4], slope[0, i, 5], slope[0, i, 6] = by_x / dt, by_y / dt, by_turn / dt
    slope[1, i, 0], slope[1, i, 1], slope[1, i, 2], slope[1, i, 3] = s / dt, -c / dt, -ahead / dt, -left / dt / dt
    slope[1, i, 4], slope[1, i, 5], slope[1, i, 6] = -s / dt, c / dt, 0.0
    slope[2, i, :] = 0.0
    slope[2, i, 2], slope[2, i, 3], slope[2, i, 6] = -1.0 / dt, -turn / dt / dt, 1.0 / dt


@njit(cache=True, nogil=True)
def add(H: Floats, b: Floats, first: int, slope: Floats, scale: float, error: float, weight: float) -> float:
    """Add a residual whose slopes by the unknowns from `first` on are scale * slope; return its cost."""
    for r in range(slope.shape[0] if error != 0.0 else 0):
        part = weight * scale * slope[r]
        b[first + r] -= part * error
        for q in range(r + 1 if part != 0.0 else 0):
            H[first + r, r - q] += part * scale * slope[q]
    return weight * error * error


@njit(cache=True, nogil=True)
def distance_to(
    outline: Floats, closed: bool, x: float, y: float, yaw: float, px: float, py: float, by: Floats
) -> float:
    """Return the distance of a point from the robot's outline at a pose, negative inside; its slopes go to `by` (3,).

    outline : float64 (S, 5), segments x1, y1, x2, y2 in the base frame and how thick they are (a radius).
    """
    c, s = np.cos(yaw), np.sin(yaw)
    dx, dy = px - x, py - y
    bx, b_y = c * dx + s * dy, c * dy - s * dx
    best, nx, ny, inside = np.inf, 0.0, 0.0, False
    for k in range(outline.shape[0]):
        x1, y1 = outline[k, 0], outline[k, 1]
        ex, ey = outline[k, 2] - x1, outline[k, 3] - y1
        squared = ex * ex + ey * ey
        along = 0.0
        if squared > 0.0:
            along = min(1.0, max(0.0, ((bx - x1) * ex + (b_y - y1) * ey) / squared))
        gx, gy = bx - x1 - along * ex, b_y - y1 - along * ey
        far = np.sqrt(gx * gx + gy * gy)
        if far - outline[k, 4] < best:
            best = far - outline[k, 4]
            nx, ny = (gx / far, gy / far) if far > 1e-12 else (0.0, 0.0)
        if closed and (y1 > b_y) != (y1 + ey > b_y) and bx < x1 + (b_y - y1) / ey * ex:
            inside = not inside
    if inside:
        best, nx, ny = -best, -nx, -ny
    by[0], by[1] = -(c * nx - s * ny), -(s * nx + c * ny)
    by[2] = nx * b_y - ny * bx
    return best


@njit(cache=True, nogil=True)
def add_motion(poses: Floats, dts: Floats, p: Floats, speed: Floats, slope: Floats, H: Floats, b: Floats) -> float:
    """Add the bounds of speed, acceleration and the kinematics; return their cost."""
    last = dts.shape[0] - 1
    holonomic = p[HOLONOMIC] != 0.0
    wide = np.empty(11)
    cost = 0.0
    for i in range(last + 1):
        segment(poses, dts, i, p[EXACT_ARC] != 0.0, holonomic, speed, slope)
        for channel in range(3):
            if channel == 1 and not holonomic:
                continue
            low = -p[MAX_BACK] if channel == 0 else -p[MAX_Y + (2 if channel == 2 else 0)]
            high = p[MAX_X] if channel == 0 else -low
            epsilon = 0.0 if channel == 1 else p[EPSILON]
            if holonomic and channel < 2:  # the speed over ground is bounded, too; the bound is taken as constant
                other = min(abs(speed[1 - channel, i]), p[MAX_TRANS])
                room = np.sqrt(p[MAX_TRANS] ** 2 - other**2)
                low, high = max(low, -room), min(high, room)
            error, sign = outside(speed[channel, i], low, high, epsilon)
            cost += add(H, b, 4 * i, slope[channel, i], sign, error, p[W_MAX_X + channel])
            bound = p[ACC_X + channel]
            if i > 0:
                both = dts[i - 1] + dts[i]
                rate = 2.0 * (speed[channel, i] - speed[channel, i - 1]) / both
                error, sign = outside(rate, -bound, bound, p[EPSILON])
                if error > 0.0:
                    wide[:] = 0.0
                    wide[:7] -= slope[channel, i - 1] * (2.0 / both)
                    wide[4:] += slope[channel, i] * (2.0 / both)
                    wide[3] -= rate / both
                    wide[7] -= rate / both
                    cost += add(H, b, 4 * (i - 1), wide, sign, error, p[W_ACC_X + channel])
            for end in range(2):  # from the robot's speed now, and to rest
                if i == end * last and (end == 0 or p[FREE_GOAL] == 0.0):
                    way = 1.0 - 2.0 * end
                    rate = way * (speed[channel, i] - (1 - end) * p[START_X + channel]) / dts[i]
                    wide[:7] = way * slope[channel, i] / dts[i]
                    wide[3] -= rate / dts[i]
                    error, sign = outside(rate, -bound, bound, p[EPSILON])
                    cost += add(H, b, 4 * i, wide[:7], sign, error, p[W_ACC_X + channel])
    return cost


@njit(cache=True, nogil=True)
def add_kinematics(poses: Floats, p: Floats, H: Floats, b: Floats) -> float:
    """Add what a robot on wheels cannot do, the length of the way, and the turning direction it shall prefer."""
    j = np.zeros(7)
    cost = 0.0
    for i in range(poses.shape[0] - 1):
        dx, dy = poses[i + 1, 0] - poses[i, 0], poses[i + 1, 1] - poses[i, 1]
        c1, s1 = np.cos(poses[i, 2]), np.sin(poses[i, 2])
        c2, s2 = np.cos(poses[i + 1, 2]), np.sin(poses[i + 1, 2])
        distance = np.sqrt(dx * dx + dy * dy)
        turn = wrapped(poses[i + 1, 2] - poses[i, 2])
        j[0], j[1], j[2] = s1 + s2, -(c1 + c2), -s1 * dy - c1 * dx
        j[4], j[5], j[6] = -j[0], -j[1], -s2 * dy - c2 * dx
        error = (c1 + c2) * dy - (s1 + s2) * dx  # Roesmann 2012, eq. 11: both poses lie on one arc
        cost += add(H, b, 4 * i, j, 1.0, error, p[W_NH])
        if p[CARLIKE] == 0.0:
            error, sign = below(dx * c1 + dy * s1, 0.0, 0.0)
            j[0], j[1], j[2] = -c1, -s1, dy * c1 - dx * s1
            j[4], j[5], j[6] = c1, s1, 0.0
            cost += add(H, b, 4 * i, j, sign, error, p[W_FORWARD])
        if distance > 1e-12:
            ux, uy = dx / distance, dy / distance
            j[0], j[1], j[2], j[4], j[5], j[6] = -ux, -uy, 0.0, ux, uy, 0.0
            cost += add(H, b, 4 * i, j, 1.0, distance, p[W_PATH])
            if p[CARLIKE] != 0.0 and turn != 0.0:
                size, side = abs(turn), np.sign(turn)
                radius, by_turn = distance / size, -distance / (size * size)
                if p[EXACT_ARC] != 0.0:
                    sine = np.sin(0.5 * size)
                    radius, by_turn = 0.5 * distance / sine, -0.25 * distance * np.cos(0.5 * size) / (sine * sine)
                error, sign = below(radius, p[MIN_RADIUS], 0.0)
                grow = radius / distance
                j[0], j[1], j[4], j[5] = -ux * grow, -uy * grow, ux * grow, uy * grow
                j[2], j[6] = -side * by_turn, side * by_turn
                cost += add(H, b, 4 * i, j, sign, error, p[W_RADIUS])
        if p[ROTDIR] != 0.0 and i < 3:
            error, sign = below(p[ROTDIR] * turn, 0.0, 0.0)
            j[:] = 0.0
            j[2], j[6] = -p[ROTDIR], p[ROTDIR]
            cost += add(H, b, 4 * i, j, sign, error, p[W_ROTDIR])
    return cost


@njit(cache=True, nogil=True)
def add_clearance(p: Floats, far: float, by: Floats, i: int, dynamic: bool, H: Floats, b: Floats) -> float:
    """Add the two penalties of pose i at a distance from one obstacle; return their cost."""
    weight, soft, reach = p[W_OBSTACLE], p[W_INFLATION], p[INFLATION]
    if dynamic:
        weight, soft, reach = p[W_DYNAMIC], p[W_DYNAMIC_INFLATION], p[DYNAMIC_INFLATION]
    error, sign = below(far, p[MIN_DIST], p[EPSILON])
    if error > 0.0 and not dynamic and p[EXPONENT] != 1.0 and p[MIN_DIST] > 0.0:
        share = error / p[MIN_DIST]
        sign *= p[EXPONENT] * share ** (p[EXPONENT] - 1.0)
        error = p[MIN_DIST] * share ** p[EXPONENT]
    cost = add(H, b, 4 * i, by, sign, error, weight)
    if reach > p[MIN_DIST]:
        error, sign = below(far, reach, 0.0)
        cost += add(H, b, 4 * i, by, sign, error, soft)
    return cost


@njit(cache=True, nogil=True)
def add_speed_limit(
    p: Floats, i: int, far: float, by: Floats, speed: Floats, slope: Floats, H: Floats, b: Floats
) -> float:
    """Add the bound of the speeds near an obstacle; return its cost."""
    span = p[RATIO_UPPER] - p[RATIO_LOWER]
    ratio, ratio_slope = p[RATIO_MAX], 0.0
    if far < p[RATIO_LOWER]:
        ratio = 0.0
    elif far <= p[RATIO_UPPER] and span > 0.0:
        ratio, ratio_slope = p[RATIO_MAX] * (far - p[RATIO_LOWER]) / span, p[RATIO_MAX] / span
    j = np.empty(7)
    cost = 0.0
    for channel in range(0, 3, 2):
        limit = p[MAX_X] if channel == 0 else p[MAX_THETA]
        error, sign = outside(speed[channel, i], -ratio * limit, ratio * limit, 0.0)
        if error > 0.0:
            j[:] = sign * slope[channel, i]
            j[:3] -= ratio_slope * limit * by
            cost += add(H, b, 4 * i, j, 1.0, error, p[W_RATIO])
    return cost


@njit(cache=True, nogil=True)
def linearise(
    poses: Floats, dts: Floats, p: Floats, outline: Floats, closed: bool, points: Floats, starts: Ints, near: Ints,
    moving: Floats, via: Floats, H: Floats, b: Floats, costs: Floats,
) -> float:  # fmt: skip
    """Write the normal equations H step = b of all residuals at a band and its costs by kind; return the whole cost.

    poses : (N, 3); dts : (N - 1,); points : (M, 2) obstacles, those of pose i are near[starts[i]:starts[i + 1]]; moving :
    (D, 4) pose, x, y, radius; via : (V, 3) pose, x, y; H : (4 N, 11), H[r, d] = element (r, r - d); b : (4 N,); costs : (4,).
    """
    num = poses.shape[0]
    H[:], b[:], costs[:] = 0.0, 0.0, 0.0
    speed, slope, by, one = np.empty((3, num)), np.empty((3, num, 7)), np.empty(3), np.ones(1)
    costs[OTHER] = add_motion(poses, dts, p, speed, slope, H, b) + add_kinematics(poses, p, H, b)
    for i in range(num - 1):
        costs[TIME] += add(H, b, 4 * i + 3, one, 1.0, dts[i], p[W_TIME])
    reach = p[CIRCUMSCRIBED] + max(p[MIN_DIST] + p[EPSILON], p[INFLATION])
    if p[W_RATIO] > 0.0:
        reach = max(reach, p[CIRCUMSCRIBED] + p[RATIO_UPPER])
    for i in range(1, num - 1):
        x, y, yaw = poses[i, 0], poses[i, 1], poses[i, 2]
        for k in range(starts[i], starts[i + 1]):
            px, py = points[near[k], 0], points[near[k], 1]
            if (px - x) ** 2 + (py - y) ** 2 >= reach * reach:
                continue
            far = distance_to(outline, closed, x, y, yaw, px, py, by)
            costs[OBSTACLE] += add_clearance(p, far, by, i, False, H, b)
            if p[W_RATIO] > 0.0:
                costs[OBSTACLE] += add_speed_limit(p, i, far, by, speed, slope, H, b)
    for k in range(moving.shape[0]):
        i = int(moving[k, 0])
        far = distance_to(outline, closed, poses[i, 0], poses[i, 1], poses[i, 2], moving[k, 1], moving[k, 2], by)
        costs[OBSTACLE] += add_clearance(p, far - moving[k, 3], by, i, True, H, b)
    for k in range(via.shape[0]):
        i = int(via[k, 0])
        dx, dy = poses[i, 0] - via[k, 1], poses[i, 1] - via[k, 2]
        far = np.sqrt(dx * dx + dy * dy)
        if far > 1e-12:
            by[0], by[1], by[2] = dx / far, dy / far, 0.0
            costs[VIA] += add(H, b, 4 * i, by, 1.0, far, p[W_VIA])
    return float(costs.sum())


@njit(cache=True, nogil=True)
def solve(H: Floats, b: Floats, size: int, damping: float, L: Floats, x: Floats) -> bool:
    """Write the solution of (H + damping I) x = b by a banded Cholesky factorisation; False if it is not positive."""
    for i in range(size):
        for d in range(min(i, BAND), -1, -1):
            j = i - d
            total = H[i, d]
            for k in range(max(0, i - BAND), j):
                total -= L[i, i - k] * L[j, j - k]
            if d > 0:
                L[i, d] = total / L[j, 0]
            elif total + damping > 0.0:
                L[i, 0] = np.sqrt(total + damping)
            else:
                return False
    for i in range(size):
        total = b[i]
        for k in range(max(0, i - BAND), i):
            total -= L[i, i - k] * x[k]
        x[i] = total / L[i, 0]
    for i in range(size - 1, -1, -1):
        total = x[i]
        for k in range(i + 1, min(size, i + BAND + 1)):
            total -= L[k, k - i] * x[k]
        x[i] = total / L[i, 0]
    return True


@njit(cache=True, nogil=True)
def fix_ends(H: Floats, b: Floats, num: int) -> None:
    """Take the first and the last pose out of the normal equations."""
    for end in range(2):
        for q in range(3):
            r = 4 * end * (num - 1) + q
            b[r] = 0.0
            for d in range(BAND + 1):
                H[r, d] = 0.0
                if r + d < 4 * num:
                    H[r + d, d] = 0.0
            H[r, 0] = 1.0


@njit(cache=True, nogil=True)
def optimise(
    poses: Floats, dts: Floats, p: Floats, outline: Floats, closed: bool, points: Floats, starts: Ints, near: Ints,
    moving: Floats, via: Floats, iterations: int, costs: Floats,
) -> float:  # fmt: skip
    """Improve a band in place by Levenberg-Marquardt steps (Nielsen's damping); return its cost, by kind in `costs`."""
    num = poses.shape[0]
    size = 4 * num - 1
    H, b, H2, b2 = np.empty((4 * num, BAND + 1)), np.empty(4 * num), np.empty((4 * num, BAND + 1)), np.empty(4 * num)
    L, step, costs2 = np.empty((4 * num, BAND + 1)), np.empty(4 * num), np.empty(4)
    new_poses, new_dts = np.empty_like(poses), np.empty_like(dts)
    cost = linearise(poses, dts, p, outline, closed, points, starts, near, moving, via, H, b, costs)
    fix_ends(H, b, num)
    damping, growth = 1e-5 * max(1e-12, H[:size, 0].max()), 2.0
    for _ in range(iterations):
        gain = 0.0
        for _ in range(15):
            if solve(H, b, size, damping, L, step) and np.abs(step[:size]).max() < MAX_STEP:
                for i in range(num):
                    for q in range(3):
                        new_poses[i, q] = poses[i, q] + step[4 * i + q]
                    if i < num - 1:
                        new_dts[i] = max(MIN_DT, dts[i] + step[4 * i + 3])
                new = linearise(
                    new_poses, new_dts, p, outline, closed, points, starts, near, moving, via, H2, b2, costs2
                )
                expected = 1e-3
                for r in range(size):
                    expected += step[r] * (damping * step[r] + b[r])
                gain = (cost - new) / expected
                if gain > 0.0 and np.isfinite(new):
                    break
            gain = 0.0
            damping *= growth
            growth *= 2.0
        if gain <= 0.0:
            break
        poses[:], dts[:], costs[:], cost = new_poses, new_dts, costs2, new
        H, b, H2, b2 = H2, b2, H, b
        fix_ends(H, b, num)
        damping *= max(1.0 / 3.0, min(2.0 / 3.0, 1.0 - (2.0 * gain - 1.0) ** 3))
        growth = 2.0
    return cost
