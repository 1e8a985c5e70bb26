//! Tolerances: what a lens will be when it is built.
//!
//! A [`ToleranceSheet`] says what may differ from a design and by how much; [`Toleranced`] is the design with it. Each perturbation by
//! itself gives the sensitivities; their root sum square predicts the spread; builds are drawn at random (Monte Carlo), each a pure
//! function of sheet, seed and number: build 17 is the same lens today and tomorrow, alone or among a thousand, and it is a
//! [`Prescription`] like any other. Sources: Smith, "Modern Optical Engineering" (4th ed.), ch. 16; ISO 10110-5, -6; ISO 12123.
//!
//! Quantities are measured with the compensators set for the lens at hand, of the design, too.

mod amount;
mod assess;
mod compensate;
mod compensator;
mod parameter;
mod passes;
mod quantity;
mod sheet;

pub(crate) use assess::wavefront_rms;
#[cfg(test)]
pub(crate) use parameter::bend;
pub use parameter::{Axis, Change, Distribution, FRINGE_NM, Parameter};
pub(crate) use parameter::{bent_to, key, shifted, uniform};
pub use quantity::{Direction, Limit, Quantity, QuantityKind, Summary, yield_of};
pub use sheet::ToleranceSheet;
pub(crate) use sheet::{check_list, check_weights};

use crate::LensError;
use crate::analysis::{Bench, VISUAL_NM};
use crate::compound::{Configured, FilmPlace, configure};
use crate::glass::GlassError;
use crate::prescription::{Prescription, PrescriptionError};
use crate::system::System;
use assess::Assessment;
use parameter::{movable, perturbed};

/// Fields that are looked at by default, as fractions of the largest.
const FIELDS: [f64; 5] = [-1.0, -0.7, 0.0, 0.7, 1.0];
/// Part of the lit image circle whose field angle is the largest looked at: at its edge there is no light.
const IMAGE_CIRCLE: f64 = 0.95;

/// Root mean square radius of a spot, as a fraction of the focal length, above which nobody would call it an image: 2.5 mm of 50 mm; chosen.
const NO_IMAGE: f64 = 0.05;

/// A design with its tolerances.
pub struct Toleranced {
    design: Prescription,
    parameters: Vec<Parameter>,
    limits: Vec<Limit>,
    assessment: Assessment,
    nominal: Vec<f64>,
    seed: u64,
}

/// What one perturbation does by itself.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensitivity {
    /// All quantities at its upper end.
    pub plus: Vec<f64>,
    /// And at its lower end.
    pub minus: Vec<f64>,
}

/// Wavelengths (nm), weights, and the number of the reference: as asked, else as the lens says, else F, d and C.
pub(crate) fn colors_of(p: &Prescription, asked: Option<&Vec<f64>>, weights: Option<&Vec<f64>>) -> (Vec<(f64, f64)>, usize) {
    let (wavelengths, reference) = match (asked, &p.usage.wavelengths_nm[..]) {
        (Some(w), _) => (w.clone(), w.len() / 2),
        (None, []) => (VISUAL_NM.to_vec(), 1),
        (None, own) => (own.to_vec(), p.usage.reference),
    };
    let colors = wavelengths.iter().enumerate().map(|(i, nm)| (*nm, weights.map_or(1.0, |w| w[i]))).collect();
    (colors, reference)
}

/// Height (mm) up to which the film of a lens that is set is lit, at most the radius of its image circle; `None` where none is stated.
pub(crate) fn lit_height(p: &Prescription, set: &Configured) -> Option<f64> {
    let radius = 0.5 * p.image_circle?;
    set.image_circle_radius(radius).or(Some(radius))
}

/// Fields (degrees): as asked, else as the lens says, else fractions of that of the largest image height (mm).
pub(crate) fn fields_of(
    p: &Prescription,
    system: &System,
    height: Option<f64>,
    asked: Option<&Vec<f64>>,
    fractions: &[f64],
) -> Vec<f64> {
    if let Some(fields) = asked {
        return fields.clone();
    }
    let own = &p.usage.field_angles_deg;
    let largest = match (own.iter().fold(0.0f64, |a, f| a.max(f.abs())), height) {
        (most, _) if most > 0.0 => most,
        (_, Some(height)) => Bench::at_infinity(system).field_of_height(height * IMAGE_CIRCLE),
        _ => 0.0,
    };
    match largest > 0.0 {
        // A tenth of a degree is fine enough, and reads well.
        true => fractions.iter().map(|f| (10.0 * f * largest).trunc() / 10.0).collect(),
        false => vec![0.0],
    }
}

/// A field whose beams are spread so far over the film that they make no image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FieldWithoutImage {
    /// The field.
    pub field_deg: f64,
    /// Root mean square radius of its spot in the design.
    pub spot_um: f64,
    /// Lowest frequency that is measured, cycles/mm.
    pub frequency: Option<f64>,
}

impl Toleranced {
    /// Fields, in their order, where the design makes no image: the root mean square radius of the spot is more than 5 % of the focal length, or rays of neighbouring
    /// cells of the pupil land more than half a period of the lowest frequency apart, where the sum over cells ([`QuantityKind::Mtf`]) is aliased.
    pub fn fields_without_image(&self) -> Vec<FieldWithoutImage> {
        let values = || self.quantities().iter().zip(&self.nominal);
        let efl = values().find(|(q, _)| q.kind == QuantityKind::Efl).map_or(f64::INFINITY, |(_, efl)| efl.abs());
        let frequency = self.quantities().iter().filter_map(|q| q.frequency).reduce(f64::min);
        // An even disk is 2 √2 of its root mean square radius across.
        let cycles = |spot_mm: f64| 8f64.sqrt() * spot_mm * frequency.unwrap_or(0.0);
        let none = |spot_mm: f64| spot_mm > NO_IMAGE * efl || cycles(spot_mm) > 0.5 * assess::CELLS as f64;
        let spots = values().filter(|(q, um)| q.kind == QuantityKind::Spot && none(1e-3 * *um));
        spots.filter_map(|(q, um)| Some(FieldWithoutImage { field_deg: q.field_deg?, spot_um: *um, frequency })).collect()
    }

    /// Checks a sheet against a lens and measures the design. Fails on surfaces that are not there, on fields without light and on
    /// settings that the lens does not have.
    pub fn new(lens: &Prescription, sheet: &ToleranceSheet) -> Result<Toleranced, LensError> {
        let wrong = |line: usize, what: String| LensError::from(PrescriptionError::at(&sheet.file, line, what));
        let parameters = sheet.parameters(lens)?;
        let compensators = sheet.compensators(lens)?;
        // Glasses that change are curves through four lines in the design, too: it differs from its builds by nothing else.
        let mut design = lens.clone();
        for parameter in &parameters {
            if let Change::Index { surface } | Change::Abbe { surface } = parameter.change {
                let glass = &mut design.surfaces[surface].glass;
                *glass = movable(glass).map_err(|e: GlassError| {
                    wrong(0, format!("index or abbe of surface {}: {e}; expected a glass known from g to C", surface + 1))
                })?;
            }
        }
        let aperture = sheet.aperture.or_else(|| lens.used_f_number());
        let set = configure(&design, sheet.focal_length, aperture, None, FilmPlace::AsPublished)?;
        let height = lit_height(lens, &set);
        let Configured { system, state, .. } = set;
        let (colors, reference) = colors_of(lens, sheet.wavelengths_nm.as_ref(), sheet.weights.as_ref());
        let fields = fields_of(lens, &system, height, sheet.fields_deg.as_ref(), &FIELDS);
        let distance = lens.usage.object_distance.filter(|d| d.is_finite() && *d < 1e9);
        let assessment = Assessment::new(
            &system,
            state,
            distance,
            &fields,
            &colors,
            reference,
            &sheet.frequencies,
            sheet.refocus,
            compensators,
        )
        .map_err(|what| wrong(0, what))?;
        for limit in &sheet.limits {
            if !assessment.quantities.iter().any(|q| limit.matches(q)) {
                let mut all: Vec<String> = vec![];
                for q in assessment.quantities.iter().filter(|q| q.kind == limit.kind) {
                    all.push(q.name());
                }
                let expected = match all.is_empty() {
                    true => "one of those that are measured (refocus needs [compensator] refocus)".to_owned(),
                    false => all.join("; "),
                };
                return Err(wrong(limit.line, format!("limit \"{}\" matches nothing: expected {expected}", limit.name())));
            }
        }
        let nominal = assessment.measure(&design);
        Ok(Toleranced { design, parameters, limits: sheet.limits.clone(), assessment, nominal, seed: sheet.seed })
    }

    /// The lens without errors.
    pub fn design(&self) -> &Prescription {
        &self.design
    }

    /// What may be wrong, in the order of the sheet.
    pub fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    /// What is measured.
    pub fn quantities(&self) -> &[Quantity] {
        &self.assessment.quantities
    }

    /// What is asked.
    pub fn limits(&self) -> &[Limit] {
        &self.limits
    }

    /// All quantities of the design.
    pub fn nominal(&self) -> &[f64] {
        &self.nominal
    }

    /// Amounts of all perturbations of a build, in their units: pure functions of seed, number and place in the sheet.
    pub fn amounts(&self, build: u64) -> Vec<f64> {
        let key_of = |i: usize| key(&[self.seed, build, i as u64]);
        // Both parts of an error by the key of the first.
        let draw = |(i, p): (usize, &Parameter)| {
            let drawn = match p.part {
                None => p.distribution.draw(key_of(i)),
                Some(Axis::X) => p.distribution.draw_parts(key_of(i))[0],
                Some(Axis::Y) => p.distribution.draw_parts(key_of(i - 1))[1],
            };
            p.half_range * drawn
        };
        self.parameters.iter().enumerate().map(draw).collect()
    }

    /// The lens with given amounts of its perturbations, the film where the design has it. Fails where an index leaves what a glass
    /// can have, and with another number of amounts than [`Toleranced::amounts`] gives.
    pub fn perturbed(&self, amounts: &[f64]) -> Result<Prescription, LensError> {
        let (found, expected) = (amounts.len(), self.parameters.len());
        if found != expected {
            return Err(PrescriptionError::at(&self.design.name, 0, format!("{found} amounts; expected {expected}")).into());
        }
        perturbed(&self.design, &self.parameters, amounts).map_err(|e| {
            PrescriptionError::at(&self.design.name, 0, format!("{e}; expected a smaller tolerance of index or Abbe number"))
                .into()
        })
    }

    /// All quantities of a lens that differs from the design by little; not a number where it lets no light through.
    pub fn measure(&self, lens: &Prescription) -> Vec<f64> {
        self.assessment.measure(lens)
    }

    /// All quantities with given amounts of the perturbations.
    pub fn measure_perturbed(&self, amounts: &[f64]) -> Vec<f64> {
        match self.perturbed(amounts) {
            Ok(lens) => self.measure(&lens),
            Err(_) => vec![f64::NAN; self.quantities().len()],
        }
    }

    /// All quantities of a build.
    pub fn measure_build(&self, build: u64) -> Vec<f64> {
        self.measure_perturbed(&self.amounts(build))
    }

    /// What the perturbation of a number does by itself.
    pub fn sensitivity(&self, parameter: usize) -> Sensitivity {
        let at = |sign: f64| {
            let mut amounts = vec![0.0; self.parameters.len()];
            amounts[parameter] = sign * self.parameters[parameter].half_range;
            self.measure_perturbed(&amounts)
        };
        Sensitivity { plus: at(1.0), minus: at(-1.0) }
    }

    /// Standard deviation of each quantity over builds, predicted from the sensitivities: root of the sum of squares of half their
    /// differences, times the deviation of their distributions. Exact where quantities are linear in the perturbations.
    pub fn root_sum_square(&self, sensitivities: &[Sensitivity]) -> Vec<f64> {
        let each = |q: usize| {
            let terms = sensitivities.iter().zip(&self.parameters);
            terms.map(|(s, p)| (0.5 * (s.plus[q] - s.minus[q]) * p.deviation()).powi(2)).sum::<f64>().sqrt()
        };
        (0..self.quantities().len()).map(each).collect()
    }

    /// Mean of each quantity over builds, predicted from the sensitivities to second order: what is best in the design can only
    /// become worse.
    pub fn predicted_mean(&self, sensitivities: &[Sensitivity]) -> Vec<f64> {
        let each = |q: usize| {
            let nominal = self.nominal[q];
            let terms = sensitivities.iter().zip(&self.parameters);
            nominal + terms.map(|(s, p)| 0.5 * (s.plus[q] + s.minus[q] - 2.0 * nominal) * p.deviation().powi(2)).sum::<f64>()
        };
        (0..self.quantities().len()).map(each).collect()
    }

    /// Whether quantities keep all limits.
    pub fn is_good(&self, values: &[f64]) -> bool {
        (0..self.limits.len()).all(|l| self.keeps(l, values))
    }

    /// Whether quantities keep the limit of a number.
    pub fn keeps(&self, limit: usize, values: &[f64]) -> bool {
        let limit = &self.limits[limit];
        self.quantities().iter().zip(values).all(|(q, v)| !limit.matches(q) || limit.keeps(*v))
    }

    /// A build as a lens, adjusted by its compensators, the film where they put it, with a note of what it is. Fails where its surfaces cross.
    pub fn build(&self, build: u64) -> Result<Prescription, LensError> {
        let (mut lens, values) = self.assessment.compensated(&self.perturbed(&self.amounts(build))?);
        let refocus = self.quantities().iter().position(|q| q.kind == QuantityKind::Refocus).map_or(0.0, |i| values[i]);
        if refocus.is_finite()
            && let Some(last) = lens.surfaces.last_mut()
        {
            // Gaps count along z: negative where a mirror has turned the light.
            last.gap.values.iter_mut().flatten().for_each(|g| *g += refocus * g.signum());
        }
        lens.name = format!("{}, build {build}", self.design.name);
        let moved = self.quantities().iter().zip(&values).filter_map(|(q, v)| {
            let change = q.change.filter(|_| *v != 0.0)?;
            Some(format!(", {} adjusted by {v:.5} {}", change.name(), change.unit()))
        });
        lens.notes.push(format!(
            "build {build} of seed {}: {} perturbations of the design{}{}",
            self.seed,
            self.parameters.len(),
            if refocus == 0.0 { String::new() } else { format!(", film moved by {refocus:.5} mm") },
            moved.collect::<String>()
        ));
        let name = lens.name.clone();
        Ok(lens.checked(&name)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::embedded;
    use crate::prescription::read_toml;

    const SINGLET: &str = r#"
        name = "singlet"
        surfaces = [
          { radius = 103.36, gap = 4, glass = "1.5168", semi_diameter = 5, stop = true },
          { radius = -103.36, gap = 98.7, semi_diameter = 5.5 },
        ]
    "#;

    fn toleranced(lens: &Prescription, sheet: &str) -> Toleranced {
        Toleranced::new(lens, &ToleranceSheet::parse(sheet, "sheet.toml").unwrap()).unwrap()
    }

    fn gauss(sheet: &str) -> Toleranced {
        toleranced(&embedded("double-gauss-50mm").unwrap(), sheet)
    }

    /// Number of a quantity of a kind.
    fn find(t: &Toleranced, kind: QuantityKind) -> usize {
        t.quantities().iter().position(|q| q.kind == kind).unwrap()
    }

    #[test]
    fn sensitivities_of_a_singlet_are_the_paraxial_derivatives() {
        let lens = read_toml(SINGLET, "singlet.toml").unwrap();
        let t = toleranced(
            &lens,
            "fields_deg = [0]\nwavelengths_nm = [587.56]\n[[tolerance]]\nsurfaces = 1\nradius = 0.01\n[[tolerance]]\nsurfaces = 1\n\
             thickness = 0.01\nindex = 0.0001\n[[tolerance]]\ndecenter = 0.01\n[[tolerance]]\nsurfaces = 2\nwedge = 0.01",
        );
        // Thick lens: 1/f = (n − 1) (c1 − c2 + (n − 1) d c1 c2 / n); d(1/f) = −df/f² (Hecht §6.1).
        let (n, d, r) = (1.5168, 4.0, 103.36);
        let (c1, c2) = (1.0 / r, -1.0 / r);
        let f = 1.0 / ((n - 1.0) * (c1 - c2 + (n - 1.0) * d * c1 * c2 / n));
        let by_c1 = (n - 1.0) * (1.0 + (n - 1.0) * d * c2 / n);
        let by_d = (n - 1.0) * (n - 1.0) * c1 * c2 / n;
        let by_n = (c1 - c2 + (n - 1.0) * d * c1 * c2 / n) + (n - 1.0) * d * c1 * c2 / (n * n);
        let expected = [-f * f * by_c1 * (-c1 * c1) * 0.01, -f * f * by_d * 0.01, -f * f * by_n * 1e-4];
        let efl = find(&t, QuantityKind::Efl);
        let names: Vec<String> = t.parameters().iter().map(Parameter::name).collect();
        assert_eq!(names[..3], ["radius of surface 1", "gap after surface 1", "index after surface 1"]);
        for (i, expected) in expected.iter().enumerate() {
            let s = t.sensitivity(i);
            let half = 0.5 * (s.plus[efl] - s.minus[efl]);
            // 1e-4: the third order of a perturbation of 1e-4 of the radius is 1e-8 of the first.
            assert!((half / expected - 1.0).abs() < 1e-4, "{}: {half} {expected}", names[i]);
        }
        // A decentred lens shifts the image of a distant point by as much as it is decentred; in y only where it is moved in y.
        let (x, y) = (find(&t, QuantityKind::BoresightX), find(&t, QuantityKind::BoresightY));
        let s = t.sensitivity(3);
        assert!((s.plus[x] - 0.01).abs() < 5e-4 && s.plus[y].abs() < 1e-9, "{:?}", s.plus);
        // A turned surface is a thin prism: (n − 1) α over the distance to the film, about 98.7 mm.
        let wedge = t.sensitivity(5);
        let deviation = f64::hypot(wedge.plus[x], wedge.plus[y]);
        let prism = (n - 1.0) * 0.01f64.to_radians() * 98.7;
        assert!((deviation / prism - 1.0).abs() < 0.02, "{deviation} {prism}");
    }

    #[test]
    fn builds_spread_as_the_root_sum_square_of_the_sensitivities_says() {
        let t = gauss(
            "aperture = 4\nfields_deg = [0]\nwavelengths_nm = [587.56]\nfrequencies = [30]\n\
             [[tolerance]]\nradius = \"0.02%\"\nthickness = 0.005\n\
             [[tolerance]]\ndecenter = 0.003\ndistribution = \"normal\"",
        );
        let sensitivities: Vec<Sensitivity> = (0..t.parameters().len()).map(|i| t.sensitivity(i)).collect();
        let predicted = t.root_sum_square(&sensitivities);
        const BUILDS: u64 = 300;
        let builds: Vec<Vec<f64>> = (0..BUILDS).map(|k| t.measure_build(k)).collect();
        for kind in [QuantityKind::Efl, QuantityKind::BoresightX, QuantityKind::BoresightY] {
            let q = find(&t, kind);
            let s = Summary::of(builds.iter().map(|b| b[q]));
            // Three standard errors of a standard deviation: 1/√(2 n) each.
            let error = 3.0 / (2.0 * BUILDS as f64).sqrt();
            assert!((s.deviation / predicted[q] - 1.0).abs() < error, "{kind:?}: {} {}", s.deviation, predicted[q]);
            assert!((s.mean - t.nominal()[q]).abs() < 3.5 * predicted[q] / (BUILDS as f64).sqrt(), "{kind:?} {}", s.mean);
        }
    }

    #[test]
    fn the_same_number_is_the_same_lens() {
        let sheet = "fields_deg = [0]\n[compensator]\nrefocus = 0.5\n[[tolerance]]\nradius = \"0.1%\"\nform = \"3/3(1)\"\nindex = \"NP050\"\n\
                     thickness = 0.03\n[[tolerance]]\ndecenter = 0.02\ntilt = \"1 arcmin\"";
        let (a, b) = (gauss(sheet), gauss(sheet));
        let lens = a.build(17).unwrap();
        assert_eq!(lens, b.build(17).unwrap());
        assert_ne!(lens.surfaces, a.build(18).unwrap().surfaces);
        let other = gauss(&format!("seed = 2\n{sheet}"));
        assert_ne!(lens.surfaces, other.build(17).unwrap().surfaces);
        // What is added to a sheet leaves what was drawn before as it was.
        let longer = gauss(&format!("{sheet}\n[[tolerance]]\nsurfaces = 1\nwedge = 0.01"));
        let count = a.parameters().len();
        assert_eq!(longer.amounts(17)[..count], a.amounts(17));
        // A build is a lens: written, read and measured it is the same to rounding.
        let read = read_toml(&lens.to_toml(), "build.toml").unwrap();
        let (values, again) = (a.measure(&lens), a.measure(&read));
        let refocus = find(&a, QuantityKind::Refocus);
        assert!(values[refocus].abs() < 1e-6, "its film stands in the best place: {}", values[refocus]);
        for (v, w) in values.iter().zip(&again) {
            assert!((v - w).abs() < 1e-6 * (1.0 + v.abs()), "{v} {w}");
        }
    }

    #[test]
    fn the_design_has_the_mtf_of_the_bench() {
        let colors = [(486.13, 1.0), (587.56, 1.0), (656.27, 1.0)];
        let t = gauss(
            "aperture = 2.8\nfields_deg = [0, 10, 18]\nwavelengths_nm = [486.13, 587.56, 656.27]\nfrequencies = [20, 60]\n\
             [[tolerance]]\nradius = \"0.1%\"",
        );
        let set = configure(t.design(), None, Some(2.8), None, FilmPlace::AsPublished).unwrap();
        let bench = Bench::at_infinity(&set.system);
        for field in [0.0, 10.0, 18.0] {
            let plain = bench.diffraction_mtf(field, &colors, &[20.0, 60.0], 0.0).unwrap();
            for (i, frequency) in [20.0, 60.0].into_iter().enumerate() {
                for (direction, expected) in
                    [(Direction::Tangential, plain.tangential[i]), (Direction::Sagittal, plain.sagittal[i])]
                {
                    let wanted = Quantity {
                        frequency: Some(frequency),
                        direction: Some(direction),
                        ..Quantity::of_field(QuantityKind::Mtf, field)
                    };
                    let q = t.quantities().iter().position(|q| *q == wanted).unwrap();
                    // The bench traces 128 rays across; 0.02 is what its cells at the edge of the pupil and the polynomial's 32 leave.
                    assert!((t.nominal()[q] - expected).abs() < 0.02, "{}: {} {expected}", wanted.name(), t.nominal()[q]);
                }
            }
        }
    }

    #[test]
    fn errors_of_form_of_a_surface_that_is_the_stop_keep_their_directions() {
        let lens = embedded("triplet-50mm-f4").unwrap();
        let stop = lens.surfaces.iter().position(|s| s.stop).unwrap();
        assert!(!matches!(lens.surfaces[stop].glass.kind, crate::glass::GlassKind::Air), "a glass surface");
        let t = toleranced(
            &lens,
            &format!(
                "aperture = 5.6\nfields_deg = [0]\nfrequencies = [30]\n[[tolerance]]\nsurfaces = {}\nform = \"3/-(3)\"",
                stop + 1
            ),
        );
        let of = |direction: Direction, values: &[f64]| {
            let wanted = |q: &Quantity| q.kind == QuantityKind::Mtf && q.direction == Some(direction);
            values[t.quantities().iter().position(wanted).unwrap()]
        };
        let [along, across] = [t.sensitivity(0), t.sensitivity(1)];
        let pair = |values: &[f64]| [Direction::Tangential, Direction::Sagittal].map(|d| of(d, values));
        let ([pt, ps], [mt, ms]) = (pair(&along.plus), pair(&along.minus));
        // The other sign exchanges the two sections of a round lens on its axis; at 45° they are alike.
        assert!((pt - ps).abs() > 0.05, "{pt} {ps}");
        assert!((pt - ms).abs() < 0.01 && (ps - mt).abs() < 0.01, "{pt} {ps} {mt} {ms}");
        let [ct, cs] = pair(&across.plus);
        assert!((ct - cs).abs() < 0.01, "{ct} {cs}");
        // The focal length of the y–z section goes up with one sign, down with the other, and stays at 45°.
        let efl = find(&t, QuantityKind::Efl);
        let [plus, minus, middle] = [along.plus[efl], along.minus[efl], across.plus[efl]].map(|v| v - t.nominal()[efl]);
        assert!(plus * minus < 0.0 && middle.abs() < 0.1 * plus.abs(), "{plus} {minus} {middle}");
    }

    #[test]
    fn a_gap_that_light_passes_twice_is_one_for_compensators_and_elements() {
        let lens = embedded("reflex-500mm-f8").unwrap();
        let adjusted = |surface: usize| {
            let t = toleranced(
                &lens,
                &format!(
                    "fields_deg = [0]\nfrequencies = [10]\n[compensator]\ngap = [{{ surface = {surface}, by = 0.5 }}]\n[[tolerance]]\nsurfaces = 3\nthickness = 0.02"
                ),
            );
            t.nominal()[find(&t, QuantityKind::Wavefront)]
        };
        assert!((adjusted(5) / adjusted(6) - 1.0).abs() < 1e-6 && adjusted(5) < 0.1, "{} {}", adjusted(5), adjusted(6));
        let sheet = |elements: &str| {
            let text = format!("fields_deg = [0]\n[[tolerance]]\nelements = {elements}\ndecenter = 0.02");
            Toleranced::new(&lens, &ToleranceSheet::parse(&text, "s.toml").unwrap())
                .err()
                .map(|e| e.to_string())
                .unwrap_or_default()
        };
        assert!(sheet("[[5, 6]]").contains("expected [5, 7]") && sheet("[[5, 7]]").is_empty(), "{}", sheet("[[5, 6]]"));
    }

    #[test]
    fn wrong_sheets_are_told_what_is_wrong() {
        let lens = embedded("double-gauss-50mm").unwrap();
        let error = |text: &str| match ToleranceSheet::parse(text, "s.toml") {
            Err(e) => e.to_string(),
            Ok(sheet) => Toleranced::new(&lens, &sheet).err().map(|e| e.to_string()).unwrap_or_default(),
        };
        for (text, parts) in [
            ("seed = 1", vec!["s.toml", "no [[tolerance]]", "expected"]),
            (
                "[[tolerance]]\nradius = \"0.1 furlongs\"",
                vec!["s.toml:1", "0.1 furlongs", "expected an amount such as", "fringes"],
            ),
            ("seed = 1\n[[tolerance]]\nsurfaces = 12\nradius = 0.1", vec!["s.toml:2", "surface 12", "expected 1 to 11"]),
            ("[[tolerance]]\nradus = 0.1", vec!["s.toml:2", "radus", "expected"]),
            ("[[tolerance]]\nsurfaces = 2\nindex = 0.001", vec!["surface 2", "expected glass, found air"]),
            ("[[tolerance]]\nsurfaces = 2\nthickness = 0.2", vec!["0.2 mm", "0.12", "surface 2", "expected less"]),
            ("[[tolerance]]\nsurfaces = 1\nabbe = \"AN5\"", vec!["surface 1", "no dispersion"]),
            ("[[tolerance]]\nform = \"5(1)\"", vec!["form \"5(1)\"", "expected", "3/3(1)"]),
            ("[[tolerance]]\nsurfaces = 1", vec!["s.toml:1", "nothing in this [[tolerance]]", "expected"]),
            ("fields_deg = [200]\n[[tolerance]]\nradius = 0.1", vec!["fields_deg 200", "expected -120 to 120"]),
            (
                "[[tolerance]]\nradius = 0.1\n[[limit]]\nquantity = \"mtff\"\nat_least = 1",
                vec!["s.toml:3", "mtff", "did you mean \"mtf\"?"],
            ),
            (
                "[[tolerance]]\nradius = 0.1\n[[limit]]\nquantity = \"mtf\"\nfrequency = 31\nat_least = 1",
                vec!["s.toml:3", "matches nothing", "expected mtf 30/mm"],
            ),
            ("[[tolerance]]\nradius = 0.1\n[[limit]]\nquantity = \"efl\"", vec!["s.toml:3", "efl", "expected at_least"]),
        ] {
            let message = error(text);
            assert!(parts.iter().all(|p| message.contains(p)), "{text}\n{message}");
        }
    }

    #[test]
    fn forms_in_fringes_and_in_nanometres_are_the_same() {
        let form = |text: &str| {
            gauss(&format!("fields_deg = [0]\n[[tolerance]]\nsurfaces = 1\nform = \"{text}\"")).parameters().to_vec()
        };
        let (fringes, nm) = (form("3/2(1)"), form("3/546.07(273.035) nm"));
        // Power, and the two directions of irregularity; Δc = N λ / h² with h = 12.6 mm.
        assert_eq!(fringes.len(), 3);
        assert!((fringes[0].half_range / (2.0 * FRINGE_NM * 1e-6 / (12.6 * 12.6)) - 1.0).abs() < 1e-12);
        assert!(fringes.iter().zip(&nm).all(|(a, b)| a.change == b.change && (a.half_range / b.half_range - 1.0).abs() < 1e-12));
    }

    #[test]
    fn fields_that_the_lens_does_not_image_are_known() {
        // An equiconvex singlet is sharp on its axis and blurs by millimetres far from it.
        let lens = read_toml(SINGLET, "singlet.toml").unwrap();
        let t = toleranced(&lens, "fields_deg = [0, 10, 60]\nfrequencies = [30]\n[[tolerance]]\nsurfaces = 1\nradius = 0.01");
        let found = t.fields_without_image();
        assert_eq!(found.iter().map(|f| (f.field_deg, f.frequency)).collect::<Vec<_>>(), [(60.0, Some(30.0))], "{found:?}");
        assert!(found[0].spot_um > 5000.0, "{found:?}");
        assert!(gauss("aperture = 2.8\n[[tolerance]]\nradius = \"0.1%\"").fields_without_image().is_empty());
        let fisheye = embedded("fisheye-10mm").unwrap();
        assert!(toleranced(&fisheye, "fields_deg = [0, 60]\n[[tolerance]]\nradius = \"0.1%\"").fields_without_image().is_empty());
    }

    #[test]
    fn yield_counts_builds_that_keep_all_limits() {
        let t = gauss(
            "fields_deg = [0]\nwavelengths_nm = [587.56]\n[[tolerance]]\nradius = \"1%\"\ndistribution = \"ends\"\nsurfaces = 1\n\
             [[limit]]\nquantity = \"efl\"\nat_least = 50.0",
        );
        // A longer radius of the first surface, which collects, is a longer focal length: half of the builds pass.
        let s = t.sensitivity(0);
        let efl = find(&t, QuantityKind::Efl);
        assert!(s.plus[efl] > s.minus[efl]);
        let limit = 0.5 * (s.plus[efl] + s.minus[efl]);
        let good = (0..100).filter(|k| t.measure_build(*k)[efl] >= limit).count();
        // 100 fair coins: 50 ± 5, four deviations.
        assert!((30..=70).contains(&good), "{good}");
        assert!(t.keeps(0, &[51.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]) && !t.is_good(&[f64::NAN; 8]));
    }
}
