# SPDX-License-Identifier: MIT
"""Pre-integration of IMU samples with bias Jacobians and covariances, and the residuals between two states."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def _cross_matrix(v):
    """The matrix (3, 3) of the cross product with `v`."""
    out = np.zeros((3, 3))
    out[0, 1], out[0, 2] = -v[2], v[1]
    out[1, 0], out[1, 2] = v[2], -v[0]
    out[2, 0], out[2, 1] = -v[1], v[0]
    return out


@njit(cache=True, nogil=True)
def _exponential(v):
    """The rotation (3, 3) by the vector `v`, radians, and its right Jacobian."""
    square = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    angle = math.sqrt(square)
    if angle < 1e-4:
        a, b, c = 1.0 - square / 6.0, 0.5 - square / 24.0, 1.0 / 6.0 - square / 120.0
    else:
        a, b = math.sin(angle) / angle, (1.0 - math.cos(angle)) / square
        c = (angle - math.sin(angle)) / (square * angle)
    cross = _cross_matrix(v)
    twice = cross @ cross
    return np.eye(3) + a * cross + b * twice, np.eye(3) - b * cross + c * twice


@njit(cache=True, nogil=True)
def _logarithm(turn):
    """The rotation vector of the matrix `turn`, by way of the quaternion so that half turns are no trouble."""
    trace = turn[0, 0] + turn[1, 1] + turn[2, 2]
    q = np.empty(4)
    if trace > 0.0:
        q[3] = 1.0 + trace
        q[0], q[1], q[2] = turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]
    else:
        i = 0
        if turn[1, 1] > turn[i, i]:
            i = 1
        if turn[2, 2] > turn[i, i]:
            i = 2
        j, k = (i + 1) % 3, (i + 2) % 3
        q[i] = 1.0 + turn[i, i] - turn[j, j] - turn[k, k]
        q[j], q[k] = turn[j, i] + turn[i, j], turn[k, i] + turn[i, k]
        q[3] = turn[k, j] - turn[j, k]
        if q[3] < 0.0:
            q = -q
    sine = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2])
    scale = 2.0 / q[3] if sine < 1e-9 * q[3] else 2.0 * math.atan2(sine, q[3]) / sine
    return scale * q[:3]


@njit(cache=True, nogil=True)
def _inverse_right_jacobian(v):
    """The inverse (3, 3) of the right Jacobian at the rotation vector `v`."""
    square = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    angle = math.sqrt(square)
    if angle < 1e-4:
        c = 1.0 / 12.0 + square / 720.0
    else:
        c = 1.0 / square - (1.0 + math.cos(angle)) / (2.0 * angle * math.sin(angle))
    cross = _cross_matrix(v)
    return np.eye(3) + 0.5 * cross + c * (cross @ cross)


@njit(cache=True, nogil=True)
def _reading(stamps, values, i, now, out):
    """Write the values between samples i and i + 1 at the time `now` to `out`; the outermost hold beyond the ends."""
    last = len(stamps) - 1
    share = 0.0 if now <= stamps[i] or i == last else (now - stamps[i]) / (stamps[i + 1] - stamps[i])
    following = min(i + 1, last)
    for axis in range(3):
        out[axis] = (1.0 - share) * values[i, axis] + share * values[following, axis]


@njit(cache=True, nogil=True)
def _step(turn, velocity, position, jacobian, covariance, rate, force, seconds, densities):
    """Go on by `seconds` at a constant rate and force (biases taken off); all arrays are changed in place.

    `densities` (5,): variances of gyroscope and accelerometer noise and of their biases' walks over a second, and that
    which is added to the positions' over a second.
    """
    half, half_jacobian = _exponential(0.5 * seconds * rate)
    whole, whole_jacobian = _exponential(seconds * rate)
    middle = turn @ half
    pull = middle @ force
    lever = -(middle @ _cross_matrix(force))
    by_turn = lever @ half.T * seconds  # of the velocity by the rotation error so far
    by_rate = -(lever @ half_jacobian) * (0.5 * seconds * seconds)  # of the velocity by the gyroscope's bias

    step = np.eye(15)
    step[:3, :3] = whole.T
    step[:3, 9:12] = -seconds * whole_jacobian
    step[3:6, :3] = by_turn
    step[3:6, 9:12] = by_rate
    step[3:6, 12:] = -seconds * middle
    step[6:9, :3] = 0.5 * seconds * by_turn
    step[6:9, 3:6] = seconds * np.eye(3)
    step[6:9, 9:12] = 0.5 * seconds * by_rate
    step[6:9, 12:] = -0.5 * seconds * seconds * middle

    moved = step @ covariance @ step.T
    for a in range(9):
        for b in range(9):
            noise = 0.0
            for axis in range(3):
                noise += densities[0] * step[a, 9 + axis] * step[b, 9 + axis]
                noise += densities[1] * step[a, 12 + axis] * step[b, 12 + axis]
            moved[a, b] += noise / seconds
    for axis in range(3):
        moved[6 + axis, 6 + axis] += densities[4] * seconds
        moved[9 + axis, 9 + axis] += densities[2] * seconds
        moved[12 + axis, 12 + axis] += densities[3] * seconds
    covariance[:] = 0.5 * (moved + moved.T)

    jacobian[:] = np.ascontiguousarray(step[:9, :9]) @ jacobian + step[:9, 9:]
    position += seconds * velocity + 0.5 * seconds * seconds * pull
    velocity += seconds * pull
    turn[:] = turn @ whole


@njit(cache=True, nogil=True)
def preintegrate(
    stamps, rates, forces, begins, ends, starts, biases, densities, usual_ns,
    rotations, velocities, positions, jacobians, covariances, gaps
):  # fmt: skip
    """Fill the outputs of K intervals; `starts` are the last samples not after `begins` (0 if there is none).

    Where samples lie farther apart than twice `usual_ns`, a quarter of the change across the gap counts as an unknown
    constant error within it.
    """
    count = len(stamps)
    first_rate, last_rate = np.empty(3), np.empty(3)
    first_force, last_force = np.empty(3), np.empty(3)
    here = np.empty(5)
    for k in range(len(begins)):
        turn, velocity, position = np.eye(3), np.zeros(3), np.zeros(3)
        jacobian, covariance = np.zeros((9, 6)), np.zeros((15, 15))
        now, i = begins[k], starts[k]
        widest = max(stamps[0] - begins[k], 0)
        _reading(stamps, rates, i, now, first_rate)
        _reading(stamps, forces, i, now, first_force)
        while now < ends[k]:
            following = ends[k]
            apart = ends[k] - stamps[i]
            if now < stamps[i]:  # before the first sample of all
                following = min(following, stamps[i])
                apart = stamps[i] - now
            elif i + 1 < count:
                following = min(following, stamps[i + 1])
                apart = stamps[i + 1] - stamps[i]
            widest = max(widest, apart)
            _reading(stamps, rates, i, following, last_rate)
            _reading(stamps, forces, i, following, last_force)
            seconds = (following - now) * 1e-9
            here[:] = densities
            if apart > 2 * usual_ns:
                j = min(i + 1, count - 1)
                for axis in range(3):
                    here[0] += (0.25 * (rates[j, axis] - rates[i, axis])) ** 2 * seconds
                    here[1] += (0.25 * (forces[j, axis] - forces[i, axis])) ** 2 * seconds
            rate = 0.5 * (first_rate + last_rate) - biases[k, :3]
            force = 0.5 * (first_force + last_force) - biases[k, 3:]
            _step(turn, velocity, position, jacobian, covariance, rate, force, seconds, here)
            first_rate[:] = last_rate
            first_force[:] = last_force
            now = following
            if i + 1 < count and following == stamps[i + 1]:
                i += 1
        rotations[k] = turn
        velocities[k] = velocity
        positions[k] = position
        jacobians[k] = jacobian
        covariances[k] = covariance
        gaps[k] = widest * 1e-9


@njit(cache=True, nogil=True)
def whiten(covariances, roots):
    """Fill `roots` (K, 15, 15) with lower triangles W such that W' W is the inverse of each covariance.

    Rows and columns are brought to equal size first, because metres, radians and biases differ by many orders.
    """
    for k in range(len(covariances)):
        size = np.sqrt(np.diag(covariances[k]))
        scaled = np.empty((15, 15))
        for a in range(15):
            for b in range(15):
                scaled[a, b] = covariances[k, a, b] / (size[a] * size[b])
        lower = np.linalg.cholesky(scaled)
        for column in range(15):  # forward substitution of the identity
            for row in range(column, 15):
                total = 1.0 if row == column else 0.0
                for m in range(column, row):
                    total -= lower[row, m] * roots[k, m, column] * size[column]
                roots[k, row, column] = total / lower[row, row] / size[column]


@njit(cache=True, nogil=True)
def residuals(
    first, second, seconds, rotations, velocities, positions, jacobians, biases_of, roots,
    turns, places, speeds, biases, gravity, out, by_first, by_second, by_gravity
):  # fmt: skip
    """Fill whitened residuals (K, 15) and, where they have rows, their derivatives (K, 15, 15) and by gravity (K, 15, 3).

    States are `turns` (S, 3, 3), `places`, `speeds` (S, 3) and `biases` (S, 6). Derivatives are by a rotation vector on the
    right of the state's rotation, then by place, speed, gyroscope's and accelerometer's bias.
    """
    wanted = len(by_first) > 0
    raw = np.empty(15)
    for k in range(len(first)):
        i, j, t = first[k], second[k], seconds[k]
        moved = biases[i] - biases_of[k]
        change = jacobians[k] @ moved
        more, more_jacobian = _exponential(change[:3])
        back = np.ascontiguousarray(turns[i].T)
        error = (rotations[k] @ more).T @ back @ turns[j]
        angle = _logarithm(error)
        speed = back @ (speeds[j] - speeds[i] - t * gravity)
        place = back @ (places[j] - places[i] - t * speeds[i] - 0.5 * t * t * gravity)
        raw[:3] = angle
        raw[3:6] = speed - velocities[k] - change[3:6]
        raw[6:9] = place - positions[k] - change[6:]
        raw[9:] = biases[j] - biases[i]
        root = roots[k]
        out[k] = root @ raw
        if not wanted:
            continue
        one, two, down = np.zeros((15, 15)), np.zeros((15, 15)), np.zeros((15, 3))
        inverse = _inverse_right_jacobian(angle)
        one[:3, :3] = -inverse @ (np.ascontiguousarray(turns[j].T) @ turns[i])
        two[:3, :3] = inverse
        one[:3, 9:] = -inverse @ error.T @ more_jacobian @ np.ascontiguousarray(jacobians[k, :3])
        one[3:6, :3] = _cross_matrix(speed)
        one[3:6, 6:9] = -back
        two[3:6, 6:9] = back
        one[3:9, 9:] = -jacobians[k, 3:]
        one[6:9, :3] = _cross_matrix(place)
        one[6:9, 3:6] = -back
        two[6:9, 3:6] = back
        one[6:9, 6:9] = -t * back
        for a in range(9, 15):
            one[a, a] = -1.0
            two[a, a] = 1.0
        down[3:6] = -t * back
        down[6:9] = -0.5 * t * t * back
        by_first[k] = root @ one
        by_second[k] = root @ two
        by_gravity[k] = root @ down
