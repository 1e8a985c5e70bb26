//! Where the image of a place travels while its pixel is open, and what that leaves of the response.
//!
//! Camera and subject move as the shot says: the scene point that the chief ray of the place meets halfway through the time of its pixel is followed, and its
//! image by chief rays. The response is the Fourier transform of the time that the image spends at each place (G. D. Boreman, *Modulation Transfer Function
//! in Optical and Electro-Optical Systems*, SPIE 2001, section 2.5: of constant speed a sinc).

use super::mtf::sinc;
use crate::shot::Shot;
use crate::shutter::Place;
use crate::why::spot::Subject;
use glam::DVec2;
use std::f64::consts::TAU;

/// Moments at which the image is looked for, and moments of a window that are summed.
const MOMENTS: usize = 65;
const SUMMED: usize = 128;
/// Rings of the pupil, each with a window of its own where blades open from its middle.
const RINGS: usize = 8;
/// From an edge to the places beside it where the surfaces are looked for, pixels: the nearer one is the object whose edge it is.
const BESIDE_PX: f64 = 3.0;

/// How the image of the chart moves during the exposure.
#[derive(Clone, Copy)]
pub enum Motion<'a> {
    /// At constant speed: pixels to the right and down from beginning to end.
    Straight([f64; 2]),
    /// As camera and subject of a shot do, which must have been metered ([`Shot::meter`]).
    Of(&'a Shot),
}

/// Motion of the image of a place.
#[derive(Clone, Debug, PartialEq)]
pub enum ImageMotion {
    /// At constant speed: pixels to the right and down.
    Straight(DVec2),
    /// Places (pixels from where it is halfway) and the time at each.
    Places(Vec<(DVec2, f64)>),
}

impl Motion<'_> {
    /// The motion at a place of the picture (pixels) on an edge across a direction; `None` where the lens does not show what is there all of the time. `across`: unit
    /// vector, right and down.
    pub fn at(&self, place: [f64; 2], across: [f64; 2]) -> Option<ImageMotion> {
        match self {
            Motion::Straight(travel) => Some(ImageMotion::Straight(DVec2::from_array(*travel))),
            Motion::Of(shot) => of_nearer_surface(shot, DVec2::from_array(place), DVec2::from_array(across)),
        }
    }
}

impl ImageMotion {
    /// Response at a frequency (cycles a pixel, right and down): real and imaginary part, the latter positive where light lies ahead.
    pub fn response(&self, frequency: DVec2) -> [f64; 2] {
        match self {
            ImageMotion::Straight(travel) => [sinc(frequency.dot(*travel)), 0.0],
            ImageMotion::Places(all) => {
                let (mut sums, mut time) = ([0.0; 2], 0.0);
                for (place, weight) in all {
                    let (sin, cos) = (TAU * frequency.dot(*place)).sin_cos();
                    sums[0] += weight * cos;
                    sums[1] += weight * sin;
                    time += weight;
                }
                sums.map(|s| if time > 0.0 { s / time } else { 0.0 })
            }
        }
    }

    /// Largest distance between two of its places along a direction, pixels.
    pub fn length_px(&self, direction: DVec2) -> f64 {
        match self {
            ImageMotion::Straight(travel) => travel.dot(direction).abs(),
            ImageMotion::Places(all) => {
                let ends = all.iter().map(|p| p.0.dot(direction)).fold([f64::MAX, f64::MIN], |[a, b], v| [a.min(v), b.max(v)]);
                (ends[1] - ends[0]).max(0.0)
            }
        }
    }
}

/// Motion of the nearer of the surfaces on both sides of an edge.
fn of_nearer_surface(shot: &Shot, place: DVec2, across: DVec2) -> Option<ImageMotion> {
    let still = Some(ImageMotion::Straight(DVec2::ZERO));
    if !shot.scene.moves() && shot.camera.motion.is_still() {
        return still;
    }
    let shutter = shot.shutter();
    let film = &shot.camera.film;
    let size = [film.columns, film.rows];
    let seen = |side: f64| {
        let subject = Subject::seen(&shot.scene, &shot.camera, &shutter, shot.at_s(), place + across * side * BESIDE_PX)?;
        let distance = subject.surface.as_ref().map_or(f64::INFINITY, |s| f64::from(s.t));
        Some((distance, subject))
    };
    let sides = [-1.0, 1.0].map(seen);
    let (_, subject) = sides.into_iter().flatten().min_by(|a, b| a.0.total_cmp(&b.0))?;
    // Blades in the pupil let light through its parts at times of their own; rings of equal area.
    let most = (shot.camera.lens.widest_f_number() / shot.camera.lens.f_number()).min(1.0);
    let pupils = (0..RINGS).map(|k| most * ((k as f64 + 0.5) / RINGS as f64).sqrt());
    let windows: Vec<(f64, f64)> = pupils
        .map(|pupil| shutter.window(&Place { pixel: subject.pixel, size, pupil }))
        .filter(|(open, close)| open < close)
        .collect();
    let (open, close) = windows.iter().fold((f64::MAX, f64::MIN), |(a, b), w| (a.min(w.0), b.max(w.1)));
    if !(close > open) {
        return still;
    }
    let step = (close - open) / (MOMENTS - 1) as f64;
    let path = subject.path(&shot.camera, (0..MOMENTS).map(|k| open + step * k as f64))?;
    let at = |time: f64| {
        let t = ((time - open) / step).clamp(0.0, (MOMENTS - 1) as f64);
        let k = (t as usize).min(MOMENTS - 2);
        path[k].lerp(path[k + 1], t - k as f64)
    };
    let middle = at(subject.time_s);
    let of_window = |(open, close): &(f64, f64)| {
        let (open, span) = (*open, close - open);
        (0..SUMMED).map(move |k| (open + span * (k as f64 + 0.5) / SUMMED as f64, span))
    };
    Some(ImageMotion::Places(windows.iter().flat_map(of_window).map(|(time, span)| (at(time) - middle, span)).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_way_at_constant_speed_has_the_response_of_a_box() {
        let straight = ImageMotion::Straight(DVec2::new(1.2, -0.4));
        let places = (0..1000).map(|k| (DVec2::new(1.2, -0.4) * ((k as f64 + 0.5) / 1000.0 - 0.5), 1.0));
        let sampled = ImageMotion::Places(places.collect());
        for f in [DVec2::new(0.3, 0.0), DVec2::new(0.0, 0.7), DVec2::new(0.5, -0.5)] {
            let ([a, _], [b, im]) = (straight.response(f), sampled.response(f));
            assert!((a - b).abs() < 1e-6 && im.abs() < 1e-9, "{f}: {a} {b} {im}");
        }
        assert!((sampled.length_px(DVec2::X) - 1.1988).abs() < 1e-9 && straight.length_px(DVec2::Y) == 0.4);
        // Twice as long at one end as at the other: two points of weights 2 and 1.
        let two = ImageMotion::Places(vec![(DVec2::ZERO, 2.0), (DVec2::X, 1.0)]);
        let [re, im] = two.response(DVec2::new(0.5, 0.0));
        assert!((re - 1.0 / 3.0).abs() < 1e-12 && im.abs() < 1e-12);
    }
}
