//! The mean of the nearest neighbours of each colour, for any pattern.

use super::Mosaic;
use crate::region::Region;
use diopter_image::Cfa;

/// Where a missing colour is taken from: offsets and weights.
type Taps = Vec<([i64; 2], f32)>;

/// Neighbours of each place of the pattern, `[row][column][channel]`.
pub struct Neighbours {
    taps: Vec<Taps>,
    channels: usize,
    reach: usize,
}

impl Neighbours {
    /// Finds the neighbours: those within the smallest square that holds the colour, nearer ones counting more.
    pub fn new(cfa: &Cfa) -> Self {
        let mut taps = Vec::new();
        let mut reach = 0;
        for y in 0..cfa.rows() as i64 {
            for x in 0..cfa.columns() as i64 {
                for c in 0..cfa.channel_count() {
                    let found = Self::around(cfa, x, y, c);
                    reach = found
                        .iter()
                        .fold(reach, |r, (d, _)| r.max(d[0].unsigned_abs() as usize).max(d[1].unsigned_abs() as usize));
                    taps.push(found);
                }
            }
        }
        Neighbours { taps, channels: cfa.channel_count(), reach }
    }

    fn around(cfa: &Cfa, x: i64, y: i64, c: usize) -> Taps {
        if cfa.channel_beyond(x, y) == c {
            return vec![([0, 0], 1.0)];
        }
        for radius in 1..=cfa.columns().max(cfa.rows()) as i64 {
            let square = (-radius..=radius).flat_map(|dy| (-radius..=radius).map(move |dx| [dx, dy]));
            let mut taps: Taps = square
                .filter(|d| cfa.channel_beyond(x + d[0], y + d[1]) == c)
                .map(|d| (d, 1.0 / (d[0] * d[0] + d[1] * d[1]) as f32))
                .collect();
            let sum: f32 = taps.iter().map(|t| t.1).sum();
            if sum > 0.0 {
                taps.iter_mut().for_each(|t| t.1 /= sum);
                return taps;
            }
        }
        Vec::new()
    }

    /// How far around a pixel the mosaic is looked at, px.
    pub fn reach(&self) -> usize {
        self.reach
    }

    /// All channels of the pixels of `region`, `[channel][row × column]`, from a mosaic that reaches [`Neighbours::reach`]
    /// further on each side.
    pub fn run(&self, mosaic: &Mosaic, region: Region) -> Vec<Vec<f32>> {
        let (w, cfa) = (mosaic.region.width as i64, mosaic.cfa);
        let mut planes = vec![vec![0.0; region.area()]; self.channels];
        for row in 0..region.height {
            for column in 0..region.width {
                let (x, y) = (region.left + column as i64, region.top + row as i64);
                let cell = y.rem_euclid(cfa.rows() as i64) as usize * cfa.columns() + x.rem_euclid(cfa.columns() as i64) as usize;
                let here = (y - mosaic.region.top) * w + x - mosaic.region.left;
                for (c, plane) in planes.iter_mut().enumerate() {
                    let taps = &self.taps[cell * self.channels + c];
                    plane[row * region.width + column] =
                        taps.iter().map(|(d, weight)| mosaic.data[(here + d[1] * w + d[0]) as usize] * weight).sum();
                }
            }
        }
        planes
    }
}
