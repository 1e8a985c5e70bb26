//! Contact sheets as files: pictures side by side with captions, on one picture (PNG, JPEG), one self-contained HTML page or paper (PDF).

use crate::UsageError;
use crate::document::{Block, Document};
use crate::html::escaped;
use crate::output::{JPEG_QUALITY, Output};
use crate::paint::Page;
use crate::step_pictures::{histogram, under};
use anyhow::anyhow;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use diopter::image::{Picture, Raster, jpeg, png};
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Between pictures and around them, px.
const GAP: usize = 12;
/// Baseline to baseline of captions, px.
const LINE: usize = 20;
/// Letters of captions, and of the facts under them, px.
const CAPTION: f32 = 16.0;
const FACTS: f32 = 12.5;
/// Letters of the title, px.
const TITLE: f32 = 22.0;
/// Letters of tables, px; how wide one is, of its height (DejaVu Sans Mono).
const FIXED: f32 = 12.5;
const FIXED_WIDE: f32 = 0.602;
/// Baseline to baseline of tables, of the height of their letters.
const FIXED_LINE: f32 = 1.3;
/// Width that a sheet of one axis fills, px.
const WIDTH: usize = 1600;
/// Height of a histogram, px.
const HISTOGRAM: usize = 64;
/// Most pixels of a sheet.
const MOST_PIXELS: usize = 150_000_000;

/// A sheet: what is above it, and its pictures.
pub struct ContactSheet {
    /// Title; may be empty.
    pub title: String,
    /// Lines under the title.
    pub text: Vec<String>,
    /// Pictures beside each other; as many as fit without.
    pub columns: Option<usize>,
    /// Row by row.
    pub cells: Vec<Cell>,
    /// Captions and lines of fixed width, one below the other under the pictures.
    pub tables: Vec<(String, String)>,
}

/// A picture with what is said of it.
pub struct Cell {
    /// As it is shown.
    pub picture: Picture,
    /// What changed.
    pub label: String,
    /// Time, aperture, speed.
    pub facts: String,
}

/// How a sheet is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Png,
    Jpeg,
    Html,
    Pdf,
}

/// Files that a sheet goes to, proved writable.
pub fn prepare(paths: &[PathBuf]) -> anyhow::Result<Vec<(Kind, Output)>> {
    let one = |path: &PathBuf| {
        let ending = Path::new(path).extension().map(|e| e.to_string_lossy().to_lowercase());
        let kind = match ending.as_deref() {
            Some("png") => Kind::Png,
            Some("jpg" | "jpeg") => Kind::Jpeg,
            Some("html" | "htm") => Kind::Html,
            Some("pdf") => Kind::Pdf,
            _ => {
                let wrong = anyhow!("{}: expected a name that ends in .png, .jpg, .html or .pdf", path.display());
                return Err(UsageError(wrong).into());
            }
        };
        Ok((kind, Output::prepare(path)?))
    };
    paths.iter().map(one).collect()
}

/// What is shown below a picture.
#[derive(Clone, Copy, Debug, Default)]
pub struct Below {
    /// A part at 100 %: its middle, 0 to 1 across and down the picture.
    pub crop: Option<[f64; 2]>,
    /// The histogram.
    pub histogram: bool,
}

/// A picture as a cell shows it: reduced already, and what is shown of the whole below it.
pub fn compose(reduced: &Picture, whole: &Picture, below: Below) -> Picture {
    let mut shown = reduced.clone();
    shown.facts = None;
    let width = shown.pixels.width;
    if let Some(middle) = below.crop {
        shown = under(&shown, &vec![0.11; 3 * width * (GAP / 2)]);
        let rows = (2 * width).div_ceil(3).min(whole.pixels.height);
        shown = under(&shown, &cut(&whole.pixels, middle, [width, rows]));
    }
    if below.histogram {
        shown = under(&shown, &histogram(whole, width, HISTOGRAM));
    }
    shown
}

/// A part of a picture around a place (0 to 1 across and down), as far within it as it goes; dark where the picture is narrower than `size`.
fn cut(picture: &Raster<f32>, middle: [f64; 2], size: [usize; 2]) -> Vec<f32> {
    let from = |middle: f64, length: usize, part: usize| {
        let start = (middle * length as f64 - 0.5 * part as f64).round().max(0.0) as usize;
        start.min(length.saturating_sub(part))
    };
    let [left, top] = [from(middle[0], picture.width, size[0]), from(middle[1], picture.height, size[1])];
    let mut part = vec![0.11; 3 * size[0] * size[1]];
    let across = size[0].min(picture.width - left);
    for row in 0..size[1].min(picture.height - top) {
        let at = 3 * ((top + row) * picture.width + left);
        part[3 * row * size[0]..][..3 * across].copy_from_slice(&picture.data[at..at + 3 * across]);
    }
    part
}

impl ContactSheet {
    /// Width and height of the largest picture.
    fn cell(&self) -> [usize; 2] {
        let largest = |of: fn(&Picture) -> usize| self.cells.iter().map(|c| of(&c.picture)).max().unwrap_or(1);
        [largest(|p| p.pixels.width), largest(|p| p.pixels.height)]
    }

    /// Pictures beside each other.
    pub fn columns(&self) -> usize {
        let fit = ((WIDTH - GAP) / (self.cell()[0] + GAP)).max(1);
        self.columns
            .unwrap_or_else(|| {
                // Rows of equal length look better than full ones.
                let rows = self.cells.len().div_ceil(fit);
                self.cells.len().div_ceil(rows.max(1))
            })
            .clamp(1, self.cells.len().max(1))
    }

    /// The sheet as one picture.
    fn page(&self) -> anyhow::Result<Page> {
        let [w, h] = self.cell();
        let columns = self.columns();
        let rows = self.cells.len().div_ceil(columns);
        let head = if self.title.is_empty() { 0 } else { 34 } + LINE * self.text.len();
        let row = h + 2 * LINE + GAP;
        let width = GAP + columns * (w + GAP);
        let room = (width - 2 * GAP) as f32;
        // Letters as wide as they go: the tables of a narrow sheet are small.
        let longest = self.tables.iter().flat_map(|t| t.1.lines()).map(|l| l.chars().count()).max().unwrap_or(0);
        let fixed = FIXED.min(room / (longest.max(1) as f32 * FIXED_WIDE));
        let tall = |text: &str| (text.lines().count() as f32 * fixed * FIXED_LINE).ceil() as usize + 2 * LINE;
        let pictures = head + GAP + rows * row;
        let height = pictures + self.tables.iter().map(|t| tall(&t.1)).sum::<usize>();
        if width.saturating_mul(height) > MOST_PIXELS || width.max(height) > 65_535 {
            let wrong = anyhow!(
                "sheet {width}x{height}: expected at most {MOST_PIXELS} pixels; a smaller --sheet-cell (cell) makes it so"
            );
            return Err(UsageError(wrong).into());
        }
        let mut page = Page::new(width, height)?;
        if !self.title.is_empty() {
            page.text_within(GAP as f32, 30.0, &self.title, TITLE, room)?;
        }
        for (i, line) in self.text.iter().enumerate() {
            let y = (head - LINE * (self.text.len() - i)) as f32 + 14.0;
            page.text_within(GAP as f32, y, line, 14.0, room)?;
        }
        for (i, cell) in self.cells.iter().enumerate() {
            let (x, y) = (GAP + i % columns * (w + GAP), head + GAP + i / columns * row);
            let pixels = &cell.picture.pixels;
            page.picture(x + (w - pixels.width) / 2, y + (h - pixels.height) / 2, &cell.picture);
            let below = (y + h) as f32;
            page.text_within(x as f32, below + 17.0, &cell.label, CAPTION, w as f32)?;
            page.text_within(x as f32, below + 34.0, &cell.facts, FACTS, w as f32)?;
        }
        let mut y = pictures;
        for (caption, text) in &self.tables {
            page.text_within(GAP as f32, y as f32 + 14.0, caption, 14.0, room)?;
            page.lines(GAP as f32, (y + LINE) as f32 + fixed, text, fixed, fixed * FIXED_LINE)?;
            y += tall(text);
        }
        Ok(page)
    }

    /// The sheet as a page that holds its pictures.
    fn html(&self) -> anyhow::Result<String> {
        let title = if self.title.is_empty() { "Contact sheet" } else { &self.title };
        let mut page = String::new();
        let (w, columns) = (self.cell()[0], self.columns());
        writeln!(
            page,
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<title>{}</title>",
            escaped(title)
        )?;
        writeln!(
            page,
            "<style>\nbody {{ background: #1c1c1c; color: #e1e1e1; font-family: \"DejaVu Sans\", Verdana, sans-serif; margin: {GAP}px; }}\n\
             main {{ display: grid; grid-template-columns: repeat({columns}, {w}px); gap: {GAP}px; align-items: end; }}\n\
             figure {{ margin: 0; }}\nimg {{ display: block; margin: 0 auto; }}\nfigcaption {{ font-size: 16px; margin-top: 4px; }}\n\
             small {{ display: block; color: #b4b4b4; font-size: 12.5px; }}\n</style>\n</head>\n<body>"
        )?;
        if !self.title.is_empty() {
            writeln!(page, "<h1>{}</h1>", escaped(&self.title))?;
        }
        for line in &self.text {
            writeln!(page, "<p>{}</p>", escaped(line))?;
        }
        writeln!(page, "<main>")?;
        for cell in &self.cells {
            let mut bytes = Vec::new();
            png::write(&cell.picture, png::Depth::Eight, &mut bytes)?;
            let (label, facts) = (escaped(&cell.label), escaped(&cell.facts));
            let pixels = &cell.picture.pixels;
            writeln!(
                page,
                "<figure><img src=\"data:image/png;base64,{}\" width=\"{}\" height=\"{}\" alt=\"{label}\"><figcaption>{label}<small>{facts}</small></figcaption></figure>",
                STANDARD.encode(&bytes),
                pixels.width,
                pixels.height
            )?;
        }
        writeln!(page, "</main>")?;
        for (caption, text) in &self.tables {
            writeln!(page, "<p>{}</p>\n<pre>{}</pre>", escaped(caption), escaped(text))?;
        }
        writeln!(page, "</body>\n</html>")?;
        Ok(page)
    }

    /// The sheet on paper that lies on its side: pictures as they are, with their captions as text.
    fn document(&self) -> Document {
        let cells = self.cells.iter().map(|c| (c.picture.clone(), c.label.clone(), c.facts.clone())).collect();
        let mut blocks: Vec<Block> = self.text.iter().map(|line| Block::Paragraph(line.clone())).collect();
        blocks.push(Block::Contacts { columns: self.columns(), cells });
        for (caption, text) in &self.tables {
            blocks.push(Block::Paragraph(caption.clone()));
            blocks.push(Block::Fixed(text.clone()));
        }
        Document { title: self.title.clone(), blocks, wide: true }
    }

    /// Writes the sheet to all files.
    pub fn write(&self, outputs: Vec<(Kind, Output)>) -> anyhow::Result<Vec<PathBuf>> {
        let painted = outputs.iter().any(|o| matches!(o.0, Kind::Png | Kind::Jpeg));
        let page = if painted { Some(self.page()?) } else { None };
        let mut written = Vec::new();
        for (kind, output) in outputs {
            written.push(match (kind, &page) {
                (Kind::Png, Some(page)) => {
                    let bytes = page.png()?;
                    output.commit(|to| Ok(to.write_all(&bytes)?))?
                }
                (Kind::Jpeg, Some(page)) => output.commit(|to| Ok(jpeg::write(&page.to_picture(), JPEG_QUALITY, to)?))?,
                (Kind::Pdf, _) => {
                    let bytes = self.document().pdf()?;
                    output.commit(|to| Ok(to.write_all(&bytes)?))?
                }
                _ => {
                    let text = self.html()?;
                    output.commit(|to| Ok(to.write_all(text.as_bytes())?))?
                }
            });
        }
        Ok(written)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter::image::Encoding;
    use diopter::light::color::RgbSpace;

    fn picture(width: usize, height: usize) -> Picture {
        let data = (0..width * height).flat_map(|i| [(i % width) as f32 / width as f32, (i / width) as f32 / height as f32, 0.5]);
        let pixels = Raster { width, height, channels: 3, data: data.collect() };
        Picture { pixels, space: RgbSpace::Srgb, encoding: Encoding::Srgb, facts: None }
    }

    fn sheet(count: usize, columns: Option<usize>) -> ContactSheet {
        let cell = |k: usize| Cell { picture: picture(60, 40), label: format!("iso {k}"), facts: "f/2 <b>".into() };
        let cells = (0..count).map(cell).collect();
        ContactSheet { title: "A & B".into(), text: vec!["one".into()], columns, cells, tables: Vec::new() }
    }

    #[test]
    fn sheets_have_the_size_of_their_cells() {
        let sheet = sheet(6, Some(3));
        let page = sheet.page().unwrap().to_picture();
        assert_eq!(page.pixels.width, GAP + 3 * (60 + GAP));
        assert_eq!(page.pixels.height, 34 + LINE + GAP + 2 * (40 + 2 * LINE + GAP));
        // The second picture of the second row is where it belongs, unchanged.
        let (x, y) = (GAP + 60 + GAP, 34 + LINE + GAP + 40 + 2 * LINE + GAP);
        let at = 3 * ((y + 7) * page.pixels.width + x + 11);
        let expected = [11.0 / 60.0, 7.0 / 40.0, 0.5f32];
        for (got, expected) in page.pixels.data[at..at + 3].iter().zip(expected) {
            assert!((got - expected).abs() < 0.5 / 255.0 + 1e-6, "{got} {expected}");
        }
    }

    #[test]
    fn rows_of_one_axis_are_of_equal_length() {
        // 1600 px hold 22 pictures of 60 px.
        assert_eq!([7, 23, 44].map(|n| sheet(n, None).columns()), [7, 12, 22]);
        assert_eq!(sheet(2, Some(9)).columns(), 2);
    }

    #[test]
    fn pages_hold_their_pictures_and_escape_what_they_say() {
        let html = sheet(2, None).html().unwrap();
        assert_eq!(html.matches("data:image/png;base64,").count(), 2);
        assert!(html.contains("<h1>A &amp; B</h1>") && html.contains("f/2 &lt;b&gt;") && !html.contains("http:"), "{html}");
    }

    #[test]
    fn crops_are_pixels_of_the_whole() {
        let whole = picture(300, 200);
        let part = cut(&whole.pixels, [0.5, 1.0], [60, 40]);
        // Around the middle across, and as far down as there is picture.
        assert_eq!(part[..3], whole.pixels.data[3 * (160 * 300 + 120)..][..3]);
        let shown = compose(&picture(60, 40), &whole, Below { crop: Some([0.5, 0.5]), histogram: true });
        assert_eq!([shown.pixels.width, shown.pixels.height], [60, 40 + GAP / 2 + 40 + HISTOGRAM]);
        // Of a picture smaller than the crop nothing is left out.
        assert_eq!(cut(&picture(10, 10).pixels, [0.0, 0.0], [20, 10]).len(), 3 * 200);
    }
}
