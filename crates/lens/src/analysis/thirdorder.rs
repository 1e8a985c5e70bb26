//! Third-order (Seidel) and chromatic sums by surface.
//!
//! Formulas: Welford, "Aberrations of Optical Systems" (1986), §8.2–8.6 and §10.4. As transverse aberrations they are what CODE V
//! prints with THO.

use crate::paraxial::Trace;
use crate::system::System;

/// Contribution of a surface, or a sum of them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SurfaceSums {
    /// Seidel sums S_I to S_V, mm.
    pub seidel: [f64; 5],
    /// Axial and lateral colour C_I, C_II, mm.
    pub chromatic: [f64; 2],
    /// Petzval contribution −(n' − n) c / (n n'), 1/mm.
    pub petzval: f64,
}

/// Third-order analysis of a lens for an aperture and a field.
#[derive(Clone, Debug)]
pub struct ThirdOrder {
    /// By surface.
    pub surfaces: Vec<SurfaceSums>,
    /// n' u' of the marginal ray in image space.
    pub image_slope: f64,
    /// Lagrange invariant H = n (ū y − u ȳ), mm.
    pub invariant: f64,
}

impl ThirdOrder {
    /// `n`: indices at the reference wavelength; `dispersion`: n(short) − n(long) of each gap; `object_distance`: from the object to the first vertex, mm, `None` at infinity;
    /// `height`: marginal ray in the entrance pupil, mm; `slope`: tangent of the field angle.
    pub fn of(
        system: &System,
        n: &[f64],
        dispersion: &[f64],
        object_distance: Option<f64>,
        height: f64,
        slope: f64,
    ) -> ThirdOrder {
        let axial = Trace::axial(system, n);
        let slanted = Trace::new(system, n, 0.0, 1.0);
        // The chief ray crosses the middle of the stop.
        let entrance_pupil_z = slanted.heights[system.stop] / axial.heights[system.stop];
        let chief_y = -slope * entrance_pupil_z;
        // From the axial point of the object to the rim of the pupil.
        let (marginal_y, marginal_slope) = match object_distance {
            None => (height, 0.0),
            Some(d) => (height * d / (d + entrance_pupil_z), height / (d + entrance_pupil_z)),
        };
        let marginal = Trace::new(system, n, marginal_y, marginal_slope);
        let chief = Trace::new(system, n, chief_y, slope);
        let invariant = n[0] * (slope * marginal_y - marginal_slope * chief_y);
        let signed = |i: usize| n[i] * system.runs[i];
        let surfaces = (0..system.surfaces.len())
            .map(|i| {
                let (n0, n1) = (signed(i), signed(i + 1));
                // Gradients, phases and facets have contributions of their own, and a base ray askew others, which are not computed: no numbers rather than wrong ones.
                let is_fresnel = |s: &crate::system::PlacedSurface| matches!(s.profile, crate::surface::Profile::Fresnel(_));
                let is_askew = system.object_axis.is_some();
                if is_askew || system.has_gradients() || system.has_diffractive() || system.surfaces.iter().any(is_fresnel) {
                    let nan = f64::NAN;
                    return SurfaceSums { seidel: [nan; 5], chromatic: [nan; 2], petzval: nan };
                }
                // Free of aberrations by definition.
                if system.surfaces[i].ideal_focal_length.is_some() {
                    return SurfaceSums::default();
                }
                let profile = &system.surfaces[i].profile;
                let c = system.surfaces[i].section_curvature();
                let (y, y_bar) = (marginal.heights[i], chief.heights[i]);
                let (u0, u1) = (marginal.angles[i], marginal.angles[i + 1]);
                let a = n0 * (u0 + y * c);
                let a_bar = n0 * (chief.angles[i] + y_bar * c);
                let d = u1 / n1 - u0 / n0;
                let petzval = c * (1.0 / n1 - 1.0 / n0);
                let s1 = -a * a * y * d;
                let s2 = -a * a_bar * y * d;
                let s3 = -a_bar * a_bar * y * d;
                let s4 = -invariant * invariant * petzval;
                // Without A in a denominator (Welford 8.36).
                let inverse_square = 1.0 / (n1 * n1) - 1.0 / (n0 * n0);
                let s5 = -a_bar * (a_bar * a_bar * inverse_square * y - (invariant + a_bar * y) * y_bar * petzval);
                let mut seidel = [s1, s2, s3, s4, s5];
                let g = match profile {
                    crate::surface::Profile::Conic { c, k } => k * c.powi(3) / 8.0,
                    crate::surface::Profile::Asphere(a) => a.fourth_order(),
                    crate::surface::Profile::Forbes(f) => f.fourth_order(),
                    crate::surface::Profile::Biconic { c_y, k_y, .. } => k_y * c_y.powi(3) / 8.0,
                    crate::surface::Profile::Freeform(f) => f.fourth_order(),
                    _ => 0.0,
                };
                let s = 8.0 * g * (n1 - n0);
                seidel[0] += s * y.powi(4);
                seidel[1] += s * y.powi(3) * y_bar;
                seidel[2] += s * y * y * y_bar * y_bar;
                seidel[4] += s * y * y_bar.powi(3);
                let color = dispersion[i + 1] / n[i + 1] - dispersion[i] / n[i];
                SurfaceSums { seidel, chromatic: [a * y * color, a_bar * y * color], petzval }
            })
            .collect();
        let last = system.surfaces.len();
        ThirdOrder { surfaces, image_slope: signed(last) * marginal.angles[last], invariant }
    }

    /// Over all surfaces.
    pub fn sum(&self) -> SurfaceSums {
        self.surfaces.iter().fold(SurfaceSums::default(), |mut sum, s| {
            sum.seidel.iter_mut().zip(s.seidel).for_each(|(a, b)| *a += b);
            sum.chromatic.iter_mut().zip(s.chromatic).for_each(|(a, b)| *a += b);
            sum.petzval += s.petzval;
            sum
        })
    }

    /// Transverse aberrations in mm: spherical, tangential coma, tangential and sagittal astigmatism, Petzval blur,
    /// distortion, axial and lateral colour.
    pub fn transverse(&self, s: &SurfaceSums) -> [f64; 8] {
        let [s1, s2, s3, s4, s5] = s.seidel.map(|v| v / (2.0 * self.image_slope));
        let [c1, c2] = s.chromatic.map(|v| v / self.image_slope);
        [s1, 3.0 * s2, 3.0 * s3 + s4, s3 + s4, s4, s5, c1, c2]
    }
}
