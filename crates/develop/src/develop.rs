//! The order of the steps.
//!
//! A developer is asked for rows of the picture; each asks the step before for the part it needs (`Developer::finished` and what it calls, bottom
//! to top), so that neither time nor memory is spent on anything else, and pictures of any size fit.

use crate::light_field::{Decoder, DepthMap, LightField};
use crate::look::{Look, Until};
use crate::lut::Lut;
use crate::overview::Overview;
use crate::recipe::{Demosaic, Recipe, RecipeError};
use crate::region::{Planes, Region, inside};
use crate::steps::demosaic::{Demosaicer, Mosaic, false_color};
use crate::steps::{
    black_level, camera_matrix, defects, encode, exposure, highlights, lens, local, noise, resize, row_noise, sharpen, warp,
    white_balance,
};
use diopter_image::dng::opcode::{Action, Opcode, Warp};
use diopter_image::{Encoding, ExposureFacts, Picture, PictureSource, RawImage};
use diopter_light::color::RgbSpace;
use glam::Vec3;
use rayon::prelude::*;

/// The steps, in their order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Step {
    /// Numbers to fractions of saturation.
    BlackLevel,
    /// Offsets of rows taken off.
    RowNoise,
    /// Channels scaled so that white is even.
    WhiteBalance,
    /// Defective pixels corrected.
    Defects,
    /// Saturated channels clipped or guessed.
    Highlights,
    /// Pictures made of a light field.
    LightField,
    /// Missing colours filled in.
    Demosaic,
    /// Noise reduced.
    NoiseReduction,
    /// What the lens did, undone.
    LensCorrection,
    /// Camera channels to linear sRGB.
    CameraMatrix,
    /// Brightness.
    Exposure,
    /// Contrast of large areas.
    LocalTone,
    /// Light of the scene to light of a display.
    ToneCurve,
    /// Grading of codes.
    Grade,
    /// A look from a table.
    Lut,
    /// Sharpening.
    Sharpen,
    /// Size.
    Resize,
    /// Codes in a space.
    Encode,
}

impl Step {
    /// All steps.
    pub const ALL: [Step; 18] = [
        Step::BlackLevel,
        Step::RowNoise,
        Step::WhiteBalance,
        Step::Defects,
        Step::Highlights,
        Step::LightField,
        Step::Demosaic,
        Step::NoiseReduction,
        Step::LensCorrection,
        Step::CameraMatrix,
        Step::Exposure,
        Step::LocalTone,
        Step::ToneCurve,
        Step::Grade,
        Step::Lut,
        Step::Sharpen,
        Step::Resize,
        Step::Encode,
    ];

    /// Its name in files: `black-level` ...
    pub fn name(self) -> &'static str {
        match self {
            Step::BlackLevel => "black-level",
            Step::RowNoise => "row-noise",
            Step::WhiteBalance => "white-balance",
            Step::Defects => "defects",
            Step::Highlights => "highlights",
            Step::LightField => "light-field",
            Step::Demosaic => "demosaic",
            Step::NoiseReduction => "noise-reduction",
            Step::LensCorrection => "lens-correction",
            Step::CameraMatrix => "camera-matrix",
            Step::Exposure => "exposure",
            Step::LocalTone => "local-tone",
            Step::ToneCurve => "tone-curve",
            Step::Grade => "grade",
            Step::Lut => "lut",
            Step::Sharpen => "sharpen",
            Step::Resize => "resize",
            Step::Encode => "encode",
        }
    }
}

/// Pixels of a tile of the picture, where nothing looks far around.
const TILE: [usize; 2] = [512, 64];
/// Where noise reduction looks far around.
const LARGE_TILE: [usize; 2] = [512, 256];

/// A raw image and a recipe, made ready to hand out the picture.
pub struct Developer<'a> {
    raw: &'a RawImage,
    facts: ExposureFacts,
    recipe: &'a Recipe,
    until: Step,
    /// Factor of each channel.
    gains: Vec<f32>,
    rows: Vec<f32>,
    neighbours: Option<defects::Neighbours>,
    cast: Option<highlights::Cast>,
    demosaicer: Demosaicer,
    /// A light field of which a picture is made, and that picture. Made before any tile: workers of a pool must not wait for one of them.
    light_field: Option<(LightField, Planes)>,
    reducer: Option<noise::Reducer>,
    /// Corrections of pixels that the file asks for: before its warp, and behind it.
    file_corrections: [&'a [Opcode]; 2],
    /// The warp that the file asks for.
    warp: Option<&'a Warp>,
    correction: Option<lens::Correction>,
    srgb_of_channel: Vec<Vec3>,
    exposure: f32,
    local: Option<local::LocalTone>,
    look: Look,
    /// Demosaiced pixels: all, and those that are shown.
    size: [usize; 2],
    frame: Region,
    /// Picture before it is turned.
    resized: [usize; 2],
    encoder: encode::Encoder,
}

/// Develops a raw image. `lut`: what the recipe's `lut.file` holds, if anything. Fails when the recipe asks for what the file cannot give.
pub fn develop(raw: &RawImage, recipe: &Recipe, lut: Option<Lut>) -> Result<Picture, RecipeError> {
    Ok(Developer::new(raw, recipe, lut)?.whole())
}

impl<'a> Developer<'a> {
    /// Prepares all steps. `lut`: what the recipe's `lut.file` holds, if anything. Fails on settings out of their ranges, and when the recipe asks for what the file cannot give (a light field, a lens
    /// profile, a white that no colour matrix leads to).
    pub fn new(raw: &'a RawImage, recipe: &'a Recipe, lut: Option<Lut>) -> Result<Self, RecipeError> {
        recipe.check()?;
        let (h, mosaic) = (&raw.header, &raw.mosaic);
        let overview = || Overview::new(raw);
        let neutral = white_balance::neutral(h, &recipe.white, &overview)?;
        // The channel that responds most keeps its scale.
        let gains: Vec<f32> = neutral.iter().map(|n| (1.0 / n.max(1e-3)) as f32).collect();
        let light_field = match recipe.light_field.wanted() {
            false => None,
            true => Some(LightField::of(h, [mosaic.width, mosaic.height])?.ok_or_else(|| RecipeError {
                place: "light_field".into(),
                found: "a picture of a file that holds no light field".into(),
                expected: "a raw file taken here with a microlens array (--plenoptic)".into(),
            })?),
        };
        if let Some(field) = &light_field {
            field.check(&recipe.light_field, h.facts.f_number)?;
        }
        // A picture of a light field has all channels in every pixel, without any being guessed.
        let method = if light_field.is_some() { Demosaic::Half } else { recipe.demosaic.method };
        let demosaicer = Demosaicer::new(method, &h.cfa);
        let srgb_of_channel = camera_matrix::to_srgb(h, &neutral);
        let exposure = exposure::gain(recipe.exposure.ev, h.baseline_ev);
        let light = |signal: &[f32]| {
            let balanced = signal.iter().zip(&gains).map(|(s, g)| (s * g).min(1.0));
            balanced.zip(&srgb_of_channel).map(|(s, c)| *c * s).sum::<Vec3>() * exposure
        };
        let mut profile = h.facts.lens_profile.clone();
        if let (Some(field), Some(profile)) = (&light_field, &mut profile) {
            // Its picture is a little smaller than the film.
            let scale = field.film_over_picture() as f32;
            (profile.reach, profile.scale) = (profile.reach * scale, profile.scale * scale);
        }
        let correction = lens::Correction::new(profile.as_ref(), &recipe.lens, h.cfa.filters());
        if correction.is_none() && recipe.lens != Default::default() {
            return Err(unknown_lens());
        }
        let (before, rest) = match light_field.is_some() {
            true => (&h.opcodes[..0], &h.opcodes[..0]),
            false => {
                let first = h.opcodes.iter().position(|o| matches!(o.action, Action::Warp(_)));
                h.opcodes.split_at(first.unwrap_or(h.opcodes.len()))
            }
        };
        let (warp, after) = match rest.split_first() {
            Some((Opcode { action: Action::Warp(warp), .. }, after)) => (Some(warp), after),
            _ => (None, rest),
        };
        let cell = if light_field.is_some() { [1, 1] } else { demosaicer.cell(&h.cfa) };
        let size = match &light_field {
            Some(field) => field.size(),
            None => [(mosaic.width / cell[0]).max(1), (mosaic.height / cell[1]).max(1)],
        };
        let frame = match h.framing.crop {
            Some([x, y, w, h]) if w >= cell[0] && h >= cell[1] && light_field.is_none() => {
                Region { left: (x / cell[0]) as i64, top: (y / cell[1]) as i64, width: w / cell[0], height: h / cell[1] }
            }
            _ => Region::whole(size[0], size[1]),
        };
        let swapped = |[w, h]: [usize; 2], swap: bool| if swap { [h, w] } else { [w, h] };
        let turned = h.framing.orientation.transposes();
        // Pixels that are not square become so, as the file says.
        let scale = h.framing.scale;
        let scaled = |n: usize, scale: f64| ((n as f64 * scale).round() as usize).max(1);
        let shown = swapped([scaled(frame.width, scale[0]), scaled(frame.height, scale[1])], turned);
        let resized = swapped(resize::target(shown, &recipe.resize), turned);
        let developer = Developer {
            raw,
            facts: ExposureFacts {
                white: white_balance::name_of(&recipe.white, &h.facts.white),
                ..match &light_field {
                    Some(field) => field.facts_of(&h.facts, &recipe.light_field),
                    None => h.facts.clone(),
                }
            },
            recipe,
            until: Step::Encode,
            rows: row_noise::offsets(raw, recipe.row_noise.amount),
            neighbours: (recipe.defects.threshold > 0.0).then(|| defects::Neighbours::new(&h.cfa)),
            cast: (recipe.highlights.method == crate::HighlightMethod::Recover).then(|| highlights::cast(raw, &gains)).flatten(),
            reducer: noise::Reducer::new(&recipe.noise, raw, &gains, &demosaicer).map(|r| match &light_field {
                // Its pixels are means of many.
                Some(field) => r.with_noise_of(field.samples_a_pixel(&recipe.light_field, h.facts.f_number) as f32),
                None => r,
            }),
            file_corrections: [before, after],
            warp,
            correction,
            local: local::LocalTone::new(&recipe.local, overview, light),
            look: Look::new(recipe, lut),
            encoder: encode::Encoder::new(&recipe.output),
            gains,
            demosaicer,
            light_field: None,
            srgb_of_channel,
            exposure,
            size,
            frame,
            resized,
        };
        Ok(match light_field {
            Some(field) => developer.with_light_field(field),
            None => developer,
        })
    }

    /// With the picture of a light field made, as far as the steps go.
    fn with_light_field(mut self, field: LightField) -> Self {
        let mosaic = self.mosaic(Region::whole(self.raw.mosaic.width, self.raw.mosaic.height));
        let f_number = self.raw.header.facts.f_number;
        let settings = match self.until < Step::LightField {
            // The middle of each lens's image.
            true => crate::recipe::LightField { view: Some([0.0; 2]), ..Default::default() },
            false => self.recipe.light_field.clone(),
        };
        let decoder = Decoder { field: &field, mosaic };
        let picture = decoder.picture(&settings, f_number).unwrap_or_else(|e| unreachable!("settings were checked: {e}"));
        self.light_field = Some((field, picture));
        self
    }

    /// The same picture after only the steps up to one: camera channels and light are shown by the sRGB function. Before a picture was made
    /// of it, of a light field the middle of each microlens's image is shown.
    pub fn until(mut self, step: Step) -> Self {
        self.until = step;
        match self.light_field.take() {
            Some((field, _)) => self.with_light_field(field),
            None => self,
        }
    }

    /// The geometry of a light field of which a picture is made.
    pub fn light_field(&self) -> Option<&LightField> {
        self.light_field.as_ref().map(|f| &f.0)
    }

    /// Depth from the light field of which a picture is made, before it is turned or resized; `None` of other files.
    pub fn depth(&self) -> Option<DepthMap> {
        let (field, _) = self.light_field.as_ref()?;
        Some(Decoder { field, mosaic: self.mosaic(Region::whole(self.raw.mosaic.width, self.raw.mosaic.height)) }.depth())
    }

    /// Pixels of the mosaic a side of a pixel of the picture.
    fn pixels_a_side(&self) -> [f32; 2] {
        match &self.light_field {
            Some((field, _)) => {
                let [w, h] = field.size();
                [self.raw.mosaic.width as f32 / w as f32, self.raw.mosaic.height as f32 / h as f32]
            }
            None => self.demosaicer.cell(&self.raw.header.cfa).map(|n| n as f32),
        }
    }

    /// Whether a step does anything with this recipe and file.
    pub fn does(&self, step: Step) -> bool {
        match step {
            Step::RowNoise => !self.rows.is_empty(),
            Step::Defects => self.neighbours.is_some(),
            Step::Highlights => self.cast.is_some() || self.recipe.highlights.method == crate::HighlightMethod::Clip,
            Step::LightField => self.light_field.is_some(),
            Step::Demosaic => {
                let cfa = &self.raw.header.cfa;
                !cfa.is_monochrome() && !cfa.has_all_channels() && self.light_field.is_none()
            }
            Step::NoiseReduction => self.reducer.is_some(),
            Step::LensCorrection => self.correction.is_some() || self.warp.is_some(),
            Step::LocalTone => self.local.is_some(),
            Step::Grade => self.recipe.grade != Default::default(),
            Step::Lut => !self.recipe.lut.file.is_empty(),
            Step::Sharpen => self.recipe.sharpen.amount > 0.0,
            Step::Resize => self.resized != [self.frame.width, self.frame.height],
            _ => true,
        }
    }

    /// Black level to highlights: a part of the mosaic with all its edges.
    fn mosaic(&self, region: Region) -> Mosaic<'_> {
        let cfa = &self.raw.header.cfa;
        let repair = self.neighbours.as_ref().filter(|_| self.until >= Step::Defects);
        let recover = highlights::reach(cfa);
        let around = region.grown(recover + repair.map_or(0, |n| n.reach()));
        let even = vec![1.0; self.gains.len()];
        let gains = if self.until >= Step::WhiteBalance { &self.gains } else { &even };
        let rows: &[f32] = if self.until >= Step::RowNoise { &self.rows } else { &[] };
        let mut data = black_level::take(self.raw, around, gains, rows);
        if let Some(neighbours) = repair {
            let deviation = |channel: usize, v: f32| self.deviation(channel, v);
            let threshold = self.recipe.defects.threshold as f32;
            data = neighbours.corrected(&data, around.width, [around.left, around.top], cfa, threshold, deviation);
        }
        if self.until >= Step::Highlights {
            highlights::apply(&mut data, around, cfa, gains, self.recipe.highlights.method, self.cast.as_ref());
        }
        let data = if around == region { data } else { crate::region::cut(&data, around, region) };
        Mosaic { region, data, cfa }
    }

    /// Noise of a balanced value.
    fn deviation(&self, channel: usize, v: f32) -> f32 {
        let gain = self.gains[channel];
        match self.raw.header.noise.get(channel) {
            Some([a, b]) => gain * (*a as f32 * (v / gain).max(0.0) + *b as f32).max(0.0).sqrt(),
            // A file that does not tell: shot noise of some ten thousand electrons, and a little more.
            None => gain * (1e-4 * (v / gain).max(0.0) + 1e-6).sqrt(),
        }
    }

    /// A part of the picture of a light field, edges repeated.
    fn refocused(&self, whole: &Planes, region: Region) -> Planes {
        let [w, h] = self.size;
        let mut planes = vec![Vec::with_capacity(region.area()); whole.planes.len()];
        for y in region.top..region.bottom() {
            let row = inside(y, h, 1) * w;
            for x in region.left..region.right() {
                let i = row + inside(x, w, 1);
                planes.iter_mut().zip(&whole.planes).for_each(|(to, from)| to.push(from[i]));
            }
        }
        Planes { region, planes }
    }

    fn demosaiced(&self, region: Region) -> Planes {
        if let Some((_, picture)) = &self.light_field {
            return self.refocused(picture, region);
        }
        let [cx, cy] = self.demosaicer.cell(&self.raw.header.cfa);
        // Each pass looks at the pixels around.
        let passes = if self.until >= Step::Demosaic { self.false_color_passes() } else { 0 };
        let region = region.grown(passes * false_color::REACH);
        let of_cells = Region {
            left: region.left * cx as i64,
            top: region.top * cy as i64,
            width: region.width * cx,
            height: region.height * cy,
        };
        let mosaic = self.mosaic(of_cells.grown(self.demosaicer.reach()));
        if self.until < Step::Demosaic && !mosaic.cfa.has_all_channels() {
            return mosaic_as_seen(&mosaic, of_cells, region);
        }
        let mut planes = self.demosaicer.run(&mosaic, region);
        if self.until >= Step::Demosaic {
            self.correct_pixels(&mut planes, self.file_corrections[0]);
        }
        if self.recipe.highlights.method == crate::HighlightMethod::Clip {
            planes.planes.iter_mut().for_each(|p| p.iter_mut().for_each(|v| *v = v.min(1.0)));
        }
        (0..passes).fold(planes, |planes, _| false_color::pass(&planes))
    }

    /// Passes against false colour: where red, green and blue are guessed pixel by pixel.
    fn false_color_passes(&self) -> usize {
        let cfa = &self.raw.header.cfa;
        let guessed = !cfa.has_all_channels() && cfa.channel_count() == 3 && self.demosaicer.cell(cfa) == [1, 1];
        if guessed { self.recipe.demosaic.false_color_passes.round() as usize } else { 0 }
    }

    fn denoised(&self, region: Region) -> Planes {
        match self.reducer.as_ref().filter(|_| self.until >= Step::NoiseReduction) {
            Some(reducer) => reducer.apply(self.demosaiced(region.grown(noise::REACH)), region),
            None => self.demosaiced(region),
        }
    }

    /// What the file asks for pixel by pixel. Its values are those before the white balance.
    fn correct_pixels(&self, planes: &mut Planes, opcodes: &[Opcode]) {
        if opcodes.is_empty() {
            return;
        }
        let (region, size) = (planes.region, self.raw.size());
        let cell = self.demosaicer.cell(&self.raw.header.cfa);
        let pixels = [cell[0] / self.raw.header.cfa.samples_per_pixel(), cell[1]];
        // The pixel of the file in the middle of one of the picture.
        let place = |i: i64, axis: usize| {
            (inside(i, self.size[axis], 1) * pixels[axis] + pixels[axis] / 2).min(size[axis].saturating_sub(1))
        };
        for (channel, plane) in planes.planes.iter_mut().enumerate() {
            let gain = self.gains[channel];
            for (row, line) in plane.chunks_exact_mut(region.width).enumerate() {
                let y = place(region.top + row as i64, 1);
                for (column, v) in line.iter_mut().enumerate() {
                    let at = [place(region.left + column as i64, 0), y];
                    *v = gain * opcodes.iter().fold(*v / gain, |v, opcode| opcode.value(size, channel, at, v));
                }
            }
        }
    }

    /// The warp of the file, and what it asks for behind it.
    fn warped(&self, region: Region) -> Planes {
        let Some(warp) = self.warp.filter(|_| self.until >= Step::LensCorrection) else { return self.denoised(region) };
        let from = self.denoised(warp::source(warp, region, self.size));
        let mut planes = warp::apply(warp, &from, region, self.size);
        self.correct_pixels(&mut planes, self.file_corrections[1]);
        planes
    }

    fn corrected(&self, region: Region) -> Planes {
        match self.correction.as_ref().filter(|_| self.until >= Step::LensCorrection) {
            Some(c) => c.apply(self.warped(c.source(region, self.size)), region, self.size),
            None => self.warped(region),
        }
    }

    /// Camera matrix to table: what changes each pixel by itself.
    fn coloured(&self, region: Region) -> Planes {
        let channels = self.corrected(region);
        if self.until < Step::CameraMatrix {
            return three(channels);
        }
        let mut rgb = camera_matrix::apply(&channels, &self.srgb_of_channel);
        let local = self.local.as_ref().filter(|_| self.until >= Step::LocalTone);
        let cell = self.pixels_a_side();
        let exposure = if self.until >= Step::Exposure { self.exposure } else { 1.0 };
        let part = match self.until {
            Step::ToneCurve => Some(Until::Tone),
            Step::Grade => Some(Until::Grade),
            step if step > Step::Grade => Some(Until::Lut),
            _ => None,
        };
        let [r, g, b] = &mut rgb.planes[..] else { return rgb };
        for row in 0..region.height {
            let line = row * region.width..(row + 1) * region.width;
            let y = (region.top + row as i64) as f32 * cell[1];
            let pixels = r[line.clone()].iter_mut().zip(&mut g[line.clone()]).zip(&mut b[line]);
            for (column, ((r, g), b)) in pixels.enumerate() {
                let mut c = Vec3::new(*r, *g, *b) * exposure;
                if let Some(local) = local {
                    c = local.apply(c, (region.left + column as i64) as f32 * cell[0], y);
                }
                if let Some(part) = part {
                    c = self.look.apply_until(c, part);
                }
                [*r, *g, *b] = c.to_array();
            }
        }
        rgb
    }

    fn sharpened(&self, region: Region) -> Planes {
        match sharpen::reach(&self.recipe.sharpen) {
            r if r > 0 && self.until >= Step::Sharpen => {
                sharpen::apply(self.coloured(region.grown(r)), region, &self.recipe.sharpen)
            }
            _ => self.coloured(region),
        }
    }

    /// In pixels of the picture before it is turned.
    fn resized(&self, region: Region) -> Planes {
        let shifted = |r: Region| Region { left: r.left + self.frame.left, top: r.top + self.frame.top, ..r };
        if !self.does(Step::Resize) {
            return Planes { region, ..self.sharpened(shifted(region)) };
        }
        let axes = [resize::Axis::new(self.frame.width, self.resized[0]), resize::Axis::new(self.frame.height, self.resized[1])];
        let from = resize::source(region, axes);
        let planes = Planes { region: from, ..self.sharpened(shifted(from)) };
        resize::apply(&planes, region, axes)
    }

    /// Turned upright and encoded: `[row][column][3]`.
    fn finished(&self, region: Region) -> Vec<f32> {
        let orientation = self.raw.header.framing.orientation;
        let [width, height] = self.size();
        let mirrors = orientation.mirrors();
        let mirrored =
            |first: i64, count: usize, n: usize, mirror: bool| if mirror { n as i64 - first - count as i64 } else { first };
        let left = mirrored(region.left, region.width, width, mirrors[0]);
        let top = mirrored(region.top, region.height, height, mirrors[1]);
        let stored = match orientation.transposes() {
            true => Region { left: top, top: left, width: region.height, height: region.width },
            false => Region { left, top, ..region },
        };
        let planes = self.resized(stored);
        let [r, g, b] = &planes.planes[..] else { unreachable!("pictures have three channels") };
        let mut out = Vec::with_capacity(region.area() * 3);
        for row in 0..region.height {
            let y = if mirrors[1] { region.height - 1 - row } else { row };
            for column in 0..region.width {
                let x = if mirrors[0] { region.width - 1 - column } else { column };
                let i = if orientation.transposes() { x * stored.width + y } else { y * stored.width + x };
                let light = Vec3::new(r[i], g[i], b[i]);
                let code = if self.until == Step::Encode { self.encoder.apply(light) } else { encode::srgb_codes(light) };
                out.extend(code.to_array());
            }
        }
        out
    }
}

/// The error of a lens correction without anything to correct by.
pub fn unknown_lens() -> RecipeError {
    RecipeError {
        place: "lens".into(),
        found: "a correction of a file that does not say what its lens does".into(),
        expected: "a raw file taken here through a prescription (not an ideal lens, nor one with cylinders)".into(),
    }
}

/// A mosaic before it is demosaiced: each pixel in the colour of its filter.
fn mosaic_as_seen(mosaic: &Mosaic, cells: Region, region: Region) -> Planes {
    let data = crate::region::cut(&mosaic.data, mosaic.region, cells);
    let cfa = mosaic.cfa;
    let mut planes = vec![vec![0.0; region.area()]; 3];
    for row in 0..region.height {
        for column in 0..region.width {
            // Of a halved picture the first pixel of each cell.
            let (dx, dy) = (column * (cells.width / region.width), row * (cells.height / region.height));
            let (x, y) = (cells.left + dx as i64, cells.top + dy as i64);
            let filter = cfa.filters()[cfa.channel_beyond(x, y)];
            let v = data[dy * cells.width + dx];
            for (k, plane) in planes.iter_mut().enumerate() {
                let through = !filter.is_colored() || filter == diopter_image::raw::Filter::ALL[k];
                plane[row * region.width + column] = if through { v } else { 0.0 };
            }
        }
    }
    Planes { region, planes }
}

/// Camera channels as three: the first of each, or the only one.
fn three(mut channels: Planes) -> Planes {
    while channels.planes.len() < 3 {
        channels.planes.push(channels.planes[channels.planes.len() - 1].clone());
    }
    channels.planes.truncate(3);
    channels
}

impl PictureSource for Developer<'_> {
    fn size(&self) -> [usize; 2] {
        let [w, h] = self.resized;
        if self.raw.header.framing.orientation.transposes() { [h, w] } else { [w, h] }
    }

    fn space(&self) -> RgbSpace {
        if self.until == Step::Encode { encode::space(self.recipe.output.space) } else { RgbSpace::Srgb }
    }

    fn encoding(&self) -> Encoding {
        if self.until == Step::Encode { self.recipe.output.encoding } else { Encoding::Srgb }
    }

    fn facts(&self) -> Option<&ExposureFacts> {
        Some(&self.facts)
    }

    fn rows(&self, first: usize, count: usize) -> Vec<f32> {
        let width = self.size()[0];
        let tile = self.tile()[0];
        let parts: Vec<(usize, Vec<f32>)> = (0..width.div_ceil(tile))
            .into_par_iter()
            .map(|k| {
                let w = tile.min(width - k * tile);
                (w, self.finished(Region { left: (k * tile) as i64, top: first as i64, width: w, height: count }))
            })
            .collect();
        if let [(_, only)] = &parts[..] {
            return only.clone();
        }
        let mut out = Vec::with_capacity(width * count * 3);
        for row in 0..count {
            parts.iter().for_each(|(w, part)| out.extend_from_slice(&part[row * w * 3..(row + 1) * w * 3]));
        }
        out
    }

    fn rows_at_once(&self) -> usize {
        self.tile()[1]
    }
}

impl Developer<'_> {
    /// Size of the tiles of the picture: smaller where one of its pixels is made of many.
    fn tile(&self) -> [usize; 2] {
        let [w, h] = if self.reducer.is_some() { LARGE_TILE } else { TILE };
        let shrink =
            (self.frame.width as f64 / self.resized[0] as f64).max(self.frame.height as f64 / self.resized[1] as f64).max(1.0);
        // JPEG is written in blocks of 8 rows.
        [((w as f64 / shrink) as usize).max(8), ((h as f64 / shrink) as usize / 8 * 8).max(8)]
    }
}

#[cfg(test)]
mod tests;
