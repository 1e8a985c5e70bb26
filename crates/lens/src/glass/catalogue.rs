//! The catalogue: 1,687 glasses of seven vendors, crystals and plastics; and 393 glasses that Schott and Hoya no longer list, which are found by
//! name and not proposed to anyone.
//!
//! Source: refractiveindex.info database at commit ff11b58 (CC0), from the vendors' own sheets; `data/*.csv` hold the figures as
//! text, `build.rs` packs them, and they are unpacked and indexed when the first name is asked for.

use super::{Glass, GlassError, GlassKind, nearest};
use std::collections::HashMap;
use std::sync::OnceLock;

/// Vendors in the order in which an ambiguous name is looked up.
pub(super) const VENDORS: [&str; 9] = ["schott", "ohara", "hoya", "hikari", "sumita", "cdgm", "lzos", "material", "plastic"];

struct Catalogue {
    /// Lines of all tables.
    lines: String,
    /// Of which these first bytes are of glasses that vendors list.
    listed: usize,
    /// Lines of the absorption table.
    absorption: String,
    /// Name without dashes and case → (vendor, byte offset of its line).
    by_name: HashMap<String, Vec<(usize, usize)>>,
    /// "vendor/name" → byte offset in `absorption`.
    absorption_by_name: HashMap<String, usize>,
}

fn unpack(packed: &[u8]) -> String {
    // The data is our own, packed when this crate was built.
    let bytes = miniz_oxide::inflate::decompress_to_vec_zlib(packed).unwrap_or_default();
    String::from_utf8(bytes).unwrap_or_default()
}

fn catalogue() -> &'static Catalogue {
    static CATALOGUE: OnceLock<Catalogue> = OnceLock::new();
    CATALOGUE.get_or_init(|| {
        let mut lines = unpack(include_bytes!(concat!(env!("OUT_DIR"), "/glasses.deflate")));
        lines += &unpack(include_bytes!(concat!(env!("OUT_DIR"), "/materials.deflate")));
        let listed = lines.len();
        lines += &unpack(include_bytes!(concat!(env!("OUT_DIR"), "/discontinued.deflate")));
        let absorption = unpack(include_bytes!(concat!(env!("OUT_DIR"), "/absorption.deflate")));
        let offset = |whole: &str, line: &str| line.as_ptr() as usize - whole.as_ptr() as usize;
        let mut by_name: HashMap<String, Vec<(usize, usize)>> = HashMap::new();
        for line in lines.lines().filter(|l| !l.starts_with('#')) {
            let mut fields = line.split(',');
            let (Some(vendor), Some(name)) = (fields.next(), fields.next()) else { continue };
            let rank = VENDORS.iter().position(|v| *v == vendor).unwrap_or(VENDORS.len());
            by_name.entry(plain(name)).or_default().push((rank, offset(&lines, line)));
        }
        by_name.values_mut().for_each(|entries| entries.sort_unstable());
        let absorption_by_name = absorption
            .lines()
            .filter(|l| !l.starts_with('#'))
            .filter_map(|l| Some((l.split_once(',')?.0.to_owned(), offset(&absorption, l))))
            .collect();
        Catalogue { lines, listed, absorption, by_name, absorption_by_name }
    })
}

/// Upper case letters and digits only.
pub(super) fn plain(name: &str) -> String {
    name.chars().filter(|c| c.is_alphanumeric()).map(|c| c.to_ascii_uppercase()).collect()
}

/// Every name as "vendor/name", in the order of the tables, but for glasses that are no longer made.
pub fn entry_names() -> Vec<String> {
    let entry = |l: &'static str| {
        let mut fields = l.split(',');
        Some(format!("{}/{}", fields.next()?, fields.next()?))
    };
    let catalogue = catalogue();
    catalogue.lines[..catalogue.listed].lines().filter(|l| !l.starts_with('#')).filter_map(entry).collect()
}

/// All glasses that a vendor lists and that have figures, in the order of its table; `None` where there is no such vendor.
pub fn catalogue_glasses(vendor: &str) -> Option<Vec<Glass>> {
    let vendor = VENDORS.iter().find(|v| v.eq_ignore_ascii_case(vendor.trim()))?;
    let of_vendor = |name: &String| name.split_once('/').is_some_and(|(v, _)| v == *vendor);
    Some(entry_names().iter().filter(|n| of_vendor(n)).filter_map(|n| find(n, &[]).ok()).collect())
}

/// The glass of a name: dashes and case do not count; the vendor may stand before ("schott/", "SCHOTT:") or behind
/// ("_SCHOTT", "(SCHOTT)"). Without one, `preferred` vendors are asked first. Fails on an unknown name, with those near it, and
/// on a glass of which the name alone is known.
pub fn find(name: &str, preferred: &[&str]) -> Result<Glass, GlassError> {
    let catalogue = catalogue();
    let vendor_of = |text: &str| VENDORS.iter().position(|v| v.eq_ignore_ascii_case(text.trim()));
    let split = |at: Option<(&'_ str, &'_ str)>| at.map(|(a, b)| (a.trim().to_owned(), b.trim().to_owned()));
    let mut vendor = None;
    let mut stem = name.trim().to_owned();
    if let Some((a, b)) = split(name.split_once(['/', ':'])) {
        if let Some(v) = vendor_of(&a) {
            (vendor, stem) = (Some(v), b);
        }
    } else if let Some((a, b)) = split(name.rsplit_once(['_', '(', ' ']))
        && let Some(v) = vendor_of(b.trim_end_matches(')'))
    {
        (vendor, stem) = (Some(v), a);
    }
    let unknown = || {
        let near = near_names(&stem);
        let hint = match near.is_empty() {
            true => "; a glass is a catalogue name such as N-BK7, nd/Vd such as 1.5168/64.17, or one index".to_owned(),
            false => format!("; did you mean {}?", near.join(" or ")),
        };
        GlassError::Unknown { name: name.to_owned(), hint }
    };
    let entries = catalogue.by_name.get(&plain(&stem)).ok_or_else(unknown)?;
    let wanted: Vec<usize> = preferred.iter().filter_map(|v| vendor_of(v)).collect();
    // A row that only knows the name does not hide one that has figures: of the vendor itself, and of others where none is named.
    let has_figures = |e: &&(usize, usize)| !figures_missing(catalogue.lines[e.1..].lines().next().unwrap_or(""));
    let of = |v: usize| {
        let mut own = entries.iter().filter(move |e| e.0 == v);
        own.clone().find(has_figures).or_else(|| own.next())
    };
    let entry = match vendor {
        Some(v) => of(v),
        None => wanted.iter().find_map(|v| of(*v)).or_else(|| entries.iter().find(has_figures).or(entries.first())),
    };
    let line = entry.and_then(|e| catalogue.lines[e.1..].lines().next()).ok_or_else(unknown)?;
    let fields: Vec<&str> = line.split(',').collect();
    let (vendor, full_name) = (fields[0], fields[1]);
    if figures_missing(line) {
        return Err(GlassError::NoFigures(name.to_owned()));
    }
    let number = |i: usize| fields.get(i).and_then(|f| f.parse::<f64>().ok()).unwrap_or(f64::NAN);
    let coefficients = fields[5].split_whitespace().filter_map(|c| c.parse().ok()).collect();
    let kind = GlassKind::Catalogue {
        vendor: vendor.to_owned(),
        formula: fields[2].parse().unwrap_or(0),
        coefficients,
        range_nm: [number(3) * 1000.0, number(4) * 1000.0],
    };
    let absorption = catalogue.absorption_by_name.get(&format!("{vendor}/{full_name}")).map_or(vec![], |at| {
        let line = catalogue.absorption[*at..].lines().next().unwrap_or("");
        let values: Vec<f64> = line.split(',').nth(1).unwrap_or("").split_whitespace().filter_map(|v| v.parse().ok()).collect();
        // 1/m in the table, 1/mm here.
        values.chunks_exact(2).map(|p| (p[0], p[1] * 1e-3)).collect()
    });
    Ok(Glass { name: full_name.to_owned(), kind, absorption })
}

fn figures_missing(line: &str) -> bool {
    line.split(',').nth(2) == Some("-")
}

/// Up to three names near a misspelt one.
fn near_names(stem: &str) -> Vec<String> {
    let names: Vec<String> = entry_names();
    let mut bare: Vec<&str> = names.iter().filter_map(|n| n.split_once('/')).map(|(_, n)| n).collect();
    let mut near = vec![];
    while near.len() < 3 {
        let Some(next) = nearest(stem, bare.iter().copied()) else { break };
        near.push(format!("\"{next}\""));
        let next = next.to_owned();
        bare.retain(|n| *n != next);
    }
    near
}
