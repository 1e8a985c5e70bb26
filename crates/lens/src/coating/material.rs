//! What films are made of: complex indices over wavelength.

use super::complex::Complex;
use crate::glass::Glass;
use diopter_light::names::nearest;
use std::sync::OnceLock;

const TABLE: &str = include_str!("data/materials.csv");
/// First wavelength of the table and its step, nm.
const FIRST_NM: f64 = 350.0;
const STEP_NM: f64 = 10.0;

/// A material of a film.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Material {
    /// One of the table's: number of its column.
    Film(usize),
    /// The same index at every wavelength.
    Index {
        /// Real part.
        n: f64,
        /// Extinction coefficient.
        k: f64,
    },
    /// A transparent material of the glass catalogue.
    Glass(Glass),
    /// Two of the table's materials evaporated together: indices by volume (as Merck's "Substance M", Al₂O₃ with other oxides, is made).
    Mixture {
        /// Columns of the table.
        of: [usize; 2],
        /// Volume fraction of the second.
        second: f64,
    },
}

struct Table {
    names: Vec<&'static str>,
    /// `[material][wavelength]`
    indices: Vec<Vec<Complex>>,
}

fn table() -> &'static Table {
    static PARSED: OnceLock<Table> = OnceLock::new();
    PARSED.get_or_init(|| {
        let mut rows = TABLE.lines().filter(|l| !l.starts_with('#'));
        let names: Vec<&str> =
            rows.next().unwrap_or("").split(',').skip(1).step_by(2).map(|c| c.trim_end_matches(" n")).collect();
        let mut indices = vec![vec![]; names.len()];
        for row in rows {
            // A test reads every figure.
            let figures: Vec<f64> = row.split(',').skip(1).map(|v| v.parse().unwrap_or(f64::NAN)).collect();
            for (material, nk) in indices.iter_mut().zip(figures.chunks_exact(2)) {
                material.push(Complex::new(nk[0], nk[1]));
            }
        }
        Table { names, indices }
    })
}

/// Names of the film materials that have tables.
pub fn film_names() -> impl Iterator<Item = &'static str> {
    table().names.iter().copied()
}

/// Number of a film material, which is known to be in the table.
pub(super) fn film(name: &str) -> usize {
    table().names.iter().position(|n| *n == name).unwrap_or(0)
}

/// Index of the metal of mirrors.
pub(super) fn aluminium(nm: f64) -> Complex {
    tabulated(film("Al"), nm)
}

fn tabulated(material: usize, nm: f64) -> Complex {
    let column = &table().indices[material];
    let at = ((nm - FIRST_NM) / STEP_NM).clamp(0.0, (column.len() - 1) as f64);
    let i = (at as usize).min(column.len() - 2);
    let f = at - i as f64;
    column[i] * (1.0 - f) + column[i + 1] * f
}

impl Material {
    /// A film material by name (`MgF2`, `Ta2O5`, `Ag` ...), or a transparent one of the glass catalogue. Fails with what is known.
    pub fn parse(name: &str) -> Result<Material, String> {
        let name = name.trim();
        if let Some(i) = table().names.iter().position(|n| n.eq_ignore_ascii_case(name)) {
            return Ok(Material::Film(i));
        }
        match Glass::parse(name) {
            Ok(glass) if !name.is_empty() => Ok(Material::Glass(glass)),
            _ => {
                let known: Vec<&str> = film_names().collect();
                let hint = nearest(name, known.iter().copied()).map_or(String::new(), |n| format!(" (did you mean \"{n}\"?)"));
                Err(format!(
                    "unknown film material \"{name}\"{hint}: expected one of {}, a glass, or figures n and k",
                    known.join(", ")
                ))
            }
        }
    }

    /// n + ik at a vacuum wavelength in nm. Tables reach from 350 to 1000 nm; beyond, their ends hold.
    pub fn index(&self, nm: f64) -> Complex {
        match self {
            Material::Film(i) => tabulated(*i, nm),
            Material::Index { n, k } => Complex::new(*n, *k),
            Material::Glass(glass) => glass.index(nm).into(),
            Material::Mixture { of, second } => tabulated(of[0], nm) * (1.0 - second) + tabulated(of[1], nm) * *second,
        }
    }

    /// As reports print it.
    pub fn describe(&self) -> String {
        match self {
            Material::Film(i) => table().names[*i].into(),
            Material::Index { n, k } if *k == 0.0 => format!("n = {n}"),
            Material::Index { n, k } => format!("n = {n}, k = {k}"),
            Material::Glass(glass) => glass.written(),
            Material::Mixture { of, second } => {
                let [a, b] = of.map(|i| table().names[i]);
                format!("{a} with {:.0} % {b}", 100.0 * second)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_whole_and_unchanged() {
        let table = table();
        assert_eq!(table.names.len(), 12);
        for (name, column) in table.names.iter().zip(&table.indices) {
            assert_eq!(column.len(), 66, "{name}");
            assert!(column.iter().all(|n| n.re > 0.0 && n.im >= 0.0), "{name}");
        }
        // FNV-1a, 64 bits, over the bytes of the file.
        let sum = TABLE.bytes().fold(0xcbf2_9ce4_8422_2325u64, |h, b| (h ^ b as u64).wrapping_mul(0x100_0000_01b3));
        assert_eq!(sum, 0x6cb8_3e02_1bc1_1513, "{sum:#x}");
    }

    #[test]
    fn materials_have_the_indices_that_handbooks_print() {
        // Malitson 1965 at the d line: 1.45846; Johnson & Christy 1972 for silver at 548.6 nm: 0.06 + 3.586 i; Rakić 1995 for
        // aluminium at 550 nm: a reflectance of 91.6 %, the table that mirrors have.
        let index = |name: &str, nm: f64| Material::parse(name).unwrap().index(nm);
        assert!((index("SiO2", 587.56).re - 1.45846).abs() < 2e-5);
        let silver = index("ag", 548.6);
        assert!((silver.re - 0.06).abs() < 0.005 && (silver.im - 3.586).abs() < 0.02, "{silver:?}");
        let aluminium = super::super::response(1.0, std::iter::empty(), index("Al", 550.0), 1.0, 550.0);
        let known = crate::coating::film::aluminium(550.0);
        assert!((aluminium.reflectance[0] - known).abs() < 1e-3, "{} {known}", aluminium.reflectance[0]);
        // Between the points of the table linear; a glass by its formula.
        let (a, b, between) = (index("TiO2", 500.0), index("TiO2", 510.0), index("TiO2", 503.0));
        assert!((between.re - (0.7 * a.re + 0.3 * b.re)).abs() < 1e-12);
        assert!((index("N-BK7", 587.5618).re - 1.5168).abs() < 1e-5);
        let wrong = Material::parse("MgF3").unwrap_err();
        assert!(wrong.contains("did you mean \"MgF2\"?") && wrong.contains("Ta2O5"), "{wrong}");
    }
}
