//! Cryptomatte: identifiers that are hashes of names, and how EXR files say so.
//!
//! Source: J. Friedman, A. C. Jones 2015, "Fully automatic ID mattes with support for motion blur and transparency" (SIGGRAPH posters); Psyop, "Cryptomatte
//! Specification" 1.2.0. A layer has channels `Layer00.R` (identifier), `.G` (its coverage), `.B`, `.A` (those of the next rank), `Layer01.R` ...; the metadata
//! `cryptomatte/<key>/…` names layer, hash, conversion and manifest, where the key is the first seven hexadecimal digits of the layer's own hash.

use std::collections::BTreeMap;

/// MurmurHash3_x86_32 with seed 0 of a name in UTF-8. Source: A. Appleby, MurmurHash3 (public domain), `MurmurHash3_x86_32`.
pub fn murmur3(name: &str) -> u32 {
    const C1: u32 = 0xcc9e_2d51;
    const C2: u32 = 0x1b87_3593;
    let scrambled = |k: u32| k.wrapping_mul(C1).rotate_left(15).wrapping_mul(C2);
    let bytes = name.as_bytes();
    let (blocks, tail) = bytes.as_chunks::<4>();
    let mut hash = 0u32;
    for block in blocks {
        hash = (hash ^ scrambled(u32::from_le_bytes(*block))).rotate_left(13).wrapping_mul(5).wrapping_add(0xe654_6b64);
    }
    let rest = tail.iter().rev().fold(0u32, |k, byte| k << 8 | u32::from(*byte));
    hash ^= scrambled(rest);
    hash ^= bytes.len() as u32;
    hash = (hash ^ hash >> 16).wrapping_mul(0x85eb_ca6b);
    hash = (hash ^ hash >> 13).wrapping_mul(0xc2b2_ae35);
    hash ^ hash >> 16
}

/// The identifier of a name: its hash as the bits of a floating-point number, kept from being zero, subnormal, infinite or no number by the lowest bit of its
/// exponent (the specification's `uint32_to_float32`).
pub fn identifier(name: &str) -> f32 {
    let hash = murmur3(name);
    let exponent = hash >> 23 & 0xff;
    f32::from_bits(if exponent == 0 || exponent == 255 { hash ^ 1 << 23 } else { hash })
}

/// Names whose hashes are the identifiers of a layer of coverage.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Manifest {
    /// Layer of the EXR file.
    pub layer: String,
    /// Names, each once, in order.
    pub names: Vec<String>,
    /// Name of the file beside the EXR file that holds the names, too ([`Manifest::sidecar_json`]); `None` without one.
    pub sidecar: Option<String>,
}

impl Manifest {
    /// A manifest of names, each once, in order, without a file beside.
    pub fn new(layer: impl Into<String>, names: Vec<String>) -> Manifest {
        Manifest { layer: layer.into(), names, sidecar: None }
    }

    /// What the file beside the EXR file holds: names and their identifiers as eight hexadecimal digits (Cryptomatte 1.2.0, "manif_file").
    pub fn sidecar_json(&self) -> String {
        manifest_json(self)
    }
}

/// Names and their identifiers as eight hexadecimal digits, as JSON.
pub(crate) fn manifest_json(manifest: &Manifest) -> String {
    let names: serde_json::Map<String, serde_json::Value> =
        manifest.names.iter().map(|name| (name.clone(), format!("{:08x}", identifier(name).to_bits()).into())).collect();
    serde_json::Value::Object(names).to_string()
}

/// Metadata of a layer: names of attributes and their texts. The manifest stands in the header also where a file beside holds it: readers take either.
pub(crate) fn metadata(manifest: &Manifest) -> Vec<(String, String)> {
    let key = &format!("{:08x}", murmur3(&manifest.layer))[..7];
    let always = [
        ("name", manifest.layer.clone()),
        ("hash", "MurmurHash3_32".into()),
        ("conversion", "uint32_to_float32".into()),
        ("manifest", manifest_json(manifest)),
    ];
    let sidecar = manifest.sidecar.iter().map(|file| ("manif_file", file.clone()));
    always.into_iter().chain(sidecar).map(|(what, text)| (format!("cryptomatte/{key}/{what}"), text)).collect()
}

/// The layer and its names that attributes tell of, one for each `cryptomatte/<key>/name`.
pub(crate) fn manifests(attributes: &[(String, String)]) -> Vec<Manifest> {
    let text = |wanted: String| attributes.iter().find(|(name, _)| *name == wanted).map_or("", |(_, text)| text.as_str());
    let layers =
        attributes.iter().filter_map(|(name, layer)| Some((name.strip_prefix("cryptomatte/")?.strip_suffix("/name")?, layer)));
    let mut found: Vec<Manifest> = layers
        .map(|(key, layer)| {
            let json = text(format!("cryptomatte/{key}/manifest"));
            let names: BTreeMap<String, serde_json::Value> = serde_json::from_str(json).unwrap_or_default();
            let sidecar = attributes
                .iter()
                .find(|(name, _)| *name == format!("cryptomatte/{key}/manif_file"))
                .map(|(_, file)| file.clone());
            Manifest { layer: layer.clone(), names: names.into_keys().collect(), sidecar }
        })
        .collect();
    found.sort_by(|a, b| a.layer.cmp(&b.layer));
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hashes_are_those_of_other_programs() {
        // The first two names are those of the specification's example; all by Python's mmh3 5.3.1: mmh3.hash(name, 0, signed=False).
        for (name, hash) in [
            ("bunny", 0x1385_1a76),
            ("default", 0x42c9_679f),
            ("", 0),
            ("a", 0x3c25_69b2),
            ("CryptoObject", 0x3ae3_9a58),
            ("Wände", 0xd680_08de),
            ("hello, world", 0x149b_bb7f),
            ("The quick brown fox jumps over the lazy dog", 0x2e4f_f723),
        ] {
            assert_eq!(murmur3(name), hash, "{name}");
        }
        // Exponents of all zeros and of all ones.
        for name in ["object-436", "object-690", "object-499", "object-659"] {
            let exponent = murmur3(name) >> 23 & 0xff;
            assert!(exponent == 0 || exponent == 255, "{name}");
            assert!(identifier(name).is_normal(), "{name}");
        }
    }

    #[test]
    fn metadata_tells_the_names_again() {
        let names = vec!["a \"b\"".into(), "bunny".into(), "Wände".into()];
        let manifest = Manifest { sidecar: Some("truth.CryptoObject.json".into()), ..Manifest::new("CryptoObject", names) };
        let metadata = metadata(&manifest);
        assert_eq!(metadata[4], ("cryptomatte/3ae39a5/manif_file".into(), "truth.CryptoObject.json".into()));
        assert!(metadata.iter().all(|(name, _)| name.starts_with("cryptomatte/") && name.len() <= 31));
        assert!(metadata[3].1.contains("\"bunny\":\"13851a76\""), "{}", metadata[3].1);
        let mut sorted = manifest.clone();
        sorted.names.sort();
        assert_eq!(manifests(&metadata), [sorted]);
    }
}
