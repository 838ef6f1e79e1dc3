# SPDX-License-Identifier: MIT
"""Why frames could not begin a map: counted while they come, told when none could."""

from __future__ import annotations

from collections.abc import Mapping

FEW_KEY_POINTS = "starts refused: too few key points"
LITTLE_DEPTH = "starts refused: too little depth"
FEW_MATCHES = "starts refused: too few matches"
NO_PARALLAX = "starts refused: no parallax"

_WORDS = {
    FEW_KEY_POINTS: "{count} of {frames} have too few key points to begin with (dark, blurred or bare images: `slamcli doctor` says which;"
    " lower ORBextractor.iniThFAST and minThFAST find weaker ones)",
    LITTLE_DEPTH: "{count} of {frames} have depth at too few key points to begin with (is it the depth of this camera, --depth-topic,"
    " in the right unit, --depth-scale? --mode mono does without)",
    FEW_MATCHES: "{count} of {frames} look too different from the one before (fast motion, blur, dropped frames: `slamcli doctor` says which)",
    NO_PARALLAX: "in {count} of {frames} the motion shows no parallax: the camera stands still, only turns, or is too far from what it sees; a map"
    " from one camera begins when it is moved sideways (--start skips what comes before; depth or a second camera need no motion)",
}


def why_none_began(counts: Mapping[str, int], num_frames: int) -> str:
    """Return the cause that most frames share, in words.

    Parameters
    ----------
    counts
        Of frames, by the causes of this module; other keys are passed over.
    num_frames
        Of the recording.
    """
    if not num_frames:
        return "the recording has no frames"
    causes = [(counts[cause], cause) for cause in _WORDS if counts.get(cause)]
    if not causes:
        return f"none of {num_frames} frames was found in a map"
    count, cause = max(causes, key=lambda one: one[0])
    return _WORDS[cause].format(count=count, frames=f"{num_frames} frames")
