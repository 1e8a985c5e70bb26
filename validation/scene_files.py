"""Scene files that nobody here made: is each read, warned of or refused, and why?

    python validation/scene_files.py DIOPTER FOLDER [--list FILES.txt] [--markdown table.md] [--pictures OUT]

FOLDER holds working trees of repositories, one folder each. Every .usd, .usda, .usdc, .usdz, .xml (Mitsuba), .pbrt, .gltf, .glb, .obj, .ply, .spz and .nvdb file in it, or those that
FILES.txt names, goes through `scene info --json` in a process of its own; with `--pictures` it is photographed, 160 × 120 pixels, 8 samples, by the file's own camera or the suggested view.
"""

import argparse
import json
import subprocess
import time
from pathlib import Path

KINDS = {".usd", ".usda", ".usdc", ".usdz", ".xml", ".pbrt", ".gltf", ".glb", ".obj", ".ply", ".spz", ".nvdb"}


def told(program: str, file: Path, folder: Path) -> dict:
    start = time.perf_counter()
    command = [program, "scene", "info", str(file), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    seconds = time.perf_counter() - start
    said = json.loads(done.stdout) if done.stdout.startswith("{") else {}
    row = {"file": file.relative_to(folder), "code": done.returncode, "seconds": seconds}
    if "error" in said:
        error = said["error"]
        row["refused"] = (error["found"] or error["message"]) + (f" ({error['expected']})" if error["expected"] else "")
        return row
    if not said:
        row["refused"] = f"no answer: {done.stderr.strip()[-200:]}"
        return row
    row["warnings"] = [w.replace(str(file) + ": ", "").replace(str(folder), "") for w in said["warnings"]]
    row["what"] = f"{said['objects']} objects, {said['triangles_in_place']} triangles"
    row["what"] += f", {said['splats']} splats" if said["splats"] else ""
    row["what"] += f", {said['curve_segments']} hairs' segments" if said["curve_segments"] else ""
    return row


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("diopter")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--list", type=Path)
    parser.add_argument("--markdown", type=Path)
    parser.add_argument("--pictures", type=Path)
    arguments = parser.parse_args()
    folder = arguments.folder
    if arguments.list:
        files = [folder / line for line in arguments.list.read_text().split("\n") if line.strip()]
    else:
        files = sorted(f for f in folder.rglob("*") if f.suffix in KINDS and f.is_file())
    lines = ["| file | read | what is in it, or why not |", "|---|---|---|"]
    count = {"read": 0, "warned": 0, "refused": 0}
    for number, file in enumerate(files):
        row = told(arguments.diopter, file, folder)
        if "refused" in row:
            state, why = "refused", row["refused"]
        elif row["warnings"]:
            state, why = "warned", row["what"] + "; " + "; ".join(row["warnings"])
        else:
            state, why = "read", row["what"]
        count[state] += 1
        why = why if len(why) < 150 else why[:147] + "..."
        why = why.replace("|", "/").replace("\n", " ").replace("<", "`").replace(">", "`")
        lines.append(f"| {row['file']} | {state} | {why} |")
        print(f"{state:8} {row['seconds']:6.2f} s  {row['file']}  {why}", flush=True)
        if row["code"] not in (0, 1, 2):
            print(f"EXIT CODE {row['code']}")
        if arguments.pictures and state != "refused":
            out = arguments.pictures / f"{number:03}_{file.stem}.jpg"
            command = [arguments.diopter, "shoot", str(file), "--size", "160x120", "--spp", "8", "-o", str(out)]
            done = subprocess.run(command, capture_output=True, text=True, timeout=600)
            if done.returncode != 0:
                print(f"NOT PHOTOGRAPHED: {done.stderr.strip()}")
    print(f"{len(files)} files: {count['read']} read, {count['warned']} with warnings, {count['refused']} refused")
    if arguments.markdown:
        arguments.markdown.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
