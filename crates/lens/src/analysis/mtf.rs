//! Modulation transfer: geometric from the spot, diffraction from the pupil's autocorrelation.
//!
//! The diffraction MTF traces rays from the image point back through the lens on an even grid of image-space direction cosines
//! (l, m): in them the optical transfer function at frequency ν is exactly the autocorrelation of the pupil function at a shift
//! λν (Hopkins 1955), without mapping from the entrance pupil. For every frequency a second grid is traced, moved by just that shift:
//! nothing is interpolated between cells, however coarse the frequency. The pupil's phase is the path to a plane across the field's
//! direction (a near object: to the object point), so that colours of one image point keep their lateral shifts when they are
//! added.

use super::{Beam, Bench};
use crate::batch::double::{Batch, Indices, LANES, Packet};
use crate::draw::{Axis, Chart, FIELD_COLORS, Figure, Line, Style};
use crate::dual::Number;
use crate::ray::TraceDirection;
use glam::{DVec2, DVec3};
use std::f64::consts::{PI, TAU};

/// Rays across the pupil: as many as the wavefront needs, from the first to the last.
const ACROSS: [usize; 3] = [128, 256, 512];
/// Rays across the pupil of geometric contrast.
const RAYS_ACROSS: usize = 96;
/// Largest step of phase from ray to ray, rad, that sampling still follows.
pub(super) const LARGEST_STEP: f64 = 2.0;

/// Phase of the pupil function (rad) on a square grid, rows along m; `None` where nothing passes.
pub(super) struct Pupil {
    pub(super) phase: Vec<Option<f64>>,
    pub(super) across: usize,
}

/// How the pupil function of a colour is traced.
pub(super) struct Sampling<'a> {
    pub(super) batch: &'a Batch,
    pub(super) n: Indices,
    pub(super) beam: &'a Beam,
    /// Image point.
    pub(super) image: DVec3,
    /// Way from the image towards the lens: +1 along +z.
    pub(super) back: f64,
    pub(super) nm: f64,
}

impl Pupil {
    /// Largest step of phase between neighbours.
    pub(super) fn largest_step(&self) -> f64 {
        let at = |row: usize, column: usize| self.phase[row * self.across + column];
        let mut largest = 0.0f64;
        for row in 0..self.across {
            for column in 1..self.across {
                for (a, b) in [(at(row, column - 1), at(row, column)), (at(column - 1, row), at(column, row))] {
                    if let (Some(a), Some(b)) = (a, b) {
                        largest = largest.max((a - b).abs());
                    }
                }
            }
        }
        largest
    }
}

/// Contrast over frequency for a field point.
#[derive(Clone, Debug)]
pub struct Mtf {
    /// Field angle, degrees.
    pub field_deg: f64,
    /// Cycles a mm on the film.
    pub frequencies: Vec<f64>,
    /// For lines across the field's direction (detail along y).
    pub tangential: Vec<f64>,
    /// For lines along it.
    pub sagittal: Vec<f64>,
    /// Of the spot alone, without diffraction.
    pub geometric: bool,
}

impl Mtf {
    /// Contrast over frequency: a colour a field, tangential full, sagittal broken.
    pub fn plot(title: &str, curves: &[Mtf], limit: Option<&[f64]>) -> Figure {
        let cell = DVec2::new(560.0, 340.0);
        let mut figure = Figure::sheet(title, 1, 1, cell);
        let mut lines = vec![];
        if let (Some(limit), Some(first)) = (limit, curves.first()) {
            let points = first.frequencies.iter().zip(limit).map(|(f, m)| DVec2::new(*f, *m)).collect();
            lines.push(Line::new("diffraction limit".into(), [150, 150, 150], Style::Full, points));
        }
        for (i, m) in curves.iter().enumerate() {
            let color = FIELD_COLORS[i % FIELD_COLORS.len()];
            let points = |v: &[f64]| m.frequencies.iter().zip(v).map(|(f, m)| DVec2::new(*f, *m)).collect::<Vec<_>>();
            let kind = if m.geometric { ", geometric" } else { "" };
            lines.push(Line::new(format!("{:.1}° tangential{kind}", m.field_deg), color, Style::Full, points(&m.tangential)));
            lines.push(Line::new(format!("{:.1}° sagittal{kind}", m.field_deg), color, Style::Broken, points(&m.sagittal)));
        }
        let highest = curves.first().and_then(|m| m.frequencies.last()).copied().unwrap_or(1.0);
        let x = Axis { label: "spatial frequency, cycles/mm".into(), range: [0.0, highest] };
        let y = Axis { label: "contrast".into(), range: [0.0, 1.0] };
        Chart { title: String::new(), x, y, lines }.draw(&mut figure, DVec2::new(0.0, 24.0), cell);
        figure
    }

    /// Contrast at some frequencies over a field angle or a defocus: a colour a frequency, tangential full, sagittal broken.
    pub fn plot_over(title: &str, label: &str, frequencies: &[f64], curves: &[(f64, Mtf)]) -> Figure {
        let cell = DVec2::new(560.0, 340.0);
        let mut figure = Figure::sheet(title, 1, 1, cell);
        let mut lines = vec![];
        for (i, f) in frequencies.iter().enumerate() {
            let color = FIELD_COLORS[i % FIELD_COLORS.len()];
            let points = |v: &dyn Fn(&Mtf) -> f64| curves.iter().map(|(x, m)| DVec2::new(*x, v(m))).collect::<Vec<_>>();
            lines.push(Line::new(format!("{f:.0}/mm tangential"), color, Style::Full, points(&|m| m.tangential[i])));
            lines.push(Line::new(format!("{f:.0}/mm sagittal"), color, Style::Broken, points(&|m| m.sagittal[i])));
        }
        let ends = [curves.first().map_or(0.0, |c| c.0), curves.last().map_or(1.0, |c| c.0)];
        let range = if ends[1] > ends[0] { ends } else { [ends[0] - 1.0, ends[0] + 1.0] };
        let x = Axis { label: label.into(), range };
        let y = Axis { label: "contrast".into(), range: [0.0, 1.0] };
        Chart { title: String::new(), x, y, lines }.draw(&mut figure, DVec2::new(0.0, 24.0), cell);
        figure
    }
}

/// MTF of a perfect lens with a round pupil: 2/π (acos x − x √(1 − x²)), x = frequency over cut-off 1/(λN).
pub fn airy_mtf(frequency: f64, nm: f64, f_number: f64) -> f64 {
    airy_mtf_of(frequency * nm * 1e-6 * f_number)
}

/// The same over frequency divided by the cutoff.
pub(crate) fn airy_mtf_of<N: Number>(x: N) -> N {
    if x.value() >= 1.0 {
        return N::constant(0.0);
    }
    let root = (N::constant(1.0) - x * x).sqrt();
    (root.atan2(x) - x * root).scaled(2.0 / PI)
}

/// MTF of a perfect lens with a round pupil whose film stands out of focus: `cutoff` in cycles/mm (1/(λN) on the axis), `blur_mm` the diameter of the
/// geometric blur disk. 1 at frequency 0, negative where contrast is reversed.
///
/// (4/π) ∫₀^(1−s) √(1 − (x + s)²) cos(π b ν x) dx with s = ν / cutoff: 2/π (acos s − s √(1 − s²)) without blur, 2 J₁(π b ν)/(π b ν) far below the cutoff.
/// Source: Hopkins, "The frequency response of a defocused optical system", Proc. R. Soc. A 231 (1955).
pub fn defocused_airy_mtf(frequency: f64, cutoff: f64, blur_mm: f64) -> f64 {
    let s = frequency / cutoff;
    if !(s < 1.0) {
        return 0.0;
    }
    // Steps much shorter than the waves of the cosine; where these are too many for that, nothing is left of the contrast.
    const FEWEST: f64 = 400.0;
    const MOST: f64 = 200_000.0;
    let waves = 0.5 * blur_mm.abs() * frequency;
    if 40.0 * waves > MOST {
        return 0.0;
    }
    let steps = (40.0 * waves).max(FEWEST).ceil();
    // x + s = cos t: the root at the end of the pupil becomes a square.
    let end = s.acos();
    let width = end / steps;
    let value = |t: f64| t.sin().powi(2) * (TAU * waves * (t.cos() - s)).cos();
    4.0 / PI * (0..steps as usize).map(|k| value((k as f64 + 0.5) * width) * width).sum::<f64>()
}

/// Contrast of detail along a direction at frequencies in cycles/mm, of film points (mm) by their light. `None` without light.
fn contrast(rays: &[(DVec2, f64)], direction: DVec2, frequencies: &[f64]) -> Option<Vec<f64>> {
    let origin = rays.first()?.0;
    Some(response(rays, origin, direction, frequencies)?.into_iter().map(|[re, im]| f64::hypot(re, im)).collect())
}

/// Real and imaginary part of the same with its phase, places counted from `origin`.
fn response(rays: &[(DVec2, f64)], origin: DVec2, direction: DVec2, frequencies: &[f64]) -> Option<Vec<[f64; 2]>> {
    let total: f64 = rays.iter().map(|r| r.1).sum();
    let at = |frequency: &f64| {
        let (mut re, mut im) = (0.0, 0.0);
        for (p, light) in rays {
            let phase = TAU * frequency * (*p - origin).dot(direction);
            re += light * phase.cos();
            im += light * phase.sin();
        }
        [re / total, im / total]
    };
    (total > 0.0).then(|| frequencies.iter().map(at).collect())
}

impl Bench<'_> {
    /// Geometric MTF of several colours (nm, weight) at frequencies in cycles/mm, `defocus` mm behind the film: every ray that passes counts the same, as
    /// lens designers have it. `None` where no light comes through.
    pub fn geometric_mtf(&self, field_deg: f64, colors: &[(f64, f64)], frequencies: &[f64], defocus: f64) -> Option<Mtf> {
        let reference = colors.get(colors.len() / 2)?.0;
        let rays: Vec<(DVec2, f64)> = colors
            .iter()
            .filter_map(|(nm, weight)| Some((self.scattered_spot(field_deg, *nm, reference, RAYS_ACROSS, defocus)?, weight)))
            // Each colour counts by its weight, however many of its rays pass.
            .flat_map(|(spot, weight)| {
                let each = weight / spot.points.len() as f64;
                spot.points.into_iter().map(move |p| (p, each))
            })
            .collect();
        let along = |direction| contrast(&rays, direction, frequencies);
        let (tangential, sagittal) = (along(DVec2::Y)?, along(DVec2::X)?);
        Some(Mtf { field_deg, frequencies: frequencies.to_vec(), tangential, sagittal, geometric: true })
    }

    /// Geometric contrast of detail along any direction (a unit vector: sagittal, tangential) of several colours (nm, weight) at frequencies
    /// in cycles/mm, `defocus` mm behind the film, as it is in a photograph: every ray counts by the light that it keeps in glass and at surfaces
    /// ([`System::transmittance`](crate::System::transmittance)). `None` where no light comes through.
    pub fn geometric_contrast(
        &self,
        field_deg: f64,
        colors: &[(f64, f64)],
        frequencies: &[f64],
        direction: DVec2,
        defocus: f64,
    ) -> Option<Vec<f64>> {
        let all = self.geometric_response(field_deg, colors, frequencies, direction, defocus)?;
        Some(all.into_iter().map(|[re, im]| f64::hypot(re, im)).collect())
    }

    /// The same with its phase about the centroid of the light: real and imaginary part of ∫ l(x) exp(2πi f x) dx over the line spread function l, x along the
    /// direction, whose tangential part leads away from the axis.
    pub fn geometric_response(
        &self,
        field_deg: f64,
        colors: &[(f64, f64)],
        frequencies: &[f64],
        direction: DVec2,
        defocus: f64,
    ) -> Option<Vec<[f64; 2]>> {
        let reference = colors.get(colors.len() / 2)?.0;
        let rays: Vec<(DVec2, f64)> = colors
            .iter()
            .filter_map(|(nm, weight)| Some((self.scattered_light(field_deg, *nm, reference, RAYS_ACROSS, defocus)?, weight)))
            .flat_map(|(light, weight)| light.into_iter().map(move |(p, fraction)| (p, weight * fraction)))
            .collect();
        let total: f64 = rays.iter().map(|r| r.1).sum();
        let centroid = rays.iter().map(|(p, light)| *p * *light).sum::<DVec2>() / total;
        let outward = if centroid.y < 0.0 { DVec2::new(direction.x, -direction.y) } else { direction };
        response(&rays, centroid, outward, frequencies)
    }

    /// Direction cosines between which all light of a beam comes, seen from an image point: lower and upper corner, with a margin. `None` of
    /// fewer than three rays.
    pub(super) fn direction_cosines(&self, beam: &Beam, nm: f64, image: DVec3) -> Option<[DVec2; 2]> {
        let rays = self.grid(beam, nm, 41);
        let (mut low, mut high) = (DVec2::MAX, DVec2::MIN);
        for (_, r) in &rays {
            let d = (r.position - image).normalize().truncate();
            (low, high) = (low.min(d), high.max(d));
        }
        let pad = (high - low) * 0.06;
        (rays.len() >= 3).then_some([low - pad, high + pad])
    }

    /// Diffraction MTF of several colours (nm, weight) at frequencies in cycles/mm, `defocus` mm behind the film. Where the wavefront is
    /// too steep for the finest grid (hundreds of waves) the geometric one stands in, and [`Mtf::geometric`] says so.
    pub fn diffraction_mtf(&self, field_deg: f64, colors: &[(f64, f64)], frequencies: &[f64], defocus: f64) -> Option<Mtf> {
        let reference = colors.get(colors.len() / 2)?.0;
        let beam = self.beam(field_deg, reference)?;
        let film_z = self.system.film_z + defocus * self.system.film_run();
        let image = crate::trace::at_plane(&beam.image, film_z);
        let [low, high] = self.direction_cosines(&beam, reference, image)?;
        let size = (high - low).max_element();
        let corner = 0.5 * (low + high) - 0.5 * size;
        let batch = Batch::new(self.system);
        let back = -self.system.film_run();
        let mut sums = vec![[[0.0f64; 2]; 2]; frequencies.len()];
        let mut total = 0.0;
        for &(nm, weight) in colors {
            let mut n = Indices::default();
            batch.indices(&[nm; LANES], &mut n);
            let film_index = self.system.film_index(&self.system.indices(nm));
            let sampling = Sampling { batch: &batch, n, beam: &beam, image, back, nm };
            let mut sampled = None;
            for across in ACROSS {
                let step = size / across as f64;
                let pupil = sampling.pupil(corner, step, across);
                let fine = pupil.largest_step() < LARGEST_STEP;
                sampled = Some((pupil, step, fine));
                if fine {
                    break;
                }
            }
            let (pupil, step, fine) = sampled?;
            if !fine {
                // Hundreds of waves: diffraction does nothing that geometry does not.
                return self.geometric_mtf(field_deg, colors, frequencies, defocus);
            }
            let energy: f64 = pupil.phase.iter().flatten().count() as f64;
            if energy == 0.0 {
                continue;
            }
            total += weight;
            for (f, sum) in frequencies.iter().zip(&mut sums) {
                let shift = f * nm * 1e-6 / film_index;
                if shift >= size {
                    continue;
                }
                for (direction, sum) in [DVec2::Y, DVec2::X].into_iter().zip(sum) {
                    let [re, im] = correlation(&pupil, &sampling.pupil(corner + direction * shift, step, pupil.across));
                    sum[0] += weight * re / energy;
                    sum[1] += weight * im / energy;
                }
            }
        }
        if total == 0.0 {
            return None;
        }
        let contrast = |axis: usize| sums.iter().map(|s| f64::hypot(s[axis][0], s[axis][1]) / total).collect();
        let (tangential, sagittal) = (contrast(0), contrast(1));
        Some(Mtf { field_deg, frequencies: frequencies.to_vec(), tangential, sagittal, geometric: false })
    }
}

impl Sampling<'_> {
    /// On a grid of `across` cells a side of `step`, its corner at the direction cosines `low`.
    pub(super) fn pupil(&self, low: DVec2, step: f64, across: usize) -> Pupil {
        let middle = |i: usize| low + step * DVec2::new((i % across) as f64 + 0.5, (i / across) as f64 + 0.5);
        let places: Vec<DVec2> = (0..across * across).map(middle).collect();
        Pupil { phase: self.phases(&places), across }
    }

    /// Phase (rad) at direction cosines seen from the image point; `None` where nothing passes.
    pub(super) fn phases(&self, places: &[DVec2]) -> Vec<Option<f64>> {
        let mut phase = Vec::with_capacity(places.len());
        let mut packet = Packet::default();
        let object = self.beam.finite.then_some(self.beam.chief.position);
        for chunk in places.chunks(LANES) {
            for lane in 0..LANES {
                let d = chunk[lane.min(chunk.len() - 1)];
                let dz = (1.0 - d.length_squared()).max(0.0).sqrt() * self.back;
                packet.set(lane, self.image.to_array(), [d.x, d.y, dz]);
            }
            let mask = self.batch.trace(&mut packet, &self.n, TraceDirection::ToObject);
            for lane in 0..chunk.len() {
                let passed = mask >> lane & 1 == 1;
                let p = DVec3::new(packet.x[lane], packet.y[lane], packet.z[lane]);
                // On to the entrance pupil, whose edge limits the light: a ray of an aberrated image point leaves the lens by a small angle aside, and phases on
                // another plane would differ by half its square for each wavelength between the two.
                let (d, axis) = (DVec3::new(packet.dx[lane], packet.dy[lane], packet.dz[lane]), self.beam.chief.direction);
                let t = (self.beam.pupil - p).dot(axis) / d.dot(axis);
                let t = if t.is_finite() { t } else { 0.0 };
                let p = p + d * t;
                let path = packet.path[lane]
                    + t
                    + match object {
                        Some(o) => (p - o).length(),
                        None => (p - self.beam.chief.position).dot(axis),
                    };
                phase.push(passed.then_some(TAU * path / (self.nm * 1e-6)));
            }
        }
        phase
    }
}

/// Sum of P*(p) P(p + shift) over the points p of a grid, from the pupil there and the pupil on the shifted grid: real, imaginary.
fn correlation(pupil: &Pupil, shifted: &Pupil) -> [f64; 2] {
    pupil.phase.iter().zip(&shifted.phase).fold([0.0; 2], |[re, im], pair| match pair {
        // Differences first: large phases lose digits in their cosines.
        (Some(a), Some(b)) => [re + (b - a).cos(), im + (b - a).sin()],
        _ => [re, im],
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::test_lenses::parabola;
    use crate::ray::{Apertures, TraceDirection, TracedRay};
    use crate::system::{State, System};
    use glam::DVec3;

    #[test]
    fn waves_are_shorter_and_light_is_denser_where_the_film_is_in_glass() {
        // An ellipse is a perfect lens within glass: e = 1 / n, so that κ = -1 / n². NA = n sin u' = 0.2574 of the rim of 5 mm, 30 mm before the film.
        let text = "name = \"x\"\nsurfaces = [{ stop = true, radius = 10, conic = -0.4444444444444444, gap = 30, glass = \"1.5\", semi_diameter = 5 }]";
        let p = crate::prescription::read_toml(text, "x").unwrap();
        let system = System::at(&p, State::default());
        let bench = Bench::at_infinity(&system);
        let marginal = {
            let ray = TracedRay { position: DVec3::new(0.0, 5.0 * (1.0 - 1e-9), -1.0), direction: DVec3::Z };
            let n = system.indices(550.0);
            1.5 * system.trace(ray, &n, TraceDirection::ToFilm, Apertures::Clip).unwrap().direction.y.abs()
        };
        let cutoff = 2.0 * marginal / 550e-6;
        let frequencies = [0.2 * cutoff, 0.427 * cutoff, 0.8 * cutoff];
        let mtf = bench.diffraction_mtf(0.0, &[(550.0, 1.0)], &frequencies, 0.0).unwrap();
        for (k, f) in frequencies.iter().enumerate() {
            let exact = airy_mtf_of(f / cutoff);
            assert!((mtf.tangential[k] - exact).abs() < 0.01, "{} {exact}", mtf.tangential[k]);
        }
        // E / L = π NA² for all light from a lossless pupil.
        let light = bench.illumination(0.0, 550.0).geometric;
        assert!((light / (std::f64::consts::PI * marginal * marginal) - 1.0).abs() < 2e-3, "{light}");
    }

    #[test]
    fn a_perfect_lens_has_the_airy_mtf() {
        // f/8 at 550 nm: cut-off 227.27 cycles/mm, half contrast at 0.40397 of it (TRUTHS 4).
        let system = parabola(200.0, 25.0);
        let bench = Bench::at_infinity(&system);
        let frequencies: Vec<f64> = vec![1e-6, 20.0, 50.0, 0.40397 * 227.27, 120.0, 180.0, 220.0, 240.0];
        let mtf = bench.diffraction_mtf(0.0, &[(550.0, 1.0)], &frequencies, 0.0).unwrap();
        for (i, f) in frequencies.iter().enumerate() {
            // sin u of the parabola's edge is 1/(2N) to third order.
            let exact = airy_mtf(*f, 550.0, 8.0);
            assert!((mtf.tangential[i] - exact).abs() < 0.01 && (mtf.sagittal[i] - exact).abs() < 0.01, "{f}: {mtf:?} {exact}");
        }
        assert!((airy_mtf(0.40397 * 227.2727, 550.0, 8.0) - 0.5).abs() < 1e-4);
        // A quarter wave of defocus (8 λ N² /... = ±2λN²) leaves 0.8 of the Strehl ratio and lowers the middle.
        let blurred = bench.diffraction_mtf(0.0, &[(550.0, 1.0)], &[100.0], 2.0 * 550e-6 * 64.0).unwrap();
        let sharp = airy_mtf(100.0, 550.0, 8.0);
        assert!(blurred.tangential[0] < 0.85 * sharp && blurred.tangential[0] > 0.5 * sharp, "{blurred:?} {sharp}");
        assert!(bench.wavefront_rms(0.0, 550.0, 41).unwrap() < 1e-4);
    }

    #[test]
    fn coarse_frequencies_are_not_interpolated() {
        // Defocus of W waves at the edge: a blur disk of 8 λ N W.
        let system = parabola(200.0, 25.0);
        let bench = Bench::at_infinity(&system);
        let defocus = 0.8;
        let waves = defocus * (1.0 - (1.0f64 / 16.0).asin().cos()) / 550e-6;
        let frequencies = [0.3, 0.7, 1.36, 2.1, 5.0];
        let mtf = bench.diffraction_mtf(0.0, &[(550.0, 1.0)], &frequencies, defocus).unwrap();
        assert!(!mtf.geometric);
        for (i, f) in frequencies.iter().enumerate() {
            let exact = defocused_airy_mtf(*f, 1.0 / (550e-6 * 8.0), 8.0 * 550e-6 * 8.0 * waves);
            assert!((mtf.tangential[i] - exact.abs()).abs() < 2e-3, "{f}: {} {exact}", mtf.tangential[i]);
            assert!((mtf.sagittal[i] - exact.abs()).abs() < 2e-3, "{f}: {} {exact}", mtf.sagittal[i]);
        }
    }

    #[test]
    fn contrast_along_any_direction_lies_between_its_ends() {
        let system = crate::System::at(&crate::embedded("double-gauss-50mm").unwrap(), crate::State::default());
        let bench = Bench::at_infinity(&system);
        let colors = [(550.0, 1.0)];
        let mtf = bench.geometric_mtf(12.0, &colors, &[10.0], 0.0).unwrap();
        let along = |turn: f64| bench.geometric_contrast(12.0, &colors, &[10.0], DVec2::from_angle(turn), 0.0).unwrap()[0];
        // Light lost on the way weakens the rays of the rim, which lie farthest out.
        let gain = [along(0.0) - mtf.sagittal[0], along(0.5 * PI) - mtf.tangential[0]];
        assert!(gain.iter().all(|g| (0.0..0.03).contains(g)), "{gain:?}");
        // The lens is symmetric about the plane of the field: 4600 scattered rays of each side tell it to 0.01.
        assert!((along(0.7) - along(PI - 0.7)).abs() < 0.02, "{} {}", along(0.7), along(PI - 0.7));
    }

    #[test]
    fn the_defocused_mtf_has_the_limits_of_airy_and_of_a_disk() {
        let cutoff = 1.0 / (550e-6 * 8.0);
        for f in [0.0, 20.0, 100.0, 220.0, 230.0] {
            assert!((defocused_airy_mtf(f, cutoff, 0.0) - airy_mtf(f, 550.0, 8.0)).abs() < 1e-4, "{f}");
        }
        // Far below the cutoff the first zero of 2 J1(x)/x, x = 3.8317.
        let zero = 3.831_706 / (PI * 0.1);
        let at = |f: f64| defocused_airy_mtf(f, 1e6, 0.1);
        assert!(at(zero).abs() < 1e-3 && at(0.9 * zero) > 0.01 && at(1.2 * zero) < -0.05);
        // Whatever is asked.
        assert_eq!(defocused_airy_mtf(50.0, cutoff, 1e9), 0.0);
        assert_eq!(defocused_airy_mtf(50.0, f64::NAN, 1.0), 0.0);
    }

    #[test]
    fn a_wavefront_too_steep_to_sample_is_called_geometric() {
        let system = parabola(200.0, 100.0);
        let mtf = Bench::at_infinity(&system).diffraction_mtf(0.0, &[(550.0, 1.0)], &[1.0], 20.0).unwrap();
        assert!(mtf.geometric);
    }

    #[test]
    fn defocused_geometric_mtf_is_that_of_a_disk() {
        // A blur disk of diameter b: 2 J1(π b ν)/(π b ν).
        let system = parabola(200.0, 25.0);
        let bench = Bench::at_infinity(&system);
        let defocus = 0.8;
        let b = defocus / 8.0;
        let mtf = bench.geometric_mtf(0.0, &[(550.0, 1.0)], &[2.0, 5.0, 9.0], defocus).unwrap();
        let j1 = |x: f64| {
            (0..20)
                .map(|k| {
                    let mut t = 0.5 * x;
                    for i in 1..=k {
                        t *= -(0.25 * x * x) / (i as f64 * (i as f64 + 1.0));
                    }
                    t
                })
                .sum::<f64>()
        };
        for (i, f) in [2.0, 5.0, 9.0].iter().enumerate() {
            let x = PI * b * f;
            let exact = (2.0 * j1(x) / x).abs();
            assert!((mtf.tangential[i] - exact).abs() < 0.01, "{f}: {} {exact}", mtf.tangential[i]);
        }
    }
}
