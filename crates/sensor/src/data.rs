//! The data sheets and spectral responses that are embedded.

/// Bodies: name on the command line, and TOML.
pub const BODIES: &[(&str, &str)] = &[
    ("canon-5d-mark-iv", include_str!("bodies/canon-5d-mark-iv.toml")),
    ("canon-5d-mark-ii", include_str!("bodies/canon-5d-mark-ii.toml")),
    ("canon-t2i", include_str!("bodies/canon-t2i.toml")),
    ("nikon-d850", include_str!("bodies/nikon-d850.toml")),
    ("sony-a7s-ii", include_str!("bodies/sony-a7s-ii.toml")),
    ("ideal", include_str!("bodies/ideal.toml")),
];

/// Relative spectral sensitivities, 380–780 nm in 5 nm: `nm,R,G,B`. Source: rawtoaces camera data, Apache-2.0.
pub const RESPONSES: &[(&str, &str)] = &[
    ("canon_eos_5d_mark_ii", include_str!("responses/canon_eos_5d_mark_ii.csv")),
    ("canon_eos_5d_mark_iv", include_str!("responses/canon_eos_5d_mark_iv.csv")),
    ("canon_eos_600d", include_str!("responses/canon_eos_600d.csv")),
    ("nikon_d850", include_str!("responses/nikon_d850.csv")),
    ("sony_a7s_ii", include_str!("responses/sony_a7s_ii.csv")),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_are_the_ones_that_were_checked() {
        // FNV-1a, 64 bit.
        let sum = RESPONSES
            .iter()
            .flat_map(|(_, t)| t.bytes())
            .fold(0xcbf2_9ce4_8422_2325u64, |h, b| (h ^ b as u64).wrapping_mul(0x100_0000_01b3));
        assert_eq!(sum, CHECKED, "a table changed: compare it with its source, then update the checksum");
    }
    const CHECKED: u64 = 16369499539220588316;
}
