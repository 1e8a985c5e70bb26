"""The program `diopter`: the same as the one that Cargo builds. Also `python -m diopter`."""

from __future__ import annotations

import os
import sys

from diopter._diopter import run


def main() -> int:
    """Runs the program on what was typed; returns its exit code."""
    # Lessons run the program again: by this interpreter, in whose environment it is installed.
    os.environ.setdefault("DIOPTER_PYTHON", sys.executable)
    return run(sys.argv[1:])


if __name__ == "__main__":
    sys.exit(main())
