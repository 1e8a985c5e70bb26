//! Glass: index and absorption over wavelength, by catalogue name, by nd and Vd, or constant.
//!
//! Wavelengths in nm; indices relative to air at 20 °C and 1 atm, as vendors print them and as lenses stand. A name that is
//! not in the catalogue is an error with near names; nothing is ever guessed. A pair nd/Vd is turned into a curve through nd
//! and nF − nC with the partial dispersion P_gF = 0.6438 − 0.001682 Vd of the normal glasses (Schott TIE-29), which reports
//! call a model glass.

mod alias;
mod catalogue;
mod dispersion;

pub(crate) use alias::parse_foreign;
pub use catalogue::{catalogue_glasses, entry_names, find};

use diopter_light::names::nearest;

/// Helium d line, nm.
pub const D_NM: f64 = 587.5618;
/// Hydrogen F line, nm.
pub const F_NM: f64 = 486.1327;
/// Hydrogen C line, nm.
pub const C_NM: f64 = 656.2725;
/// Mercury g line, nm.
pub const G_NM: f64 = 435.8343;
/// Mercury e line, nm.
pub const E_NM: f64 = 546.0740;

/// Wavelengths the program traces, nm: a glass must have a finite index over all of them.
pub const VISIBLE_NM: [f64; 2] = [380.0, 780.0];

/// Indices that are believed where nobody measured them.
const LIKELY: std::ops::RangeInclusive<f64> = 1.0..=4.5;

/// What fills the space between two surfaces.
#[derive(Clone, Debug, PartialEq)]
pub struct Glass {
    /// As it is written in a prescription.
    pub name: String,
    /// Where index and absorption come from.
    pub kind: GlassKind,
    /// Absorption coefficient in 1/mm at wavelengths in nm, ascending; empty where nobody measured it.
    absorption: Vec<(f64, f64)>,
}

/// Where an index comes from.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum GlassKind {
    /// Index 1.
    Air,
    /// The same index at every wavelength: figures from a source that gives no dispersion.
    Constant(f64),
    /// A curve through published figures: nd and Vd, perhaps indices at C, F and g.
    Model {
        /// Index at 587.56 nm.
        nd: f64,
        /// Abbe number (nd − 1)/(nF − nC).
        vd: f64,
        /// n = a + b/λ² + c/λ⁴ + d λ², λ in µm.
        cauchy: [f64; 4],
    },
    /// A catalogue's dispersion formula.
    Catalogue {
        /// Vendor, lower case; "material" and "plastic" for what has none.
        vendor: String,
        /// 1 to 9.
        formula: u8,
        /// As published, µm.
        coefficients: Vec<f64>,
        /// Range of the formula, nm.
        range_nm: [f64; 2],
    },
}

/// Why a glass cannot be had.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GlassError {
    /// No catalogue has it.
    #[error("unknown glass \"{name}\"{hint}")]
    Unknown {
        /// As written.
        name: String,
        /// "; did you mean ...?"
        hint: String,
    },
    /// The name is in a catalogue that prints no dispersion for it.
    #[error("glass \"{0}\": the catalogue knows the name but no dispersion figures; write nd/Vd instead, such as 1.5168/64.17")]
    NoFigures(String),
    /// Figures that cannot be a glass.
    #[error("glass \"{name}\": {what}")]
    Range {
        /// As written.
        name: String,
        /// What is wrong.
        what: String,
    },
}

impl Glass {
    /// Index 1, no absorption.
    pub fn air() -> Self {
        Glass { name: "air".into(), kind: GlassKind::Air, absorption: vec![] }
    }

    /// One index for all wavelengths. Fails outside 1 to 4.5.
    pub fn constant(n: f64) -> Result<Self, GlassError> {
        let name = format!("{n}");
        check_index(&name, n)?;
        Ok(Glass { name, kind: GlassKind::Constant(n), absorption: vec![] })
    }

    /// Through nd and Vd along the normal line, moved off it by `d_pgf`. Fails on an index outside 1 to 4.5, a Vd outside 10 to
    /// 150 and a `d_pgf` beyond ±0.2.
    pub fn model(nd: f64, vd: f64, d_pgf: f64) -> Result<Self, GlassError> {
        let name = if d_pgf == 0.0 { format!("{nd}/{vd}") } else { format!("{nd}/{vd}/{d_pgf}") };
        check_index(&name, nd)?;
        if !(10.0..=150.0).contains(&vd) || d_pgf.abs() > 0.2 || !d_pgf.is_finite() {
            let what = format!("an Abbe number of {vd} (off the normal line by {d_pgf}): expected 10 to 150 (within 0.2)");
            return Err(GlassError::Range { name, what });
        }
        let principal = (nd - 1.0) / vd;
        let n_g_minus_f = (0.6438 - 0.001682 * vd + d_pgf) * principal;
        // Three conditions for a + b/λ² + c/λ⁴.
        let x = |nm: f64| (nm * 1e-3).powi(-2);
        let ([xd, xf, xc, xg], sq) = ([D_NM, F_NM, C_NM, G_NM].map(x), |v: f64| v * v);
        let (a11, a12, a21, a22) = (xf - xc, sq(xf) - sq(xc), xg - xf, sq(xg) - sq(xf));
        let det = a11 * a22 - a12 * a21;
        let b = (principal * a22 - a12 * n_g_minus_f) / det;
        let c = (a11 * n_g_minus_f - a21 * principal) / det;
        let cauchy = [nd - b * xd - c * sq(xd), b, c, 0.0];
        Ok(Glass { name, kind: GlassKind::Model { nd, vd, cauchy }, absorption: vec![] })
    }

    /// Through four published indices at d, C, F and g. Fails on an index outside 1 to 4.5, and unless nC ≤ nd ≤ nF ≤ ng.
    pub fn measured(nd: f64, n_c: f64, n_f: f64, n_g: f64) -> Result<Self, GlassError> {
        let name = format!("d {nd} C {n_c} F {n_f} g {n_g}");
        for n in [nd, n_c, n_f, n_g] {
            check_index(&name, n)?;
        }
        if !(n_c <= nd && nd <= n_f && n_f <= n_g) {
            return Err(GlassError::Range {
                name,
                what: "indices must not fall towards short wavelengths: nC ≤ nd ≤ nF ≤ ng".into(),
            });
        }
        let row = |nm: f64, n: f64| {
            let l2 = (nm * 1e-3).powi(2);
            [1.0, 1.0 / l2, 1.0 / (l2 * l2), l2, n]
        };
        let cauchy = solve4([row(D_NM, nd), row(C_NM, n_c), row(F_NM, n_f), row(G_NM, n_g)]);
        let vd = (nd - 1.0) / (n_f - n_c);
        Ok(Glass { name, kind: GlassKind::Model { nd, vd, cauchy }, absorption: vec![] })
    }

    /// Through any published indices: pairs (nm, n). A Cauchy polynomial of as many terms as pairs, at most four: of more pairs
    /// those nearest to g, F, d and C are taken. Fails without a pair, on wavelengths outside 200 to 3000 nm or less than 1 nm
    /// apart, and on an index outside 1 to 4.5, at the d line too.
    pub fn through(name: &str, pairs: &[(f64, f64)]) -> Result<Self, GlassError> {
        let wrong = |what: String| GlassError::Range { name: name.into(), what };
        for (nm, n) in pairs {
            check_index(name, *n)?;
            if !(200.0..=3000.0).contains(nm) {
                return Err(wrong(format!("a wavelength of {nm} nm: expected 200 to 3000")));
            }
        }
        let mut pairs = pairs.to_vec();
        if pairs.len() > 4 {
            let all = std::mem::take(&mut pairs);
            for line in [G_NM, F_NM, D_NM, C_NM] {
                let left = all.iter().filter(|p| !pairs.contains(p));
                pairs.extend(left.min_by(|a, b| (a.0 - line).abs().total_cmp(&(b.0 - line).abs())).copied());
            }
        }
        let pairs = &pairs[..];
        if pairs.is_empty() || (0..pairs.len()).any(|i| pairs[..i].iter().any(|p| (p.0 - pairs[i].0).abs() < 1.0)) {
            return Err(wrong("indices at different wavelengths are needed".into()));
        }
        // Terms that there is no pair for are pinned to zero.
        let row = |i: usize| match pairs.get(i) {
            Some((nm, n)) => {
                let l2 = nm * nm * 1e-6;
                [1.0, 1.0 / l2, 1.0 / (l2 * l2), l2, *n]
            }
            None => std::array::from_fn(|k| (k == i) as u32 as f64),
        };
        let cauchy = solve4([row(0), row(1), row(2), row(3)]);
        let mut glass = Glass { name: name.into(), kind: GlassKind::Model { nd: 0.0, vd: 0.0, cauchy }, absorption: vec![] };
        let (nd, vd) = (glass.index(D_NM), glass.abbe());
        check_index(name, nd)?;
        glass.kind = GlassKind::Model { nd, vd, cauchy };
        // Written by four lines, which carry the curve.
        glass.name = format!("d {nd} C {} F {} g {}", glass.index(C_NM), glass.index(F_NM), glass.index(G_NM));
        Ok(glass)
    }

    /// A glass as a prescription writes it: `air`, a catalogue name with or without its vendor (`N-BK7`, `schott/N-BK7`,
    /// `NBK7_SCHOTT`), `nd/Vd`, `nd/Vd/ΔPgF`, `d .. C .. F .. g ..`, or one constant index. Fails on a name that is not in the
    /// catalogue, and on figures that no glass has.
    pub fn parse(text: &str) -> Result<Self, GlassError> {
        Self::parse_preferring(text, &[])
    }

    /// The same; where several vendors have the name the first of `vendors` that does wins. Fails as [`Glass::parse`].
    pub fn parse_preferring(text: &str, vendors: &[&str]) -> Result<Self, GlassError> {
        let name = text.trim();
        if name.is_empty() || name.eq_ignore_ascii_case("air") {
            return Ok(Self::air());
        }
        if let Ok(n) = name.parse::<f64>() {
            return Self::constant(n);
        }
        let numbers: Option<Vec<f64>> = name.split('/').map(|p| p.trim().parse().ok()).collect();
        match numbers.as_deref() {
            Some([nd, vd]) => return Self::model(*nd, *vd, 0.0),
            Some([nd, vd, d]) => return Self::model(*nd, *vd, *d),
            _ => {}
        }
        let words: Vec<&str> = name.split_whitespace().collect();
        if let ["d", d, "C", c, "F", f, "g", g] = words[..] {
            let read = |t: &str| t.parse::<f64>().unwrap_or(f64::NAN);
            return Self::measured(read(d), read(c), read(f), read(g));
        }
        find(name, vendors)
    }

    /// Index at a wavelength, relative to air; NaN where there is none: a formula has no real value there, or beyond its printed range one outside 1 to 4.5 or beyond a
    /// resonance, where glasses are opaque.
    pub fn index(&self, nm: f64) -> f64 {
        match &self.kind {
            GlassKind::Air => 1.0,
            GlassKind::Constant(n) => *n,
            GlassKind::Model { cauchy: [a, b, c, d], .. } => {
                let l2 = nm * nm * 1e-6;
                a + b / l2 + c / (l2 * l2) + d * l2
            }
            GlassKind::Catalogue { formula, coefficients, range_nm: [short, long], .. } => {
                let n = dispersion::index(*formula, coefficients, nm * 1e-3);
                let is_likely =
                    || LIKELY.contains(&n) && !dispersion::is_beyond_resonance(*formula, coefficients, nm * 1e-3, short * 1e-3);
                if (*short..=*long).contains(&nm) || is_likely() { n } else { f64::NAN }
            }
        }
    }

    /// Wavelengths over which the index is known, nm: the printed range of a formula; [`VISIBLE_NM`] of a curve through nd and Vd,
    /// which says nothing about the infrared. `None` where nothing limits it (air, a constant index).
    pub fn range_nm(&self) -> Option<[f64; 2]> {
        match &self.kind {
            GlassKind::Air | GlassKind::Constant(_) => None,
            GlassKind::Model { .. } => Some(VISIBLE_NM),
            GlassKind::Catalogue { range_nm, .. } => Some(*range_nm),
        }
    }

    /// A sentence where the index at a wavelength lies beyond [`Glass::range_nm`] and is extrapolated.
    pub fn extrapolated(&self, nm: f64) -> Option<String> {
        let [short, long] = self.range_nm()?;
        // Ranges are printed to a few nm.
        if nm >= short - 2.0 && nm <= long + 2.0 {
            return None;
        }
        let known = match &self.kind {
            GlassKind::Model { .. } => "a curve through nd and Vd",
            _ => "its dispersion formula",
        };
        let found = match self.index(nm) {
            n if n.is_finite() && n > 0.0 => format!("the index {n:.4} at {nm} nm is extrapolated"),
            _ => format!("there is no index at {nm} nm"),
        };
        Some(format!("glass {}: {found}: {known} holds from {short:.0} to {long:.0} nm", self.written()))
    }

    /// Abbe number (nd − 1)/(nF − nC); infinite without dispersion.
    pub fn abbe(&self) -> f64 {
        (self.index(D_NM) - 1.0) / (self.index(F_NM) - self.index(C_NM))
    }

    /// Absorption coefficient at a wavelength, 1/mm (natural logarithm); 0 where it is not known.
    pub fn absorption(&self, nm: f64) -> f64 {
        let table = &self.absorption;
        let i = table.partition_point(|p| p.0 <= nm);
        match (i.checked_sub(1).map(|j| table[j]), table.get(i)) {
            (Some((x0, y0)), Some(&(x1, y1))) => y0 + (y1 - y0) * (nm - x0) / (x1 - x0),
            (Some((_, y)), None) | (None, Some(&(_, y))) => y,
            (None, None) => 0.0,
        }
    }

    /// Whether the absorption was measured.
    pub fn knows_absorption(&self) -> bool {
        !self.absorption.is_empty()
    }

    /// The same with another absorption: pairs (nm, 1/mm), ascending.
    pub fn with_absorption(mut self, table: Vec<(f64, f64)>) -> Self {
        self.absorption = table;
        self
    }

    /// As a prescription writes it.
    pub fn written(&self) -> String {
        match &self.kind {
            GlassKind::Catalogue { vendor, .. } => format!("{vendor}/{}", self.name),
            _ => self.name.clone(),
        }
    }

    /// An absorption that the prescription itself gives (one value for all wavelengths), 1/mm.
    pub fn own_absorption(&self) -> Option<f64> {
        match self.absorption[..] {
            [(_, alpha)] => Some(alpha),
            _ => None,
        }
    }

    /// One line for reports: what this glass is and how much is known about it.
    pub fn describe(&self) -> String {
        match &self.kind {
            GlassKind::Air => "air".into(),
            GlassKind::Constant(n) => format!("constant index {n}: no dispersion given"),
            GlassKind::Model { nd, vd, .. } => format!("model glass through nd {nd}, Vd {vd:.2}"),
            GlassKind::Catalogue { vendor, .. } => {
                format!("{vendor} {}: nd {:.5}, Vd {:.2}", self.name, self.index(D_NM), self.abbe())
            }
        }
    }
}

fn check_index(name: &str, n: f64) -> Result<(), GlassError> {
    match LIKELY.contains(&n) {
        true => Ok(()),
        false => Err(GlassError::Range { name: name.into(), what: format!("an index of {n}: expected 1 to 4.5") }),
    }
}

/// Solves four linear equations, right side in the last column.
fn solve4(mut m: [[f64; 5]; 4]) -> [f64; 4] {
    for i in 0..4 {
        let pivot = (i..4).max_by(|a, b| m[*a][i].abs().total_cmp(&m[*b][i].abs())).unwrap_or(i);
        m.swap(i, pivot);
        for r in 0..4 {
            if r != i {
                let f = m[r][i] / m[i][i];
                for k in i..5 {
                    m[r][k] -= f * m[i][k];
                }
            }
        }
    }
    std::array::from_fn(|i| m[i][4] / m[i][i])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn catalogue_glasses_have_their_listed_indices() {
        // Schott's sheets: nd, Vd.
        for (name, nd, vd) in
            [("N-BK7", 1.51680, 64.17), ("N-SF5", 1.67271, 32.25), ("SF6", 1.80518, 25.43), ("F2", 1.62004, 36.37)]
        {
            let g = Glass::parse(name).unwrap();
            assert!((g.index(D_NM) - nd).abs() < 6e-6 && (g.abbe() - vd).abs() < 6e-3, "{name} {} {}", g.index(D_NM), g.abbe());
        }
        // TRUTHS: the CODE V listing's indices at its own wavelengths.
        for (name, n) in [
            ("NSSK2_SCHOTT", [1.618769, 1.622292, 1.630455]),
            ("NSK2_SCHOTT", [1.604134, 1.607379, 1.614860]),
            ("F5_SCHOTT", [1.598744, 1.603417, 1.614617]),
            ("NSK16_SCHOTT", [1.617271, 1.620408, 1.627559]),
        ] {
            let g = Glass::parse(name).unwrap();
            for (nm, n) in [656.3, 587.6, 486.1].into_iter().zip(n) {
                assert!((g.index(nm) - n).abs() < 6e-7, "{name} {nm} {}", g.index(nm));
            }
        }
    }

    #[test]
    fn every_entry_is_finite_over_what_is_traced() {
        let mut known = 0;
        for name in entry_names() {
            match Glass::parse(&name) {
                Ok(g) => {
                    known += 1;
                    let visible = match &g.kind {
                        GlassKind::Catalogue { range_nm, .. } => range_nm[0] <= 450.0,
                        _ => true,
                    };
                    for i in 0..=40 {
                        let n = g.index(380.0 + 10.0 * i as f64);
                        assert!(!visible || (1.0..4.5).contains(&n), "{name}: {n}");
                        assert!(g.absorption(380.0 + 10.0 * i as f64) >= 0.0);
                    }
                }
                Err(GlassError::NoFigures(_)) => {}
                Err(e) => panic!("{name}: {e}"),
            }
        }
        assert!(known > 1670, "{known}");
    }

    #[test]
    fn a_model_glass_comes_near_the_real_one() {
        for name in ["N-BK7", "N-SF5", "N-LAK9", "F2", "N-SK16"] {
            let real = Glass::parse(name).unwrap();
            let model = Glass::parse(&format!("{:.6}/{:.3}", real.index(D_NM), real.abbe())).unwrap();
            for nm in [400.0, 450.0, 500.0, 550.0, 600.0, 650.0, 700.0] {
                assert!((real.index(nm) - model.index(nm)).abs() < 1e-3, "{name} {nm}: {} {}", real.index(nm), model.index(nm));
            }
            let (d, c, f, g) = (real.index(D_NM), real.index(C_NM), real.index(F_NM), real.index(G_NM));
            let measured = Glass::measured(d, c, f, g).unwrap();
            for nm in [400.0, 500.0, 700.0] {
                assert!((real.index(nm) - measured.index(nm)).abs() < 5e-4, "{name} {nm}");
            }
        }
    }

    #[test]
    fn an_index_beyond_what_is_known_says_so() {
        let model = Glass::parse("1.5168/64.17").unwrap();
        assert_eq!(model.extrapolated(587.6), None);
        let note = model.extrapolated(1550.0).unwrap();
        assert!(note.contains("1550 nm is extrapolated") && note.contains("380 to 780 nm"), "{note}");
        assert_eq!(Glass::parse("N-BK7").unwrap().extrapolated(1550.0), None);
        let note = Glass::parse("GERMANIUM").unwrap().extrapolated(587.6).unwrap();
        assert!(note.contains("2500 to 12000 nm"), "{note}");
        assert_eq!(Glass::constant(1.5).unwrap().extrapolated(10_000.0), None);
    }

    #[test]
    fn beside_a_resonance_there_is_no_index() {
        // Connolly's formula of ZnSe holds from 540 nm; its second resonance lies at 391.4 nm.
        let glass = Glass::parse("ZnSe").unwrap();
        assert!((glass.index(587.6) - 2.62).abs() < 0.02, "{}", glass.index(587.6));
        for nm in [380.0, 391.3, 391.5, 395.0] {
            assert!(glass.index(nm).is_nan(), "{nm}: {}", glass.index(nm));
            assert!(glass.extrapolated(nm).unwrap().contains("there is no index"));
        }
    }

    #[test]
    fn absorption_gives_the_vendors_transmittance() {
        // Schott's N-BK7 sheet: internal transmittance of 25 mm at 400 nm 0.992, at 380 nm 0.983 (rounded to 3 digits).
        let bk7 = Glass::parse("N-BK7").unwrap();
        for (nm, tau) in [(400.0, 0.992), (546.0, 0.996), (380.0, 0.983)] {
            let t = (-bk7.absorption(nm) * 25.0).exp();
            assert!((t - tau).abs() < 2.5e-3, "{nm}: {t}");
        }
    }

    #[test]
    fn names_are_found_however_they_are_written_and_never_guessed() {
        let bk7 = Glass::parse("N-BK7").unwrap().index(500.0);
        for name in ["NBK7_SCHOTT", "schott/N-BK7", "n-bk7", "SCHOTT:N-BK7", "N-BK7 (SCHOTT)"] {
            assert_eq!(Glass::parse(name).unwrap().index(500.0), bk7, "{name}");
        }
        let e = Glass::parse("N-BK77").unwrap_err().to_string();
        assert!(e.contains("unknown glass \"N-BK77\"") && e.contains("N-BK7"), "{e}");
        assert!(Glass::parse("ohara/N-BK7").is_err());
        assert!(matches!(Glass::parse("BF16"), Err(GlassError::NoFigures(_))));
        assert!(Glass::parse("0.9/50").is_err() && Glass::parse("1.5/NaN").is_err() && Glass::parse("7").is_err());
        assert!((Glass::parse("LAC9 (HOYA)").unwrap().index(D_NM) - 1.691).abs() < 1e-3);
    }
}
