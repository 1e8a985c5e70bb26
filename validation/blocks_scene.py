"""A table with boxes under a random pattern, as glTF: a scene whose surfaces are known in closed form, with texture everywhere. It shines by itself, so that nothing depends on where lamps are put.

Each box is a node of its own, named `box-0` ... and of the class `box` (in `extras`); the table is of the class `table`.
"""

import base64
import json
import os

import numpy as np
from PIL import Image, ImageDraw, ImageFilter

TABLE = 1.2  # m
# Corner (x, z) and size (x, y, z) of the boxes, m.
BOXES = [((-0.45, -0.4), (0.3, 0.25, 0.2)), ((0.1, -0.35), (0.25, 0.4, 0.25)), ((-0.4, 0.1), (0.2, 0.15, 0.3)), ((0.05, 0.1), (0.35, 0.1, 0.15)), ((0.2, 0.32), (0.12, 0.3, 0.12))]


def faces():
    """Quads of the scene: corner and two edges each, m; bottoms of boxes are left out."""
    h = 0.5 * TABLE
    quads = [((-h, 0, h), (TABLE, 0, 0), (0, 0, -TABLE))]
    for (x, z), (a, b, c) in BOXES:
        quads += [
            ((x, 0, z + c), (a, 0, 0), (0, b, 0)),
            ((x + a, 0, z + c), (0, 0, -c), (0, b, 0)),
            ((x + a, 0, z), (-a, 0, 0), (0, b, 0)),
            ((x, 0, z), (0, 0, c), (0, b, 0)),
            ((x, b, z + c), (a, 0, 0), (0, 0, -c)),
        ]
    return np.array(quads, float)


def owners():
    """Number of the object of each quad: 0 the table, then the boxes."""
    return np.array([0] + [1 + b for b in range(len(BOXES)) for _ in range(5)])


def pattern(side, random, smooth):
    """Dots of several sizes and greys, none over another: seen askew their middles stay where they are. `smooth`: clouds, no smaller than some pixels."""
    if smooth:
        total = np.zeros((side, side))
        for radius in (10, 24):
            noise = np.asarray(Image.fromarray((random.random((side, side)) * 255).astype(np.uint8)).filter(ImageFilter.GaussianBlur(radius)), float)
            total += (noise - noise.mean()) / noise.std()
        return (255 * np.clip(0.5 + 0.2 * total / total.std(), 0.02, 0.98)).astype(np.uint8)
    fine = 4  # drawn finer, then made small: soft edges
    picture = Image.new("L", (side * fine, side * fine), 110)
    draw = ImageDraw.Draw(picture)
    taken = np.zeros((side, side), bool)
    for _ in range(side * side // 60):
        r = random.choice([2.5, 3.5, 5.0, 8.0], p=[0.35, 0.35, 0.2, 0.1])
        x, y = random.uniform(r, side - r, 2)
        room = np.s_[max(int(y - r - 2), 0) : int(y + r + 3), max(int(x - r - 2), 0) : int(x + r + 3)]
        if taken[room].any():
            continue
        taken[room] = True
        grey = int(random.choice([random.uniform(0, 60), random.uniform(170, 250)]))
        draw.ellipse([(x - r) * fine, (y - r) * fine, (x + r) * fine, (y + r) * fine], fill=grey)
    return np.asarray(picture.resize((side, side), Image.BOX))


def scene(folder, smooth=False):
    """Writes the scene into a folder; the path of its file."""
    random = np.random.default_rng(3)
    # An atlas: each face has a piece of its own shape, 0.8 texels to 1 mm.
    atlas = np.zeros((2048, 2048), np.uint8)
    meshes, at, row = {}, [0, 0], 0
    for (corner, u, v), owner in zip(faces(), owners()):
        w, h = int(800 * np.linalg.norm(u)), int(800 * np.linalg.norm(v))
        if at[0] + w + 8 > 2048:
            at, row = [0, at[1] + row + 8], 0
        x, y = at
        side = max(w, h) + 8
        atlas[y : y + h + 4, x : x + w + 4] = pattern(side, random, smooth)[: h + 4, : w + 4]
        positions, uvs, indices = meshes.setdefault(int(owner), ([], [], []))
        first = len(positions)
        for a, b in ((0, 0), (1, 0), (1, 1), (0, 1)):
            positions.append(corner + a * u + b * v)
            uvs.append(((x + 2 + a * w) / 2048, (y + 2 + (1 - b) * h) / 2048))
        indices += [first, first + 1, first + 2, first, first + 2, first + 3]
        at[0] += w + 8
        row = max(row, h + 4)
    Image.fromarray(atlas).convert("RGB").save(os.path.join(folder, "atlas.png"))
    data, views, accessors = b"", [], []
    gltf_meshes, nodes = [], []
    for owner, (positions, uvs, indices) in sorted(meshes.items()):
        first = len(accessors)
        p = np.array(positions, np.float32)
        for values, kind, number in ((p, "VEC3", 5126), (np.array(uvs, np.float32), "VEC2", 5126), (np.array(indices, np.uint32), "SCALAR", 5125)):
            views.append({"buffer": 0, "byteOffset": len(data), "byteLength": values.nbytes})
            accessors.append({"bufferView": len(views) - 1, "componentType": number, "count": len(values), "type": kind})
            data += values.tobytes()
        accessors[first].update(min=p.min(0).tolist(), max=p.max(0).tolist())
        gltf_meshes.append({"primitives": [{"attributes": {"POSITION": first, "TEXCOORD_0": first + 1}, "indices": first + 2, "material": 0}]})
        nodes.append({"mesh": len(nodes), "name": "table" if owner == 0 else f"box-{owner - 1}", "extras": {"class": "box" if owner else "table"}})
    material = {"name": "pattern", "doubleSided": True, "pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1], "metallicFactor": 0}, "emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 0},
                "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 500}}}
    gltf = {
        "asset": {"version": "2.0"}, "extensionsUsed": ["KHR_materials_emissive_strength"], "scene": 0, "scenes": [{"nodes": list(range(len(nodes)))}], "nodes": nodes,
        "meshes": gltf_meshes, "materials": [material], "textures": [{"source": 0}], "images": [{"uri": "atlas.png"}], "accessors": accessors, "bufferViews": views,
        "buffers": [{"byteLength": len(data), "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode()}],
    }
    path = os.path.join(folder, "blocks.gltf")
    with open(path, "w") as f:
        json.dump(gltf, f)
    return path


def distances(points, quads):
    """From each point to the nearest face, m."""
    best = np.full(len(points), np.inf)
    for corner, u, v in quads:
        d = points - corner
        s, t = np.clip(d @ u / (u @ u), 0, 1), np.clip(d @ v / (v @ v), 0, 1)
        best = np.minimum(best, np.linalg.norm(d - s[:, None] * u - t[:, None] * v, axis=1))
    return best
