# SPDX-License-Identifier: MIT
"""Levenberg-Marquardt on sparse graphs of residuals, with robust losses and graduated non-convexity."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slamcli.posegraph.losses import Loss
from slamcli.posegraph.normal_equations import NormalEquations

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
START = 1e-4  # damping in the beginning, as a share of the diagonal
LARGEST = 1e16  # damping at which no step leads down any more
SMALLEST_STEP = 1e-10  # m or rad: nothing moves any more
SURROGATE_ITERATIONS = 4  # in each round of the graduated losses but the last


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Terms:
    """A group of residuals of one kind. A variable is three numbers of the state's tangent space."""

    variables: Integers
    """int64 (N, K); -1 where a residual has fewer."""
    residuals: Callable[[Floats], Floats]
    """From a state to (N, M)."""
    jacobians: Callable[[Floats], Floats]
    """From a state to (N, M, 3 K)."""
    loss: Loss
    robust: NDArray[np.bool_]
    """bool (N,): which residuals the loss applies to; the others are squared."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Minimum:
    """Where the descent ended."""

    state: Floats
    cost_before: float
    cost_after: float
    iterations: int
    converged: bool
    norms: tuple[Floats, ...]
    """Norms (N,) of the residuals of each group."""
    weights: tuple[Floats, ...]
    """How much each residual counted in the end, 0 to 1."""


class Descent:
    """The iterations on one graph; see :func:`minimise`."""

    def __init__(
        self,
        terms: Sequence[Terms],
        held: NDArray[np.bool_],
        retract: Callable[[Floats, Floats], Floats],
        together: int = 1,
    ) -> None:
        self.terms: Sequence[Terms]
        self.terms, self.retract, self.size = terms, retract, len(held)
        self.equations = NormalEquations(held, [term.variables for term in terms], together)
        self.surrogates = [term.loss.surrogates(0.0)[-1] for term in terms]

    def squares(self, residuals: Sequence[Floats]) -> list[Floats]:
        """Return the squared norms (N,) of the residuals of each group."""
        return [np.einsum("nm,nm->n", r, r) for r in residuals]

    def cost(self, squares: Sequence[Floats]) -> float:
        """Return half the sum of the losses."""
        total = 0.0
        for term, values, surrogate in zip(self.terms, squares, self.surrogates, strict=True):
            total += float(np.sum(np.where(term.robust, term.loss.values(values, surrogate), values)))
        return 0.5 * total

    def weights(self, squares: Sequence[Floats]) -> list[Floats]:
        """Return how much each residual counts."""
        return [
            np.where(term.robust, term.loss.weights(values, surrogate), 1.0)
            for term, values, surrogate in zip(self.terms, squares, self.surrogates, strict=True)
        ]

    def residuals(self, state: Floats) -> list[Floats]:
        """Return the residuals (N, M) of each group."""
        return [term.residuals(state) for term in self.terms]

    def linearise(self, state: Floats, residuals: Sequence[Floats], weights: Sequence[Floats]) -> None:
        """Fill the normal equations at a state."""
        self.equations.clear()
        for i, term in enumerate(self.terms):
            self.equations.add(i, term.jacobians(state), residuals[i], weights[i])

    def run(self, state: Floats, max_iterations: int, tolerance: float) -> tuple[Floats, int, bool]:
        """Descend from a state; return where it ended, after how many iterations, and whether it converged."""
        residuals = self.residuals(state)
        squares = self.squares(residuals)
        cost, damping, growth = self.cost(squares), START, 2.0
        fresh = False
        for iteration in range(max_iterations):
            if not fresh:
                self.linearise(state, residuals, self.weights(squares))
                fresh = True
            step, predicted = self._step(damping)
            if predicted == 0.0 or (predicted > 0 and np.abs(step).max(initial=0.0) <= SMALLEST_STEP):
                return state, iteration, True
            candidate = self.retract(state, step) if predicted > 0 else state
            new_residuals = self.residuals(candidate)
            new_squares = self.squares(new_residuals)
            new_cost = self.cost(new_squares) if predicted > 0 else np.inf
            if new_cost <= cost:
                gain = (cost - new_cost) / predicted
                damping *= max(1 / 3, 1 - (2 * gain - 1) ** 3)  # Madsen, Nielsen, Tingleff 2004, algorithm 3.16
                growth, fresh = 2.0, False
                decrease, cost = cost - new_cost, new_cost
                state, residuals, squares = candidate, new_residuals, new_squares
                if decrease <= tolerance * cost:
                    return state, iteration + 1, True
            else:
                if 0 < predicted <= 1e-3 * tolerance * cost:  # what is left lies below the rounding of the cost
                    return state, iteration + 1, True
                damping, growth = damping * growth, growth * 2
                if damping > LARGEST:
                    return state, iteration + 1, False
        return state, max_iterations, False

    def _step(self, damping: float) -> tuple[Floats, float]:
        """Return the step (V, 3) and by how much the linearised cost falls; negative if the equations are singular."""
        equations = self.equations
        scale = damping * np.clip(np.einsum("vii->vi", equations.diagonal), 1e-6, 1e32)
        step = np.zeros((self.size, 3))
        if not equations.factorise(scale):
            return step, -1.0
        free = equations.solve(-equations.gradient)
        step[equations.variables] = free
        return step, 0.5 * float(np.sum(free * (scale * free - equations.gradient)))


def minimise(
    state: Floats,
    terms: Sequence[Terms],
    held: NDArray[np.bool_],
    retract: Callable[[Floats, Floats], Floats],
    max_iterations: int,
    tolerance: float,
    together: int = 1,
) -> Minimum:
    """Return the state that minimises half the sum of the losses of the residuals.

    Parameters
    ----------
    state : of any shape; only `terms` and `retract` look into it.
    held : bool (V,), variables that do not move, or (V, 3), which of their numbers.
    retract : moves a state by a step float64 (V, 3).
    tolerance : relative decrease of the cost at which it has converged.
    together : variables of a pose.

    Notes
    -----
    Robust losses are handled by iteratively reweighted least squares. Sums run in the order of `terms` and their
    residuals on one thread: the same input gives the same bytes.
    """
    descent = Descent(terms, held, retract, together)
    before = descent.cost(descent.squares(descent.residuals(state)))
    iterations = 0
    if any(term.loss.graduated and np.any(term.robust) for term in terms):
        state, iterations = _graduate(descent, state, max_iterations, tolerance)
    state, more, converged = descent.run(state, max_iterations, tolerance)
    squares = descent.squares(descent.residuals(state))
    return Minimum(
        state=state, cost_before=before, cost_after=descent.cost(squares), iterations=iterations + more, converged=converged,
        norms=tuple(np.sqrt(values) for values in squares), weights=tuple(descent.weights(squares)),
    )  # fmt: skip


def _graduate(descent: Descent, state: Floats, max_iterations: int, tolerance: float) -> tuple[Floats, int]:
    """Follow the minimum from the convex surrogate to the last but one; leave the descent with the losses themselves."""
    terms, final = descent.terms, descent.surrogates
    descent.terms = [replace(term, loss=Loss()) if term.loss.graduated else term for term in terms]
    state, total, _ = descent.run(state, max_iterations, tolerance)
    descent.terms = terms
    squares = descent.squares(descent.residuals(state))
    rounds = [t.loss.surrogates(float(np.max(s[t.robust], initial=0.0))) for t, s in zip(terms, squares, strict=True)]
    for i in range(max(len(r) for r in rounds) - 1):
        descent.surrogates = [r[min(i, len(r) - 1)] for r in rounds]
        state, more, _ = descent.run(state, SURROGATE_ITERATIONS, tolerance)
        total += more
        weights = descent.weights(descent.squares(descent.residuals(state)))
        if all(_settled(t, w) for t, w in zip(terms, weights, strict=True)):
            break
    descent.surrogates = final
    return state, total


def _settled(term: Terms, weights: Floats) -> bool:
    """Whether every residual of a truncated loss is either in or out, after which the rounds change nothing."""
    if not term.loss.graduated:
        return True
    return term.loss.kind == "truncated" and bool(np.all((weights < 1e-3) | (weights > 1 - 1e-3)))
