# SPDX-License-Identifier: MIT
"""Visual odometry that wheels guide and carry."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3
from slamcli.measurements import Odometry
from slamcli.rtabmap.given_odometry import GivenOdometry
from slamcli.rtabmap.guided_odometry import GuidedOdometry
from slamcli.rtabmap.node_input import OdometryStep
from slamcli.rtabmap.signature import no_features
from slamcli.vision.features import Features

Floats = NDArray[np.float64]


def _pose(x: float, yaw: float = 0.0) -> Floats:
    return se3.from_se2(np.array([x, 0.0, yaw]))


@dataclass
class _Scripted:
    """Visual odometry that says what it is told to: a pose, None (lost), or a pose of a frame that begins anew."""

    script: list[tuple[Floats | None, bool]]
    guesses: list[Floats | None] = field(default_factory=list)
    seen: list[tuple[int, Floats]] = field(default_factory=list)

    def step(self, stamp_ns: int, features: Features, guess: Floats | None = None) -> OdometryStep:
        del features
        self.guesses.append(guess)
        pose, anew = self.script[len(self.guesses) - 1]
        if pose is not None:
            self.seen.append((stamp_ns, pose))
        return OdometryStep(
            stamp_ns=stamp_ns, T_odom_base=pose, covariance=1e-6 * np.eye(6), began_anew=anew, keyframe=anew
        )

    def track(self) -> tuple[NDArray[np.int64], Floats]:
        return np.array([stamp for stamp, _ in self.seen]), np.array([pose for _, pose in self.seen])


def _wheels(*xs: float) -> GivenOdometry:
    """Odometry with a sample a tenth of a second."""
    wheels = GivenOdometry()
    for k, x in enumerate(xs):
        wheels.add(
            Odometry(
                stamp_ns=k * 100_000_000, frame_id="odom", position_m=np.array([x, 0.0, 0.0]), quat_xyzw=np.array([0.0, 0.0, 0.0, 1.0])
            )
        )  # fmt: skip
    return wheels


def _run(
    script: list[tuple[Floats | None, bool]], wheels: GivenOdometry
) -> tuple[GuidedOdometry, _Scripted, list[OdometryStep]]:
    visual = _Scripted(script)
    guided = GuidedOdometry(visual, wheels)  # type: ignore[arg-type]
    return guided, visual, [guided.step(k * 100_000_000, no_features()) for k in range(len(script))]


def test_wheels_guide_each_frame_from_the_last_one_that_was_seen() -> None:
    _, visual, steps = _run([(_pose(0), False), (_pose(1.1), False), (_pose(2.2), False)], _wheels(5, 6, 7))
    assert visual.guesses[0] is None
    for guess in visual.guesses[1:]:
        assert guess is not None
        np.testing.assert_allclose(guess, _pose(1.0), atol=1e-12)
    assert [step.T_odom_base[0, 3] for step in steps if step.T_odom_base is not None] == [0.0, 1.1, 2.2]
    assert [step.adds_up for step in steps] == [False, False, False]


def test_wheels_carry_over_what_is_not_seen() -> None:
    guided, visual, steps = _run(
        [(_pose(0), False), (None, False), (None, False), (_pose(3.3), False)], _wheels(0, 1, 2, 3)
    )
    poses = [step.T_odom_base for step in steps]
    np.testing.assert_allclose([pose[0, 3] for pose in poses if pose is not None], [0.0, 1.0, 2.0, 3.3])
    assert [step.carried for step in steps] == [False, True, True, False]
    guess = visual.guesses[3]
    assert guess is not None
    np.testing.assert_allclose(guess[0, 3], 3.0)  # since the last frame that was seen
    assert steps[2].covariance[0, 0] > steps[1].covariance[0, 0] > steps[0].covariance[0, 0]
    stamps, track = guided.track()
    assert stamps.tolist() == [0, 100_000_000, 200_000_000, 300_000_000]
    np.testing.assert_allclose(track[:, 0, 3], [0.0, 1.0, 2.0, 3.3])


def test_a_new_local_map_begins_where_the_wheels_say() -> None:
    script = [(_pose(0), False), (None, False), (_pose(10.0, 0.5), True), (_pose(10.0, 0.5) @ _pose(1.2), False)]
    guided, _, steps = _run(script, _wheels(0, 1, 2, 3))
    assert not any(step.began_anew for step in steps)
    np.testing.assert_allclose(steps[2].T_odom_base, _pose(2.0), atol=1e-12)
    np.testing.assert_allclose(steps[3].T_odom_base, _pose(3.2), atol=1e-12)
    assert steps[2].adds_up
    _, track = guided.track()
    np.testing.assert_allclose(track[:, 0, 3], [0.0, 1.0, 2.0, 3.2], atol=1e-12)


def test_without_wheels_what_is_lost_is_lost() -> None:
    guided, _, steps = _run([(_pose(0), False), (None, False), (_pose(4.0), True)], GivenOdometry())
    assert steps[1].T_odom_base is None
    assert steps[2].began_anew
    assert not any(step.carried for step in steps)
    assert guided.track()[0].tolist() == [0, 200_000_000]
