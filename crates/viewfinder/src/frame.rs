//! A frame of the finder on its way to a page: what is known of it, the picture, and how blurred each place of it is.
//!
//! Binary layout: `DVF1`, the length of the header (32 bits, little endian), the header (JSON), the length of the picture (likewise), the picture (JPEG),
//! the blur map (one signed byte a cell).

use diopter::camera::Camera;
use diopter::image::{ExposureFacts, FocalPlane, Raster, RawImage, focal_plane::Truth};
use diopter::quick_look::Optics;
use serde::Serialize;
use serde_json::Value;

/// A frame as it is sent.
pub struct Frame {
    /// Counts all frames.
    pub number: u64,
    /// The message.
    pub bytes: Vec<u8>,
}

const MAGIC: &[u8; 4] = b"DVF1";

/// Joins the parts of a frame.
pub fn encode(number: u64, header: &Value, jpeg: &[u8], blur: &[i8]) -> Frame {
    let header = header.to_string();
    let mut bytes = Vec::with_capacity(MAGIC.len() + 8 + header.len() + jpeg.len() + blur.len());
    bytes.extend(MAGIC);
    bytes.extend((header.len() as u32).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend((jpeg.len() as u32).to_le_bytes());
    bytes.extend(jpeg);
    bytes.extend(blur.iter().map(|b| *b as u8));
    Frame { number, bytes }
}

/// Cells of a histogram.
pub const BINS: usize = 96;
/// Stops below saturation that a histogram shows.
pub const STOPS: f64 = 12.0;

/// What a raw image holds, by channel.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Histogram {
    /// Letter of the filter.
    pub channel: char,
    /// Pixels by their light on a scale of stops: the last cell ends at saturation, the first begins [`STOPS`] below and holds all darker ones.
    pub bins: Vec<u32>,
    /// Fraction of the pixels that are saturated.
    pub clipped: f64,
    /// Fraction of the pixels at black or below.
    pub black: f64,
}

/// Histograms of all channels of a raw image.
pub fn histograms(raw: &RawImage) -> Vec<Histogram> {
    let h = &raw.header;
    let range = h.white_level - h.black_level;
    let mut found: Vec<Histogram> = h
        .cfa
        .filters()
        .iter()
        .map(|f| Histogram { channel: f.letter(), bins: vec![0; BINS], clipped: 0.0, black: 0.0 })
        .collect();
    // Each number once, then as often as it occurs.
    let mut counts = vec![vec![0u32; 1 << 16]; found.len()];
    for (i, dn) in raw.mosaic.data.iter().enumerate() {
        counts[h.cfa.channel_at(i % raw.mosaic.width, i / raw.mosaic.width)][usize::from(*dn)] += 1;
    }
    for (histogram, counts) in found.iter_mut().zip(&counts) {
        let all = counts.iter().map(|c| u64::from(*c)).sum::<u64>().max(1) as f64;
        for (dn, count) in counts.iter().enumerate().filter(|(_, c)| **c > 0) {
            let light = (dn as f64 - h.black_level) / range;
            let fraction = f64::from(*count) / all;
            if dn as f64 >= h.white_level {
                histogram.clipped += fraction;
            }
            if light <= 0.0 {
                histogram.black += fraction;
            }
            let place = (light.max(1e-9).log2() / STOPS + 1.0) * BINS as f64;
            histogram.bins[(place.max(0.0) as usize).min(BINS - 1)] += count;
        }
    }
    found
}

/// How blurred the places of a picture are: diameters of the circle of confusion in units of the largest that is taken for sharp, with the sign of what
/// is farther than the sharp plane, in quarters.
pub struct BlurMap {
    /// Cells across and down.
    pub size: [usize; 2],
    /// One a cell.
    pub cells: Vec<i8>,
}

/// Cells across a map.
const BLUR_COLUMNS: usize = 240;
/// Steps of a map in one circle of confusion.
pub const BLUR_STEPS: f64 = 4.0;

/// The blur map of a picture, by the depth along chief rays and thin-lens blur; `None` where nothing is out of focus.
pub fn blur_map(truth: &Truth, camera: &Camera, facts: &ExposureFacts) -> Option<BlurMap> {
    if camera.lens.is_sharp_everywhere() {
        return None;
    }
    let film = &camera.film;
    let focus_m = facts.focus_distance_m.unwrap_or(f64::INFINITY);
    let optics = Optics::thin(facts.focal_length_mm, facts.f_number, focus_m, film.width_mm, &Default::default());
    let depth: &Raster<f32> = truth.depth();
    let step = depth.width.div_ceil(BLUR_COLUMNS).max(1);
    let size = [depth.width.div_ceil(step), depth.height.div_ceil(step)];
    // Radius in pixels of a picture of so many columns, over the radius that is taken for sharp.
    let columns = 10_000;
    let sharp_px =
        0.5 * film.width_mm.hypot(film.height_mm) * diopter::depth_of_field::CIRCLE_OF_DIAGONAL / film.width_mm * columns as f64;
    let cell = |i: usize| {
        let (x, y) = (i % size[0] * step + step / 2, i / size[0] * step + step / 2);
        let d = depth.pixel(x.min(depth.width - 1), y.min(depth.height - 1))[0];
        let circles = optics.radius_px(f64::from(d), columns) / sharp_px;
        (circles * BLUR_STEPS).round().clamp(-127.0, 127.0) as i8
    };
    Some(BlurMap { size, cells: (0..size[0] * size[1]).map(cell).collect() })
}

/// Times by which a pixel may be brighter than the second brightest of its neighbours.
const STANDS_OUT: f32 = 2.0;
/// Half difference over mean from which on one half of the samples sees what the other does not: three times as much light.
const ONE_SIDED: f32 = 0.5;

/// An exposure of few samples without its outliers: single pixels (or pairs) that stand far out of those around them, in one half of their samples, are
/// made as bright as these. A mosaic would turn each of them into a coloured dot. Stars and small lamps are in both halves, and stay. What is taken away
/// is a matter of the frame alone: pictures that are taken re-weight outliers by their samples.
pub fn without_outliers(plane: &FocalPlane) -> FocalPlane {
    let mut out = plane.clone();
    let (width, height, bands) = (plane.width(), plane.height(), plane.bands.len());
    if width < 3 || height < 3 || bands == 0 {
        return out;
    }
    let light: Vec<f32> = plane.mean.data.chunks_exact(bands).map(|p| p.iter().sum()).collect();
    for y in 0..height {
        for x in 0..width {
            let own = light[y * width + x];
            let (mut first, mut second) = (0.0f32, 0.0f32);
            for v in y.saturating_sub(1)..(y + 2).min(height) {
                for u in x.saturating_sub(1)..(x + 2).min(width) {
                    if (u, v) != (x, y) {
                        let there = light[v * width + u];
                        (first, second) = if there > first { (there, first) } else { (first, second.max(there)) };
                    }
                }
            }
            let most = STANDS_OUT * second;
            let k = (y * width + x) * bands;
            let one_sided = || {
                let half: f32 = plane.half_difference.data[k..k + bands].iter().sum();
                plane.facts.samples < 2 || half.abs() > ONE_SIDED * own
            };
            if own > most && one_sided() {
                let factor = most / own;
                out.mean.data[k..k + bands].iter_mut().for_each(|v| *v *= factor);
                out.half_difference.data[k..k + bands].iter_mut().for_each(|v| *v *= factor);
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter::image::focal_plane::{Band, BandUnit};
    use diopter::image::{Cfa, RawHeader};
    use diopter::lens::{Focus, Iris, Lens, ThinLens};
    use diopter::light::units::Millimeters;
    use diopter::{CameraMotion, Film};
    use serde_json::json;

    fn raw(dn: impl Fn(usize) -> u16) -> RawImage {
        let header = RawHeader {
            cfa: Cfa::parse("bayer").unwrap(),
            bits: 12,
            black_level: 100.0,
            white_level: 4100.0,
            as_shot_neutral: vec![1.0; 3],
            calibrations: vec![],
            baseline_ev: 0.0,
            framing: Default::default(),
            opcodes: vec![],
            warnings: vec![],
            noise: vec![],
            facts: ExposureFacts::default(),
        };
        RawImage { mosaic: Raster { width: 8, height: 4, channels: 1, data: (0..32).map(dn).collect() }, header }
    }

    #[test]
    fn histograms_count_stops_below_saturation() {
        // Red saturated, green two stops below, blue at black.
        let h = raw(|i| match (i % 8 % 2, i / 8 % 2) {
            (0, 0) => 4100,
            (1, 1) => 90,
            _ => 1100,
        });
        let [red, green, blue] = &histograms(&h)[..] else { panic!("three channels") };
        assert_eq!((red.channel, green.channel, blue.channel), ('R', 'G', 'B'));
        assert_eq!((red.clipped, green.clipped, blue.black), (1.0, 0.0, 1.0));
        let sum = |h: &Histogram| h.bins.iter().sum::<u32>();
        assert_eq!((sum(red), sum(green), sum(blue)), (8, 16, 8));
        // Two stops of twelve below the top of 96 cells.
        assert_eq!(green.bins.iter().position(|b| *b > 0), Some(80));
        assert_eq!((red.bins[BINS - 1], blue.bins[0]), (8, 8));
    }

    #[test]
    fn single_bright_pixels_are_as_bright_as_those_around_them() {
        let bands = ["r", "b"].map(|name| Band { name: name.into(), unit: BandUnit::Electrons }).to_vec();
        let mut plane = FocalPlane::even(bands, &[10.0, 30.0], [8, 6], ExposureFacts::default());
        plane.facts.samples = 4;
        // A single path of much weight; a star; a highlight of 2 × 2 pixels.
        plane.mean.pixel_mut(2, 2).copy_from_slice(&[4000.0, 0.0]);
        plane.half_difference.pixel_mut(2, 2).copy_from_slice(&[-4000.0, 0.0]);
        plane.mean.pixel_mut(2, 5).copy_from_slice(&[4000.0, 0.0]);
        for (x, y) in [(5, 3), (6, 3), (5, 4), (6, 4)] {
            plane.mean.pixel_mut(x, y).copy_from_slice(&[500.0, 500.0]);
        }
        let calm = without_outliers(&plane);
        assert_eq!(calm.mean.pixel(2, 2), [80.0, 0.0]);
        assert_eq!((calm.mean.pixel(5, 3), calm.mean.pixel(0, 0)), (&[500.0, 500.0][..], &[10.0, 30.0][..]));
        assert_eq!(calm.mean.pixel(2, 5), [4000.0, 0.0]);
        let small = FocalPlane::even(vec![], &[], [0, 0], ExposureFacts::default());
        assert_eq!(without_outliers(&small), small);
    }

    #[test]
    fn frames_hold_their_parts() {
        let frame = encode(7, &json!({ "a": 1 }), &[1, 2, 3], &[-1, 2]);
        assert_eq!(&frame.bytes[..4], MAGIC);
        let length = u32::from_le_bytes(frame.bytes[4..8].try_into().unwrap()) as usize;
        assert_eq!(&frame.bytes[8..8 + length], b"{\"a\":1}");
        assert_eq!(&frame.bytes[8 + length..], [3, 0, 0, 0, 1, 2, 3, 255, 2]);
    }

    #[test]
    fn blur_is_nought_in_the_sharp_plane_and_signed_about_it() {
        let lens = Lens::Thin(ThinLens::new(Millimeters(50.0), 2.8, Iris::default(), Focus::at_mm(2000.0)).unwrap());
        let camera = Camera { lens, film: Film::new(36.0, 24.0, 4, 1), motion: CameraMotion::still(glam::Affine3A::IDENTITY) };
        let facts = ExposureFacts { focal_length_mm: 50.0, f_number: 2.8, focus_distance_m: Some(2.0), ..Default::default() };
        let mut truth = Truth::empty(4, 1);
        truth.depth_mut().data = vec![2.0, 1.0, 4.0, f32::INFINITY];
        let map = blur_map(&truth, &camera, &facts).unwrap();
        assert_eq!(map.size, [4, 1]);
        assert!(map.cells[0] == 0 && map.cells[1] < -4 && map.cells[2] > 4 && map.cells[3] > map.cells[2], "{:?}", map.cells);
        // f² / (N c (s − f)) · (1 − s / d) for d = 4 m: circle over the one taken for sharp.
        let circle = diopter::depth_of_field::circle_mm(50.0, 2.8, 2.0, 4.0) / (36f64.hypot(24.0) / 1442.0);
        assert!((f64::from(map.cells[2]) / BLUR_STEPS - circle).abs() < 0.13, "{circle} {}", map.cells[2]);
    }
}
