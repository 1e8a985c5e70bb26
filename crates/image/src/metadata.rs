//! The facts of an exposure that travel with it and become EXIF and DNG tags.

use serde::{Deserialize, Serialize};

/// What was photographed with what, and how.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ExposureFacts {
    /// Program name and version.
    pub software: String,
    /// Scene name or file name.
    pub scene: String,
    /// Camera body.
    pub body: String,
    /// Maker of the body, as EXIF Make.
    pub make: String,
    /// Model of the body, as EXIF Model.
    pub model: String,
    /// Serial number of the body: what its fixed pattern is drawn from.
    pub serial: String,
    /// Lens.
    pub lens: String,
    /// Focal length, mm; 0 of what has none that tells a field of view (panoramas, parallel projection).
    pub focal_length_mm: f64,
    /// Focal length that gives the same diagonal field of view on 36 × 24 mm, mm.
    pub focal_length_35mm_mm: f64,
    /// f-number, true value.
    pub f_number: f64,
    /// f-number of a lossless lens as bright; 0 when not known.
    pub t_number: f64,
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Distance of the plane in focus from the lens, m; `None` for infinity or a pinhole.
    pub focus_distance_m: Option<f64>,
    /// How far the film stands behind its place for infinity, mm.
    pub extension_mm: f64,
    /// How it was focused: `manual`, `auto (phase)`, `on NAME` ...; empty when not known.
    pub focus_mode: String,
    /// ISO speed; 0 before read-out.
    pub iso: f64,
    /// ISO speed the camera was set to before read-out; 0 when not known.
    pub iso_set: f64,
    /// Temperature of the sensor, °C; of a plane what the camera was set to, `None` when nobody said.
    pub temperature_c: Option<f64>,
    /// Seed of the noise of the read-out; 0 before.
    pub noise_seed: u64,
    /// Illuminant taken for white; of a plane what the camera was set to, of a developed picture what its development took (also `auto`, `patch`); empty when
    /// nobody said.
    pub white: String,
    /// When it was taken, `YYYY:MM:DD HH:MM:SS`, UTC; `None` when nobody looked at a clock.
    pub date: Option<String>,
    /// Metered exposure value at ISO 100 of the scene as framed; `None` when nothing was metered.
    pub metered_ev100: Option<f64>,
    /// How the camera was set: `M`, `A`, `S`, `P`; empty when not known.
    pub mode: String,
    /// Metering pattern: `average`, `centre-weighted`, `spot`, `matrix`, `highlight`; empty without metering.
    pub metering: String,
    /// Exposure compensation asked for, EV.
    pub compensation_ev: f64,
    /// By how much this picture of an exposure bracket was exposed more than was set, EV; `None` of other pictures.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bracket_ev: Option<f64>,
    /// Neutral density filter before the lens, stops.
    pub nd_stops: f64,
    /// Polarising filter before the lens, as in `linear:30deg`; empty without one.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub polarizer: String,
    /// Mosaic of polarisers before the pixels ([`crate::Cfa::letters`]); empty without one.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub polarizers: String,
    /// Scene time at which the exposure began, s.
    pub at_s: f64,
    /// When which part of the picture was open; `None` where the shutter is not known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shutter: Option<ShutterFacts>,
    /// Which photodiodes of split pixels it holds: `left` or `right`, by the half of the pupil that they see from behind the camera; empty where pixels are whole.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub photodiodes: String,
    /// Whether a flash was fired.
    pub flash: bool,
    /// Factor all light of the scene was multiplied by, because a setting (`ambient_ev`) asked for it; 1 if none did.
    pub light_scale: f64,
    /// Seed of the light transport.
    pub seed: u64,
    /// First sample of each pixel.
    pub first_sample: u32,
    /// Samples a pixel.
    pub samples: u32,
    /// Which samples they are, first and first that is none of them, range by range, where others are missing in between; empty where `first_sample` says it all.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub sample_ranges: Vec<[u32; 2]>,
    /// Stands for what decides the light beside these facts: where the camera stands, what of the scene was changed, how it is lit, how paths are followed. Empty when
    /// not known.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub settings_hash: String,
    /// Of a picture merged of several exposures; `None` of others.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub merged: Option<MergedFacts>,
    /// Whether the renderer's noise was reduced: the mean is then an estimate, no longer the truth within its variance.
    pub denoised: bool,
    /// Fraction of all light that re-weighting of outliers (fireflies) took away: the bias of the mean. `None` where every sample counts as it is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fireflies_removed: Option<f64>,
    /// What reduced it, with its version; empty where nothing did.
    pub denoiser: String,
    /// What the lens can be set to: focal length (mm) and f-number fully open, at its shortest and at its longest; of a prime both are the same.
    /// `None` of ideal lenses and where it is not known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lens_range: Option<[[f64; 2]; 2]>,
    /// What the lens does to a picture; `None` where it is not known or does nothing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lens_profile: Option<LensProfile>,
    /// The microlens array before the sensor; `None` of ordinary cameras.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub light_field: Option<LightFieldFacts>,
}

/// Relative difference of numbers that are the same but for how they were computed.
const SAME: f64 = 1e-9;

impl ExposureFacts {
    /// ISO speed of a picture, or the one set for an exposure that has not been read out; `None` where neither is known.
    pub fn speed(&self) -> Option<f64> {
        [self.iso, self.iso_set].into_iter().find(|iso| *iso > 0.0)
    }

    /// The facts that define the picture on the film: two exposures that agree in them show the same light, and hold samples of one picture.
    ///
    /// Left out is which samples they hold, how the exposure was chosen (mode, metering, compensation, focusing), and
    /// what only the read-out uses (ISO speed, temperature, noise, white, date).
    pub fn of_picture(&self) -> ExposureFacts {
        ExposureFacts {
            focus_mode: String::new(),
            serial: String::new(),
            iso: 0.0,
            iso_set: 0.0,
            temperature_c: None,
            noise_seed: 0,
            white: String::new(),
            date: None,
            metered_ev100: None,
            mode: String::new(),
            metering: String::new(),
            compensation_ev: 0.0,
            bracket_ev: None,
            first_sample: 0,
            samples: 0,
            sample_ranges: Vec::new(),
            ..self.clone()
        }
    }

    /// Which samples of each pixel it holds: first and first that is none of them, range by range.
    ///
    /// Ranges that a file says are believed where they rise and hold as many samples as it says.
    pub fn ranges(&self) -> Vec<[u32; 2]> {
        let ranges = &self.sample_ranges;
        let rises = ranges.iter().flatten().is_sorted_by(|a, b| a < b);
        let all: u64 = ranges.iter().map(|[first, end]| u64::from(end.saturating_sub(*first))).sum();
        match !ranges.is_empty() && rises && all == u64::from(self.samples) {
            true => ranges.clone(),
            false => vec![[self.first_sample, self.first_sample.saturating_add(self.samples)]],
        }
    }

    /// Names of the facts in which the pictures of two exposures differ ([`ExposureFacts::of_picture`]), with both values. What one of them does not know is no
    /// difference.
    pub fn differences(&self, other: &ExposureFacts) -> Vec<String> {
        let of = |facts: &ExposureFacts| match serde_json::to_value(facts.of_picture()) {
            Ok(serde_json::Value::Object(object)) => object,
            _ => serde_json::Map::new(),
        };
        let (a, b) = (of(self), of(other));
        let mut names: Vec<&String> = a.keys().chain(b.keys()).collect();
        names.sort_unstable();
        names.dedup();
        let none = serde_json::Value::Null;
        // Lengths that were written and read again, or found anew; whole numbers are as they are.
        let same = |a: &serde_json::Value, b: &serde_json::Value| match (a.as_f64(), b.as_f64()) {
            (Some(x), Some(y)) if a.is_f64() && b.is_f64() => (x - y).abs() <= SAME * x.abs().max(y.abs()),
            _ => a == b,
        };
        let differs = |name: &String| {
            let [a, b] = [&a, &b].map(|facts| facts.get(name).unwrap_or(&none));
            let told = name.replace('_', " ");
            match name.as_str() {
                "settings_hash" if a.is_null() || b.is_null() || a == b => None,
                "settings_hash" => {
                    Some("settings of scene, camera or paths (where it stands, how the scene is lit ...)".to_owned())
                }
                _ if same(a, b) => None,
                _ if a.is_object() || b.is_object() || a.is_array() || b.is_array() => Some(told),
                _ => Some(format!("{told} ({a} and {b})")),
            }
        };
        names.into_iter().filter_map(differs).collect()
    }
}

/// What the numbers of a picture are that was merged of several exposures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct MergedFacts {
    /// Light that they stand for, over that of the exposure that the facts tell.
    pub scale: f64,
    /// How much brighter than its numbers the picture is to be shown, of what its body asks for, EV.
    pub brightened_ev: f64,
}

/// A microlens array and the lens before it: what it takes to decode a raw light field.
///
/// Lengths on the film in mm from its middle, to the right and down as the picture shows it. The image of the pupil behind the lens at c
/// has its middle at c · (1 + gap · curvature); a pixel x beside it sees the slope (c − x) / gap, to which c · curvature is added for the
/// place in the exit pupil.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct LightFieldFacts {
    /// `square`, or `hexagonal`: each second row is shifted by half a pitch.
    pub arrangement: String,
    /// Distance of the lenses.
    pub pitch_mm: f64,
    /// One of them.
    pub origin_mm: [f64; 2],
    /// Their focal length.
    pub focal_length_mm: f64,
    /// From the array to the sensor.
    pub gap_mm: f64,
    /// Distance of pixels across and down.
    pub pixel_mm: [f64; 2],
    /// One over the distance from the array to the exit pupil.
    pub exit_curvature_per_mm: f64,
    /// Radius of the exit pupil over its distance.
    pub pupil_slope: f64,
    /// What is added to a distance from the lens for the reciprocal law: extension = (focal length)² / (distance + this).
    pub object_offset_mm: f64,
    /// Shapes of the pupil over the film; without them it is a disk everywhere.
    pub pupils: Option<PupilShapes>,
}

/// Shapes of the exit pupil as places of the film see it, cut by rims and blades.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PupilShapes {
    /// How many places across and down: rows and columns from edge to edge of the film. At least two of each.
    pub counts: [usize; 2],
    /// For each of them, row by row from the upper left, how far the shape reaches from the place of its middle on the axis in evenly spaced directions, the
    /// first one to the right, the next ones turned downwards, in radii of the pupil (its support function). No numbers where no light arrives.
    pub extents: Vec<Vec<f64>>,
}

/// When a picture was open.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ShutterFacts {
    /// `global`, `leaf`, `focal-plane` or `rolling`.
    pub kind: String,
    /// From the first light to the last anywhere, s.
    pub total_s: f64,
    /// Mean time that a row is open, as its light counts it: what blades take from the pupil is left out, s.
    pub effective_s: f64,
    /// Times of its rows.
    pub rows: RowTimes,
}

/// Opening and closing of each row (or column) of a picture, s since the exposure began: exact, as first and step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RowTimes {
    /// Of the top row (or left column), and from one to the next.
    pub open_s: [f64; 2],
    /// The same of closing.
    pub close_s: [f64; 2],
    /// Whether these are columns, from the left.
    pub columns: bool,
}

impl RowTimes {
    /// Times of `lines` lines that open and close one after the other, the last one first if `backwards`; first time and step of each.
    pub fn running(backwards: bool, lines: f64, open_s: [f64; 2], close_s: [f64; 2]) -> Self {
        let turned = |[first, step]: [f64; 2]| if backwards { [first + (lines - 1.0) * step, -step] } else { [first, step] };
        RowTimes { open_s: turned(open_s), close_s: turned(close_s), columns: false }
    }

    /// The same for columns or rows.
    pub fn of_columns(self, columns: bool) -> Self {
        RowTimes { columns, ..self }
    }

    /// Opening and closing of a line, s.
    pub fn of(&self, line: usize) -> (f64, f64) {
        let at = |[first, step]: [f64; 2]| first + step * line as f64;
        (at(self.open_s), at(self.close_s))
    }
}

/// What a lens does to a picture of its film, found by tracing rays: enough to undo distortion, lateral colour and vignetting.
///
/// Tables run over the height on the film from 0 to `reach` in equal steps; heights are fractions of half the diagonal of the whole film.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LensProfile {
    /// Largest height that sees light from before the camera; 1 in the corner.
    pub reach: f32,
    /// Height over the tangent of the angle, in the middle, of green light.
    pub scale: f32,
    /// Tangent of the angle to the axis of the light that arrives, as red, green and blue pixels see it.
    pub tangents: [Vec<f32>; 3],
    /// Light that arrives, of that in the middle.
    pub brightness: Vec<f32>,
}

impl LensProfile {
    /// Whether its tables can be used: of one length of at least 2, tangents finite and rising, brightness from 0 to below 100, reach above 0 and at most 2.
    pub fn is_whole(&self) -> bool {
        let n = self.brightness.len();
        let rising = |t: &Vec<f32>| t.len() == n && t.iter().all(|v| v.is_finite()) && t.is_sorted_by(|a, b| a < b);
        n >= 2
            && self.reach > 0.0
            && self.reach <= 2.0
            && self.scale > 0.0
            && self.scale.is_finite()
            && self.tangents.iter().all(rising)
            && self.brightness.iter().all(|v| *v >= 0.0 && *v < 100.0)
    }
}
