//! The colour steps that change each pixel by itself: tone curve, grading, look-up table. They can be baked into one table.

use crate::lut::{self, Lut};
use crate::recipe::{Curve, Interpolation, LutInput, Recipe};
use crate::steps::encode::{open_codes, open_light, srgb_codes, srgb_light};
use crate::steps::grade::Grading;
use crate::steps::tone::ToneCurve;
use diopter_image::Encoding;
use diopter_light::color::{D65_XY, RgbSpace, delta_e_2000, lab, srgb_encode, xyz_from_xy};
use glam::{Mat3, Vec3};

/// From the light of the scene (linear Rec.709, middle grey 0.18) to that of a display.
pub struct Look {
    tone: ToneCurve,
    grading: Option<Grading>,
    lut: Option<Table>,
    /// Code of the brightest light.
    top: f32,
}

struct Table {
    lut: Lut,
    input: LutInput,
    interpolation: Interpolation,
    amount: f32,
    ap1_from_srgb: Mat3,
}

/// How far a part of the look is carried out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Until {
    /// The tone curve alone.
    Tone,
    /// With grading.
    Grade,
    /// All.
    Lut,
}

impl Look {
    /// Prepares the colour steps of a recipe. `lut`: what its `lut.file` holds.
    pub fn new(recipe: &Recipe, lut: Option<Lut>) -> Self {
        let peak = match recipe.output.encoding {
            Encoding::Linear => f32::INFINITY,
            e if e.is_hdr() => recipe.output.peak as f32,
            _ => 1.0,
        };
        let step = &recipe.lut;
        Look {
            tone: ToneCurve::new(&recipe.tone, peak, crate::steps::encode::space(recipe.output.space)),
            grading: Grading::new(&recipe.grade),
            lut: lut.map(|lut| Table {
                lut,
                input: step.input,
                interpolation: step.interpolation,
                amount: step.amount as f32,
                ap1_from_srgb: RgbSpace::AcesCg.from_space(RgbSpace::Srgb).as_mat3(),
            }),
            top: if peak > 1.0 { srgb_encode(peak) } else { 1.0 },
        }
    }

    /// Light of the display, linear Rec.709 (1 = white), for light of the scene, linear Rec.709 (0.18 = middle grey).
    #[inline]
    pub fn apply(&self, scene: Vec3) -> Vec3 {
        self.apply_until(scene, Until::Lut)
    }

    /// Light of the display after some of the steps. Both as for [`Look::apply`].
    pub fn apply_until(&self, scene: Vec3, until: Until) -> Vec3 {
        let shown = self.tone.apply(scene);
        if self.grading.is_none() && self.lut.is_none() || until == Until::Tone {
            return shown;
        }
        let graded = match &self.grading {
            Some(g) => open_light(g.apply(open_codes(shown), self.top)),
            None => shown,
        };
        match &self.lut {
            Some(table) if until == Until::Lut => table.apply(scene, graded),
            _ => graded,
        }
    }
}

impl Table {
    fn apply(&self, scene: Vec3, shown: Vec3) -> Vec3 {
        let at = |c: Vec3| self.lut.at(c, self.interpolation);
        let looked = match self.input {
            // What lies beyond the table goes on as far beyond as it was.
            LutInput::Srgb => {
                let codes = open_codes(shown);
                let inside = codes.clamp(Vec3::ZERO, Vec3::ONE);
                open_light(at(inside) + (codes - inside))
            }
            LutInput::Linear => at(shown),
            LutInput::Acescct => srgb_light(at((self.ap1_from_srgb * scene).map(lut::acescct_code))),
            LutInput::Log => srgb_light(at(scene.map(lut::log_code))),
        };
        if self.amount == 1.0 { looked } else { shown.lerp(looked, self.amount) }
    }
}

/// A baked look and how far it lies off the steps themselves.
#[derive(Clone, Debug)]
pub struct Baked {
    /// The table.
    pub lut: Lut,
    /// ΔE2000 of the mean and of the worst of many colours.
    pub mean: f64,
    /// The worst.
    pub worst: f64,
}

/// Bakes exposure, tone curve, grading and table of a recipe into one 3D table of `size` points a side (2 to 256) for `input` codes, which gives sRGB codes; of linear
/// light, linear light.
pub fn bake(recipe: &Recipe, lut: Option<Lut>, size: usize, input: LutInput) -> Baked {
    let sdr = Recipe { output: crate::recipe::Output::default(), ..recipe.clone() };
    let look = Look::new(&sdr, lut);
    let brighten = recipe.exposure.ev.exp2() as f32;
    let srgb_from_ap1 = RgbSpace::Srgb.from_space(RgbSpace::AcesCg).as_mat3();
    let ap1_from_srgb = RgbSpace::AcesCg.from_space(RgbSpace::Srgb).as_mat3();
    let light = |code: Vec3| match input {
        LutInput::Srgb => code.map(diopter_light::color::srgb_decode),
        LutInput::Linear => code,
        LutInput::Acescct => srgb_from_ap1 * code.map(lut::acescct_light),
        LutInput::Log => code.map(lut::log_light),
    };
    let codes = |scene: Vec3| match input {
        LutInput::Srgb => srgb_codes(scene),
        LutInput::Linear => scene,
        LutInput::Acescct => (ap1_from_srgb * scene).map(lut::acescct_code),
        LutInput::Log => scene.map(lut::log_code),
    };
    let is_light = input == LutInput::Linear;
    let direct = |scene: Vec3| {
        let light = look.apply(scene * brighten);
        if is_light { light.clamp(Vec3::ZERO, Vec3::ONE) } else { srgb_codes(light) }
    };
    let title = format!("diopter: {} from {}", curve_name(recipe.tone.curve), input_name(input));
    let lut = Lut::from_function(&title, size, |c| direct(light(c)));
    // Colours of the scene, surfaces of all hues from seven stops below middle grey to where the input ends.
    let brightest: f32 = match input {
        LutInput::Srgb | LutInput::Linear => 1.0,
        LutInput::Acescct | LutInput::Log => 16.0,
    };
    let white = xyz_from_xy(D65_XY);
    let to_lab = |code: Vec3| {
        let light = if is_light { code } else { code.map(diopter_light::color::srgb_decode) }.as_dvec3();
        lab(RgbSpace::Srgb.xyz_from_rgb() * light, white)
    };
    let (mut sum, mut worst, mut count) = (0.0, 0.0f64, 0.0);
    for i in 0..20_000u32 {
        // Points of a low-discrepancy sequence (Roberts 2018, R4).
        let at = |k: i32| (0.5 + f64::from(i) * 1.167_303_978_261_418_7f64.powi(-k)).fract() as f32;
        let brightness = 0.18 / 128.0 * (brightest / (0.18 / 128.0)).powf(at(1));
        // A fifth lies outside Rec.709, as saturated colours of cameras do.
        let low = if i % 5 == 0 { -0.15 } else { 0.0 };
        let colour = Vec3::new(at(2), at(3), at(4)) * (1.0 - low) + low;
        if colour.max_element() < 0.3 {
            continue;
        }
        let scene = colour / colour.max_element() * brightness;
        let e = delta_e_2000(to_lab(lut.at(codes(scene), recipe.lut.interpolation)), to_lab(direct(scene)));
        sum += e;
        worst = worst.max(e);
        count += 1.0;
    }
    Baked { lut, mean: sum / count, worst }
}

fn curve_name(curve: Curve) -> String {
    let recipe = Recipe { tone: crate::recipe::Tone { curve, ..Default::default() }, ..Recipe::default() };
    recipe.value("tone.curve")
}

fn input_name(input: LutInput) -> &'static str {
    match input {
        LutInput::Srgb => "sRGB codes",
        LutInput::Linear => "linear light",
        LutInput::Acescct => "ACEScct",
        LutInput::Log => "log codes",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recipe::{Grade, Tone};

    #[test]
    fn the_default_look_can_be_baked() {
        for input in [LutInput::Log, LutInput::Acescct] {
            let baked = bake(&Recipe::default(), None, 33, input);
            // A table over ACEScct has few points where light is dark and out of gamut: there single colours are far off.
            let worst = if input == LutInput::Log { 2.0 } else { 25.0 };
            assert!(baked.mean < 0.5 && baked.worst < worst, "{input:?}: mean {} worst {}", baked.mean, baked.worst);
        }
    }

    #[test]
    fn grading_keeps_light_above_white() {
        let mut recipe = Recipe { grade: Grade { saturation: 1.01, ..Grade::default() }, ..Recipe::default() };
        recipe.output.encoding = Encoding::Pq;
        recipe.tone.curve = Curve::Linear;
        let light = Look::new(&recipe, None).apply(Vec3::splat(3.0));
        assert!((light.y - 3.0).abs() < 0.01, "{light}");
        // A table of codes that changes nothing leaves what is brighter than it knows.
        recipe.grade = Grade::default();
        let plain = Lut::from_function("nothing", 17, |c| c);
        let light = Look::new(&recipe, Some(plain)).apply(Vec3::new(3.0, 0.5, 0.18));
        assert!((light - Vec3::new(3.0, 0.5, 0.18)).length() < 0.01, "{light}");
    }

    #[test]
    fn a_baked_table_takes_the_place_of_curve_and_grading() {
        let recipe = Recipe {
            tone: Tone { curve: Curve::Agx, ..Tone::default() },
            grade: Grade { saturation: 1.2, ..Grade::default() },
            ..Recipe::default()
        };
        // Of the whole scene, or of a picture that no curve has changed before.
        for (input, curve) in [(LutInput::Log, Curve::Agx), (LutInput::Srgb, Curve::Linear), (LutInput::Linear, Curve::Linear)] {
            let baked = bake(&recipe, None, 33, input);
            let mut with = Recipe { tone: Tone { curve, ..Tone::default() }, ..Recipe::default() };
            with.lut.input = input;
            let (direct, table) = (Look::new(&recipe, None), Look::new(&with, Some(baked.lut)));
            // Linear light has few points where it is dark.
            let most = if input == LutInput::Linear { 0.05 } else { 0.02 };
            for scene in [Vec3::splat(0.18), Vec3::new(0.5, 0.2, 0.05), Vec3::new(0.04, 0.1, 0.9)] {
                let off = (srgb_codes(direct.apply(scene)) - srgb_codes(table.apply(scene))).length();
                assert!(off < most, "{input:?} {scene}: {off}");
            }
        }
    }
}
