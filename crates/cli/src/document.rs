//! Pages for people: reports, lessons and sheets, as one HTML file that needs no other, or as PDF on A4.
//!
//! A document is a list of blocks, one below the other. Both ways of writing it show the same blocks with the same words.

use crate::UsageError;
use crate::html::escaped;
use crate::output::Output;
use crate::pdf::{A4, Ink, Paper, Type};
use anyhow::anyhow;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use diopter::image::{Picture, png};
use diopter::lens::draw::{Color, Figure};
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Margins of a sheet of paper, points.
const MARGIN: f64 = 42.0;
/// Letters of text, tables and headings, points.
const TEXT: f64 = 9.5;
const FIXED: f64 = 7.6;
const SMALL: f64 = 8.0;
const HEADING: f64 = 13.0;
const TITLE: f64 = 18.0;
/// Baseline to baseline, of the letters' height.
const LEADING: f64 = 1.35;
/// Between blocks and between pictures, points.
const GAP: f64 = 8.0;
/// Letters of fixed width are not made smaller than this to fit a line, points: longer lines are broken.
const LEAST_FIXED: f64 = 5.0;
/// Most points a pixel of a picture takes, and most of the height of a page.
const POINTS_A_PIXEL: f64 = 0.75;
const TALLEST: f64 = 0.62;

const INK: Color = [34, 34, 34];
const PALE: Color = [110, 110, 110];

/// Something on a page.
pub enum Block {
    /// A part begins.
    Heading(String),
    /// Running text.
    Paragraph(String),
    /// Below a picture, or a command.
    Small(String),
    /// Lines of letters of fixed width.
    Fixed(String),
    /// Rows of cells. The first row is the head, if `head`.
    Rows { rows: Vec<Vec<String>>, head: bool },
    /// Drawings, side by side as far as they fit.
    Figures(Vec<Figure>),
    /// A picture; `marked`: a place in it, 0 to 1 across and down, with a ring around.
    Picture { picture: Box<Picture>, marked: Option<[f64; 2]> },
    /// Names with fractions as bars; those below 0 in another colour.
    Bars(Vec<(String, f64)>),
    /// Figures at a glance: name, value, remark.
    Tiles(Vec<[String; 3]>),
    /// Pictures side by side, each with a line and a smaller line below it.
    Contacts { columns: usize, cells: Vec<(Picture, String, String)> },
    /// What follows begins on a new sheet of paper, with this title.
    Chapter(String),
}

/// A page, or as many as it takes.
#[derive(Default)]
pub struct Document {
    pub title: String,
    pub blocks: Vec<Block>,
    /// Sheets of paper lie on their side.
    pub wide: bool,
}

/// How a document is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Html,
    Pdf,
}

/// Kind of a document by the ending of its file's name.
pub fn kind(path: &Path) -> Option<Kind> {
    match path.extension()?.to_string_lossy().to_lowercase().as_str() {
        "html" | "htm" => Some(Kind::Html),
        "pdf" => Some(Kind::Pdf),
        _ => None,
    }
}

/// The file that a document goes to, proved writable.
pub fn prepare(path: &Path) -> anyhow::Result<(Kind, Output)> {
    let Some(kind) = kind(path) else {
        return Err(UsageError(anyhow!("{}: expected a name that ends in .html or .pdf", path.display())).into());
    };
    Ok((kind, Output::prepare(path)?))
}

impl Document {
    /// Adds a heading.
    pub fn heading(&mut self, text: &str) {
        self.blocks.push(Block::Heading(text.into()));
    }

    /// Adds a paragraph.
    pub fn paragraph(&mut self, text: &str) {
        self.blocks.push(Block::Paragraph(text.into()));
    }

    /// A part: its heading, drawings and lines of fixed width.
    pub fn section(&mut self, heading: &str, figures: &[Figure], table: &str) {
        self.heading(heading);
        if !figures.is_empty() {
            self.blocks.push(Block::Figures(figures.to_vec()));
        }
        if !table.is_empty() {
            self.blocks.push(Block::Fixed(table.into()));
        }
    }

    /// Writes the file.
    pub fn write(&self, (kind, output): (Kind, Output)) -> anyhow::Result<PathBuf> {
        let bytes = match kind {
            Kind::Html => self.html()?.into_bytes(),
            Kind::Pdf => self.pdf()?,
        };
        output.commit(|to| Ok(to.write_all(&bytes)?))
    }

    /// One page that needs no other file.
    pub fn html(&self) -> anyhow::Result<String> {
        let title = escaped(&self.title);
        let mut page = format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<title>{title}</title>\n<style>\n\
             body {{ font-family: system-ui, 'Segoe UI', 'DejaVu Sans', sans-serif; max-width: 1080px; margin: 2em auto; padding: 0 1.2em; color: #222; line-height: 1.45; }}\n\
             h1 {{ font-size: 1.9em; line-height: 1.15; margin: 0 0 0.4em; padding-top: 0.5em; border-top: 6px solid #c33; }}\n\
             h2 {{ font-size: 1.2em; margin: 2em 0 0.5em; padding-bottom: 0.2em; border-bottom: 2px solid #222; }}\n\
             figure {{ margin: 0.4em 0; }}\nsvg {{ max-width: 100%; height: auto; }}\n\
             .side figure {{ flex: 1 1 440px; }}\n\
             pre {{ background: #f6f6f4; border-left: 3px solid #bbb; padding: 0.8em 1em; overflow-x: auto; font-size: 76%; line-height: 1.35; }}\n\
             .tiles {{ display: grid; grid-template-columns: repeat(auto-fill, minmax(190px, 1fr)); gap: 10px; margin: 1em 0; }}\n\
             .tiles div {{ background: #f6f6f4; border-top: 3px solid #c33; padding: 0.5em 0.8em; }}\n\
             .tiles span, .tiles b, .tiles small {{ display: block; }}\n.tiles span {{ font-size: 85%; color: #555; }}\n.tiles b {{ font-size: 1.45em; font-variant-numeric: tabular-nums; }}\n\
             table {{ border-collapse: collapse; margin: 0.5em 0; font-size: 90%; }}\n\
             td, th {{ padding: 1px 9px; text-align: right; border-bottom: 1px solid #ddd; font-variant-numeric: tabular-nums; }}\n\
             td:first-child, th:first-child {{ text-align: left; }}\n\
             .side {{ display: flex; flex-wrap: wrap; gap: 1em; align-items: flex-start; }}\n\
             .picture {{ position: relative; display: inline-block; }}\n.picture img {{ display: block; max-width: 100%; }}\n\
             .picture div {{ position: absolute; width: 22px; height: 22px; margin: -13px; border: 2px solid #e33; border-radius: 50%; box-shadow: 0 0 0 1px #fff; }}\n\
             .bar {{ display: flex; align-items: center; margin: 2px 0; font-size: 90%; }}\n.bar span {{ width: 22em; }}\n\
             .bar i {{ background: #47a; height: 0.9em; display: inline-block; }}\n.bar i.less {{ background: #c62; }}\n\
             .bar b {{ font-weight: normal; margin-left: 0.5em; }}\nsmall {{ color: #666; }}\n\
             @media print {{ body {{ margin: 0; font-size: 10px; }} @page {{ margin: 12mm; }} h1.chapter {{ break-before: page; }} }}\n\
             </style>\n</head>\n<body>\n<h1>{title}</h1>\n"
        );
        for block in &self.blocks {
            match block {
                Block::Heading(text) => writeln!(page, "<h2>{}</h2>", escaped(text))?,
                Block::Chapter(text) => writeln!(page, "<h1 class=\"chapter\">{}</h1>", escaped(text))?,
                Block::Paragraph(text) => writeln!(page, "<p>{}</p>", escaped(text))?,
                Block::Small(text) => writeln!(page, "<p><small>{}</small></p>", escaped(text))?,
                Block::Fixed(text) => writeln!(page, "<pre>{}</pre>", escaped(text))?,
                Block::Rows { rows, head } => {
                    writeln!(page, "<table>")?;
                    for (i, row) in rows.iter().enumerate() {
                        let tag = if *head && i == 0 { "th" } else { "td" };
                        let cells: String = row.iter().map(|c| format!("<{tag}>{}</{tag}>", escaped(c))).collect();
                        writeln!(page, "<tr>{cells}</tr>")?;
                    }
                    writeln!(page, "</table>")?;
                }
                Block::Figures(figures) => {
                    let all: String = figures.iter().map(|f| format!("<figure>{}</figure>\n", f.to_svg())).collect();
                    writeln!(page, "<div class=\"side\">{all}</div>")?;
                }
                Block::Picture { picture, marked } => {
                    let mark = marked.map_or(String::new(), |[x, y]| {
                        format!("<div style=\"left:{:.2}%;top:{:.2}%\"></div>", 100.0 * x, 100.0 * y)
                    });
                    writeln!(page, "<div class=\"picture\">{}{mark}</div>", embedded(picture, "the picture")?)?;
                }
                Block::Bars(all) => page.push_str(&bars(all)),
                Block::Tiles(all) => {
                    let tile = |[name, value, remark]: &[String; 3]| {
                        let [name, value, remark] = [name, value, remark].map(|t| escaped(t));
                        format!("<div><span>{name}</span><b>{value}</b><small>{remark}</small></div>")
                    };
                    writeln!(page, "<div class=\"tiles\">{}</div>", all.iter().map(tile).collect::<String>())?;
                }
                Block::Contacts { columns, cells } => {
                    writeln!(page, "<div style=\"display:grid;grid-template-columns:repeat({columns},auto);gap:12px\">")?;
                    for (picture, label, facts) in cells {
                        let (label, facts) = (escaped(label), escaped(facts));
                        let image = embedded(picture, &label)?;
                        writeln!(page, "<figure>{image}<figcaption>{label}<br><small>{facts}</small></figcaption></figure>")?;
                    }
                    writeln!(page, "</div>")?;
                }
            }
        }
        writeln!(page, "<footer>diopter {}</footer>\n</body>\n</html>", env!("CARGO_PKG_VERSION"))?;
        Ok(page)
    }

    /// On paper.
    pub fn pdf(&self) -> anyhow::Result<Vec<u8>> {
        let [short, long] = A4;
        let mut sheet = Sheet {
            paper: Paper::new()?,
            size: if self.wide { [long, short] } else { [short, long] },
            y: 0.0,
            number: 0,
            title: self.title.clone(),
        };
        sheet.turn();
        if !self.title.is_empty() {
            sheet.lines(&self.title, Ink { of: Type::Bold, size: TITLE, color: INK });
            sheet.y += 0.5 * GAP;
        }
        for (k, block) in self.blocks.iter().enumerate() {
            sheet.block(block, self.blocks.get(k + 1))?;
        }
        sheet.paper.finish(&self.title)
    }
}

/// A picture within a page.
fn embedded(picture: &Picture, name: &str) -> anyhow::Result<String> {
    let mut bytes = Vec::new();
    png::write(picture, png::Depth::Eight, &mut bytes)?;
    let (width, height) = (picture.pixels.width, picture.pixels.height);
    let data = STANDARD.encode(&bytes);
    Ok(format!("<img src=\"data:image/png;base64,{data}\" width=\"{width}\" height=\"{height}\" alt=\"{name}\">"))
}

/// Bars of fractions.
fn bars(all: &[(String, f64)]) -> String {
    let bar = |(name, fraction): &(String, f64)| {
        format!(
            "<div class=\"bar\"><span>{}</span><i{} style=\"width:{:.1}%\"></i><b>{:.1} %</b></div>\n",
            escaped(name),
            if *fraction < 0.0 { " class=\"less\"" } else { "" },
            (50.0 * fraction.abs()).min(50.0),
            100.0 * fraction
        )
    };
    all.iter().map(bar).collect()
}

/// Sheets of paper that are filled from the top.
struct Sheet {
    paper: Paper,
    size: [f64; 2],
    /// How far the sheet is filled, points from its top.
    y: f64,
    number: usize,
    title: String,
}

impl Sheet {
    fn room(&self) -> f64 {
        self.size[0] - 2.0 * MARGIN
    }

    fn bottom(&self) -> f64 {
        self.size[1] - MARGIN
    }

    /// Begins a sheet.
    fn turn(&mut self) {
        self.paper.page(self.size);
        self.number += 1;
        self.y = MARGIN;
        let ink = Ink { of: Type::Sans, size: 7.0, color: PALE };
        let foot = format!("{}   {}   diopter {}", self.title, self.number, env!("CARGO_PKG_VERSION"));
        let foot = self.shortened(&foot, ink, self.room());
        let x = 0.5 * (self.size[0] - self.paper.width(&foot, ink));
        self.paper.text([x, self.size[1] - 0.5 * MARGIN], &foot, ink);
    }

    /// Begins a sheet where less than a height is left of this one, unless it is empty.
    fn need(&mut self, height: f64) {
        if self.y + height > self.bottom() && self.y > MARGIN {
            self.turn();
        }
    }

    /// As much of a line as fits a width.
    fn shortened(&self, text: &str, ink: Ink, width: f64) -> String {
        if self.paper.width(text, ink) <= width {
            return text.to_owned();
        }
        let mut kept: Vec<char> = text.chars().collect();
        while !kept.is_empty() {
            kept.pop();
            let with_dots: String = kept.iter().chain(['…'].iter()).collect();
            if self.paper.width(&with_dots, ink) <= width {
                return with_dots;
            }
        }
        String::new()
    }

    /// Text in lines that fit; words longer than a line are broken.
    fn wrapped(&self, text: &str, ink: Ink, width: f64) -> Vec<String> {
        let mut lines = Vec::new();
        for line in text.lines() {
            let mut now = String::new();
            for word in line.split_whitespace() {
                let longer = if now.is_empty() { word.to_owned() } else { format!("{now} {word}") };
                if self.paper.width(&longer, ink) <= width {
                    now = longer;
                    continue;
                }
                if !now.is_empty() {
                    lines.push(std::mem::take(&mut now));
                }
                for c in word.chars() {
                    now.push(c);
                    if self.paper.width(&now, ink) > width && now.chars().count() > 1 {
                        now.pop();
                        lines.push(std::mem::replace(&mut now, c.to_string()));
                    }
                }
            }
            lines.push(now);
        }
        lines
    }

    /// Running text over the width of the sheet.
    fn lines(&mut self, text: &str, ink: Ink) {
        for line in self.wrapped(text, ink, self.room()) {
            let step = ink.size * LEADING;
            self.need(step);
            self.y += step;
            self.paper.text([MARGIN, self.y - 0.3 * ink.size], &line, ink);
        }
    }

    /// Height of what must stand below a heading or a picture on the same sheet.
    fn height_of(&self, block: Option<&Block>) -> f64 {
        let row = TEXT * LEADING;
        match block {
            Some(Block::Figures(all)) => all.first().map_or(0.0, |f| f.height * self.scale_of(f, 1)),
            Some(Block::Picture { picture, .. }) => self.picture_size(picture)[1],
            Some(Block::Contacts { columns, cells }) => self.contact_height(*columns, cells.first()),
            Some(Block::Small(text)) => {
                let ink = Ink { of: Type::Sans, size: SMALL, color: PALE };
                self.wrapped(text, ink, self.room()).len() as f64 * SMALL * LEADING
            }
            Some(Block::Chapter(_)) | None => 0.0,
            Some(_) => 3.0 * row,
        }
    }

    fn block(&mut self, block: &Block, next: Option<&Block>) -> anyhow::Result<()> {
        match block {
            Block::Chapter(text) => {
                if self.y > MARGIN {
                    self.turn();
                }
                self.paper.mark(text, self.y);
                self.lines(text, Ink { of: Type::Bold, size: TITLE, color: INK });
                self.y += 0.5 * GAP;
            }
            Block::Heading(text) => {
                let ink = Ink { of: Type::Bold, size: HEADING, color: INK };
                // A heading stays with what it heads.
                let below = self.height_of(next);
                self.need(GAP + HEADING * LEADING + below);
                self.y += GAP;
                self.paper.mark(text, self.y);
                self.lines(text, ink);
                self.y += 0.5 * GAP;
            }
            Block::Paragraph(text) => {
                self.lines(text, Ink { of: Type::Sans, size: TEXT, color: INK });
                self.y += 0.5 * GAP;
            }
            Block::Small(text) => {
                self.lines(text, Ink { of: Type::Sans, size: SMALL, color: PALE });
                self.y += 0.5 * GAP;
            }
            Block::Fixed(text) => self.fixed(text),
            Block::Rows { rows, head } => self.rows(rows, *head),
            Block::Figures(all) => self.figures(all),
            Block::Picture { picture, marked } => {
                let [w, h] = self.picture_size(picture);
                let caption = self.height_of(next.filter(|b| matches!(b, Block::Small(_))));
                self.need(h + 0.5 * GAP + caption);
                let at = [MARGIN, self.y];
                self.paper.picture(at, [w, h], picture)?;
                if let Some([x, y]) = marked {
                    let middle = [at[0] + x * w, at[1] + y * h];
                    self.paper.circle(middle, 8.0, 2.4, [255, 255, 255]);
                    self.paper.circle(middle, 8.0, 1.4, [230, 50, 50]);
                }
                self.y += h + 0.5 * GAP;
            }
            Block::Bars(all) => self.bars(all),
            Block::Tiles(all) => {
                let rows: Vec<Vec<String>> = all.iter().map(|t| t.to_vec()).collect();
                self.rows(&rows, false);
            }
            Block::Contacts { columns, cells } => self.contacts(*columns, cells)?,
        }
        Ok(())
    }

    /// Width and height of a picture on this paper.
    fn picture_size(&self, picture: &Picture) -> [f64; 2] {
        let [w, h] = [picture.pixels.width, picture.pixels.height].map(|n| n as f64);
        let scale = POINTS_A_PIXEL.min(self.room() / w).min(TALLEST * self.size[1] / h);
        [w * scale, h * scale]
    }

    fn scale_of(&self, figure: &Figure, beside: usize) -> f64 {
        let room = (self.room() - (beside - 1) as f64 * GAP) / beside as f64;
        (room / figure.width).min(TALLEST * self.size[1] / figure.height).min(1.0)
    }

    fn figures(&mut self, all: &[Figure]) {
        // Two beside each other where letters stay large enough to be read.
        let widest = all.iter().map(|f| f.width).fold(1.0, f64::max);
        let beside = if all.len() > 1 && widest < 1.3 * self.room() { 2 } else { 1 };
        for row in all.chunks(beside) {
            let height = row.iter().map(|f| f.height * self.scale_of(f, beside)).fold(0.0, f64::max);
            self.need(height);
            let step = (self.room() + GAP) / beside as f64;
            for (k, figure) in row.iter().enumerate() {
                self.paper.figure([MARGIN + k as f64 * step, self.y], self.scale_of(figure, beside), figure);
            }
            self.y += height + GAP;
        }
    }

    fn fixed(&mut self, text: &str) {
        let plain = Ink { of: Type::Mono, size: FIXED, color: INK };
        let widest = text.lines().map(|l| self.paper.width(l, plain)).fold(1.0, f64::max);
        let ink = Ink { size: (FIXED * self.room() / widest).clamp(LEAST_FIXED, FIXED), ..plain };
        let most = (self.room() / self.paper.width("0", ink)) as usize;
        for line in text.lines() {
            let letters: Vec<char> = line.chars().collect();
            let parts: Vec<&[char]> = if letters.is_empty() { vec![&[]] } else { letters.chunks(most.max(1)).collect() };
            for part in parts {
                let step = ink.size * LEADING;
                self.need(step);
                self.y += step;
                let part: String = part.iter().collect();
                self.paper.text([MARGIN, self.y - 0.3 * ink.size], part.trim_end(), ink);
            }
        }
        self.y += GAP;
    }

    fn rows(&mut self, rows: &[Vec<String>], head: bool) {
        let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
        let ink = |size: f64, first: bool| Ink { of: if first { Type::Bold } else { Type::Sans }, size, color: INK };
        let width_at = |sheet: &Sheet, size: f64, c: usize| {
            let each = rows.iter().enumerate().filter_map(|(i, r)| Some((i, r.get(c)?)));
            each.map(|(i, cell)| sheet.paper.width(cell, ink(size, head && i == 0))).fold(0.0, f64::max) + 8.0
        };
        let widths: Vec<f64> = (0..columns).map(|c| width_at(self, SMALL, c)).collect();
        let total: f64 = widths.iter().sum();
        let scale = (self.room() / total.max(1.0)).min(1.0);
        let size = (SMALL * scale).max(LEAST_FIXED);
        for (i, row) in rows.iter().enumerate() {
            let step = size * 1.5;
            self.need(step);
            self.y += step;
            let mut x = MARGIN;
            for (c, cell) in row.iter().enumerate() {
                let width = widths[c] * scale;
                let ink = ink(size, head && i == 0);
                let text = self.shortened(cell, ink, width);
                // The first column is names, the others are numbers.
                let left = if c == 0 { x } else { x + width - 4.0 * scale - self.paper.width(&text, ink) };
                self.paper.text([left, self.y - 0.4 * size], &text, ink);
                x += width;
            }
            let line = if head && i == 0 { PALE } else { [221, 221, 221] };
            self.paper.rectangle([MARGIN, self.y], [total * scale, 0.5], line);
        }
        self.y += GAP;
    }

    fn bars(&mut self, all: &[(String, f64)]) {
        let ink = Ink { of: Type::Sans, size: SMALL, color: INK };
        let names = all.iter().map(|(name, _)| self.paper.width(name, ink)).fold(0.0, f64::max) + GAP;
        let longest = self.room() - names - 50.0;
        for (name, fraction) in all {
            let step = SMALL * 1.5;
            self.need(step);
            self.paper.text([MARGIN, self.y + SMALL], name, ink);
            let width = longest * fraction.abs().min(1.0);
            let color = if *fraction < 0.0 { [204, 102, 34] } else { [68, 119, 170] };
            self.paper.rectangle([MARGIN + names, self.y + 1.0], [width, SMALL], color);
            self.paper.text([MARGIN + names + width + 4.0, self.y + SMALL], &format!("{:.1} %", 100.0 * fraction), ink);
            self.y += step;
        }
        self.y += GAP;
    }

    /// Width of a cell with so many beside it.
    fn contact_width(&self, columns: usize) -> f64 {
        (self.room() + GAP) / columns as f64 - GAP
    }

    fn contact_height(&self, columns: usize, cell: Option<&(Picture, String, String)>) -> f64 {
        let Some((picture, ..)) = cell else { return 0.0 };
        let [w, h] = [picture.pixels.width, picture.pixels.height].map(|n| n as f64);
        let scale = (self.contact_width(columns) / w).min(POINTS_A_PIXEL).min((self.size[1] - 2.0 * MARGIN - 60.0) / h);
        h * scale + 2.6 * SMALL * LEADING
    }

    fn contacts(&mut self, columns: usize, cells: &[(Picture, String, String)]) -> anyhow::Result<()> {
        let width = self.contact_width(columns);
        for row in cells.chunks(columns.max(1)) {
            let height = row.iter().map(|c| self.contact_height(columns, Some(c))).fold(0.0, f64::max);
            self.need(height);
            let text = 2.6 * SMALL * LEADING;
            for (k, cell) in row.iter().enumerate() {
                let x = MARGIN + k as f64 * (width + GAP);
                let (picture, label, facts) = cell;
                let tall = self.contact_height(columns, Some(cell)) - text;
                let [w, h] = [picture.pixels.width, picture.pixels.height].map(|n| n as f64);
                self.paper.picture([x, self.y], [tall * w / h, tall], picture)?;
                let below = self.y + height - text;
                let ink = Ink { of: Type::Bold, size: SMALL, color: INK };
                let label = self.shortened(label, ink, width);
                self.paper.text([x, below + SMALL * 1.2], &label, ink);
                let ink = Ink { of: Type::Sans, size: 6.5, color: PALE };
                let facts = self.shortened(facts, ink, width);
                self.paper.text([x, below + SMALL * 2.4], &facts, ink);
            }
            self.y += height + 0.5 * GAP;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
