# SPDX-License-Identifier: MIT
"""What ORB-SLAM3 itself would stop at, or take for something else, in a settings file of either schema."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from slamcli.errors import CalibrationError
from slamcli.native.checks.findings import ERROR, NOTE, WARNING, Finding, at, check_declared
from slamcli.native.orbslam_cameras import rig_calibration
from slamcli.native.orbslam_names import LEGACY, canonical, renamed
from slamcli.native.settings import Setting, merge
from slamcli.parameters import Declaration

_INTRINSICS = ("fx", "fy", "cx", "cy")
_RADTAN, _FISHEYE = ("k1", "k2", "p1", "p2"), ("k1", "k2", "k3", "k4")
_EXTRACTOR = ("nFeatures", "scaleFactor", "nLevels", "iniThFAST", "minThFAST")
_VIEWER = (
    "KeyFrameSize", "KeyFrameLineWidth", "GraphLineWidth", "PointSize", "CameraSize", "CameraLineWidth", "ViewpointX",
    "ViewpointY", "ViewpointZ", "ViewpointF",
)  # fmt: skip
_WHOLE = {
    "Camera.width", "Camera.height", "Camera.newWidth", "Camera.newHeight", "Camera.RGB", "ORBextractor.nFeatures",
    "ORBextractor.nLevels", "ORBextractor.iniThFAST", "ORBextractor.minThFAST", "IMU.InsertKFsWhenLost", "loopClosing",
    "LEFT.width", "LEFT.height", "RIGHT.width", "RIGHT.height", "Camera1.overlappingBegin", "Camera1.overlappingEnd",
    "Camera2.overlappingBegin", "Camera2.overlappingEnd",
}  # fmt: skip
"""Read as whole numbers; other numbers must be written as real ones (``0.0``, not ``0``)."""
_NEW_NAMES = {new: old for old, new in LEGACY.items()}


def check_orbslam(file: str, raw: Sequence[Setting], table: Iterable[Declaration]) -> Iterator[Finding]:
    """Yield what is wrong with a settings file; `raw` are its entries under the names that it writes."""
    given = merge(raw)
    settings = merge(renamed(setting) for setting in raw)
    is_new = "File.version" in settings or any(name.startswith("Camera1.") for name in given)
    zero_factor = settings.get("RGBD.DepthMapFactor")
    declared = {name: s for name, s in settings.items() if s is not zero_factor or s.value != 0}
    yield from _once(check_declared(declared, table, "ORB-SLAM3"))
    yield from _types(settings, is_new=is_new)
    yield from _missing(file, settings, is_new=is_new)
    yield from _traps(settings)
    yield from _one_schema(given, is_new=is_new)
    try:
        rig_calibration({name: setting.value for name, setting in settings.items()}, file)
    except (CalibrationError, ValueError) as error:
        yield Finding(ERROR, file, 0, str(error).removeprefix(f"{file}: "))
    yield Finding(
        NOTE,
        file,
        0,
        "which sensors are used (mono, stereo, RGB-D, with IMU) is said by --mode or the recording, not by this file",
    )


def _once(findings: Iterable[Finding]) -> Iterator[Finding]:
    """Pass findings on; what the viewer's entries do not do is said once."""
    viewer: list[Finding] = []
    for finding in findings:
        if finding.severity == NOTE and finding.message.startswith("Viewer."):
            viewer.append(finding)
        else:
            yield finding
    if viewer:
        first = viewer[0]
        yield Finding(
            NOTE,
            first.file,
            first.line,
            f"Viewer entries ({len(viewer)}) are accepted and have no effect: nothing is drawn",
        )


def _types(settings: Mapping[str, Setting], *, is_new: bool) -> Iterator[Finding]:
    for name, setting in settings.items():
        value = setting.value
        shown = setting.name if is_new else _NEW_NAMES.get(name, name)
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            continue
        if name == "Camera.fps":
            if is_new and isinstance(value, float):
                yield at(setting, ERROR, f"Camera.fps={value!r}: schema 1.0 reads a whole number: ORB-SLAM3 stops")
        elif name in _WHOLE or (name == "IMU.Frequency" and not is_new):
            if isinstance(value, float):
                yield at(setting, ERROR, f"{shown}={value!r} must be a whole number: ORB-SLAM3 stops")
        elif isinstance(value, int) and (is_new or not name.startswith("Viewer.")):
            yield at(
                setting,
                ERROR,
                f"{shown}={value!r} must be a real number ({value}.0): ORB-SLAM3 says that it does not exist, and stops",
            )


def _missing(file: str, settings: Mapping[str, Setting], *, is_new: bool) -> Iterator[Finding]:
    fisheye = "kannala" in str(getattr(settings.get("Camera.type"), "value", "")).lower()
    needed = [f"Camera1.{name}" for name in _INTRINSICS]
    if fisheye or not is_new:
        needed += [f"Camera1.{name}" for name in (_FISHEYE if fisheye else _RADTAN)]
    needed += [f"ORBextractor.{name}" for name in _EXTRACTOR]
    if is_new:
        needed += [
            "Camera.type",
            "Camera.width",
            "Camera.height",
            "Camera.fps",
            *(f"Viewer.{name}" for name in _VIEWER),
        ]
    lacking = [name if is_new else _NEW_NAMES.get(name, name) for name in needed if name not in settings]
    if lacking:
        yield Finding(
            ERROR, file, 0, f"{', '.join(lacking)}: missing: ORB-SLAM3 says that the parameter does not exist or is no real number, and stops"
            " (slamcli takes what the recording says, no distortion and its defaults)",
        )  # fmt: skip
    if "Camera.RGB" not in settings:
        yield Finding(WARNING, file, 0, "Camera.RGB is missing: ORB-SLAM3 takes colours as blue first (no effect here)")
    if "RGBD.DepthMapFactor" not in settings:
        name = "RGBD.DepthMapFactor" if is_new else "DepthMapFactor"
        yield Finding(
            WARNING, file, 0, f"{name} is missing: ORB-SLAM3 stops with RGB-D (here the images' encoding says the unit)"
        )
    if "Stereo.ThDepth" not in settings:
        name = "Stereo.ThDepth" if is_new else "ThDepth"
        yield Finding(
            WARNING,
            file,
            0,
            f"{name} is missing: ORB-SLAM3 stops, or takes 0 with RGB-D (by version): every point counts as far (here 40)",
        )
    if "Camera.bf" not in settings and "Stereo.b" not in settings and "Stereo.T_c1_c2" not in settings:
        yield Finding(
            NOTE, file, 0, f"{'Stereo.b' if is_new else 'Camera.bf'} is missing: ORB-SLAM3 stops with stereo and RGB-D"
        )


def _traps(settings: Mapping[str, Setting]) -> Iterator[Finding]:
    depth, factor = settings.get("Stereo.ThDepth"), settings.get("RGBD.DepthMapFactor")
    if depth is not None and depth.value == 0:
        yield at(depth, ERROR, "ThDepth 0: every point counts as far, and RGB-D makes no map of one frame")
    if factor is not None and factor.value == 0:
        yield at(
            factor, WARNING, "DepthMapFactor 0 is taken as 1: depth in raw units, 1000 times too far for millimetres"
        )
    near = _close_m(settings)
    if near is not None and depth is not None:
        yield at(depth, NOTE, f"ThDepth: points nearer than {near:.2f} m are close")
    first, least = settings.get("ORBextractor.iniThFAST"), settings.get("ORBextractor.minThFAST")
    if first is not None and least is not None and _number(first) < _number(least):
        yield at(
            least,
            WARNING,
            f"minThFAST {least.value} is above iniThFAST {first.value}: the second search finds less than the first",
        )
    scale = settings.get("ORBextractor.scaleFactor")
    if scale is not None and _number(scale) <= 1.0:
        yield at(scale, ERROR, f"scaleFactor {scale.value}: every level of the pyramid has the size of the first")


def _one_schema(given: Mapping[str, Setting], *, is_new: bool) -> Iterator[Finding]:
    """Names of the other schema, which the original does not read."""
    for name, setting in given.items():
        if is_new and name in LEGACY:
            yield at(
                setting,
                ERROR,
                f"{name} is of the legacy schema: with File.version 1.0 ORB-SLAM3 reads {canonical(name)}",
            )


def _close_m(settings: Mapping[str, Setting]) -> float | None:
    """Return up to which distance points are close, metres, where the file says it."""
    values = {
        name: _number(settings[name])
        for name in ("Stereo.ThDepth", "Camera.bf", "Camera1.fx", "Stereo.b")
        if name in settings
    }
    if "Stereo.ThDepth" not in values:
        return None
    if "Stereo.b" in values:
        return values["Stereo.ThDepth"] * values["Stereo.b"]
    if "Camera.bf" in values and values.get("Camera1.fx", 0.0) > 0.0:
        return values["Stereo.ThDepth"] * values["Camera.bf"] / values["Camera1.fx"]
    return None


def _number(setting: Setting) -> float:
    return float(setting.value) if isinstance(setting.value, (int, float)) else float("nan")
