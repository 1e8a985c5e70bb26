//! Names of glasses in the lens files of other programs that the catalogue has under another name.
//!
//! Only importers ask here, and every alias comes with a note for the reader: our own form still takes exact names only. Three
//! kinds: names with an entry in [`ALIASES`]; Schott's glasses of before about 1998, whose lead- and arsenic-free successors carry
//! the prefix N- and the same glass code (Schott, "Optical Glass" catalogue, chapter 1); moulded glasses (`_MOLD`), whose index
//! falls while they cool fast (Schott TIE-40).

use super::catalogue::{VENDORS, plain};
use super::{Glass, GlassError};

/// Name (letters and digits only), the glass it is taken for, and why.
const ALIASES: &[(&str, &str, &str)] = &[
    ("BK7", "schott/N-BK7", "Schott prints the same dispersion for both"),
    ("LASF9", "schott/N-LASF9", "the successor of the same glass code 850322"),
    ("LAKN22", "schott/N-LAK22", "the successor of the same glass code 651559"),
    // No glass of today has their place; nd and Vd of Schott's discontinued glasses, by glass codes 650392 and 618551.
    ("BASF10", "1.65016/39.15", "discontinued: a curve through Schott's nd and Vd"),
    ("SSK4", "1.61765/55.14", "discontinued: a curve through Schott's nd and Vd"),
    ("SSK4A", "1.61765/55.14", "discontinued: a curve through Schott's nd and Vd"),
    ("B270", "1.5229/58.5", "a curve through the nd and Vd of Schott's data sheet of B 270"),
    ("CAF2DAIMON20", "schott/LITHOTEC-CAF2", "calcium fluoride"),
    ("FSILICA", "material/SILICA", "fused silica, Malitson 1965"),
    ("FUSEDSILICA", "material/SILICA", "fused silica, Malitson 1965"),
    ("SIO2", "material/SILICA", "fused silica, Malitson 1965"),
    ("QUARTZGLASS", "material/SILICA", "fused silica, Malitson 1965"),
    ("CORNING7980", "material/C79-80", "Corning 7980"),
    ("SILICN", "material/SILICON", "CODE V's name"),
    ("GERMMN", "material/GERMANIUM", "CODE V's name"),
    ("GERMMW", "material/GERMANIUM", "CODE V's name"),
    ("GERMLW", "material/GERMANIUM", "CODE V's name"),
    ("SAPHIR", "material/SAPPHIRE", "CODE V's name"),
    ("ACRYLIC", "material/PMMA", "acrylic glass, Beadie et al. 2015"),
];

/// nd and Vd after precision moulding. Source: list of moulded glasses of Rochester Precision Optics (2009).
const MOULDED: &[(&str, f64, f64)] = &[
    ("BACD14", 1.59851, 60.23),
    ("BSM16C", 1.61481, 59.71),
    ("DK59", 1.51480, 63.10),
    ("DLAK6", 1.68944, 52.83),
    ("DLAK70", 1.66525, 55.14),
    ("DZLAF52A", 1.80120, 40.63),
    ("EFDS1", 1.91266, 20.65),
    ("FDS9", 1.84506, 23.78),
    ("HLAK54", 1.72850, 51.10),
    ("HZLAF50B", 1.79870, 46.27),
    ("HZLAF52", 1.80130, 40.70),
    ("HZLAF53", 1.82920, 36.95),
    ("HZLAF55", 1.83000, 42.73),
    ("HZLAF56", 1.80000, 33.02),
    ("KCSK120", 1.58330, 59.19),
    ("KVC79", 1.60515, 57.30),
    ("KVC89", 1.80460, 40.71),
    ("LLAM60", 1.73859, 48.99),
    ("LTIM28", 1.68403, 30.86),
    ("NBK7", 1.51259, 63.65),
    ("NFK5", 1.48439, 69.96),
    ("NFK51", 1.48466, 84.15),
    ("NLAF2", 1.73877, 44.54),
    ("NLAK22", 1.64672, 55.51),
    ("NSK5", 1.58393, 60.73),
    ("PSK57", 1.58406, 58.96),
    ("SF57", 1.84457, 23.75),
    ("SLAH60", 1.82727, 36.79),
    ("SLAL12", 1.67330, 54.97),
    ("SLAL13", 1.68890, 52.86),
    ("SLAL18", 1.72376, 54.27),
    ("SNPH1", 1.79789, 22.46),
    ("TAC4", 1.72900, 50.71),
    ("TAF1", 1.76700, 49.27),
    ("TAF3", 1.79980, 46.25),
    ("VC78", 1.66547, 55.12),
];

/// A glass by the name another program gives it, and a note where that is not the catalogue's name. Fails as
/// [`Glass::parse_preferring`] does where no alias is known either.
pub(crate) fn parse_foreign(name: &str, vendors: &[&str]) -> Result<(Glass, Option<String>), GlassError> {
    let unknown = match Glass::parse_preferring(name, vendors) {
        Err(e @ (GlassError::Unknown { .. } | GlassError::NoFigures(_))) => e,
        found => return found.map(|glass| (glass, None)),
    };
    let taken = |glass: Glass, why: &str| {
        let note = format!("glass \"{name}\" is taken for {}: {why}", glass.written());
        Ok((glass, Some(note)))
    };
    // "NAME_VENDOR", and CODE V's "NAME_SPECIAL" of what is not a vendor's.
    let name_in_file = name.trim();
    let (stem, vendor) = match name_in_file.rsplit_once('_') {
        Some((stem, end)) if end.eq_ignore_ascii_case("SPECIAL") => (stem, None),
        Some((stem, end)) if VENDORS.iter().any(|v| v.eq_ignore_ascii_case(end)) => (stem, Some(end)),
        _ => (name_in_file, None),
    };
    let key = plain(stem);
    if key.is_empty() {
        return Err(unknown);
    }
    // Old names are Schott's, or of no vendor.
    if vendor.is_none_or(|v| v.eq_ignore_ascii_case("schott")) {
        if let Some((_, target, why)) = ALIASES.iter().find(|a| a.0 == key) {
            return taken(Glass::parse(target)?, why);
        }
        // "SK10" and "LAKN12" became "N-SK10" and "N-LAK12".
        let digits = key.find(|c: char| c.is_ascii_digit()).unwrap_or(key.len());
        let (letters, number) = key.split_at(digits);
        for letters in [Some(letters), letters.strip_suffix('N')].into_iter().flatten().filter(|l| l.len() > 1) {
            if let Ok(glass) = Glass::parse(&format!("schott/N-{letters}{number}")) {
                return taken(glass, "the successor without lead and arsenic");
            }
        }
    }
    if stem.len() < name_in_file.len()
        && vendor.is_none()
        && let Ok(glass) = Glass::parse_preferring(stem, &["material"])
    {
        return taken(glass, "the same name without its suffix");
    }
    if let Some(base) = stem.strip_suffix("_MOLD").or_else(|| stem.strip_suffix("_mold"))
        && !base.is_empty()
    {
        let key = plain(base);
        if let Some((_, nd, vd)) = MOULDED.iter().find(|m| m.0 == key) {
            return taken(Glass::model(*nd, *vd, 0.0)?, "a curve through nd and Vd after moulding (Rochester Precision Optics)");
        }
        if let Ok(glass) = Glass::parse_preferring(base, vendors) {
            return taken(glass, "the annealed glass; moulding lowers nd by about 0.002 to 0.007, which is not known for it");
        }
    }
    Err(unknown)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::glass::D_NM;

    #[test]
    fn other_programs_names_are_found_with_a_note() {
        // nd by the sheets of Schott, Corning and Rochester Precision Optics.
        for (name, nd, vd) in [
            ("BK7", 1.51680, 64.17),
            ("BK7_SCHOTT", 1.51680, 64.17),
            ("FUSED_SILICA", 1.45846, 67.82),
            ("F_SILICA", 1.45846, 67.82),
            ("LASF9", 1.85025, 32.17),
            ("SSK4", 1.61765, 55.14),
            ("LAKN22", 1.65113, 55.89),
            ("BASF10", 1.65016, 39.15),
            ("SK10", 1.62278, 56.98),
            ("LAKN12", 1.67790, 55.20),
            ("N-BK7_MOLD", 1.51259, 63.65),
            ("SILICA_SPECIAL", 1.45846, 67.82),
        ] {
            let (glass, note) = parse_foreign(name, &[]).unwrap_or_else(|e| panic!("{name}: {e}"));
            assert!((glass.index(D_NM) - nd).abs() < 2e-5, "{name}: {}", glass.index(D_NM));
            assert!((glass.abbe() - vd).abs() < 0.02, "{name}: {}", glass.abbe());
            assert!(note.is_some_and(|n| n.contains(name)), "{name}");
        }
        // What the catalogue has needs none.
        for name in ["N-BK7", "C79-80", "GERMANIUM", "SILICON", "CAF2", "1.5/60", "air"] {
            assert_eq!(parse_foreign(name, &[]).unwrap().1, None, "{name}");
        }
        // 1550 nm in silicon 3.478 (Salzberg & Villa 1957), 10 µm in germanium 4.003 (Icenogle et al. 1976).
        let index = |name: &str, nm: f64| Glass::parse(name).unwrap().index(nm);
        assert!((index("SILICON", 1550.0) - 3.478).abs() < 1e-3 && (index("GERMANIUM", 10_000.0) - 4.003).abs() < 2e-3);
        // A moulded glass that nobody lists, by the annealed one.
        let (glass, note) = parse_foreign("L-BAL35_MOLD", &[]).unwrap();
        assert!((glass.index(D_NM) - 1.58913).abs() < 2e-5 && note.unwrap().contains("annealed"));
    }

    #[test]
    fn nothing_else_is_guessed() {
        for name in ["BK7_SCHOT", "BK7_OHARA", "NOGLASS", "NOGLASS_MOLD", "N-BK77", "_MOLD", "_SPECIAL", "N", "7"] {
            assert!(parse_foreign(name, &[]).is_err(), "{name}");
        }
        // Our own form does not know aliases.
        assert!(Glass::parse("BK7").is_err());
    }
}
