//! ACES 2.0 output transform: tone scale, chroma compression and gamut compression in a colour appearance model.
//!
//! Source: AMPAS, "ACES 2.0 Output Transforms" (CTL, aces-output v2.0), whose figures and formulas are followed; checked against OpenColorIO. The
//! model is CAM16 after Hellwig & Fairchild 2022, in JMh: lightness, colourfulness, hue (degrees). Tables over hue are finer than the reference's
//! and therefore not placed at the corners of the gamut.

use super::{Asked, Rendering};
use diopter_image::encoding::HDR_WHITE_NITS;
use diopter_light::color::{ACES_XY, AP0_PRIMARIES, RgbSpace, xyz_from_primaries};
use glam::{DMat3, DVec3, Mat3, Vec3};

/// cd/m² of light 1.0.
const REFERENCE: f32 = 100.0;
/// Points of the tables over hue.
const HUES: usize = 1440;

// The appearance model: adapting luminance, background, dim surround.
const ADAPTING: f64 = 100.0;
const BACKGROUND: f64 = 20.0;
const SURROUND_C: f64 = 0.59;
const SURROUND_NC: f64 = 0.9;
const CONE_OFFSET: f32 = 0.2713 * 100.0;
const CONE_POWER: f32 = 0.42;

// Chroma compression.
const COMPRESSION: (f32, f32) = (2.4, 3.3);
const EXPANSION: (f32, f32) = (1.3, 0.69);
const EXPANSION_THRESHOLD: f32 = 0.5;

// Gamut compression.
const SMOOTH_CUSPS: f32 = 0.12;
const SMOOTH_M: f32 = 0.27;
const CUSP_MID_BLEND: f32 = 1.3;
const FOCUS_GAIN_BLEND: f32 = 0.3;
const FOCUS_DISTANCE: (f32, f32) = (1.35, 1.75);
const GAMUT_THRESHOLD: f32 = 0.75;

/// J = 100 A^cz.
fn cz() -> f32 {
    (SURROUND_C * (1.48 + (BACKGROUND / 100.0).sqrt())) as f32
}

/// Cone response of light; odd about 0.
fn compressed(v: f32) -> f32 {
    let f = v.abs().powf(CONE_POWER);
    (f / (CONE_OFFSET + f)).copysign(v)
}

/// Light of a cone response.
fn expanded(v: f32) -> f32 {
    let limited = v.abs().min(0.99);
    (CONE_OFFSET * limited / (1.0 - limited)).powf(1.0 / CONE_POWER).copysign(v)
}

/// The model for a set of primaries, adapted to their white.
struct Model {
    cones_from_rgb: Mat3,
    rgb_from_cones: Mat3,
    opponent_from_cones: Mat3,
    cones_from_opponent: Mat3,
    fl: f32,
    /// Response to the adapting luminance.
    white: f32,
    cz: f32,
}

impl Model {
    fn new(xyz_from_rgb: DMat3) -> Self {
        let cam16 = xyz_from_primaries([(0.8336, 0.1735), (2.3854, -1.4659), (0.087, -0.125)], (0.333, 0.333));
        let to_cones = cam16.inverse();
        let k = 1.0 / (5.0 * ADAPTING + 1.0);
        let k4 = k.powi(4);
        let fl = 0.2 * k4 * 5.0 * ADAPTING + 0.1 * (1.0 - k4).powi(2) * (5.0 * ADAPTING).cbrt();
        let n = fl / f64::from(REFERENCE);
        let white = xyz_from_rgb * DVec3::ONE * f64::from(REFERENCE);
        let white_cones = to_cones * white;
        let gain = DVec3::splat(n * white.y) / white_cones;
        let adapted = (gain * white_cones).as_vec3();
        let base = DMat3::from_cols_array(&[
            2.0,
            1.0,
            1.0 / 20.0, //
            1.0,
            -12.0 / 11.0,
            1.0 / 11.0, //
            1.0 / 9.0,
            1.0 / 9.0,
            -2.0 / 9.0,
        ])
        .transpose()
            * 400.0;
        let response = adapted.map(compressed).as_dvec3();
        let achromatic = base.row(0).dot(response);
        let scale = 43.0 * SURROUND_NC;
        let opponent = DMat3::from_cols(base.row(0) / achromatic, base.row(1) * scale, base.row(2) * scale).transpose();
        let cones = DMat3::from_diagonal(gain) * to_cones * xyz_from_rgb * f64::from(REFERENCE);
        Model {
            cones_from_rgb: cones.as_mat3(),
            rgb_from_cones: cones.inverse().as_mat3(),
            opponent_from_cones: opponent.as_mat3(),
            cones_from_opponent: opponent.inverse().as_mat3(),
            fl: n as f32,
            white: compressed(fl as f32),
            cz: cz(),
        }
    }

    /// Achromatic response and two opponent ones.
    fn opponent(&self, rgb: Vec3) -> Vec3 {
        self.opponent_from_cones * (self.cones_from_rgb * rgb).map(compressed)
    }

    /// Lightness, colourfulness, hue.
    fn jmh(&self, rgb: Vec3) -> Vec3 {
        self.jmh_of(self.opponent(rgb))
    }

    fn jmh_of(&self, o: Vec3) -> Vec3 {
        if o.x <= 0.0 {
            return Vec3::ZERO;
        }
        let hue = o.z.atan2(o.y).to_degrees();
        Vec3::new(100.0 * o.x.powf(self.cz), o.y.hypot(o.z), if hue < 0.0 { hue + 360.0 } else { hue })
    }

    fn rgb(&self, jmh: Vec3) -> Vec3 {
        let (sin, cos) = jmh.z.to_radians().sin_cos();
        let o = Vec3::new((jmh.x / 100.0).powf(1.0 / self.cz), jmh.y * cos, jmh.y * sin);
        self.rgb_from_cones * (self.cones_from_opponent * o).map(expanded)
    }

    /// Luminance of a grey of an achromatic response, cd/m².
    fn luminance(&self, achromatic: f32) -> f32 {
        expanded(self.white * achromatic) / self.fl
    }

    /// Lightness of a grey of a luminance.
    fn lightness(&self, luminance: f32) -> f32 {
        let a = compressed(luminance.abs() * self.fl) / self.white;
        (100.0 * a.powf(self.cz)).copysign(luminance)
    }
}

/// The tone scale: luminance of the scene to that of a display, cd/m².
struct ToneScale {
    power: f32,
    flare: f32,
    s2: f32,
    m2: f32,
    /// Luminance of middle grey on the display, of the reference.
    grey: f32,
    /// log10 of the peak over the reference.
    log_peak: f32,
    /// Brightest light of the scene that is told apart.
    input_limit: f32,
}

impl ToneScale {
    fn new(peak: f64) -> Self {
        let (power, grey_in, grey_out, grey_growth, flare) = (1.15, 0.18, 10.013, 0.14, 0.04);
        let solve = |v: f64| 0.5 * (v + (v * (v + 4.0 * flare)).sqrt());
        let roof = 128.0 + (896.0 - 128.0) * ((peak / 100.0).ln() / 100f64.ln());
        let m1 = solve(peak / 100.0);
        let u = ((roof / m1) / (roof / m1 + 1.0)).powf(power);
        let m = m1 / u;
        let grey = grey_out / 100.0 * (1.0 + (peak / 100.0).log2() * grey_growth);
        let g = (solve(grey) / m).powf(1.0 / power);
        let w2 = grey_in / -(m1 * g / (g - 1.0));
        let u2 = ((roof / m1) / (roof / m1 + w2)).powf(power);
        ToneScale {
            power: power as f32,
            flare: flare as f32,
            s2: (w2 * m1 * 100.0) as f32,
            m2: (m1 / u2) as f32,
            grey: grey as f32,
            log_peak: (peak / 100.0).log10() as f32,
            input_limit: (8.0 * roof) as f32,
        }
    }

    fn at(&self, luminance: f32) -> f32 {
        let f = self.m2 * (luminance / (luminance + self.s2)).max(0.0).powf(self.power);
        (f * f / (f + self.flare)).max(0.0) * REFERENCE
    }
}

/// What the gamut of the display is at a hue.
#[derive(Clone, Copy, Default)]
struct Cusp {
    j: f32,
    m: f32,
    /// 1 / exponent of the upper hull.
    top: f32,
}

/// The transform made ready for a display.
pub struct Transform {
    ap1_from_srgb: Mat3,
    ap0_from_ap1: Mat3,
    input: Model,
    limit: Model,
    tone: ToneScale,
    /// Lightness of the peak.
    j_max: f32,
    mid_j: f32,
    focus_distance: f32,
    lower_hull: f32,
    chroma_scale: f32,
    compression: f32,
    expansion: f32,
    threshold: f32,
    /// Largest colourfulness of AP1 at the peak's lightness, by hue.
    reach: Vec<f32>,
    cusps: Vec<Cusp>,
    /// Light of the display, in its whites.
    peak: f32,
    /// From the display's primaries, in units of the reference, to linear sRGB in whites.
    out: Mat3,
}

impl Rendering for Transform {
    const KNOWS_PEAK: bool = true;

    /// Without a brighter display: 100 cd/m² and Rec.709 primaries.
    fn new(asked: &Asked) -> Self {
        let white = f64::from(HDR_WHITE_NITS);
        match asked.brighter_peak() {
            Some(peak) => Transform::for_display(f64::from(peak) * white, asked.gamut, white),
            None => Transform::for_display(100.0, RgbSpace::Srgb, 100.0),
        }
    }

    fn at(&self, scene: Vec3) -> Vec3 {
        let ap1 = (self.ap1_from_srgb * scene).clamp(Vec3::ZERO, Vec3::splat(self.tone.input_limit));
        let o = self.input.opponent(self.ap0_from_ap1 * ap1);
        let jmh = self.input.jmh_of(o);
        let j_toned = self.input.lightness(self.tone.at(self.input.luminance(o.x.max(0.0))));
        let reach = lerp_table(&self.reach, jmh.z);
        let toned = self.compress_chroma(jmh, j_toned, reach);
        let inside = self.compress_gamut(toned, reach);
        self.out * self.limit.rgb(inside).clamp(Vec3::ZERO, Vec3::splat(self.peak))
    }
}

impl Transform {
    /// For a display of a peak luminance (cd/m²), limited to the gamut of a space; light comes out with 1 = `white` cd/m².
    fn for_display(peak: f64, gamut: RgbSpace, white: f64) -> Self {
        let ap0 = xyz_from_primaries(AP0_PRIMARIES, ACES_XY);
        let ap1 = RgbSpace::AcesCg.xyz_from_rgb();
        let (input, reach_model) = (Model::new(ap0), Model::new(ap1));
        let limit = Model::new(gamut.xyz_from_rgb());
        let tone = ToneScale::new(peak);
        let j_max = input.lightness(peak as f32);
        let mut t = Transform {
            ap1_from_srgb: RgbSpace::AcesCg.from_space(RgbSpace::Srgb).as_mat3(),
            ap0_from_ap1: (ap0.inverse() * ap1).as_mat3(),
            mid_j: input.lightness(tone.grey * REFERENCE),
            focus_distance: FOCUS_DISTANCE.0 * (1.0 + FOCUS_DISTANCE.1 * tone.log_peak),
            lower_hull: 1.0 / (1.14 + 0.07 * tone.log_peak),
            chroma_scale: (0.03379 * peak as f32).powf(0.30596) - 0.45135,
            compression: COMPRESSION.0 * (1.0 + COMPRESSION.1 * tone.log_peak),
            expansion: (EXPANSION.0 * (1.0 - EXPANSION.1 * tone.log_peak)).max(0.2),
            threshold: EXPANSION_THRESHOLD / peak as f32,
            reach: Vec::new(),
            cusps: Vec::new(),
            peak: peak as f32 / REFERENCE,
            out: (RgbSpace::Srgb.from_space(gamut) * (f64::from(REFERENCE) / white)).as_mat3(),
            input,
            limit,
            tone,
            j_max,
        };
        let hue = |i: usize| i as f32 * 360.0 / HUES as f32;
        t.reach = (0..HUES).map(|i| largest_inside(&reach_model, j_max, hue(i))).collect();
        t.reach.push(t.reach[0]);
        t.cusps = cusps(&t.limit, t.peak);
        for i in 0..HUES {
            t.cusps[i].top = t.upper_hull(t.cusps[i], hue(i));
        }
        t.cusps.push(t.cusps[0]);
        t
    }

    fn compress_chroma(&self, jmh: Vec3, j: f32, reach: f32) -> Vec3 {
        if jmh.y == 0.0 {
            return Vec3::new(j, 0.0, jmh.z);
        }
        let norm = chroma_norm(jmh.z) * self.chroma_scale;
        let inv = 1.0 / cz();
        let n = j / self.j_max;
        let rest = (1.0 - n).max(0.0);
        let limit = n.powf(inv) * reach / norm;
        let m = jmh.y * (j / jmh.x).powf(inv) / norm;
        let m = limit - toe(limit - m, limit - 0.001, rest * self.expansion, (n * n + self.threshold).sqrt());
        let m = toe(m, limit, n * self.compression, rest);
        Vec3::new(j, m * norm, jmh.z)
    }

    fn compress_gamut(&self, jmh: Vec3, reach: f32) -> Vec3 {
        if jmh.x <= 0.0 {
            return Vec3::new(0.0, 0.0, jmh.z);
        }
        if jmh.y <= 0.0 || jmh.x > self.j_max {
            return Vec3::new(jmh.x, 0.0, jmh.z);
        }
        let place = jmh.z * (HUES as f32 / 360.0);
        let i = (place as usize).min(HUES - 1);
        let (a, b, t) = (self.cusps[i], self.cusps[i + 1], place - i as f32);
        let cusp = Cusp { j: a.j + t * (b.j - a.j), m: a.m + t * (b.m - a.m), top: a.top + t * (b.top - a.top) };
        let line = self.line(jmh.x, jmh.x, jmh.y, &cusp);
        let boundary = self.boundary(&line, &cusp);
        if boundary <= 0.0 {
            return Vec3::new(jmh.x, 0.0, jmh.z);
        }
        let reach = crossing(line.j0, line.slope, 1.0 / cz(), self.j_max, reach, self.j_max);
        let m = remapped(jmh.y, boundary, reach);
        Vec3::new(line.j0 + m * line.slope, m, jmh.z)
    }

    /// The line towards the focus along which a colour is compressed.
    fn line(&self, j_gain: f32, j: f32, m: f32, cusp: &Cusp) -> Line {
        let focus = cusp.j + (self.mid_j - cusp.j) * (CUSP_MID_BLEND - cusp.j / self.j_max).min(1.0);
        let threshold = cusp.j + (self.j_max - cusp.j) * FOCUS_GAIN_BLEND;
        let mut gain = self.j_max * self.focus_distance;
        if j_gain > threshold {
            let a = ((self.j_max - threshold) / (self.j_max - j_gain).max(0.0001)).log10();
            gain *= a * a + 1.0;
        }
        let j0 = meets_axis(j, m, focus, self.j_max, gain);
        let direction = if j0 < focus { j0 } else { self.j_max - j0 };
        Line { j0, slope: direction * (j0 - focus) / (focus * gain), j_cusp: meets_axis(cusp.j, cusp.m, focus, self.j_max, gain) }
    }

    /// Colourfulness where a line leaves the gamut of the display.
    fn boundary(&self, line: &Line, cusp: &Cusp) -> f32 {
        let lower = crossing(line.j0, line.slope, self.lower_hull, cusp.j, cusp.m, line.j_cusp);
        let upper = crossing(self.j_max - line.j0, -line.slope, cusp.top, self.j_max - cusp.j, cusp.m, self.j_max - line.j_cusp);
        // The smaller of the two, with a rounded edge.
        let width = SMOOTH_CUSPS * cusp.m;
        let h = (width - (lower - upper).abs()).max(0.0) / width;
        lower.min(upper) - h * h * h * width / 6.0
    }

    /// 1 / exponent of the upper hull at a hue: the smallest exponent with which it lies outside the gamut.
    fn upper_hull(&self, cusp: Cusp, hue: f32) -> f32 {
        let lines = [0.01f32, 0.1, 0.5, 0.8, 0.99].map(|p| {
            let j = cusp.j + (self.j_max - cusp.j) * p;
            self.line(j, j, cusp.m, &cusp)
        });
        let encloses = |gamma: f32| {
            let cusp = Cusp { top: 1.0 / gamma, ..cusp };
            lines.iter().all(|line| {
                let m = self.boundary(line, &cusp);
                self.limit.rgb(Vec3::new(line.j0 + line.slope * m, m, hue)).max_element() > self.peak
            })
        };
        let (mut low, mut high) = (0.0f32, 0.4f32);
        while high < 5.0 && !encloses(high) {
            low = high;
            high += 0.4;
        }
        while high - low > 1e-5 {
            let middle = 0.5 * (low + high);
            if encloses(middle) { high = middle } else { low = middle }
        }
        1.0 / high
    }
}

struct Line {
    /// Lightness where it meets the grey axis.
    j0: f32,
    slope: f32,
    /// Lightness where the line through the cusp does.
    j_cusp: f32,
}

/// Lightness on the grey axis of the line through (j, m) towards the focus.
fn meets_axis(j: f32, m: f32, focus: f32, j_max: f32, gain: f32) -> f32 {
    let m = m / gain;
    let a = m / focus;
    if j < focus {
        let b = 1.0 - m;
        2.0 * j / (b + (b * b + 4.0 * a * j).sqrt())
    } else {
        let b = -(1.0 + m + j_max * a);
        let c = j_max * m + j;
        -2.0 * c / (b - (b * b - 4.0 * a * c).sqrt())
    }
}

/// Colourfulness where a line meets a hull J = J_max (M / M_max)^(1/inv), approximately.
fn crossing(j0: f32, slope: f32, inv: f32, j_max: f32, m_max: f32, reference: f32) -> f32 {
    let shifted = reference * (j0 / reference).powf(inv);
    shifted * m_max / (j_max - slope * m_max)
}

/// Colourfulness compressed from the reach of AP1 into the gamut, above a threshold.
fn remapped(m: f32, gamut: f32, reach: f32) -> f32 {
    let proportion = (gamut / reach).max(GAMUT_THRESHOLD);
    let threshold = proportion * gamut;
    if m <= threshold || proportion >= 1.0 {
        return m;
    }
    let (m, gamut, reach) = (m - threshold, gamut - threshold, reach - threshold);
    let scale = reach / (reach / gamut - 1.0);
    let x = m / scale;
    threshold + scale * x / (1.0 + x)
}

fn toe(x: f32, limit: f32, k1: f32, k2: f32) -> f32 {
    if x > limit {
        return x;
    }
    let k2 = k2.max(0.001);
    let k1 = (k1 * k1 + k2 * k2).sqrt();
    let k3 = (limit + k1) / (limit + k2);
    let b = k3 * x - k1;
    0.5 * (b + (b * b + 4.0 * k2 * k3 * x).sqrt())
}

/// Colourfulness that hues have by nature.
fn chroma_norm(hue: f32) -> f32 {
    let (s1, c1) = hue.to_radians().sin_cos();
    let (c2, s2) = (2.0 * c1 * c1 - 1.0, 2.0 * c1 * s1);
    let (c3, s3) = (4.0 * c1 * c1 * c1 - 3.0 * c1, 3.0 * s1 - 4.0 * s1 * s1 * s1);
    11.34072 * c1 + 16.46899 * c2 + 7.88380 * c3 + 14.66441 * s1 - 6.37224 * s2 + 9.19364 * s3 + 77.12896
}

fn lerp_table(table: &[f32], hue: f32) -> f32 {
    let place = hue * (HUES as f32 / 360.0);
    let i = (place as usize).min(HUES - 1);
    table[i] + (place - i as f32) * (table[i + 1] - table[i])
}

/// Largest colourfulness of a lightness and hue without a negative component.
fn largest_inside(model: &Model, j: f32, hue: f32) -> f32 {
    let outside = |m: f32| model.rgb(Vec3::new(j, m, hue)).min_element() < 0.0;
    let (mut low, mut high) = (0.0f32, 50.0f32);
    while !outside(high) && high < 1300.0 {
        low = high;
        high += 50.0;
    }
    while high - low > 1e-3 {
        let middle = 0.5 * (low + high);
        if outside(middle) { high = middle } else { low = middle }
    }
    high
}

/// The most colourful displayable colours by hue: points on the edges between the corners R, Y, G, C, B, M of the cube.
fn cusps(limit: &Model, peak: f32) -> Vec<Cusp> {
    const CORNERS: [[f32; 3]; 6] =
        [[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0], [1.0, 0.0, 1.0]];
    let corners = CORNERS.map(|c| Vec3::from(c) * peak);
    let hues = corners.map(|c| limit.jmh(c).z);
    let at = |hue: f32| {
        // The edge whose hues hold this one; hues rise along it, through 360 on one edge.
        let along = |from: f32, to: f32| (to - from).rem_euclid(360.0);
        let edge = (0..6).find(|e| along(hues[*e], hue) < along(hues[*e], hues[(e + 1) % 6])).unwrap_or(0);
        let (a, b) = (corners[edge], corners[(edge + 1) % 6]);
        let (mut low, mut high) = (0.0f32, 1.0f32);
        for _ in 0..26 {
            let middle = 0.5 * (low + high);
            let reached = along(hues[edge], limit.jmh(a.lerp(b, middle)).z);
            // Rounding at the first corner may fall just short of it.
            let reached = if reached > 359.0 { 0.0 } else { reached };
            if reached > along(hues[edge], hue) { high = middle } else { low = middle }
        }
        let jmh = limit.jmh(a.lerp(b, 0.5 * (low + high)));
        Cusp { j: jmh.x, m: jmh.y * (1.0 + SMOOTH_M * SMOOTH_CUSPS), top: 0.0 }
    };
    (0..HUES).map(|i| at(i as f32 * 360.0 / HUES as f32)).collect()
}
