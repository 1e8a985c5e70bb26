//! The data sheets and spectral responses that are embedded.

/// Bodies: name on the command line, and TOML; `ideal` last. The files of the folder, listed when this is compiled.
pub const BODIES: &[(&str, &str)] = include!(concat!(env!("OUT_DIR"), "/bodies.rs"));

/// Relative spectral sensitivities, 380–780 nm in 5 nm: `nm,R,G,B`. Source: rawtoaces camera data, Apache-2.0.
pub const RESPONSES: &[(&str, &str)] = &[
    ("canon_digital_rebel_xti", include_str!("responses/canon_digital_rebel_xti.csv")),
    ("canon_eos_5d", include_str!("responses/canon_eos_5d.csv")),
    ("canon_eos_5d_mark_ii", include_str!("responses/canon_eos_5d_mark_ii.csv")),
    ("canon_eos_5d_mark_iv", include_str!("responses/canon_eos_5d_mark_iv.csv")),
    ("canon_eos_600d", include_str!("responses/canon_eos_600d.csv")),
    ("fujifilm_x_t4", include_str!("responses/fujifilm_x_t4.csv")),
    ("nikon_d850", include_str!("responses/nikon_d850.csv")),
    ("sony_a7s_ii", include_str!("responses/sony_a7s_ii.csv")),
    ("sony_rx100m4", include_str!("responses/sony_rx100m4.csv")),
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
    const CHECKED: u64 = 12311870858963829545;
}
