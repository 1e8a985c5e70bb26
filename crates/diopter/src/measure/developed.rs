//! What development makes of an edge: the edge that the chain predicts for the raw channels is developed by the same recipe and measured as the picture is.
//!
//! A raw image of the edge is made of the predicted response of each channel ([`Chain::response`], with its phase), at the levels that both sides have in the raw
//! file, in its place on the filter pattern, under the light that falls off across it, with the noise that the file says it has. It is developed again and again,
//! each time with one more step of the recipe; the response after a step over that before it is the factor of the step. Where the image has all channels at every pixel,
//! nothing is to be demosaiced: that is the first of them. Demosaicing and noise reduction adapt to what they see, tone curves bend, sharpening works on codes: their
//! factors hold for this edge, at this contrast, brightness and noise.
//!
//! Left out, and said in [`Developed::notes`]: what looks at the whole picture (local tone, automatic balances), corrections of the lens and of the file, which move
//! pixels by where they lie. Places of turned pictures, crops and light fields are not predicted at all.
//! Source of e-SFR of developed pictures: ISO 12233:2023; of products of factors of nonlinear steps there is none, hence the model.

use super::mtf::{Options, measure};
use super::predict::{Chain, largest_difference};
use super::{Channel, EdgeMtf, MeasureError, Measured, Region};
use diopter_develop::lut::Lut;
use diopter_develop::{Demosaic, Developer, Recipe};
use diopter_image::{Cfa, Picture, PictureSource, Raster, RawHeader, RawImage};
use glam::DVec2;
use rayon::prelude::*;
use serde::Serialize;
use std::f64::consts::TAU;

/// Pixels of the mosaic around the region that is measured: as far as noise reduction looks (62), and whole patterns.
const MARGIN: usize = 72;
/// Full scale of the raw image that is made.
const FULL: f64 = 65_535.0;
/// Its black level: noise goes below.
const BLACK: f64 = 4096.0;
/// Raw images with noise of their own that the response is the mean of.
const READINGS: u64 = 4;
/// Frequencies of the response, cycles a pixel: up to here, in these steps. Beyond, the pixel aperture leaves little.
const HIGHEST: f64 = 2.0;
const STEP: f64 = 0.01;
/// Steps between two of them: the edge spread function repeats after the reciprocal.
const FINER: usize = 4;
/// Places a pixel at which the edge spread function is computed, and distance from the edge, pixels, beyond which it is level.
const PLACES: f64 = 8.0;
const REACH_PX: f64 = 120.0;
/// Places from −[`REACH_PX`] to [`REACH_PX`] at which the light that the lens brings is computed.
const LIT: usize = 9;
/// Where both sides of an edge are level: fractions of the reach of the measurement.
const LEVEL: [f64; 2] = [0.6, 1.0];
/// Brightness at which linear steps are shown, EV: nothing is clipped.
const HELD_BACK_EV: f64 = -1.0;

/// How a raw file was developed.
pub struct Development<'a> {
    /// The raw file.
    pub raw: &'a RawImage,
    /// The recipe.
    pub recipe: &'a Recipe,
    /// What the recipe's `lut.file` holds.
    pub lut: Option<&'a Lut>,
    /// Columns and rows of the developed picture.
    pub size: [usize; 2],
}

/// A step of the development and the factor of its response.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StepFactor {
    /// What it does.
    pub name: &'static str,
    /// Response after it over that before, at the frequencies of the edge.
    pub factor: Vec<f64>,
}

/// The predicted response of an edge in a developed picture.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Developed {
    /// Cycles a pixel of the developed picture, across the edge.
    pub frequencies: Vec<f64>,
    /// Of the light on the sensor in the colours of the picture, nothing developed: the chain as this edge shows it in its window.
    pub raw: Vec<f64>,
    /// What the development does, in its order; steps that do nothing are left out.
    pub steps: Vec<StepFactor>,
    /// All of it.
    pub product: Vec<f64>,
    /// Largest difference of the measured response from it up to half a cycle a pixel, and where.
    pub largest_difference: [f64; 2],
    /// What is left out.
    pub notes: Vec<String>,
}

/// A developed picture as linear light, bands R, G, B in its own space, without limits of clipping.
pub fn measured(picture: &Picture) -> Measured {
    let luminance = picture.space.luminance_weights();
    let mut pixels = picture.pixels.clone();
    pixels.data.as_chunks_mut::<3>().0.iter_mut().for_each(|p| *p = picture.encoding.decode_pixel(*p, luminance));
    let bands = ["R", "G", "B"].map(str::to_owned).to_vec();
    Measured::Light { pixels, bands, limits: [f32::NEG_INFINITY, f32::INFINITY], clipped: None, facts: None }
}

impl Development<'_> {
    /// Pixels of the developed picture for one of the mosaic.
    fn scale(&self) -> f64 {
        self.size[0] as f64 / self.raw.size()[0] as f64
    }

    /// Fails where places of the picture are not those of the mosaic.
    fn check(&self) -> Result<(), MeasureError> {
        let header = &self.raw.header;
        let unfit = |found: &str, expected: &str| Err(MeasureError::unfit("prediction of a developed picture", found, expected));
        if self.recipe.light_field.wanted() || header.facts.light_field.is_some() {
            return unfit("a picture of a light field", "one of a camera without microlenses");
        }
        if header.framing != Default::default() {
            return unfit("a raw file that is cropped, turned or stretched", "one that is shown as its pixels lie");
        }
        if header.cfa.has_all_channels() {
            return unfit("a raw file without a mosaic", "one as a sensor reads it");
        }
        let [w, h] = self.raw.size().map(|n| n as f64 * self.scale());
        if (w - self.size[0] as f64).abs() > 1.0 || (h - self.size[1] as f64).abs() > 1.5 {
            return unfit(
                &format!(
                    "{} × {} pixels of a raw file of {} × {}",
                    self.size[0],
                    self.size[1],
                    self.raw.size()[0],
                    self.raw.size()[1]
                ),
                "the picture that was developed of the raw file, of the same shape",
            );
        }
        Ok(())
    }

    /// What the prediction leaves out.
    fn notes(&self) -> Vec<String> {
        let mut notes = vec![];
        let mut note = |text: &str| notes.push(text.to_owned());
        let r = self.recipe;
        if r.local != Default::default() {
            note("local tone looks at the whole picture: it is not predicted");
        }
        if r.lens != Default::default() {
            note("corrections of the lens resample the picture by where its pixels lie: they are not predicted");
        }
        if !self.raw.header.opcodes.is_empty() {
            note("corrections that the raw file asks for are not predicted");
        }
        if r.white.patch.is_some() || r.white.balance.trim().eq_ignore_ascii_case("auto") {
            note("the white balance looks at the whole picture: that of the camera (as-shot) stands in for it");
        }
        if r.noise.luminance > 0.0 || r.noise.color > 0.0 {
            note(
                "noise reduction adapts to contrast and noise: its factor is that of this edge; the renderer's own noise is not in it",
            );
        }
        notes
    }

    /// The recipes: nothing but colours, then one step more each time. The first is for an image without a mosaic.
    fn stages(&self) -> Vec<(&'static str, Recipe)> {
        let r = self.recipe;
        let mut white = r.white.clone();
        if white.patch.take().is_some() || white.balance.trim().eq_ignore_ascii_case("auto") {
            white.balance = Recipe::default().white.balance;
        }
        let mut linear = Recipe { white, highlights: r.highlights.clone(), demosaic: r.demosaic.clone(), ..Recipe::default() };
        linear.noise.luminance = 0.0;
        linear.noise.color = 0.0;
        linear.tone.curve = diopter_develop::Curve::Linear;
        linear.sharpen.amount = 0.0;
        linear.exposure.ev = HELD_BACK_EV;
        let demosaiced = Recipe { row_noise: r.row_noise.clone(), defects: r.defects.clone(), ..linear.clone() };
        let reduced = Recipe { noise: r.noise.clone(), ..demosaiced.clone() };
        let (exposure, tone, grade, lut) = (r.exposure.clone(), r.tone.clone(), r.grade.clone(), r.lut.clone());
        let toned = Recipe { exposure, tone, grade, lut, output: r.output.clone(), ..reduced.clone() };
        let sharpened = Recipe { sharpen: r.sharpen.clone(), ..toned.clone() };
        let resized = Recipe { resize: r.resize.clone(), ..sharpened.clone() };
        vec![
            ("", linear),
            ("demosaicing", demosaiced),
            ("noise reduction", reduced),
            ("tone and colour", toned),
            ("sharpening", sharpened),
            ("resizing", resized),
        ]
    }

    /// Levels of each channel on the dark and the light side of an edge, fractions of saturation.
    fn levels(&self, edge: &EdgeMtf) -> Result<Vec<[f64; 2]>, MeasureError> {
        let (scale, header) = (self.scale(), &self.raw.header);
        let reach = edge.esf.iter().map(|p| p[0].abs()).fold(0.0, f64::max);
        let (middle, across) = (DVec2::from_array(edge.middle), DVec2::from_array(edge.across));
        let n = header.cfa.channel_count();
        let mut sums = vec![[[0.0; 2]; 2]; n];
        let r = edge.region;
        let within = |at: usize, size: usize, all: usize| {
            let [from, to] = [at as f64 / scale, (at + size) as f64 / scale];
            (from.ceil() as usize)..(to.floor() as usize).min(all)
        };
        for row in within(r.y, r.height, self.raw.size()[1]) {
            for column in within(r.x, r.width, self.raw.size()[0]) {
                let place = DVec2::new(column as f64 + 0.5, row as f64 + 0.5) * scale;
                let distance = (place - middle).dot(across);
                if !(LEVEL[0] * reach..LEVEL[1] * reach).contains(&distance.abs()) {
                    continue;
                }
                let value = f64::from(self.raw.mosaic.pixel(column, row)[0]) - header.black_level;
                let sum = &mut sums[header.cfa.channel_at(column, row)][usize::from(distance > 0.0)];
                sum[0] += value / (header.white_level - header.black_level);
                sum[1] += 1.0;
            }
        }
        sums.iter()
            .map(|sides| match sides.iter().all(|s| s[1] > 0.0) {
                true => Ok(sides.map(|s| s[0] / s[1])),
                false => Err(MeasureError::unfit(
                    edge.region.to_string(),
                    "the raw file has no pixels of every channel on both sides of the edge",
                    "a longer edge",
                )),
            })
            .collect()
    }

    /// Predicts the response of an edge that was measured in a channel of the developed picture. `chain`: of the raw file's channels, its pixels those of the
    /// mosaic; `options`: how the edge was measured. Fails on light fields, on raw files that are framed or without a mosaic, on a picture of another shape than the raw
    /// file, on an edge too short for both its sides, and as [`Chain::predict`] and [`measure`].
    pub fn predict(&self, chain: &Chain, edge: &EdgeMtf, channel: Channel, options: &Options) -> Result<Developed, MeasureError> {
        self.check()?;
        let scale = self.scale();
        let in_raw = edge.middle.map(|v| v / scale);
        // Far from the edge, and reduced to the light at the edge.
        let reach = edge.esf.iter().map(|p| p[0].abs()).fold(0.0, f64::max);
        let places: Vec<f64> = (0..LIT).map(|k| REACH_PX * (2.0 * k as f64 / (LIT - 1) as f64 - 1.0)).collect();
        let light = chain.light_across(in_raw, edge.across, &places)?;
        let lit = [-1.0, 1.0].map(|side| light_at(&light, side * 0.5 * (LEVEL[0] + LEVEL[1]) * reach / scale));
        let mut levels = self.levels(edge)?;
        levels.iter_mut().flat_map(|sides| sides.iter_mut().zip(lit)).for_each(|(v, light)| *v /= light.max(1e-3));
        let frequencies: Vec<f64> = (0..=(HIGHEST / STEP).round() as usize).map(|k| k as f64 * STEP).collect();
        let of_channel = |(c, levels): (usize, &[f64; 2])| {
            let chain = Chain { channel: c, ..*chain };
            let response = chain.response(in_raw, edge.across, &frequencies)?;
            Ok(Side { levels: *levels, rise: Rise::new(&response) })
        };
        let channels = levels.iter().enumerate().map(of_channel).collect::<Result<Vec<_>, MeasureError>>()?;
        let tile = Tile::new(edge, scale, &self.raw.header, channels, light);

        // Response after each stage at the frequencies of the edge.
        let mut stages = vec![];
        let mut before: Option<Recipe> = None;
        for (name, recipe) in self.stages() {
            // A step that does nothing has no factor; a mosaic of one colour has nothing to demosaic.
            let same = before.as_ref() == Some(&recipe);
            if same && (name != "demosaicing" || self.raw.header.cfa.is_monochrome()) {
                continue;
            }
            stages.push((name, self.response(&tile, &recipe, name.is_empty(), edge, channel, options)?));
            before = Some(recipe);
        }
        let raw = stages[0].1.clone();
        let over =
            |after: &[f64], before: &[f64]| after.iter().zip(before).map(|(a, b)| if *b > 1e-6 { a / b } else { 1.0 }).collect();
        let steps = stages.windows(2).map(|w| StepFactor { name: w[1].0, factor: over(&w[1].1, &w[0].1) }).collect();
        let product = stages.pop().map(|s| s.1).unwrap_or_default();
        let largest_difference = largest_difference(edge, &product);
        Ok(Developed { frequencies: edge.frequencies.clone(), raw, steps, product, largest_difference, notes: self.notes() })
    }

    /// The response of the tile after a stage, at the frequencies of the edge.
    fn response(
        &self,
        tile: &Tile,
        recipe: &Recipe,
        all_channels: bool,
        edge: &EdgeMtf,
        channel: Channel,
        options: &Options,
    ) -> Result<Vec<f64>, MeasureError> {
        let failed =
            |what: String| MeasureError::unfit("prediction of a developed picture", what, "an edge that development leaves one");
        // One that is halved has fewer pixels, and so has one whose size was asked for.
        let half = recipe.demosaic.method == Demosaic::Half && !all_channels && !self.raw.header.cfa.is_monochrome();
        let cells = if half { [self.raw.header.cfa.columns(), self.raw.header.cfa.rows()] } else { [1, 1] };
        let mut recipe = recipe.clone();
        let mut own = [0, 1].map(|k| 1.0 / cells[k] as f64);
        if recipe.resize != Default::default() {
            let width = (tile.size[0] as f64 * self.scale()).round().max(1.0);
            recipe.resize = Default::default();
            recipe.resize.width = Some(width as u32);
            own = [width / tile.size[0] as f64; 2];
        }
        let readings = if all_channels { 1 } else { READINGS };
        let develop = |reading: u64| {
            let raw = tile.raw(&self.raw.header, all_channels, (!all_channels).then_some(reading));
            let lut = if recipe.lut.file.is_empty() { None } else { self.lut.cloned() };
            Developer::new(&raw, &recipe, lut).map(|d| measured(&d.whole())).map_err(|e| failed(e.to_string()))
        };
        let mut mean = develop(0)?.plane(channel)?;
        for reading in 1..readings {
            let more = develop(reading)?.plane(channel)?;
            mean.values.iter_mut().zip(&more.values).for_each(|(a, b)| *a += b);
        }
        mean.values.iter_mut().for_each(|v| *v /= readings as f32);
        // As many pixels around the edge as were measured.
        let per_own = own[0] / self.scale();
        let r = edge.region;
        let scaled = |v: usize| (v as f64 * per_own).round().max(1.0) as usize;
        let start = |k: usize| {
            let at = [r.x, r.y][k] as f64 / self.scale() - tile.origin[k] as f64;
            (at * own[k]).round().max(0.0) as usize
        };
        let (width, height) = (scaled(r.width), scaled(r.height));
        let fit = |at: usize, size: usize, all: usize| at.min(all.saturating_sub(size));
        let region = Region { x: fit(start(0), width, mean.width), y: fit(start(1), height, mean.height), width, height };
        let options = Options { reach: options.reach.map(|r| r * per_own), ..*options };
        let found = measure(&mean, region, &options)?;
        Ok(edge.frequencies.iter().map(|f| found.at(f / per_own)).collect())
    }
}

/// The edge spread function of a response.
struct Rise {
    /// From −[`REACH_PX`] to [`REACH_PX`], [`PLACES`] a pixel.
    values: Vec<f64>,
}

impl Rise {
    /// E(x) = ½ + 2 ∫ (Re H sin 2πfx − Im H cos 2πfx) / (2πf) df: the integral of the line spread function, whose transform is H.
    fn new(response: &[[f64; 2]]) -> Rise {
        let last = (response.len() - 1) * FINER;
        let step = STEP / FINER as f64;
        // Between frequencies by straight lines; the ends of the integral (trapezoid) count half.
        let at = |i: usize| {
            let (k, t) = (i / FINER, (i % FINER) as f64 / FINER as f64);
            let (a, b) = (response[k], response[(k + 1).min(response.len() - 1)]);
            [0, 1].map(|p| a[p] + (b[p] - a[p]) * t)
        };
        let fine: Vec<(f64, [f64; 2])> = (1..=last).map(|i| (step * i as f64, at(i))).collect();
        let n = (REACH_PX * PLACES) as i64;
        let value = |i: i64| {
            let x = i as f64 / PLACES;
            // At frequency 0 the integrand is Re H(0) 2π x / 2π.
            let mut sum = 0.5 * response[0][0] * x;
            for (k, (f, [re, im])) in fine.iter().enumerate() {
                let weight = if k + 1 == fine.len() { 0.5 } else { 1.0 };
                let (sin, cos) = (TAU * f * x).sin_cos();
                sum += weight * (re * sin - im * cos) / (TAU * f);
            }
            0.5 + 2.0 * step * sum
        };
        Rise { values: (-n..=n).into_par_iter().map(value).collect() }
    }

    /// Between places by cubics through the four around (E. Catmull & R. Rom 1974); level beyond.
    fn at(&self, x: f64) -> f64 {
        let place = ((x + REACH_PX) * PLACES).clamp(1.0, self.values.len() as f64 - 3.0 - 1e-9);
        let (k, t) = (place as usize, place.fract());
        let [a, b, c, d] = [0, 1, 2, 3].map(|i| self.values[k - 1 + i]);
        b + 0.5 * t * (c - a + t * (2.0 * a - 5.0 * b + 4.0 * c - d + t * (3.0 * (b - c) + d - a)))
    }
}

/// A channel on both sides of an edge.
struct Side {
    levels: [f64; 2],
    rise: Rise,
}

/// Light at a distance from the edge, pixels, between the places where it is known.
fn light_at(light: &[f64], distance: f64) -> f64 {
    let place = ((distance / REACH_PX + 1.0) * 0.5 * (LIT - 1) as f64).clamp(0.0, (LIT - 1) as f64 - 1e-9);
    let (k, t) = (place as usize, place.fract());
    light[k] + (light[k + 1] - light[k]) * t
}

/// A raw image of an edge and what lies around it.
struct Tile {
    /// Place of its first pixel in the mosaic: whole patterns.
    origin: [i64; 2],
    size: [usize; 2],
    /// The edge, pixels of the tile.
    middle: DVec2,
    across: DVec2,
    channels: Vec<Side>,
    /// Light across the edge over that at the edge, at [`LIT`] places.
    light: Vec<f64>,
}

impl Tile {
    fn new(edge: &EdgeMtf, scale: f64, header: &RawHeader, channels: Vec<Side>, light: Vec<f64>) -> Tile {
        let r = edge.region;
        let patterns = [header.cfa.columns(), header.cfa.rows()];
        let origin = [0, 1].map(|k| {
            let first = ([r.x, r.y][k] as f64 / scale).floor() as i64 - MARGIN as i64;
            first.div_euclid(patterns[k] as i64) * patterns[k] as i64
        });
        let size = [0, 1].map(|k| {
            let end = (([r.x + r.width, r.y + r.height][k]) as f64 / scale).ceil() as i64 + MARGIN as i64;
            ((end - origin[k]) as usize).next_multiple_of(patterns[k])
        });
        let middle = DVec2::new(edge.middle[0] / scale - origin[0] as f64, edge.middle[1] / scale - origin[1] as f64);
        Tile { origin, size, middle, across: DVec2::from_array(edge.across), channels, light }
    }

    /// As a mosaic, or with all channels at every pixel; with the noise of a reading.
    fn raw(&self, header: &RawHeader, all_channels: bool, reading: Option<u64>) -> RawImage {
        let [width, height] = self.size;
        // Three channels side by side are what developers know without a mosaic; of others the mosaic stands.
        let all_channels = all_channels && header.cfa.filters() == Cfa::linear_rgb().filters();
        let samples = if all_channels { header.cfa.channel_count() } else { 1 };
        let mut mosaic = Raster::<u16>::new(width * samples, height, 1);
        let value = |channel: usize, distance: f64| {
            let Side { levels: [left, right], rise } = &self.channels[channel];
            let light = light_at(&self.light, distance);
            (left + (right - left) * rise.at(distance)) * light
        };
        for row in 0..height {
            for column in 0..width {
                let place = DVec2::new(column as f64 + 0.5, row as f64 + 0.5);
                let distance = (place - self.middle).dot(self.across);
                for s in 0..samples {
                    let channel = if all_channels { s } else { header.cfa.channel_at(column, row) };
                    let mut x = value(channel, distance);
                    if let (Some(reading), Some([a, b])) = (reading, header.noise.get(channel)) {
                        let number = ((reading as usize * height + row) * width + column) as u64;
                        x += (a * x.max(0.0) + b).max(0.0).sqrt() * normal(number);
                    }
                    let dn = BLACK + x * (FULL - BLACK);
                    mosaic.pixel_mut(column * samples + s, row)[0] = dn.round().clamp(0.0, FULL) as u16;
                }
            }
        }
        let cfa = if all_channels { Cfa::linear_rgb() } else { header.cfa.clone() };
        let header = RawHeader {
            cfa,
            bits: 16,
            black_level: BLACK,
            white_level: FULL,
            opcodes: vec![],
            framing: Default::default(),
            ..header.clone()
        };
        RawImage { mosaic, header }
    }
}

/// A number of a normal distribution, by the number of the draw: SplitMix64 and Box & Muller (1958).
fn normal(number: u64) -> f64 {
    let uniform = |k: u64| {
        let mut z = (2 * number + k + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        (((z ^ (z >> 31)) >> 11) as f64 + 0.5) / (1u64 << 53) as f64
    };
    (-2.0 * uniform(0).ln()).sqrt() * (TAU * uniform(1)).cos()
}
