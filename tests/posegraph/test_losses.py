# SPDX-License-Identifier: MIT
"""Losses: known values, and weights that are their derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.errors import ConfigError
from slamcli.posegraph.losses import Loss

CASES = [
    (Loss(), 1.0),
    (Loss(kind="huber", scale=2.0), 1.0),
    (Loss(kind="cauchy", scale=2.0), 1.0),
    (Loss(kind="geman_mcclure", scale=2.0), 1.0),
    (Loss(kind="geman_mcclure", scale=2.0), 7.0),
    (Loss(kind="tolerant", scale=5.0, sharpness=2.0), 1.0),
    (Loss(kind="truncated", scale=2.0), 0.5),
    (Loss(kind="truncated", scale=2.0), 30.0),
    (Loss(kind="truncated", scale=2.0), np.inf),
]


@pytest.mark.parametrize(("loss", "surrogate"), CASES)
def test_weights_are_the_derivatives_of_the_values(loss, surrogate):
    squares = np.array([0.01, 0.5, 2.0, 3.9, 4.3, 11.9, 12.1, 50.0])
    numeric = (loss.values(squares + 1e-6, surrogate) - loss.values(squares - 1e-6, surrogate)) / 2e-6
    np.testing.assert_allclose(loss.weights(squares, surrogate), numeric, atol=1e-7)


@pytest.mark.parametrize(("loss", "surrogate"), CASES)
def test_no_loss_at_no_residual(loss, surrogate):
    np.testing.assert_allclose(loss.values(np.zeros(1), surrogate), 0, atol=1e-12)
    assert 0 < loss.weights(np.zeros(1), surrogate)[0] <= 1


@pytest.mark.parametrize(
    ("kind", "value"),
    [("huber", 2 * 2 * 5 - 4), ("cauchy", 4 * np.log(1 + 25 / 4)), ("geman_mcclure", 100 / 29), ("truncated", 4)],
)
def test_known_values(kind, value):
    loss = Loss(kind=kind, scale=2.0)
    assert loss.values(np.array([25.0]), loss.surrogates(0.0)[-1])[0] == pytest.approx(value)


def test_rounds_end_with_the_loss_itself():
    falling = Loss(kind="geman_mcclure", graduated=True).surrogates(50.0)
    assert falling[0] == 100.0
    assert np.all(np.diff(falling) < 0)
    assert falling[-1] == 1.0
    growing = Loss(kind="truncated", graduated=True).surrogates(50.0)
    assert growing[0] == pytest.approx(1 / 99)
    assert np.all(np.diff(growing) > 0)
    assert np.isinf(growing[-1])
    assert Loss(kind="truncated", graduated=True).surrogates(0.1) == [np.inf]


@pytest.mark.parametrize("settings", [{"scale": 0.0}, {"kind": "huber", "graduated": True}, {"sharpness": -1.0}])
def test_meaningless_settings_are_refused(settings):
    with pytest.raises(ConfigError):
        Loss(**settings)
