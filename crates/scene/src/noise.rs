//! Noise in space, and the patterns that procedural textures make of it.
//!
//! Source: K. Perlin 2002, "Improving Noise"; sums of octaves and marble: pbrt 3rd ed., §10.6 (their constants, so that its scenes look alike).
//! Octaves are not faded out with distance: samples of a pixel take their mean.

use glam::Vec3;

/// Perlin's permutation of 0 to 255.
const PERMUTATION: [u8; 256] = [
    151, 160, 137, 91, 90, 15, 131, 13, 201, 95, 96, 53, 194, 233, 7, 225, 140, 36, 103, 30, 69, 142, 8, 99, 37, 240, 21, 10, 23,
    190, 6, 148, 247, 120, 234, 75, 0, 26, 197, 62, 94, 252, 219, 203, 117, 35, 11, 32, 57, 177, 33, 88, 237, 149, 56, 87, 174,
    20, 125, 136, 171, 168, 68, 175, 74, 165, 71, 134, 139, 48, 27, 166, 77, 146, 158, 231, 83, 111, 229, 122, 60, 211, 133, 230,
    220, 105, 92, 41, 55, 46, 245, 40, 244, 102, 143, 54, 65, 25, 63, 161, 1, 216, 80, 73, 209, 76, 132, 187, 208, 89, 18, 169,
    200, 196, 135, 130, 116, 188, 159, 86, 164, 100, 109, 198, 173, 186, 3, 64, 52, 217, 226, 250, 124, 123, 5, 202, 38, 147,
    118, 126, 255, 82, 85, 212, 207, 206, 59, 227, 47, 16, 58, 17, 182, 189, 28, 42, 223, 183, 170, 213, 119, 248, 152, 2, 44,
    154, 163, 70, 221, 153, 101, 155, 167, 43, 172, 9, 129, 22, 39, 253, 19, 98, 108, 110, 79, 113, 224, 232, 178, 185, 112, 104,
    218, 246, 97, 228, 251, 34, 242, 193, 238, 210, 144, 12, 191, 179, 162, 241, 81, 51, 145, 235, 249, 14, 239, 107, 49, 192,
    214, 31, 181, 199, 106, 157, 184, 84, 204, 176, 115, 121, 50, 45, 127, 4, 150, 254, 138, 236, 205, 93, 222, 114, 67, 29, 24,
    72, 243, 141, 128, 195, 78, 66, 215, 61, 156, 180,
];

/// Each octave's frequency over the one before: not 2, lest their lattices meet.
const LACUNARITY: f32 = 1.99;

/// Noise between about −1 and 1, 0 at whole coordinates.
pub fn noise(p: Vec3) -> f32 {
    let cell = p.floor();
    let f = p - cell;
    let whole = cell.to_array().map(|c| (c as i64).rem_euclid(256) as usize);
    let weight = |t: f32| t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
    let next = |i: usize| usize::from(PERMUTATION[i & 255]);
    let corner = |i: [usize; 3]| {
        let h = next(next(next(whole[0] + i[0]) + whole[1] + i[1]) + whole[2] + i[2]) & 15;
        let d = f - Vec3::new(i[0] as f32, i[1] as f32, i[2] as f32);
        let u = if h < 8 || h == 12 || h == 13 { d.x } else { d.y };
        let v = if h < 4 || h == 12 || h == 13 { d.y } else { d.z };
        (if h & 1 == 0 { u } else { -u }) + (if h & 2 == 0 { v } else { -v })
    };
    let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
    let (wx, wy, wz) = (weight(f.x), weight(f.y), weight(f.z));
    let along = |y: usize, z: usize| mix(corner([0, y, z]), corner([1, y, z]), wx);
    mix(mix(along(0, 0), along(1, 0), wy), mix(along(0, 1), along(1, 1), wy), wz)
}

/// Octaves of noise added, each weaker by `roughness` and finer by 1.99; 0 without octaves.
pub fn fbm(p: Vec3, roughness: f32, octaves: u32) -> f32 {
    octaves_of(p, roughness, octaves, |n| n).0
}

/// Octaves of the magnitude of noise, at least 0: creases where it passes 0. `roughness` as of [`fbm`].
pub fn wrinkled(p: Vec3, roughness: f32, octaves: u32) -> f32 {
    let (sum, next) = octaves_of(p, roughness, octaves, f32::abs);
    // What finer octaves have on average.
    sum + 0.2 * next
}

/// The sum, and the strength of the octave that would follow.
fn octaves_of(mut p: Vec3, roughness: f32, octaves: u32, of: impl Fn(f32) -> f32) -> (f32, f32) {
    let (mut sum, mut strength) = (0.0, 1.0);
    for _ in 0..octaves {
        sum += strength * of(noise(p));
        p *= LACUNARITY;
        strength *= roughness;
    }
    (sum, strength)
}

/// Height of waves raised by gusts, without unit.
pub fn windy(p: Vec3) -> f32 {
    fbm(p * 0.1, 0.5, 3).abs() * fbm(p, 0.5, 6)
}

/// Veins of marble along y, linear sRGB; `variation` bends them by noise of `octaves` and `roughness` as of [`fbm`].
pub fn marble(p: Vec3, roughness: f32, octaves: u32, variation: f32) -> Vec3 {
    const GREY: [f32; 3] = [0.58, 0.58, 0.6];
    const COLORS: [[f32; 3]; 9] = [GREY, GREY, GREY, [0.5, 0.5, 0.5], [0.6, 0.59, 0.58], GREY, GREY, [0.2, 0.2, 0.33], GREY];
    let along = (0.5 + 0.5 * (p.y + variation * fbm(p, roughness, octaves)).sin()) * 6.0;
    let first = (along as usize).min(5);
    let t = along - first as f32;
    let [a, b, c, d] = [0, 1, 2, 3].map(|k| Vec3::from_array(COLORS[first + k]));
    let s = 1.0 - t;
    1.5 * (a * (s * s * s) + b * (3.0 * s * s * t) + c * (3.0 * s * t * t) + d * (t * t * t))
}

/// Whether a place of the plane lies in one of the dots (radius 0.35) that are strewn on it, at most one in each unit square.
pub fn dotted(s: f32, t: f32) -> bool {
    const RADIUS: f32 = 0.35;
    let plane = |x: f32, y: f32| noise(Vec3::new(x, y, 0.5));
    let (a, b) = ((s + 0.5).floor(), (t + 0.5).floor());
    if plane(a + 0.5, b + 0.5) <= 0.0 {
        return false;
    }
    let shift = 0.5 - RADIUS;
    let middle = [a + shift * plane(a + 1.5, b + 2.8), b + shift * plane(a + 4.5, b + 9.8)];
    (s - middle[0]).powi(2) + (t - middle[1]).powi(2) < RADIUS * RADIUS
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_smooth_even_and_none_at_whole_places() {
        let mut seen = [false; 256];
        PERMUTATION.iter().for_each(|p| seen[usize::from(*p)] = true);
        assert!(seen.iter().all(|s| *s), "each number once");
        let at = |i: u32| Vec3::new(0.37 * i as f32, 0.71 * (i % 97) as f32, -0.53 * (i % 31) as f32);
        let (mut sum, mut most) = (0.0, 0.0f32);
        for i in 0..20_000 {
            let p = at(i);
            let (n, near) = (noise(p), noise(p + Vec3::splat(1e-3)));
            assert!((n - near).abs() < 0.01, "{p}: {n} {near}");
            assert_eq!(noise(p.floor()), 0.0);
            sum += n;
            most = most.max(n.abs());
        }
        assert!((sum / 20_000.0f32).abs() < 0.01 && most > 0.6 && most <= 1.1, "{sum} {most}");
        // Far from the origin and at odd places nothing breaks.
        assert!(noise(Vec3::new(-1e9, 3e7, 0.5)).is_finite());
    }

    #[test]
    fn patterns_have_their_shares() {
        let all: Vec<Vec3> = (0..40_000u32).map(|i| Vec3::new((i % 200) as f32 * 0.1, (i / 200) as f32 * 0.1, 3.3)).collect();
        let mean = |f: &dyn Fn(Vec3) -> f32| all.iter().map(|p| f(*p)).sum::<f32>() / all.len() as f32;
        // About half of the cells hold a dot of π 0.35².
        let dots = mean(&|p| f32::from(u8::from(dotted(p.x, p.y))));
        assert!((0.1..0.28).contains(&dots), "{dots}");
        assert!(mean(&|p| fbm(p, 0.5, 8)).abs() < 0.1);
        assert!(mean(&|p| wrinkled(p, 0.5, 8)) > 0.3);
        let marble = mean(&|p| marble(p, 0.5, 8, 0.2).y);
        assert!((0.5..0.9).contains(&marble), "{marble}");
    }
}
