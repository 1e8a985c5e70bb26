//! What operands are worth, and how their residuals change: one formula for plain numbers and for numbers with a derivative.

use super::{Operand, OperandKind, Wanted};
use crate::analysis::airy_mtf_of;
use crate::bundle::{FilmPointChange, TracedFilmPoint};
use crate::dual::{Dual, Number};
use crate::paraxial::Cardinal;
use crate::tolerance::{Direction, wavefront_rms};
use std::f64::consts::TAU;

/// A ray on the plane of the film.
#[derive(Clone, Copy, Debug)]
pub(super) struct Arrival<N> {
    /// mm
    pub place: [N; 2],
    /// Direction cosines.
    pub cosines: [N; 3],
    /// Optical path to the plane, mm.
    pub path: N,
    /// Part of the beam.
    pub weight: f64,
}

impl From<&TracedFilmPoint> for Arrival<f64> {
    fn from(l: &TracedFilmPoint) -> Self {
        Arrival { place: l.place.to_array(), cosines: l.direction.to_array(), path: l.path, weight: l.weight }
    }
}

impl Arrival<f64> {
    /// With its change by one variable.
    pub fn changing(&self, by: &FilmPointChange) -> Arrival<Dual<1>> {
        let dual = |value: f64, by: f64| Dual { value, derivatives: [by] };
        Arrival {
            place: [0, 1].map(|i| dual(self.place[i], by.place[i])),
            cosines: [0, 1, 2].map(|i| dual(self.cosines[i], by.cosines[i])),
            path: dual(self.path, by.path),
            weight: self.weight,
        }
    }
}

/// What operands look at.
pub(super) struct Seen<'a, N> {
    /// Of each field and wavelength; the first ray is the chief ray.
    pub rays: &'a [Vec<Vec<Arrival<N>>>],
    pub first: Cardinal<N>,
    /// Place of the film, mm from the first vertex.
    pub film_z: N,
    /// Gap after the operand's surface, on the axis and at the rim, mm.
    pub thickness: &'a dyn Fn(usize) -> N,
    pub edge: &'a dyn Fn(usize) -> N,
    /// Index behind the lens at each wavelength.
    pub image_indices: &'a [N],
}

/// What operands need to know of the merit beside the lens.
pub(super) struct Terms<'a> {
    pub fields_deg: &'a [f64],
    pub wavelengths: &'a [f64],
    pub weights: &'a [f64],
    pub reference: usize,
    pub object_distance: Option<f64>,
    /// Focal length that distortion is measured against, mm.
    pub ideal_efl: Option<f64>,
}

impl Terms<'_> {
    /// Value and residuals of an operand.
    pub fn of<N: Number>(&self, o: &Operand, seen: &Seen<N>) -> (N, Vec<N>) {
        let root = o.weight.sqrt();
        let one = |value: N| (value, vec![o.error(value).scaled(root)]);
        let minimised = o.wanted == Wanted::Target(0.0);
        let field = o.field.unwrap_or(0);
        let chief = || &seen.rays[field][self.reference][0];
        match o.kind {
            OperandKind::Spot => {
                let colors = &seen.rays[field];
                let rays =
                    || colors.iter().zip(self.weights).flat_map(|(rays, w)| rays[1..].iter().map(move |l| (l, w * l.weight)));
                let middle = [0, 1].map(|axis| N::sum(rays().map(|(l, w)| l.place[axis].scaled(w))));
                // Ray by ray, in µm; together their squares are that of the RMS spot.
                let errors: Vec<N> =
                    rays().flat_map(|(l, w)| [0, 1].map(|i| (l.place[i] - middle[i]).scaled(1e3 * w.sqrt()))).collect();
                let rms = N::sum(errors.iter().map(|e| *e * *e)).sqrt();
                if minimised { (rms, errors.into_iter().map(|e| e.scaled(root)).collect()) } else { one(rms) }
            }
            OperandKind::Wavefront => {
                let rays = &seen.rays[field][self.reference];
                let n = seen.image_indices[self.reference];
                let middle = [0, 1].map(|axis| N::sum(rays.iter().map(|l| l.place[axis].scaled(l.weight))));
                // To the foot of the perpendicular from the middle of the spot: see `path_to_foot`.
                let aside = |l: &Arrival<N>| N::sum([0, 1].iter().map(|i| (middle[*i] - l.place[*i]) * l.cosines[*i]));
                let paths: Vec<N> = rays[1..].iter().map(|l| l.path + aside(l) * n).collect();
                let (cosines, weights): (Vec<_>, Vec<_>) =
                    rays[1..].iter().map(|l| ([l.cosines[0], l.cosines[1]], l.weight)).unzip();
                let per_mm = 1.0 / (self.wavelengths[self.reference] * 1e-6);
                let (rms, errors) = wavefront_rms(&cosines, &weights, &paths);
                if minimised {
                    let each = errors.iter().zip(&weights).map(|(e, w)| e.scaled(root * w.sqrt() * per_mm));
                    (rms.scaled(per_mm), each.collect())
                } else {
                    one(rms.scaled(per_mm))
                }
            }
            OperandKind::Mtf => one(self.contrast(o, seen, &seen.rays[field])),
            OperandKind::Distortion => {
                let tan = self.fields_deg[field].to_radians().tan();
                let efl = self.ideal_efl.map_or(seen.first.efl, N::constant);
                let ideal = match self.object_distance.map(N::constant) {
                    None => efl.scaled(tan),
                    Some(d) => efl / (d + seen.first.ffl) * (d + seen.first.entrance_pupil_z).scaled(tan),
                };
                one((chief().place[1] / ideal - N::constant(1.0)).scaled(100.0))
            }
            OperandKind::ChiefAngle => {
                let [x, y, z] = chief().cosines;
                one((x * x + y * y).sqrt().atan2(z.abs()).scaled(1f64.to_degrees()))
            }
            OperandKind::Efl => match o.wanted {
                // By the power, which is finite for plane plates: near the target the same.
                Wanted::Target(t) => {
                    let error = N::constant(1.0) - N::constant(t) / seen.first.efl;
                    (seen.first.efl, vec![error.scaled(root * t)])
                }
                Wanted::Within(_) => one(seen.first.efl),
            },
            OperandKind::Bfl => one(seen.first.bfl),
            OperandKind::Length => one(seen.film_z.abs()),
            OperandKind::Thickness => one(o.surface.map_or(N::constant(0.0), |s| (seen.thickness)(s).abs())),
            OperandKind::Edge => one(o.surface.map_or(N::constant(0.0), |s| (seen.edge)(s))),
        }
    }

    /// Contrast of all wavelengths: the transfer function of the rays, |Σ w exp(2πi ν x)|, each wavelength times that of a perfect lens with a
    /// pupil as wide (Smith, "Modern Optical Engineering", ch. 15: a good approximation from perfect to bad, not far out of focus). Four standard deviations
    /// of a direction cosine over an ellipse are its width.
    fn contrast<N: Number>(&self, o: &Operand, seen: &Seen<N>, colors: &[Vec<Arrival<N>>]) -> N {
        let (frequency, direction) = o.detail.unwrap_or((0.0, Direction::Tangential));
        let axis = usize::from(direction == Direction::Tangential);
        let mean = |rays: &[Arrival<N>], of: &dyn Fn(&Arrival<N>) -> N| N::sum(rays.iter().map(|l| of(l).scaled(l.weight)));
        let middle = N::sum(colors.iter().zip(self.weights).map(|(rays, w)| mean(&rays[1..], &|l| l.place[axis]).scaled(*w)));
        let mut sum = [N::constant(0.0); 2];
        for (color, (rays, w)) in colors.iter().zip(self.weights).enumerate() {
            let rays = &rays[1..];
            let average = mean(rays, &|l| l.cosines[axis]);
            let spread = mean(rays, &|l| (l.cosines[axis] - average) * (l.cosines[axis] - average)).sqrt();
            let width = spread.scaled(4.0) * seen.image_indices[color].abs();
            let perfect = airy_mtf_of(N::constant(frequency * self.wavelengths[color] * 1e-6) / width).scaled(*w);
            let phase = |l: &Arrival<N>| (l.place[axis] - middle).scaled(TAU * frequency);
            let parts = [mean(rays, &|l| phase(l).cos()), mean(rays, &|l| phase(l).sin())];
            (0..2).for_each(|i| sum[i] = sum[i] + parts[i] * perfect);
        }
        (sum[0] * sum[0] + sum[1] * sum[1]).sqrt()
    }
}

/// Derivatives of the residuals of a spot that is made small, which are linear in the places: without numbers that carry them.
pub(super) fn spot_changes(
    o: &Operand,
    weights: &[f64],
    colors: &[Vec<Arrival<f64>>],
    changes: &[&[FilmPointChange]],
) -> Vec<f64> {
    let mut middle = [0.0; 2];
    for ((rays, changes), w) in colors.iter().zip(changes).zip(weights) {
        for (ray, change) in rays[1..].iter().zip(&changes[1..]) {
            (0..2).for_each(|i| middle[i] += w * ray.weight * change.place[i]);
        }
    }
    let factor = 1e3 * o.weight.sqrt();
    let mut all = Vec::with_capacity(2 * colors.iter().map(Vec::len).sum::<usize>());
    for ((rays, changes), w) in colors.iter().zip(changes).zip(weights) {
        for (ray, change) in rays[1..].iter().zip(&changes[1..]) {
            let factor = factor * (w * ray.weight).sqrt();
            all.extend([0, 1].map(|i| (change.place[i] - middle[i]) * factor));
        }
    }
    all
}
