//! Measures many lenses that are nearly the same, fast: what depends on the design alone is computed once.
//!
//! The beams are those of the design ([`crate::bundle`]), aimed at the same places of the stop in every build. The MTF is the
//! autocorrelation of the pupil function in direction cosines of image space (Hopkins 1955), as [`crate::analysis`] has it; here the
//! wavefront is a polynomial through the rays of the bundle (products of Chebyshev polynomials up to degree [`DEGREE`]), and the
//! shape of the pupil, rims and obstructions included, is the design's. Limits: rims of a build that cut a little more or less light
//! than the design's are not seen.

use super::parameter::Parameter;
use super::quantity::{Direction, Quantity, QuantityKind};
use crate::analysis::Bench;
use crate::bundle::{Bundle, RayAiming, Sampling, TracedFilmPoint, Tracer, path_to_foot};
use crate::dual::Number;
use crate::linear::Cholesky;
use crate::paraxial::FirstOrder;
use crate::prescription::Prescription;
use crate::system::{State, System};
use glam::DVec2;
use std::f64::consts::TAU;

/// Rays of a beam: as many as the polynomial needs, 24 × 7 for 66 coefficients.
const SAMPLING: Sampling = Sampling { arms: 24, rings: 7 };
/// Degree of the wavefront polynomial.
const DEGREE: usize = 10;
/// Cells across the pupil of the autocorrelation.
pub(super) const CELLS: usize = 32;
/// Points a side of a cell that decide how much of it is lit.
const SUBCELLS: usize = 4;
/// Fields from here on, degrees, have no rectilinear image that distortion could be measured against.
const STEEPEST_FIELD: f64 = 89.0;

/// What is measured, made ready for a design.
pub(super) struct Assessment {
    pub(super) state: State,
    object_distance: Option<f64>,
    pub(super) wavelengths: Vec<f64>,
    weights: Vec<f64>,
    reference: usize,
    refocus: Option<f64>,
    /// What else is adjusted, with how far it may move.
    pub(super) compensators: Vec<Parameter>,
    axis: Bundle,
    fields: Vec<FieldPlan>,
    pub quantities: Vec<Quantity>,
}

/// A field point: its rays, and how their paths become contrast.
struct FieldPlan {
    bundle: Bundle,
    /// One a wavelength.
    waves: Vec<WavePlan>,
}

/// The pupil of a field at a wavelength.
struct WavePlan {
    /// Least squares: coefficients from the paths of the rays, rows of rays.
    coefficients: Vec<f64>,
    /// For each frequency: tangential, sagittal.
    shears: Vec<[Shear; 2]>,
}

/// Where the pupil and the pupil moved by λν overlap.
struct Shear {
    /// Basis functions at one end less those at the other, rows of terms.
    differences: Vec<f64>,
    /// Part of the pupil's area that each row stands for.
    areas: Vec<f64>,
}

const TERMS: usize = (DEGREE + 1) * (DEGREE + 2) / 2;

/// T_i(x) T_j(y) for i + j ≤ [`DEGREE`].
fn basis(p: DVec2) -> [f64; TERMS] {
    let chebyshev = |x: f64| {
        let mut t = [1.0; DEGREE + 1];
        t[1] = x;
        for k in 2..=DEGREE {
            t[k] = 2.0 * x * t[k - 1] - t[k - 2];
        }
        t
    };
    let (tx, ty) = (chebyshev(p.x), chebyshev(p.y));
    let mut out = [0.0; TERMS];
    let mut at = 0;
    for i in 0..=DEGREE {
        for j in 0..=DEGREE - i {
            out[at] = tx[i] * ty[j];
            at += 1;
        }
    }
    out
}

/// Whether a point lies in a polygon (crossing number).
fn inside(polygon: &[DVec2], p: DVec2) -> bool {
    let mut odd = false;
    for (i, a) in polygon.iter().enumerate() {
        let b = polygon[(i + 1) % polygon.len()];
        if (a.y > p.y) != (b.y > p.y) && p.x < a.x + (b.x - a.x) * (p.y - a.y) / (b.y - a.y) {
            odd = !odd;
        }
    }
    odd
}

impl WavePlan {
    /// From the direction cosines of the rays and of the outline (inner, outer); shears λν of the frequencies.
    fn new(rays: &[(DVec2, f64)], outline: &[[DVec2; 2]], shears: &[f64]) -> Option<WavePlan> {
        let outer: Vec<DVec2> = outline.iter().map(|o| o[1]).collect();
        let inner: Vec<DVec2> = outline.iter().map(|o| o[0]).collect();
        let (low, high) = outer.iter().fold((DVec2::MAX, DVec2::MIN), |(a, b), p| (a.min(*p), b.max(*p)));
        let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
        if !(half.min_element() > 0.0) {
            return None;
        }
        let normal = |p: DVec2| (p - middle) / half;
        // Weighted least squares by the normal equations; their condition stays below 1e8 on disks and cat's eyes.
        let rows: Vec<[f64; TERMS]> = rays.iter().map(|r| basis(normal(r.0))).collect();
        let mut matrix = vec![0.0; TERMS * TERMS];
        for (row, (_, w)) in rows.iter().zip(rays) {
            for i in 0..TERMS {
                for j in 0..TERMS {
                    matrix[i * TERMS + j] += w * row[i] * row[j];
                }
            }
        }
        // Keeps combinations that the rays do not see at zero.
        let ridge = 1e-13 * (0..TERMS).map(|i| matrix[i * TERMS + i]).sum::<f64>();
        (0..TERMS).for_each(|i| matrix[i * TERMS + i] += ridge);
        let factor = Cholesky::new(matrix, TERMS)?;
        let mut coefficients = vec![0.0; TERMS * rays.len()];
        for (ray, (row, (_, w))) in rows.iter().zip(rays).enumerate() {
            let mut column: Vec<f64> = row.iter().map(|v| v * w).collect();
            factor.solve(&mut column);
            for (term, v) in column.into_iter().enumerate() {
                coefficients[term * rays.len() + ray] = v;
            }
        }
        let hole = inner.iter().zip(&outer).any(|(i, o)| i.distance(*o) < 0.999 * middle.distance(*o)) && {
            // Inner ends that coincide in one point are no hole.
            let (a, b) = inner.iter().fold((DVec2::MAX, DVec2::MIN), |(a, b), p| (a.min(*p), b.max(*p)));
            (b - a).max_element() > 1e-6 * half.max_element()
        };
        let lit = |p: DVec2| inside(&outer, p) && !(hole && inside(&inner, p));
        // Part of a square cell around a point where both ends of the shear are lit.
        let covered = |p: DVec2, shift: DVec2, cell: DVec2| {
            let mut count = 0;
            for k in 0..SUBCELLS * SUBCELLS {
                let at = |i: usize| (i as f64 + 0.5) / SUBCELLS as f64 - 0.5;
                let q = p + cell * DVec2::new(at(k % SUBCELLS), at(k / SUBCELLS));
                count += (lit(q - 0.5 * shift) && lit(q + 0.5 * shift)) as usize;
            }
            count as f64 / (SUBCELLS * SUBCELLS) as f64
        };
        let cell = 2.0 * half / CELLS as f64;
        let cells = |i: usize| low + cell * DVec2::new((i % CELLS) as f64 + 0.5, (i / CELLS) as f64 + 0.5);
        let all: f64 = (0..CELLS * CELLS).map(|i| covered(cells(i), DVec2::ZERO, cell)).sum();
        if !(all > 0.0) {
            return None;
        }
        let shear = |shift: DVec2| {
            let mut plan = Shear { differences: vec![], areas: vec![] };
            for i in 0..CELLS * CELLS {
                let p = cells(i);
                let area = covered(p, shift, cell);
                if area > 0.0 {
                    let (a, b) = (basis(normal(p + 0.5 * shift)), basis(normal(p - 0.5 * shift)));
                    plan.differences.extend(a.iter().zip(b).map(|(a, b)| a - b));
                    plan.areas.push(area / all);
                }
            }
            plan
        };
        let shears = shears.iter().map(|s| [shear(DVec2::Y * *s), shear(DVec2::X * *s)]).collect();
        Some(WavePlan { coefficients, shears })
    }

    /// Optical transfer function at each frequency, tangential and sagittal, from the paths of the rays (mm).
    fn transfer(&self, paths: &[f64], nm: f64) -> Vec<[DVec2; 2]> {
        let turn = TAU / (nm * 1e-6);
        // Millions of radians that all have in common would cost digits.
        let common = paths.first().copied().unwrap_or(0.0);
        let wavefront: Vec<f64> = self
            .coefficients
            .chunks_exact(paths.len())
            .map(|row| turn * row.iter().zip(paths).map(|(c, p)| c * (p - common)).sum::<f64>())
            .collect();
        let sum = |s: &Shear| {
            let rows = s.differences.chunks_exact(TERMS);
            rows.zip(&s.areas)
                .map(|(row, area)| {
                    let phase: f64 = row.iter().zip(&wavefront).map(|(a, b)| a * b).sum();
                    DVec2::new(phase.cos(), phase.sin()) * *area
                })
                .sum::<DVec2>()
        };
        self.shears.iter().map(|s| [sum(&s[0]), sum(&s[1])]).collect()
    }
}

impl Assessment {
    /// For a design as it stands (`system`: with its aperture set, at `state`). The error names the field without light.
    pub fn new(
        system: &System,
        state: State,
        object_distance: Option<f64>,
        fields_deg: &[f64],
        colors: &[(f64, f64)],
        reference: usize,
        frequencies: &[f64],
        refocus: Option<f64>,
        compensators: Vec<Parameter>,
    ) -> Result<Assessment, String> {
        let wavelengths: Vec<f64> = colors.iter().map(|c| c.0).collect();
        let total: f64 = colors.iter().map(|c| c.1).sum();
        let weights: Vec<f64> = colors.iter().map(|c| c.1 / total).collect();
        let bench = Bench { system, object_distance };
        let nm = wavelengths[reference];
        let tracer = Tracer::new(system, &wavelengths);
        let dark = |field: f64| format!("field {field}: no light comes through the lens there; expected a smaller angle");
        let axis = Bundle::lit(&bench, 0.0, nm, Sampling { arms: 4, rings: 1 }).ok_or_else(|| dark(0.0))?;
        let mut fields = vec![];
        for &field in fields_deg {
            let bundle = Bundle::lit(&bench, field, nm, SAMPLING).ok_or_else(|| dark(field))?;
            let aimed = bundle.aim(&tracer, reference, RayAiming::Stop).ok_or_else(|| dark(field))?;
            let outline: Vec<(DVec2, f64)> = bundle.outline.iter().flatten().map(|p| (*p, 0.0)).collect();
            let waves = (0..wavelengths.len())
                .map(|color| {
                    let cosines = |l: &TracedFilmPoint| l.direction.truncate();
                    let rays: Vec<(DVec2, f64)> =
                        bundle.trace(&tracer, aimed, color)?.iter().map(|l| (cosines(l), l.weight)).collect();
                    let edge: Vec<DVec2> = bundle.trace_places(&tracer, aimed, color, &outline)?.iter().map(cosines).collect();
                    let edge: Vec<[DVec2; 2]> = edge.chunks_exact(2).map(|e| [e[0], e[1]]).collect();
                    let shears: Vec<f64> = frequencies.iter().map(|f| f * wavelengths[color] * 1e-6).collect();
                    // The chief ray is not part of the quadrature.
                    WavePlan::new(&rays[1..], &edge, &shears)
                })
                .collect::<Option<_>>()
                .ok_or_else(|| dark(field))?;
            fields.push(FieldPlan { bundle, waves });
        }
        let mut quantities = vec![Quantity::of_lens(QuantityKind::Efl)];
        if refocus.is_some() {
            quantities.push(Quantity::of_lens(QuantityKind::Refocus));
        }
        quantities.extend(compensators.iter().map(|c| Quantity::of_compensator(c.change)));
        for kind in [QuantityKind::Boresight, QuantityKind::BoresightX, QuantityKind::BoresightY] {
            quantities.push(Quantity::of_lens(kind));
        }
        for &field in fields_deg {
            quantities.push(Quantity::of_field(QuantityKind::Spot, field));
            quantities.push(Quantity::of_field(QuantityKind::Wavefront, field));
            if has_distortion(field) {
                quantities.push(Quantity::of_field(QuantityKind::Distortion, field));
            }
            for &frequency in frequencies {
                for direction in [Direction::Tangential, Direction::Sagittal] {
                    let of = Quantity::of_field(QuantityKind::Mtf, field);
                    quantities.push(Quantity { frequency: Some(frequency), direction: Some(direction), ..of });
                }
            }
        }
        Ok(Assessment {
            state,
            object_distance,
            wavelengths,
            weights,
            reference,
            refocus,
            compensators,
            axis,
            fields,
            quantities,
        })
    }

    /// All quantities of a lens, in their order; what could not be measured (rays that do not arrive) is not a number.
    pub fn measure(&self, p: &Prescription) -> Vec<f64> {
        self.compensated(p).1
    }

    /// A lens adjusted by all compensators but the film, and all its quantities, the film's move among them.
    pub fn compensated(&self, p: &Prescription) -> (Prescription, Vec<f64>) {
        let (adjusted, amounts) = match self.compensators.is_empty() {
            true => (p.clone(), vec![]),
            false => self.adjusted(p),
        };
        let values = self.measure_adjusted(&adjusted, &amounts);
        (adjusted, values)
    }

    /// Where the rays of each field land, by wavelength; `None` of a field with a ray that does not arrive.
    fn film_points(&self, tracer: &Tracer) -> Vec<Option<Vec<Vec<TracedFilmPoint>>>> {
        let of = |f: &FieldPlan| {
            let aimed = f.bundle.aim(tracer, self.reference, RayAiming::Stop)?;
            (0..self.wavelengths.len()).map(|color| f.bundle.trace(tracer, aimed, color)).collect()
        };
        self.fields.iter().map(of).collect()
    }

    /// Places of all rays about the centroids of their fields (x and y by turns, mm times the root of their weight), the film refocused: the sum of
    /// their squares is that of the mean square spots. `None` where a field has no light.
    pub fn blur(&self, tracer: &Tracer) -> Option<Vec<f64>> {
        let film_points = self.film_points(tracer);
        let dz = self.refocus.map_or(0.0, |range| self.best_focus(&film_points).clamp(-range, range));
        let mut out = vec![];
        for colors in film_points {
            let colors = colors?;
            let middle = self.mean(&colors, &|l| l.place + l.slope * dz);
            for (rays, w) in colors.iter().zip(&self.weights) {
                out.extend(rays.iter().flat_map(|l| ((w * l.weight).sqrt() * (l.place + l.slope * dz - middle)).to_array()));
            }
        }
        Some(out)
    }

    fn measure_adjusted(&self, p: &Prescription, amounts: &[f64]) -> Vec<f64> {
        let system = System::at(p, self.state);
        let mut tracer = Tracer::new(&system, &self.wavelengths);
        let mut film_points = self.film_points(&tracer);
        let refocus = self.refocus.map(|range| self.best_focus(&film_points).clamp(-range, range));
        let axis = self.axis.aim(&tracer, self.reference, RayAiming::Stop);
        let mut axis = axis.and_then(|aimed| Some(self.axis.trace(&tracer, aimed, self.reference)?[0]));
        if let Some(dz) = refocus {
            let shift = |l: &mut TracedFilmPoint, n: f64| {
                l.place += l.slope * dz;
                l.path += n * dz / l.direction.z;
            };
            for colors in film_points.iter_mut().flatten() {
                for (color, rays) in colors.iter_mut().enumerate() {
                    let n = tracer.image_index(color);
                    rays.iter_mut().for_each(|l| shift(l, n));
                }
            }
            if let Some(l) = &mut axis {
                shift(l, 1.0);
            }
            tracer.system.film_z += dz;
        }
        let first = FirstOrder::of(&tracer.system, tracer.indices(self.reference));
        let mut out = Vec::with_capacity(self.quantities.len());
        out.push(first.efl);
        out.extend(refocus.map(|dz| dz * tracer.system.film_run()));
        out.extend(amounts);
        let boresight = axis.map_or(DVec2::NAN, |l| l.place);
        out.extend([boresight.length(), boresight.x, boresight.y]);
        for (field, rays) in self.fields.iter().zip(&film_points) {
            match rays {
                Some(rays) => self.measure_field(field, rays, &tracer, &first, boresight, &mut out),
                None => {
                    let count = self.quantities.iter().filter(|q| q.field_deg == Some(field.bundle.field_deg)).count();
                    // A field that is listed twice has each of its quantities twice.
                    let twice = self.fields.iter().filter(|f| f.bundle.field_deg == field.bundle.field_deg).count();
                    out.extend(std::iter::repeat_n(f64::NAN, count / twice.max(1)));
                }
            }
        }
        out
    }

    /// Moves the film to the smallest mean square spot of all fields, mm along +z: least squares, since spots grow with the square.
    fn best_focus(&self, film_points: &[Option<Vec<Vec<TracedFilmPoint>>>]) -> f64 {
        let (mut cross, mut square) = (0.0, 0.0);
        for colors in film_points.iter().flatten() {
            let mean = |f: &dyn Fn(&TracedFilmPoint) -> DVec2| self.mean(colors, f);
            let (place, slope) = (mean(&|l| l.place), mean(&|l| l.slope));
            for (rays, w) in colors.iter().zip(&self.weights) {
                for l in rays {
                    let s = l.slope - slope;
                    cross += w * l.weight * (l.place - place).dot(s);
                    square += w * l.weight * s.length_squared();
                }
            }
        }
        if square > 0.0 { -cross / square } else { 0.0 }
    }

    /// Mean over all rays and wavelengths.
    fn mean(&self, colors: &[Vec<TracedFilmPoint>], f: &dyn Fn(&TracedFilmPoint) -> DVec2) -> DVec2 {
        colors.iter().zip(&self.weights).map(|(rays, w)| *w * rays.iter().map(|l| f(l) * l.weight).sum::<DVec2>()).sum()
    }

    fn measure_field(
        &self,
        field: &FieldPlan,
        colors: &[Vec<TracedFilmPoint>],
        tracer: &Tracer,
        first: &FirstOrder,
        boresight: DVec2,
        out: &mut Vec<f64>,
    ) {
        let middle = self.mean(colors, &|l| l.place);
        let spot2: f64 = colors
            .iter()
            .zip(&self.weights)
            .map(|(rays, w)| w * rays.iter().map(|l| l.weight * l.place.distance_squared(middle)).sum::<f64>())
            .sum();
        out.push(1e3 * spot2.sqrt());
        // One image point for all wavelengths, so that lateral colour costs contrast.
        let paths = |color: usize, image: DVec2| -> Vec<f64> {
            let n = tracer.image_index(color);
            colors[color][1..].iter().map(|l| path_to_foot(l, image, n)).collect()
        };
        let rays = &colors[self.reference];
        let centroid: DVec2 = rays.iter().map(|l| l.place * l.weight).sum();
        let (cosines, weights): (Vec<_>, Vec<_>) =
            rays[1..].iter().map(|l| (l.direction.truncate().to_array(), l.weight)).unzip();
        let (rms, _) = wavefront_rms(&cosines, &weights, &paths(self.reference, centroid));
        out.push(rms / (self.wavelengths[self.reference] * 1e-6));
        if has_distortion(field.bundle.field_deg) {
            out.push(self.distortion(field.bundle.field_deg, &rays[0], tracer, first, boresight));
        }
        let mut sums = vec![[DVec2::ZERO; 2]; field.waves.first().map_or(0, |w| w.shears.len())];
        for (color, plan) in field.waves.iter().enumerate() {
            let transfer = plan.transfer(&paths(color, middle), self.wavelengths[color]);
            for (sum, t) in sums.iter_mut().zip(transfer) {
                sum[0] += self.weights[color] * t[0];
                sum[1] += self.weights[color] * t[1];
            }
        }
        out.extend(sums.iter().flatten().map(|s| s.length()));
    }

    /// Distance of the chief ray from the axial image over that of a rectilinear image of the lens's own focal length, as
    /// [`crate::analysis::FieldPoint`] has it; per cent.
    fn distortion(&self, field_deg: f64, chief: &TracedFilmPoint, tracer: &Tracer, first: &FirstOrder, boresight: DVec2) -> f64 {
        let (system, tan) = (&tracer.system, field_deg.to_radians().tan());
        let ideal = match self.object_distance {
            None => first.front_focal_length() * tan + chief.slope.y * (system.film_z - system.last_z() - first.bfl),
            Some(d) => {
                let m = first.front_focal_length() / (d + first.ffl);
                let image_z = system.last_z() + first.bfl + first.efl * m * system.film_run();
                m * tan * (d + first.entrance_pupil_z) + chief.slope.y * (system.film_z - image_z)
            }
        };
        ((chief.place.y - boresight.y) / ideal - 1.0) * 100.0
    }
}

/// Whether distortion is measured at a field.
fn has_distortion(field_deg: f64) -> bool {
    field_deg != 0.0 && field_deg.abs() < STEEPEST_FIELD
}

/// Paths (mm) less their best plane over the direction cosines, and the root mean square of that: piston and tilt say where the image
/// is, not how good.
pub(crate) fn wavefront_rms<N: Number>(cosines: &[[N; 2]], weights: &[f64], paths: &[N]) -> (N, Vec<N>) {
    let mean = |f: &dyn Fn(usize) -> N| N::sum(weights.iter().enumerate().map(|(i, w)| f(i).scaled(*w)));
    let middle = [mean(&|i| cosines[i][0]), mean(&|i| cosines[i][1])];
    let path = mean(&|i| paths[i]);
    let at = |i: usize, axis: usize| cosines[i][axis] - middle[axis];
    let second = |a: usize, b: usize| mean(&|i| at(i, a) * at(i, b));
    let (xx, xy, yy) = (second(0, 0), second(0, 1), second(1, 1));
    let [px, py] = [0, 1].map(|axis| mean(&|i| at(i, axis) * (paths[i] - path)));
    let det = xx * yy - xy * xy;
    let tilt = match det.value() > 0.0 {
        true => [(px * yy - py * xy) / det, (py * xx - px * xy) / det],
        false => [N::constant(0.0); 2],
    };
    let errors: Vec<N> = (0..paths.len()).map(|i| paths[i] - path - tilt[0] * at(i, 0) - tilt[1] * at(i, 1)).collect();
    (mean(&|i| errors[i] * errors[i]).sqrt(), errors)
}
