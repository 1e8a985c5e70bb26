//! A lens in another size: all lengths times one number, all angles as they were.
//!
//! Scaled are shapes, gaps, rims and apertures, shifts, the image circle, the distances of object and near focus. Not scaled, because a larger lens has
//! them unchanged: indices, Abbe numbers and absorption of glasses, coatings (layers go with the wavelength), roughness, angles and f-numbers. Gradients
//! keep the indices of corresponding places; phases of diffractive surfaces grow with the lens, so that they bend rays as before. Aberrations in mm
//! grow with the lens, diffraction at an f-number does not. Source: Smith, "Modern Optical Engineering", §13 "Scaling".

use super::{ApertureKind, Prescription, PrescriptionError, Surface};
use crate::aperture::{Aperture, Outline};
use crate::diffractive::Diffractive;
use crate::forbes::Forbes;
use crate::freeform::Freeform;
use crate::gradient::Gradient;
use crate::polynomial::Polynomial;
use crate::surface::{Asphere, Profile};

impl Prescription {
    /// All lengths times `factor` (above 0). Fails where a number leaves the range it may have. What only the whole lens tells (rims that overlap by more
    /// than published ones may) is looked at by [`Prescription::checked`].
    pub fn scaled(&self, factor: f64) -> Result<Prescription, PrescriptionError> {
        let wrong = |what: String| PrescriptionError::at(&self.name, 0, format!("scaled by {factor}: {what}"));
        if !(factor > 0.0 && factor.is_finite()) {
            return Err(wrong("expected a number above 0".into()));
        }
        let mut lens = self.clone();
        for (i, s) in lens.surfaces.iter_mut().enumerate() {
            *s = surface(s, factor).map_err(|what| wrong(what).surface(i + 1))?;
        }
        for length in [&mut lens.focal_length, &mut lens.image_circle, &mut lens.close_focus, &mut lens.usage.object_distance] {
            *length = length.map(|v| v * factor);
        }
        lens.zoom.iter_mut().for_each(|f| *f *= factor);
        for m in &mut lens.misalignments {
            m.decenter = m.decenter.map(|v| v * factor);
        }
        if let Some(axis) = &mut lens.object_axis {
            axis.decenter = axis.decenter.map(|v| v * factor);
        }
        if let Some(hood) = &mut lens.hood {
            hood.length *= factor;
            hood.diameter = hood.diameter.map(|d| d * factor);
        }
        if let Some(ApertureKind::EntrancePupil(d)) = &mut lens.usage.aperture {
            *d *= factor;
        }
        lens.usage.defocus *= factor;
        Ok(lens)
    }
}

fn surface(s: &Surface, factor: f64) -> Result<Surface, String> {
    let mut s = s.clone();
    s.profile = profile(&s.profile, factor)?;
    s.gap.values.iter_mut().flatten().for_each(|g| *g *= factor);
    if let Some(g) = &s.gradient {
        // The index at a corresponding place stays: coefficients of r²ⁱ and zⁱ shrink by that power of the factor.
        let each = |values: &[f64], step: i32| {
            values.iter().enumerate().map(|(i, v)| v / factor.powi(step * (i as i32 + 1))).collect::<Vec<_>>()
        };
        s.gradient = Some(Gradient::new(g.is_squared(), each(g.radial(), 2), each(g.axial(), 1))?);
    }
    s.semi_diameter = s.semi_diameter.map(|v| v * factor);
    s.obstruction *= factor;
    s.apertures = s.apertures.iter().map(|a| aperture(a, factor)).collect::<Result<_, _>>()?;
    s.ideal_focal_length = s.ideal_focal_length.map(|v| v * factor);
    if let Some(d) = &s.diffractive {
        s.diffractive = Some(Diffractive::new(d.order(), polynomial(d.phase(), factor)?, d.blaze())?);
    }
    s.decenter = s.decenter.map(|v| v * factor);
    Ok(s)
}

fn asphere(a: &Asphere, factor: f64) -> Asphere {
    let term = |(i, v): (usize, &f64)| v * factor.powi(1 - i as i32);
    Asphere { c: a.c / factor, k: a.k, a: a.a.iter().enumerate().map(term).collect() }
}

/// Value and arguments grow alike.
fn polynomial(p: &Polynomial, factor: f64) -> Result<Polynomial, String> {
    Ok(Polynomial::new(p.norm_mm() * factor, p.terms().clone())?.times(factor))
}

fn profile(p: &Profile, factor: f64) -> Result<Profile, String> {
    Ok(match p {
        Profile::Plane => Profile::Plane,
        Profile::Sphere(c) => Profile::Sphere(c / factor),
        Profile::Conic { c, k } => Profile::Conic { c: c / factor, k: *k },
        Profile::Asphere(a) => Profile::Asphere(asphere(a, factor)),
        Profile::Fresnel(a) => Profile::Fresnel(asphere(a, factor)),
        Profile::Forbes(f) => {
            let terms = f.terms().iter().map(|t| t * factor).collect();
            Profile::Forbes(Forbes::new(f.kind(), f.c() / factor, f.k(), f.norm_mm() * factor, terms)?)
        }
        Profile::Freeform(f) => {
            Profile::Freeform(Box::new(Freeform { base: asphere(&f.base, factor), departure: polynomial(&f.departure, factor)? }))
        }
        Profile::Toroid { y, c_x } => Profile::Toroid { y: asphere(y, factor), c_x: c_x / factor },
        Profile::Biconic { c_x, k_x, c_y, k_y } => {
            Profile::Biconic { c_x: c_x / factor, k_x: *k_x, c_y: c_y / factor, k_y: *k_y }
        }
    })
}

fn aperture(a: &Aperture, factor: f64) -> Result<Aperture, String> {
    let outline = match a.outline() {
        Outline::Rectangle(half) => Outline::Rectangle(half.map(|v| v * factor)),
        Outline::Ellipse(half) => Outline::Ellipse(half.map(|v| v * factor)),
        Outline::Ring(radii) => Outline::Ring(radii.map(|v| v * factor)),
        Outline::Spider { arms, width } => Outline::Spider { arms, width: width * factor },
    };
    Aperture::new(outline, a.blocks(), a.center().map(|v| v * factor), a.rotation_deg())
}

#[cfg(test)]
mod tests {
    use crate::analysis::Bench;
    use crate::glass::D_NM;
    use crate::prescription::read_toml;
    use crate::ray::{Apertures, TraceDirection, TracedRay};
    use crate::trace::at_plane;
    use crate::{Prescription, State, System, embedded, embedded_names};
    use glam::DVec3;

    /// A ray through both: places times the factor, directions the same.
    fn same_rays(p: &Prescription, factor: f64) {
        let q = p.scaled(factor).unwrap();
        let [a, b] = [p, &q].map(|p| System::at(p, State::default()));
        let height = 0.3 * a.surfaces[0].semi_diameter.min(a.iris.radius);
        for [x, y, slope] in [[0.0, 0.0, 0.0], [0.7, 0.2, 0.0], [-0.3, 0.5, 0.05]] {
            let start = DVec3::new(x * height, y * height, -1.0);
            let direction = DVec3::new(0.02, slope, 1.0).normalize();
            let land = |s: &System, scale: f64| {
                let ray = TracedRay { position: start * scale, direction };
                let out = s.trace(ray, &s.indices(D_NM), TraceDirection::ToFilm, Apertures::Clip).ok()?;
                Some((at_plane(&out, s.film_z) / scale, out.direction))
            };
            match (land(&a, 1.0), land(&b, factor)) {
                // Gradients are followed in steps of a fixed length: 1e-6 there, rounding elsewhere.
                (Some(a), Some(b)) => {
                    let size = 1.0 + a.0.length();
                    assert!((a.0 - b.0).length() < 2e-6 * size && (a.1 - b.1).length() < 1e-6, "{}: {a:?} {b:?}", p.name);
                }
                (a, b) => assert_eq!(a.is_some(), b.is_some(), "{}", p.name),
            }
        }
        assert_eq!(q.f_number, p.f_number);
    }

    #[test]
    fn rays_through_a_scaled_lens_are_the_scaled_rays() {
        embedded_names().for_each(|name| same_rays(&embedded(name).unwrap(), 1.37));
    }

    #[test]
    fn every_kind_of_surface_is_scaled() {
        for fields in [
            "radius = 40, q_con = { radius = 9, terms = [0.02, -0.01] }",
            "radius = 40, q_bfs = { radius = 9, terms = [0.02, -0.01] }",
            "radius = 40, radius_x = 60",
            "radius = 40, conic = -1, radius_x = 60, conic_x = 0.5",
            "radius = 40, asphere = { 3 = 1e-5, 4 = 1e-5, 6 = -1e-8 }, fresnel = true",
            "radius = 40, decenter = [0.3, 0.2], tilt_deg = [1, 2, 3]",
            "radius = 40, apertures = [{ rectangle = [3, 9], center = [1, 0], rotation_deg = 10 }]",
            "radius = 40, gradient = { radial = [-1e-3, 1e-6], axial = [1e-3, 1e-5] }",
        ] {
            let text = format!(
                "name = \"{fields}\"\nsurfaces = [ {{ {fields}, gap = 4, glass = \"N-BK7\", semi_diameter = 10, stop = true }},\n\
                 {{ radius = -50, gap = 42, semi_diameter = 10 }} ]"
            );
            same_rays(&read_toml(&text, "test.toml").unwrap(), 1.37);
        }
        let ideal = "name = \"ideal\"\nsurfaces = [ { ideal_focal_length = 50, gap = 50, semi_diameter = 10, stop = true } ]";
        same_rays(&read_toml(ideal, "ideal.toml").unwrap(), 0.5);
    }

    #[test]
    fn light_on_the_film_depends_on_the_f_number_alone() {
        let p = embedded("double-gauss-50mm").unwrap();
        let light = |p: &Prescription, height: f64| {
            let system = System::at(p, State::default());
            Bench::at_infinity(&system).illumination(height, D_NM).geometric
        };
        let q = p.scaled(2.0).unwrap();
        for height in [0.0, 10.0] {
            assert!((light(&q, 2.0 * height) / light(&p, height) - 1.0).abs() < 1e-3);
        }
        assert!(p.scaled(0.0).is_err() && p.scaled(f64::NAN).is_err());
    }
}
