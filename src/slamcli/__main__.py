# SPDX-License-Identifier: MIT
"""``python -m slamcli``."""

from slamcli.cli.main import main

if __name__ == "__main__":
    main()
