# SPDX-License-Identifier: MIT
"""``python -m slamcli``."""

from slamcli.cli.main import main
from slamcli.runtime import hold_lifeline

if __name__ == "__main__":
    hold_lifeline()
    main()
