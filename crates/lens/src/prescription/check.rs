//! What every prescription must be, wherever it came from.

use super::infer::{overlap, reach};
use super::{ApertureKind, LARGEST, MOST_SURFACES, Prescription, PrescriptionError, Surface, WAVELENGTHS_NM};
use crate::aperture::{Aperture, Outline};
use crate::at_stop;
use crate::f_number;
use crate::glass::{Glass, GlassKind};
use crate::paraxial;
use crate::ray::TracedRay;
use crate::surface::Profile;
use crate::system::{State, System};
use glam::DVec3;

/// Most characters of a name or a source.
const LONGEST_TEXT: usize = 500;
impl Prescription {
    /// Whether nothing in it bends light: a pinhole with its thickness, a shade, a sensor without a lens. Its film stands where the last gap says.
    pub fn is_openings_alone(&self) -> bool {
        let opening = |s: &Surface| {
            s.profile == Profile::Plane
                && s.glass.kind == GlassKind::Air
                && !s.mirror
                && s.gradient.is_none()
                && s.ideal_focal_length.is_none()
                && s.tilt == [0.0; 3]
        };
        self.zoom.len() < 2 && self.close_focus.is_none() && self.surfaces.iter().all(opening)
    }

    /// Checks every number, infers stop and semi-diameters that are missing (and notes that), and returns the lens. Fails, naming line and surface
    /// where they are known, on numbers out of their ranges, on a second stop, where surfaces cross or the film stands in the lens, and where a
    /// base ray does not come through.
    pub fn checked(mut self, file: &str) -> Result<Self, PrescriptionError> {
        let whole = |what: String| PrescriptionError::at(file, 0, what);
        // What a file says about itself is shown on terminals and written into others.
        let clean = |s: &str| s.chars().filter(|c| !c.is_control()).take(LONGEST_TEXT).collect::<String>();
        self.name = clean(&self.name);
        self.source = clean(&self.source);
        self.patent = self.patent.as_deref().map(clean);
        let count = self.surfaces.len();
        if count == 0 {
            return Err(whole("no surfaces: a lens needs at least one".into()));
        }
        if count > MOST_SURFACES {
            return Err(whole(format!("{count} surfaces: expected at most {MOST_SURFACES}")));
        }
        // A surface is as wide as its opening, if nothing else is said.
        for s in &mut self.surfaces {
            let widest = s.apertures.iter().map(Aperture::reach).fold(f64::INFINITY, f64::min);
            if s.semi_diameter.is_none() && widest.is_finite() {
                s.semi_diameter = Some(widest.min(reach(&s.profile, widest)));
            }
        }
        for (i, s) in self.surfaces.iter().enumerate() {
            let wrong = |what: String| PrescriptionError::at(file, s.line, what).surface(i + 1);
            let (c, c_x) = (s.profile.curvature(), s.profile.curvature_x());
            if !c.is_finite() || !c_x.is_finite() || c.abs() > 1e6 || c_x.abs() > 1e6 {
                return Err(wrong("a radius that is 0 or not a number: write no radius (or inf) for a plane".into()));
            }
            if let Profile::Conic { k, .. } = &s.profile
                && !k.is_finite()
            {
                return Err(wrong("a conic constant that is not a number".into()));
            }
            if let Profile::Biconic { k_x, k_y, .. } = &s.profile
                && !(k_x.is_finite() && k_y.is_finite())
            {
                return Err(wrong("a conic constant that is not a number".into()));
            }
            let base = match &s.profile {
                Profile::Asphere(a) | Profile::Toroid { y: a, .. } | Profile::Fresnel(a) => Some(a),
                Profile::Freeform(f) => Some(&f.base),
                _ => None,
            };
            if let Some(a) = base
                && (!a.k.is_finite() || a.a.iter().any(|v| !v.is_finite()))
            {
                return Err(wrong("an aspheric coefficient that is not a number".into()));
            }
            if let Some(g) = &s.gradient {
                if s.glass.kind == GlassKind::Air || s.mirror || i + 1 == count {
                    return Err(wrong(
                        "a gradient in air, behind a mirror or before the film: expected a glass between two surfaces".into(),
                    ));
                }
                let n0 = s.glass.index(self.inference_nm());
                for row in &s.gap.values {
                    for z in row.iter().flat_map(|gap| [0.0, 0.5 * gap, *gap]) {
                        for h in [0.0, 0.5, 1.0].map(|part| part * s.semi_diameter.unwrap_or(0.0)) {
                            let n = g.index(n0, DVec3::new(0.0, h, z));
                            if !(1.0..=4.5).contains(&n) {
                                return Err(wrong(format!(
                                    "gradient: an index of {n} at a height of {h}, {z} mm in: expected 1 to 4.5"
                                )));
                            }
                        }
                    }
                }
            }
            if let Some(focal) = s.ideal_focal_length {
                if !(focal != 0.0 && focal.abs() < LARGEST) {
                    return Err(wrong(format!("ideal_focal_length {focal}: expected a length in mm that is not 0")));
                }
                let air = |g: &Glass| g.kind == GlassKind::Air;
                if s.profile != Profile::Plane || s.mirror || s.diffractive.is_some() {
                    return Err(wrong("an ideal lens on a curved or diffractive surface or a mirror: expected a plane".into()));
                }
                if !air(&s.glass) || (i > 0 && !air(&self.surfaces[i - 1].glass)) {
                    return Err(wrong("an ideal lens beside glass: it stands in air, give it a surface of its own".into()));
                }
            }
            let columns = self.zoom.len().max(1);
            for row in &s.gap.values {
                if let Some(bad) = row.iter().find(|g| !g.is_finite() || g.abs() > LARGEST) {
                    return Err(wrong(format!("gap {bad}: expected a length within {LARGEST} mm")));
                }
                if row.len() != 1 && row.len() != columns {
                    let expected = if columns == 1 { "one" } else { "one, or one for each zoom position" };
                    return Err(wrong(format!("{} gaps: expected {expected} ({columns})", row.len())));
                }
            }
            if s.gap.focuses() && self.close_focus.is_none() {
                return Err(wrong("a gap for close focus, but the lens has no close_focus distance".into()));
            }
            if !(s.obstruction >= 0.0 && s.obstruction < LARGEST) {
                return Err(wrong(format!("obstruction {}: expected 0 or more, in mm", s.obstruction)));
            }
            if let Some(sd) = s.semi_diameter {
                if !(sd > 0.0 && sd < LARGEST) {
                    return Err(wrong(format!("semi-diameter {sd}: expected a positive length in mm")));
                }
                if !(s.obstruction < sd) {
                    return Err(wrong(format!("obstruction {}: expected 0 to the semi-diameter {sd}", s.obstruction)));
                }
                // Rounded figures of hemispheres get a millionth.
                let edge = sd * (1.0 - 1e-6);
                if s.profile.sag(0.0, edge).is_none() || s.profile.sag(edge, 0.0).is_none() {
                    let reach = reach(&s.profile, sd);
                    return Err(wrong(format!("semi-diameter {sd}: the surface ends at a height of {reach:.4} mm")));
                }
            }
        }
        let u = &self.usage;
        let impossible = match u.aperture {
            Some(ApertureKind::EntrancePupil(mm)) if !(mm > 0.0 && mm < LARGEST) => {
                Some(format!("entrance pupil diameter {mm} mm: expected a positive number"))
            }
            Some(ApertureKind::FNumber(n)) if !(n > 0.0 && n < LARGEST) => {
                Some(format!("f-number {n}: expected a positive number"))
            }
            Some(ApertureKind::ObjectNa(na)) if !(na > 0.0 && na < 1.0) => {
                Some(format!("numerical aperture of the object's side {na}: expected a positive number below 1"))
            }
            _ => None,
        };
        if let Some(what) = impossible {
            return Err(whole(what));
        }
        if let Some(bad) = u.field_angles_deg.iter().find(|f| !(f.abs() <= 120.0)) {
            return Err(whole(format!("field {bad}: expected an angle within 120 degrees")));
        }
        if let Some(bad) = u.wavelengths_nm.iter().find(|w| !WAVELENGTHS_NM.contains(*w)) {
            let (least, most) = WAVELENGTHS_NM.into_inner();
            return Err(whole(format!("wavelength {bad} nm: expected {least} to {most}")));
        }
        if u.vignetting.iter().flatten().any(|v| !(v.abs() <= 1.0)) {
            return Err(whole("vignetting factors: expected -1 to 1".into()));
        }
        if let Some(d) = u.object_distance.filter(|d| !(*d > 0.0)) {
            return Err(whole(format!(
                "object distance {d} mm: expected a positive length; leave it out for an object at infinity"
            )));
        }
        if !(u.defocus.abs() < LARGEST) {
            return Err(whole(format!("defocus {}: expected a length within {LARGEST} mm", u.defocus)));
        }
        if self.object_axis.is_some() && self.hood.is_some() {
            return Err(whole("a hood on a lens with an object_axis: hoods stand on the axis of round lenses".into()));
        }
        if let Some(z) = self.zoom.iter().find(|z| !(**z > 0.0 && **z < LARGEST)) {
            return Err(whole(format!("zoom position {z}: expected a focal length in mm")));
        }
        for (what, value) in [
            ("focal_length", self.focal_length.map(f64::abs)),
            ("f_number", self.f_number),
            ("image_circle", self.image_circle),
            ("close_focus", self.close_focus),
        ] {
            if value.is_some_and(|v| !(v > 0.0 && v < LARGEST)) {
                return Err(whole(format!("{what} {}: expected a positive number", value.unwrap_or(0.0))));
            }
        }
        if let Some([first, last]) = self.stabiliser.filter(|[first, last]| first > last || *last >= count) {
            let found = format!("stabiliser of surfaces {} to {}", first + 1, last.wrapping_add(1));
            return Err(whole(format!("{found}: expected the first and the last of 1 to {count}")));
        }
        for m in &self.misalignments {
            if m.first > m.last || m.last >= count {
                let what = format!(
                    "element of surfaces {} to {}: expected the first and the last of 1 to {count}",
                    m.first + 1,
                    m.last.wrapping_add(1)
                );
                return Err(whole(what));
            }
        }
        let axis = self.object_axis.iter();
        let decenters = self.misalignments.iter().flat_map(|m| &m.decenter).chain(self.surfaces.iter().flat_map(|s| &s.decenter));
        if let Some(bad) = decenters.chain(axis.clone().flat_map(|a| &a.decenter)).find(|v| !(v.abs() < LARGEST)) {
            return Err(whole(format!("decenter {bad}: expected a length within {LARGEST} mm")));
        }
        let tilts = self.misalignments.iter().flat_map(|m| &m.tilt).chain(self.surfaces.iter().flat_map(|s| &s.tilt));
        if let Some(bad) = tilts.chain(axis.flat_map(|a| &a.tilt)).find(|v| !(v.abs() <= 1000.0)) {
            return Err(whole(format!("tilt {bad}: expected degrees within 1000")));
        }

        let stops: Vec<usize> = (0..count).filter(|i| self.surfaces[*i].stop).collect();
        if let [first, second, ..] = stops[..] {
            let s = &self.surfaces[second];
            let what = format!("a second stop: surface {} is one already", first + 1);
            return Err(PrescriptionError::at(file, s.line, what).surface(second + 1));
        }
        if stops.is_empty() {
            let stop = self.infer_stop();
            self.surfaces[stop].stop = true;
            let reason = match self.surfaces.iter().any(|s| s.semi_diameter.is_some()) {
                true => "which limits the axial beam,",
                false => "the first,",
            };
            self.notes.push(format!("no stop given: surface {}, {reason} is taken for it", stop + 1));
        }
        self.check_base_ray(file)?;
        self.infer_film();
        self.infer_semi_diameters(file)?;
        self.check_gaps(file)?;
        let extrapolated = self.extrapolated(&self.usage.wavelengths_nm);
        self.notes.extend(extrapolated);
        self.note_clipped_aperture();
        Ok(self)
    }

    /// A sentence for each glass and wavelength (nm) where the index lies beyond what is known of the glass
    /// ([`crate::glass::Glass::extrapolated`]); each once, at most 40.
    pub fn extrapolated(&self, wavelengths_nm: &[f64]) -> Vec<String> {
        let mut found: Vec<String> = vec![];
        for nm in wavelengths_nm {
            for sentence in self.surfaces.iter().filter_map(|s| s.glass.extrapolated(*nm)) {
                if found.len() < 40 && !found.contains(&sentence) {
                    found.push(sentence);
                }
            }
        }
        found
    }

    /// Notes an aperture of the file that rims let through in part only.
    fn note_clipped_aperture(&mut self) {
        if self.usage.object_distance.is_some_and(|d| d.is_finite() && d < 1e9) {
            return;
        }
        let system = System::at(self, State::default());
        let n = system.indices(crate::glass::D_NM);
        let efl = paraxial::FirstOrder::of(&system, &n).efl;
        let wanted = match self.usage.aperture {
            Some(ApertureKind::EntrancePupil(d)) => 0.5 * d,
            Some(ApertureKind::FNumber(f)) => 0.5 * efl.abs() / f,
            Some(ApertureKind::ObjectNa(_)) | None => return,
        };
        // Less than this is the rounding of the figures.
        const ROUNDING: f64 = 0.99;
        if let Some(found) = f_number::widest_radius(&system, &n, efl).filter(|r| *r < ROUNDING * wanted) {
            let by = f_number::clipping_surface(&system, &n, wanted).map_or(String::new(), |s| format!(" of surface {}", s + 1));
            self.notes.push(format!(
                "the file's entrance pupil of {:.4} mm (f/{:.2}) is clipped to {:.4} mm (f/{:.2}) by the rim{by}",
                2.0 * wanted,
                efl.abs() / (2.0 * wanted),
                2.0 * found,
                efl.abs() / (2.0 * found)
            ));
        }
    }

    /// Of a lens whose object has an axis of its own: it must be a base ray, which comes through the stop's opening to the film.
    fn check_base_ray(&self, file: &str) -> Result<(), PrescriptionError> {
        if self.object_axis.is_none() {
            return Ok(());
        }
        let system = System::at(self, State::default());
        let n = system.indices(self.inference_nm());
        let along = TracedRay { position: DVec3::ZERO, direction: DVec3::Z };
        let through = system.base_ray(&n).is_ok_and(|end| end.direction.z * system.film_run() > 0.01);
        let at = at_stop::place_at_stop(&system, &n, along).filter(|_| through);
        let stop = &system.surfaces[system.stop];
        match at.is_some_and(|at| stop.lets_through(at.x, at.y)) {
            true => Ok(()),
            false => {
                let what = "object_axis: light along it does not come through the opening of the stop to the film: expected the base ray, from the middle \
                            of the field through the middle of the stop";
                Err(PrescriptionError::at(file, 0, what))
            }
        }
    }

    /// Gaps must not be negative where light runs forward, and neighbours must not cross where light can pass.
    fn check_gaps(&self, file: &str) -> Result<(), PrescriptionError> {
        if self.object_axis.is_some() {
            return Ok(());
        }
        let zooms: Vec<f64> = (0..self.zoom.len().max(1)).map(|z| z as f64).collect();
        for &zoom in &zooms {
            for focus in [0.0, 1.0] {
                let mut run = 1.0;
                for (i, s) in self.surfaces.iter().enumerate() {
                    if s.mirror {
                        run = -run;
                    }
                    let gap = s.gap.at(zoom, focus) * run;
                    let wrong = |what: String| PrescriptionError::at(file, s.line, what).surface(i + 1);
                    let sign = if run < 0.0 { "after a mirror gaps are negative" } else { "surfaces would cross" };
                    let Some(next) = self.surfaces.get(i + 1) else {
                        if gap < -1e-9 {
                            return Err(wrong(format!(
                                "gap {} to the film: the film would stand in the lens",
                                s.gap.at(zoom, focus)
                            )));
                        }
                        continue;
                    };
                    let free = self.is_free_stop(i) || self.is_free_stop(i + 1);
                    if gap < -1e-9 && !free {
                        return Err(wrong(format!("gap {}: {sign}", s.gap.at(zoom, focus))));
                    }
                    // At the height both rims reach.
                    let h = rim_height(s).min(rim_height(next)) * (1.0 - 1e-6);
                    if let (Some(a), Some(b)) = (s.profile.sag(0.0, h), next.profile.sag(0.0, h)) {
                        let edge = gap + run * (b - a);
                        if edge < -overlap(h) && !free {
                            return Err(wrong(format!(
                                "it crosses surface {} at a height of {h:.3} mm (edge thickness {edge:.3} mm): \
                                 a gap too small or semi-diameters too large",
                                i + 2
                            )));
                        }
                    }
                }
            }
        }
        Ok(())
    }
}

/// Height along y at which a surface ends.
fn rim_height(s: &Surface) -> f64 {
    let along_y = |a: &Aperture| match a.outline() {
        Outline::Rectangle([_, y]) | Outline::Ellipse([_, y])
            if !a.blocks() && a.center() == [0.0; 2] && a.rotation_deg() == 0.0 =>
        {
            y
        }
        _ => a.reach(),
    };
    s.apertures.iter().map(along_y).fold(s.semi_diameter.unwrap_or(0.0), f64::min)
}

#[cfg(test)]
mod tests;
