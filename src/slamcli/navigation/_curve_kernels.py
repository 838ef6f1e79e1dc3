# SPDX-License-Identifier: MIT
"""Kernels of shortest curves of bounded curvature; see `slamcli.navigation.curves`.

A curve is a row of up to five segments with signed lengths (negative: in reverse) and turns: 1 left, -1 right, 0 straight.
Everything is in units of the turning radius, with the start at the origin, heading along x.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_HAIR = 1e-10
_QUARTER = 0.5 * math.pi
_TURN = 2.0 * math.pi


@njit(cache=True, nogil=True)
def _positive(angle: float) -> float:
    """Return the angle in [0, 2 pi), what is a hair below a full turn as 0."""
    angle = angle % _TURN
    return 0.0 if _TURN - angle < _HAIR else angle


@njit(cache=True, nogil=True)
def _signed(angle: float) -> float:
    """Return the angle in [-pi, pi]."""
    return math.atan2(math.sin(angle), math.cos(angle))


@njit(cache=True, nogil=True)
def dubins(x: float, y: float, phi: float, lengths: Floats, turns: Ints) -> float:
    """Write the shortest forward curve to a pose into `lengths` (5,) and `turns` (5,); return its length.

    The six words of Dubins (1957), each solved from the circles' centres: those of the start are at (0, 1) and (0, -1).
    """
    best = np.inf
    sine, cosine = math.sin(phi), math.cos(phi)
    for word in range(6):
        first = 1 if word in (0, 2, 4) else -1
        last = first if word in (0, 1, 4, 5) else -first
        # From the centre of the first circle to that of the last.
        cx = x - last * sine
        cy = y + last * cosine - first
        distance = math.sqrt(cx * cx + cy * cy)
        direction = math.atan2(cy, cx)
        if word < 2:
            straight = distance
            heading = direction
        elif word < 4:
            if distance < 2.0 - _HAIR:
                continue
            straight = math.sqrt(max(distance * distance - 4.0, 0.0))
            heading = direction + first * math.atan2(2.0, straight)
        else:
            if distance > 4.0 + _HAIR:
                continue
            # The middle circle's centre is two radii from both; of its two places the one with the long way round.
            half = math.acos(min(distance / 4.0, 1.0))
            heading = direction + first * (_QUARTER + half)
            straight = _positive(math.pi + 2.0 * half) if distance > _HAIR else math.pi
        if word < 4:
            t = _positive(first * heading)
            v = _positive(last * (phi - heading))
            total = t + straight + v
            middle = 0
        else:
            t = _positive(first * heading)
            v = _positive(first * (phi - heading) + straight)
            total = t + straight + v
            middle = -first
        if total < best:
            best = total
            lengths[:] = 0.0
            turns[:] = 0
            lengths[0], lengths[1], lengths[2] = t, straight, v
            turns[0], turns[1], turns[2] = first, middle, last
    return best


@njit(cache=True, nogil=True)
def _tau_omega(u: float, v: float, xi: float, eta: float, phi: float) -> tuple[float, float]:
    delta = _signed(u - v)
    a = math.sin(u) - math.sin(delta)
    b = math.cos(u) - math.cos(delta) - 1.0
    t1 = math.atan2(eta * a - xi * b, xi * a + eta * b)
    t2 = 2.0 * (math.cos(delta) - math.cos(v) - math.cos(u)) + 3.0
    tau = _signed(t1 + math.pi if t2 < 0.0 else t1)
    return tau, _signed(tau - u + v - phi)


@njit(cache=True, nogil=True)
def _word(family: int, x: float, y: float, phi: float, out: Floats) -> int:
    """Write the signed lengths of one base word of Reeds and Shepp (section 8) to `out`; return their number, 0 if none."""
    minus_x, minus_y = x - math.sin(phi), y - 1.0 + math.cos(phi)
    plus_x, plus_y = x + math.sin(phi), y - 1.0 - math.cos(phi)
    minus, plus = math.sqrt(minus_x * minus_x + minus_y * minus_y), math.sqrt(plus_x * plus_x + plus_y * plus_y)
    if family == 0:  # eq. 8.1: L+ S+ L+
        t = math.atan2(minus_y, minus_x)
        v = _signed(phi - t)
        if t < -_HAIR or v < -_HAIR:
            return 0
        out[0], out[1], out[2] = t, minus, v
        return 3
    if family == 1:  # eq. 8.2: L+ S+ R+
        if plus < 2.0:
            return 0
        u = math.sqrt(plus * plus - 4.0)
        t = _signed(math.atan2(plus_y, plus_x) + math.atan2(2.0, u))
        v = _signed(t - phi)
        if t < -_HAIR or v < -_HAIR:
            return 0
        out[0], out[1], out[2] = t, u, v
        return 3
    if family == 2:  # eqs. 8.3 and 8.4: L+ R- L
        if minus > 4.0:
            return 0
        u = -2.0 * math.asin(0.25 * minus)
        t = _signed(math.atan2(minus_y, minus_x) + 0.5 * u + math.pi)
        v = _signed(phi - t + u)
        if t < -_HAIR:
            return 0
        out[0], out[1], out[2] = t, u, v
        return 3
    if family == 3:  # eq. 8.7: L+ R+ L- R-
        rho = 0.25 * (2.0 + plus)
        if rho > 1.0:
            return 0
        u = math.acos(rho)
        t, v = _tau_omega(u, -u, plus_x, plus_y, phi)
        if t < -_HAIR or v > _HAIR:
            return 0
        out[0], out[1], out[2], out[3] = t, u, -u, v
        return 4
    if family == 4:  # eq. 8.8: L+ R- L- R+
        rho = (20.0 - plus * plus) / 16.0
        if rho < 0.0 or rho > 1.0:
            return 0
        u = -math.acos(rho)
        t, v = _tau_omega(u, u, plus_x, plus_y, phi)
        if t < -_HAIR or v < -_HAIR:
            return 0
        out[0], out[1], out[2], out[3] = t, u, u, v
        return 4
    if family == 5:  # eq. 8.9: L+ R-(90) S- L-
        if minus < 2.0:
            return 0
        r = math.sqrt(minus * minus - 4.0)
        u = 2.0 - r
        t = _signed(math.atan2(minus_y, minus_x) + math.atan2(r, -2.0))
        v = _signed(phi - _QUARTER - t)
        if t < -_HAIR or u > _HAIR or v > _HAIR:
            return 0
        out[0], out[1], out[2], out[3] = t, -_QUARTER, u, v
        return 4
    if family == 6:  # eq. 8.10: L+ R-(90) S- R-
        if plus < 2.0:
            return 0
        t = math.atan2(plus_x, -plus_y)
        u = 2.0 - plus
        v = _signed(t + _QUARTER - phi)
        if t < -_HAIR or u > _HAIR or v > _HAIR:
            return 0
        out[0], out[1], out[2], out[3] = t, -_QUARTER, u, v
        return 4
    # eq. 8.11: L+ R-(90) S- L-(90) R+
    if plus < 2.0:
        return 0
    u = 4.0 - math.sqrt(plus * plus - 4.0)
    if u > _HAIR:
        return 0
    t = _signed(math.atan2((4.0 - u) * plus_x - 2.0 * plus_y, -2.0 * plus_x + (u - 4.0) * plus_y))
    v = _signed(t - phi)
    if t < -_HAIR or v < -_HAIR:
        return 0
    out[0], out[1], out[2], out[3], out[4] = t, -_QUARTER, u, -_QUARTER, v
    return 5


@njit(cache=True, nogil=True)
def reeds_shepp(x: float, y: float, phi: float, lengths: Floats, turns: Ints) -> float:
    """Write the shortest curve to a pose, forward and in reverse, into `lengths` (5,) and `turns` (5,); return its length.

    Each base word also with time reversed (flip), left and right exchanged (mirror), and driven from its end (back).
    """
    best = np.inf
    trial = np.zeros(5)
    phi = _signed(phi)
    # L R L; L R L R; L R S L; L R S R; L R S L R: which segments turn how.
    pattern = np.array(
        [
            [1, 0, 1, 0, 0],
            [1, 0, -1, 0, 0],
            [1, -1, 1, 0, 0],
            [1, -1, 1, -1, 0],
            [1, -1, 1, -1, 0],
            [1, -1, 0, 1, 0],
            [1, -1, 0, -1, 0],
            [1, -1, 0, 1, -1],
        ]
    )
    back_x = x * math.cos(phi) + y * math.sin(phi)
    back_y = x * math.sin(phi) - y * math.cos(phi)
    for family in range(8):
        for way in range(8 if family in (2, 5, 6) else 4):
            flip = -1.0 if way & 1 else 1.0
            mirror = -1 if way & 2 else 1
            px, py = (back_x, back_y) if way & 4 else (x, y)
            count = _word(family, flip * px, mirror * py, flip * mirror * phi, trial)
            if count == 0:
                continue
            total = 0.0
            for k in range(count):
                total += abs(trial[k])
            if total >= best - 1e-12:
                continue
            best = total
            lengths[:] = 0.0
            turns[:] = 0
            for k in range(count):
                at = count - 1 - k if way & 4 else k
                lengths[at] = flip * trial[k]
                turns[at] = mirror * pattern[family, k]
    return best


@njit(cache=True, nogil=True)
def advance(x: float, y: float, phi: float, turn: int, length: float) -> tuple[float, float, float]:
    """Return the pose after one segment, in units of the turning radius."""
    if turn == 0:
        return x + length * math.cos(phi), y + length * math.sin(phi), phi
    end = phi + turn * length
    return x + turn * (math.sin(end) - math.sin(phi)), y - turn * (math.cos(end) - math.cos(phi)), end
