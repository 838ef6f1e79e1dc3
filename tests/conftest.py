# SPDX-License-Identifier: MIT
"""What holds for all tests."""

from __future__ import annotations

import signal

# A shell that starts the tests in the background has Ctrl-C and the like ignored, and so would be the processes that tests interrupt.
for _ending, _default in (
    (signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL), (signal.SIGQUIT, signal.SIG_DFL),
):  # fmt: skip
    if signal.getsignal(_ending) is signal.SIG_IGN:
        signal.signal(_ending, _default)
