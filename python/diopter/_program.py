"""The command line from Python: everything that it does is there."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from typing import Any

from ._errors import DiopterError


def command(*arguments: str | os.PathLike[str], cwd: str | os.PathLike[str] | None = None) -> Any:
    """Runs a command of the program ``diopter`` in a process of its own, and returns what it answers with ``--json``.

    ``command("lens", "info", "tessar-50mm-f2.8")``. Commands that know no answer in JSON give their text.

    Raises:
        DiopterError: The command failed; with the parts of its error.
    """
    words = [os.fspath(a) for a in arguments]
    typed = [sys.executable, "-m", "diopter", *words]
    run = subprocess.run([*typed, "--json"], cwd=cwd, capture_output=True, text=True, encoding="utf-8")
    try:
        answer = json.loads(run.stdout)
    except ValueError:
        answer = None
    if run.returncode != 0:
        told = answer.get("error", {}) if isinstance(answer, dict) else {}
        message = told.get("message") or run.stderr.strip() or f"exit code {run.returncode}"
        raise DiopterError(message, told.get("place"), told.get("found"), told.get("expected"), told.get("hint"))
    return run.stdout if answer is None else answer
