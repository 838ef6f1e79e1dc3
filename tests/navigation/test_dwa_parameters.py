# SPDX-License-Identifier: MIT
from __future__ import annotations

from pathlib import Path

import pytest

from slamcli.errors import ConfigError
from slamcli.native.ros_yaml import read_ros_yaml
from slamcli.navigation.dwa_parameters import DwaParameters, read_dwa

CONFIGS = Path(__file__).resolve().parents[2] / "configs"


def test_the_missions_file_loads() -> None:
    settings = read_ros_yaml(CONFIGS / "base_local_planner_params.yaml")
    values = {s.name.removeprefix("DWAPlannerROS/"): s.value for s in settings}
    parameters = read_dwa(values)
    assert (parameters.max_vel_x, parameters.min_vel_x, parameters.acc_lim_y) == (0.5, -0.1, 0.0)
    assert (parameters.path_distance_bias, parameters.goal_distance_bias, parameters.occdist_scale) == (32.0, 24.0, 0.1)
    assert (parameters.vx_samples, parameters.vy_samples, parameters.vth_samples) == (10, 1, 20)
    assert parameters.latch_xy_goal_tolerance


def test_names_from_before_1_16_are_taken() -> None:
    parameters = read_dwa(
        {"max_trans_vel": 0.4, "min_rot_vel": 0.2, "rot_stopped_vel": 0.05, "trans_stopped_vel": 0.03}
    )
    assert (parameters.max_vel_trans, parameters.min_vel_theta) == (0.4, 0.2)
    assert (parameters.theta_stopped_vel, parameters.trans_stopped_vel) == (0.05, 0.03)
    with pytest.raises(ConfigError, match=r"max_vel_trans=0\.5 contradicts max_vel_trans=0\.4"):
        read_dwa({"max_trans_vel": 0.4, "max_vel_trans": 0.5})


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"min_vel_x": 0.6}, "min_vel_x=0.6 is above max_vel_x=0.55"),
        ({"sim_time": float("nan")}, "not a number"),
        ({"max_vel_x": float("inf")}, "must be between"),
        ({"sim_granularity": 0.0}, "between 0.0001"),
        ({"vx_sample": 3}, "did you mean vx_samples"),
        ({"vx_samples": 2.5}, "not a whole number"),
    ],
)
def test_wrong_values_are_refused(values: dict[str, float], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        read_dwa(values)


def test_not_a_number_is_refused_in_python_too() -> None:
    with pytest.raises(ConfigError, match="not a finite number"):
        DwaParameters(sim_time=float("nan"))
