//! Drawings as files: SVG as it is, PNG painted with `tiny-skia` and the letters of DejaVu Sans.

use crate::UsageError;
use crate::output::Output;
use ab_glyph::{Font, FontRef, OutlineCurve, ScaleFont};
use anyhow::{Context, anyhow};
use diopter::image::{Encoding, Picture, Raster};
use diopter::lens::draw::{Anchor, Color, Figure, Item};
use diopter::light::color::RgbSpace;
use std::io::Write;
use std::path::{Path, PathBuf};
use tiny_skia::{FillRule, Paint, PathBuilder, Pixmap, Stroke, StrokeDash, Transform};

/// Pixels a point.
const SCALE: f32 = 2.0;

/// Files that a drawing goes to, proved writable.
pub fn prepare(paths: &[PathBuf]) -> anyhow::Result<Vec<(bool, Output)>> {
    let one = |path: &PathBuf| {
        let ending = Path::new(path).extension().map(|e| e.to_string_lossy().to_lowercase());
        let png = match ending.as_deref() {
            Some("png") => true,
            Some("svg") => false,
            _ => return Err(UsageError(anyhow!("{}: expected a name that ends in .svg or .png", path.display())).into()),
        };
        Ok((png, Output::prepare(path)?))
    };
    paths.iter().map(one).collect()
}

/// Writes a drawing to all of them.
pub fn write(outputs: Vec<(bool, Output)>, figure: &Figure) -> anyhow::Result<Vec<PathBuf>> {
    let mut written = vec![];
    for (png, output) in outputs {
        let bytes = if png { paint(figure)? } else { figure.to_svg().into_bytes() };
        written.push(output.commit(|w| Ok(w.write_all(&bytes)?))?);
    }
    Ok(written)
}

fn paint(figure: &Figure) -> anyhow::Result<Vec<u8>> {
    let size = |points: f64| (points as f32 * SCALE).ceil() as u32;
    let mut map = Pixmap::new(size(figure.width), size(figure.height)).context("a drawing without size")?;
    map.fill(tiny_skia::Color::WHITE);
    let font = FontRef::try_from_slice(dejavu::sans::regular()).context("the embedded font")?;
    let scale = Transform::from_scale(SCALE, SCALE);
    for item in &figure.items {
        match item {
            Item::Path { points, color, width, dash, fill } => {
                let mut builder = PathBuilder::new();
                for (i, p) in points.iter().enumerate() {
                    let (x, y) = (p.x as f32, p.y as f32);
                    if i == 0 { builder.move_to(x, y) } else { builder.line_to(x, y) }
                }
                let Some(path) = builder.finish() else { continue };
                if let Some((color, opacity)) = fill {
                    map.fill_path(&path, &ink(*color, *opacity as f32), FillRule::Winding, scale, None);
                }
                if *width > 0.0 {
                    let dash = (*dash > 0.0).then(|| StrokeDash::new(vec![*dash as f32; 2], 0.0)).flatten();
                    let stroke = Stroke { width: *width as f32, dash, ..Stroke::default() };
                    map.stroke_path(&path, &ink(*color, 1.0), &stroke, scale, None);
                }
            }
            Item::Dot { at, radius, color } => {
                if let Some(path) = PathBuilder::from_circle(at.x as f32, at.y as f32, *radius as f32) {
                    map.fill_path(&path, &ink(*color, 1.0), FillRule::Winding, scale, None);
                }
            }
            Item::Text { at, text, size, anchor, upwards, color } => {
                let (path, width) = letters(&font, text, *size as f32);
                let Some(path) = path else { continue };
                let start = match anchor {
                    Anchor::Start => 0.0,
                    Anchor::Middle => -0.5 * width,
                    Anchor::End => -width,
                };
                let mut place = Transform::from_translate(start, 0.0);
                if *upwards {
                    place = place.post_rotate(-90.0);
                }
                let place = place.post_translate(at.x as f32, at.y as f32).post_scale(SCALE, SCALE);
                map.fill_path(&path, &ink(*color, 1.0), FillRule::Winding, place, None);
            }
        }
    }
    map.encode_png().context("the drawing as PNG")
}

/// A dark page of pictures and lines of text.
pub struct Page(Pixmap);

impl Page {
    /// A page of a size in pixels. Fails on one without pixels.
    pub fn new(width: usize, height: usize) -> anyhow::Result<Page> {
        let mut map = Pixmap::new(width as u32, height as u32).context("a page without size")?;
        map.fill(tiny_skia::Color::from_rgba8(28, 28, 28, 255));
        Ok(Page(map))
    }

    /// Puts a picture (as codes) with its upper left corner at a place, pixels from that of the page. It must fit across; what lies below the page is left out.
    pub fn picture(&mut self, x: usize, y: usize, picture: &Picture) {
        let (width, w) = (self.0.width() as usize, picture.pixels.width);
        let codes = picture.to_8_bit();
        let data = self.0.data_mut();
        for (row, line) in codes.chunks_exact(3 * w).enumerate() {
            for (column, c) in line.as_chunks::<3>().0.iter().enumerate() {
                let at = ((y + row) * width + x + column) * 4;
                if let Some(to) = data.get_mut(at..at + 4) {
                    to.copy_from_slice(&[c[0], c[1], c[2], 255]);
                }
            }
        }
    }

    /// Writes light letters, `size` px high, from a place on the baseline, px.
    pub fn text(&mut self, x: f32, y: f32, text: &str, size: f32) -> anyhow::Result<()> {
        let font = FontRef::try_from_slice(dejavu::sans::regular()).context("the embedded font")?;
        if let Some(path) = letters(&font, text, size).0 {
            self.0.fill_path(&path, &ink([225, 225, 225], 1.0), FillRule::Winding, Transform::from_translate(x, y), None);
        }
        Ok(())
    }

    /// Writes letters as [`Page::text`], smaller where they would be wider than `width` px.
    pub fn text_within(&mut self, x: f32, y: f32, text: &str, size: f32, width: f32) -> anyhow::Result<()> {
        let font = FontRef::try_from_slice(dejavu::sans::regular()).context("the embedded font")?;
        let wide = letters(&font, text, size).1;
        self.text(x, y, text, if wide > width { size * width / wide } else { size })
    }

    /// Writes lines of fixed width, the first on the baseline at (x, y), `size` px high and `line` px apart.
    pub fn lines(&mut self, x: f32, y: f32, text: &str, size: f32, line: f32) -> anyhow::Result<()> {
        let font = FontRef::try_from_slice(dejavu::sans_mono::regular()).context("the embedded font")?;
        for (i, text) in text.lines().enumerate() {
            if let Some(path) = letters(&font, text, size).0 {
                let at = Transform::from_translate(x, y + i as f32 * line);
                self.0.fill_path(&path, &ink([225, 225, 225], 1.0), FillRule::Winding, at, None);
            }
        }
        Ok(())
    }

    /// The page as a picture.
    pub fn to_picture(&self) -> Picture {
        // The page is opaque: premultiplied colours are the colours.
        let data = self.0.data().as_chunks::<4>().0.iter().flat_map(|p| [p[0], p[1], p[2]].map(|v| f32::from(v) / 255.0));
        let (width, height) = (self.0.width() as usize, self.0.height() as usize);
        let pixels = Raster { width, height, channels: 3, data: data.collect() };
        Picture { pixels, space: RgbSpace::Srgb, encoding: Encoding::Srgb, facts: None }
    }

    /// The page as a file.
    pub fn png(&self) -> anyhow::Result<Vec<u8>> {
        self.0.encode_png().context("the page as PNG")
    }
}

/// A picture of ours (PNG, sRGB codes), as it was painted. Fails on what is no PNG that can be read.
pub fn read_png(bytes: &[u8]) -> anyhow::Result<Picture> {
    Ok(Page(Pixmap::decode_png(bytes).context("a picture that was just written")?).to_picture())
}

fn ink(color: Color, opacity: f32) -> Paint<'static> {
    let mut paint = Paint::default();
    paint.set_color_rgba8(color[0], color[1], color[2], (opacity * 255.0) as u8);
    paint.anti_alias = true;
    paint
}

/// Outline of a line of text from its start on the baseline, and its width.
fn letters(font: &FontRef, text: &str, size: f32) -> (Option<tiny_skia::Path>, f32) {
    let scaled = font.as_scaled(size * 1.16);
    let factor = scaled.h_scale_factor();
    let mut builder = PathBuilder::new();
    let mut x = 0.0;
    let mut last = None;
    for c in text.chars() {
        let glyph = scaled.glyph_id(c);
        if let Some(last) = last {
            x += scaled.kern(last, glyph);
        }
        if let Some(outline) = font.outline(glyph) {
            let at = |p: ab_glyph::Point| (x + p.x * factor, -p.y * factor);
            let mut end: Option<ab_glyph::Point> = None;
            for curve in &outline.curves {
                let from = match curve {
                    OutlineCurve::Line(a, _) | OutlineCurve::Quad(a, _, _) | OutlineCurve::Cubic(a, _, _, _) => *a,
                };
                if end != Some(from) {
                    let (px, py) = at(from);
                    builder.move_to(px, py);
                }
                end = Some(match curve {
                    OutlineCurve::Line(_, b) => {
                        let (bx, by) = at(*b);
                        builder.line_to(bx, by);
                        *b
                    }
                    OutlineCurve::Quad(_, b, c) => {
                        let ((bx, by), (cx, cy)) = (at(*b), at(*c));
                        builder.quad_to(bx, by, cx, cy);
                        *c
                    }
                    OutlineCurve::Cubic(_, b, c, d) => {
                        let ((bx, by), (cx, cy), (dx, dy)) = (at(*b), at(*c), at(*d));
                        builder.cubic_to(bx, by, cx, cy, dx, dy);
                        *d
                    }
                });
            }
        }
        x += scaled.h_advance(glyph);
        last = Some(glyph);
    }
    (builder.finish(), x)
}
