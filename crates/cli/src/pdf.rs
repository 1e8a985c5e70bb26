//! Pages as PDF (ISO 32000-1): what a [`crate::document::Document`] is put on paper with. Text in DejaVu, cut down to the letters that are used, with what
//! they stand for, so that it can be searched and copied; drawings as paths; pictures in their own colours, by their ICC profile.
//!
//! Places are in points from the upper left corner of a page, as in [`Figure`]. Nothing depends on the clock: the same pages are the same file.

use ab_glyph::{Font, FontRef, GlyphId};
use anyhow::{Context, anyhow};
use diopter::image::{Picture, icc, jpeg};
use diopter::lens::draw::{Anchor, Color, Figure, Item};
use miniz_oxide::deflate::compress_to_vec_zlib;
use pdf_writer::types::{CidFontType, FontFlags, SystemInfo, UnicodeCmap};
use pdf_writer::writers::Resources;
use pdf_writer::{Content, Filter, Finish, Name, Pdf, Rect, Ref, Str, TextStr};
use std::collections::BTreeMap;
use subsetter::GlyphRemapper;

/// A4, points.
pub const A4: [f64; 2] = [595.28, 841.89];
/// Effort of the compression, of 10.
const EFFORT: u8 = 7;
/// Quality of pictures that are stored with losses, and by how much they must be smaller so.
const JPEG_QUALITY: u8 = 93;
const LOSSES_SAVE: usize = 3;
/// Identity-H numbers glyphs as the font does.
const SYSTEM: SystemInfo = SystemInfo { registry: Str(b"Adobe"), ordering: Str(b"Identity"), supplement: 0 };

/// Letters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Type {
    Sans,
    Bold,
    Mono,
}

const TYPES: [Type; 3] = [Type::Sans, Type::Bold, Type::Mono];

impl Type {
    fn name(self) -> (&'static str, &'static str) {
        match self {
            Type::Sans => ("F0", "DejaVuSans"),
            Type::Bold => ("F1", "DejaVuSans-Bold"),
            Type::Mono => ("F2", "DejaVuSansMono"),
        }
    }

    fn bytes(self) -> &'static [u8] {
        match self {
            Type::Sans => dejavu::sans::regular(),
            Type::Bold => dejavu::sans::bold(),
            Type::Mono => dejavu::sans_mono::regular(),
        }
    }
}

/// A font and those of its glyphs that are used.
struct Face {
    font: FontRef<'static>,
    /// Glyphs of the file, numbered from 0 as they are met.
    used: GlyphRemapper,
    /// What the new numbers stand for.
    letters: BTreeMap<u16, char>,
}

impl Face {
    fn new(of: Type) -> anyhow::Result<Face> {
        let font = FontRef::try_from_slice(of.bytes()).context("the embedded font")?;
        Ok(Face { font, used: GlyphRemapper::new(), letters: BTreeMap::new() })
    }

    /// Advance of a glyph, em.
    fn advance(&self, glyph: GlyphId) -> f64 {
        f64::from(self.font.h_advance_unscaled(glyph)) / f64::from(self.font.units_per_em().unwrap_or(2048.0))
    }

    fn width(&self, text: &str) -> f64 {
        text.chars().map(|c| self.advance(self.font.glyph_id(c))).sum()
    }

    /// Text as glyph numbers of the font that is embedded.
    fn codes(&mut self, text: &str) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(2 * text.len());
        for c in text.chars() {
            let new = self.used.remap(self.font.glyph_id(c).0);
            self.letters.entry(new).or_insert(c);
            bytes.extend(new.to_be_bytes());
        }
        bytes
    }
}

/// A line of text.
#[derive(Clone, Copy, Debug)]
pub struct Ink {
    pub of: Type,
    /// Points.
    pub size: f64,
    pub color: Color,
}

/// A document on its way to the file.
pub struct Paper {
    pdf: Pdf,
    next: Ref,
    tree: Ref,
    resources: Ref,
    faces: [Face; 3],
    /// Size of the page at hand.
    size: [f64; 2],
    content: Option<Content>,
    pages: Vec<Ref>,
    /// Title, page and distance from its lower edge.
    outline: Vec<(String, Ref, f32)>,
    images: Vec<(String, Ref)>,
    opacities: Vec<(String, Ref, f64)>,
    profiles: Vec<(Vec<u8>, Ref)>,
}

impl Paper {
    /// A document without pages.
    pub fn new() -> anyhow::Result<Paper> {
        let mut next = Ref::new(1);
        // The catalogue comes first.
        next.bump();
        let (tree, resources) = (next.bump(), next.bump());
        let faces = [Face::new(TYPES[0])?, Face::new(TYPES[1])?, Face::new(TYPES[2])?];
        let (pages, outline, images, opacities, profiles) = (vec![], vec![], vec![], vec![], vec![]);
        let (pdf, content) = (Pdf::new(), None);
        Ok(Paper { pdf, next, tree, resources, faces, size: A4, content, pages, outline, images, opacities, profiles })
    }

    /// Begins a page of a size, points.
    pub fn page(&mut self, size: [f64; 2]) {
        self.end_page();
        self.size = size;
        self.content = Some(Content::new());
        let id = self.next.bump();
        self.pages.push(id);
    }

    fn end_page(&mut self) {
        let (Some(content), Some(&id)) = (self.content.take(), self.pages.last()) else { return };
        let stream = self.next.bump();
        let bytes = compress_to_vec_zlib(content.finish().as_slice(), EFFORT);
        self.pdf.stream(stream, &bytes).filter(Filter::FlateDecode);
        let mut page = self.pdf.page(id);
        page.media_box(Rect::new(0.0, 0.0, self.size[0] as f32, self.size[1] as f32)).parent(self.tree).contents(stream);
        page.pair(Name(b"Resources"), self.resources);
    }

    fn content(&mut self) -> &mut Content {
        if self.content.is_none() {
            self.page(self.size);
        }
        self.content.get_or_insert_with(Content::new)
    }

    /// From the lower edge.
    fn up(&self, y: f64) -> f32 {
        (self.size[1] - y) as f32
    }

    /// An entry of the table of contents that leads to a height of this page.
    pub fn mark(&mut self, title: &str, y: f64) {
        self.content();
        let up = self.up(y);
        if let Some(page) = self.pages.last() {
            self.outline.push((title.to_owned(), *page, up));
        }
    }

    /// Width of a line of text, points.
    pub fn width(&self, text: &str, ink: Ink) -> f64 {
        self.faces[ink.of as usize].width(text) * ink.size
    }

    /// Writes a line from a place on the baseline.
    pub fn text(&mut self, [x, y]: [f64; 2], text: &str, ink: Ink) {
        let at = [1.0, 0.0, 0.0, 1.0, x as f32, self.up(y)];
        self.set(at, text, ink);
    }

    fn set(&mut self, matrix: [f32; 6], text: &str, ink: Ink) {
        let codes = self.faces[ink.of as usize].codes(text);
        let [r, g, b] = ink.color.map(|v| f32::from(v) / 255.0);
        let name = ink.of.name().0;
        let content = self.content();
        content.begin_text().set_font(Name(name.as_bytes()), ink.size as f32).set_fill_rgb(r, g, b);
        content.set_text_matrix(matrix).show(Str(&codes)).end_text();
    }

    /// A filled rectangle: corner, width and height.
    pub fn rectangle(&mut self, [x, y]: [f64; 2], [w, h]: [f64; 2], color: Color) {
        let [r, g, b] = color.map(|v| f32::from(v) / 255.0);
        let bottom = self.up(y + h);
        self.content().set_fill_rgb(r, g, b).rect(x as f32, bottom, w as f32, h as f32).fill_nonzero();
    }

    /// A circle: middle, radius and width of the line.
    pub fn circle(&mut self, [x, y]: [f64; 2], radius: f64, width: f64, color: Color) {
        let [r, g, b] = color.map(|v| f32::from(v) / 255.0);
        let y = self.up(y);
        let content = self.content();
        content.set_stroke_rgb(r, g, b).set_line_width(width as f32);
        disk(content, [x as f32, y], radius as f32);
        content.stroke();
    }

    /// A drawing with its corner at a place, `scale` times as large as it says.
    pub fn figure(&mut self, [x, y]: [f64; 2], scale: f64, figure: &Figure) {
        let top = self.up(y);
        self.content().save_state().transform([scale as f32, 0.0, 0.0, -scale as f32, x as f32, top]);
        let rgb = |c: Color| c.map(|v| f32::from(v) / 255.0);
        for item in &figure.items {
            match item {
                Item::Path { points, color, width, dash, fill } => {
                    let alpha = fill.map(|(_, opacity)| opacity).filter(|o| *o < 1.0).map(|o| self.opacity(o));
                    let content = self.content();
                    content.save_state();
                    if let Some(name) = &alpha {
                        content.set_parameters(Name(name.as_bytes()));
                    }
                    if let Some((c, _)) = fill {
                        let [r, g, b] = rgb(*c);
                        content.set_fill_rgb(r, g, b);
                    }
                    let [r, g, b] = rgb(*color);
                    content.set_stroke_rgb(r, g, b).set_line_width(*width as f32);
                    content.set_line_join(pdf_writer::types::LineJoinStyle::RoundJoin);
                    if *dash > 0.0 {
                        content.set_dash_pattern([*dash as f32; 2], 0.0);
                    }
                    for (i, p) in points.iter().enumerate() {
                        let (px, py) = (p.x as f32, p.y as f32);
                        if i == 0 {
                            content.move_to(px, py)
                        } else {
                            content.line_to(px, py)
                        };
                    }
                    match (fill.is_some(), *width > 0.0) {
                        (true, true) => content.fill_nonzero_and_stroke(),
                        (true, false) => content.fill_nonzero(),
                        (false, true) => content.stroke(),
                        (false, false) => content.end_path(),
                    };
                    content.restore_state();
                }
                Item::Dot { at, radius, color } => {
                    let [r, g, b] = rgb(*color);
                    let content = self.content();
                    content.set_fill_rgb(r, g, b);
                    disk(content, [at.x as f32, at.y as f32], *radius as f32);
                    content.fill_nonzero();
                }
                Item::Text { at, text, size, anchor, upwards, color } => {
                    let ink = Ink { of: Type::Sans, size: *size, color: *color };
                    let back = match anchor {
                        Anchor::Start => 0.0,
                        Anchor::Middle => 0.5,
                        Anchor::End => 1.0,
                    } * self.width(text, ink);
                    let (px, py) = (at.x as f32, at.y as f32);
                    // The drawing's y runs downwards: letters are turned back.
                    let matrix = match upwards {
                        false => [1.0, 0.0, 0.0, -1.0, px - back as f32, py],
                        true => [0.0, -1.0, -1.0, 0.0, px, py + back as f32],
                    };
                    self.set(matrix, text, ink);
                }
            }
        }
        self.content().restore_state();
    }

    fn opacity(&mut self, opacity: f64) -> String {
        if let Some((name, ..)) = self.opacities.iter().find(|o| (o.2 - opacity).abs() < 1e-6) {
            return name.clone();
        }
        let (name, id) = (format!("G{}", self.opacities.len()), self.next.bump());
        self.pdf.ext_graphics(id).non_stroking_alpha(opacity as f32);
        self.opacities.push((name.clone(), id, opacity));
        name
    }

    /// A picture with its corner at a place, in a width and height.
    pub fn picture(&mut self, [x, y]: [f64; 2], [w, h]: [f64; 2], picture: &Picture) -> anyhow::Result<()> {
        let (width, height) = (picture.pixels.width, picture.pixels.height);
        let side = |n: usize| i32::try_from(n).map_err(|_| anyhow!("a picture of {n} pixels a side"));
        let plain = compress_to_vec_zlib(&picture.to_8_bit(), EFFORT);
        let mut lossy = Vec::new();
        jpeg::write(&Picture { facts: None, ..picture.clone() }, JPEG_QUALITY, &mut lossy)?;
        let (bytes, filter) = match LOSSES_SAVE * lossy.len() < plain.len() {
            true => (lossy, Filter::DctDecode),
            false => (plain, Filter::FlateDecode),
        };
        let profile = self.profile(picture)?;
        let (name, id) = (format!("I{}", self.images.len()), self.next.bump());
        let mut image = self.pdf.image_xobject(id, &bytes);
        image.width(side(width)?).height(side(height)?).bits_per_component(8);
        image.filter(filter);
        image.color_space().icc_based(profile);
        image.finish();
        let bottom = self.up(y + h);
        let content = self.content();
        content.save_state().transform([w as f32, 0.0, 0.0, h as f32, x as f32, bottom]);
        content.x_object(Name(name.as_bytes())).restore_state();
        self.images.push((name, id));
        Ok(())
    }

    /// The profile of a picture's colours, written once.
    fn profile(&mut self, picture: &Picture) -> anyhow::Result<Ref> {
        let bytes = icc::profile(picture.space, picture.encoding)?;
        if let Some((_, id)) = self.profiles.iter().find(|p| p.0 == bytes) {
            return Ok(*id);
        }
        let id = self.next.bump();
        let packed = compress_to_vec_zlib(&bytes, EFFORT);
        let mut profile = self.pdf.icc_profile(id, &packed);
        profile.n(3);
        profile.filter(Filter::FlateDecode);
        profile.finish();
        self.profiles.push((bytes, id));
        Ok(id)
    }

    fn embed(&mut self, of: Type) -> anyhow::Result<Ref> {
        let [font, cid, descriptor, cmap, file] = [(); 5].map(|()| self.next.bump());
        let face = &self.faces[of as usize];
        let bytes = subsetter::subset(of.bytes(), 0, &face.used).map_err(|e| anyhow!("the embedded font: {e}"))?;
        // A tag of six letters tells fonts that are cut down (ISO 32000-1, 9.6.4).
        let base = format!("DIOPTR+{}", of.name().1);
        let base = Name(base.as_bytes());
        self.pdf.type0_font(font).base_font(base).encoding_predefined(Name(b"Identity-H")).descendant_font(cid).to_unicode(cmap);
        let mut c = self.pdf.cid_font(cid);
        c.subtype(CidFontType::Type2).base_font(base).system_info(SYSTEM).font_descriptor(descriptor).default_width(0.0);
        c.cid_to_gid_map_predefined(Name(b"Identity"));
        let widths: Vec<f32> = face.used.remapped_gids().map(|g| (1000.0 * face.advance(GlyphId(g))) as f32).collect();
        c.widths().consecutive(0, widths);
        c.finish();
        let em = f64::from(face.font.units_per_em().unwrap_or(2048.0));
        let per_mille = |v: f32| (1000.0 * f64::from(v) / em) as f32;
        let (ascent, descent) = (per_mille(face.font.ascent_unscaled()), per_mille(face.font.descent_unscaled()));
        let mut flags = FontFlags::SYMBOLIC;
        flags.set(FontFlags::FIXED_PITCH, of == Type::Mono);
        self.pdf
            .font_descriptor(descriptor)
            .name(base)
            .flags(flags)
            .bbox(Rect::new(-1021.0, descent.min(-463.0), 1793.0, ascent.max(1232.0)))
            .italic_angle(0.0)
            .ascent(ascent)
            .descent(descent)
            .cap_height(729.0)
            .stem_v(80.0)
            .font_file2(file);
        let mut map = UnicodeCmap::new(Name(b"Custom"), SYSTEM);
        face.letters.iter().for_each(|(glyph, letter)| map.pair(*glyph, *letter));
        self.pdf.cmap(cmap, map.finish().as_slice());
        let length = bytes.len() as i32;
        let packed = compress_to_vec_zlib(&bytes, EFFORT);
        let mut stream = self.pdf.stream(file, &packed);
        stream.filter(Filter::FlateDecode).pair(Name(b"Length1"), length);
        stream.finish();
        Ok(font)
    }

    /// The bytes of the file. Fails where a font cannot be cut down to the letters that are used.
    pub fn finish(mut self, title: &str) -> anyhow::Result<Vec<u8>> {
        self.content();
        self.end_page();
        let mut fonts = Vec::new();
        for of in TYPES {
            if !self.faces[of as usize].letters.is_empty() {
                fonts.push((of, self.embed(of)?));
            }
        }
        let mut resources = self.pdf.indirect(self.resources).start::<Resources>();
        let mut dict = resources.fonts();
        for (of, id) in &fonts {
            dict.pair(Name(of.name().0.as_bytes()), *id);
        }
        dict.finish();
        let mut dict = resources.x_objects();
        for (name, id) in &self.images {
            dict.pair(Name(name.as_bytes()), *id);
        }
        dict.finish();
        let mut dict = resources.ext_g_states();
        for (name, id, _) in &self.opacities {
            dict.pair(Name(name.as_bytes()), *id);
        }
        dict.finish();
        resources.finish();
        let outline = (!self.outline.is_empty()).then(|| self.next.bump());
        if let Some(root) = outline {
            let ids: Vec<Ref> = self.outline.iter().map(|_| self.next.bump()).collect();
            let last = ids.len() - 1;
            self.pdf.outline(root).first(ids[0]).last(ids[last]).count(ids.len() as i32);
            for (k, (title, page, up)) in self.outline.iter().enumerate() {
                let mut item = self.pdf.outline_item(ids[k]);
                item.title(TextStr(title)).parent(root);
                if k > 0 {
                    item.prev(ids[k - 1]);
                }
                if k < last {
                    item.next(ids[k + 1]);
                }
                item.dest().page(*page).xyz(0.0, *up, None);
            }
        }
        let info = self.next.bump();
        self.pdf.document_info(info).title(TextStr(title)).producer(TextStr(concat!("diopter ", env!("CARGO_PKG_VERSION"))));
        self.pdf.pages(self.tree).kids(self.pages.iter().copied()).count(self.pages.len() as i32);
        let mut catalog = self.pdf.catalog(Ref::new(1));
        catalog.pages(self.tree);
        if let Some(outline) = outline {
            catalog.outlines(outline);
        }
        catalog.finish();
        Ok(self.pdf.finish())
    }
}

/// The path of a circle: four cubic curves, off by less than 0.03 % of the radius.
fn disk(content: &mut Content, [x, y]: [f32; 2], r: f32) {
    const K: f32 = 0.552_284_75;
    content.move_to(x + r, y);
    for [a, b, c] in [
        [[1.0, K], [K, 1.0], [0.0, 1.0]],
        [[-K, 1.0], [-1.0, K], [-1.0, 0.0]],
        [[-1.0, -K], [-K, -1.0], [0.0, -1.0]],
        [[K, -1.0], [1.0, -K], [1.0, 0.0]],
    ] {
        let at = |p: [f32; 2]| (x + r * p[0], y + r * p[1]);
        let ((ax, ay), (bx, by), (cx, cy)) = (at(a), at(b), at(c));
        content.cubic_to(ax, ay, bx, by, cx, cy);
    }
    content.close_path();
}
