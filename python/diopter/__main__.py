"""The program `diopter`: the same as the one that Cargo builds. Also `python -m diopter`."""

from __future__ import annotations

import sys

from diopter._diopter import run


def main() -> int:
    """Runs the program on what was typed; returns its exit code."""
    return run(sys.argv[1:])


if __name__ == "__main__":
    sys.exit(main())
