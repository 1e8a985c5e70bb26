"""Random USD stages as OpenUSD composes them and as diopter does: sublayers, references, payloads, inherits, nested variants, instances, list edits.

    pip install usd-core
    python validation/usd_composition.py DIOPTER [--stages 400] [--inherits 0] [--first 0]

Each stage is four text files that refer to later ones and to later prims of their own. Compared are the boxes of all cubes that are drawn: their names, x and y. OpenUSD is
asked in a process of its own, ended after ten seconds (it does not always come back); stages that it reports errors of are left out. Told are the numbers of stages that differ.
"""

import argparse
import json
import random
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

FILES = 4
ROOTS = "ABC"
# A box that differs by this is another, in units of the stage.
SAME = 0.003


class Writer:
    """The files of a stage, by its number."""

    def __init__(self, number: int, inherits: float):
        self.random, self.inherits = random.Random(number), inherits

    def chance(self, probability: float) -> bool:
        return self.random.random() < probability

    def opinions(self, indent: str) -> str:
        r, text = self.random, ""
        if self.chance(0.6):
            text += f"{indent}double size = {r.choice([0.1, 0.2, 0.3, 0.4, 0.5])}\n"
        if self.chance(0.4):
            text += f"{indent}double3 xformOp:translate = ({r.randint(0, 9)}, {r.randint(0, 9)}, 0)\n"
            text += f'{indent}uniform token[] xformOpOrder = ["xformOp:translate"]\n'
        if self.chance(0.1):
            text += f'{indent}token visibility = "{r.choice(["invisible", "inherited"])}"\n'
        return text

    def target(self, file: int, root: str) -> str | None:
        """A prim of a later file, or a later one of the same."""
        if self.chance(0.7) and file < FILES - 1:
            return f"@f{self.random.randint(file + 1, FILES - 1)}.usda@</{self.random.choice(ROOTS)}>"
        later = ROOTS[ROOTS.index(root) + 1 :]
        return f"</{self.random.choice(later)}>" if later else None

    def prim(self, file: int, name: str, depth: int, root: str) -> str:
        r, indent, head = self.random, "  " * depth, ""
        kinds = ["def Cube", "def Cube", "def Xform", "over", "def Xform"] + (["class Xform"] if depth == 0 else [])
        kind = r.choice(kinds)
        if self.chance(0.45):
            targets = sorted({t for t in (self.target(file, root) for _ in range(r.randint(1, 2))) if t})
            if targets:
                head += f"\n{indent} {r.choice(['', 'prepend ', 'append '])}references = [{', '.join(targets)}]"
        if self.chance(0.15):
            target = self.target(file, root)
            if target and target.startswith("@"):
                head += f"\n{indent} {r.choice(['', 'prepend '])}payload = {target}"
        later = ROOTS[ROOTS.index(root) + 1 :]
        if later and self.chance(self.inherits):
            head += f"\n{indent} inherits = </{r.choice(later)}>"
        has_variants = self.chance(0.25)
        if has_variants or self.chance(0.2):
            head += f'\n{indent} variants = {{\n{indent}  string v = "{r.choice("xyz")}"\n{indent} }}'
        if has_variants:
            head += f'\n{indent} {r.choice(["prepend ", ""])}variantSets = "v"'
        if self.chance(0.06):
            head += f"\n{indent} active = {r.choice(['false', 'true'])}"
        if kind != "class Xform" and self.chance(0.12):
            head += f"\n{indent} instanceable = true"
        text = f'{indent}{kind} "{name}" ({head}\n{indent}) {{\n' + self.opinions(indent + " ")
        if has_variants:
            text += f'{indent} variantSet "v" = {{\n'
            for option in "xy":
                target = self.target(file, root) if self.chance(0.3) else None
                said = f" (\n{indent}   prepend references = {target}\n{indent}  )" if target else ""
                text += f'{indent}  "{option}"{said} {{\n' + self.opinions(indent + "   ")
                if depth < 2 and self.chance(0.5):
                    text += self.prim(file, r.choice("pq"), depth + 1, root)
                text += f"{indent}  }}\n"
            text += f"{indent} }}\n"
        if depth < 2:
            for child in r.sample("pqr", r.randint(0, 2)):
                text += self.prim(file, child, depth + 1, root)
        return text + f"{indent}}}\n"

    def write(self, folder: Path) -> Path:
        for file in range(FILES):
            layers = ""
            if file < FILES - 1 and self.chance(0.35):
                count = self.random.randint(1, min(2, FILES - 1 - file))
                names = sorted(self.random.sample(range(file + 1, FILES), count))
                layers = f"\n subLayers = [{', '.join(f'@f{k}.usda@' for k in names)}]"
            text = f'#usda 1.0\n(\n metersPerUnit = 1\n upAxis = "Y"\n defaultPrim = "A"{layers}\n)\n'
            text += "".join(self.prim(file, name, 0, name) for name in ROOTS if self.chance(0.85))
            if file == 0:
                text += 'def Cube "Z" {\n double size = 0.07\n}\n'
            (folder / f"f{file}.usda").write_text(text)
        return folder / "f0.usda"


THEIRS = """
import json, sys
from pxr import Usd, UsdGeom
stage, boxes = Usd.Stage.Open(sys.argv[1]), []
if stage.GetCompositionErrors():
    sys.exit(3)
for prim in Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)):
    if prim.IsA(UsdGeom.Cube) and UsdGeom.Imageable(prim).ComputeVisibility() != "invisible":
        place = UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(0).ExtractTranslation()
        half = UsdGeom.Cube(prim).GetSizeAttr().Get() / 2
        boxes.append([prim.GetName(), place[0] - half, place[0] + half, place[1]])
print(json.dumps(boxes))
"""


def theirs(stage: Path) -> list | None:
    """Boxes by OpenUSD; None of a stage with errors, or one that takes too long."""
    try:
        done = subprocess.run([sys.executable, "-c", THEIRS, stage], capture_output=True, text=True, timeout=10)
    except subprocess.TimeoutExpired:
        return None
    return json.loads(done.stdout) if done.returncode == 0 else None


def ours(diopter: str, stage: Path) -> list:
    """The same of the glTF file that diopter makes of it; cubes are meshes below translations."""
    file = stage.with_suffix(".glb")
    done = subprocess.run([diopter, "scene", "convert", stage, "-o", file], capture_output=True, text=True)
    if done.returncode != 0:
        return [done.stderr.strip()]
    data = file.read_bytes()
    length = struct.unpack("<I", data[12:16])[0]
    root = json.loads(data[20 : 20 + length])
    boxes = []

    def walk(number: int, at: tuple[float, float], scale: float) -> None:
        node = root["nodes"][number]
        matrix = node.get("matrix")
        shift = node.get("translation", matrix[12:15] if matrix else [0, 0, 0])
        at, scale = (at[0] + scale * shift[0], at[1] + scale * shift[1]), scale * (node.get("scale", [matrix[0] if matrix else 1])[0])
        for part in root["meshes"][node["mesh"]]["primitives"] if "mesh" in node else []:
            corners = root["accessors"][part["attributes"]["POSITION"]]
            low, high = corners["min"], corners["max"]
            boxes.append([node.get("name"), at[0] + scale * low[0], at[0] + scale * high[0], at[1] + scale * 0.5 * (low[1] + high[1])])
        for child in node.get("children", []):
            walk(child, at, scale)

    for number in root["scenes"][root.get("scene", 0)]["nodes"]:
        walk(number, (0.0, 0.0), 1.0)
    return boxes


def alike(a: list, b: list) -> bool:
    order = lambda box: (box[0], [round(v, 2) for v in box[1:]])
    try:
        a, b = sorted(a, key=order), sorted(b, key=order)
    except (TypeError, IndexError):
        return False
    close = lambda x, y: x[0] == y[0] and all(abs(p - q) < SAME for p, q in zip(x[1:], y[1:]))
    return len(a) == len(b) and all(close(x, y) for x, y in zip(a, b))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("diopter")
    parser.add_argument("--stages", type=int, default=400)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--inherits", type=float, default=0.0, help="how often a prim inherits another")
    asked = parser.parse_args()
    same, differ, left_out = 0, [], 0
    for number in range(asked.first, asked.first + asked.stages):
        with tempfile.TemporaryDirectory() as folder:
            stage = Writer(number, asked.inherits).write(Path(folder))
            expected = theirs(stage)
            if expected is None:
                left_out += 1
            elif alike(expected, ours(asked.diopter, stage)):
                same += 1
            else:
                differ.append(number)
    print(f"{same} alike, {len(differ)} differ {differ}, {left_out} left out")


if __name__ == "__main__":
    main()
