//! A microlens array before the sensor: behind it each pixel sees the scene through its own part of the pupil.
//!
//! The array stands where the film would; the sensor lies a gap behind it. Its lenses are thin and fill the plane. A ray that the sensor
//! point x and the point m of a lens around c make has the slope (m − x) / gap towards the main lens behind the array and
//! (m − x) / gap − (m − c) / f before it. The map (m, slope) → (m, x) stretches areas by gap² everywhere, so the light that falls on a
//! lens is the light that falls on the sensor: what a pixel gets is ∫ W dm / gap², W being what the film would weigh that direction with.
//!
//! Sources: M. Levoy et al. 2006, "Light field microscopy"; R. Ng et al. 2005, "Light field photography with a hand-held plenoptic
//! camera"; gap ≠ focal length: A. Lumsdaine & T. Georgiev 2009, "The focused plenoptic camera".

use crate::{Lens, LensError, require};
use diopter_light::lattice::{Arrangement, Lattice};
use glam::DVec2;

/// A microlens array, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MicrolensArray {
    /// Where its lenses stand, in lens axes.
    pub lattice: Lattice,
    /// Focal length of its lenses.
    pub focal_length: f64,
    /// From the array to the sensor.
    pub gap: f64,
}

impl MicrolensArray {
    /// An array for a film of a size (mm), its columns and rows about the middle. Fails on lengths that are not positive or fit no lens
    /// on the film.
    pub fn new(
        arrangement: Arrangement,
        [pitch, focal_length, gap]: [f64; 3],
        film_mm: [f64; 2],
    ) -> Result<MicrolensArray, LensError> {
        for (what, value) in [("microlens pitch", pitch), ("microlens focal length", focal_length), ("microlens gap", gap)] {
            require(value > 0.0 && value.is_finite(), what, value, " mm", "a positive length")?;
        }
        let mut lattice = Lattice { arrangement, pitch, origin: DVec2::ZERO };
        let [columns, rows] = [film_mm[0] / pitch, film_mm[1] / lattice.row_pitch()].map(|n| n as i64);
        require(columns >= 4 && rows >= 4, "microlens pitch", pitch, " mm", "at least four lenses across the film")?;
        // Halfway between the first and the last.
        let half = |n: i64, step: f64| if n % 2 == 0 { 0.5 * step } else { 0.0 };
        lattice.origin = DVec2::new(half(columns, pitch), half(rows, lattice.row_pitch()));
        Ok(MicrolensArray { lattice, focal_length, gap })
    }

    /// The array behind a lens.
    pub fn behind(&self, lens: &Lens) -> MicrolensOptics {
        let (magnification, blur) = self.images(lens);
        let smear = self.lattice.cell_radius() * blur;
        MicrolensOptics { array: *self, magnification, image_radius: self.gap * lens.pupil_reach() + smear }
    }

    /// Size of the lattice of pupil images over that of the microlenses, and of the blur of each over its microlens: 0 where the gap is its focal length.
    fn images(&self, lens: &Lens) -> (f64, f64) {
        let magnification = 1.0 + self.gap * lens.exit_curvature();
        (magnification, (magnification - self.gap / self.focal_length).abs())
    }

    /// How many times more light falls on the middle of the image of a lens's pupil than on the film: area of a microlens over that of this image, or of the blur of
    /// one whose gap is not its focal length, whichever is larger. Below 1 where the images of neighbours overlap.
    pub fn concentration(&self, lens: &Lens) -> f64 {
        let blur = self.lattice.cell_area() * self.images(lens).1.powi(2);
        self.lattice.cell_area() / (std::f64::consts::PI * (self.gap * lens.pupil_slope()).powi(2)).max(blur)
    }
}

/// A microlens array behind a lens.
#[derive(Clone, Copy, Debug)]
pub struct MicrolensOptics {
    array: MicrolensArray,
    /// Size of the lattice of pupil images over that of the lenses.
    magnification: f64,
    /// Farthest that light through a lens falls from the middle of its image.
    image_radius: f64,
}

/// A ray from the sensor, as the main lens sees it.
#[derive(Clone, Copy, Debug)]
pub struct MicrolensSample {
    /// Where it passes the array, mm.
    pub at: DVec2,
    /// Slope towards the main lens.
    pub slope: DVec2,
    /// Samples that are drawn, per unit of film area and slope, of one a unit of sensor area.
    pub density: f64,
}

impl MicrolensOptics {
    fn lenses(&self, sensor: DVec2) -> impl Iterator<Item = DVec2> + use<> {
        self.array.lattice.within(sensor / self.magnification, self.image_radius / self.magnification)
    }

    /// Draws a ray from a sensor point: a lens whose image may lie there, and a place in it. `None` where there is only dark. Places are in
    /// mm, `u` and `v` from 0 to 1.
    pub fn draw(&self, sensor: DVec2, [u, v]: [f32; 2]) -> Option<MicrolensSample> {
        let count = self.lenses(sensor).count();
        let scaled = u * count as f32;
        let lens = self.lenses(sensor).nth((scaled as usize).min(count.checked_sub(1)?))?;
        let at = self.array.lattice.place_in_cell(lens, [scaled.fract(), v]);
        let slope = (at - sensor) / self.array.gap - (at - lens) / self.array.focal_length;
        Some(MicrolensSample { at, slope, density: self.density_of(count) })
    }

    fn density_of(&self, count: usize) -> f64 {
        self.array.gap.powi(2) / (count.max(1) as f64 * self.array.lattice.cell_area())
    }

    /// The ray through the middle of the lens that belongs to a sensor point, mm.
    pub fn middle(&self, sensor: DVec2) -> MicrolensSample {
        let lens = self.array.lattice.nearest(sensor / self.magnification);
        MicrolensSample { at: lens, slope: (lens - sensor) / self.array.gap, density: self.density_of(1) }
    }

    /// Where on the sensor (mm) light lands that comes to a place of the array (mm) with a slope.
    pub fn on_sensor(&self, at: DVec2, slope: DVec2) -> DVec2 {
        let lens = self.array.lattice.nearest(at);
        at - (slope + (at - lens) / self.array.focal_length) * self.array.gap
    }

    /// [`MicrolensSample::density`] of any ray from a sensor point.
    pub fn density(&self, sensor: DVec2) -> f64 {
        self.density_of(self.lenses(sensor).count())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Focus, Iris, ThinLens};
    use diopter_light::units::Millimeters;

    fn arrays() -> [MicrolensArray; 2] {
        let array = |a| MicrolensArray::new(a, [0.3, 1.2, 1.1], [12.0, 8.0]).unwrap();
        [array(Arrangement::Square), array(Arrangement::Hexagonal)]
    }

    fn places(n: usize) -> impl Iterator<Item = [f32; 2]> {
        (1..=n).map(|i| [0.754_877_666, 0.569_840_291].map(|a: f64| (0.001 + 0.998 * (a * i as f64).fract()) as f32))
    }

    #[test]
    fn the_middle_of_the_array_is_that_of_the_film() {
        for (film, even) in [([12.0, 8.0], true), ([12.4, 8.4], false)] {
            let l = MicrolensArray::new(Arrangement::Square, [0.4, 1.0, 1.0], film).unwrap().lattice;
            let mirrored = l.nearest(-l.origin);
            assert!((mirrored + l.origin).length() < 1e-9 && (l.origin.x > 0.1) == even);
        }
        assert!(MicrolensArray::new(Arrangement::Square, [4.0, 1.0, 1.0], [12.0, 8.0]).is_err());
        assert!(MicrolensArray::new(Arrangement::Square, [0.1, f64::NAN, 1.0], [12.0, 8.0]).is_err());
    }

    #[test]
    fn ways_land_where_they_begin_and_hold_all_light() {
        let lens =
            Lens::Thin(ThinLens::new(Millimeters(50.0), 3.5, Iris::default(), Focus::Distance(Millimeters(900.0))).unwrap());
        for array in arrays() {
            let behind = array.behind(&lens);
            let (mut drawn, mut passed) = (0.0, 0.0);
            for (i, u) in places(40_000).enumerate() {
                // Even over whole periods of the images, around a place off the axis.
                let fraction = DVec2::new((i % 200) as f64 + 0.5, (i / 200) as f64 + 0.5) / 200.0;
                let period = DVec2::new(array.lattice.pitch, array.lattice.row_pitch()) * behind.magnification;
                let sensor = DVec2::new(2.0, 1.0) + fraction * period * 6.0;
                drawn += 1.0;
                let Some(way) = behind.draw(sensor, u) else { continue };
                assert!(behind.on_sensor(way.at, way.slope).distance(sensor) < 1e-9);
                let Ok(ray) = lens.ray_along(way.at, way.slope) else { continue };
                passed += ray.weight_sr / way.density;
            }
            // The sensor gets what the film would, on the larger area of the images.
            let film = lens.ray(DVec2::new(2.9, 1.9), [0.5, 0.5]).unwrap().weight_sr;
            let fraction = passed / drawn * behind.magnification.powi(2) / film;
            assert!((fraction - 1.0).abs() < 0.01, "{fraction}");
        }
    }
}
