//! How the numbers of a picture relate to light: transfer functions.
//!
//! Sources: IEC 61966-2-1 (sRGB); SMPTE ST 2084 / ITU-R BT.2100-2 table 4 (PQ) and table 5 (HLG); ITU-R BT.2408-7 (diffuse white of HDR
//! pictures at 203 cd/m², 75 % of HLG).

use diopter_light::color::{srgb_decode, srgb_encode};

/// Luminance of diffuse white (1.0) in PQ pictures, cd/m². Source: ITU-R BT.2408-7 §2.1.
pub const HDR_WHITE_NITS: f32 = 203.0;

/// Luminance that HLG's largest code shows on the display it is made for, cd/m². Source: ITU-R BT.2100-2.
pub const HLG_PEAK_NITS: f32 = 1000.0;

/// System gamma of that display. Source: ITU-R BT.2100-2 table 5, 1.2 + 0.42 log10(Lw / 1000).
const HLG_GAMMA: f32 = 1.2;

/// How the numbers of a picture relate to light. Light is linear with 1.0 = diffuse white.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Encoding {
    /// Proportional to light.
    Linear,
    /// The sRGB transfer function.
    Srgb,
    /// A power of 1/1.8: displays of old Macintosh computers.
    #[serde(rename = "gamma-1.8")]
    Gamma18,
    /// A power of 1/2.2.
    #[serde(rename = "gamma-2.2")]
    Gamma22,
    /// A power of 1/2.4: the display of ITU-R BT.1886 with a black of 0.
    #[serde(rename = "gamma-2.4")]
    Gamma24,
    /// Perceptual quantizer: absolute, white at 203 cd/m².
    Pq,
    /// Hybrid log-gamma: what a display of 1000 cd/m² shows, white at 203 cd/m² (75 %). The function acts on colours, not channels: see
    /// [`Encoding::encode_pixel`]; of a channel by itself it is that of greys.
    Hlg,
}

impl Encoding {
    /// All of them.
    pub const ALL: [Encoding; 7] =
        [Encoding::Linear, Encoding::Srgb, Encoding::Gamma18, Encoding::Gamma22, Encoding::Gamma24, Encoding::Pq, Encoding::Hlg];

    /// Whether light above white can be told.
    pub fn is_hdr(self) -> bool {
        matches!(self, Encoding::Pq | Encoding::Hlg | Encoding::Linear)
    }

    /// Code (0 to 1) of linear light; what cannot be told is clipped, but for `Linear`. Light is 1 at diffuse white.
    pub fn encode(self, linear: f32) -> f32 {
        match self {
            Encoding::Linear => linear,
            Encoding::Srgb => srgb_encode(linear.clamp(0.0, 1.0)),
            Encoding::Gamma18 => linear.clamp(0.0, 1.0).powf(1.0 / 1.8),
            Encoding::Gamma22 => linear.clamp(0.0, 1.0).powf(1.0 / 2.2),
            Encoding::Gamma24 => linear.clamp(0.0, 1.0).powf(1.0 / 2.4),
            Encoding::Pq => pq_encode(linear * HDR_WHITE_NITS),
            Encoding::Hlg => self.encode_pixel([linear; 3], [1.0 / 3.0; 3])[0],
        }
    }

    /// Codes of a colour. `luminance`: weights of the channels in the picture's space.
    pub fn encode_pixel(self, light: [f32; 3], luminance: [f32; 3]) -> [f32; 3] {
        if self != Encoding::Hlg {
            return light.map(|v| self.encode(v));
        }
        // The display raises the luminance of the scene to its gamma: undone here (BT.2100 note 5i).
        let shown = light.map(|v| (v * HDR_WHITE_NITS / HLG_PEAK_NITS).clamp(0.0, 1.0));
        let y: f32 = shown.iter().zip(luminance).map(|(v, w)| v * w).sum();
        let scale = if y > 0.0 { y.powf((1.0 - HLG_GAMMA) / HLG_GAMMA) } else { 0.0 };
        shown.map(|v| hlg_encode(v * scale))
    }

    /// Light of the codes of a colour, as [`Encoding::encode_pixel`].
    pub fn decode_pixel(self, codes: [f32; 3], luminance: [f32; 3]) -> [f32; 3] {
        if self != Encoding::Hlg {
            return codes.map(|v| self.decode(v));
        }
        let scene = codes.map(hlg_decode);
        let y: f32 = scene.iter().zip(luminance).map(|(v, w)| v * w).sum();
        let scale = if y > 0.0 { y.powf(HLG_GAMMA - 1.0) } else { 0.0 };
        scene.map(|v| v * scale * HLG_PEAK_NITS / HDR_WHITE_NITS)
    }

    /// Linear light (1 at diffuse white) of a code.
    pub fn decode(self, code: f32) -> f32 {
        match self {
            Encoding::Linear => code,
            Encoding::Srgb => srgb_decode(code),
            Encoding::Gamma18 => code.max(0.0).powf(1.8),
            Encoding::Gamma22 => code.max(0.0).powf(2.2),
            Encoding::Gamma24 => code.max(0.0).powf(2.4),
            Encoding::Pq => pq_decode(code) / HDR_WHITE_NITS,
            Encoding::Hlg => self.decode_pixel([code; 3], [1.0 / 3.0; 3])[0],
        }
    }
}

const PQ_M1: f64 = 0.159_301_757_812_5;
const PQ_M2: f64 = 78.843_75;
const PQ_C: [f64; 3] = [0.835_937_5, 18.851_562_5, 18.687_5];

/// PQ code of a luminance in cd/m², 0 to 10 000.
pub fn pq_encode(nits: f32) -> f32 {
    let y = (f64::from(nits) / 10_000.0).clamp(0.0, 1.0).powf(PQ_M1);
    (((PQ_C[0] + PQ_C[1] * y) / (1.0 + PQ_C[2] * y)).powf(PQ_M2)) as f32
}

/// Luminance in cd/m² of a PQ code.
pub fn pq_decode(code: f32) -> f32 {
    let v = f64::from(code).clamp(0.0, 1.0).powf(1.0 / PQ_M2);
    (10_000.0 * ((v - PQ_C[0]).max(0.0) / (PQ_C[1] - PQ_C[2] * v)).powf(1.0 / PQ_M1)) as f32
}

const HLG_A: f32 = 0.178_832_77;
const HLG_B: f32 = 0.284_668_92;
const HLG_C: f32 = 0.559_910_73;

/// HLG code of scene light, 0 to 1.
pub fn hlg_encode(light: f32) -> f32 {
    let e = light.clamp(0.0, 1.0);
    if e <= 1.0 / 12.0 { (3.0 * e).sqrt() } else { HLG_A * (12.0 * e - HLG_B).ln() + HLG_C }
}

/// Scene light of an HLG code.
pub fn hlg_decode(code: f32) -> f32 {
    let v = code.clamp(0.0, 1.0);
    if v <= 0.5 { v * v / 3.0 } else { (((v - HLG_C) / HLG_A).exp() + HLG_B) / 12.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hdr_codes_agree_with_the_standards() {
        // BT.2408-7 table 1 (58 %, 75 %) and SMPTE ST 2084 computed in double precision.
        for (nits, code) in [(100.0, 0.508_078_4), (203.0, 0.580_688_9), (1000.0, 0.751_827_1), (4000.0, 0.902_572_4)] {
            assert!((pq_encode(nits) - code).abs() < 1e-6, "{nits} {}", pq_encode(nits));
        }
        assert!((hlg_encode(0.015) - 0.212_132).abs() < 1e-6);
        // BT.2408-7 table 1: diffuse white at 75 %, 18 % grey (26 cd/m²) at 38 %; the peak is the largest code.
        for (nits, code) in [(203.0, 0.75), (26.0, 0.38), (1000.0, 1.0)] {
            let got = Encoding::Hlg.encode(nits / HDR_WHITE_NITS);
            assert!((got - code).abs() < 5e-3, "{nits} {got}");
        }
        assert!((Encoding::Pq.encode(1.0) - 0.580_688_9).abs() < 1e-6);
    }

    #[test]
    fn gammas_are_powers() {
        for (encoding, gamma) in [(Encoding::Gamma18, 1.8f32), (Encoding::Gamma22, 2.2), (Encoding::Gamma24, 2.4)] {
            assert_eq!((encoding.encode(0.0), encoding.encode(1.0)), (0.0, 1.0));
            // Grey of 18 %: 0.386, 0.459, 0.489.
            assert!((encoding.encode(0.18).ln() - 0.18f32.ln() / gamma).abs() < 1e-5, "{encoding:?}");
        }
    }

    #[test]
    fn decoding_undoes_encoding() {
        for encoding in Encoding::ALL {
            for i in 0..=100 {
                let code = i as f32 / 100.0;
                let back = encoding.encode(encoding.decode(code));
                assert!((back - code).abs() < 2e-5, "{encoding:?} {code} {back}");
            }
        }
    }
}
