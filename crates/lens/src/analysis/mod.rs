//! What a lens does, measured by tracing: spots, fans, wavefronts, point spread, MTF, distortion, colour, vignetting.
//!
//! An analysis is a file: its values, how a [`Bench`] measures them, and their `plot`.
//!
//! A [`Bench`] is a lens as it stands before an object at a distance; a [`Beam`] the light of one field point. Fields are angles
//! of the chief ray in object space, in the y–z plane, positive upwards as the light comes from below: the image lies at +y.
//! Chief rays are found from the middle of the stop outwards, so that fisheyes beyond 90° need no special case. Wavelengths in
//! nm, lengths in mm.

mod fft;
mod field;
mod mtf;
mod psf;
mod spot;
#[cfg(test)]
mod test_lenses;
mod thirdorder;
mod wavefront;
pub mod zernike;

pub use field::{ColorCurves, FieldPoint, Illumination, PupilShape};
pub(crate) use mtf::airy_mtf_of;
pub use mtf::{Mtf, airy_mtf, defocused_airy_mtf};
pub use psf::{PointImageCurves, Psf, Raster};
pub use spot::{Fan, FanPoint, Spot};
pub use thirdorder::{SurfaceSums, ThirdOrder};
pub use wavefront::{Wavefront, WavefrontSample};

use crate::glass::{C_NM, D_NM, F_NM};
use crate::paraxial::FirstOrder;
use crate::ray::{Apertures, TraceDirection, TracedRay};
use crate::system::System;
use crate::trace::at_plane;
use glam::{DVec2, DVec3};

/// A place across the chief ray, mm: sagittal, tangential.
pub type PupilPoint = DVec2;

/// Colours that analyses take when nothing else is asked: F, d, C.
pub const VISUAL_NM: [f64; 3] = [F_NM, D_NM, C_NM];

/// A lens on the optical bench.
#[derive(Clone, Debug)]
pub struct Bench<'a> {
    /// The lens as it stands; its film is where images are looked at.
    pub system: &'a System,
    /// Distance from the object to the first vertex, mm; `None` for infinity.
    pub object_distance: Option<f64>,
}

/// The light of one field point.
#[derive(Clone, Debug)]
pub struct Beam {
    /// Chief ray where it starts: on the object, or before the lens.
    pub chief: TracedRay,
    /// Chief ray behind the last surface.
    pub image: TracedRay,
    /// Unit vectors across the chief ray: sagittal (x) and tangential.
    pub across: [DVec3; 2],
    /// Rectangle across the chief ray that holds all light that passes: lower and upper corner, mm (of the plane through
    /// [`Beam::pupil`]).
    pub extent: [DVec2; 2],
    /// Where the chief ray crosses the entrance pupil (the point around which it is seen to turn).
    pub pupil: DVec3,
    finite: bool,
}

impl Beam {
    /// The ray through a place of the pupil plane across the chief ray, mm from the chief ray.
    pub fn ray(&self, at: DVec2) -> TracedRay {
        let offset = self.across[0] * at.x + self.across[1] * at.y;
        if self.finite {
            let direction = (self.pupil + offset - self.chief.position).normalize() * self.towards_lens();
            return TracedRay { position: self.chief.position, direction };
        }
        TracedRay { position: self.chief.position + offset, direction: self.chief.direction }
    }

    /// Derivatives of position and direction of [`Beam::ray`] by either coordinate of the place.
    pub(crate) fn ray_by(&self, at: DVec2) -> [[DVec3; 2]; 2] {
        self.across.map(|across| {
            if !self.finite {
                return [across, DVec3::ZERO];
            }
            let towards = self.pupil + self.across[0] * at.x + self.across[1] * at.y - self.chief.position;
            let direction = towards.normalize();
            [DVec3::ZERO, (across - direction * direction.dot(across)) * (self.towards_lens() / towards.length())]
        })
    }

    /// Along the light the pupil lies before the object, 1, or behind it, −1: in lenses that are telecentric on the object's side, or more.
    fn towards_lens(&self) -> f64 {
        (self.pupil - self.chief.position).dot(self.chief.direction).signum()
    }
}

impl<'a> Bench<'a> {
    /// Before an object at infinity.
    pub fn at_infinity(system: &'a System) -> Self {
        Bench { system, object_distance: None }
    }

    /// First-order data at a wavelength.
    pub fn first_order(&self, nm: f64) -> FirstOrder {
        FirstOrder::of(self.system, &self.system.indices(nm))
    }

    /// Chief ray of a field angle (rad) in front of the lens, running towards it: from the middle of the stop outwards, and
    /// in the y–z plane before the lens, also where something in it stands askew. `None` where no ray leaves the lens at that angle.
    fn chief(&self, angle: f64, nm: f64) -> Option<TracedRay> {
        let system = self.system;
        let n = system.indices(nm);
        if system.object_axis.is_some() {
            let direction = DVec3::new(0.0, angle.sin(), angle.cos());
            let ray = |at: DVec2| TracedRay { position: at.extend(0.0), direction };
            return crate::at_stop::chief_of(system, &n, ray).map(ray);
        }
        let stop = &system.surfaces[system.stop];
        let (middle, _) = stop.to_lens(DVec3::ZERO, DVec3::Z);
        let run = system.runs[system.stop];
        // A ray that crosses the stop upwards comes from below.
        let leave = |t: f64| {
            let direction = DVec3::new(0.0, -t.sin(), -t.cos() * run);
            let start = TracedRay { position: middle, direction };
            let out = system.trace_part(start, &n, TraceDirection::ToObject, Apertures::Ignore, 0..system.stop, |_| {}).ok()?;
            // Angle of the light that comes in: of −direction.
            Some((out, f64::atan2(-out.direction.y, -out.direction.z)))
        };
        let found = |out: TracedRay| {
            if system.is_centered() {
                return Some(TracedRay { position: out.position, direction: -out.direction });
            }
            // Something that stands askew has sent it out of the y–z plane: that of the parallel rays beside it which meets the middle of the stop.
            let direction = DVec3::new(0.0, angle.sin(), angle.cos());
            let ray =
                |at: DVec2| TracedRay { position: out.position + DVec3::X * at.x + direction.cross(DVec3::X) * at.y, direction };
            crate::at_stop::chief_from(system, &n, DVec2::ZERO, ray).map(ray)
        };
        // The angle grows with the angle at the stop; look for where it passes the one asked.
        const STEPS: usize = 400;
        let limit = 1.5;
        let mut before = (0.0, leave(0.0)?);
        // Light along the axis of a lens that stands askew leaves the middle of the stop at an angle.
        let sign = if angle - before.1.1 < 0.0 { -1.0 } else { 1.0 };
        if (before.1.1 - angle).abs() < 1e-12 {
            return found(before.1.0);
        }
        // A pupil that turns rays about (a mirror in front of the stop) may start the other way.
        let probe = leave(1e-4)?.1 - before.1.1;
        let sign = if probe < 0.0 { -sign } else { sign };
        for i in 1..=STEPS {
            let t = sign * limit * i as f64 / STEPS as f64;
            let Some(out) = leave(t) else { break };
            if (before.1.1 - angle) * (out.1 - angle) <= 0.0 {
                let (mut low, mut high) = (before.0, t);
                let rising = out.1 > before.1.1;
                let mut ray = out.0;
                for _ in 0..100 {
                    let mid = 0.5 * (low + high);
                    let (there, a) = leave(mid)?;
                    ray = there;
                    if (a < angle) == rising { low = mid } else { high = mid }
                }
                return found(ray);
            }
            before = (t, out);
        }
        None
    }

    /// Where the chief ray of the axial beam stands in the plane of the entrance pupil, mm: beside the axis where the stop is decentred.
    fn pupil_axis(&self, nm: f64) -> DVec2 {
        let first = self.first_order(nm);
        let ray = |at: DVec2| TracedRay { position: at.extend(first.entrance_pupil_z), direction: DVec3::Z };
        crate::at_stop::chief_of(self.system, &self.system.indices(nm), ray).unwrap_or(DVec2::ZERO)
    }

    /// A beam whose lit part is not looked for.
    pub(crate) fn chief_beam(&self, field_deg: f64, nm: f64) -> Option<Beam> {
        let system = self.system;
        let near = self.chief(field_deg.to_radians(), nm)?;
        let direction = near.direction;
        // Where it crosses the axis of the entrance pupil, or comes nearest to it.
        let flat = direction.truncate();
        let axis = self.pupil_axis(nm);
        let pupil = match flat.length_squared() > 1e-14 {
            true => near.position - direction * ((near.position.truncate() - axis).dot(flat) / flat.length_squared()),
            false => axis.extend(self.first_order(nm).entrance_pupil_z),
        };
        let position = match self.object_distance {
            Some(d) => pupil + direction * ((-d - pupil.z) / direction.z),
            None => {
                // Before anything of the lens: beyond a sphere around it.
                let reach = |s: &crate::system::PlacedSurface| s.z.abs() + s.semi_diameter.min(1e4);
                pupil - direction * (2.0 * system.surfaces.iter().map(reach).fold(pupil.length(), f64::max))
            }
        };
        let chief = TracedRay { position, direction };
        let image = system.trace(chief, &system.indices(nm), TraceDirection::ToFilm, Apertures::Ignore).ok()?;
        let across = [DVec3::X, direction.cross(DVec3::X).normalize()];
        Some(Beam { chief, image, across, extent: [DVec2::ZERO; 2], pupil, finite: self.object_distance.is_some() })
    }

    /// Whether light of a field angle (degrees) comes through.
    pub fn is_lit(&self, field_deg: f64, nm: f64) -> bool {
        let passes =
            |beam: Beam| self.system.trace(beam.chief, &self.system.indices(nm), TraceDirection::ToFilm, Apertures::Clip).is_ok();
        self.chief_beam(field_deg, nm).is_some_and(passes) || self.beam(field_deg, nm).is_some()
    }

    /// The light of a field angle (degrees). `None` where none comes through.
    pub fn beam(&self, field_deg: f64, nm: f64) -> Option<Beam> {
        let mut beam = self.chief_beam(field_deg, nm)?;
        let system = self.system;
        let n = system.indices(nm);
        // The lit part of the pupil: around the paraxial one; where it is larger, or elsewhere, over all the front.
        let lit = |half: f64, low: DVec2, high: DVec2, side: usize| {
            let cell = (high - low) / (side - 1) as f64;
            let (mut lit_low, mut lit_high) = (DVec2::MAX, DVec2::MIN);
            for i in 0..side * side {
                let at = low + cell * DVec2::new((i % side) as f64, (i / side) as f64);
                if system.trace(beam.ray(at), &n, TraceDirection::ToFilm, Apertures::Clip).is_ok() {
                    (lit_low, lit_high) = (lit_low.min(at), lit_high.max(at));
                }
            }
            let within = lit_low.min_element() > -half && lit_high.max_element() < half;
            (lit_low.x <= lit_high.x && within).then_some((lit_low - cell, lit_high + cell))
        };
        let pupil_radius = self.first_order(nm).entrance_pupil_radius();
        let widest = 1.5 * system.surfaces[0].semi_diameter.min(1e4).max(pupil_radius);
        let square = |half: f64, side: usize| lit(half, DVec2::splat(-half), DVec2::splat(half), side);
        let (low, high) = square(2.0 * pupil_radius, 61).or_else(|| square(widest, 61)).or_else(|| square(widest, 401))?;
        let (low, high) = lit(f64::INFINITY, low, high, 61).unwrap_or((low, high));
        let extent = lit(f64::INFINITY, low, high, 41).map_or([low, high], |(a, b)| [a, b]);
        beam.extent = extent;
        Some(beam)
    }

    /// Rays of a beam that pass, on a square grid of `across` rays a side, and where they meet the film plane, with the cosine
    /// and optical path there: place in the pupil, ray behind the lens.
    fn grid(&self, beam: &Beam, nm: f64, across: usize) -> Vec<(DVec2, TracedRay)> {
        let n = self.system.indices(nm);
        let [low, high] = beam.extent;
        let cell = (high - low) / across as f64;
        (0..across * across)
            .filter_map(|i| {
                let at = low + cell * DVec2::new((i % across) as f64 + 0.5, (i / across) as f64 + 0.5);
                let ray = self.system.trace(beam.ray(at), &n, TraceDirection::ToFilm, Apertures::Clip).ok()?;
                Some((at, ray))
            })
            .collect()
    }

    /// Film point of a ray behind the lens, mm, `defocus` behind the film, along the light.
    fn on_film(&self, ray: &TracedRay, defocus: f64) -> DVec2 {
        at_plane(ray, self.system.film_z + defocus * self.system.film_run()).truncate()
    }

    /// Largest field angle (degrees) whose chief ray lands within a height on the film; searched in steps up to 130°.
    pub fn field_of_height(&self, height: f64) -> f64 {
        let nm = self.system.nearest_with_indices(D_NM);
        let n = self.system.indices(nm);
        let lands = |deg: f64| {
            let chief = self.chief(f64::to_radians(deg), nm)?;
            let image = self.system.trace(chief, &n, TraceDirection::ToFilm, Apertures::Ignore).ok()?;
            Some(self.on_film(&image, 0.0).y.abs())
        };
        let (mut low, mut high) = (0.0, 130.0);
        for i in 1..=260 {
            let deg = 0.5 * i as f64;
            match lands(deg) {
                Some(h) if h <= height => low = deg,
                _ => {
                    high = deg;
                    break;
                }
            }
        }
        for _ in 0..40 {
            let mid = 0.5 * (low + high);
            match lands(mid) {
                Some(h) if h <= height => low = mid,
                _ => high = mid,
            }
        }
        low
    }

    /// Focal length as a bench measures it: height of the image of a distant point a little off the axis, in the plane of the
    /// smallest axial spot, over the tangent of its angle.
    pub fn measured_focal_length(&self, nm: f64) -> Option<f64> {
        let infinite = Bench::at_infinity(self.system);
        let (z, _) = crate::focusing::best_film_z(self.system, None)?;
        let angle = 0.2f64;
        // Both sides, so that an image beside the axis does not count.
        let height = |angle: f64| {
            let beam = infinite.beam(angle, nm)?;
            let rays = infinite.grid(&beam, nm, 41);
            Some(
                rays.iter().map(|r| infinite.on_film(&r.1, (z - self.system.film_z) * self.system.film_run())).sum::<DVec2>().y
                    / rays.len() as f64,
            )
        };
        Some((height(angle)? - height(-angle)?) / (2.0 * angle.to_radians().tan()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::embedded;
    use crate::system::State;

    #[test]
    fn chief_rays_cross_the_middle_of_the_stop() {
        for (name, fields) in [("double-gauss-50mm", vec![0.0, 5.0, 14.0, -10.0]), ("fisheye-10mm", vec![0.0, 30.0, 70.0])] {
            let p = embedded(name).unwrap();
            let system = System::at(&p, State::default());
            let bench = Bench::at_infinity(&system);
            for field in fields {
                let beam = bench.beam(field, D_NM).unwrap_or_else(|| panic!("{name} {field}"));
                let mut at_stop = None;
                let n = system.indices(D_NM);
                system
                    .trace_with(beam.chief, &n, TraceDirection::ToFilm, Apertures::Ignore, |e| {
                        if e.surface == system.stop {
                            at_stop = Some(e.point);
                        }
                    })
                    .unwrap();
                let at = at_stop.unwrap();
                assert!(at.x.hypot(at.y) < 1e-9, "{name} {field}: {at}");
                let angle = f64::atan2(beam.chief.direction.y, beam.chief.direction.z).to_degrees();
                assert!((angle - field).abs() < 1e-9, "{angle} {field}");
                assert!(bench.on_film(&beam.image, 0.0).y * field >= 0.0);
            }
        }
    }

    #[test]
    fn pupils_have_the_shape_that_rims_leave() {
        // On the axis a disk of the f-number's diameter; at 20° a cat's eye of the vignetted area.
        let system = System::at(&embedded("double-gauss-50mm").unwrap(), State::default());
        let bench = Bench::at_infinity(&system);
        let reach = bench.axial_reach(D_NM).unwrap();
        let area = |outline: &[DVec2]| {
            (0..outline.len()).map(|i| 0.5 * outline[i].perp_dot(outline[(i + 1) % outline.len()])).sum::<f64>()
        };
        let axis = bench.pupil_shape(0.0, D_NM).unwrap();
        assert!(axis.entrance.iter().all(|p| (p.length() - reach).abs() < 1e-6 * reach), "{reach}");
        let tilted = bench.pupil_shape(20.0, D_NM).unwrap();
        let expected = bench.vignetting(20.0, D_NM).unwrap();
        let found = area(&tilted.entrance) / area(&axis.entrance);
        assert!((found / expected - 1.0).abs() < 0.01 && expected < 0.6, "{found} {expected}");
        assert!(axis.exit.len() == 72 && area(&tilted.exit) < area(&axis.exit));
    }

    #[test]
    fn the_bench_measures_the_focal_length() {
        let system = System::at(&embedded("double-gauss-50mm").unwrap(), State::default());
        let bench = Bench::at_infinity(&system);
        let f = bench.measured_focal_length(D_NM).unwrap();
        // Coma moves the middle of the light a little.
        assert!((f / bench.first_order(D_NM).efl - 1.0).abs() < 5e-3, "{f}");
    }
}
