# SPDX-License-Identifier: MIT
"""Compiled RANSAC for the similarity of two sets of points that cameras see; see `slamcli.vision.similarity_ransac`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def horn(first, second, fix_scale, pose):
    """Fill pose (3, 5) with [R | t | s, 0, 0] that lays points second (N, 3) on first (N, 3); False for fewer than three.

    The rotation is the eigenvector of the largest eigenvalue of N (section 4), the scale the symmetric one (section 2.E).
    """
    count = first.shape[0]
    if count < 3:
        return False
    a, b = np.zeros(3), np.zeros(3)
    for i in range(count):
        for c in range(3):
            a[c] += first[i, c]
            b[c] += second[i, c]
    for c in range(3):
        a[c] /= count
        b[c] /= count
    m = np.zeros((3, 3))
    square_a, square_b = 0.0, 0.0
    for i in range(count):
        for c in range(3):
            square_a += (first[i, c] - a[c]) ** 2
            square_b += (second[i, c] - b[c]) ** 2
            for d in range(3):
                m[c, d] += (second[i, c] - b[c]) * (first[i, d] - a[d])
    if not (square_a > 0.0 and square_b > 0.0):
        return False
    n = np.empty((4, 4))
    n[0, 0], n[1, 1] = m[0, 0] + m[1, 1] + m[2, 2], m[0, 0] - m[1, 1] - m[2, 2]
    n[2, 2], n[3, 3] = m[1, 1] - m[0, 0] - m[2, 2], m[2, 2] - m[0, 0] - m[1, 1]
    n[0, 1], n[0, 2], n[0, 3] = m[1, 2] - m[2, 1], m[2, 0] - m[0, 2], m[0, 1] - m[1, 0]
    n[1, 2], n[1, 3], n[2, 3] = m[0, 1] + m[1, 0], m[2, 0] + m[0, 2], m[1, 2] + m[2, 1]
    for c in range(4):
        for d in range(c):
            n[c, d] = n[d, c]
    _, vectors = np.linalg.eigh(n)
    w, x, y, z = vectors[0, 3], vectors[1, 3], vectors[2, 3], vectors[3, 3]
    pose[0, 0], pose[0, 1], pose[0, 2] = w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)
    pose[1, 0], pose[1, 1], pose[1, 2] = 2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)
    pose[2, 0], pose[2, 1], pose[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z
    scale = 1.0 if fix_scale else math.sqrt(square_a / square_b)
    for c in range(3):
        pose[c, 3] = a[c] - scale * (pose[c, 0] * b[0] + pose[c, 1] * b[1] + pose[c, 2] * b[2])
        pose[c, 4] = 0.0
    pose[0, 4] = scale
    return True


@njit(cache=True, nogil=True)
def judge(pose, first, second, pixels_1, pixels_2, weights_1, weights_2, camera, limit, inliers):
    """Fill inliers (N,) with what reprojects well in both images: the sum of the larger chi2, at most `limit` each."""
    fx, fy, cx, cy = camera[0], camera[1], camera[2], camera[3]
    scale, total = pose[0, 4], 0.0
    for i in range(first.shape[0]):
        inliers[i] = False
        x, y, z = second[i, 0], second[i, 1], second[i, 2]
        u = scale * (pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z) + pose[0, 3]
        v = scale * (pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z) + pose[1, 3]
        w = scale * (pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z) + pose[2, 3]
        x, y, z = first[i, 0] - pose[0, 3], first[i, 1] - pose[1, 3], first[i, 2] - pose[2, 3]
        p = pose[0, 0] * x + pose[1, 0] * y + pose[2, 0] * z  # times the scale, which the projection does not show
        q = pose[0, 1] * x + pose[1, 1] * y + pose[2, 1] * z
        r = pose[0, 2] * x + pose[1, 2] * y + pose[2, 2] * z
        if not (w > 0.0 and r > 0.0):
            total += limit
            continue
        chi2_1 = ((fx * u / w + cx - pixels_1[i, 0]) ** 2 + (fy * v / w + cy - pixels_1[i, 1]) ** 2) * weights_1[i]
        chi2_2 = ((fx * p / r + cx - pixels_2[i, 0]) ** 2 + (fy * q / r + cy - pixels_2[i, 1]) ** 2) * weights_2[i]
        chi2 = max(chi2_1, chi2_2)
        inliers[i] = chi2 <= limit
        total += chi2 if chi2 <= limit else limit
    return total


@njit(cache=True, nogil=True)
def ransac(
    first, second, pixels_1, pixels_2, weights_1, weights_2, camera, samples, limit, log_miss, fix_scale, best, inliers
):  # fmt: skip
    """Fill best (3, 5) and inliers (N,) with the similarity of least truncated cost: samples tried (0 inliers: none fits)."""
    count = first.shape[0]
    pose, agree = np.empty((3, 5)), np.empty(count, np.bool_)
    a, b = np.empty((3, 3)), np.empty((3, 3))
    inliers[:] = False
    bar, needed, done = limit * count, samples.shape[0], 0
    while done < needed:
        for k in range(3):
            for c in range(3):
                a[k, c] = first[samples[done, k], c]
                b[k, c] = second[samples[done, k], c]
        done += 1
        if not horn(a, b, fix_scale, pose):
            continue
        cost = judge(pose, first, second, pixels_1, pixels_2, weights_1, weights_2, camera, limit, agree)
        if cost < bar:
            bar = cost
            best[:] = pose
            inliers[:] = agree
            good = (np.sum(agree) / count) ** 3
            if good >= 1.0:
                needed = done
            elif good > 0.0:
                needed = min(needed, max(done, math.ceil(log_miss / math.log1p(-good))))
    return done
