# SPDX-License-Identifier: MIT
"""What a sensor makes of perfect light and depth: exposure, noise, rounding, holes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.simulation.parameters import SimulationParameters
from slamcli.simulation.render import View

_BORDER_SHARE = 0.04
"""Depths of neighbours that differ by so much of their depth are the border of a thing."""
_SLANT = 0.12
"""Cosine of incidence below which no depth comes back."""


class Swing:
    """How the exposure wanders with time."""

    def __init__(self, parameters: SimulationParameters, rng: np.random.Generator) -> None:
        self._parameters = parameters
        self._phases = rng.uniform(0.0, 2 * np.pi, 2)

    def at(self, time_s: float) -> float:
        """Return the factor of all light at a time."""
        p = self._parameters
        waves = np.sin(2 * np.pi * time_s / (p.camera_swing_seconds * np.array([1.0, 2.7])) + self._phases)
        return float((1.0 + p.camera_swing) ** waves.mean())


def developed(
    light: NDArray[np.float32], parameters: SimulationParameters, gain: float, rng: np.random.Generator
) -> NDArray[np.uint8]:
    """Return pixels (H, W) or (H, W, 3) of light (H, W, C): lens, gain, noise, rounding.

    Noise grows with the root of the light, as that of photons does, above that of the sensor.
    """
    p = parameters
    height, width = light.shape[:2]
    bright = light * np.float32(gain)
    if p.camera_vignetting > 0.0:
        y, x = np.meshgrid(np.linspace(-1, 1, height), np.linspace(-1, 1, width), indexing="ij")
        bright *= (1.0 - p.camera_vignetting * (x * x + y * y) / 2).astype(np.float32)[..., None]
    if p.camera_noise > 0.0:
        noise = rng.standard_normal(light.shape, dtype=np.float32)
        noise *= np.sqrt(np.float32(0.4) + np.float32(0.6 / 128) * np.maximum(bright, 0)) * np.float32(p.camera_noise)
        bright += noise
    pixels = np.clip(np.rint(bright), 0, 255).astype(np.uint8)
    return pixels[..., 0] if pixels.shape[2] == 1 else pixels


def measured_depth(view: View, parameters: SimulationParameters, rng: np.random.Generator) -> NDArray[np.float32]:
    """Return depth (H, W), metres times `depth.scale`, 0 where there is none: noise of the depth's square, steps of its inverse."""
    p = parameters
    true_m = view.depth_m
    seen = np.isfinite(true_m) & (true_m > 0.0)
    depth = np.where(seen, true_m, 1.0)
    noise = rng.standard_normal(depth.shape, dtype=np.float32) * np.float32(p.depth_noise)
    depth = depth + noise * depth**2
    if p.depth_step > 0.0:
        depth = 1.0 / (np.maximum(np.rint(1.0 / (np.maximum(depth, 1e-3) * p.depth_step)), 1.0) * p.depth_step)
    seen &= (depth >= p.depth_range_min) & (depth <= p.depth_range_max)
    if p.depth_holes:
        seen &= ~_borders(np.where(np.isfinite(true_m), true_m, 1e6)) & (view.slants > _SLANT)
    if p.depth_dropout > 0.0:
        seen &= rng.random(depth.shape, dtype=np.float32) >= p.depth_dropout
    return np.where(seen, depth * p.depth_scale, 0.0).astype(np.float32)


def _borders(depth: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Mark pixels (H, W) that are much farther away than one beside them: they lie in the shadow of the projector."""
    marked = np.zeros(depth.shape, np.bool_)
    jump = 1.0 + _BORDER_SHARE
    marked[:, 1:] |= depth[:, 1:] > jump * depth[:, :-1]
    marked[:, :-1] |= depth[:, :-1] > jump * depth[:, 1:]
    marked[1:] |= depth[1:] > jump * depth[:-1]
    marked[:-1] |= depth[:-1] > jump * depth[1:]
    return marked
