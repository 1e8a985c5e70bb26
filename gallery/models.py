"""Makes the models of the gallery that are formulas: python models.py [FOLDER], beside the shot files without one. Needs numpy (pip).

knot.stl: a trefoil, binary STL. shell.ply: a sea shell (after R. Dawkins's and D. Raup's parameters: a circle that grows as it turns), binary PLY with colours of its
corners. balls.gltf: a soap bubble, brushed steel, velvet, heat-tinted titanium: KHR_materials_iridescence, _anisotropy, _sheen.
"""

import base64
import json
import struct
import sys
from pathlib import Path

import numpy as np


def grid(points):
    """Triangles of a grid of points [u][v] that closes in both directions."""
    n, m = points.shape[:2]
    i, j = np.meshgrid(np.arange(n), np.arange(m), indexing="ij")
    at = lambda a, b: (a % n) * m + (b % m)
    quads = at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)
    a, b, c, d = (q.ravel() for q in quads)
    return np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def tube(path, radius, m):
    """A tube of radii around a closed path [n][3]."""
    ahead = np.roll(path, -1, 0) - np.roll(path, 1, 0)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    side = np.cross(ahead, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(side, ahead)
    v = np.linspace(0, 2 * np.pi, m, endpoint=False)
    ring = side[:, None] * np.cos(v)[None, :, None] + up[:, None] * np.sin(v)[None, :, None]
    return path[:, None] + radius * ring


def knot(folder):
    t = np.linspace(0, 2 * np.pi, 600, endpoint=False)
    path = np.stack([np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)], 1) * 0.04
    points = tube(path, 0.028, 60)
    points[..., 1] -= points[..., 1].min()
    corners = points.reshape(-1, 3)[grid(points)].astype("<f4")
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    rows = np.zeros(len(corners), dtype=[("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")])
    rows["n"], rows["c"] = normals / np.linalg.norm(normals, axis=1, keepdims=True), corners
    (folder / "knot.stl").write_bytes(b"trefoil".ljust(80) + struct.pack("<I", len(rows)) + rows.tobytes())


def shell(folder):
    turns, growth = 5.5, 2.2
    u = np.linspace(-turns * 2 * np.pi, 0, 1600)
    v = np.linspace(0, 2 * np.pi, 120)
    size = growth ** (u / (2 * np.pi))
    ribs = 1 + 0.035 * np.cos(16 * u)
    u, v, s, r = u[:, None], v[None, :], size[:, None], ribs[:, None]
    out = s * (1.0 + 0.72 * r * np.cos(v))
    points = np.stack([out * np.cos(u), s * (0.95 * r * np.sin(v)) - 2.1 * s, out * np.sin(u)], -1) * 0.05
    points[..., 1] -= points[..., 1].min()
    band = 0.5 + 0.5 * np.cos(16 * u) * np.ones_like(v)
    spots = 0.5 + 0.5 * np.sin(7 * v + 3 * np.sin(5 * u))
    light, dark = np.array([238, 214, 178.0]), np.array([150, 72, 40.0])
    colour = light + (dark - light) * (0.25 * band + 0.75 * spots**3)[..., None]
    n, m = points.shape[:2]
    i, j = np.meshgrid(np.arange(n - 1), np.arange(m - 1), indexing="ij")
    a, b, c, d = ((i + k) * m + (j + l) for k, l in ((0, 0), (1, 0), (1, 1), (0, 1)))
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    corners = np.zeros(n * m, dtype=[("p", "<f4", 3), ("c", "u1", 3)])
    corners["p"], corners["c"] = points.reshape(-1, 3), colour.reshape(-1, 3)
    rows = np.zeros(len(faces), dtype=[("n", "u1"), ("i", "<i4", 3)])
    rows["n"], rows["i"] = 3, faces
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {n * m}\n"
    header += "".join(f"property float {x}\n" for x in "xyz") + "".join(f"property uchar {x}\n" for x in ("red", "green", "blue"))
    header += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    (folder / "shell.ply").write_bytes(header.encode() + corners.tobytes() + rows.tobytes())


def balls(folder):
    n, m = 96, 192
    theta, phi = np.meshgrid(np.linspace(0, np.pi, n + 1), np.linspace(0, 2 * np.pi, m + 1), indexing="ij")
    normal = np.stack([np.sin(theta) * np.cos(phi), np.cos(theta), -np.sin(theta) * np.sin(phi)], -1).reshape(-1, 3)
    uv = np.stack([phi / (2 * np.pi), theta / np.pi], -1).reshape(-1, 2)
    tangent = np.stack([-np.sin(phi), 0 * phi, -np.cos(phi), 1 + 0 * phi], -1).reshape(-1, 4)
    i, j = np.meshgrid(np.arange(n), np.arange(m), indexing="ij")
    a, b, c, d = (((i + k) * (m + 1) + j + l) for k, l in ((0, 0), (1, 0), (1, 1), (0, 1)))
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    parts = [x.tobytes() for x in (normal.astype("<f4"), uv.astype("<f4"), tangent.astype("<f4"), faces.astype("<u4"))]
    views, at = [], 0
    for part in parts:
        views.append({"buffer": 0, "byteOffset": at, "byteLength": len(part)})
        at += len(part)
    vertices = len(normal)
    kinds = [(5126, vertices, "VEC3"), (5126, vertices, "VEC2"), (5126, vertices, "VEC4"), (5125, faces.size, "SCALAR")]
    accessors = [{"bufferView": k, "componentType": t, "count": c, "type": s} for k, (t, c, s) in enumerate(kinds)]
    accessors[0] |= {"min": [-1, -1, -1], "max": [1, 1, 1]}
    pbr = lambda color, metal, rough: {"baseColorFactor": [*color, 1], "metallicFactor": metal, "roughnessFactor": rough}
    film = lambda ior, low, high: {"iridescenceFactor": 1, "iridescenceIor": ior, "iridescenceThicknessMinimum": low,
                                   "iridescenceThicknessMaximum": high}
    materials = [
        {"name": "bubble", "pbrMetallicRoughness": pbr([1, 1, 1], 0, 0), "extensions": {
            "KHR_materials_ior": {"ior": 1.0001}, "KHR_materials_transmission": {"transmissionFactor": 1},
            "KHR_materials_iridescence": film(1.33, 480, 480)}},
        {"name": "brushed steel", "pbrMetallicRoughness": pbr([0.56, 0.57, 0.58], 1, 0.25), "extensions": {
            "KHR_materials_anisotropy": {"anisotropyStrength": 0.75, "anisotropyRotation": 1.5708}}},
        {"name": "velvet", "pbrMetallicRoughness": pbr([0.12, 0.005, 0.02], 0, 1), "extensions": {
            "KHR_materials_sheen": {"sheenColorFactor": [0.9, 0.25, 0.4], "sheenRoughnessFactor": 0.35},
            "KHR_materials_specular": {"specularFactor": 0}}},
        {"name": "titanium", "pbrMetallicRoughness": pbr([0.54, 0.5, 0.45], 1, 0.2), "extensions": {
            "KHR_materials_iridescence": film(2.4, 66, 66)}},
    ]
    primitive = {"attributes": {"POSITION": 0, "NORMAL": 0, "TEXCOORD_0": 1, "TANGENT": 2}, "indices": 3}
    names = sorted({e for m in materials for e in m["extensions"]})
    places = [(-0.165, 0.05, 0.0), (-0.055, 0.05, 0.0), (0.055, 0.05, 0.0), (0.165, 0.05, 0.0)]
    scene = {
        "asset": {"version": "2.0"}, "extensionsUsed": names, "scene": 0, "scenes": [{"nodes": list(range(4))}],
        "nodes": [{"name": materials[k]["name"], "mesh": k, "translation": p, "scale": [0.05] * 3} for k, p in enumerate(places)],
        "meshes": [{"primitives": [{**primitive, "material": k}]} for k in range(4)],
        "materials": materials, "accessors": accessors, "bufferViews": views,
        "buffers": [{"byteLength": at, "uri": "data:application/octet-stream;base64," + base64.b64encode(b"".join(parts)).decode()}],
    }
    (folder / "balls.gltf").write_text(json.dumps(scene))


if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parent)
    for make in (knot, shell, balls):
        make(folder)
