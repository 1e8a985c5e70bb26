//! How large the image of a point is: from where its light arrives, and what pixel, low-pass filter, crosstalk and development make of it.
//!
//! A *blur radius* is the root mean square radius of the Gaussian whose response falls to one half at the same spatial frequency as that of the image:
//! exp(−2π²σ²f²) = ½ at f = √(ln 2 / 2) / (πσ), radius √2 σ; σ² is the mean over eight directions on the film. Unlike the root mean square radius of
//! the image itself it exists for diffraction, whose irradiance falls with the cube of the distance only, and is what edges show.
//! For Gaussian blurs both are the same, and squares add.
//!
//! The response of the whole is that of the points where light arrives times those of pixel aperture (sinc), low-pass filter (cos) and crosstalk, as in
//! [`crate::measure::predict`], times the Gaussian that the development adds ([`super::development`]).

use super::spot::Spot;
use crate::camera::Film;
use crate::measure::mtf::sinc;
use glam::DVec2;
use rayon::prelude::*;
use serde::Serialize;
use std::f64::consts::{LN_2, PI, SQRT_2, TAU};

/// Directions over half a turn along which the response is looked at.
const DIRECTIONS: usize = 8;
/// The search for one half begins where a root mean square radius allows a loss of 5 % at most, and goes on in steps of 3 % ...
const FIRST: f64 = 0.05;
const GROWTH: f64 = 1.03;
/// ... up to 5000 times that: what is still sharp there is sharp in that direction.
const MOST_STEPS: usize = 390;
const HALVINGS: usize = 24;

/// The size of the image of a point.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Blur {
    /// Blur radius on the film, µm.
    pub radius_um: f64,
    /// The same in pixels of the picture.
    pub radius_px: f64,
    /// Frequency at which the response of a Gaussian of this radius falls to one half, cycles/mm; `None` where nothing blurs.
    pub mtf50_per_mm: Option<f64>,
    /// The same in cycles a pixel.
    pub mtf50_per_px: Option<f64>,
    /// Root mean square radius, µm, without diffraction (whose own is infinite) and without the development. Where a real lens diffracts, its aberration in the
    /// plane of focus belongs to the pattern of diffraction and is not in this number either.
    pub rms_um: f64,
    /// Direction in the picture in which it is widest, degrees from right towards up, 0 to 180.
    pub widest_deg: f64,
    /// Blur radius of what is as wide in all directions as this is there, µm.
    pub widest_um: f64,
}

/// What follows behind the lens.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Filters {
    /// Light-sensitive width of a pixel, across and down, mm.
    pub aperture_mm: [f64; 2],
    /// Distance of the two images of the low-pass filter along each axis, mm.
    pub low_pass_mm: f64,
    /// Fraction of a pixel's charge that each neighbour gets.
    pub crosstalk: f64,
    /// Distance of pixels, across and down, mm.
    pub pitch_mm: [f64; 2],
    /// Variance along an axis that demosaicing and noise reduction add, px².
    pub development_px2: [f64; 2],
}

impl Filters {
    /// What blurs on a film with these pixels; `crosstalk`: fraction that each neighbour gets; `development_px2`: variance along each axis, px².
    pub fn new(film: &Film, crosstalk: f64, development_px2: [f64; 2]) -> Filters {
        let pitch_mm = [film.width_mm / film.columns as f64, film.height_mm / film.rows as f64];
        let aperture_mm = [0, 1].map(|k| (pitch_mm[k] - film.gap_mm[k]).max(0.0));
        Filters { aperture_mm, low_pass_mm: film.low_pass_mm, crosstalk, pitch_mm, development_px2 }
    }

    /// Mean distance of pixels, mm.
    fn pixel_mm(&self) -> f64 {
        (self.pitch_mm[0] * self.pitch_mm[1]).sqrt()
    }

    fn response(&self, f: DVec2) -> f64 {
        let [w, h] = self.aperture_mm;
        let [px, py] = self.pitch_mm;
        let aperture = sinc(f.x * w) * sinc(f.y * h);
        let low_pass = (PI * f.x * self.low_pass_mm).cos() * (PI * f.y * self.low_pass_mm).cos();
        let crosstalk = 1.0 - 2.0 * self.crosstalk * (2.0 - (TAU * f.x * px).cos() - (TAU * f.y * py).cos());
        let variance = self.development_px2.iter().sum::<f64>().max(0.0) * self.pixel_mm().powi(2);
        aperture * low_pass * crosstalk * (-2.0 * PI * PI * variance * f.length_squared()).exp()
    }

    /// Mean square radius, mm²: of boxes, pairs of points and fractions of neighbours. The development is left out.
    fn mean_square(&self) -> f64 {
        let [w, h] = self.aperture_mm;
        let [px, py] = self.pitch_mm;
        (w * w + h * h) / 12.0 + 0.5 * self.low_pass_mm.powi(2) + 2.0 * self.crosstalk * (px * px + py * py)
    }
}

/// Where light lands, about its mean, and how much of it.
struct Points(Vec<(DVec2, f64)>);

impl Points {
    fn of(spot: &Spot, diffracted: bool) -> Points {
        let all = spot.arrivals.iter().map(|a| a.weight).sum::<f64>();
        let place = |a: &super::spot::Arrival| if diffracted { a.at_mm + a.displaced_mm } else { a.at_mm };
        let mean = spot.arrivals.iter().map(|a| place(a) * (a.weight / all)).sum::<DVec2>();
        Points(spot.arrivals.iter().map(|a| (place(a) - mean, a.weight / all)).collect())
    }

    fn mean_square(&self) -> f64 {
        self.0.iter().map(|(p, w)| p.length_squared() * w).sum()
    }

    fn response(&self, f: DVec2) -> f64 {
        let sum = self.0.iter().map(|(p, w)| {
            let (sin, cos) = (TAU * f.dot(*p)).sin_cos();
            DVec2::new(cos, sin) * *w
        });
        sum.sum::<DVec2>().length()
    }
}

/// The blur of an image of a point.
pub(super) fn blur(spot: &Spot, filters: &Filters) -> Blur {
    let [geometric, points] = [false, true].map(|diffracted| Points::of(spot, diffracted));
    let pixel_mm = filters.pixel_mm();
    let added = filters.development_px2.iter().sum::<f64>().max(0.0) * pixel_mm * pixel_mm;
    let extent = (points.mean_square() + filters.mean_square() + 2.0 * added).sqrt();
    let rms_um = 1e3 * (geometric.mean_square() + filters.mean_square()).sqrt();
    if !(extent > 0.0) {
        return Blur::default();
    }
    let variance = |direction: DVec2| {
        let response = |f: f64| points.response(direction * f) * filters.response(direction * f).abs();
        let mut low = FIRST / extent;
        for _ in 0..MOST_STEPS {
            let mut high = low * GROWTH;
            if response(high) < 0.5 {
                for _ in 0..HALVINGS {
                    let middle = 0.5 * (low + high);
                    if response(middle) < 0.5 { high = middle } else { low = middle }
                }
                return 0.5 * LN_2 / (PI * high).powi(2);
            }
            low = high;
        }
        0.0
    };
    let angle = |k: usize| PI * k as f64 / DIRECTIONS as f64;
    // The picture stands upside down and mirrored on the film; to the right in the picture is −x, up is −y.
    let variances: Vec<f64> =
        (0..DIRECTIONS).into_par_iter().map(|k| variance(DVec2::new(-angle(k).cos(), -angle(k).sin()))).collect();
    let mean = variances.iter().sum::<f64>() / DIRECTIONS as f64;
    let widest = (0..DIRECTIONS).fold(0, |best, k| if variances[k] > variances[best] { k } else { best });
    let mtf50 = (mean > 0.0).then(|| (0.5 * LN_2).sqrt() / (PI * mean.sqrt()));
    Blur {
        radius_um: 1e3 * SQRT_2 * mean.sqrt(),
        radius_px: SQRT_2 * mean.sqrt() / pixel_mm,
        mtf50_per_mm: mtf50,
        mtf50_per_px: mtf50.map(|f| f * pixel_mm),
        rms_um,
        widest_deg: angle(widest).to_degrees(),
        widest_um: 1e3 * SQRT_2 * variances[widest].sqrt(),
    }
}

#[cfg(test)]
mod tests {
    use super::super::spot::Arrival;
    use super::*;

    fn spot(places: impl Iterator<Item = DVec2>) -> Spot {
        let arrivals = places.map(|at_mm| Arrival { at_mm, displaced_mm: DVec2::ZERO, weight: 1.0 }).collect();
        Spot { arrivals, exposure: 1.0 }
    }

    #[test]
    fn a_gaussian_has_its_own_radius_and_squares_add() {
        // By quantiles of radius and even angles: 2σ² = −mean of 2σ² ln(1 − u).
        let n = 2048;
        let golden = 0.618_033_988_749_895;
        let place = |i: usize| {
            let radius = (-2.0 * (1.0 - (i as f64 + 0.5) / n as f64).ln()).sqrt() * 0.01;
            DVec2::from_angle(TAU * (i as f64 * golden).fract()) * radius
        };
        let spot = spot((0..n).map(place));
        let own = blur(&spot, &Filters { pitch_mm: [0.005; 2], ..Filters::default() });
        assert!((own.radius_um / (10.0 * SQRT_2) - 1.0).abs() < 0.01, "{own:?}");
        assert!((own.rms_um / (10.0 * SQRT_2) - 1.0).abs() < 0.01 && (own.radius_px / (2.0 * SQRT_2) - 1.0).abs() < 0.01);
        // A development that adds as much again, (2 px)² along an axis.
        let more = blur(&spot, &Filters { pitch_mm: [0.005; 2], development_px2: [3.0, 1.0], ..Filters::default() });
        assert!((more.radius_um.powi(2) / own.radius_um.powi(2) - 2.0).abs() < 0.02, "{more:?}");
    }

    #[test]
    fn a_pixel_is_a_box() {
        // sinc(x) = ½ at x = 0.60335. Along the diagonal both sides count: sinc²(x / √2) = ½ at x = 0.62642 (0.44295 √2).
        let filters = Filters { aperture_mm: [0.01; 2], pitch_mm: [0.01; 2], ..Filters::default() };
        let found = blur(&spot(std::iter::once(DVec2::ZERO)), &filters);
        let sigma = |f50: f64| (0.5 * LN_2).sqrt() / (PI * f50) * 10.0;
        let [along, diagonal] = [0.603_35, 0.626_42].map(|x| SQRT_2 * sigma(x));
        assert!((found.widest_um / along - 1.0).abs() < 2e-3, "{found:?} {along}");
        assert!((diagonal..along).contains(&found.radius_um), "{found:?}");
        // Variance of a box, a twelfth, along each axis.
        assert!((found.rms_um - 10.0 / 6f64.sqrt()).abs() < 1e-9);
    }

    #[test]
    fn a_streak_is_wide_along_itself_alone() {
        // To the upper right in the picture: left and up on the film, whose y grows downwards in the picture.
        let n = 2001;
        let place = |i: usize| DVec2::new(-1.0, -1.0).normalize() * 0.05 * ((i as f64 + 0.5) / n as f64 - 0.5);
        let filters = Filters { aperture_mm: [0.001; 2], pitch_mm: [0.001; 2], ..Filters::default() };
        let found = blur(&spot((0..n).map(place)), &filters);
        assert_eq!(found.widest_deg, 45.0);
        let along = 50.0 * SQRT_2 * (0.5 * LN_2).sqrt() / (PI * 0.603_35);
        assert!((found.widest_um / along - 1.0).abs() < 2e-3, "{found:?} {along}");
    }
}
