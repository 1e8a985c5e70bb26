//! What the optical chain makes of an edge: the product of the responses of lens, pixel aperture, low-pass filter, crosstalk and motion.
//!
//! The lens's is the geometric one of its spots at the edge's place, along the direction across the edge, over the colours that the channel sees of
//! the light, or where the exposure knew diffraction ([`crate::expose::diffraction_shows`]) that of its wavefronts. All of them are even functions of spatial frequency but for the lens's phase, which the magnitude of
//! a product does not need. Where light falls off across the edge (vignetting), both its sides slope: the edge spread function then rises or falls within the window
//! for another reason than blur, and the response measures up to some hundredths more or less. That is predicted, too. Left out: the renderer's noise. What the
//! development does to the raw channels is predicted by [`super::developed`].

use super::motion::Motion;
use super::mtf::{Window, sinc};
use super::{EdgeMtf, MeasureError};
use diopter_lens::CompoundLens;
use diopter_lens::Focus;
use diopter_lens::analysis::Bench;
use diopter_lens::glass::D_NM;
use diopter_lens::paraxial::FirstOrder;
use diopter_light::cie;
use diopter_light::spectrum::Table;
use diopter_sensor::Sensor;
use glam::DVec2;
use serde::Serialize;
use std::f64::consts::{PI, TAU};

/// Colours that the lens is traced with, nm: from, to, step. To the ends of what light carries: sensors without a filter see beyond 700 nm, where lenses are out of focus.
const COLORS_NM: [i32; 3] = [380, 780, 20];
/// Colours that matter less than this fraction of the strongest are left out.
const LEAST_WEIGHT: f64 = 0.01;
/// Heights below this fraction of the pixel are the middle of the picture, where no direction is radial.
const MIDDLE_PX: f64 = 1.0;

/// A camera whose pictures are predicted.
pub struct Chain<'a> {
    /// The lens as it is set; the chart lies where it is focused.
    pub lens: &'a CompoundLens,
    /// The body.
    pub sensor: &'a Sensor,
    /// Number of the sensor's channel.
    pub channel: usize,
    /// Illuminant of the chart: `D65`, `A` ...
    pub light: &'a str,
    /// Width and height of the film that the picture shows, mm.
    pub film_mm: [f64; 2],
    /// Pixels of the picture.
    pub size: [usize; 2],
    /// Whether the picture was exposed with diffraction at the aperture.
    pub diffraction: bool,
    /// How the image of the chart moves during the exposure.
    pub motion: Motion<'a>,
}

/// The response of each part at the frequencies of an edge.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Prediction {
    /// Image height of the edge, mm.
    pub height_mm: f64,
    /// How far the image travels across the edge during the exposure, pixels.
    pub travel_px: f64,
    /// Cycles a pixel across the edge: those of the measured response.
    pub frequencies: Vec<f64>,
    /// Lens.
    pub lens: Vec<f64>,
    /// Light-sensitive part of the pixel.
    pub aperture: Vec<f64>,
    /// Optical low-pass filter.
    pub low_pass: Vec<f64>,
    /// Crosstalk between pixels.
    pub crosstalk: Vec<f64>,
    /// Motion of the image across the edge.
    pub motion: Vec<f64>,
    /// Their product.
    pub product: Vec<f64>,
    /// What light that falls off across the edge adds to the response of an edge: a factor.
    pub shading: Vec<f64>,
    /// What of the product an edge shows within the window that it was measured in (light that falls beyond it does not lower the response, which is 1 at frequency
    /// 0), with the shading.
    pub windowed: Vec<f64>,
    /// Largest difference of the measured response from the windowed product up to half a cycle a pixel, and where.
    pub largest_difference: [f64; 2],
}

/// The response of each part at frequencies: real numbers where the part is even, else real and imaginary part, the latter positive where light lies ahead.
struct Parts {
    height_mm: f64,
    travel_px: f64,
    lens: Vec<[f64; 2]>,
    aperture: Vec<f64>,
    low_pass: Vec<f64>,
    crosstalk: Vec<f64>,
    motion: Vec<[f64; 2]>,
}

/// A place of the film and a direction across an edge there, with the lens that shows it.
struct Spot<'a> {
    bench: Bench<'a>,
    /// From the middle of the film, mm.
    offset: DVec2,
    across: DVec2,
    /// Distance of pixels, mm.
    pitch: [f64; 2],
    /// Wavelengths (nm) with the response of the channel to the light.
    colors: Vec<(f64, f64)>,
}

fn unfit(found: String, expected: &str) -> MeasureError {
    MeasureError::unfit("prediction", found, expected)
}

impl<'a> Chain<'a> {
    /// Predicts the response of an edge that was measured. Fails on an unknown light or channel, on a motion that is not finite, and where the lens brings no light to
    /// the edge or moves it out of the picture.
    pub fn predict(&self, edge: &EdgeMtf) -> Result<Prediction, MeasureError> {
        let spot = self.spot(edge.middle, edge.across)?;
        let parts = self.parts(&spot, edge.middle, edge.across, &edge.frequencies)?;
        let magnitude = |all: &[[f64; 2]]| all.iter().map(|[re, im]| re.hypot(*im)).collect::<Vec<_>>();
        let even = |all: &[f64]| all.iter().map(|v| v.abs()).collect::<Vec<_>>();
        let (lens, motion) = (magnitude(&parts.lens), magnitude(&parts.motion));
        let (aperture, low_pass, crosstalk) = (even(&parts.aperture), even(&parts.low_pass), even(&parts.crosstalk));
        let product: Vec<f64> = (0..lens.len()).map(|k| lens[k] * aperture[k] * low_pass[k] * crosstalk[k] * motion[k]).collect();
        let seen = Seen::new(edge);
        let unshaded = seen.response(&product, None);
        let windowed = seen.response(&product, Some(&seen.light(spot.light())));
        let shading = windowed.iter().zip(&unshaded).map(|(w, e)| if *e > 0.0 { w / e } else { 1.0 }).collect();
        let largest_difference = largest_difference(edge, &windowed);
        Ok(Prediction {
            height_mm: parts.height_mm,
            travel_px: parts.travel_px,
            frequencies: edge.frequencies.clone(),
            lens,
            aperture,
            low_pass,
            crosstalk,
            motion,
            product,
            shading,
            windowed,
            largest_difference,
        })
    }

    /// The product of all parts with its phase, at frequencies (cycles a pixel) across an edge at a place (pixels): real and imaginary part, the latter positive
    /// where light lies ahead. `across`: unit vector, right and down. Fails as [`Chain::predict`].
    pub fn response(&self, place: [f64; 2], across: [f64; 2], frequencies: &[f64]) -> Result<Vec<[f64; 2]>, MeasureError> {
        let p = self.parts(&self.spot(place, across)?, place, across, frequencies)?;
        let product = |k: usize| {
            let even = p.aperture[k] * p.low_pass[k] * p.crosstalk[k];
            let ([a, b], [c, d]) = (p.lens[k], p.motion[k]);
            [even * (a * c - b * d), even * (a * d + b * c)]
        };
        Ok((0..frequencies.len()).map(product).collect())
    }

    /// Light that the lens brings to distances (pixels) across an edge at a place, over that at the edge. Fails on an unknown light or channel.
    pub fn light_across(&self, place: [f64; 2], across: [f64; 2], distances: &[f64]) -> Result<Vec<f64>, MeasureError> {
        let spot = self.spot(place, across)?;
        let light = spot.light();
        let middle = light(0.0);
        Ok(distances.iter().map(|d| if middle > 0.0 { light(*d) / middle } else { 1.0 }).collect())
    }

    fn weight(&self, responses: &[Table], light: &Table, channel: usize, nm: i32) -> f64 {
        f64::from(responses[channel].at(nm as f32)) * f64::from(light.at(nm as f32))
    }

    fn light_table(&self) -> Result<Table, MeasureError> {
        cie::illuminant(self.light)
            .ok_or_else(|| unfit(format!("light \"{}\"", self.light), &format!("one of {}", cie::illuminant_names().join(", "))))
    }

    fn spot(&self, place: [f64; 2], across: [f64; 2]) -> Result<Spot<'a>, MeasureError> {
        let light = self.light_table()?;
        let responses = self.sensor.band_responses();
        if self.channel >= responses.len() {
            return Err(unfit(format!("channel {}", self.channel), &format!("0 to {}", responses.len() - 1)));
        }
        let [from, to, step] = COLORS_NM;
        let all: Vec<(f64, f64)> = (from..=to)
            .step_by(step as usize)
            .map(|nm| (f64::from(nm), self.weight(&responses, &light, self.channel, nm)))
            .collect();
        let strongest = all.iter().map(|c| c.1).fold(0.0, f64::max);
        let colors: Vec<(f64, f64)> = all.into_iter().filter(|c| c.1 > LEAST_WEIGHT * strongest).collect();
        let pitch = [0, 1].map(|k| self.film_mm[k] / self.size[k] as f64);
        let offset = DVec2::from_array([0, 1].map(|k| (place[k] - 0.5 * self.size[k] as f64) * pitch[k]));
        let system = self.lens.system();
        let object_distance = match self.lens.focus() {
            Focus::Infinity => None,
            _ => self.lens.focus_distance().map(|d| d.0 - FirstOrder::of(system, &system.indices(D_NM)).entrance_pupil_z),
        };
        let bench = Bench { system, object_distance };
        Ok(Spot { bench, offset, across: DVec2::from_array(across), pitch, colors })
    }

    /// Each part at frequencies in cycles a pixel.
    fn parts(&self, spot: &Spot, place: [f64; 2], edge_across: [f64; 2], frequencies: &[f64]) -> Result<Parts, MeasureError> {
        if let Motion::Straight(motion) = self.motion
            && !motion.iter().all(|v| v.is_finite())
        {
            return Err(unfit(format!("motion {motion:?}"), "two finite numbers of pixels"));
        }
        let (across, offset, pitch, colors) = (spot.across, spot.offset, spot.pitch, &spot.colors);
        let radial = if offset.length() > MIDDLE_PX * pitch[0] { offset.normalize() } else { DVec2::Y };
        // Sagittal, tangential; the lens is symmetric about the plane of the field.
        let direction = DVec2::new(across.dot(radial.perp()), across.dot(radial)).normalize();
        let height_mm = offset.length();
        let field = spot.bench.field_of_height(height_mm);
        let per_mm: Vec<f64> = frequencies.iter().map(|f| f / pitch[0]).collect();
        let lens = match self.diffraction {
            false => spot.bench.geometric_response(field, colors, &per_mm, direction, 0.0),
            // Between sagittal and tangential by the squares of the direction's cosines: exact along both, and of a small astigmatism in between.
            true => spot.bench.diffraction_mtf(field, colors, &per_mm, 0.0).map(|m| {
                let parts = m.sagittal.iter().zip(&m.tangential);
                parts.map(|(s, t)| [s * direction.x * direction.x + t * direction.y * direction.y, 0.0]).collect()
            }),
        };
        let lens: Vec<[f64; 2]> = lens.ok_or_else(|| {
            unfit(format!("no light {height_mm:.2} mm from the middle"), "an edge within the lens's image circle")
        })?;

        // Filters of the sensor keep their size in mm, whatever pixels the picture has.
        let sensor = self.sensor;
        let own = sensor.pitch_mm();
        let gap = 1.0 - sensor.fill_factor.sqrt();
        let open = [0, 1].map(|k| (1.0 - gap * own[k] / pitch[k]).max(0.0));
        let shift = sensor.low_pass_px * own[0] / pitch[0];
        let [from, to, step] = COLORS_NM;
        let (light, responses) = (self.light_table()?, sensor.band_responses());
        let of_channel = |c| (from..=to).step_by(step as usize).map(|nm| self.weight(&responses, &light, c, nm)).sum();
        let even: Vec<f64> = (0..responses.len()).map(of_channel).collect();
        let each = |of: &dyn Fn(DVec2) -> f64| frequencies.iter().map(|f| of(across * *f)).collect::<Vec<_>>();
        let aperture = each(&|f| sinc(f.x * open[0]) * sinc(f.y * open[1]));
        let low_pass = each(&|f| (PI * f.x * shift).cos() * (PI * f.y * shift).cos());
        let crosstalk = each(&|f| self.crosstalk(f, &even));
        let motion = self.motion.at(place, edge_across).ok_or_else(|| {
            unfit(
                format!("the place {:.0},{:.0} leaves the picture during the exposure", place[0], place[1]),
                "an edge that the lens shows as long as the shutter is open",
            )
        })?;
        let travel_px = motion.length_px(across);
        let motion = frequencies.iter().map(|f| motion.response(across * *f)).collect();
        Ok(Parts { height_mm, travel_px, lens, aperture, low_pass, crosstalk, motion })
    }

    /// What neighbours add to the pixels of the channel: of other colours they see the same edge with signals of their own (`even`: those of an even
    /// field).
    fn crosstalk(&self, f: DVec2, even: &[f64]) -> f64 {
        let (cfa, c) = (&self.sensor.cfa, self.sensor.crosstalk);
        let [columns, rows] = [cfa.columns(), cfa.rows()];
        let (mut sum, mut all) = (0.0, 0.0);
        for i in (0..columns * rows).filter(|i| cfa.channel_at(i % columns, i / columns) == self.channel) {
            let (x, y) = (i % columns, i / columns);
            let of = |x: usize, y: usize| even[cfa.channel_at(x, y)];
            let own = (1.0 - 4.0 * c) * of(x, y);
            let beside = c * (of(x + 1, y) + of(x + columns - 1, y));
            let above = c * (of(x, y + 1) + of(x, y + rows - 1));
            sum += own + beside * (TAU * f.x).cos() + above * (TAU * f.y).cos();
            all += own + beside + above;
        }
        sum / all
    }
}

impl<'a> Spot<'a> {
    /// What the lens passes at distances across the edge, pixels, in the strongest colour.
    fn light(&self) -> impl Fn(f64) -> f64 + '_ {
        let strongest_nm = self.colors.iter().fold((D_NM, 0.0), |best, c| if c.1 > best.1 { *c } else { best }).0;
        move |px| {
            let place = self.offset + self.across * px * self.pitch[0];
            self.bench.illumination(place.length(), strongest_nm).with_losses
        }
    }
}

/// Largest difference of a measured response from a predicted one up to half a cycle a pixel, and where.
pub(super) fn largest_difference(edge: &EdgeMtf, predicted: &[f64]) -> [f64; 2] {
    let mut largest = [0.0; 2];
    for (k, f) in edge.frequencies.iter().enumerate().filter(|(_, f)| **f <= 0.5) {
        let difference = edge.mtf[k] - predicted[k];
        if difference.abs() > f64::abs(largest[0]) {
            largest = [difference, *f];
        }
    }
    largest
}

/// Places a pixel at which edge and line spread functions are computed.
const PLACES: f64 = 4.0;
/// Places to each side of an edge at which its light is computed; a parabola lies through them.
const LIT: i32 = 4;

/// How an edge is measured: within a window, between levels.
struct Seen<'a> {
    frequencies: &'a [f64],
    window: Window,
    /// Half of its width, pixels.
    half: f64,
    /// Level of the dark side over the step to the light one.
    dark: f64,
    /// Whether the light side is where the direction across the edge points to.
    rises: bool,
}

impl<'a> Seen<'a> {
    fn new(edge: &'a EdgeMtf) -> Self {
        let (window, half) = edge.window;
        let [dark, light] = edge.levels;
        // The edge spread function says on which side its light is.
        let side = |light: bool| edge.esf.iter().filter(move |p| (p[0] > 0.0) == light).map(|p| p[1]);
        let mean = |light: bool| side(light).sum::<f64>() / side(light).count().max(1) as f64;
        let dark = if light > dark { (dark / (light - dark)).max(0.0) } else { 0.0 };
        Seen { frequencies: &edge.frequencies, window, half, dark, rises: mean(true) >= mean(false) }
    }

    /// Places across the edge, pixels, to both sides alike.
    fn places(&self) -> Vec<f64> {
        let n = (self.half * PLACES) as i32;
        (-n..=n).map(|i| f64::from(i) / PLACES).collect()
    }

    /// Light at the places over that at the edge, and its derivative, from what the lens passes at distances across the edge, pixels.
    fn light(&self, at: impl Fn(f64) -> f64) -> Vec<[f64; 2]> {
        let places = self.places();
        let middle = at(0.0);
        if !(middle > 0.0) {
            return vec![[1.0, 0.0]; places.len()];
        }
        // Least squares of 1 + a u + b u², u from −1 to 1: moments of even and odd powers stand apart.
        let (mut odd, mut even, mut squares, mut fourth) = (0.0, 0.0, 0.0, 0.0);
        for u in (-LIT..=LIT).map(|k| f64::from(k) / f64::from(LIT)) {
            let v = at(u * self.half) / middle - 1.0;
            odd += u * v;
            even += u * u * v;
            squares += u * u;
            fourth += u.powi(4);
        }
        let (a, b) = (odd / squares, even / fourth);
        let one = |x: &f64| {
            let u = x / self.half;
            [1.0 + a * u + b * u * u, (a + 2.0 * b * u) / self.half]
        };
        places.iter().map(one).collect()
    }

    /// The response that an edge shows of one (at the frequencies, in even steps from 0) whose line spread function is even; under light that differs across the
    /// edge by [`Seen::light`].
    fn response(&self, response: &[f64], light: Option<&[[f64; 2]]>) -> Vec<f64> {
        /// Steps between two frequencies: the line spread function repeats after so many times the reciprocal of their distance.
        const FINER: usize = 8;
        let [first, second, ..] = *self.frequencies else { return response.to_vec() };
        if !(self.half > 0.0 && self.half.is_finite()) {
            return response.to_vec();
        }
        // Between given frequencies by cubics through the four around (E. Catmull & R. Rom 1974); even about 0.
        let at = |k: isize| response[(k.unsigned_abs()).min(response.len() - 1)];
        let fine: Vec<f64> = (0..=(response.len() - 1) * FINER)
            .map(|i| {
                let (k, t) = ((i / FINER) as isize, (i % FINER) as f64 / FINER as f64);
                let [a, b, c, d] = [at(k - 1), at(k), at(k + 1), at(k + 2)];
                b + 0.5 * t * (c - a + t * (2.0 * a - 5.0 * b + 4.0 * c - d + t * (3.0 * (b - c) + d - a)))
            })
            .collect();
        let step = (second - first) / FINER as f64;
        let places = self.places();
        let middle = places.len() / 2;
        // Even: half of the frequencies twice, the one in the middle once; and half of the places.
        let once = |k: usize| if k == 0 { 1.0 } else { 2.0 };
        let half: Vec<f64> = places[middle..]
            .iter()
            .map(|x| {
                let sum: f64 = fine.iter().enumerate().map(|(k, r)| once(k) * r * (TAU * step * k as f64 * x).cos()).sum();
                step * sum
            })
            .collect();
        let line = |i: usize| half[i.abs_diff(middle)];
        // The edge is half way up in the middle.
        let (mut up, mut edge) = (0.0, Vec::with_capacity(places.len()));
        for i in 0..places.len() {
            up += if i == 0 { 0.0 } else { 0.5 * (line(i - 1) + line(i)) / PLACES };
            edge.push(up);
        }
        let shift = 0.5 - edge[middle];
        let spread: Vec<f64> = (0..places.len())
            .map(|i| {
                let blurred = match light {
                    None => line(i),
                    Some(light) => {
                        let [level, slope] = light[i];
                        let (rise, up) = match self.rises {
                            true => (line(i), edge[i] + shift),
                            false => (-line(i), 1.0 - edge[i] - shift),
                        };
                        level * rise + slope * (self.dark + up)
                    }
                };
                blurred * self.window.at(places[i] / self.half)
            })
            .collect();
        let transform = |f: f64| {
            let (re, im) = spread.iter().zip(&places).fold((0.0, 0.0), |(re, im), (s, x)| {
                let (sin, cos) = (TAU * f * x).sin_cos();
                (re + s * cos, im + s * sin)
            });
            f64::hypot(re, im)
        };
        let all = transform(0.0);
        self.frequencies.iter().map(|f| transform(*f) / all).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::Region;
    use diopter_lens::compound::Setting;
    use diopter_lens::embedded;
    use std::sync::Arc;

    fn edge(across: [f64; 2]) -> EdgeMtf {
        EdgeMtf {
            region: Region { x: 0, y: 0, width: 64, height: 64 },
            horizontal: false,
            angle_deg: 0.0,
            across,
            middle: [300.0, 200.0],
            residual_px: 0.0,
            bow_px: 0.0,
            levels: [0.1, 0.4],
            contrast: 0.6,
            noise: 0.0,
            frequencies: (0..=100).map(|k| f64::from(k) / 100.0).collect(),
            mtf: vec![1.0; 101],
            mtf50: None,
            mtf10: None,
            at_nyquist: 1.0,
            esf: vec![],
            window: (Window::Tukey { alpha: 0.5 }, 80.0),
            reach_px: 80.0,
        }
    }

    #[test]
    fn the_chain_is_the_product_of_its_parts() {
        let setting =
            Setting { focal_length: None, f_number: Some(4.0), focus: Focus::Infinity, iris: None, film_mm: [36.0, 24.0] };
        let lens = CompoundLens::new(Arc::new(embedded("double-gauss-50mm").unwrap()), &setting).unwrap();
        let mut sensor = Sensor::named("canon-t2i").unwrap();
        (sensor.low_pass_px, sensor.crosstalk, sensor.fill_factor) = (0.5, 0.02, 0.81);
        let [w, h] = sensor.pitch_mm();
        let size = [600, 400];
        let film_mm = [600.0 * w, 400.0 * h];
        let still = Motion::Straight([0.0; 2]);
        let chain =
            Chain { lens: &lens, sensor: &sensor, channel: 1, light: "D65", film_mm, size, diffraction: false, motion: still };
        let p = chain.predict(&edge([1.0, 0.0])).unwrap();
        assert!(p.height_mm < 1e-9 && p.product[0] == p.lens[0] && (p.lens[0] - 1.0).abs() < 1e-9);
        // Nyquist: sinc(0.45), cos(π/4), and neighbours beside it that count against it. R and B lie beside green, as bright together as they are.
        let half = 50;
        assert!((p.aperture[half] - sinc(0.45)).abs() < 1e-12 && (p.low_pass[half] - (0.25 * PI).cos()).abs() < 1e-12);
        assert!(p.crosstalk[half] < 1.0 && p.crosstalk[half] > 0.9, "{}", p.crosstalk[half]);
        let product = p.lens[half] * p.aperture[half] * p.low_pass[half] * p.crosstalk[half];
        assert!((p.product[half] - product).abs() < 1e-12);
        // Nothing falls beyond a wide window.
        assert!(
            p.windowed.iter().zip(&p.product).take(70).all(|(w, p)| (w - p).abs() < 2e-3),
            "{:?} {:?}",
            p.windowed,
            p.product
        );
        // The edge that was "measured" has full contrast: the difference is largest where the chain leaves least.
        assert!((p.largest_difference[0] - (1.0 - p.product[half])).abs() < 0.05, "{:?}", p.largest_difference);
        // Along an edge nothing is lost; across it what a box as long as the motion leaves, with its first zero at one cycle in its length.
        let moved = |motion| Chain { motion: Motion::Straight(motion), ..chain }.predict(&edge([1.0, 0.0])).unwrap();
        assert_eq!(moved([0.0, 7.0]).product, p.product);
        let across = moved([-1.2, 7.0]);
        assert!((across.product[half] - p.product[half] * sinc(0.6)).abs() < 1e-12);
        assert!(moved([2.0, 0.0]).motion[half] < 1e-12);
        // A sensor of one colour, all neighbours alike: 1 − 2c (1 − cos 2πf).
        let mono = Sensor { crosstalk: 0.02, ..Sensor::named("imx249").unwrap() };
        let chain = Chain { sensor: &mono, channel: 0, ..chain };
        let p = chain.predict(&edge([1.0, 0.0])).unwrap();
        assert!((p.crosstalk[half] - 0.92).abs() < 1e-9, "{}", p.crosstalk[half]);
        assert!(Chain { light: "D64", ..chain }.predict(&edge([1.0, 0.0])).is_err());
    }

    #[test]
    fn a_halo_beyond_the_window_is_not_seen() {
        // Nine tenths of the light in a narrow line, one tenth in a halo 12 pixels wide (sigma), of which a window of 8 pixels sees part.
        let gauss = |f: f64, sigma: f64| (-2.0 * (PI * f * sigma).powi(2)).exp();
        let frequencies: Vec<f64> = (0..=100).map(|k| f64::from(k) / 100.0).collect();
        let response: Vec<f64> = frequencies.iter().map(|f| 0.9 * gauss(*f, 0.7) + 0.1 * gauss(*f, 12.0)).collect();
        let window = Window::Tukey { alpha: 1.0 };
        let seen = Seen { frequencies: &frequencies, window, half: 8.0, dark: 0.2, rises: true };
        let found = seen.response(&response, None);
        // The same in space.
        let line =
            |x: f64| [(0.9, 0.7), (0.1, 12.0)].map(|(part, s)| part / s * (-0.5 * (x / s).powi(2)).exp()).iter().sum::<f64>();
        let sum = |f: f64| {
            (-800..=800).map(|i| f64::from(i) / 100.0).map(|x| line(x) * window.at(x / 8.0) * (TAU * f * x).cos()).sum::<f64>()
        };
        for (f, found) in frequencies.iter().zip(&found).take(60) {
            assert!((found - sum(*f) / sum(0.0)).abs() < 1e-3, "{f}: {found} {}", sum(*f) / sum(0.0));
        }
        // Without it a tenth is missing at once.
        assert!(response[5] < 0.9 && found[5] > 0.93, "{} {}", response[5], found[5]);
    }
    #[test]
    fn light_that_falls_off_is_in_the_response_as_it_is_in_the_edge() {
        // An edge from 1 to 4 with a Gaussian blur, under light that falls by 2 % over 20 pixels: by the derivative of the edge itself.
        let (sigma, half) = (1.2, 24.0);
        let frequencies: Vec<f64> = (0..=100).map(|k| f64::from(k) / 100.0).collect();
        let response: Vec<f64> = frequencies.iter().map(|f| (-2.0 * (PI * f * sigma).powi(2)).exp()).collect();
        let window = Window::Tukey { alpha: 0.5 };
        let shade = |x: f64| 1.0 - 0.001 * x - 5e-6 * x * x;
        for (rises, sign) in [(true, 1.0), (false, -1.0)] {
            let seen = Seen { frequencies: &frequencies, window, half, dark: 1.0 / 3.0, rises };
            let found = seen.response(&response, Some(&seen.light(shade)));
            // Cumulative by small steps.
            let h = 0.01;
            let n = (half / h) as i32;
            let gauss = |x: f64| (-0.5 * (x / sigma).powi(2)).exp() / (sigma * TAU.sqrt());
            let mut up = 0.0;
            let edge: Vec<f64> = (-n..=n)
                .map(|i| {
                    let x = f64::from(i) * h;
                    up += h * gauss(x);
                    shade(x) * (1.0 + 3.0 * if sign > 0.0 { up } else { 1.0 - up })
                })
                .collect();
            let transform = |f: f64| {
                let (mut re, mut im) = (0.0, 0.0);
                for i in 1..edge.len() - 1 {
                    let x = (i as f64 - f64::from(n)) * h;
                    let v = (edge[i + 1] - edge[i - 1]) * window.at(x / half);
                    re += v * (TAU * f * x).cos();
                    im += v * (TAU * f * x).sin();
                }
                f64::hypot(re, im)
            };
            for (k, f) in frequencies.iter().enumerate().take(60) {
                let exact = transform(*f) / transform(0.0);
                assert!((found[k] - exact).abs() < 1e-3, "{rises} {f}: {} {exact}", found[k]);
            }
            // On the rising side light that falls takes from the step, and more than blur alone is left; on the other it adds.
            let plain = seen.response(&response, None);
            assert!(sign * (found[3] - plain[3]) > 0.005, "{rises}: {} {}", found[3], plain[3]);
        }
    }
}
