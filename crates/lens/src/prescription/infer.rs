//! What a prescription does not say and its other figures tell: stop, film and semi-diameters, and rims clipped where surfaces cross.

use super::{ApertureKind, Gap, LARGEST, Prescription, PrescriptionError, Surface};
use crate::at_stop::chief_of;
use crate::f_number;
use crate::paraxial;
use crate::ray::{Apertures, TraceDirection, TracedRay};
use crate::surface::Profile;
use crate::system::{State, System};
use glam::{DVec2, DVec3};

impl Prescription {
    /// The wavelength at which missing figures are inferred, nm: the d line, or the stated reference where a glass has no index there.
    pub(crate) fn inference_nm(&self) -> f64 {
        let index_exists = |nm: f64| self.surfaces.iter().all(|s| s.glass.index(nm) > 0.0);
        let reference = self.usage.wavelengths_nm.get(self.usage.reference).copied();
        match reference {
            Some(nm) if !index_exists(crate::glass::D_NM) => nm,
            _ => crate::glass::D_NM,
        }
    }

    /// Diameter of the entrance pupil (mm) of the beam from the middle of the object, at its distance, that comes to the image at an angle of this tangent to the axis,
    /// by first order. `None` without an object at a finite distance, and where no such beam has one. The stop is inferred where none is given.
    pub(crate) fn pupil_of_image_cone(&self, tangent: f64) -> Option<f64> {
        let distance = self.usage.object_distance?;
        let mut whole = self.clone();
        if !whole.surfaces.iter().any(|s| s.stop) {
            let stop = whole.infer_stop();
            whole.surfaces.get_mut(stop)?.stop = true;
        }
        let system = System::at(&whole, State::default());
        let n = system.indices(whole.inference_nm());
        // A ray of slope 1 from the object: slopes go with one another.
        let slope = *paraxial::Trace::new(&system, &n, distance, 1.0).angles.last()?;
        let diameter = 2.0 * (tangent / slope * (distance + paraxial::FirstOrder::of(&system, &n).entrance_pupil_z)).abs();
        (diameter > 0.0 && diameter < LARGEST).then_some(diameter)
    }

    /// The f-number (focal length over diameter of the entrance pupil) of the aperture that the prescription says it is used at; `None` where it says none, or one that no
    /// beam of its object has.
    pub fn used_f_number(&self) -> Option<f64> {
        let aperture = self.usage.aperture?;
        if let ApertureKind::FNumber(n) = aperture {
            return Some(n);
        }
        let system = System::at(self, State::default());
        let first = paraxial::FirstOrder::of(&system, &system.indices(self.inference_nm()));
        let diameter = match aperture {
            ApertureKind::EntrancePupil(d) => d,
            ApertureKind::ObjectNa(na) => 2.0 * (self.usage.object_distance? + first.entrance_pupil_z) * na.asin().tan(),
            ApertureKind::FNumber(_) => return None,
        };
        // Less than this is no f-number of glass in air: an entrance pupil that is wider than all rims.
        Some(first.efl / diameter).filter(|n| *n > 0.1)
    }

    /// The surface whose rim the axial beam touches first.
    pub(crate) fn infer_stop(&self) -> usize {
        let system = System::at(self, State::default());
        let heights = paraxial::Trace::axial(&system, &system.indices(self.inference_nm())).heights;
        let ratio = |i: &usize| {
            let sd = self.surfaces[*i].semi_diameter.unwrap_or(f64::INFINITY);
            sd / heights[*i].abs().max(1e-12)
        };
        (0..self.surfaces.len()).min_by(|a, b| ratio(a).total_cmp(&ratio(b))).unwrap_or(0)
    }

    /// Puts the film into the paraxial focus where the file gives it no place.
    pub(super) fn infer_film(&mut self) {
        let last = self.surfaces.len() - 1;
        let given = self.surfaces[last].gap.values.iter().flatten().any(|g| *g != 0.0);
        if given || !self.zoom.is_empty() || self.object_axis.is_some() {
            return;
        }
        let system = System::at(self, State::default());
        let bfl = paraxial::FirstOrder::of(&system, &system.indices(self.inference_nm())).bfl;
        // After an odd number of mirrors light runs towards the object, and lengths along it count negative.
        if bfl * system.film_run() > 0.0 && bfl.abs() < LARGEST {
            self.surfaces[last].gap = Gap::fixed(bfl);
            self.notes.push(format!("no gap behind the last surface: the film stands in the paraxial focus, {bfl:.4} mm"));
        }
    }

    /// Radius of the entrance pupil of the widest beam on the axis that the rims which are given let pass, mm, with a note; NaN where none is.
    fn widest_pupil(&mut self, system: &System, n: &[f64]) -> f64 {
        let heights = paraxial::Trace::axial(system, n).heights;
        let beam = |(s, height): (&Surface, &f64)| Some(s.semi_diameter? * (heights[0] / height).abs());
        let widest = self
            .surfaces
            .iter()
            .zip(&heights)
            .filter_map(beam)
            .filter(|r| *r > 0.0 && r.is_finite())
            .fold(f64::INFINITY, f64::min);
        if widest.is_finite() {
            self.notes.push(format!(
                "no aperture is given: the stop lets pass what the rims do on the axis, a beam of {:.4} mm",
                2.0 * widest
            ));
            return widest;
        }
        f64::NAN
    }

    /// Gives surfaces without a semi-diameter one that lets the stated beams through.
    pub(super) fn infer_semi_diameters(&mut self, file: &str) -> Result<(), PrescriptionError> {
        let missing: Vec<usize> = (0..self.surfaces.len()).filter(|i| self.surfaces[*i].semi_diameter.is_none()).collect();
        if missing.is_empty() {
            return Ok(());
        }
        let system = System::at(self, State::default());
        let n = system.indices(self.inference_nm());
        let first = paraxial::FirstOrder::of(&system, &n);
        let stop = self.stop();
        let pupil = match self.usage.aperture {
            Some(ApertureKind::EntrancePupil(d)) => 0.5 * d,
            Some(ApertureKind::FNumber(f)) => 0.5 * first.efl.abs() / f,
            Some(ApertureKind::ObjectNa(na)) => match self.usage.object_distance {
                Some(d) => (d + first.entrance_pupil_z) * na.asin().tan(),
                None => f64::NAN,
            },
            None => match (self.f_number, self.surfaces[stop].semi_diameter) {
                (_, Some(sd)) => sd * first.entrance_pupil_magnification.abs(),
                (Some(f), None) => 0.5 * first.efl.abs() / f,
                (None, None) => self.widest_pupil(&system, &n),
            },
        };
        if !(pupil > 0.0 && pupil < LARGEST) {
            let what = "no semi-diameter, and neither an aperture nor an f-number to infer it from";
            return Err(PrescriptionError::at(file, self.surfaces[missing[0]].line, what).surface(missing[0] + 1));
        }
        let fields = if self.usage.field_angles_deg.is_empty() { vec![0.0] } else { self.usage.field_angles_deg.clone() };
        let mut height = vec![0.0f64; self.surfaces.len()];
        for (f, angle) in fields.iter().enumerate() {
            let [up, low] = self.usage.vignetting.get(f).copied().unwrap_or([0.0; 2]);
            // Where surfaces stand beside the axis the light through the stop does so, too.
            let ray_of = |place: DVec2| entrance_ray(&first, self.usage.object_distance, *angle, place.to_array());
            let middle = chief_of(&system, &n, ray_of).unwrap_or(DVec2::ZERO);
            for place in [[0.0, 1.0 - up], [0.0, 0.0], [0.0, low - 1.0], [1.0, 0.0], [-1.0, 0.0]] {
                let ray = ray_of(middle + DVec2::from_array(place) * pupil);
                let mut passed = vec![None; self.surfaces.len()];
                let traced = system.trace_with(ray, &n, TraceDirection::ToFilm, Apertures::Ignore, |e| {
                    let s = &system.surfaces[e.surface];
                    let p = s.to_local(e.point, DVec3::Z).0;
                    passed[e.surface] = Some(p.x.hypot(p.y));
                });
                // A ray that fails says nothing but is no reason to give up: the others do.
                let _ = traced;
                for (h, p) in height.iter_mut().zip(&passed) {
                    *h = h.max(p.unwrap_or(0.0));
                }
            }
        }
        for &i in &missing {
            // The stop is as large as the real axial beam; rims get a hair more than the light needs.
            let axial = || {
                let axial = paraxial::Trace::axial(&system, &n).heights;
                (axial[i] * pupil / axial[0].abs().max(1e-12)).abs()
            };
            let real = if i == stop { self.marginal_radius(&system, &n, &first, pupil) } else { Some(height[i] * 1.0001) };
            let wanted = real.filter(|r| *r > 0.0).unwrap_or_else(axial);
            // A millionth of a millimetre is more than anyone grinds.
            let wanted = (wanted * 1e6).ceil() / 1e6;
            let sd = wanted.min(reach(&self.surfaces[i].profile, wanted));
            if !(sd > 0.0 && sd < LARGEST) {
                let what = "no semi-diameter, and no ray of the stated beams to infer it from reaches the surface";
                return Err(PrescriptionError::at(file, self.surfaces[i].line, what).surface(i + 1));
            }
            let obstruction = self.surfaces[i].obstruction;
            if obstruction >= sd {
                let what = format!("obstruction {obstruction}: the beams of the file reach only {sd} mm here");
                return Err(PrescriptionError::at(file, self.surfaces[i].line, what).surface(i + 1));
            }
            self.surfaces[i].semi_diameter = Some(sd);
        }
        self.notes.push("semi-diameters that the file does not give are inferred from its aperture and fields".into());
        self.clip_crossing_rims(&missing, "inferred ");
        Ok(())
    }

    /// Clips semi-diameters that a file of another program gives at the height where two surfaces cross, with a note: such programs draw and clip
    /// nothing by them, so that their files carry larger ones than the glass has. In our own form they are an error.
    pub(crate) fn clip_given_rims(&mut self) {
        let all: Vec<usize> = (0..self.surfaces.len()).collect();
        self.clip_crossing_rims(&all, "");
    }

    /// Radius at the stop of the axial beam that fills an entrance pupil of a radius (mm), by real rays.
    fn marginal_radius(&self, system: &System, n: &[f64], first: &paraxial::FirstOrder, pupil: f64) -> Option<f64> {
        let near = self.usage.object_distance.filter(|d| d.is_finite() && *d < 1e9);
        if near.is_none() {
            return f_number::stop_radius(system, n, first.efl, pupil);
        }
        let mut radius = None;
        let ray = entrance_ray(first, near, 0.0, [0.0, pupil]);
        // A ray that fails behind the stop has told what was asked.
        let _ = system.trace_with(ray, n, TraceDirection::ToFilm, Apertures::Ignore, |e| {
            if e.surface == system.stop {
                let p = system.surfaces[e.surface].to_local(e.point, DVec3::Z).0;
                radius = Some(p.x.hypot(p.y));
            }
        });
        radius
    }

    /// Clips semi-diameters of some surfaces (`kind` in the note: inferred, or nothing) at the height where two surfaces cross: beams that need more
    /// would pass where there is no glass (or, between elements, no air).
    fn clip_crossing_rims(&mut self, which: &[usize], kind: &str) {
        // Off a common axis neighbours do not face one another.
        if self.object_axis.is_some() {
            return;
        }
        let zooms = self.zoom.len().max(1);
        let mut run = 1.0;
        for i in 0..self.surfaces.len().saturating_sub(1) {
            if self.surfaces[i].mirror {
                run = -run;
            }
            if self.is_free_stop(i) || self.is_free_stop(i + 1) {
                continue;
            }
            for (zoom, focus) in (0..zooms).flat_map(|z| [(z as f64, 0.0), (z as f64, 1.0)]) {
                let (front, back) = (&self.surfaces[i], &self.surfaces[i + 1]);
                let (Some(a), Some(b)) = (front.semi_diameter, back.semi_diameter) else { continue };
                let gap = front.gap.at(zoom, focus) * run;
                let edge = |h: f64| Some(gap + run * (back.profile.sag(0.0, h)? - front.profile.sag(0.0, h)?));
                let rim = a.min(b) * (1.0 - 1e-6);
                if gap <= 0.0 || edge(rim).is_none_or(|e| e >= -overlap(rim)) {
                    continue;
                }
                // The first height, from the axis, at which nothing is left between them.
                const STEPS: usize = 200;
                let bare = |h: f64| edge(h).is_some_and(|e| e < 0.0);
                let Some(k) = (1..=STEPS).find(|k| bare(rim * *k as f64 / STEPS as f64)) else { continue };
                let (mut low, mut high) = (rim * (k - 1) as f64 / STEPS as f64, rim * k as f64 / STEPS as f64);
                for _ in 0..60 {
                    let mid = 0.5 * (low + high);
                    if bare(mid) { high = mid } else { low = mid }
                }
                let mut clipped = vec![];
                for k in [i, i + 1] {
                    let s = &mut self.surfaces[k];
                    if which.contains(&k) && s.obstruction < low && s.semi_diameter.is_some_and(|sd| sd > low) {
                        s.semi_diameter = Some(low);
                        clipped.push(format!("{}", k + 1));
                    }
                }
                if !clipped.is_empty() {
                    self.notes.push(format!(
                        "surfaces {} and {} cross at a height of {low:.4} mm: the {kind}semi-diameter of surface {} ends there",
                        i + 1,
                        i + 2,
                        clipped.join(" and ")
                    ));
                }
            }
        }
    }

    /// A plane stop in air has no thickness: tables may put it behind a vertex it stands beside.
    pub(super) fn is_free_stop(&self, k: usize) -> bool {
        let air = |k: usize| self.surfaces[k].glass == crate::glass::Glass::air();
        let s = &self.surfaces[k];
        s.stop && s.profile == Profile::Plane && air(k) && (k == 0 || air(k - 1))
    }
}

/// How far (mm) surfaces may overlap at a rim of a height: published semi-diameters are often estimates, and a tenth of a millimetre is
/// their inexactness, not a wrong lens.
pub(super) fn overlap(height: f64) -> f64 {
    0.1 + 0.02 * height
}

/// Largest height up to `wanted` at which a surface exists.
pub(super) fn reach(profile: &Profile, wanted: f64) -> f64 {
    let exists = |h: f64| profile.sag(0.0, h).is_some() && profile.sag(h, 0.0).is_some();
    if exists(wanted) {
        return wanted;
    }
    let (mut low, mut high) = (0.0, wanted);
    for _ in 0..60 {
        let mid = 0.5 * (low + high);
        if exists(mid) { low = mid } else { high = mid }
    }
    low
}

/// A ray of a field angle (degrees, in y) aimed at a place of the paraxial entrance pupil.
fn entrance_ray(first: &paraxial::FirstOrder, object_distance: Option<f64>, angle_deg: f64, pupil: [f64; 2]) -> TracedRay {
    let target = DVec3::new(pupil[0], pupil[1], first.entrance_pupil_z);
    let slope = angle_deg.to_radians().tan();
    match object_distance.filter(|d| d.is_finite() && *d < 1e9) {
        Some(d) => {
            // The angle is seen from the middle of the pupil.
            let object = DVec3::new(0.0, -slope * (d + first.entrance_pupil_z), -d);
            let direction = (target - object).normalize() * (target.z - object.z).signum();
            TracedRay { position: object, direction }
        }
        None => {
            let direction = DVec3::new(0.0, slope, 1.0).normalize();
            TracedRay { position: target - direction * (target.z / direction.z), direction }
        }
    }
}
