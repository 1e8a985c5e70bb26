//! Pixels that stand out of all their neighbours of the same colour are replaced by their mean.

use crate::setting::section;
use diopter_image::Cfa;

section! {
    /// Pixels that are broken.
    Defects "defects" {
        threshold: f64 = 0.0, "deviations", Number(0.0, 1000.0),
            "pixels that stand out of all their neighbours by more are corrected; 0 is off: stars are such pixels too";
    }
}

/// Nearest pixels of the same colour: offsets.
pub struct Neighbours {
    /// For each place of the pattern.
    offsets: Vec<Vec<[i64; 2]>>,
    reach: usize,
}

/// Neighbours looked at.
const NEAREST: usize = 8;

impl Neighbours {
    /// Finds them for a pattern.
    pub fn new(cfa: &Cfa) -> Self {
        let (columns, rows) = (cfa.columns() as i64, cfa.rows() as i64);
        let reach = columns.max(rows).max(1) + 1;
        let mut offsets = Vec::new();
        for y in 0..rows {
            for x in 0..columns {
                let square = (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| [dx, dy]));
                let mut same: Vec<[i64; 2]> = square
                    .filter(|d| *d != [0, 0] && cfa.channel_beyond(x + d[0], y + d[1]) == cfa.channel_beyond(x, y))
                    .collect();
                // Distances in pixels.
                let samples = cfa.samples_per_pixel() as i64;
                same.sort_by_key(|d| (d[0] / samples).pow(2) + d[1] * d[1]);
                same.truncate(NEAREST);
                offsets.push(same);
            }
        }
        let furthest = offsets.iter().flatten().flatten().map(|d| d.unsigned_abs() as usize).max().unwrap_or(0);
        Neighbours { offsets, reach: furthest }
    }

    /// How far they lie, px.
    pub fn reach(&self) -> usize {
        self.reach
    }

    /// Repairs the defective pixels of a plane (`width` wide; its corner at a place of the pattern) but for a border of [`Neighbours::reach`]. `deviation`: of
    /// the noise at a value, for the channel at a pixel of the plane.
    pub fn corrected(
        &self,
        data: &[f32],
        width: usize,
        corner: [i64; 2],
        cfa: &Cfa,
        threshold: f32,
        deviation: impl Fn(usize, f32) -> f32,
    ) -> Vec<f32> {
        let height = data.len() / width;
        let mut out = data.to_vec();
        for y in self.reach..height.saturating_sub(self.reach) {
            let row = (corner[1] + y as i64).rem_euclid(cfa.rows() as i64) as usize;
            for x in self.reach..width - self.reach {
                let column = (corner[0] + x as i64).rem_euclid(cfa.columns() as i64) as usize;
                let i = y * width + x;
                let offsets = &self.offsets[row * cfa.columns() + column];
                let (mut low, mut high, mut sum) = (f32::MAX, f32::MIN, 0.0);
                for d in offsets {
                    let v = data[(i as i64 + d[1] * width as i64 + d[0]) as usize];
                    low = low.min(v);
                    high = high.max(v);
                    sum += v;
                }
                let v = data[i];
                let out_of = (v - high).max(low - v);
                if out_of > 0.0 && out_of > threshold * deviation(cfa.channel_at(column, row), 0.5 * (low + high)) {
                    out[i] = sum / offsets.len() as f32;
                }
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn single_pixels_are_mended_and_edges_are_not() {
        for pattern in ["RG/GB", "x-trans", "mono", "quad", "linear"] {
            let cfa = Cfa::parse(pattern).unwrap_or_else(Cfa::linear_rgb);
            let neighbours = Neighbours::new(&cfa);
            let mut data: Vec<f32> = (0..40 * 40).map(|i| if i % 40 < 20 { 0.2 } else { 0.6 }).collect();
            let clean = data.clone();
            data[15 * 40 + 11] = 0.9;
            data[22 * 40 + 28] = 0.0;
            let corrected = neighbours.corrected(&data, 40, [0, 0], &cfa, 10.0, |_, _| 0.01);
            let worst = corrected.iter().zip(&clean).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(worst < 0.11, "{pattern} {worst}");
            assert_eq!(neighbours.corrected(&clean, 40, [0, 0], &cfa, 10.0, |_, _| 0.01), clean, "{pattern}");
        }
    }
}
