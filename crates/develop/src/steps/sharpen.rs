//! Unsharp masking of brightness, in codes, so that edges get no darker and brighter sides of different strength.

use super::tone::LUMA;
use crate::region::{Planes, Region};
use crate::setting::section;
use diopter_light::color::srgb_encode;
use glam::Vec3;

section! {
    /// Sharpening of brightness.
    Sharpen "sharpen" {
        amount: f64 = 0.0, "", Number(0.0, 5.0),
            "how much of the difference to the blurred picture is added";
        radius: f64 = 0.8, "px", Number(0.2, 20.0),
            "deviation of the blur";
        threshold: f64 = 0.0, "code", Number(0.0, 1.0),
            "smaller differences are taken for noise";
    }
}

/// Weights of a Gaussian from the middle outwards, their full sum 1.
fn gaussian(deviation: f64) -> Vec<f32> {
    let reach = (3.0 * deviation).ceil() as usize;
    let weights: Vec<f64> = (0..=reach).map(|i| (-((i * i) as f64) / (2.0 * deviation * deviation)).exp()).collect();
    let sum = weights[0] + 2.0 * weights[1..].iter().sum::<f64>();
    weights.iter().map(|w| (w / sum) as f32).collect()
}

/// How far around a pixel is looked, px.
pub fn reach(settings: &Sharpen) -> usize {
    if settings.amount == 0.0 { 0 } else { (3.0 * settings.radius).ceil() as usize }
}

/// Sharpens the pixels of `region`; the planes (display light) reach [`reach`] further.
pub fn apply(rgb: Planes, region: Region, settings: &Sharpen) -> Planes {
    let (w, h) = (rgb.region.width, rgb.region.height);
    let light = |p: &Planes, i: usize| Vec3::new(p.planes[0][i], p.planes[1][i], p.planes[2][i]);
    let code: Vec<f32> = (0..w * h).map(|i| srgb_encode(light(&rgb, i).dot(LUMA).max(0.0))).collect();
    let weights = gaussian(settings.radius);
    let r = weights.len() - 1;
    let mut across = vec![0.0f32; w * h];
    for y in 0..h {
        for x in r..w - r {
            let i = y * w + x;
            across[i] = weights[0] * code[i] + (1..=r).map(|k| weights[k] * (code[i - k] + code[i + k])).sum::<f32>();
        }
    }
    let (amount, threshold) = (settings.amount as f32, settings.threshold as f32);
    let (ox, oy) = ((region.left - rgb.region.left) as usize, (region.top - rgb.region.top) as usize);
    let mut out = Planes { region, planes: vec![vec![0.0; region.area()]; 3] };
    for row in 0..region.height {
        for column in 0..region.width {
            let i = (oy + row) * w + ox + column;
            let blurred =
                weights[0] * across[i] + (1..=r).map(|k| weights[k] * (across[i - k * w] + across[i + k * w])).sum::<f32>();
            let difference = code[i] - blurred;
            let kept = difference.signum() * (difference.abs() - threshold).max(0.0);
            let c = light(&rgb, i);
            let y = c.dot(LUMA).max(0.0);
            let target = diopter_light::color::srgb_decode((code[i] + amount * kept).max(0.0));
            // In the dark a ratio says little: there light is added.
            let c = if y > 1e-3 { c * (target / y) } else { c + (target - y) };
            (0..3).for_each(|k| out.planes[k][row * region.width + column] = c[k]);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn edge(x: i64) -> f32 {
        if x < 0 { 0.1 } else { 0.5 }
    }

    fn sharpened(settings: &Sharpen) -> Vec<f32> {
        let region = Region { left: -10, top: 0, width: 20, height: 3 };
        let around = region.grown(reach(settings));
        let plane: Vec<f32> = (0..around.area()).map(|i| edge(around.left + (i % around.width) as i64)).collect();
        apply(Planes { region: around, planes: vec![plane; 3] }, region, settings).planes[1][20..40].to_vec()
    }

    #[test]
    fn edges_get_steeper_and_flats_stay() {
        let line = sharpened(&Sharpen { amount: 1.0, radius: 1.0, threshold: 0.0 });
        assert!(line[9] < 0.09 && line[10] > 0.52, "{line:?}");
        assert!((line[0] - 0.1).abs() < 1e-4 && (line[19] - 0.5).abs() < 1e-4, "{line:?}");
        let calm = sharpened(&Sharpen { amount: 1.0, radius: 1.0, threshold: 0.5 });
        assert!(calm.iter().enumerate().all(|(i, v)| (v - edge(i as i64 - 10)).abs() < 1e-4));
    }
}
