//! Compensators: what is adjusted in every build after it was put together, so that its errors do least harm: gaps that are shimmed, elements
//! that are centred or tilted under a test target. The film's own refocus is solved in closed form (`assess.rs`); the others, which
//! [`Change`] names, by damped least squares of all rays within how far each may move. Source: Smith, "Modern Optical Engineering" (4th ed.), §16.5.

use super::amount::{Amount, Unit, amount};
use super::parameter::{Axis, Change, Distribution, Parameter};
use crate::prescription::{Prescription, PrescriptionError};
use crate::toml_place::line_of;
use serde::Deserialize;
use toml::Spanned;

/// Most compensators beside the film: each costs traces in every build.
const MOST_COMPENSATORS: usize = 20;

/// `[compensator]` of a sheet.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Compensators {
    pub refocus: Option<f64>,
    #[serde(default)]
    gap: Vec<Spanned<GapEntry>>,
    #[serde(default)]
    decenter: Vec<Spanned<ElementEntry>>,
    #[serde(default)]
    tilt: Vec<Spanned<ElementEntry>>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct GapEntry {
    surface: usize,
    by: Amount,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ElementEntry {
    element: [usize; 2],
    by: Amount,
    axis: Option<Axis>,
}

impl Compensators {
    /// What may be adjusted in a lens beside its film: gaps, then shifts, then tilts, each with how far it may move either way. Fails on surfaces
    /// that the lens does not have, on one that is given twice and on ranges that it cannot move by; errors name the line in `text`, the sheet.
    pub fn parameters(&self, p: &Prescription, file: &str, text: &str) -> Result<Vec<Parameter>, PrescriptionError> {
        let count = p.surfaces.len();
        let mut all: Vec<Parameter> = vec![];
        let mut push = |change: Change, half_range: f64, line: usize| {
            let found = Parameter { change, half_range, distribution: Distribution::Uniform, part: None };
            let wrong = |what: String| Err(PrescriptionError::at(file, line, what));
            if !(half_range > 0.0) {
                return wrong(format!("compensator {}: by 0, expected how far it may move", found.name()));
            }
            if all.iter().any(|p| p.change == change) {
                return wrong(format!("compensator {}: a second time, expected once", found.name()));
            }
            if all.len() == MOST_COMPENSATORS {
                return wrong(format!(
                    "more than {MOST_COMPENSATORS} compensators: expected fewer (an element counts for x and for y)"
                ));
            }
            all.push(found);
            Ok(())
        };
        for entry in &self.gap {
            let line = line_of(text, entry.span().start);
            let wrong = |what: String| PrescriptionError::at(file, line, what);
            let GapEntry { surface, by } = entry.get_ref();
            if !(1..=count).contains(surface) {
                return Err(wrong(format!("compensator gap after surface {surface}: expected 1 to {count}")));
            }
            if *surface == count {
                let what = "the last: expected one before it (the film's own place is refocus)";
                return Err(wrong(format!("compensator gap after surface {surface}, {what}")));
            }
            let (by, _) =
                amount("by", by, Unit::Millimeters, &[Unit::Millimeters], "a length, such as \"0.2 mm\"").map_err(wrong)?;
            let least = p.surfaces[surface - 1].gap.values.iter().flatten().map(|g| g.abs()).fold(f64::INFINITY, f64::min);
            if by >= least {
                let what = format!("by {by} mm of a gap of {least} mm: expected less, the surfaces would meet");
                return Err(wrong(format!("compensator gap after surface {surface}: {what}")));
            }
            push(Change::Gap { surface: surface - 1 }, by, line)?;
        }
        let elements = self.decenter.iter().map(|e| (e, false)).chain(self.tilt.iter().map(|e| (e, true)));
        for (entry, turned) in elements {
            let line = line_of(text, entry.span().start);
            let wrong = |what: String| PrescriptionError::at(file, line, what);
            let ElementEntry { element: [first, last], by, axis } = entry.get_ref();
            if !(1 <= *first && first <= last && *last <= count) {
                return Err(wrong(format!("compensator element [{first}, {last}]: expected first and last of 1 to {count}")));
            }
            let (by, _) = match turned {
                false => amount("by", by, Unit::Millimeters, &[Unit::Millimeters], "a length, such as \"0.1 mm\""),
                true => amount("by", by, Unit::Degrees, &[Unit::Degrees], "an angle, such as \"5 arcmin\""),
            }
            .map_err(wrong)?;
            let (first, last) = (first - 1, last - 1);
            for axis in [Axis::X, Axis::Y].into_iter().filter(|a| axis.is_none_or(|only| only == *a)) {
                let change = if turned { Change::Tilt { first, last, axis } } else { Change::Decenter { first, last, axis } };
                push(change, by, line)?;
            }
        }
        Ok(all)
    }
}

#[cfg(test)]
mod tests {
    use crate::embedded;
    use crate::prescription::read_toml;
    use crate::tolerance::{Change, QuantityKind, Sensitivity, Summary, ToleranceSheet, Toleranced};

    const HEAD: &str = "aperture = 2.8\nfields_deg = [-14, 0, 14]\nwavelengths_nm = [587.56]\n";

    fn gauss(sheet: &str) -> Toleranced {
        let sheet = ToleranceSheet::parse(&format!("{HEAD}{sheet}"), "sheet.toml").unwrap();
        Toleranced::new(&embedded("double-gauss-50mm").unwrap(), &sheet).unwrap()
    }

    /// What the compensators of a lens did, in the order of the sheet.
    fn moves(t: &Toleranced, values: &[f64]) -> Vec<f64> {
        let of = t.quantities().iter().zip(values).filter(|(q, _)| q.kind == QuantityKind::Compensator);
        of.map(|(_, v)| *v).collect()
    }

    /// Sum of the mean square spots of all fields, µm².
    fn square(t: &Toleranced, values: &[f64]) -> f64 {
        t.quantities().iter().zip(values).filter(|(q, _)| q.kind == QuantityKind::Spot).map(|(_, v)| v * v).sum()
    }

    #[test]
    fn an_element_that_was_put_wrongly_is_put_back() {
        // Centred, the design's spots are smallest by symmetry; the compensator is the same move as the error.
        for (kind, error, by) in [("decenter", 0.02, 0.1), ("tilt", 0.05, 0.2)] {
            let t = gauss(&format!(
                "[compensator]\nrefocus = 0.5\n{kind} = [{{ element = [7, 9], by = {by} }}]\n[[tolerance]]\nelements = [[7, 9]]\n{kind} = {error}"
            ));
            assert_eq!(t.parameters().len(), 2);
            // 1e-4 of the error: where the last step changes the spots by 1e-8, the move is known to the root of that.
            assert!(moves(&t, t.nominal()).iter().all(|v| v.abs() < 1e-4 * error), "{:?}", t.nominal());
            let errors = [error, -0.5 * error];
            let values = t.measure_perturbed(&errors);
            for (found, error) in moves(&t, &values).iter().zip(errors) {
                assert!((found + error).abs() < 1e-4 * by, "{kind}: {found} {error}");
            }
            // So the lens is the design again.
            for ((q, v), nominal) in t.quantities().iter().zip(&values).zip(t.nominal()) {
                let moved = q.kind == QuantityKind::Compensator;
                assert!(moved || (v - nominal).abs() < 1e-3 * (0.1 + nominal.abs()), "{}: {v} {nominal}", q.name());
            }
            // And goes no further than it may.
            let held = gauss(&format!(
                "[compensator]\nrefocus = 0.5\n{kind} = [{{ element = [7, 9], by = {}, axis = \"x\" }}]\n[[tolerance]]\nelements = [[7, 9]]\n\
                 {kind} = {error}",
                0.5 * error
            ));
            assert_eq!(moves(&held, &held.measure_perturbed(&[error, 0.0])), [-0.5 * error]);
        }
    }

    #[test]
    fn a_gap_is_set_to_the_smallest_spots_that_a_search_finds() {
        let tolerance = "[[tolerance]]\nsurfaces = [7, 9]\nradius = \"0.5%\"\n[[tolerance]]\nsurfaces = 5\nthickness = 2";
        let free = gauss(&format!("[compensator]\nrefocus = 0.5\ngap = [{{ surface = 5, by = \"2000 µm\" }}]\n{tolerance}"));
        let plain = gauss(&format!("[compensator]\nrefocus = 0.5\n{tolerance}"));
        let errors = [0.05, -0.07, 0.0];
        let values = free.measure_perturbed(&errors);
        let [found] = moves(&free, &values)[..] else { panic!("one compensator") };
        // Brute force: the same gap as an error of the sheet without the compensator.
        const STEP: f64 = 0.05;
        let (best, at) = (-39..=39)
            .map(|i| STEP * f64::from(i))
            .map(|gap| (square(&plain, &plain.measure_perturbed(&[errors[0], errors[1], gap])), gap))
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .unwrap();
        assert!((found - at).abs() < STEP, "{found} {at}");
        assert!(at.abs() > 0.1 && at.abs() < 1.9, "the search ended inside: {at}");
        // As good as the best of the search, which is within a step of the bottom of a valley that is 1 mm wide; 1e-6: the film's own place.
        let least = square(&free, &values);
        assert!(least < best * (1.0 + 1e-6) && least > 0.98 * best, "{least} {best}");
        let there = square(&plain, &plain.measure_perturbed(&[errors[0], errors[1], found]));
        assert!((least / there - 1.0).abs() < 1e-9, "{least} {there}");
        assert!(least < 0.9 * square(&plain, &plain.measure_perturbed(&errors)));
    }

    #[test]
    fn builds_with_compensators_spread_as_their_sensitivities_say() {
        let t = gauss(
            "[compensator]\nrefocus = 0.5\ndecenter = [{ element = [7, 9], by = 0.2 }]\n[[tolerance]]\nelements = \"all\"\ndecenter = 0.004\n\
             [[tolerance]]\nradius = \"0.01%\"",
        );
        let sensitivities: Vec<Sensitivity> = (0..t.parameters().len()).map(|i| t.sensitivity(i)).collect();
        let predicted = t.root_sum_square(&sensitivities);
        const BUILDS: u64 = 80;
        let builds: Vec<Vec<f64>> = (0..BUILDS).map(|k| t.measure_build(k)).collect();
        for (i, q) in t.quantities().iter().enumerate() {
            if !matches!(q.kind, QuantityKind::Compensator | QuantityKind::Efl | QuantityKind::Refocus | QuantityKind::BoresightX)
            {
                continue;
            }
            let s = Summary::of(builds.iter().map(|b| b[i]));
            // Three standard errors: 1/√(2 n) of a deviation, 1/√n of a mean.
            assert!(
                (s.deviation / predicted[i] - 1.0).abs() < 3.0 / (2.0 * BUILDS as f64).sqrt(),
                "{}: {s:?} {}",
                q.name(),
                predicted[i]
            );
            assert!((s.mean - t.nominal()[i]).abs() < 3.0 * predicted[i] / (BUILDS as f64).sqrt(), "{}: {s:?}", q.name());
        }
        // The lens of a build is adjusted: written and read, nothing is left to adjust.
        let lens = t.build(4).unwrap();
        assert!(lens.notes.iter().any(|n| n.contains("decentre of element 7-9 in y adjusted by")), "{:?}", lens.notes);
        let again = t.measure(&read_toml(&lens.to_toml(), "build.toml").unwrap());
        for (q, (v, w)) in t.quantities().iter().zip(again.iter().zip(&builds[4])) {
            match q.kind {
                QuantityKind::Compensator => assert!(v.abs() < 1e-5 && w.abs() > 1e-4, "{}: {v} {w}", q.name()),
                QuantityKind::Refocus => assert!(v.abs() < 1e-5, "{v}"),
                _ => assert!((v - w).abs() < 1e-4 * (0.1 + w.abs()), "{}: {v} {w}", q.name()),
            }
        }
    }

    #[test]
    fn wrong_compensators_are_told_what_is_wrong() {
        let lens = embedded("double-gauss-50mm").unwrap();
        for (text, parts) in [
            ("gap = [{ surface = 5, by = 6 }]", vec!["s.toml:2", "surface 5", "by 6 mm", "5.705 mm", "expected less"]),
            ("\ngap = [{ surface = 12, by = 0.1 }]", vec!["s.toml:3", "surface 12", "expected 1 to 11"]),
            ("gap = [{ surface = 11, by = 0.1 }]", vec!["s.toml:2", "the last", "refocus"]),
            ("gap = [{ surface = 5, by = \"1 arcmin\" }]", vec!["s.toml:2", "1 arcmin", "expected a length"]),
            ("decenter = [{ element = [9, 7], by = 0.1 }]", vec!["s.toml:2", "[9, 7]", "expected first and last of 1 to 11"]),
            ("decenter = [{ element = [7, 9], by = 0 }]", vec!["s.toml:2", "by 0", "how far"]),
            (
                "tilt = [{ element = [7, 9], by = 0.1 }, { element = [7, 9], by = 0.2, axis = \"x\" }]",
                vec!["s.toml:2", "a second time"],
            ),
            ("tilt = [{ element = [7, 9], by = 0.1, axis = \"z\" }]", vec!["s.toml:2", "`z`", "expected `x` or `y`"]),
            ("gaps = [{ surface = 5, by = 0.1 }]", vec!["s.toml:2", "gaps", "expected"]),
        ] {
            let message = match ToleranceSheet::parse(&format!("[compensator]\n{text}\n[[tolerance]]\nradius = 0.1"), "s.toml") {
                Err(e) => e.to_string(),
                Ok(sheet) => Toleranced::new(&lens, &sheet).err().map(|e| e.to_string()).unwrap_or_default(),
            };
            assert!(parts.iter().all(|p| message.contains(p)), "{text}\n{message}");
        }
        let change = Change::Gap { surface: 4 };
        assert_eq!((change.name().as_str(), change.unit()), ("gap after surface 5", "mm"));
    }
}
