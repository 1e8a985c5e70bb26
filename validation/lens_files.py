"""Lens files that nobody here made: is each read, warned of or refused, and does its first order agree with ray-optics?

    pip install rayoptics
    python validation/lens_files.py DIOPTER FOLDER [--markdown table.md]

FOLDER holds .zmx, .seq and .len files, named repository__file. Focal length and back focal length (mm) at the file's own primary wavelength, by diopter (`lens info
--json --wavelength ...`) and by ray-optics, each file in a process of its own. A file that ray-optics does not read has no figure beside ours; its figures are in the file's own unit, and it counts mirrors'
focal lengths with another sign: both are allowed for.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path

PEER = """
import json, sys, warnings, logging
warnings.simplefilter("ignore"); logging.disable(logging.CRITICAL)
import contextlib, io
with contextlib.redirect_stdout(io.StringIO()):
    from rayoptics.environment import *
    model = open_model(sys.argv[1], info=True)
    model = model[0] if isinstance(model, tuple) else model
    model.update_model()
    from rayoptics.parax.firstorder import compute_first_order
    osp = model["optical_spec"]
    nm = osp["wvls"].central_wvl
    fod = model["analysis_results"]["parax_data"].fod
print(json.dumps({"nm": float(nm), "efl": float(fod.efl), "bfl": float(fod.bfl)}))
"""


def ours(program: str, file: Path, nm: float | None) -> dict:
    flags = ["--wavelength", str(nm)] if nm else []
    done = subprocess.run([program, "lens", "info", str(file), "--json", *flags], capture_output=True, text=True, timeout=120)
    told = json.loads(done.stdout) if done.stdout.startswith("{") else {}
    return {"code": done.returncode, "stderr": done.stderr.strip(), **told}


def peer(file: Path) -> dict:
    try:
        done = subprocess.run([sys.executable, "-c", PEER, str(file)], capture_output=True, text=True, timeout=120)
        return json.loads(done.stdout.strip().splitlines()[-1])
    except (subprocess.TimeoutExpired, IndexError, json.JSONDecodeError):
        return {}


def same(mine: float, theirs: float, size: float) -> bool:
    """Whether two lengths agree to 1e-5 of `size`, but for the sign and the file's unit (mm, cm, inch)."""
    return any(abs(abs(mine) - abs(theirs) * unit) <= 1e-5 * max(abs(mine), size) for unit in (1.0, 10.0, 25.4))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--markdown", type=Path)
    a = parser.parse_args()
    rows = []
    for file in sorted(p for p in a.folder.iterdir() if p.suffix.lower() in {".zmx", ".seq", ".len"}):
        theirs = peer(file)
        mine = ours(a.program, file, theirs.get("nm"))
        if "effective_focal_length_mm" in mine:
            state = f"read, {len(mine['notes'])} notes" if mine.get("notes") else "read"
            efl, bfl = mine["effective_focal_length_mm"], mine["back_focal_length_mm"]
        else:
            error = mine.get("error", {})
            state = "refused: " + (error.get("message") or mine["stderr"]).replace("\n", " ")[:160]
            efl = bfl = None
        row = [file.name, state, efl, theirs.get("efl"), bfl, theirs.get("bfl")]
        rows.append(row)
        print("\t".join("" if v is None else f"{v:.6g}" if isinstance(v, float) else str(v) for v in row), flush=True)
    both = [r for r in rows if r[2] is not None and r[3] is not None]
    agree = [r for r in both if same(r[2], r[3], abs(r[2])) and same(r[4], r[5], abs(r[2]))]
    print(f"{len(rows)} files, {sum(r[2] is not None for r in rows)} read; {len(agree)} of {len(both)} agree within 1e-5")
    if a.markdown:
        text = "| file | diopter | EFL, mm | ray-optics | BFL, mm | ray-optics |\n|---|---|---|---|---|---|\n"
        for r in rows:
            text += "| " + " | ".join("" if v is None else f"{v:.6g}" if isinstance(v, float) else str(v) for v in r) + " |\n"
        a.markdown.write_text(text)


if __name__ == "__main__":
    main()
