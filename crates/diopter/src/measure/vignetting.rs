//! Relative illumination over the image height, from the picture of a flat field.
//!
//! Light falls off from the middle by vignetting, by cos⁴ and by the pixels' own angles: all of it is measured together. Means over rings are
//! smoothed by parabolas through their neighbours (W. S. Cleveland 1979, local regression): lens rims cut the beam from a height on, and no
//! polynomial in r² follows that. Beside them an even polynomial is fitted, E(r) = E₀ (1 + a₁ r² + a₂ r⁴ + a₃ r⁶), r the image height over half of the
//! diagonal (the form of DNG's FixVignetteRadial, DNG specification 1.7, opcode 3), E₀ being the light in the middle. The four corners are given
//! apart: where they differ, the field was not even or the lens is not centred.

use super::fit::least_squares;
use super::{MeasureError, Plane, Region};
use serde::Serialize;

/// Rings.
const RINGS: usize = 64;
/// Image heights to each side over which rings are smoothed, and from the middle outwards there, where they are small.
const SMOOTHED: f64 = 0.1;
const SMOOTHED_IN_MIDDLE: f64 = 0.12;
/// Side of the squares in the corners, of the shorter side of the picture.
const CORNER: f64 = 0.05;
/// Fraction of the samples that may be clipped.
const MOST_CLIPPED: f64 = 0.01;
/// Root mean square of what the fit leaves in the rings' means, of the mean, beyond which the picture shows more than a flat field.
const MOST_RESIDUAL: f64 = 0.05;

/// Illumination at an image height.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Ring {
    /// Image height over half of the diagonal.
    pub height: f64,
    /// Mean of the ring over the light in the middle.
    pub illumination: f64,
    /// Samples in it.
    pub samples: f64,
}

/// How light falls off.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Vignetting {
    /// From the middle outwards.
    pub rings: Vec<Ring>,
    /// a₁, a₂, a₃.
    pub coefficients: [f64; 3],
    /// Root mean square of what the polynomial leaves in the rings, relative to the middle.
    pub residual: f64,
    /// Illumination of the corners relative to the middle: upper left, upper right, lower left, lower right.
    pub corners: [f64; 4],
}

impl Vignetting {
    /// Illumination at an image height (over half of the diagonal) relative to the middle, by the rings about it.
    pub fn at(&self, height: f64) -> f64 {
        smoothed(&self.rings, height)
    }

    /// The same by the polynomial.
    pub fn fitted(&self, height: f64) -> f64 {
        let r2 = height * height;
        self.coefficients.iter().rev().fold(0.0, |sum, a| (sum + a) * r2) + 1.0
    }

    /// Loss in the corners on average, EV.
    pub fn corner_ev(&self) -> f64 {
        -(self.corners.iter().sum::<f64>() / 4.0).log2()
    }
}

/// Illumination at a height by the parabola through the rings about it, the nearer the more they count.
fn smoothed(rings: &[Ring], height: f64) -> f64 {
    let reach = SMOOTHED.max(SMOOTHED_IN_MIDDLE - height);
    let near = |ring: &Ring| {
        let off = (ring.height - height).abs() / reach;
        (off < 1.0).then(|| (1.0 - off.powi(3)).powi(3) * ring.samples)
    };
    let rows = rings.iter().filter_map(|ring| {
        let weight = near(ring)?.sqrt();
        let off = (ring.height - height) / reach;
        Some(([1.0, off, off * off].map(|v| v * weight).to_vec(), weight * ring.illumination))
    });
    match least_squares(rows, 3) {
        Some(parabola) => parabola[0],
        // So few rings that one alone is near.
        None => {
            let off = |ring: &&Ring| (ring.height - height).abs();
            rings.iter().min_by(|a, b| off(a).total_cmp(&off(b))).map_or(f64::NAN, |ring| ring.illumination)
        }
    }
}

/// Measures the picture of a flat field. Fails below 32 pixels a side, where more than 1 % of it is clipped, without light, and where rings deviate by 5 % from a smooth
/// fall-off.
pub fn measure(plane: &Plane) -> Result<Vignetting, MeasureError> {
    plane.check(plane.whole(), 32)?;
    let [low, high] = plane.clipped(plane.whole());
    if low.max(high) > MOST_CLIPPED {
        return Err(MeasureError::unfit(
            "flat field",
            format!("{:.1} % of its pixels are clipped", 100.0 * low.max(high)),
            "all of it between black and white: expose it otherwise",
        ));
    }
    let (w, h) = (plane.width as f64, plane.height as f64);
    let diagonal = 0.5 * w.hypot(h);
    let mut rings = [(0.0, 0.0, 0.0f64); RINGS];
    for (i, v) in plane.values.iter().enumerate().filter(|(_, v)| !v.is_nan()) {
        let (x, y) = ((i % plane.width) as f64 + 0.5 - 0.5 * w, (i / plane.width) as f64 + 0.5 - 0.5 * h);
        let height = x.hypot(y) / diagonal;
        let ring = &mut rings[((height * RINGS as f64) as usize).min(RINGS - 1)];
        (ring.0, ring.1, ring.2) = (ring.0 + height * height, ring.1 + f64::from(*v), ring.2 + 1.0);
    }
    let ring = |(r2, light, n): (f64, f64, f64)| Ring { height: (r2 / n).sqrt(), illumination: light / n, samples: n };
    let mut rings: Vec<Ring> = rings.into_iter().filter(|r| r.2 > 0.0).map(ring).collect();
    let middle = smoothed(&rings, 0.0);
    if !(middle > 0.0) {
        return Err(MeasureError::unfit("flat field", "no light in its middle", "an evenly lit field that fills the picture"));
    }
    rings.iter_mut().for_each(|ring| ring.illumination /= middle);
    let rows = rings.iter().map(|ring| {
        let (r2, weight) = (ring.height.powi(2), ring.samples.sqrt());
        ([r2, r2.powi(2), r2.powi(3)].map(|v| v * weight).to_vec(), (ring.illumination - 1.0) * weight)
    });
    let coefficients = least_squares(rows, 3).map_or([0.0; 3], |c| [c[0], c[1], c[2]]);
    let side = ((CORNER * w.min(h)) as usize).max(4);
    let [right, below] = [plane.width - side, plane.height - side];
    let corners = [[0, 0], [right, 0], [0, below], [right, below]].map(|[x, y]| {
        let (mut sum, mut count) = (0.0, 0.0f64);
        plane.samples(Region { x, y, width: side, height: side }).for_each(|v| (sum, count) = (sum + v, count + 1.0));
        sum / count.max(1.0) / middle
    });
    let mut found = Vignetting { rings, coefficients, residual: 0.0, corners };
    let total: f64 = found.rings.iter().map(|ring| ring.samples).sum();
    let off = |ring: &Ring| ring.samples * (ring.illumination - found.fitted(ring.height)).powi(2);
    let squares = found.rings.iter().map(off).sum::<f64>();
    found.residual = (squares / total).sqrt();
    if !(found.residual < MOST_RESIDUAL) {
        return Err(MeasureError::unfit(
            "flat field",
            format!("rings deviate by {:.1} % from a smooth fall-off", 100.0 * found.residual),
            "an evenly lit field that fills the picture (\"flat-field\")",
        ));
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field(light: impl Fn(f64, f64) -> f64) -> Plane {
        let (width, height) = (240, 160);
        let diagonal = 0.5 * 240f64.hypot(160.0);
        let value = |i: usize| {
            let (x, y) = ((i % width) as f64 + 0.5 - 120.0, (i / width) as f64 + 0.5 - 80.0);
            light(x / diagonal, y / diagonal) as f32
        };
        Plane { width, height, values: (0..width * height).map(value).collect(), limits: [0.0, 1.0], clipped: None }
    }

    #[test]
    fn a_known_fall_off_is_found() {
        // cos⁴ at a field of 35° in the corners: not a polynomial, but within 0.1 % of one.
        let cos4 = |r: f64| (1.0 + (r * 35f64.to_radians().tan()).powi(2)).powi(-2);
        let found = measure(&field(|x, y| 0.6 * cos4(x.hypot(y)))).unwrap();
        for r in [0.0, 0.3, 0.6, 0.9] {
            assert!((found.at(r) - cos4(r)).abs() < 2e-3, "{r}: {} {}", found.at(r), cos4(r));
        }
        // Squares of 8 pixels: their middles lie at 0.972 of the half diagonal and their mean on either side of it.
        assert!(found.corners.iter().all(|c| (c - cos4(0.965)).abs() < 0.01), "{:?}", found.corners);
        assert!((found.corner_ev() + cos4(0.965).log2()).abs() < 0.04, "{}", found.corner_ev());
    }

    #[test]
    fn rims_that_cut_the_beam_from_a_height_on_are_followed() {
        // No polynomial in r²: that is 2 % off in the middle.
        let light = |r: f64| if r < 0.1 { 1.0 } else { 1.0 - 0.7 * (r - 0.1) };
        let found = measure(&field(|x, y| 0.5 * light(x.hypot(y)))).unwrap();
        for r in [0.0, 0.2, 0.3, 0.5, 0.8, 0.95] {
            assert!((found.at(r) - light(r)).abs() < 5e-3, "{r}: {} {}", found.at(r), light(r));
        }
        assert!(found.residual > 2e-3, "{}", found.residual);
    }

    #[test]
    fn raw_mosaics_are_measured_in_one_channel() {
        let mut plane = field(|x, y| 0.5 - 0.2 * (x * x + y * y));
        (0..240 * 160).filter(|i| (i % 240 + i / 240) % 2 == 0).for_each(|i| plane.values[i] = f32::NAN);
        let found = measure(&plane).unwrap();
        assert!((found.coefficients[0] + 0.4).abs() < 2e-3 && (found.at(1.0) - 0.6).abs() < 2e-3, "{found:?}");
    }

    #[test]
    fn what_is_no_flat_field_is_refused() {
        let told = |light: &dyn Fn(f64, f64) -> f64| measure(&field(light)).unwrap_err().to_string();
        assert!(told(&|_, _| 1.0).contains("clipped"));
        assert!(told(&|x, y| if (x * x + y * y) * 40.0 % 2.0 < 1.0 { 0.2 } else { 0.8 }).contains("smooth fall-off"));
    }
}
