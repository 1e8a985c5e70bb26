//! The CIE standard observer and illuminants, as spectra.

pub mod tables;

use crate::table::Table;
use crate::units::LUMINOUS_EFFICACY;
use glam::DVec3;
use std::sync::OnceLock;

/// The three colour-matching functions of the CIE 1931 2° observer, 360–830 nm at 1 nm.
pub struct Observer {
    /// x̄(λ)
    pub x: Table,
    /// ȳ(λ), also the photopic luminous efficiency function V(λ)
    pub y: Table,
    /// z̄(λ)
    pub z: Table,
}

/// The CIE 1931 2° standard observer.
pub fn observer() -> &'static Observer {
    static OBSERVER: OnceLock<Observer> = OnceLock::new();
    OBSERVER.get_or_init(|| {
        let (_, rows) = tables::read_csv(tables::CIE_1931_CSV);
        let column = |c: usize| Table::new(360.0, 1.0, rows.iter().map(|r| r[c] as f32).collect());
        Observer { x: column(1), y: column(2), z: column(3) }
    })
}

/// XYZ of a spectrum over wavelength (nm), ∫ f (x̄, ȳ, z̄) dλ over 360–830 nm in 1 nm steps, unscaled: for a radiance in W·m⁻²·sr⁻¹·nm⁻¹, Y times 683 lm/W is in cd/m².
/// Source: CIE 015:2018.
pub fn xyz_of(spectrum: impl Fn(f32) -> f32) -> DVec3 {
    let o = observer();
    (360..=830).fold(DVec3::ZERO, |sum, nm| {
        let nm = nm as f32;
        sum + DVec3::new(o.x.at(nm) as f64, o.y.at(nm) as f64, o.z.at(nm) as f64) * spectrum(nm) as f64
    })
}

/// Luminance in cd/m² of a spectral radiance in W·m⁻²·sr⁻¹·nm⁻¹ (or illuminance in lx of an irradiance).
pub fn luminance(spectrum: impl Fn(f32) -> f32) -> f64 {
    xyz_of(spectrum).y * LUMINOUS_EFFICACY
}

/// Names of the illuminants this program knows (CIE 015:2018).
pub fn illuminant_names() -> Vec<String> {
    tables::read_csv(tables::ILLUMINANTS_CSV).0
}

/// Relative spectral power of a CIE illuminant by name (`D65`, `A`, `FL2` ..., in either case), 380–780 nm at 5 nm, unscaled; `None` for an unknown name.
pub fn illuminant(name: &str) -> Option<Table> {
    let (names, rows) = tables::read_csv(tables::ILLUMINANTS_CSV);
    let column = names.iter().position(|n| n.eq_ignore_ascii_case(name))? + 1;
    Some(Table::new(380.0, 5.0, rows.iter().map(|r| r[column] as f32).collect()))
}

/// D65 scaled to a luminance of 1 cd/m², 380–780 nm at 5 nm (as radiance in W·m⁻²·sr⁻¹·nm⁻¹): the white of RGB lights.
pub fn d65_one_nit() -> &'static Table {
    static D65: OnceLock<Table> = OnceLock::new();
    D65.get_or_init(|| {
        let d65 = illuminant("D65").expect("D65 is in the table");
        d65.scaled((1.0 / luminance(|nm| d65.at(nm))) as f32)
    })
}

/// A ColorChecker patch: its name and reflectance.
pub struct Patch {
    /// Name as printed on the chart.
    pub name: String,
    /// Reflectance, 380–730 nm in 10 nm; constant beyond.
    pub reflectance: Table,
}

/// The 24 patches of the ColorChecker Classic, dark skin first, black last.
pub fn colorchecker() -> Vec<Patch> {
    let (names, rows) = tables::read_csv(tables::COLORCHECKER_CSV);
    (0..24)
        .map(|c| Patch {
            name: names[c].clone(),
            reflectance: Table::new(380.0, 10.0, rows.iter().map(|r| r[c + 1] as f32).collect()),
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// FNV-1a, 64 bit.
    fn checksum(text: &str) -> u64 {
        text.bytes().fold(0xcbf2_9ce4_8422_2325, |h, b| (h ^ b as u64).wrapping_mul(0x100_0000_01b3))
    }

    #[test]
    fn tables_are_the_ones_that_were_checked() {
        let sums = [tables::CIE_1931_CSV, tables::ILLUMINANTS_CSV, tables::COLORCHECKER_CSV].map(checksum);
        assert_eq!(sums, CHECKED, "a table changed: compare it with its source, then update the checksum");
    }
    const CHECKED: [u64; 3] = [4540714253315631146, 7784347631027981023, 14601788028405667921];

    #[test]
    fn observer_peaks_where_the_cie_says() {
        assert_eq!(observer().y.at(555.0), 1.0);
        // 547 nm: the value whose digits were swapped in pbrt-v4 for six years.
        assert_eq!(observer().y.at(547.0), 0.987_418_2);
        assert!((observer().x.at(600.0) - 1.0622).abs() < 1e-4);
    }
}
