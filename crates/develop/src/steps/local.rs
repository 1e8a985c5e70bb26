//! Contrast of large areas, taken apart from that within them: base and detail of log luminance by a guided filter.
//!
//! The filter's coefficients are found on the overview and spread over the full picture, where each pixel guides itself (fast guided filter). Sources:
//! Durand & Dorsey 2002, "Fast bilateral filtering for the display of high-dynamic-range images" (base and detail); He, Sun & Tang 2013, "Guided image
//! filtering" (IEEE TPAMI 35); He & Sun 2015, "Fast guided filter".

use super::tone::{GREY, LUMA};
use crate::overview::Overview;
use crate::setting::section;
use glam::Vec3;

section! {
    /// Contrast of large areas.
    Local "local" {
        compression: f64 = 0.0, "", Number(0.0, 1.0),
            "fraction of the contrast between large areas that is taken away";
        detail: f64 = 1.0, "", Number(0.0, 4.0),
            "factor of the contrast within areas";
        radius: f64 = 0.04, "of the longer side", Number(0.002, 0.25),
            "how large an area is";
    }
}

/// Steps of log2 luminance smaller than this belong to an area, larger ones are its edge.
const EDGE: f32 = 0.7;
/// Light below which everything is black.
const LEAST: f32 = 1e-5;

/// The step made ready.
pub struct LocalTone {
    width: usize,
    height: usize,
    side: [f32; 2],
    /// base = a · log + b, a pair a cell.
    line: Vec<[f32; 2]>,
    compression: f32,
    detail: f32,
}

impl LocalTone {
    /// `None` where nothing is to be done. `light`: of a cell's signal, as the picture will have it.
    pub fn new(settings: &Local, overview: impl FnOnce() -> Overview, light: impl Fn(&[f32]) -> Vec3) -> Option<Self> {
        if settings.compression == 0.0 && settings.detail == 1.0 {
            return None;
        }
        let overview = overview();
        let (w, h) = (overview.width, overview.height);
        let log: Vec<f32> = overview.cells().map(|c| log_luminance(light(c.signal))).collect();
        let radius = ((settings.radius * w.max(h) as f64).round() as usize).max(1);
        let mean = box_mean(&log, w, h, radius);
        let squares = box_mean(&log.iter().map(|v| v * v).collect::<Vec<_>>(), w, h, radius);
        let mut a = vec![0.0; w * h];
        let mut b = vec![0.0; w * h];
        for i in 0..w * h {
            let variance = (squares[i] - mean[i] * mean[i]).max(0.0);
            a[i] = variance / (variance + EDGE * EDGE);
            b[i] = mean[i] * (1.0 - a[i]);
        }
        let (a, b) = (box_mean(&a, w, h, radius), box_mean(&b, w, h, radius));
        Some(LocalTone {
            width: w,
            height: h,
            side: overview.side.map(|n| n as f32),
            line: a.into_iter().zip(b).map(|(a, b)| [a, b]).collect(),
            compression: settings.compression as f32,
            detail: settings.detail as f32,
        })
    }

    /// Light of the pixel at a place of the mosaic, with the contrast changed.
    pub fn apply(&self, c: Vec3, x: f32, y: f32) -> Vec3 {
        let place = |v: f32, n: usize, side: f32| {
            let p = ((v + 0.5) / side - 0.5).clamp(0.0, (n - 1) as f32);
            let i = (p as usize).min(n.saturating_sub(2));
            (i, p - i as f32)
        };
        let ((ix, tx), (iy, ty)) = (place(x, self.width, self.side[0]), place(y, self.height, self.side[1]));
        let at = |dx: usize, dy: usize| self.line[(iy + dy).min(self.height - 1) * self.width + (ix + dx).min(self.width - 1)];
        let between = |k: usize| {
            let top = at(0, 0)[k] + tx * (at(1, 0)[k] - at(0, 0)[k]);
            let bottom = at(0, 1)[k] + tx * (at(1, 1)[k] - at(0, 1)[k]);
            top + ty * (bottom - top)
        };
        let log = log_luminance(c);
        let base = between(0) * log + between(1);
        let change = (self.detail - 1.0) * (log - base) - self.compression * (base - GREY.log2());
        c * change.exp2()
    }
}

fn log_luminance(c: Vec3) -> f32 {
    c.dot(LUMA).max(LEAST).log2()
}

/// Means over squares of 2r + 1 cells, smaller at the edges.
fn box_mean(plane: &[f32], w: usize, h: usize, r: usize) -> Vec<f32> {
    // Sums of all cells above and left of a corner.
    let mut sums = vec![0.0f64; (w + 1) * (h + 1)];
    for y in 0..h {
        let mut row = 0.0;
        for x in 0..w {
            row += f64::from(plane[y * w + x]);
            sums[(y + 1) * (w + 1) + x + 1] = sums[y * (w + 1) + x + 1] + row;
        }
    }
    let mut out = Vec::with_capacity(w * h);
    for y in 0..h {
        let (y0, y1) = (y.saturating_sub(r), (y + r + 1).min(h));
        for x in 0..w {
            let (x0, x1) = (x.saturating_sub(r), (x + r + 1).min(w));
            let sum = sums[y1 * (w + 1) + x1] - sums[y0 * (w + 1) + x1] - sums[y1 * (w + 1) + x0] + sums[y0 * (w + 1) + x0];
            out.push((sum / ((y1 - y0) * (x1 - x0)) as f64) as f32);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::raw;

    #[test]
    fn areas_come_together_and_detail_stays() {
        // Left dark, right five stops brighter, both with stripes of a tenth.
        let level =
            |x: usize, y: usize| (if x < 480 { 10.0 } else { 320.0 }) * if (y / 12).is_multiple_of(2) { 1.1 } else { 1.0 };
        let image = raw(960, 640, "mono", level);
        let light = |s: &[f32]| Vec3::splat(s[0]);
        let of = |settings: &Local| {
            let local = LocalTone::new(settings, || Overview::new(&image), light).unwrap();
            move |x: usize, y: usize| local.apply(Vec3::splat(level(x, y) as f32 / 1000.0), x as f32, y as f32).y
        };
        let compressed = of(&Local { compression: 0.5, detail: 1.0, radius: 0.05 });
        let areas = compressed(800, 320) / compressed(160, 320);
        // Half of five stops.
        assert!((areas.log2() - 2.5).abs() < 0.25, "{areas}");
        let stripes = compressed(160, 317) / compressed(160, 305);
        assert!((stripes.max(1.0 / stripes) - 1.1).abs() < 0.02, "{stripes}");
        let lively = of(&Local { compression: 0.0, detail: 2.0, radius: 0.05 });
        let stripes = lively(160, 317) / lively(160, 305);
        assert!((stripes.max(1.0 / stripes) - 1.21).abs() < 0.03, "{stripes}");
        assert!(LocalTone::new(&Local::default(), || Overview::new(&image), light).is_none());
    }
}
