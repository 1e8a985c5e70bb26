//! How a raw becomes a picture: the picture after each step with its histogram, and a sheet of all.

use crate::output::Output;
use crate::paint;
use anyhow::Context;
use diopter::develop::lut::Lut;
use diopter::develop::{Developer, Recipe, Step};
use diopter::image::{Picture, PictureSource, RawImage, png};
use diopter::shot::ShotError;
use std::path::{Path, PathBuf};

/// Longer side of a picture on the sheet, px.
const CELL: u32 = 480;
/// Pictures beside each other on the sheet.
const COLUMNS: usize = 4;
/// Height of the line of text under a picture, px.
const CAPTION: usize = 26;
/// Bars of a histogram.
const BARS: usize = 256;

/// Name of a step's picture.
fn name(i: usize, step: Step) -> String {
    format!("{:02}-{}.png", i + 1, step.name())
}

/// Names of all files that may be written.
pub fn names() -> Vec<String> {
    Step::ALL.into_iter().enumerate().map(|(i, step)| name(i, step)).chain(["sheet.png".into()]).collect()
}

/// Writes `01-black-level.png` ... and `sheet.png` into a folder; steps that do nothing are left out.
pub fn write_steps(raw: &RawImage, recipe: &Recipe, lut: Option<&Lut>, folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    std::fs::create_dir_all(folder).with_context(|| format!("{}: this folder cannot be made", folder.display()))?;
    let mut small = recipe.clone();
    small.resize = Default::default();
    small.resize.long_edge = Some(CELL);
    let mut cells = Vec::new();
    let mut written = Vec::new();
    for (i, step) in Step::ALL.into_iter().enumerate() {
        let developer = Developer::new(raw, recipe, lut.cloned()).map_err(ShotError::from)?;
        if !developer.does(step) {
            continue;
        }
        let output = Output::prepare(&folder.join(name(i, step)))?;
        let picture = developer.until(step).whole();
        let with = under(&picture, &histogram(&picture, picture.pixels.width, (picture.pixels.height / 5).max(64)));
        written.push(output.commit(|to| Ok(png::write(&with, png::Depth::Eight, to)?))?);
        let developer = Developer::new(raw, &small, lut.cloned()).map_err(ShotError::from)?;
        let thumb = developer.until(step).whole();
        let strip = histogram(&thumb, thumb.pixels.width, 72);
        cells.push((format!("{} {}", i + 1, step.name()), under(&thumb, &strip)));
    }
    let output = Output::prepare(&folder.join("sheet.png"))?;
    let sheet = sheet(&cells)?;
    written.push(output.commit(|to| Ok(std::io::Write::write_all(to, &sheet)?))?);
    Ok(written)
}

/// Counts of codes as bars of the three colours, light on black: `[row][column][3]`.
pub fn histogram(picture: &Picture, width: usize, height: usize) -> Vec<f32> {
    let mut counts = [[0.0f64; BARS]; 3];
    for pixel in picture.pixels.data.as_chunks::<3>().0 {
        for (c, v) in pixel.iter().enumerate() {
            counts[c][((v.clamp(0.0, 1.0) * (BARS - 1) as f32).round()) as usize] += 1.0;
        }
    }
    // The ends may hold more than all else: they are cut off.
    let top = counts.iter().flat_map(|c| &c[1..BARS - 1]).fold(1.0f64, |a, b| a.max(*b));
    let mut strip = vec![0.0; width * height * 3];
    // Quarters of the codes, and a mark for every sixteenth at the foot.
    for mark in 0..=16 {
        let x = mark * (width - 1) / 16;
        let from = if mark % 4 == 0 { 0 } else { height - 4 };
        for y in from..height {
            strip[(y * width + x) * 3..][..3].fill(0.3);
        }
    }
    for x in 0..width {
        let bar = (x * BARS / width).min(BARS - 1);
        for c in 0..3 {
            let full = ((counts[c][bar] / top).min(1.0).sqrt() * (height - 4) as f64) as usize;
            for y in height - full..height {
                strip[(y * width + x) * 3 + c] = 0.85;
            }
        }
    }
    strip
}

/// A picture with a strip below.
pub fn under(picture: &Picture, strip: &[f32]) -> Picture {
    let mut with = picture.clone();
    // Histograms count codes; whatever they mean, they are shown as they are.
    with.pixels.data.extend_from_slice(strip);
    with.pixels.height += strip.len() / (3 * picture.pixels.width);
    with
}

/// All steps on one picture, as PNG.
fn sheet(cells: &[(String, Picture)]) -> anyhow::Result<Vec<u8>> {
    let (_, first) = cells.first().context("there are no steps")?;
    let gap = 10;
    let (w, h) = (first.pixels.width, first.pixels.height);
    let columns = COLUMNS.min(cells.len());
    let rows = cells.len().div_ceil(columns);
    let mut page = paint::Page::new(gap + columns * (w + gap), gap + rows * (h + CAPTION + gap))?;
    for (i, (name, picture)) in cells.iter().enumerate() {
        let (x, y) = (gap + i % columns * (w + gap), gap + i / columns * (h + CAPTION + gap));
        page.picture(x, y, picture);
        page.text((x + 2) as f32, (y + h + CAPTION - 7) as f32, name, 17.0)?;
    }
    page.png()
}
