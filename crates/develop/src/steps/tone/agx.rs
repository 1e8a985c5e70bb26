//! AgX, the original: Troy Sobotka's configuration for OpenColorIO (github.com/sobotka/AgX), whose middle grey is the code 0.5.
//!
//! Scene light goes through a matrix that pulls primaries towards white, is taken to logarithms from −10 to +6.5 stops about middle grey, and
//! through a sigmoid of slope 2 with a toe of power 3 and a shoulder of power 3.25. The result is a display code. Other AgX (Blender's, Filament's,
//! three.js's) have other matrices, slopes or an outset after the curve.

use super::{Asked, LUMA, Rendering, Table};
use diopter_light::color::srgb_decode;
use glam::{Mat3, Vec3};

/// Rows of the matrix.
const INSET: [f32; 9] = [
    0.842_479_06,
    0.078_433_6,
    0.079_223_745, //
    0.042_328_24,
    0.878_468_64,
    0.079_166_13, //
    0.042_375_655,
    0.078_433_6,
    0.879_142_97,
];
/// log2 of the light at code 0 and 1 of the sigmoid: 0.18 · 2^−10 and 0.18 · 2^6.5.
const RANGE: [f32; 2] = [-12.473_931, 4.026_069];
/// Place of middle grey between them, and its code.
const PIVOT: [f64; 2] = [10.0 / 16.5, 0.5];
const SLOPE: f64 = 2.0;
const TOE_POWER: f64 = 3.0;
const SHOULDER_POWER: f64 = 3.25;

/// The curve without a look.
pub struct Agx {
    inset: Mat3,
    sigmoid: Table,
}

impl Agx {
    /// Display codes.
    fn codes(&self, scene: Vec3) -> Vec3 {
        let c = self.inset * scene.max(Vec3::ZERO);
        c.map(|v| self.sigmoid.at((v.max(1e-10).log2() - RANGE[0]) / (RANGE[1] - RANGE[0])))
    }
}

impl Rendering for Agx {
    fn new(_: &Asked) -> Self {
        Agx { inset: Mat3::from_cols_array(&INSET).transpose(), sigmoid: Table::new(0.0, 1.0, 4097, sigmoid) }
    }

    #[inline]
    fn at(&self, scene: Vec3) -> Vec3 {
        self.codes(scene).map(srgb_decode)
    }
}

/// More contrast and colour: power 1.35, saturation 1.4.
pub struct Punchy(Agx);

impl Rendering for Punchy {
    fn new(asked: &Asked) -> Self {
        Punchy(Agx::new(asked))
    }

    #[inline]
    fn at(&self, scene: Vec3) -> Vec3 {
        let code = self.0.codes(scene).map(|v| v.max(0.0).powf(1.35));
        let luma = Vec3::splat(code.dot(LUMA));
        (luma + (code - luma) * 1.4).clamp(Vec3::ZERO, Vec3::ONE).map(srgb_decode)
    }
}

/// The curve from logarithm to code, both 0 to 1.
fn sigmoid(x: f64) -> f64 {
    let (power, sx, sy, sign) = match x >= PIVOT[0] {
        true => (SHOULDER_POWER, 1.0 - PIVOT[0], 1.0 - PIVOT[1], 1.0),
        false => (TOE_POWER, PIVOT[0], PIVOT[1], -1.0),
    };
    let scale = sign * ((SLOPE * sx).powf(-power) * ((SLOPE * sx / sy).powf(power) - 1.0)).powf(-1.0 / power);
    let t = SLOPE * (x - PIVOT[0]) / scale;
    PIVOT[1] + scale * t / (1.0 + t.powf(power)).powf(1.0 / power)
}
