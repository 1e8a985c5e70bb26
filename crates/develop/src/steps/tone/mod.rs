//! Tone curves: from the light of the scene to that of a display. One file a family, one line a curve (`curves!`).
//!
//! Every curve takes linear Rec.709 light of the scene, 0.18 = middle grey, and gives linear Rec.709 light of a display, 1 = its white. Curves
//! that were published as display codes (AgX, Hejl) are decoded by the sRGB function, so that a finished sRGB picture holds their codes.

mod aces1;
mod aces2;
mod agx;
mod filmic;
mod linear;
mod neutral;
mod reinhard;

use crate::setting::{names, section};
use diopter_light::color::RgbSpace;
use glam::Vec3;

/// Middle grey.
pub const GREY: f32 = 0.18;

/// Luminance of Rec.709.
pub const LUMA: Vec3 = diopter_light::color::SRGB_LUMINANCE;

/// What a curve is made ready for.
struct Asked {
    /// Luminance to be shown as white, by curves that let one choose.
    white: Option<f32>,
    /// The brightest light that the display can show, in whites; above 1 for HDR.
    peak: f32,
    /// Its primaries.
    gamut: RgbSpace,
}

impl Asked {
    /// The white that was asked for, or what the curve was published with.
    fn white_or(&self, published: f32) -> f32 {
        self.white.unwrap_or(published)
    }

    /// The peak of a display brighter than white.
    fn brighter_peak(&self) -> Option<f32> {
        Some(self.peak).filter(|p| *p > 1.0 && p.is_finite())
    }
}

/// A curve: linear Rec.709 light of the scene to that of the display.
trait Rendering: Sized {
    /// Whether it knows displays brighter than white.
    const KNOWS_PEAK: bool = false;

    fn new(asked: &Asked) -> Self;

    fn at(&self, scene: Vec3) -> Vec3;
}

impl<T: Rendering> Rendering for Box<T> {
    const KNOWS_PEAK: bool = T::KNOWS_PEAK;

    fn new(asked: &Asked) -> Self {
        Box::new(T::new(asked))
    }

    #[inline]
    fn at(&self, scene: Vec3) -> Vec3 {
        (**self).at(scene)
    }
}

/// All curves, a line each: variant, name in recipes, and the type that makes and applies it.
macro_rules! curves {
    ($($(#[$doc:meta])* $variant:ident = $text:literal => $type:ty,)*) => {
        names! {
            /// Tone curves.
            #[non_exhaustive]
            Curve { $($(#[$doc])* $variant = $text,)* }
        }

        #[cfg(test)]
        const ALL: &[Curve] = &[$(Curve::$variant,)*];

        enum Kind { $($variant($type),)* }

        impl Kind {
            fn new(curve: Curve, asked: &Asked) -> Self {
                match curve { $(Curve::$variant => Kind::$variant(<$type as Rendering>::new(asked)),)* }
            }

            fn knows_peak(&self) -> bool {
                match self { $(Kind::$variant(_) => <$type as Rendering>::KNOWS_PEAK,)* }
            }

            #[inline]
            fn at(&self, scene: Vec3) -> Vec3 {
                match self { $(Kind::$variant(curve) => curve.at(scene),)* }
            }
        }
    };
}

curves! {
    /// None: clipped at white.
    Linear = "linear" => linear::Clipped,
    /// Reinhard et al. 2002, x / (1 + x), on each channel.
    Reinhard = "reinhard" => reinhard::Simple,
    /// Reinhard et al. 2002, eq. 4, with a white, on luminance.
    ReinhardExtended = "reinhard-extended" => reinhard::Extended,
    /// Reinhard et al. 2002, L / (1 + L), on luminance.
    ReinhardLuminance = "reinhard-luminance" => reinhard::Luminance,
    /// Hill's fit of the ACES 1.x reference rendering for sRGB displays.
    #[serde(alias = "aces")]
    AcesFit = "aces-fit" => aces1::Fit,
    /// ACES 1.3 reference rendering and sRGB output transform.
    Aces13 = "aces-1.3" => Box<aces1::Tables>,
    /// ACES 2.0 output transform, Rec.709, 100 cd/m².
    Aces20 = "aces-2.0" => Box<aces2::Transform>,
    /// AgX, Sobotka's original.
    Agx = "agx" => Box<agx::Agx>,
    /// AgX with the punchy look.
    AgxPunchy = "agx-punchy" => Box<agx::Punchy>,
    /// Khronos PBR Neutral.
    Neutral = "neutral" => neutral::Neutral,
    /// Hable's filmic curve (Uncharted 2).
    Hable = "hable" => filmic::Hable,
    /// Hejl & Burgess-Dawson's filmic curve.
    Hejl = "hejl" => filmic::Hejl,
}

impl Curve {
    /// Whether one can choose what luminance it shows as white ([`Tone::white`]).
    pub fn chooses_white(self) -> bool {
        matches!(self, Curve::ReinhardExtended | Curve::Hable)
    }
}

section! {
    /// Tone curve.
    Tone "tone" {
        curve: Curve = Curve::AcesFit, "", Names(Curve::NAMES),
            "from the light of the scene to that of a display";
        keep_grey: bool = true, "", Bool,
            "scales the light so that 18 % grey is shown as 18 % with every curve; without, the curve is as published";
        white: Option<f64> = None, "", Number(0.5, 1000.0),
            "luminance shown as white by reinhard-extended (4) and hable (11.2)";
    }
}

/// A curve made ready.
pub struct ToneCurve {
    kind: Kind,
    /// Factor before the curve.
    gain: f32,
    /// Of displays brighter than white, for curves that know none.
    peak: Option<f32>,
}

impl ToneCurve {
    /// Prepares a curve. `peak`: the brightest light the display can show, in whites, above 1 for HDR; `gamut`: its primaries. Of the curves
    /// `linear` and `aces-2.0` know displays brighter than white; others keep their look up to grey and pass over into the light of the scene.
    pub fn new(tone: &Tone, peak: f32, gamut: RgbSpace) -> Self {
        let asked = Asked { white: tone.white.map(|w| w as f32), peak, gamut };
        let kind = Kind::new(tone.curve, &asked);
        let peak = asked.brighter_peak().filter(|_| !kind.knows_peak());
        let mut curve = ToneCurve { kind, gain: 1.0, peak };
        if tone.keep_grey {
            curve.gain = curve.gain_that_keeps_grey();
        }
        curve
    }

    /// The gain with which middle grey is shown as middle grey, by halving; curves rise.
    fn gain_that_keeps_grey(&self) -> f32 {
        let shown = |gain: f32| self.kind.at(Vec3::splat(GREY * gain)).dot(LUMA);
        let (mut low, mut high) = (0.05f32, 20.0f32);
        for _ in 0..40 {
            let middle = (low * high).sqrt();
            if shown(middle) < GREY { low = middle } else { high = middle }
        }
        (low * high).sqrt()
    }

    /// Light of the display, 0 to its peak.
    #[inline]
    pub fn apply(&self, scene: Vec3) -> Vec3 {
        let shown = self.kind.at(scene * self.gain);
        match self.peak {
            Some(peak) => brighter(shown, scene, peak),
            None => shown,
        }
    }
}

/// Stops above middle grey at which a picture for a brighter display is all light of the scene.
const ALL_SCENE: f32 = 4.0;

/// A look made for white passes over, above middle grey, into the light of the scene, which ends softly at the peak. A choice of ours.
fn brighter(shown: Vec3, scene: Vec3, peak: f32) -> Vec3 {
    let light = scene.dot(LUMA);
    if light <= GREY {
        return shown;
    }
    let t = ((light / GREY).log2() / ALL_SCENE).min(1.0);
    let ended = peak * (1.0 - (-light / peak).exp());
    shown.lerp((scene * (ended / light)).clamp(Vec3::ZERO, Vec3::splat(peak)), t * t * (3.0 - 2.0 * t))
}

/// A function of one number as a table with straight lines between its points.
pub(super) struct Table {
    first: f32,
    per_step: f32,
    values: Vec<f32>,
}

impl Table {
    /// Tabulates a function from `first` to `last`.
    pub fn new(first: f32, last: f32, points: usize, f: impl Fn(f64) -> f64) -> Self {
        let step = f64::from(last - first) / (points - 1) as f64;
        let values = (0..points).map(|i| f(f64::from(first) + step * i as f64) as f32).collect();
        Table { first, per_step: (1.0 / step) as f32, values }
    }

    #[inline]
    pub fn at(&self, x: f32) -> f32 {
        let last = self.values.len() - 2;
        let place = ((x - self.first) * self.per_step).clamp(0.0, (last + 1) as f32);
        let i = (place as usize).min(last);
        self.values[i] + (place - i as f32) * (self.values[i + 1] - self.values[i])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter_light::color::{srgb_decode, srgb_encode};

    fn published(curve: Curve) -> ToneCurve {
        ToneCurve::new(&Tone { curve, keep_grey: false, white: None }, 1.0, RgbSpace::Srgb)
    }

    fn codes(c: Vec3) -> [f32; 3] {
        c.to_array().map(|v| srgb_encode(v.clamp(0.0, 1.0)))
    }

    #[test]
    fn neutral_stays_neutral_and_brighter_never_gets_darker() {
        for &curve in ALL {
            let tone = published(curve);
            let mut before = -1.0;
            for i in 0..400 {
                let v = 1e-4 * 1.04f32.powi(i);
                let out = codes(tone.apply(Vec3::splat(v)));
                // AgX's published matrix has rows that sum to 1 within 1.4e-4.
                let spread = out.iter().fold(0.0f32, |a, b| a.max((b - out[1]).abs()));
                assert!(spread < 5e-4, "{curve:?} {v}: {out:?}");
                assert!(out[1] >= before - 1e-5, "{curve:?} {v}: {} after {before}", out[1]);
                before = out[1];
            }
        }
    }

    #[test]
    fn middle_grey_is_kept_where_asked() {
        for &curve in ALL {
            let tone = ToneCurve::new(&Tone { curve, keep_grey: true, white: None }, 1.0, RgbSpace::Srgb);
            let got = tone.apply(Vec3::splat(0.18)).y;
            assert!((got - 0.18).abs() < 3e-4, "{curve:?} {got}");
        }
    }

    #[test]
    fn brighter_displays_show_the_same_middle_and_more_light() {
        for &curve in ALL {
            let tone = |peak| ToneCurve::new(&Tone { curve, keep_grey: true, white: None }, peak, RgbSpace::Rec2020);
            let (sdr, hdr) = (tone(1.0), tone(5.0));
            let at = |t: &ToneCurve, v: f32| t.apply(Vec3::splat(v)).y;
            assert!((at(&hdr, 0.18) / at(&sdr, 0.18) - 1.0).abs() < 5e-3, "{curve:?}");
            assert!(at(&hdr, 30.0) > 2.0 && at(&hdr, 30.0) <= 5.001, "{curve:?} {}", at(&hdr, 30.0));
            let steps: Vec<f32> = (0..300).map(|i| at(&hdr, 0.01 * 1.03f32.powi(i))).collect();
            assert!(steps.is_sorted_by(|a, b| *b > a - 1e-4), "{curve:?}");
        }
    }

    #[test]
    fn odd_light_gives_numbers() {
        for &curve in ALL {
            for odd in [[-1.0, 0.5, 2.0], [0.0; 3], [-0.1; 3], [1e6, 0.0, 1e-6], [65_504.0; 3]] {
                let out = published(curve).apply(Vec3::from(odd));
                assert!(out.is_finite(), "{curve:?} {odd:?} {out}");
            }
        }
    }

    /// Nineteen colours and their display codes, by OpenColorIO 2.6.0 (AgX: its published configuration, evaluated in double precision).
    const INPUTS: [[f32; 3]; 19] = [
        [0.18; 3],
        [1.0; 3],
        [0.0; 3],
        [0.01; 3],
        [0.5; 3],
        [4.0; 3],
        [16.0; 3],
        [100.0; 3],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
        [4.0, 0.0, 0.0],
        [0.0, 4.0, 0.0],
        [0.0, 0.0, 4.0],
        [0.5, 0.1, 0.02],
        [0.18, 0.35, 0.6],
        [2.0, 1.5, 0.2],
        [0.9, 0.6, 0.5],
        [0.02, 0.1, 0.06],
    ];

    include!("vectors.rs");

    fn holds(curve: Curve, codes_of: &[[f32; 3]; 19], tolerance: f32) {
        let tone = published(curve);
        for (input, expected) in INPUTS.iter().zip(codes_of) {
            let got = codes(tone.apply(Vec3::from(*input)));
            let worst = got.iter().zip(expected).map(|(a, b)| (a - b.clamp(0.0, 1.0)).abs()).fold(0.0, f32::max);
            assert!(worst < tolerance, "{curve:?} {input:?}: {got:?}, published {expected:?}");
        }
    }

    #[test]
    fn aces_1_3_agrees_with_opencolorio() {
        holds(Curve::Aces13, &ACES_13, 1e-3);
    }

    #[test]
    fn aces_2_0_agrees_with_opencolorio() {
        holds(Curve::Aces20, &ACES_20, 1e-3);
    }

    #[test]
    fn agx_agrees_with_its_publication() {
        holds(Curve::Agx, &AGX, 1e-3);
        let grey = published(Curve::Agx).apply(Vec3::splat(0.18)).y;
        assert!((srgb_encode(grey) - 0.5).abs() < 1e-4, "{}", srgb_encode(grey));
    }

    #[test]
    fn closed_forms_are_exact() {
        let at = |curve, v: f32| published(curve).apply(Vec3::splat(v)).y;
        for v in [0.01f32, 0.18, 1.0, 7.0] {
            assert!((at(Curve::Reinhard, v) - v / (1.0 + v)).abs() < 1e-6);
            assert!((at(Curve::ReinhardLuminance, v) - v / (1.0 + v)).abs() < 1e-5);
            assert!((at(Curve::ReinhardExtended, v) - (v * (1.0 + v / 16.0) / (1.0 + v)).min(1.0)).abs() < 1e-5);
        }
        // Khronos PBR Neutral, from its formula in double precision.
        for (v, expected) in [(0.18, 0.14), (0.5, 0.46), (1.0, 0.869_091), (4.0, 0.983_256), (16.0, 0.996_269)] {
            assert!((at(Curve::Neutral, v) - expected).abs() < 1e-5, "{v} {}", at(Curve::Neutral, v));
        }
        let red = published(Curve::Neutral).apply(Vec3::new(4.0, 0.0, 0.0));
        assert!((red - Vec3::new(0.98345, 0.30637, 0.30637)).length() < 1e-4, "{red}");
        // Hable with the constants and the exposure bias of 2 of his article, and Hejl & Burgess-Dawson, in double precision.
        for (v, hable, hejl) in [(0.18, 0.128_338, 0.508_028), (0.5, 0.304_301, 0.730_204), (1.0, 0.492_919, 0.841_188)] {
            assert!((at(Curve::Hable, v) - hable).abs() < 1e-5, "{}", at(Curve::Hable, v));
            assert!((at(Curve::Hejl, v) - srgb_decode(hejl)).abs() < 1e-5, "{}", at(Curve::Hejl, v));
        }
    }
}
