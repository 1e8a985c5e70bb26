//! Glasses chosen from catalogues: exchanges, one at a time, each followed by a few steps of damped least squares.
//!
//! A glass is no number that could have a derivative. Around the glass of each element its neighbours in the (nd, Vd) map are put in its place, the
//! lens is optimised for a few steps with each of them, and the best exchange of all is kept, until none makes the merit smaller: first among few
//! neighbours, then among more (steepest descent by exchanges; Smith, "Modern Lens Design", ch. 2, on substituting real glasses). A glass that no
//! catalogue knows, or that the choice does not hold, is replaced by the nearest first.

use super::Optimisation;
use super::levenberg::{Found, levenberg_marquardt};
use crate::glass::{D_NM, Glass, catalogue_glasses};
use rayon::prelude::*;

/// Neighbours that are tried, first and where none of them helped.
const NEIGHBOURS: [usize; 2] = [12, 40];
/// Steps of damped least squares with each.
const TRIAL_STEPS: usize = 15;
/// What an exchange must gain of the merit.
const LEAST_GAIN: f64 = 1e-3;
/// Most exchanges that are kept.
const MOST_EXCHANGES: usize = 40;
/// Differences of nd and Vd that count alike.
const SCALE: [f64; 2] = [0.1, 10.0];
/// Glasses nearer than this are one.
const SAME: f64 = 1e-3;

/// Glasses that may stand behind a surface.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct GlassChoice {
    /// The surface before it, 0 the first.
    pub surface: usize,
    candidates: Vec<Glass>,
}

/// How far two glasses are from one another.
fn distance(a: &Glass, b: &Glass) -> f64 {
    let v = |g: &Glass| g.abbe().min(1e3);
    f64::hypot((a.index(D_NM) - b.index(D_NM)) / SCALE[0], (v(a) - v(b)) / SCALE[1])
}

impl GlassChoice {
    /// A choice among the glasses of vendors and single glasses by their names; those without an index at one of the wavelengths (nm) are left out. Fails on names that are neither.
    pub fn new(surface: usize, names: &[String], wavelengths_nm: &[f64]) -> Result<GlassChoice, String> {
        let mut candidates: Vec<Glass> = vec![];
        for name in names {
            let found = match catalogue_glasses(name) {
                Some(vendor) => vendor,
                None => vec![Glass::parse(name).map_err(|e| format!("from: {e}, or of a vendor"))?],
            };
            let single = found.len() == 1;
            for glass in found {
                let known = wavelengths_nm.iter().all(|nm| glass.extrapolated(*nm).is_none());
                let usual = (1.3..2.5).contains(&glass.index(D_NM)) && glass.abbe() > 5.0 && glass.abbe() < 200.0;
                if single && !(known && usual) {
                    return Err(format!("from: {name}: expected a glass that is known at {wavelengths_nm:?} nm"));
                }
                // Variants of one glass differ in what they let through.
                if known && usual && candidates.iter().all(|c| distance(c, &glass) > SAME) {
                    candidates.push(glass);
                }
            }
        }
        if candidates.is_empty() {
            return Err(format!("from: no glass of {} is known at {wavelengths_nm:?} nm", names.join(", ")));
        }
        Ok(GlassChoice { surface, candidates })
    }

    /// Candidates from the nearest to a glass outwards, without itself.
    fn around(&self, glass: &Glass) -> Vec<&Glass> {
        let mut all: Vec<(f64, &Glass)> =
            self.candidates.iter().filter(|c| c.written() != glass.written()).map(|c| (distance(c, glass), c)).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        all.into_iter().map(|c| c.1).collect()
    }
}

impl Optimisation {
    /// The same with values of the variables, and one glass exchanged.
    fn with_glass(&self, x: &[f64], surface: usize, glass: &Glass) -> Optimisation {
        let mut start = self.lens_at(x);
        start.surfaces[surface].glass = glass.clone();
        Optimisation { start, ..self.clone() }
    }
}

/// Exchanges glasses while that makes the merit smaller; with the lens found, where the search ended there, and how many exchanges were tried. Without
/// choices the lens as it is.
pub(super) fn choose(from: &Optimisation, found: Found, iterations: usize) -> (Optimisation, Found, usize) {
    let (mut best, mut found, mut tried) = (from.clone(), found, 0);
    if from.choices.is_empty() {
        return (best, found, tried);
    }
    for choice in &from.choices {
        let now = best.start.surfaces[choice.surface].glass.clone();
        if choice.candidates.iter().any(|c| c.written() == now.written()) {
            continue;
        }
        // The nearest with which light still comes through.
        for glass in choice.around(&now) {
            let trial = best.with_glass(&found.x, choice.surface, glass);
            tried += 1;
            if let Some(there) = levenberg_marquardt(&trial, &found.x, iterations) {
                (best, found) = (trial, Found { iterations: found.iterations + there.iterations, ..there });
                break;
            }
        }
    }
    let mut ring = 0;
    for _ in 0..MOST_EXCHANGES {
        let exchanges: Vec<(usize, &Glass)> = from
            .choices
            .iter()
            .flat_map(|c| {
                let around = c.around(&best.start.surfaces[c.surface].glass);
                let from = if ring == 0 { 0 } else { NEIGHBOURS[ring - 1] };
                around.into_iter().take(NEIGHBOURS[ring]).skip(from).map(|g| (c.surface, g))
            })
            .collect();
        tried += exchanges.len();
        let merits: Vec<Option<Found>> = exchanges
            .par_iter()
            .map(|(surface, glass)| levenberg_marquardt(&best.with_glass(&found.x, *surface, glass), &found.x, TRIAL_STEPS))
            .collect();
        let better =
            exchanges.iter().zip(merits).filter_map(|(e, m)| Some((e, m?))).min_by(|a, b| a.1.merit.total_cmp(&b.1.merit));
        match better.filter(|(_, m)| m.merit < (1.0 - LEAST_GAIN) * found.merit) {
            Some(((surface, glass), there)) => {
                best = best.with_glass(&found.x, *surface, glass);
                found = Found { iterations: found.iterations + there.iterations, ..there };
                ring = 0;
            }
            None if ring + 1 < NEIGHBOURS.len() => ring += 1,
            None => break,
        }
    }
    let before = found.iterations;
    match levenberg_marquardt(&best, &found.x, iterations) {
        Some(end) => (best, Found { iterations: before + end.iterations, ..end }, tried),
        None => (best, found, tried),
    }
}

#[cfg(test)]
mod tests {
    use super::super::MeritSheet;
    use super::*;
    use crate::embedded;

    const SHEET: &str = "aperture = 4\nfields_deg = [0, 14]\nwavelengths_nm = [486.1, 587.6, 656.3]\n\
        [[variable]]\nsurfaces = \"all\"\nwhat = \"curvature\"\n[[operand]]\nkind = \"spot\"\n\
        [[operand]]\nkind = \"efl\"\ntarget = 50\nweight = 1000\n[[operand]]\nkind = \"edge\"\nat_least = 0.5\nweight = 1e4\n";

    #[test]
    fn a_triplet_of_wrong_glass_finds_crown_and_flint() {
        let mut lens = embedded("triplet-50mm-f4").unwrap();
        let glassy: Vec<usize> = (0..lens.surfaces.len()).filter(|i| lens.surfaces[*i].glass != Glass::air()).collect();
        // A flint where crowns belong, so that nothing corrects the colour.
        for i in &glassy {
            lens.surfaces[*i].glass = Glass::parse("F2").unwrap();
        }
        let sheet = |glass: &str| MeritSheet::parse(&format!("{SHEET}{glass}"), "merit.toml").unwrap();
        let fixed = Optimisation::new(&lens, &sheet("")).unwrap().run(0, 60).unwrap();
        assert!(fixed.glasses.is_empty() && fixed.exchanges == 0);
        let choice = "[[variable]]\nsurfaces = \"all\"\nwhat = \"glass\"\nfrom = [\"N-BK7\", \"N-SK16\", \"N-LAK9\", \"F2\", \"SF2\", \"N-F2\"]\n";
        let chosen = Optimisation::new(&lens, &sheet(choice)).unwrap().run(0, 60).unwrap();
        println!("{:?}: {} to {} after {} exchanges", chosen.glasses, fixed.merits[1], chosen.merits[1], chosen.exchanges);
        assert!(chosen.merits[1] < 0.3 * fixed.merits[1], "{:?} {:?}", fixed.merits, chosen.merits);
        let abbe = |i: usize| chosen.lens.surfaces[glassy[i]].glass.abbe();
        assert!(abbe(0) > abbe(1) && abbe(2) > abbe(1), "{:?}", chosen.glasses);
        assert!(chosen.glasses.iter().all(|(_, before, after)| before == "schott/F2" && after.starts_with("schott/")));
    }

    #[test]
    fn a_model_glass_becomes_a_real_one() {
        let mut lens = embedded("triplet-50mm-f4").unwrap();
        lens.surfaces[0].glass = Glass::parse("1.6204/60.3").unwrap();
        let text = format!("{SHEET}[[variable]]\nsurfaces = 1\nwhat = \"glass\"\nfrom = [\"N-SK16\"]\n");
        let report = Optimisation::new(&lens, &MeritSheet::parse(&text, "merit.toml").unwrap()).unwrap().run(0, 30).unwrap();
        assert_eq!(report.glasses, [(0, "1.6204/60.3".to_owned(), "schott/N-SK16".to_owned())]);
    }

    #[test]
    fn wrong_choices_are_told_what_is_wrong() {
        let lens = embedded("triplet-50mm-f4").unwrap();
        for (text, part) in [
            ("surfaces = 1\nwhat = \"glass\"\nfrom = \"shott\"", "unknown glass \"shott\""),
            ("surfaces = 2\nwhat = \"glass\"", "expected a surface before glass"),
            ("surfaces = 1\nwhat = \"glass\"\nmin = 1", "expected \"from\""),
            ("surfaces = 1\nwhat = \"gap\"\nfrom = \"schott\"", "it goes with what = \"glass\""),
            ("surfaces = 1\nwhat = \"glass\"\n[[variable]]\nsurfaces = 1\nwhat = \"index\"", "a variable already"),
        ] {
            let sheet = MeritSheet::parse(&format!("{SHEET}[[variable]]\n{text}\n"), "merit.toml").unwrap();
            let message = Optimisation::new(&lens, &sheet).err().map(|e| e.to_string()).unwrap_or_default();
            assert!(message.contains("merit.toml:") && message.contains(part), "{text}: {message}");
        }
    }
}
