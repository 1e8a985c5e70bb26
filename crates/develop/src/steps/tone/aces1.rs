//! ACES 1.x: the reference rendering (RRT) with the output transform for sRGB displays, and Hill's fit of the two.
//!
//! Sources: AMPAS, aces-dev 1.3, RRT and ODT.Academy.sRGB_100nits_dim (constants and formulas of the CTL transforms); Hill's fit as given in
//! BakingLab, ACES.hlsl. Light is linear Rec.709.

use super::{Asked, Rendering, Table};
use diopter_light::color::{ACES_XY, AP0_PRIMARIES, RgbSpace, xyz_from_primaries};
use glam::{Mat3, Vec3};

/// Hill's fit.
pub struct Fit;

impl Rendering for Fit {
    fn new(_: &Asked) -> Self {
        Fit
    }

    #[inline]
    fn at(&self, scene: Vec3) -> Vec3 {
        const INTO: Mat3 =
            Mat3::from_cols_array(&[0.59719, 0.07600, 0.02840, 0.35458, 0.90834, 0.13383, 0.04823, 0.01566, 0.83777]);
        const OUT: Mat3 =
            Mat3::from_cols_array(&[1.60475, -0.10208, -0.00327, -0.53108, 1.10813, -0.07276, -0.07367, -0.00605, 1.07602]);
        let v = INTO * scene.max(Vec3::ZERO);
        let v = (v * (v + 0.024_578_6) - 0.000_090_537) / (v * (0.983_729 * v + 0.432_951) + 0.238_081);
        (OUT * v).clamp(Vec3::ZERO, Vec3::ONE)
    }
}

/// AP1 luminance.
const AP1_Y: Vec3 = Vec3::new(0.272_228_72, 0.674_081_8, 0.053_689_52);

const GLOW_GAIN: f32 = 0.05;
const GLOW_MID: f32 = 0.08;
const RED_SCALE: f32 = 0.82;
const RED_PIVOT: f32 = 0.03;
/// Degrees of hue about red.
const RED_WIDTH: f32 = 135.0;
const RRT_SATURATION: f32 = 0.96;
const ODT_SATURATION: f32 = 0.93;
/// Exponent for a dim surround instead of a dark one.
const DIM_GAMMA: f32 = 0.9811;
const CINEMA_WHITE: f64 = 48.0;
const CINEMA_BLACK: f64 = 0.02;

/// log2 of the light between which the curve is tabulated.
const TABLE_RANGE: (f32, f32) = (-24.0, 20.0);

/// The transform made ready.
pub struct Tables {
    ap0_from_srgb: Mat3,
    ap1_from_ap0: Mat3,
    srgb_from_ap1: Mat3,
    /// Display light (0 to 1 of cinema white) over log2 of AP1 light.
    curve: Table,
    /// What light of nothing is shown as.
    black: f32,
}

impl Rendering for Tables {
    fn new(_: &Asked) -> Self {
        let ap0 = xyz_from_primaries(AP0_PRIMARIES, ACES_XY);
        let srgb_to_xyz = RgbSpace::AcesCg.xyz_from_rgb() * RgbSpace::AcesCg.from_space(RgbSpace::Srgb);
        let ap1 = RgbSpace::AcesCg.xyz_from_rgb();
        let odt = Odt::new();
        let shown = |light: f64| (odt.at(rrt(light)) - CINEMA_BLACK) / (CINEMA_WHITE - CINEMA_BLACK);
        Tables {
            ap0_from_srgb: (ap0.inverse() * srgb_to_xyz).as_mat3(),
            ap1_from_ap0: (ap1.inverse() * ap0).as_mat3(),
            srgb_from_ap1: RgbSpace::Srgb.from_space(RgbSpace::AcesCg).as_mat3(),
            curve: Table::new(TABLE_RANGE.0, TABLE_RANGE.1, 16_385, |l| shown(l.exp2())),
            black: shown(0.0) as f32,
        }
    }

    fn at(&self, scene: Vec3) -> Vec3 {
        let aces = red_modified(glowing(self.ap0_from_srgb * scene));
        let ap1 = (self.ap1_from_ap0 * aces.clamp(Vec3::ZERO, Vec3::splat(65_504.0))).clamp(Vec3::ZERO, Vec3::splat(65_504.0));
        let v = saturated(ap1, RRT_SATURATION);
        let v = v.map(|x| if x > 0.0 { self.curve.at(x.log2()) } else { self.black });
        // From a dark surround to a dim one: luminance to a power, at the same chromaticity.
        let y = v.dot(AP1_Y).max(1e-10);
        let v = v * y.powf(DIM_GAMMA - 1.0);
        (self.srgb_from_ap1 * saturated(v, ODT_SATURATION)).clamp(Vec3::ZERO, Vec3::ONE)
    }
}

fn saturated(c: Vec3, s: f32) -> Vec3 {
    Vec3::splat(c.dot(AP1_Y)).lerp(c, s)
}

fn saturation(c: Vec3) -> f32 {
    (c.max_element().max(1e-10) - c.min_element().max(1e-10)) / c.max_element().max(1e-2)
}

/// The RRT's glow: dark saturated colours are lifted a little.
fn glowing(c: Vec3) -> Vec3 {
    let s = saturation(c);
    // Luminance that counts chroma as light.
    let chroma = (c.z * (c.z - c.y) + c.y * (c.y - c.x) + c.x * (c.x - c.z)).max(0.0).sqrt();
    let yc = (c.element_sum() + 1.75 * chroma) / 3.0;
    let x = (s - 0.4) / 0.2;
    let t = (1.0 - (x / 2.0).abs()).max(0.0);
    let sigmoid = (1.0 + x.signum() * (1.0 - t * t)) / 2.0;
    let gain = GLOW_GAIN * sigmoid;
    let added = if yc <= 2.0 / 3.0 * GLOW_MID {
        gain
    } else if yc >= 2.0 * GLOW_MID {
        0.0
    } else {
        gain * (GLOW_MID / yc - 0.5)
    };
    c * (1.0 + added)
}

/// The RRT's red modifier: saturated reds are darkened.
fn red_modified(c: Vec3) -> Vec3 {
    let hue = if c.x == c.y && c.y == c.z { 0.0 } else { (3f32.sqrt() * (c.y - c.z)).atan2(2.0 * c.x - c.y - c.z).to_degrees() };
    let weight = cubic_basis(hue, RED_WIDTH);
    let mut out = c;
    out.x += weight * saturation(c) * (RED_PIVOT - c.x) * (1.0 - RED_SCALE);
    out
}

/// A bump of cubic pieces, 1 at 0, of the given width.
fn cubic_basis(x: f32, width: f32) -> f32 {
    const M: [[f32; 4]; 4] = [
        [-1.0 / 6.0, 3.0 / 6.0, -3.0 / 6.0, 1.0 / 6.0],
        [3.0 / 6.0, -1.0, 3.0 / 6.0, 0.0],
        [-3.0 / 6.0, 0.0, 3.0 / 6.0, 0.0],
        [1.0 / 6.0, 4.0 / 6.0, 1.0 / 6.0, 0.0],
    ];
    if x <= -width / 2.0 || x >= width / 2.0 {
        return 0.0;
    }
    let place = (x + width / 2.0) * 4.0 / width;
    let j = (place as usize).min(3);
    let t = place - j as f32;
    let column = 3 - j;
    let powers = [t * t * t, t * t, t, 1.0];
    1.5 * (0..4).map(|k| powers[k] * M[k][column]).sum::<f32>()
}

/// Quadratic B-spline through its coefficients, in logarithms.
fn spline(coefficients: &[f64], place: f64) -> f64 {
    let last = coefficients.len() - 3;
    let j = (place.max(0.0) as usize).min(last);
    let t = place - j as f64;
    let [a, b, c] = [coefficients[j], coefficients[j + 1], coefficients[j + 2]];
    t * t * (0.5 * a - b + 0.5 * c) + t * (b - a) + 0.5 * (a + b)
}

/// The tone scale of the RRT: light to OCES.
fn rrt(x: f64) -> f64 {
    const LOW: [f64; 6] = [-4.0, -4.0, -3.157_376_577_3, -0.485_249_995_8, 1.847_732_470_6, 1.847_732_470_6];
    const HIGH: [f64; 6] = [-0.718_548_242_5, 2.081_030_717_2, 3.668_124_123_7, 4.0, 4.0, 4.0];
    let (min, mid, max) = ((0.18 * (-15f64).exp2()).log10(), 0.18f64.log10(), (0.18 * 18f64.exp2()).log10());
    let l = x.max(1e-38).log10();
    let y = if l <= min {
        0.0001f64.log10()
    } else if l < mid {
        spline(&LOW, 3.0 * (l - min) / (mid - min))
    } else if l < max {
        spline(&HIGH, 3.0 * (l - mid) / (max - mid))
    } else {
        10_000f64.log10()
    };
    10f64.powf(y)
}

/// The tone scale of the output transform: OCES to cinema luminance, cd/m².
struct Odt {
    min: f64,
    mid: f64,
    max: f64,
}

impl Odt {
    fn new() -> Self {
        let at = |stops: f64| rrt(0.18 * stops.exp2()).log10();
        Odt { min: at(-6.5), mid: at(0.0), max: at(6.5) }
    }

    fn at(&self, x: f64) -> f64 {
        const LOW: [f64; 10] = [
            -1.698_970_004_3,
            -1.698_970_004_3,
            -1.477_9,
            -1.229_1,
            -0.864_8,
            -0.448,
            0.005_18,
            0.451_108_033_4,
            0.911_374_441_4,
            0.911_374_441_4,
        ];
        const HIGH: [f64; 10] = [
            0.515_438_696_5,
            0.847_043_778_3,
            1.135_8,
            1.380_2,
            1.519_7,
            1.598_5,
            1.646_7,
            1.674_609_135_7,
            1.687_873_339,
            1.687_873_339,
        ];
        const HIGH_SLOPE: f64 = 0.04;
        let l = x.max(1e-38).log10();
        let y = if l <= self.min {
            CINEMA_BLACK.log10()
        } else if l < self.mid {
            spline(&LOW, 7.0 * (l - self.min) / (self.mid - self.min))
        } else if l < self.max {
            spline(&HIGH, 7.0 * (l - self.mid) / (self.max - self.mid))
        } else {
            l * HIGH_SLOPE + (CINEMA_WHITE.log10() - HIGH_SLOPE * self.max)
        };
        10f64.powf(y)
    }
}
