# SPDX-License-Identifier: MIT
"""Each recovery behaviour on small costmaps."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from slamcli.errors import ConfigError
from slamcli.navigation.cost_window import CostWindow
from slamcli.navigation.footprint_check import is_blocked, outline
from slamcli.navigation.move_base_parameters import MoveBaseParameters, RecoveryParameters
from slamcli.navigation.recovery import BackUp, ClearCostmaps, RotateInPlace, build_recoveries
from slamcli.navigation.robot_state import RobotState

SQUARE = np.array([[0.3, 0.1], [-0.3, 0.1], [-0.3, -0.1], [0.3, -0.1]])


class FixedCostmap:
    def __init__(self, costs=None, footprint=SQUARE):
        self.costs = np.zeros((40, 40), np.uint8) if costs is None else costs
        self.footprint, self.cleared = footprint, []

    def window(self):
        return CostWindow(
            costs=self.costs, origin_m=(-1.0, -1.0), resolution_m=0.05, frame="odom", footprint=self.footprint,
            inscribed_radius_m=0.1, circumscribed_radius_m=0.316,
        )  # fmt: skip

    def clear_outside(self, pose, half_width_m, layer_names):
        self.cleared.append(("outside", pose.tolist(), half_width_m, layer_names))

    def clear_inside(self, pose, half_width_m, layer_names):
        self.cleared.append(("inside", pose.tolist(), half_width_m, layer_names))


def pair(costs=None):
    return SimpleNamespace(world=FixedCostmap(), local=FixedCostmap(costs))


def at(yaw=0.0, x=0.0, now=0.0):
    return RobotState(
        time_s=now, pose_odom=np.array([x, 0.0, yaw]), T_map_odom=np.array([2.0, 0.0, 0.0]), twist=np.zeros(3)
    )


def blocked_naive(window, pose):
    """The outline, walked in tiny steps."""
    corners = window.footprint
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        for share in np.linspace(0.0, 1.0, 400):
            point = a + share * (b - a)
            c, s = np.cos(pose[2]), np.sin(pose[2])
            x, y = pose[0] + c * point[0] - s * point[1], pose[1] + s * point[0] + c * point[1]
            column, row = int(np.floor((x + 1.0) / 0.05)), int(np.floor((y + 1.0) / 0.05))
            if not (0 <= row < 40 and 0 <= column < 40) or window.costs[row, column] == 254:
                return True
    return False


def test_the_outline_is_checked_as_densely_as_cells_are():
    rng = np.random.default_rng(4)
    costs = np.where(rng.random((40, 40)) < 0.01, 254, 0).astype(np.uint8)
    window = FixedCostmap(costs).window()
    assert np.linalg.norm(np.diff(outline(window), axis=0), axis=1).max() <= 0.025 + 1e-9
    poses = np.column_stack([rng.uniform(-0.8, 0.8, (60, 2)), rng.uniform(-np.pi, np.pi, 60)])
    found = is_blocked(window, poses)
    naive = np.array([blocked_naive(window, pose) for pose in poses])
    assert not (found & ~naive).any()
    assert (found == naive).mean() > 0.9  # half a cell may cut across a corner of a cell
    assert 0.1 < naive.mean() < 0.9


def test_resets_forget_what_is_outside_the_square_in_both_frames():
    costmaps = pair()
    ClearCostmaps("conservative_reset", costmaps, 3.0, RecoveryParameters()).begin(at(x=0.5))
    layers = ("obstacles", "obstacle_layer", "voxel_layer")
    assert costmaps.world.cleared == [("outside", [2.5, 0.0, 0.0], 1.5, layers)]
    assert costmaps.local.cleared == [("outside", [0.5, 0.0, 0.0], 1.5, layers)]
    near = RecoveryParameters(invert_area_to_clear=True, affected_maps="local", layer_names="obstacles")
    ClearCostmaps("aggressive_reset", costmaps, 1.0, near).begin(at())
    assert len(costmaps.world.cleared) == 1
    assert costmaps.local.cleared[1] == ("inside", [0.0, 0.0, 0.0], 0.5, ("obstacles",))


def test_the_robot_turns_once_round_and_brakes():
    rotate = RotateInPlace("rotate_recovery", pair(), RecoveryParameters())
    rotate.begin(at())
    yaw, turned, speeds = 0.0, 0.0, []
    while (twist := rotate.step(at(yaw))) is not None:
        assert twist[:2].tolist() == [0.0, 0.0]
        speeds.append(twist[2])
        turned += twist[2] * 0.05
        yaw = (yaw + twist[2] * 0.05 + np.pi) % (2 * np.pi) - np.pi
    assert 2 * np.pi - 0.1 <= turned < 2 * np.pi + 0.01
    assert max(speeds) == 1.0
    assert min(speeds) >= 0.4
    assert speeds[-1] < 1.0


def test_it_does_not_turn_into_an_obstacle():
    costs = np.zeros((40, 40), np.uint8)
    costs[25, 20] = 254  # 0.25 m to the left: the corners of the outline would pass it
    rotate = RotateInPlace("rotate_recovery", pair(costs), RecoveryParameters())
    rotate.begin(at())
    assert rotate.step(at()) is None


def test_backing_up_ends_at_its_distance_or_before_an_obstacle():
    back = BackUp("back_up", pair(), RecoveryParameters(backup_distance=0.2))
    back.begin(at())
    np.testing.assert_allclose(back.step(at(x=-0.1)), [-0.1, 0.0, 0.0])
    assert back.step(at(x=-0.21)) is None
    costs = np.zeros((40, 40), np.uint8)
    costs[20, 12] = 254  # 0.4 m behind the middle
    blocked = BackUp("back_up", pair(costs), RecoveryParameters())
    blocked.begin(at())
    assert blocked.step(at()) is None


def test_the_list_of_behaviours_is_read_in_order():
    found = build_recoveries(MoveBaseParameters(), RecoveryParameters(), pair(), 0.25)
    assert [r.name for r in found] == ["conservative_reset", "rotate_recovery", "aggressive_reset", "rotate_recovery"]
    assert found[2]._half_width_m == 0.5  # four circumscribed radii wide
    still = MoveBaseParameters(clearing_rotation_allowed=False, recovery_behaviors="rotate_recovery, back_up")
    assert [r.name for r in build_recoveries(still, RecoveryParameters(), pair(), 0.25)] == ["back_up"]
    with pytest.raises(ConfigError, match=r"no behaviour 'spin': there are conservative_reset"):
        build_recoveries(MoveBaseParameters(recovery_behaviors="spin"), RecoveryParameters(), pair(), 0.25)


def test_behaviours_of_any_name_have_parameters_of_their_own():
    listed = MoveBaseParameters(
        recovery_behaviors="near:clear_costmap_recovery/ClearCostmapRecovery turn:RotateRecovery creep:move_slow_and_clear aggressive_reset"
    )
    own = {
        "near": RecoveryParameters(reset_distance=2.0, layer_names="obstacle_layer", affected_maps="local"),
        "creep": RecoveryParameters(limited_trans_speed=0.1),
    }
    costmaps = pair()
    found = build_recoveries(listed, RecoveryParameters(), costmaps, 0.25, own)
    assert [r.name for r in found] == ["near", "turn", "creep", "aggressive_reset"]
    found[0].begin(at())
    assert costmaps.local.cleared == [("outside", [0.0, 0.0, 0.0], 1.0, ("obstacle_layer",))]
    assert costmaps.world.cleared == []
    found[2].begin(at())
    np.testing.assert_allclose(found[2].limit(at(), np.array([0.5, 0.0, 0.2])), [0.1, 0.0, 0.04])
    assert found[3]._half_width_m == 0.5


def test_a_reset_of_another_name_is_three_metres_wide():
    listed = MoveBaseParameters(recovery_behaviors="far:clear_costmap")
    assert build_recoveries(listed, RecoveryParameters(), pair(), 0.25)[0]._half_width_m == 1.5
    everywhere = RecoveryParameters(reset_distance=8.0)
    assert build_recoveries(listed, everywhere, pair(), 0.25)[0]._half_width_m == 4.0


@pytest.mark.parametrize("text", ["near:my/Recovery", ":rotate_recovery", "near:"])
def test_types_that_there_are_not(text):
    with pytest.raises(ConfigError, match=r"types are clear_costmap_recovery/ClearCostmapRecovery"):
        build_recoveries(MoveBaseParameters(recovery_behaviors=text), RecoveryParameters(), pair(), 0.25)
