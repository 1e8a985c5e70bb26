//! Gradient-index media: an index that depends on the place, and the rays in them.
//!
//! In the frame of the surface before the medium, r² = x² + y² and z from its vertex in mm, n₀ the glass's own index at a wavelength:
//! n = n₀ + Σ Rᵢ r²ⁱ + Σ Aᵢ zⁱ (Zemax "Gradient 1" and "Gradient 3"), or n² = n₀² + the same sums ("Gradient 2"; a Selfoc rod
//! n² = n₀² (1 − α² r²) has R₁ = −n₀² α²). The coefficients are the same at all wavelengths.
//!
//! Rays: d²r/dt² = ½ ∇n² with dt = ds / n, by the Runge–Kutta scheme of Sharma, Kumar & Ghatak 1982 (Appl. Opt. 21, 984, doi
//! 10.1364/AO.21.000984, eqs 5 to 9), of the fourth order, in steps of [`STEP_MM`]. The optical path ∫ n² dt goes along by Simpson's
//! rule at the nodes of the same scheme.

use glam::DVec3;

/// Length of a step, mm.
pub const STEP_MM: f64 = 0.05;
/// Most coefficients of a sum.
const MOST_TERMS: usize = 12;

/// How the index departs from the glass's own.
#[derive(Clone, Debug, PartialEq)]
pub struct Gradient {
    squared: bool,
    radial: Vec<f64>,
    axial: Vec<f64>,
}

/// A ray within a medium.
#[derive(Clone, Copy, Debug)]
pub(crate) struct GradedRay {
    /// mm, in the frame of the surface before the medium.
    pub position: DVec3,
    /// Unit direction.
    pub direction: DVec3,
}

impl Gradient {
    /// `radial`: coefficients of r², r⁴, ...; `axial`: of z, z², ...; `squared`: of n² instead of n. Fails on more than 12 of either, and on
    /// numbers that are not finite.
    pub fn new(squared: bool, radial: Vec<f64>, axial: Vec<f64>) -> Result<Gradient, String> {
        if radial.len() > MOST_TERMS || axial.len() > MOST_TERMS {
            let what = format!("{} radial and {} axial coefficients", radial.len(), axial.len());
            return Err(format!("gradient: {what}: expected at most {MOST_TERMS} of each"));
        }
        if let Some(bad) = radial.iter().chain(&axial).find(|v| !v.is_finite()) {
            return Err(format!("gradient: coefficient {bad}: expected a number"));
        }
        Ok(Gradient { squared, radial, axial })
    }

    /// Whether the coefficients are those of n².
    pub fn is_squared(&self) -> bool {
        self.squared
    }

    /// Coefficients of r², r⁴, ...
    pub fn radial(&self) -> &[f64] {
        &self.radial
    }

    /// Coefficients of z, z², ...
    pub fn axial(&self) -> &[f64] {
        &self.axial
    }

    /// Whether the index depends on the height at all.
    pub fn is_radial(&self) -> bool {
        self.radial.iter().any(|v| *v != 0.0)
    }

    /// n² and ½ ∇n² at a place.
    #[inline]
    fn medium(&self, n0: f64, p: DVec3) -> (f64, DVec3) {
        let r2 = p.x * p.x + p.y * p.y;
        // Horner: Σ Rᵢ r²ⁱ and its derivative by r²; Σ Aᵢ zⁱ and its derivative by z.
        let horner = |c: &[f64], x: f64| c.iter().rev().fold((0.0, 0.0), |(v, d), c| ((v + c) * x, (v + c) + d * x));
        let ((radial, by_r2), (axial, by_z)) = (horner(&self.radial, r2), horner(&self.axial, p.z));
        let departure = radial + axial;
        let slope = DVec3::new(2.0 * p.x * by_r2, 2.0 * p.y * by_r2, by_z);
        match self.squared {
            true => (n0 * n0 + departure, slope * 0.5),
            false => ((n0 + departure).powi(2), slope * (n0 + departure)),
        }
    }

    /// The index at a place (mm, in the frame of the surface before the medium), where the glass's own is `n0`; not a number where there
    /// is none.
    pub fn index(&self, n0: f64, place: DVec3) -> f64 {
        self.medium(n0, place).0.sqrt()
    }

    /// Coefficient of r² of the index near the axis, ½ ∂²n/∂r², mm⁻², at z (mm from the vertex before the medium). `n0`: index of the glass.
    pub fn axial_curvature(&self, n0: f64, z: f64) -> f64 {
        let first = self.radial.first().copied().unwrap_or(0.0);
        if self.squared { first / (2.0 * self.index(n0, DVec3::new(0.0, 0.0, z))) } else { first }
    }

    /// Follows a ray to a surface. `distance` tells how far away along a straight line (mm, signed) the surface is from a ray; `None` where such a
    /// line misses it. Returns the ray on the surface and its optical path, mm; `None` where it does not get there within `most_mm`.
    pub(crate) fn follow(
        &self,
        n0: f64,
        ray: GradedRay,
        most_mm: f64,
        distance: impl Fn(&GradedRay) -> Option<f64>,
    ) -> Option<(GradedRay, f64)> {
        let mut position = ray.position;
        let mut momentum = ray.direction * self.index(n0, position);
        let (mut path, mut gone) = (0.0, 0.0);
        let mut near = 0;
        while gone <= most_mm {
            let (n2, force) = self.medium(n0, position);
            if !(n2 > 0.0) {
                return None;
            }
            let here = GradedRay { position, direction: momentum.normalize() };
            let ahead = distance(&here);
            // Within a step of it: the straight way as the length of a step, again and again, converges quadratically.
            let length = match ahead {
                Some(d) if d.abs() <= STEP_MM => {
                    if d.abs() < 1e-13 * (1.0 + gone) || near > 20 {
                        return (d.abs() < 1e-9).then_some((here, path));
                    }
                    near += 1;
                    d
                }
                // Behind: rims of neighbours may cross a little.
                Some(d) if d < 0.0 => -STEP_MM,
                _ => STEP_MM,
            };
            let dt = length / n2.sqrt();
            let a = force * dt;
            let (n2_middle, force) = self.medium(n0, position + (momentum + a * 0.25) * (0.5 * dt));
            let b = force * dt;
            let (n2_end, force) = self.medium(n0, position + (momentum + b * 0.5) * dt);
            let c = force * dt;
            position += (momentum + (a + b * 2.0) / 6.0) * dt;
            momentum += (a + b * 4.0 + c) / 6.0;
            path += dt * (n2 + 4.0 * n2_middle + n2_end) / 6.0;
            gone += length.abs();
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// To the plane z = `end`.
    fn to_plane(g: &Gradient, n0: f64, start: DVec3, direction: DVec3, end: f64) -> (GradedRay, f64) {
        let ray = GradedRay { position: start, direction: direction.normalize() };
        g.follow(n0, ray, 500.0, |r| Some((end - r.position.z) / r.direction.z)).unwrap()
    }

    #[test]
    fn meridional_rays_of_a_selfoc_rod_are_sinusoids() {
        // n² = n₀² (1 − α² r²): y = y₀ cos(α n₀ z/β) + (tan-like slope) sin, exact for any ray, with β = n cos θ the constant of
        // the motion along z (Ghatak & Thyagarajan, "Contemporary Optics", §1.4).
        let (n0, alpha) = (1.6f64, 0.1f64);
        let g = Gradient::new(true, vec![-(n0 * alpha).powi(2)], vec![]).unwrap();
        for (y0, slope) in [(0.0, 0.2), (1.5, 0.0), (1.0, -0.15)] {
            let start = DVec3::new(0.0, y0, 0.0);
            let direction = DVec3::new(0.0, slope, 1.0);
            let n = g.index(n0, start);
            let beta = n / (1.0f64 + slope * slope).sqrt();
            for end in [3.0, 17.0, 62.8] {
                let (found, path) = to_plane(&g, n0, start, direction, end);
                let k = n0 * alpha / beta;
                let (s, c) = (k * end).sin_cos();
                let y = y0 * c + slope / k * s;
                // Fourth order: (α step)⁴ of a millimetre for each millimetre gone.
                assert!((found.position.y - y).abs() < 1e-8, "{y0} {slope} {end}: {} {y}", found.position.y);
                let dy = -y0 * k * s + slope * c;
                assert!((found.direction.y / found.direction.z - dy).abs() < 1e-9);
                // ∫ n² dz / β along the sinusoid, by 2000 steps of Simpson.
                let n2 = |z: f64| {
                    let (s, c) = (k * z).sin_cos();
                    n0 * n0 * (1.0 - (alpha * (y0 * c + slope / k * s)).powi(2))
                };
                let h = end / 2000.0;
                let sum: f64 =
                    (0..2000).map(|i| (n2(h * i as f64) + 4.0 * n2(h * (i as f64 + 0.5)) + n2(h * (i + 1) as f64)) / 6.0).sum();
                assert!((path - sum * h / beta).abs() < 1e-7, "{path} {}", sum * h / beta);
            }
        }
    }

    #[test]
    fn a_luneburg_lens_brings_parallel_light_to_a_point_of_its_rim_with_equal_paths() {
        // n² = 2 − (r/R)² within a ball of radius R in air; light along z through the height h leaves at the far pole (Luneburg 1944; Born & Wolf
        // §4.2.2 for its kin), where its angle to the axis is the asin of h/R. In the frame of the front vertex n² = 1 + 2z/R − z²/R² − (x² + y²)/R².
        let radius = 10.0f64;
        let g = Gradient::new(true, vec![-radius.powi(-2)], vec![2.0 / radius, -radius.powi(-2)]).unwrap();
        let mut paths = vec![];
        for h in [DVec3::ZERO, DVec3::new(2.0, 0.0, 0.0), DVec3::new(-3.0, 4.0, 0.0), DVec3::new(0.0, 8.0, 0.0)] {
            // On the rim n = 1: rays enter as they come.
            let entry = h + DVec3::Z * (radius - (radius * radius - h.length_squared()).sqrt());
            assert!((g.index(1.0, entry) - 1.0).abs() < 1e-14);
            let (found, path) = to_plane(&g, 1.0, entry, DVec3::Z, 2.0 * radius);
            // Fourth order in steps of 0.05 mm over lengths of 10: (5e-3)⁴ of some 20 mm.
            assert!((found.position - DVec3::Z * (2.0 * radius)).length() < 1e-8, "{h}: {}", found.position);
            assert!((found.direction.truncate() + h.truncate() / radius).length() < 1e-8, "{h}: {}", found.direction);
            paths.push(entry.z + path);
        }
        // From a plane wave to its image all paths are the same: R (1 + π/2).
        let expected = radius * (1.0 + 0.5 * std::f64::consts::PI);
        assert!(paths.iter().all(|p| (p - expected).abs() < 1e-7), "{paths:?} {expected}");
    }

    #[test]
    fn a_sech_rod_images_its_axis_without_aberration_and_with_equal_paths() {
        // n = n₀ sech(αr): sinh(αy) is a sinusoid of αz for every meridional ray, whatever its height, so that all meet again where αz is a multiple of π
        // (Fletcher, Murphy & Young 1954, Proc. R. Soc. A 223, 216). sech² x = Σ by the series of tanh' (Abramowitz & Stegun 4.5.64).
        let (n0, alpha) = (1.5f64, 0.1f64);
        let sech2 =
            [-1.0, 2.0 / 3.0, -17.0 / 45.0, 62.0 / 315.0, -1382.0 / 14_175.0, 21_844.0 / 467_775.0, -929_569.0 / 42_567_525.0];
        let radial = sech2.iter().enumerate().map(|(i, c)| n0 * n0 * c * alpha.powi(2 * i as i32 + 2)).collect();
        let g = Gradient::new(true, radial, vec![]).unwrap();
        let half = std::f64::consts::PI / alpha;
        for slope in [0.05f64, 0.15, 0.28] {
            // sinh(αy) = A sin αz: at the axis dy/dz = A.
            for end in [4.0, 0.5 * half, 0.8 * half] {
                let (found, _) = to_plane(&g, n0, DVec3::ZERO, DVec3::new(0.0, slope, 1.0), end);
                let y = (slope * (alpha * end).sin()).asinh() / alpha;
                // αy stays below 0.28: the next term of the series is 1e-2 × 0.28¹⁶ = 1e-11 of n², gathered over 30 mm; the scheme's own error is 1e-9.
                assert!((found.position.y - y).abs() < 1e-8, "{slope} {end}: {} {y}", found.position.y);
            }
            let (found, path) = to_plane(&g, n0, DVec3::ZERO, DVec3::new(0.0, slope, 1.0), half);
            assert!(
                found.position.y.abs() < 1e-8 && (path - n0 * half).abs() < 1e-7,
                "{slope}: {} {}",
                found.position.y,
                path - n0 * half
            );
        }
        // A parabolic rod of the same curvature has spherical aberration: 3 orders more than the tolerance.
        let rod = Gradient::new(true, vec![-(n0 * alpha).powi(2)], vec![]).unwrap();
        let (found, _) = to_plane(&rod, n0, DVec3::ZERO, DVec3::new(0.0, 0.28, 1.0), half);
        assert!(found.position.y.abs() > 1e-2, "{}", found.position.y);
    }

    #[test]
    fn skew_rays_of_a_rod_are_helices_and_ellipses() {
        // n² = n₀² (1 − α² r²): x and y swing alone, with the same β = n cos γ; a ray that circles keeps its distance from the axis where
        // its slope is α n₀ r / β (Ghatak & Thyagarajan, "Contemporary Optics", §1.4).
        let (n0, alpha, r) = (1.5f64, 0.08f64, 2.0f64);
        let g = Gradient::new(true, vec![-(n0 * alpha).powi(2)], vec![]).unwrap();
        let n2 = n0 * n0 * (1.0 - (alpha * r).powi(2));
        // tan² = (α n₀ r)² / β², β² = n² / (1 + tan²): β² = n² − (α n₀ r)².
        let beta = (n2 - (alpha * n0 * r).powi(2)).sqrt();
        let slope = alpha * n0 * r / beta;
        for end in [4.0, 25.0, 60.0] {
            let (found, path) = to_plane(&g, n0, DVec3::new(r, 0.0, 0.0), DVec3::new(0.0, slope, 1.0), end);
            let (s, c) = (alpha * n0 / beta * end).sin_cos();
            assert!((found.position.truncate() - glam::DVec2::new(r * c, r * s)).length() < 1e-8, "{end}: {}", found.position);
            // The index along it is the same everywhere: n² z / β.
            assert!((path - n2 * end / beta).abs() < 1e-8, "{end}: {path}");
        }
    }

    #[test]
    fn axial_gradients_keep_the_transverse_momentum() {
        // n(z): n sin θ is constant (Snell in layers), and the height is ∫ tan θ dz.
        let g = Gradient::new(false, vec![], vec![0.03, -0.001]).unwrap();
        let direction = DVec3::new(0.1, -0.25, 1.0).normalize();
        let (found, _) = to_plane(&g, 1.5, DVec3::ZERO, direction, 8.0);
        let n = |z: f64| 1.5 + 0.03 * z - 0.001 * z * z;
        let invariant = 1.5 * direction.truncate();
        assert!((found.direction.truncate() * n(8.0) - invariant).length() < 1e-12);
        let slope = |z: f64| invariant / (n(z) * n(z) - invariant.length_squared()).sqrt();
        let h = 8.0 / 1000.0;
        let place = |i: f64| slope(h * i);
        let sum = (0..1000).map(|i| (place(i as f64) + place(i as f64 + 0.5) * 4.0 + place((i + 1) as f64)) * (h / 6.0));
        let sum = sum.fold(glam::DVec2::ZERO, |a, b| a + b);
        assert!((found.position.truncate() - sum).length() < 1e-9, "{} {sum}", found.position);
    }

    #[test]
    fn halving_the_way_changes_nothing_and_rays_run_back() {
        let g = Gradient::new(false, vec![-0.004, 2e-5], vec![0.01]).unwrap();
        let start = DVec3::new(1.0, -0.7, 0.0);
        let direction = DVec3::new(0.05, 0.2, 1.0);
        let (whole, path) = to_plane(&g, 1.62, start, direction, 10.0);
        let (half, first) = to_plane(&g, 1.62, start, direction, 5.013);
        let (two, second) = to_plane(&g, 1.62, half.position, half.direction, 10.0);
        // Other nodes, the same order: what is left is the error of the scheme.
        assert!((whole.position - two.position).length() < 1e-9 && (path - first - second).abs() < 1e-9);
        let (back, length) = to_plane(&g, 1.62, whole.position, -whole.direction, 0.0);
        assert!((back.position - start).length() < 1e-9 && (length - path).abs() < 1e-9);
        assert!(Gradient::new(false, vec![f64::NAN], vec![]).is_err());
    }

    const ROD: &str = "name = \"rod\"\nsurfaces = [\n{ stop = true, gap = 12, glass = \"1.6\", semi_diameter = 2, gradient = { radial = [-0.0256], squared = true } },\n\
        { gap = 8, semi_diameter = 3 },\n]\n";

    #[test]
    fn a_rod_has_the_focal_length_of_the_books() {
        use crate::paraxial::FirstOrder;
        use crate::prescription::read_toml;
        use crate::ray::{Apertures, TraceDirection, TracedRay};
        use crate::{State, System};
        let p = read_toml(ROD, "x.toml").unwrap();
        let system = System::at(&p, State::default());
        let n = system.indices(550.0);
        let first = FirstOrder::of(&system, &n);
        // α = √0.0256 / 1.6 = 0.1; f = 1 / (n₀ α sin αL), back focus cos αL / (n₀ α sin αL).
        let (s, c) = 1.2f64.sin_cos();
        assert!((first.efl - 1.0 / (0.16 * s)).abs() < 1e-8 && (first.bfl - c / (0.16 * s)).abs() < 1e-8, "{first:?}");
        // Real rays near the axis cross it there; aberrations go with the square of 1e-3 mm.
        let ray = TracedRay { position: DVec3::new(0.0, 1e-3, -1.0), direction: DVec3::Z };
        let out = system.trace(ray, &n, TraceDirection::ToFilm, Apertures::Clip).unwrap();
        let cross = out.position.z - out.position.y * out.direction.z / out.direction.y - 12.0;
        assert!((cross - first.bfl).abs() < 1e-5, "{cross} {}", first.bfl);
        let back = read_toml(&p.to_toml(), "x.toml").unwrap();
        assert_eq!(back.surfaces[0].gradient, p.surfaces[0].gradient);
        let wrong = |from: &str, to: &str| read_toml(&ROD.replace(from, to), "x.toml").unwrap_err().to_string();
        assert!(wrong("-0.0256", "-0.9").contains("surface 1: gradient: an index of"));
        assert!(wrong("glass = \"1.6\", ", "").contains("a gradient in air"));
    }

    #[test]
    fn packets_cross_gradients_as_the_plain_trace_does() {
        use crate::batch::agreement;
        use crate::ray::{Apertures, TraceDirection, TracedRay};
        use crate::{State, System};
        // Curved and tilted ends, radial and axial terms.
        let text = "name = \"x\"\nsurfaces = [\n{ radius = 30, stop = true, gap = 6, glass = \"1.65\", semi_diameter = 5, gradient = { radial = [-0.002, 1e-6], axial = [0.005] } },\n\
            { radius = -50, gap = 2, glass = \"1.5\", semi_diameter = 6, tilt_deg = [3, 0, 0] },\n{ radius = -90, gap = 20, semi_diameter = 7 },\n]\n";
        let p = crate::prescription::read_toml(text, "x.toml").unwrap();
        let system = System::at(&p, State::default());
        let n = system.indices(550.0);
        let ray = |i: usize| TracedRay {
            position: DVec3::new(0.5 * i as f64 - 3.5, 0.2 * i as f64 - 1.0, -2.0),
            direction: DVec3::new(0.05, 0.01 * i as f64 - 0.08, 1.0).normalize(),
        };
        let through = agreement(&system, &n, ray, 1e-8);
        for (i, plain, _) in &through {
            let turned = TracedRay { position: plain.position + plain.direction, direction: -plain.direction };
            let back = system.trace(turned, &n, TraceDirection::ToObject, Apertures::Clip).unwrap();
            assert!((back.direction + ray(*i).direction).length() < 1e-9, "{i}");
        }
        assert!(through.len() > 10, "{}", through.len());
    }
}
