"""All pictures of the gallery made again: by the shot files beside this script, put together where a picture shows several.

    pip install pillow
    python gallery/make.py DIOPTER [NAME...]        # all, or those named, as `shutter-series`

Needs the scenes that the shot files name; pictures whose scene is missing are left as they are and told at the end. A line for each picture: its size, the
file's, and the processor seconds that all its shots took. Models of `knot`, `shell` and `balls` are made by `models.py` first.
"""

import resource
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

from PIL import Image, ImageDraw, ImageFile, ImageFont

HERE = Path(__file__).resolve().parent
# Noise does not fit into the block that Pillow optimises by itself.
ImageFile.MAXBLOCK = 1 << 24
# What a picture of the gallery may take, bytes.
LARGEST = 250_000
GAP = 4
CAPTION = 18


class Maker:
    """Runs the program; what it wrote lies in `folder` until the picture is put together."""

    def __init__(self, diopter: str, folder: Path):
        self.diopter, self.folder = diopter, folder

    def run(self, *arguments) -> None:
        command = [self.diopter, *(str(a) for a in arguments)]
        done = subprocess.run(command, cwd=HERE, capture_output=True, text=True)
        if done.returncode != 0:
            raise RuntimeError(f"{' '.join(command)}\n{done.stderr}")

    def shoot(self, shot: str, *flags, name: str | None = None, suffix: str = "png") -> Path:
        """A picture of a shot file with more flags."""
        out = self.folder / f"{name or shot}.{suffix}"
        self.run("shoot", f"{shot}.toml", *flags, "-o", out)
        return out

    def develop(self, raw: Path, name: str, *flags) -> Path:
        out = self.folder / f"{name}.png"
        self.run("develop", raw, *flags, "-o", out)
        return out


def opened(path: Path) -> Image.Image:
    return Image.open(path).convert("RGB")


def captioned(picture: Image.Image, text: str | None) -> Image.Image:
    """A picture with a line of text below it."""
    if not text:
        return picture
    out = Image.new("RGB", (picture.width, picture.height + CAPTION), (24, 24, 24))
    out.paste(picture, (0, 0))
    font = ImageFont.load_default(12)
    ImageDraw.Draw(out).text((6, picture.height + 2), text, fill=(220, 220, 220), font=font)
    return out


def grid(cells: list[tuple[Image.Image, str | None]], columns: int, width: int | None = None) -> Image.Image:
    """Pictures side by side, with their captions; `width`: of each, px."""
    def sized(picture: Image.Image) -> Image.Image:
        if width is None or picture.width == width:
            return picture
        return picture.resize((width, round(picture.height * width / picture.width)), Image.LANCZOS)

    shown = [captioned(sized(p), text) for p, text in cells]
    w = max(p.width for p in shown)
    rows = [shown[i:i + columns] for i in range(0, len(shown), columns)]
    heights = [max(p.height for p in row) for row in rows]
    out = Image.new("RGB", (columns * w + (columns - 1) * GAP, sum(heights) + (len(rows) - 1) * GAP), (255, 255, 255))
    for k, row in enumerate(rows):
        for i, picture in enumerate(row):
            out.paste(picture, (i * (w + GAP), sum(heights[:k]) + k * GAP))
    return out


def middle(picture: Image.Image, width: int, height: int, at: tuple[float, float] = (0.5, 0.5), scale: int = 1) -> Image.Image:
    """A part of a picture around a place (fractions of it), pixels enlarged whole."""
    left, top = round(at[0] * picture.width - width / 2), round(at[1] * picture.height - height / 2)
    part = picture.crop((left, top, left + width, top + height))
    return part.resize((width * scale, height * scale), Image.NEAREST)


def shots(m: Maker, cells: list[tuple[str, tuple, str | None]], columns: int, width: int | None = None) -> Image.Image:
    """Shots side by side: shot file, flags, caption."""
    pictures = [(opened(m.shoot(shot, *flags, name=f"{shot}-{i}")), text) for i, (shot, flags, text) in enumerate(cells)]
    return grid(pictures, columns, width)


def aperture(m):
    return shots(m, [("aperture-full", (), "f/2.1, 1/80 s"), ("aperture-half", (), "half the radius, 1/80 s")], 2)


def bracket(m):
    out = m.folder / "bracket.png"
    m.run("shoot", "bracket.toml", "--merge", m.folder / "merged.dng", "-o", out)
    steps = sorted(m.folder.glob("bracket*.png"))
    merged = m.develop(m.folder / "merged.dng", "together", "--set", "local.compression=0.5")
    dark, right, bright = steps[0], steps[len(steps) // 2], steps[-1]
    cells = [(dark, "-3 EV"), (right, "as metered"), (bright, "+3 EV"), (merged, "all five merged, contrast of large areas compressed")]
    return grid([(opened(p), text) for p, text in cells], 2)


def classic_lenses(m):
    cells = []
    for name, text in [("wide", "wide angle, 22 mm"), ("double-gauss", "double Gauss, 50 mm"), ("telephoto", "telephoto, 250 mm"), ("fisheye", "fisheye, 10 mm")]:
        cells.append((f"classic-{name}", ("--spp", 4, "--denoise", "off", "--fireflies", "keep"), f"{text}: 4 samples a pixel as they are"))
        cells.append((f"classic-{name}", (), f"{text}: 64 samples, denoised"))
    return shots(m, cells, 2, 400)


def dark_frame(m):
    return shots(m, [("dark-frame", (), "20 °C"), ("hot-pixels", (), "35 °C")], 2, 480)


def demosaic(m):
    raw = m.shoot("resolution", suffix="dng")
    cells = []
    for method in ["gbtf", "rcd", "malvar-he-cutler", "bilinear"]:
        picture = opened(m.develop(raw, method, "--demosaic", method, "--set", "demosaic.false_color_passes=0"))
        cells.append((middle(picture, 180, 180, (0.5, 0.35), 2), method))
    return grid(cells, 4)


def denoised(m):
    cells = [
        ("denoised", ("--fireflies", "keep"), "32 samples a pixel"),
        ("denoised", ("--denoise", "on"), "the same, denoised"),
        ("denoised", ("--spp", 256, "--fireflies", "keep"), "256 samples a pixel"),
    ]
    pictures = [(middle(opened(m.shoot(s, *f, name=f"d{i}")), 460, 386, (0.45, 0.55)), t) for i, (s, f, t) in enumerate(cells)]
    return grid(pictures, 3)


def depth_of_field(m):
    return shots(m, [
        ("depth-of-field", (), "f/1.4"),
        ("depth-of-field", ("--aperture", "f/22"), "f/22"),
        ("depth-of-field", ("--quick",), "f/1.4 from one sharp exposure and its depth (--quick)"),
    ], 3)


def equal_exposures(m):
    pairs = [("f/1.4", "1/500"), ("f/5.6", "1/30"), ("f/22", "1/2")]
    return shots(m, [("equal-exposures", ("--aperture", a, "--shutter", t), f"{a}, {t} s") for a, t in pairs], 3)


def expose_right(m):
    pictures = [opened(m.shoot(shot)) for shot in ["expose-normal", "expose-right"]]
    texts = ["as the meter says at ISO 1600, raised by 1.5 EV", "as much light as the sensor holds at ISO 400"]
    crops = [(middle(p, 270, 180, (0.26, 0.42), 2), "pixels doubled") for p in pictures]
    return grid([*[(p.resize((540, 360), Image.LANCZOS), t) for p, t in zip(pictures, texts)], *crops], 2)


def flash_curtains(m):
    return shots(m, [
        ("flash-first", (), "1/2 s, flash as the first curtain runs"),
        ("flash-second", (), "1/2 s, flash before the second curtain runs"),
        ("flash-band", (), "1/500 s: the curtains leave a slit"),
    ], 3)


def focus_priority(m):
    return shots(m, [
        ("focus-priority", (), "closest of nine zones"),
        ("focus-priority", ("--focus-priority", "farthest"), "farthest"),
    ], 2)


def focus_stack(m):
    out = m.folder / "stack.png"
    m.run("shoot", "focus-stack.toml", "--stack", m.folder / "together.png", "-o", out)
    series = sorted(m.folder.glob("stack*.png"))
    cells = [(series[0], "first of seven"), (series[-1], "last of seven"), (m.folder / "together.png", "all of them (--stack)")]
    return grid([(opened(p), text) for p, text in cells], 3)


def iso_ladder(m):
    cells = []
    for body, name in [("t2i", "T2i"), ("5d-mark-iv", "5D Mark IV")]:
        for iso in [100, 200, 400, 800, 1600, 3200, 6400]:
            picture = opened(m.shoot(f"iso-ladder-{body}", "--iso", iso, name=f"{body}-{iso}"))
            cells.append((middle(picture, 198, 180, (0.5, 0.55)), f"{name}, ISO {iso}"))
    return grid(cells, 7)


def lens_corrected(m):
    raw = m.shoot("lens-corrected", suffix="dng")
    corrected = [x for name in ["distortion", "lateral_color", "vignetting"] for x in ["--set", f"lens.{name}=true"]]
    pictures = [(m.develop(raw, "as-it-is"), "as the lens has it"), (m.develop(raw, "corrected", *corrected), "corrected by its prescription")]
    return grid([(opened(p), text) for p, text in pictures], 2, 720)


def lens_sheet(m):
    names = [
        ("sheet-dispersion", "one flint glass: colours part"),
        ("sheet-asphere", "aspheres of a phone"),
        ("sheet-floating-focus", "a macro whose groups move"),
        ("sheet-anamorphic", "cylinders"),
        ("sheet-zoom", "a kit zoom"),
        ("classic-fisheye", "a fisheye"),
    ]
    return shots(m, [(name, (), text) for name, text in names], 3, 397)


def light_field(m):
    raw = m.shoot("light-field", suffix="dng")
    refocused = [(m.develop(raw, f"at-{f}", "--refocus", f), text) for f, text in [
        ("0.65m", "refocused to 0.65 m"), ("as-taken", "as taken: 0.83 m"), ("1.6m", "1.6 m"), ("all", "sharp at all depths"),
    ]]
    m.run("develop", raw, "--depth", m.folder / "depth.png")
    mosaic = middle(opened(m.develop(raw, "mosaic")), 360, 240, (0.45, 0.6))
    cells = [(opened(p), text) for p, text in refocused]
    cells[3:3] = [(mosaic, "the raw picture, pixel by pixel")]
    return grid([*cells, (opened(m.folder / "depth.png"), "depth, near is light")], 3, 386)


def lut_looks(m):
    raw = m.shoot("tone-curves", suffix="dng")
    looks = {
        "film": ["--preset", "film"],
        "mono": ["--tone", "agx-punchy", "--set", "grade.saturation=0", "--set", "grade.contrast=1.2"],
        "cold": ["--tone", "neutral", "--set", "grade.slope=0.92,0.98,1.1", "--set", "grade.offset=-0.01,0,0.03", "--set", "grade.saturation=0.8"],
    }
    cells = [(m.develop(raw, "default"), "default")]
    for name, look in looks.items():
        table = m.folder / f"{name}.cube"
        m.run("lut", "bake", *look, "-o", table)
        cells.append((m.develop(raw, name, "--lut", table, "--set", "lut.input=log"), f"{name}.cube"))
    return grid([(opened(p), text) for p, text in cells], 2, 600)


def rolling_shutter(m):
    return shots(m, [
        ("rolling-shutter", ("--shutter-type", "global"), "all rows at once"),
        ("rolling-shutter", (), "row by row in 50.81 ms"),
    ], 2)


def shutter_series(m):
    return shots(m, [("shutter-series", ("--shutter", t), f"{t} s") for t in ["1/4000", "1/1000", "1/250", "1/60"]], 2)


def steps(m):
    raw = m.shoot("tone-curves", suffix="dng")
    folder = m.folder / "steps"
    m.run("develop", raw, "--preset", "camera", "--steps", folder, "-o", m.folder / "end.png")
    # Without their own contact sheet.
    pictures = sorted(folder.glob("[0-9]*.png"))
    return grid([(opened(p), p.stem.replace("-", " ")) for p in pictures], 4, 366)


def telephoto(m):
    return shots(m, [
        ("classic-telephoto", (), "f/5.6"),
        ("telephoto-stopped", (), "four stops down, the same time"),
        ("telephoto-raised", (), "raised by 4 EV in development"),
    ], 3, 398)


def tone_curves(m):
    raw = m.shoot("tone-curves", suffix="dng")
    curves = ["linear", "reinhard-extended", "aces-fit", "aces-1.3", "agx"]
    cells = [(m.develop(raw, "without", "--tone", "linear", "--set", "output.encoding=linear"), "linear, not encoded")]
    cells += [(m.develop(raw, curve, "--tone", curve), curve) for curve in curves]
    return grid([(opened(p), text) for p, text in cells], 3, 480)


def water(m):
    return shots(m, [
        ("water", ("--polarizer", "linear:0deg"), "polariser along the horizon"),
        ("water", (), "across it"),
    ], 2)


COMPOSED = {
    f.__name__.replace("_", "-"): f
    for f in [
        aperture, bracket, classic_lenses, dark_frame, demosaic, denoised, depth_of_field, equal_exposures, expose_right, flash_curtains, focus_priority,
        focus_stack, iso_ladder, lens_corrected, lens_sheet, light_field, lut_looks, rolling_shutter, shutter_series, steps, telephoto, tone_curves, water,
    ]
}
SINGLE = [
    "balls", "bunny", "coffee", "cornell", "flicker", "flight-helmet", "fog", "fox", "fox-running", "high-speed", "knot", "light-trails", "milk-truck", "red-dots", "shell",
    "star-trails", "still-life",
]


def save(picture: Image.Image, path: Path) -> int:
    """The best JPEG that is small enough; its bytes."""
    for quality in range(92, 40, -4):
        picture.save(path, quality=quality, optimize=True, subsampling="4:2:0" if quality < 88 else "4:4:4")
        if path.stat().st_size <= LARGEST:
            break
    return path.stat().st_size


def missing(name: str) -> str | None:
    """The scene that a shot file names and that is not there."""
    shot = HERE / f"{name}.toml"
    scene = tomllib.loads(shot.read_text()).get("scene", {}).get("file", "") if shot.exists() else ""
    return scene if "/" in scene and not (HERE / scene).exists() else None


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    diopter, names = str(Path(sys.argv[1]).resolve()), sys.argv[2:] or [*SINGLE, *COMPOSED]
    unknown = [n for n in names if n not in SINGLE and n not in COMPOSED]
    if unknown:
        sys.exit(f"no picture {', '.join(unknown)}: expected some of {', '.join([*SINGLE, *COMPOSED])}")
    left = []
    subprocess.run([sys.executable, HERE / "models.py"], cwd=HERE, check=True, capture_output=True)
    for name in names:
        if scene := missing(name):
            left.append(f"{name}: {scene} is missing")
            continue
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        with tempfile.TemporaryDirectory() as folder:
            maker = Maker(diopter, Path(folder))
            try:
                picture = COMPOSED[name](maker) if name in COMPOSED else opened(maker.shoot(name))
            except RuntimeError as error:
                left.append(f"{name}: {error}")
                continue
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        size = save(picture, HERE / f"{name}.jpg")
        print(f"{name}: {picture.width} x {picture.height}, {size // 1000} KB, {seconds:.0f} processor seconds", flush=True)
    if left:
        sys.exit("left as they are:\n" + "\n".join(left))


if __name__ == "__main__":
    main()
