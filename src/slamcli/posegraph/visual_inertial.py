# SPDX-License-Identifier: MIT
"""Bundle adjustment of cameras together with velocities and biases of an IMU, points eliminated.

Campos et al., "ORB-SLAM3", T-RO 2021, equation 4, doi:10.1109/TRO.2021.3075644: reprojection errors and residuals of
preintegration in one Levenberg-Marquardt descent. Velocities and biases are variables beside the cameras in the reduced
system, whose sparse factorisation is that of plain bundle adjustment.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slamcli.measurements import ImuNoise
from slamcli.posegraph import _visual_inertial_kernels as kernels
from slamcli.posegraph.imu_preintegration import preintegrate
from slamcli.posegraph.imu_samples import ImuSamples
from slamcli.posegraph.inertial_links import (
    InertialStates,
    gravity_axes,
    gravity_turns,
    link_residuals,
    link_states,
    rotation_of,
)
from slamcli.posegraph.visual_inertial_problem import VisualInertialProblem, VisualInertialResult
from slamcli.vision.bundle_problem import BundleProblem
from slamcli.vision.bundle_system import BundleState, BundleSystem
from slamcli.vision.camera_system import CameraSystem
from slamcli.vision.pinhole import Pinhole

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
LINK_BOUND = 25.0
"""95 % of chi2 with the 15 freedoms of a link: beyond, Huber's loss."""
START, SMALLEST, LARGEST = 1e-5, 1e-9, 1e8


def adjust_visual_inertial(
    problem: VisualInertialProblem, *, iterations: int = 10, robust: bool = True, tolerance: float = 1e-6
) -> VisualInertialResult:
    """Return cameras, points, velocities, biases and gravity that explain images and IMU best.

    Parameters
    ----------
    iterations : at most; a rejected step counts.
    robust : Huber's loss on reprojection errors; that on links always holds.
    tolerance : relative decrease of the cost at which it ends.

    Notes
    -----
    With no camera fixed, the whole may drift along and turn about gravity; damping holds it there. Samples are integrated
    anew where a bias moved beyond what first order is good for.
    """
    system = _System(problem)
    state = _State(
        bundle=BundleState(
            poses=np.array(problem.bundle.T_camera_map[:, :3], np.float64, order="C"),
            points=np.array(problem.bundle.points, np.float64, order="C"),
            camera=problem.bundle.camera.array,
        ),
        velocities=problem.velocities.copy(), biases=problem.biases.copy(), gravity=problem.gravity_map.copy(),
    )  # fmt: skip
    damping, growth, before, cost, done, converged = START, 4.0, -1.0, 0.0, 0, False
    while done < iterations and not converged and damping <= LARGEST:
        done += 1
        system.integrate(state.biases)
        reduced = system.linearise(state, damping, robust)
        cost = reduced.cost
        before = cost if before < 0 else before
        steps = system.solve(reduced, damping)
        moved, other = (state, np.inf) if steps is None else system.step(state, steps, robust)
        if other <= cost:
            converged = cost - other <= tolerance * cost
            state, cost = moved, other
            damping, growth = max(0.1 * damping, SMALLEST), 4.0
            continue
        converged = other - cost <= 1e-9 * cost
        damping, growth = damping * growth, 2.0 * growth
    T = problem.bundle.T_camera_map.copy()
    free = ~problem.bundle.fixed
    T[free, :3] = state.bundle.poses[free]
    return VisualInertialResult(
        T_camera_map=T, points=state.bundle.points, velocities=state.velocities, biases=state.biases,
        gravity_map=state.gravity, link_squares=system.link_squares(state), iterations=done, cost_before=max(before, 0.0),
        cost=cost, converged=converged or damping > LARGEST,
    )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _State:
    bundle: BundleState
    velocities: Floats
    biases: Floats
    gravity: Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Reduced:
    blocks: Floats
    gradient: Floats
    diagonal: Floats
    cost: float


class _System:
    """Variables are blocks of six: cameras, velocities (three of them idle), biases, gravity (four idle)."""

    def __init__(self, problem: VisualInertialProblem) -> None:
        self.problem = problem
        self.visual = BundleSystem(problem.bundle, np.zeros(len(problem.bundle.points), np.bool_))
        self.first, self.second = (np.ascontiguousarray(column) for column in problem.links.T)
        self._integrated_for: Floats | None = None
        own = self.visual.system
        count, moving = own.size, np.flatnonzero(~problem.held)
        self.moving = moving
        self.speeds = np.full(len(problem.cameras), -1, np.int64)
        self.speeds[moving] = count + 2 * np.arange(len(moving))
        self.offs = np.where(self.speeds < 0, -1, self.speeds + 1)
        self.down = count + 2 * len(moving) if problem.gravity_moves else -1
        self.size = count + 2 * len(moving) + int(problem.gravity_moves)
        self.poses = self.visual.camera_ranks[problem.cameras]
        ends = [column[at] for at in (self.first, self.second) for column in (self.poses, self.speeds, self.offs)]
        self.nodes = np.ascontiguousarray(np.stack([*ends, np.full(len(self.first), self.down)], axis=1))
        self.system = CameraSystem(self._pairs())
        self.starts = np.setdiff1d(moving, self.second)

    def _pairs(self) -> NDArray[np.bool_]:
        pairs = np.eye(self.size, dtype=np.bool_)
        own = self.visual.system
        pairs[np.minimum(own.rows, own.columns), np.maximum(own.rows, own.columns)] = True
        for a in range(7):
            for b in range(7):
                both = (self.nodes[:, a] >= 0) & (self.nodes[:, b] >= 0)
                low = np.minimum(self.nodes[both, a], self.nodes[both, b])
                pairs[low, np.maximum(self.nodes[both, a], self.nodes[both, b])] = True
        return pairs

    def integrate(self, biases: Floats) -> None:
        """Integrate the samples if they were not yet, or if a bias moved too far since."""
        p, at = self.problem, biases[self.first]
        if self._integrated_for is not None:
            away = np.abs(at - self._integrated_for)
            if not len(away) or (away[:, :3].max() < 2e-3 and away[:, 3:].max() < 2e-2):
                return
        self._integrated_for = at.copy()
        motions = preintegrate(p.samples, p.stamps_ns[self.first], p.stamps_ns[self.second], at, p.noise)
        self.links = link_states(self.first, self.second, motions)

    def inertial_states(self, state: _State) -> InertialStates:
        """Return where the IMU is."""
        T, mount = state.bundle.poses[self.problem.cameras], self.problem.T_camera_imu
        back = T[:, :, :3].transpose(0, 2, 1)
        positions = np.einsum("sij,sj->si", back, mount[:3, 3] - T[:, :, 3])
        return InertialStates(
            rotations=np.ascontiguousarray(back @ mount[:3, :3]), positions=positions, velocities=state.velocities,
            biases=state.biases,
        )  # fmt: skip

    def linearise(self, state: _State, damping: float, robust: bool) -> _Reduced:
        """Return the normal equations, by the ranks of the whole system."""
        visual, ranks, own = self.visual.linearise(state.bundle, damping, robust), self.system.ranks, self.visual.system
        blocks = np.zeros((len(self.system.rows), 6, 6))
        gradient, diagonal = np.zeros((self.size, 6)), np.zeros((self.size, 6))
        values, derivatives = self._link_terms(state)
        weights, loss = _huber((values**2).sum(axis=1))
        kernels.add_links(self.nodes, derivatives, values, weights, ranks, self.system.slots, blocks, gradient)
        prior = self._prior(state)
        for s, pull in zip(self.starts, prior, strict=True):
            rank = ranks[self.offs[s]]
            blocks[self.system.slots[rank, rank]] += np.diag(1 / self._prior_sigmas() ** 2)
            gradient[rank] += pull / self._prior_sigmas()
        diagonal += np.einsum("nii->ni", blocks[self.system.diagonal_slots])
        diagonal[ranks[: own.size]] += visual.diagonal
        kernels.add_visual(own.rows, own.columns, visual.blocks, ranks, self.system.slots, blocks)
        gradient[ranks[: own.size]] += visual.gradient
        cost = visual.cost + 0.5 * float(loss.sum()) + 0.5 * float((prior**2).sum())
        return _Reduced(blocks=blocks, gradient=gradient, diagonal=diagonal, cost=cost)

    def _prior_sigmas(self) -> Floats:
        return np.repeat([self.problem.gyroscope_bias_sigma, self.problem.accelerometer_bias_sigma], 3)

    def _prior(self, state: _State) -> Floats:
        return np.asarray(state.biases[self.starts] / self._prior_sigmas())

    def _link_terms(self, state: _State) -> tuple[Floats, Floats]:
        """Return whitened residuals (K, 15) and derivatives (K, 15, 42) by the variables in the order of `nodes`."""
        values, by_first, by_second, by_gravity = link_residuals(self.links, self.inertial_states(state), state.gravity)
        turns = self._camera_turns(state)
        out = np.zeros((len(values), 15, 42))
        for begin, end, by in ((0, self.first, by_first), (18, self.second, by_second)):
            out[:, :, begin : begin + 6] = by[:, :, :6] @ turns[end]
            out[:, :, begin + 6 : begin + 9] = by[:, :, 6:9]
            out[:, :, begin + 12 : begin + 18] = by[:, :, 9:]
        out[:, :, 36:38] = by_gravity @ gravity_turns(state.gravity)
        return values, out

    def _camera_turns(self, state: _State) -> Floats:
        """Return how the IMU turns and moves (S, 6, 6) with the increments (phi, rho) of its camera."""
        mount = self.problem.T_camera_imu
        back = state.bundle.poses[self.problem.cameras, :, :3].transpose(0, 2, 1)
        x, y, z = mount[:3, 3]
        out = np.zeros((len(back), 6, 6))
        out[:, :3, :3] = -mount[:3, :3].T
        out[:, 3:, :3] = back @ np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        out[:, 3:, 3:] = -back
        return out

    def solve(self, reduced: _Reduced, damping: float) -> Floats | None:
        """Return the steps (N, 6), by rank; None if the system is not definite."""
        blocks, diagonal = reduced.blocks.copy(), reduced.diagonal
        added = damping * np.maximum(diagonal, 1e-9 * diagonal.max(axis=1, initial=0.0, keepdims=True))
        added = np.where(diagonal > 0, added, 1.0)
        blocks[self.system.diagonal_slots[:, None], np.arange(6), np.arange(6)] += added
        return self.system.solve(-reduced.gradient) if self.system.factorise(blocks) else None

    def step(self, state: _State, steps: Floats, robust: bool) -> tuple[_State, float]:
        """Return the state after the steps (N, 6), by rank, and its cost."""
        steps = steps[self.system.ranks]
        bundle, cost = self.visual.step(state.bundle, np.ascontiguousarray(steps[: self.visual.system.size]), robust)
        velocities, biases, gravity = state.velocities.copy(), state.biases.copy(), state.gravity
        velocities[self.moving] += steps[self.speeds[self.moving], :3]
        biases[self.moving] += steps[self.offs[self.moving]]
        if self.down >= 0:
            gravity = rotation_of((gravity_axes(gravity) @ steps[self.down, :2])[None])[0] @ gravity
        moved = _State(bundle=bundle, velocities=velocities, biases=biases, gravity=gravity)
        cost += 0.5 * float(_huber(self.link_squares(moved))[1].sum())
        return moved, cost + 0.5 * float((self._prior(moved) ** 2).sum())

    def link_squares(self, state: _State) -> Floats:
        """Return squared whitened residuals (K,)."""
        values = link_residuals(self.links, self.inertial_states(state), state.gravity, derivatives=False)[0]
        return np.asarray((values**2).sum(axis=1))


def _huber(squares: Floats) -> tuple[Floats, Floats]:
    """Return weights and losses (K,) of squared residuals."""
    size = np.sqrt(np.maximum(squares, LINK_BOUND))
    bound = np.sqrt(LINK_BOUND)
    far = squares > LINK_BOUND
    return np.where(far, bound / size, 1.0), np.where(far, 2 * bound * size - LINK_BOUND, squares)


def without(
    problem: VisualInertialProblem, result: VisualInertialResult, kept: NDArray[np.bool_]
) -> VisualInertialProblem:
    """Return the problem where the result ended, with the observations (M,) that are kept."""
    bundle = problem.bundle
    bundle = replace(
        bundle, T_camera_map=result.T_camera_map, points=result.points, camera_index=bundle.camera_index[kept],
        point_index=bundle.point_index[kept], pixels=bundle.pixels[kept], right=bundle.right[kept],
        sigmas=bundle.sigmas[kept],
    )  # fmt: skip
    return replace(
        problem, bundle=bundle, velocities=result.velocities, biases=result.biases, gravity_map=result.gravity_map
    )


def warm() -> None:
    """Compile the kernels of this module with two cameras and four points."""
    points = np.array([[0.0, 0, 2], [1, 0, 3], [0, 1, 4], [1, 1, 3]])
    camera = Pinhole(fx=100.0, fy=100.0, cx=50.0, cy=50.0, width=100, height=100)
    index, zeros, stamps = np.arange(4), np.zeros(4, np.int64), np.array([0, 5_000_000], np.int64)
    bundle = BundleProblem(
        T_camera_map=np.tile(np.eye(4), (2, 1, 1)), fixed=np.array([True, False]), points=points,
        camera_index=np.concatenate([zeros, zeros + 1]), point_index=np.concatenate([index, index]),
        pixels=np.tile(camera.project(points), (2, 1)), right=np.full(8, np.nan), sigmas=np.ones(8), camera=camera,
    )  # fmt: skip
    zero = np.zeros((2, 3))
    samples = ImuSamples(stamps_ns=stamps, angular_rad_s=zero, acceleration_m_s2=zero)
    problem = VisualInertialProblem(
        bundle=bundle, cameras=np.array([0, 1]), stamps_ns=stamps, velocities=zero, biases=np.zeros((2, 6)),
        held=np.zeros(2, np.bool_), links=np.array([[0, 1]]), samples=samples, noise=ImuNoise(),
        T_camera_imu=np.eye(4), gravity_map=np.array([0.0, 0.0, -9.81]), gravity_moves=True,
    )  # fmt: skip
    adjust_visual_inertial(problem)
