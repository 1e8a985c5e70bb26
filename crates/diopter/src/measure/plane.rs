//! What is measured: linear values of one channel of a picture, at the pixels where it was sampled.

use super::MeasureError;
use crate::files;
use diopter_image::raw::Filter;
use diopter_image::{Encoding, ExposureFacts, Raster, RawImage, dng, exr, icc};
use diopter_light::color::RgbSpace;
use diopter_scene::load::{read_codes, read_profile};
use serde::Serialize;
use std::io::Cursor;
use std::path::Path;

/// Which numbers of a picture are measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Channel {
    /// Red; of a raw image the pixels behind red filters.
    Red,
    /// Green.
    Green,
    /// Blue.
    Blue,
    /// Pixels without a filter, or of a monochrome sensor.
    Clear,
    /// Luminance of a developed picture (Rec. 709 weights).
    Luminance,
}

impl Channel {
    /// Name in messages.
    pub fn name(self) -> &'static str {
        match self {
            Channel::Red => "red",
            Channel::Green => "green",
            Channel::Blue => "blue",
            Channel::Clear => "clear",
            Channel::Luminance => "luminance",
        }
    }

    fn filter(self) -> Option<Filter> {
        match self {
            Channel::Red => Some(Filter::Red),
            Channel::Green => Some(Filter::Green),
            Channel::Blue => Some(Filter::Blue),
            Channel::Clear => Some(Filter::Clear),
            Channel::Luminance => None,
        }
    }
}

/// A rectangle of pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Region {
    /// First column.
    pub x: usize,
    /// First row.
    pub y: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl std::fmt::Display for Region {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(f, "region {},{},{},{}", self.x, self.y, self.width, self.height)
    }
}

impl Region {
    /// Whether a place (pixels) lies in it.
    pub fn holds(&self, [x, y]: [f64; 2]) -> bool {
        let within = |at: f64, from: usize, size: usize| at >= from as f64 && at < (from + size) as f64;
        within(x, self.x, self.width) && within(y, self.y, self.height)
    }

    /// Whether two of them share pixels.
    pub fn overlaps(&self, other: &Region) -> bool {
        self.x < other.x + other.width
            && other.x < self.x + self.width
            && self.y < other.y + other.height
            && other.y < self.y + self.height
    }
}

/// Linear values of one channel on the pixel grid.
#[derive(Clone, Debug, PartialEq)]
pub struct Plane {
    /// Pixels a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `[row][column]`, proportional to light; NaN where the channel was not sampled.
    pub values: Vec<f32>,
    /// Values at and beyond which they are clipped, below and above; infinite where they never are.
    pub limits: [f32; 2],
    /// `[row][column]`: whether a channel that the value is made of is clipped above, where the value itself does not say so.
    pub clipped: Option<Vec<bool>>,
}

impl Plane {
    /// Whether the value of a pixel (by its place in [`Plane::values`]) is clipped, below and above.
    pub fn is_clipped(&self, at: usize) -> [bool; 2] {
        let (v, [low, high]) = (self.values[at], self.limits);
        [v <= low, v >= high || self.clipped.as_ref().is_some_and(|clipped| clipped[at])]
    }

    /// What line widths and TV distortion count by, pixels: the shorter side, as the camera is held or not.
    pub fn picture_height(&self) -> usize {
        self.width.min(self.height)
    }

    /// Value at a pixel; NaN where the channel was not sampled. The pixel must lie within the picture.
    pub fn at(&self, column: usize, row: usize) -> f64 {
        f64::from(self.values[row * self.width + column])
    }

    /// All of it.
    pub fn whole(&self) -> Region {
        Region { x: 0, y: 0, width: self.width, height: self.height }
    }

    /// The samples of a region, row by row, without pixels where the channel was not sampled. The region must lie within the picture ([`Plane::check`]).
    pub fn samples(&self, region: Region) -> impl Iterator<Item = f64> + '_ {
        (region.y..region.y + region.height)
            .flat_map(move |y| (region.x..region.x + region.width).map(move |x| self.at(x, y)))
            .filter(|v| !v.is_nan())
    }

    /// Fractions of the samples of a region that are clipped, below and above.
    pub fn clipped(&self, region: Region) -> [f64; 2] {
        let (mut low, mut high, mut count) = (0.0, 0.0, 0.0f64);
        let rows = region.y..region.y + region.height;
        let places = rows.flat_map(|y| (region.x..region.x + region.width).map(move |x| y * self.width + x));
        for at in places.filter(|at| !self.values[*at].is_nan()) {
            let [below, above] = self.is_clipped(at);
            low += f64::from(below);
            high += f64::from(above);
            count += 1.0;
        }
        [low / count.max(1.0), high / count.max(1.0)]
    }

    /// Fails where a region does not lie within the picture, or is smaller than `least` pixels a side.
    pub fn check(&self, region: Region, least: usize) -> Result<(), MeasureError> {
        let inside = region.x.checked_add(region.width).is_some_and(|r| r <= self.width)
            && region.y.checked_add(region.height).is_some_and(|b| b <= self.height);
        if !inside || region.width < least || region.height < least {
            return Err(MeasureError::unfit(
                region.to_string(),
                format!("the picture has {} × {} pixels", self.width, self.height),
                format!("x,y,width,height within it, at least {least} pixels a side"),
            ));
        }
        Ok(())
    }
}

/// A picture file that is measured.
pub enum Measured {
    /// A raw image.
    Raw(Box<RawImage>),
    /// Linear values, all channels at every pixel.
    Light {
        /// Values.
        pixels: Raster<f32>,
        /// Names of its channels: `R`, `G`, `B`, `W`, `Y`.
        bands: Vec<String>,
        /// Where they are clipped.
        limits: [f32; 2],
        /// Pixel by pixel, of pictures of codes: whether a channel has the highest of them, and whether values of a channel are made of the codes of several.
        clipped: Option<(Vec<bool>, bool)>,
        /// How it was taken, where the file says so.
        facts: Option<Box<ExposureFacts>>,
    },
}

impl Measured {
    /// Reads a DNG, a focal plane or other EXR, or a picture (PNG, TIFF, JPEG ...) whose codes are decoded by `encoding`, without one by that of its colour profile, or sRGB. Fails where the file cannot be read or decoded.
    pub fn read(path: &Path, encoding: Option<Encoding>) -> Result<Measured, MeasureError> {
        let wrong = |reason: String| MeasureError::Read { path: path.display().to_string(), reason };
        let bytes = files::read(path).map_err(|e| wrong(e.to_string()))?;
        Self::from_bytes(bytes, encoding, path.extension().is_some_and(|e| e.eq_ignore_ascii_case("dng"))).map_err(wrong)
    }

    fn from_bytes(bytes: Vec<u8>, encoding: Option<Encoding>, raw: bool) -> Result<Measured, String> {
        const EXR: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];
        if encoding.is_some() && (raw || bytes.starts_with(&EXR)) {
            return Err("an encoding is of codes: it holds light; expected no --encoding, or a picture such as .png".to_owned());
        }
        if raw {
            let raw = dng::read(Cursor::new(bytes)).map_err(|e| e.to_string())?;
            return Ok(Measured::Raw(Box::new(raw)));
        }
        let limits = [f32::NEG_INFINITY, f32::INFINITY];
        if bytes.starts_with(&EXR) {
            if let Ok(plane) = exr::read_focal_plane(Cursor::new(&bytes)) {
                let bands = plane.bands.iter().map(|b| b.name.clone()).collect();
                return Ok(Measured::Light {
                    pixels: plane.mean,
                    bands,
                    limits,
                    clipped: None,
                    facts: Some(Box::new(plane.facts)),
                });
            }
            let pixels = exr::read_rgb(Cursor::new(&bytes)).map_err(|e| e.to_string())?;
            return Ok(Measured::Light {
                pixels,
                bands: ["R", "G", "B"].map(str::to_owned).to_vec(),
                limits,
                clipped: None,
                facts: None,
            });
        }
        let mut pixels = read_codes(&bytes)?;
        let profile = read_profile(&bytes);
        let of_profile = || profile.as_deref().and_then(icc::encoding_of);
        let encoding = encoding.or_else(of_profile).unwrap_or(Encoding::Srgb);
        let luminance = RgbSpace::Srgb.luminance_weights();
        let to_srgb = profile.as_deref().and_then(icc::srgb_from);
        let clipped = pixels.data.as_chunks::<3>().0.iter().map(|p| p.iter().any(|code| *code >= 1.0)).collect();
        pixels.data.as_chunks_mut::<3>().0.iter_mut().for_each(|p| {
            *p = encoding.decode_pixel(*p, luminance);
            if let Some(matrix) = &to_srgb {
                *p = matrix.map(|row| row[0] * p[0] + row[1] * p[1] + row[2] * p[2]);
            }
        });
        let top = encoding.decode(1.0);
        let clipped = Some((clipped, to_srgb.is_some()));
        let bands = ["R", "G", "B"].map(str::to_owned).to_vec();
        Ok(Measured::Light { pixels, bands, limits: [0.0, top], clipped, facts: None })
    }

    /// What is measured when nothing is asked for: green of a raw image (or its only channel), luminance of others.
    pub fn usual_channel(&self) -> Channel {
        match self {
            Measured::Raw(raw) if raw.header.cfa.is_monochrome() => Channel::Clear,
            Measured::Raw(_) => Channel::Green,
            Measured::Light { bands, .. } if bands.len() == 1 => Channel::Clear,
            // Electrons have no luminance.
            Measured::Light { facts: Some(_), .. } => Channel::Green,
            Measured::Light { .. } => Channel::Luminance,
        }
    }

    /// How it was taken, where the file says so.
    pub fn facts(&self) -> Option<&ExposureFacts> {
        match self {
            Measured::Raw(raw) => Some(&raw.header.facts),
            Measured::Light { facts, .. } => facts.as_deref(),
        }
    }

    /// The values of a channel, of a raw image 0 at its black and 1 at its white level. Fails where there is no such channel.
    pub fn plane(&self, channel: Channel) -> Result<Plane, MeasureError> {
        match self {
            Measured::Raw(raw) => plane_of_raw(raw, channel),
            Measured::Light { pixels, bands, limits, clipped, .. } => {
                let find = |name: &str| bands.iter().position(|b| b == name);
                let missing = || {
                    let expected = format!("one of its channels {}", bands.join(", "));
                    MeasureError::unfit("channel", channel.name(), expected)
                };
                let values = match channel {
                    Channel::Luminance => {
                        let rgb = [find("R"), find("G"), find("B")];
                        let [Some(r), Some(g), Some(b)] = rgb else { return Err(missing()) };
                        let w = RgbSpace::Srgb.luminance_weights();
                        let y = |p: &[f32]| w[0] * p[r] + w[1] * p[g] + w[2] * p[b];
                        pixels.data.chunks_exact(pixels.channels).map(y).collect()
                    }
                    Channel::Clear => pixels.channel(find("Y").or_else(|| find("W")).ok_or_else(missing)?),
                    other => {
                        let letter = other.filter().map_or('Y', Filter::letter).to_string();
                        pixels.channel(find(&letter).ok_or_else(missing)?)
                    }
                };
                let of_several = |mixed: bool| mixed || channel == Channel::Luminance;
                let clipped = clipped.as_ref().filter(|(_, mixed)| of_several(*mixed)).map(|(clipped, _)| clipped.clone());
                Ok(Plane { width: pixels.width, height: pixels.height, values, limits: *limits, clipped })
            }
        }
    }
}

/// The pixels behind one kind of filter: 0 is black, 1 the white level. Places are those of the mosaic, before any crop or turn.
fn plane_of_raw(raw: &RawImage, channel: Channel) -> Result<Plane, MeasureError> {
    let h = &raw.header;
    let cfa = &h.cfa;
    let wanted = channel.filter().and_then(|filter| cfa.filters().iter().position(|f| *f == filter));
    let Some(wanted) = wanted else {
        let names: Vec<&str> = cfa
            .filters()
            .iter()
            .map(|f| match f {
                Filter::Red => "red",
                Filter::Green => "green",
                Filter::Blue => "blue",
                Filter::Clear => "clear",
                Filter::Linear0 | Filter::Linear45 | Filter::Linear90 | Filter::Linear135 => "polarised",
            })
            .collect();
        return Err(MeasureError::unfit(
            "channel",
            format!("a raw image has no {} before it is developed", channel.name()),
            format!("one of {}; or `diopter develop` it first", names.join(", ")),
        ));
    };
    let [width, height] = raw.size();
    let samples = cfa.samples_per_pixel();
    let range = (h.white_level - h.black_level).max(1e-9);
    let linear = |dn: f64| ((dn - h.black_level) / range) as f32;
    let mut values = vec![f32::NAN; width * height];
    for (row, line) in raw.mosaic.data.chunks_exact(raw.mosaic.width).enumerate() {
        for (column, dn) in line.iter().enumerate() {
            if cfa.channel_at(column, row) == wanted {
                values[row * width + column / samples] = linear(f64::from(*dn));
            }
        }
    }
    Ok(Plane { width, height, values, limits: [linear(0.0), linear(h.white_level)], clipped: None })
}
