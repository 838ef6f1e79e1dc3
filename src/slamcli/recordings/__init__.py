# SPDX-License-Identifier: MIT
"""Bags and data sets to measurements, and back."""

from slamcli.recordings.mends import Mends
from slamcli.recordings.raw import Contents, Topic
from slamcli.recordings.recording import Recording, open_recording
from slamcli.recordings.writing import RecordingWriter, create_recording

__all__ = ["Contents", "Mends", "Recording", "RecordingWriter", "Topic", "create_recording", "open_recording"]
