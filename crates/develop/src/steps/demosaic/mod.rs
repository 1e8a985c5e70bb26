//! The demosaic: fills in the colours a pixel did not see. One file a method; which one serves which pattern is chosen here.

mod bilinear;
pub mod false_color;
mod gbtf;
mod linear;
mod malvar;
mod rcd;

use crate::region::{Planes, Region, cut};
use crate::setting::{names, section};
use diopter_image::Cfa;

section! {
    /// How missing colours are filled in.
    DemosaicStep "demosaic" {
        method: Demosaic = Demosaic::Gbtf, "", Names(Demosaic::NAMES),
            "gbtf has the least error on charts; malvar-he-cutler and bilinear are faster; linear serves any pattern, and takes the place of methods that do not fit one; half gives one pixel for each period of the pattern, with nothing guessed";
        false_color_passes: f64 = 3.0, "passes", Number(0.0, 5.0),
            "the colours of pixels where a channel changes by more than a factor of 4 give way to the median around: a mosaic sees glints and hard edges in single colours. Whole numbers; 0 leaves what was guessed";
    }
}

names! {
    /// Demosaic methods.
    #[non_exhaustive]
    Demosaic {
        /// Directional colour differences weighted by their gradients.
        Gbtf = "gbtf",
        /// Ratio corrected.
        Rcd = "rcd",
        /// 5 × 5 linear filters with correction by the gradient of the known colour.
        MalvarHeCutler = "malvar-he-cutler",
        /// The mean of the nearest neighbours of a colour.
        Bilinear = "bilinear",
        /// Best linear filters, for any pattern.
        Linear = "linear",
        /// One pixel for each period of the pattern.
        Half = "half",
    }
}

/// A part of a balanced mosaic.
pub struct Mosaic<'a> {
    /// Where it lies, edges included.
    pub region: Region,
    /// One value a pixel.
    pub data: Vec<f32>,
    /// The pattern.
    pub cfa: &'a Cfa,
}

impl Mosaic<'_> {
    /// Channel of a pixel, from the corner of the region.
    fn channel(&self, x: usize, y: usize) -> usize {
        self.cfa.channel_beyond(self.region.left + x as i64, self.region.top + y as i64)
    }
}

/// A method made ready for a pattern.
#[non_exhaustive]
pub enum Demosaicer {
    /// One channel: nothing is missing.
    Monochrome,
    /// All channels in every pixel: nothing is missing.
    AllChannels,
    /// Means of neighbours.
    Bilinear(bilinear::Neighbours),
    /// Bayer: 5 × 5 filters.
    Malvar,
    /// Bayer: directional colour differences weighted by their gradients.
    Gbtf,
    /// Bayer: ratio corrected.
    Rcd,
    /// Any pattern: the best linear filters.
    Linear(linear::Filters),
    /// One pixel for each period of the pattern.
    Half,
}

impl Demosaicer {
    /// The method for a pattern: those made for Bayer give way to linear filters elsewhere.
    pub fn new(method: Demosaic, cfa: &Cfa) -> Self {
        match method {
            _ if cfa.has_all_channels() && method != Demosaic::Half => Demosaicer::AllChannels,
            _ if cfa.is_monochrome() && method != Demosaic::Half => Demosaicer::Monochrome,
            Demosaic::Half => Demosaicer::Half,
            Demosaic::Bilinear => Demosaicer::Bilinear(bilinear::Neighbours::new(cfa)),
            Demosaic::Linear => Demosaicer::Linear(linear::Filters::new(cfa)),
            _ if !cfa.is_bayer() => Demosaicer::Linear(linear::Filters::new(cfa)),
            Demosaic::MalvarHeCutler => Demosaicer::Malvar,
            Demosaic::Gbtf => Demosaicer::Gbtf,
            Demosaic::Rcd => Demosaicer::Rcd,
        }
    }

    /// Pixels of the mosaic a side of a pixel of the result stands for.
    pub fn cell(&self, cfa: &Cfa) -> [usize; 2] {
        match self {
            Demosaicer::AllChannels => [cfa.columns(), 1],
            Demosaicer::Half if cfa.has_all_channels() => [2 * cfa.columns(), 2],
            // A monochrome mosaic is halved as a Bayer one is.
            Demosaicer::Half => [cfa.columns().max(2), cfa.rows().max(2)],
            _ => [1, 1],
        }
    }

    /// How far around a pixel the mosaic is looked at.
    pub fn reach(&self) -> usize {
        match self {
            Demosaicer::Monochrome | Demosaicer::AllChannels | Demosaicer::Half => 0,
            Demosaicer::Bilinear(n) => n.reach(),
            Demosaicer::Malvar => 2,
            Demosaicer::Gbtf => gbtf::REACH,
            Demosaicer::Rcd => rcd::REACH,
            Demosaicer::Linear(f) => f.reach(),
        }
    }

    /// All channels of the pixels of `region`, from a mosaic that reaches [`Demosaicer::reach`] further on each side (of `Half`: from
    /// that of all its cells).
    pub fn run(&self, mosaic: &Mosaic, region: Region) -> Planes {
        let planes = match self {
            Demosaicer::AllChannels => parted(mosaic, region),
            Demosaicer::Monochrome => vec![cut(&mosaic.data, mosaic.region, region)],
            Demosaicer::Bilinear(n) => n.run(mosaic, region),
            Demosaicer::Malvar => malvar::run(mosaic, region),
            Demosaicer::Gbtf => gbtf::run(mosaic, region),
            Demosaicer::Rcd => rcd::run(mosaic, region),
            Demosaicer::Linear(f) => f.run(mosaic, region),
            Demosaicer::Half => half(mosaic, region),
        };
        Planes { region, planes }
    }
}

/// Samples that stand side by side, a plane each.
fn parted(mosaic: &Mosaic, region: Region) -> Vec<Vec<f32>> {
    let n = mosaic.cfa.channel_count();
    let rows = mosaic.data.chunks_exact(mosaic.region.width).take(region.height);
    let mut planes = vec![Vec::with_capacity(region.area()); n];
    for row in rows {
        for pixel in row.chunks_exact(n).take(region.width) {
            planes.iter_mut().zip(pixel).for_each(|(plane, v)| plane.push(*v));
        }
    }
    planes
}

/// Means of the channels in each cell.
fn half(mosaic: &Mosaic, region: Region) -> Vec<Vec<f32>> {
    let n = mosaic.cfa.channel_count();
    let [cx, cy] = Demosaicer::Half.cell(mosaic.cfa);
    let mut planes = vec![vec![0.0; region.area()]; n];
    for y in 0..region.height {
        for x in 0..region.width {
            let mut sums = [(0.0f32, 0.0f32); 4];
            for dy in 0..cy {
                for dx in 0..cx {
                    let (px, py) = (x * cx + dx, y * cy + dy);
                    let (sum, count) = &mut sums[mosaic.channel(px, py)];
                    *sum += mosaic.data[py * mosaic.region.width + px];
                    *count += 1.0;
                }
            }
            for (plane, (sum, count)) in planes.iter_mut().zip(sums) {
                plane[y * region.width + x] = sum / count.max(1.0);
            }
        }
    }
    planes
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::region::inside;

    pub const ALL: [Demosaic; 6] =
        [Demosaic::Bilinear, Demosaic::MalvarHeCutler, Demosaic::Gbtf, Demosaic::Rcd, Demosaic::Linear, Demosaic::Half];

    /// A picture seen through a pattern and demosaiced.
    pub fn through(f: impl Fn(usize, usize) -> [f32; 4], size: [usize; 2], cfa: &Cfa, method: Demosaic) -> Planes {
        let ready = Demosaicer::new(method, cfa);
        let [cx, cy] = ready.cell(cfa);
        let region = Region::whole((size[0] / cx).max(1), (size[1] / cy).max(1));
        let around = Region { left: 0, top: 0, width: region.width * cx, height: region.height * cy }.grown(ready.reach());
        let mut data = vec![0.0; around.area()];
        for (i, v) in data.iter_mut().enumerate() {
            let x = inside(around.left + (i % around.width) as i64, size[0], cfa.columns());
            let y = inside(around.top + (i / around.width) as i64, size[1], cfa.rows());
            *v = f(x, y)[cfa.channel_at(x, y)];
        }
        ready.run(&Mosaic { region: around, data, cfa }, region)
    }

    #[test]
    fn flat_colours_are_exact_in_every_pattern() {
        let colour = [0.2, 0.5, 0.8, 0.6];
        for pattern in ["RG/GB", "GR/BG", "GB/RG", "BG/GR", "x-trans", "quad", "rgbw", "rccc", "mono"] {
            let cfa = Cfa::parse(pattern).unwrap();
            for method in ALL {
                let planes = through(|_, _| colour, [36, 24], &cfa, method);
                assert_eq!(planes.planes.len(), cfa.channel_count());
                for (c, plane) in planes.planes.iter().enumerate() {
                    let worst = plane.iter().map(|v| (v - colour[c]).abs()).fold(0.0, f32::max);
                    assert!(worst < 2e-4, "{pattern} {method:?} channel {c}: {worst}");
                }
            }
        }
    }

    #[test]
    fn grey_ramps_are_exact_inside() {
        for pattern in ["RG/GB", "GB/RG"] {
            let cfa = Cfa::parse(pattern).unwrap();
            for method in [Demosaic::MalvarHeCutler, Demosaic::Gbtf, Demosaic::Rcd, Demosaic::Linear] {
                let planes = through(|c, r| [0.1 + 0.01 * c as f32 + 0.02 * r as f32; 4], [40, 40], &cfa, method);
                for (i, v) in planes.planes.iter().flat_map(|p| p.iter().enumerate()) {
                    let (x, y) = (i % 40, i / 40);
                    if (12..28).contains(&x) && (12..28).contains(&y) {
                        let expected = 0.1 + 0.01 * x as f32 + 0.02 * y as f32;
                        assert!((v - expected).abs() < 2e-3, "{pattern} {method:?} {x} {y}: {v} {expected}");
                    }
                }
            }
        }
    }

    #[test]
    fn tiles_agree_with_the_whole() {
        let wavy = |x: usize, y: usize| {
            let (x, y) = (x as f32, y as f32);
            [0.5 + 0.3 * (0.9 * x).sin(), 0.5 + 0.3 * (0.8 * x + 0.7 * y).cos(), 0.5 + 0.2 * (1.1 * y).sin(), 0.4]
        };
        for pattern in ["GR/BG", "x-trans"] {
            let cfa = Cfa::parse(pattern).unwrap();
            for method in ALL.into_iter().filter(|m| *m != Demosaic::Half) {
                let ready = Demosaicer::new(method, &cfa);
                let mosaic = |region: Region| {
                    let around = region.grown(ready.reach());
                    let data = (0..around.area()).map(|i| {
                        let x = around.left + (i % around.width) as i64;
                        let y = around.top + (i / around.width) as i64;
                        wavy((x + 60) as usize, (y + 60) as usize)[cfa.channel_beyond(x, y)]
                    });
                    Mosaic { region: around, data: data.collect(), cfa: &cfa }
                };
                let big = Region { left: -3, top: 5, width: 40, height: 30 };
                let small = Region { left: 4, top: 10, width: 13, height: 9 };
                let whole = ready.run(&mosaic(big), big).cut(small);
                let part = ready.run(&mosaic(small), small);
                let worst = whole.planes.iter().zip(&part.planes).flat_map(|(a, b)| a.iter().zip(b)).map(|(a, b)| (a - b).abs());
                assert!(worst.fold(0.0, f32::max) < 1e-5, "{pattern} {method:?}");
            }
        }
    }
}
