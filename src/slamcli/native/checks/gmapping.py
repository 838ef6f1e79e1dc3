# SPDX-License-Identifier: MIT
"""Traps of slam_gmapping's parameters."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from slamcli.native.checks.findings import ERROR, NOTE, WARNING, Finding, at, number
from slamcli.native.settings import Setting

_NOISE = {"srr": 0.1, "srt": 0.2, "str": 0.1, "stt": 0.2}
_TYPICAL_BEAMS = 180


def check_gmapping(settings: Mapping[str, Setting], beams: int | None = None) -> Iterator[Finding]:
    """Yield the traps in the parameters of one slam_gmapping node; `beams` is the scanner's count if known."""
    yield from _minimum_score(settings, beams)
    noise = [name for name, default in _NOISE.items() if number(settings, name, default) <= default / 5]
    if len(noise) >= 2:
        ratio = max(_NOISE[name] / max(number(settings, name, 1.0), 1e-9) for name in noise)
        yield at(
            settings[noise[0]],
            WARNING,
            f"odometry noise {', '.join(noise)} is {ratio:.0f} times below the default: particles follow the odometry, "
            "and a wheel that slips takes the map along",
        )
    extent = [settings[name] for name in ("xmin", "ymin", "xmax", "ymax") if name in settings]
    if extent:
        yield at(extent[0], NOTE, "xmin, ymin, xmax, ymax are the first extent only: the map grows beyond it")
    if number(settings, "xmin", -100) >= number(settings, "xmax", 100) or number(settings, "ymin", -100) >= number(
        settings, "ymax", 100
    ):
        yield at(extent[0], ERROR, "the extent is empty: xmin must be below xmax and ymin below ymax")
    if "maxUrange" in settings and number(settings, "maxUrange", 0) > number(settings, "maxRange", float("inf")):
        yield at(settings["maxUrange"], WARNING, "maxUrange is above maxRange: readings beyond maxRange are never used")
    if "particles" in settings:
        yield at(settings["particles"], NOTE, "the number of particles is fixed in the reference: it does not adapt")
    if 0 < number(settings, "temporalUpdate", -1.0) < 0.1:
        yield at(settings["temporalUpdate"], WARNING, "temporalUpdate is in seconds: nearly every scan is processed")


def _minimum_score(settings: Mapping[str, Setting], beams: int | None) -> Iterator[Finding]:
    score = number(settings, "minimumScore", 0.0)
    used = int(number(settings, "lskip", 0)) + 1
    reachable = (beams or _TYPICAL_BEAMS) / max(used, 1)
    if score <= 0 or score < reachable * 0.6:
        return
    least = f"{score * used:g}"
    message = (
        f"minimumScore {score:g}: the score adds up to 1 for each used beam, so that a scan with fewer than {least} beams "
        "can never reach it and every scan falls back on odometry"
    )
    if score < reachable:
        message = f"minimumScore {score:g} needs {100 * score / reachable:.0f} % of {reachable:.0f} beams to fit exactly: most scans will fall back on odometry"
        yield at(settings["minimumScore"], WARNING, f"{message}; usual are 50 to 100, 0 is off")
    elif beams is None:
        message += f" (so with one of {_TYPICAL_BEAMS} beams; give yours by --beams)"
        yield at(settings["minimumScore"], WARNING, f"{message}; usual are 50 to 100, 0 is off")
    else:
        yield at(settings["minimumScore"], ERROR, f"{message}: this one has {beams}; usual are 50 to 100, 0 is off")
