//! Names of glasses in the lens files of other programs that the catalogue has under another name.
//!
//! Only importers ask here, and every alias comes with a note for the reader: our own form still takes exact names only. Three
//! kinds: names with an entry in [`ALIASES`]; Schott's glasses of before about 1998, whose lead- and arsenic-free successors carry
//! the prefix N- and the same glass code (Schott, "Optical Glass" catalogue, chapter 1); moulded glasses (`_MOLD`), whose index
//! falls while they cool fast (Schott TIE-40).

use super::catalogue::{VENDORS, plain};
use super::{Glass, GlassError, GlassKind};

/// Name (letters and digits only), the glass it is taken for, and why.
const ALIASES: &[(&str, &str, &str)] = &[
    ("LASF9", "schott/N-LASF9", "the successor of the same glass code 850322"),
    // No glass of today has its place; by glass code 618551.
    ("SSK4", "1.61765/55.14", "discontinued: a curve through Schott's nd and Vd"),
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

/// A glass by the name another program gives it, and a note where that is not the catalogue's name, or where none of the `vendors` that the file names
/// (lower case; none if it names none) has it. Fails as [`Glass::parse_preferring`] does where no alias is known either.
pub(crate) fn parse_foreign(name: &str, vendors: &[&str]) -> Result<(Glass, Option<String>), GlassError> {
    let found = match Glass::parse_preferring(name, vendors) {
        Err(e @ (GlassError::Unknown { .. } | GlassError::NoFigures(_))) => Err(e),
        found => Ok(found?),
    };
    let makers: Vec<&str> = vendors.iter().copied().filter(|v| MAKERS.contains(v)).collect();
    if let Ok(glass) = &found
        && !is_of_other_maker(glass, name, &makers)
    {
        return found.map(|glass| (glass, None));
    }
    // Before a glass of another maker comes an old name of one that the file names.
    if let Some((glass, note)) = by_alias(name, vendors)? {
        return Ok((glass, Some(note)));
    }
    let glass = found?;
    let note = format!(
        "glass \"{name}\": the file asks for glass of {}, of which none has that name; taken is {}",
        makers.join(", "),
        glass.written()
    );
    Ok((glass, Some(note)))
}

/// Vendors of glass, whose names others use for other glasses; what comes behind them are materials.
const MAKERS: &[&str] = VENDORS.split_at(7).0;

/// Whether a glass that was found by its bare name is of none of the makers that a file names, if it names any.
fn is_of_other_maker(glass: &Glass, name: &str, makers: &[&str]) -> bool {
    let GlassKind::Catalogue { vendor, .. } = &glass.kind else { return false };
    let names_vendor = name.to_ascii_lowercase().contains(vendor.as_str());
    !makers.is_empty() && !names_vendor && MAKERS.contains(&vendor.as_str()) && !makers.contains(&vendor.as_str())
}

/// A glass by a name that is not the catalogue's, and a note; `None` where no alias is known.
fn by_alias(name: &str, vendors: &[&str]) -> Result<Option<(Glass, String)>, GlassError> {
    let taken = |glass: Glass, why: &str| {
        let note = format!("glass \"{name}\" is taken for {}: {why}", glass.written());
        Ok(Some((glass, note)))
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
        return Ok(None);
    }
    // Old names are Schott's, or of no vendor.
    let of_schott = |v: &&str| v.eq_ignore_ascii_case("schott");
    if vendor.as_ref().is_none_or(of_schott) && (vendor.is_some() || vendors.is_empty() || vendors.iter().any(of_schott)) {
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
    Ok(None)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::glass::D_NM;

    #[test]
    fn other_programs_names_are_found_with_a_note() {
        // nd by the sheets of Schott, Corning and Rochester Precision Optics.
        for (name, nd, vd) in [
            ("FUSED_SILICA", 1.45846, 67.82),
            ("F_SILICA", 1.45846, 67.82),
            ("LASF9", 1.85025, 32.17),
            ("SSK4", 1.61765, 55.14),
            ("LASF44", 1.80420, 46.50),
            ("N-BK7_MOLD", 1.51259, 63.65),
            ("SILICA_SPECIAL", 1.45846, 67.82),
        ] {
            let (glass, note) = parse_foreign(name, &[]).unwrap_or_else(|e| panic!("{name}: {e}"));
            assert!((glass.index(D_NM) - nd).abs() < 2e-5, "{name}: {}", glass.index(D_NM));
            assert!((glass.abbe() - vd).abs() < 0.02, "{name}: {}", glass.abbe());
            assert!(note.is_some_and(|n| n.contains(name)), "{name}");
        }
        // What the catalogue has needs none.
        for name in ["N-BK7", "BK7", "BK7_SCHOTT", "C79-80", "GERMANIUM", "SILICON", "CAF2", "1.5/60", "air"] {
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
        assert!(Glass::parse("SSK4").is_err());
    }

    #[test]
    fn a_name_is_of_the_maker_that_the_file_names() {
        // nd of Schott's and CDGM's catalogues: the same names, other glasses.
        for (name, vendors, nd) in [
            ("F6", &[][..], 1.63636),
            ("F6", &["schott"], 1.63636),
            ("F7", &["schott", "cdgm"], 1.62536),
            ("F6", &["cdgm", "schott"], 1.62495),
            ("F6_HOYA", &["schott"], 1.63636),
            ("SK16", &["schott"], 1.62041),
        ] {
            let (glass, note) = parse_foreign(name, vendors).unwrap();
            assert!((glass.index(D_NM) - nd).abs() < 2e-5 && note.is_none(), "{name} {vendors:?}: {}", glass.index(D_NM));
        }
        // Of makers that the file does not name: told; not of materials.
        let (glass, note) = parse_foreign("H-K9L", &["schott", "hoya"]).unwrap();
        assert!((glass.index(D_NM) - 1.5168).abs() < 2e-5);
        let note = note.unwrap();
        assert!(note.contains("schott, hoya") && note.contains("cdgm/H-K9L"), "{note}");
        assert_eq!(parse_foreign("GERMANIUM", &["schott"]).unwrap().1, None);
        assert_eq!(parse_foreign("H-K9L", &["infrared"]).unwrap().1, None);
        // Nobody sells those that are no longer made.
        assert!(!crate::glass::entry_names().iter().any(|name| name == "schott/F6"));
    }
}
