//! The image of a point: geometric from the spot, diffraction from the Fourier transform of the pupil function; what it does to lines and
//! edges, how much of its light a circle holds, and the Strehl ratio.
//!
//! The pupil function stands on the reference sphere about the image point, in image-space direction cosines (l, m), where the amplitude
//! at (x, y) beside the image point is ∬ P(l, m) exp(−2πi (l x + m y)/λ) dl dm (Hopkins, "Wave Theory of Aberrations"; Goodman, "Introduction
//! to Fourier Optics", §6.1). Rays are traced from the image point back through the lens on an even grid of (l, m), as for the MTF
//! (`mtf.rs`). The amplitude is even in (l, m): that of a lens that keeps the sine condition; a cell on the edge of the pupil has the
//! amplitude of the part of it that passes. Steps of whole cells would scatter some tenths of a per cent of the light.

mod curves;

pub use curves::PointImageCurves;

use super::fft::{self, Complex};
use super::mtf::{LARGEST_STEP, Pupil, Sampling};
use super::{Beam, Bench};
use crate::batch::double::{Batch, Indices, LANES};
use glam::DVec2;
use std::f64::consts::{PI, TAU};

/// Pixels across: as many as the wavefront needs, from the first to the last.
const SIDES: [usize; 3] = [512, 1024, 2048];
/// Fewest cells across the pupil, if the image can be made larger.
const COARSEST: usize = 96;
/// Fewest cells across the pupil that the Strehl ratio is summed over: phases at the middles of cells overestimate it with the square of their size.
const STREHL_CELLS: usize = 256;
/// Parts, each way, in which a cell on the edge of the pupil is looked at.
const PARTS: usize = 8;
/// The same of the finer cells of [`STREHL_CELLS`].
const STREHL_PARTS: usize = 2;
/// Rays across the pupil of a geometric image.
const RAYS: usize = 256;

/// The image of a point.
#[derive(Clone, Debug, PartialEq)]
pub struct Psf {
    /// Field angle, degrees.
    pub field_deg: f64,
    /// Wavelength, nm.
    pub nm: f64,
    /// Place of the image plane behind the film, along the light, mm.
    pub defocus: f64,
    /// Film point of the middle of pixel [side / 2, side / 2]: the chief ray's, mm.
    pub origin: DVec2,
    /// Middle of the light of the rays, mm from [`Psf::origin`].
    pub centroid: DVec2,
    /// Size of a pixel, mm.
    pub pixel: f64,
    /// Pixels across and up.
    pub side: usize,
    /// Fraction of the light in each pixel (irradiance at its middle times its area), rows one after the other, the lowest (smallest y)
    /// first. With what falls beyond the last pixel they add up to 1.
    pub values: Vec<f64>,
    /// Largest irradiance over that of the same pupil without aberration; none of a geometric image.
    pub strehl: Option<f64>,
    /// Of the rays alone, without diffraction.
    pub geometric: bool,
    /// Distances of the rays from the centroid, ascending, mm; empty with diffraction.
    distances: Vec<f64>,
}

/// A part of an image for a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Raster {
    /// Pixels across and up.
    pub side: usize,
    /// Fraction of the light in each pixel, rows from the top.
    pub values: Vec<f32>,
}

impl Psf {
    /// Fraction of the light within circles about the centroid, for radii in mm.
    ///
    /// With diffraction the integral of the image's Fourier series over the disk: Σ OTF(ν) exp(2πi ν·c) r J₁(2πrν)/ν, without steps of
    /// pixels. Radii beyond half of the image are cut to it.
    pub fn encircled_energy(&self, radii: &[f64]) -> Vec<f64> {
        if self.geometric {
            let total = self.distances.len().max(1) as f64;
            return radii.iter().map(|r| self.distances.partition_point(|d| d <= r) as f64 / total).collect();
        }
        let n = self.side;
        let width = n as f64 * self.pixel;
        let mut spectrum: Vec<Complex> = self.values.iter().map(|v| [*v, 0.0]).collect();
        fft::transform(&mut spectrum, n);
        // Pixels count from the middle: the sign of every odd frequency turns. Of the two that are each other's conjugates one is taken.
        let mut terms = vec![];
        for row in 0..n {
            for column in 0..n / 2 {
                let [re, im] = spectrum[row * n + column];
                let (u, v) = (column as f64, if row < n / 2 { row as f64 } else { row as f64 - n as f64 });
                let twice = if column == 0 { 1.0 } else { 2.0 };
                if (row == 0 && column == 0) || re.hypot(im) < 1e-13 {
                    continue;
                }
                let sign = if (row + column) % 2 == 0 { 1.0 } else { -1.0 };
                let frequency = DVec2::new(u, v) / width;
                let (s, c) = (TAU * frequency.dot(self.centroid)).sin_cos();
                terms.push((frequency.length(), twice * sign * (re * c - im * s)));
            }
        }
        let area = width * width;
        let within = |r: f64| {
            let r = r.clamp(0.0, 0.5 * width);
            let ripples: f64 = terms.iter().map(|(f, a)| a * r * bessel_j1(TAU * r * f) / f).sum();
            (PI * r * r + ripples) / area
        };
        radii.iter().map(|r| within(*r)).collect()
    }

    /// Line spread, 1/mm, at every pixel from the lowest: of lines across the field's direction (over y) if `tangential`, else over x.
    pub fn line_spread(&self, tangential: bool) -> Vec<f64> {
        let mut line = vec![0.0; self.side];
        for (i, v) in self.values.iter().enumerate() {
            line[if tangential { i / self.side } else { i % self.side }] += v / self.pixel;
        }
        line
    }

    /// Edge spread: light of a bright half plane, 0 to 1, at the upper border of every pixel of [`Psf::line_spread`].
    pub fn edge_spread(&self, tangential: bool) -> Vec<f64> {
        let add = |sum: &mut f64, v: f64| {
            *sum += v * self.pixel;
            Some(*sum)
        };
        self.line_spread(tangential).into_iter().scan(0.0, add).collect()
    }

    /// Place of a pixel's middle along x or y, mm from [`Psf::origin`].
    pub fn place(&self, pixel: usize) -> f64 {
        (pixel as f64 - (self.side / 2) as f64) * self.pixel
    }

    /// The middle of the image, `side` pixels across (at most all of it).
    pub fn cropped(&self, side: usize) -> Raster {
        let side = side.min(self.side);
        let first = self.side / 2 - side / 2;
        let row = |r: usize| {
            let start = (first + side - 1 - r) * self.side + first;
            self.values[start..start + side].iter().map(|v| *v as f32)
        };
        Raster { side, values: (0..side).flat_map(row).collect() }
    }
}

impl Bench<'_> {
    /// In the medium of the film, mm.
    fn wavelength_at_film(&self, nm: f64) -> f64 {
        nm * 1e-6 / self.system.film_index(&self.system.indices(nm))
    }

    /// Largest pixel (mm) in which diffraction images of a field point and wavelength can be computed: half a period of their highest
    /// frequency, λ / (2 · range of direction cosines). `beam_nm` is the wavelength of the chief ray. `None` where no light comes through.
    pub fn largest_psf_pixel(&self, field_deg: f64, nm: f64, beam_nm: f64) -> Option<f64> {
        let beam = self.beam(field_deg, beam_nm)?;
        let image = crate::trace::at_plane(&beam.image, self.system.film_z);
        let [low, high] = self.direction_cosines(&beam, beam_nm, image)?;
        Some(0.5 * self.wavelength_at_film(nm) / (high - low).max_element())
    }

    /// The image of a field point (degrees) by its rays, in `side` pixels of `pixel` mm, `defocus` mm behind the film, about the chief ray of
    /// `beam_nm`. Light beyond the last pixel is left out. `None` where no light comes through.
    pub fn geometric_psf(&self, field_deg: f64, [nm, beam_nm]: [f64; 2], defocus: f64, pixel: f64, side: usize) -> Option<Psf> {
        let beam = self.beam(field_deg, beam_nm)?;
        let origin = self.on_film(&beam.image, defocus);
        let spot = self.scattered_spot(field_deg, nm, beam_nm, RAYS, defocus)?;
        let each = 1.0 / spot.points.len() as f64;
        let mut values = vec![0.0; side * side];
        for p in &spot.points {
            let at = ((*p - origin) / pixel + (side / 2) as f64 + 0.5).floor();
            if at.min_element() >= 0.0 && at.max_element() < side as f64 {
                values[at.y as usize * side + at.x as usize] += each;
            }
        }
        let mut distances: Vec<f64> = spot.points.iter().map(|p| p.distance(spot.centroid)).collect();
        distances.sort_by(f64::total_cmp);
        let centroid = spot.centroid - origin;
        Some(Psf { field_deg, nm, defocus, origin, centroid, pixel, side, values, strehl: None, geometric: true, distances })
    }

    /// The image of a field point (degrees) with diffraction, in pixels of `pixel` mm (at most [`Bench::largest_psf_pixel`]; larger ones are
    /// made that small), `defocus` mm behind the film, about the chief ray of `beam_nm`. Where the wavefront is too steep for the finest
    /// grid the geometric image stands in, and [`Psf::geometric`] says so. `None` where no light comes through.
    pub fn diffraction_psf(&self, field_deg: f64, [nm, beam_nm]: [f64; 2], defocus: f64, pixel: f64) -> Option<Psf> {
        let beam = self.beam(field_deg, beam_nm)?;
        let film_z = self.system.film_z + defocus * self.system.film_run();
        let image = crate::trace::at_plane(&beam.image, film_z);
        let [low, high] = self.direction_cosines(&beam, beam_nm, image)?;
        let (middle, size) = (0.5 * (low + high), (high - low).max_element());
        let wavelength = self.wavelength_at_film(nm);
        let pixel = pixel.min(0.5 * wavelength / size);
        let batch = Batch::new(self.system);
        let mut n = Indices::default();
        batch.indices(&[nm; LANES], &mut n);
        let sampling = Sampling { batch: &batch, n, beam: &beam, image, back: -self.system.film_run(), nm };
        for side in SIDES {
            // Cells of the period of the transform: as many as cover the pupil, at most half of all.
            let step = wavelength / (side as f64 * pixel);
            let across = ((size / step).ceil() as usize).clamp(2, side / 2);
            let corner = middle - 0.5 * step * across as f64;
            if across < COARSEST && side < SIDES[SIDES.len() - 1] {
                continue;
            }
            let pupil = sampling.pupil(corner, step, across);
            if pupil.largest_step() >= LARGEST_STEP {
                continue;
            }
            let cells = cells(&sampling, &pupil, corner, step, PARTS);
            if cells.is_empty() {
                return None;
            }
            let values = intensity(&cells, side);
            let peak = peak(&cells, &values, side);
            let fine = match STREHL_CELLS {
                least if across < least => {
                    let step = step * across as f64 / least as f64;
                    (
                        self::cells(&sampling, &sampling.pupil(corner, step, least), corner, step, STREHL_PARTS),
                        peak * across as f64 / least as f64,
                    )
                }
                _ => (cells, peak),
            };
            let strehl = Some(ratio(&fine.0, side, fine.1));
            let centroid = self.centroid_of(&beam, nm, defocus)? - image.truncate();
            let origin = image.truncate();
            return Some(Psf {
                field_deg,
                nm,
                defocus,
                origin,
                centroid,
                pixel,
                side,
                values,
                strehl,
                geometric: false,
                distances: vec![],
            });
        }
        // Hundreds of waves: diffraction does nothing that geometry does not.
        self.geometric_psf(field_deg, [nm, beam_nm], defocus, pixel, SIDES[0])
    }

    /// Mean film point of the rays of a beam, mm.
    fn centroid_of(&self, beam: &Beam, nm: f64, defocus: f64) -> Option<DVec2> {
        let rays = self.grid(beam, nm, 64);
        (!rays.is_empty()).then(|| rays.iter().map(|r| self.on_film(&r.1, defocus)).sum::<DVec2>() / rays.len() as f64)
    }
}

/// A cell of the pupil that light passes.
struct Cell {
    column: usize,
    row: usize,
    /// Part of it that light passes, 0 to 1.
    area: f64,
    /// Of the sum over that part: less than it where the phase differs within the cell.
    amplitude: f64,
    /// Less that of the first cell, rad: large phases lose digits in their cosines.
    phase: f64,
}

/// Cells of a pupil whose corner lies at the direction cosines `low`, in cells of `step`; those on its edge are looked at in `parts`, each way.
fn cells(sampling: &Sampling, pupil: &Pupil, low: DVec2, step: f64, parts: usize) -> Vec<Cell> {
    let across = pupil.across;
    let passes = |row: usize, column: usize| row < across && column < across && pupil.phase[row * across + column].is_some();
    // Beyond 0 indices wrap to numbers beyond the last.
    let neighbours = |row: usize, column: usize| {
        let around = move |v: usize| [v.wrapping_sub(1), v, v + 1];
        around(row).into_iter().flat_map(move |r| around(column).map(move |c| (r, c)))
    };
    let first = pupil.phase.iter().flatten().next().copied().unwrap_or(0.0);
    let mut cells = vec![];
    for i in 0..across * across {
        let (row, column) = (i / across, i % across);
        let phase = pupil.phase[i];
        let edge = neighbours(row, column).any(|(r, c)| passes(r, c) != phase.is_some());
        if !edge {
            cells.extend(phase.map(|phase| Cell { column, row, area: 1.0, amplitude: 1.0, phase: phase - first }));
            continue;
        }
        let part = |k: usize| DVec2::new((k % parts) as f64 + 0.5, (k / parts) as f64 + 0.5) / parts as f64;
        let corner = DVec2::new(column as f64, row as f64);
        let places: Vec<DVec2> = (0..parts * parts).map(|k| low + step * (corner + part(k))).collect();
        let lit: Vec<f64> = sampling.phases(&places).into_iter().flatten().map(|phase| phase - first).collect();
        let [re, im] = lit.iter().fold([0.0; 2], |[re, im], phase| [re + phase.cos(), im + phase.sin()]);
        if !lit.is_empty() {
            let each = 1.0 / places.len() as f64;
            cells.push(Cell { column, row, area: lit.len() as f64 * each, amplitude: re.hypot(im) * each, phase: im.atan2(re) });
        }
    }
    cells
}

/// |Fourier transform|² of a pupil function on `side` × `side` pixels, the image point in the middle, over the light of the pupil.
fn intensity(cells: &[Cell], side: usize) -> Vec<f64> {
    let mut field: Vec<Complex> = vec![[0.0; 2]; side * side];
    for cell in cells {
        let (s, c) = cell.phase.sin_cos();
        // A change of sign from cell to cell moves the image point from the first pixel to the middle.
        let amplitude = if (cell.row + cell.column) % 2 == 0 { cell.amplitude } else { -cell.amplitude };
        field[cell.row * side + cell.column] = [amplitude * c, amplitude * s];
    }
    fft::transform(&mut field, side);
    // The light of a cell is its area; squares of amplitudes would leave out what a sharp edge sends beyond the image.
    let light: f64 = cells.iter().map(|c| c.area).sum();
    let scale = 1.0 / (light * (side * side) as f64);
    field.iter().map(|[re, im]| (re * re + im * im) * scale).collect()
}

/// Irradiance at a place (pixels from the middle, of an image of `side` pixels) over that of all amplitudes in phase.
fn ratio(cells: &[Cell], side: usize, at: DVec2) -> f64 {
    let light: f64 = cells.iter().map(|c| c.area).sum();
    let turn = TAU / side as f64;
    // What is common to all cells does not count.
    let [re, im] = cells.iter().fold([0.0; 2], |[re, im], cell| {
        let (s, c) = (cell.phase - turn * DVec2::new(cell.column as f64, cell.row as f64).dot(at)).sin_cos();
        [re + cell.amplitude * c, im + cell.amplitude * s]
    });
    (re * re + im * im) / (light * light)
}

/// Where irradiance is largest, looked for between pixels, which count from the middle.
fn peak(cells: &[Cell], values: &[f64], side: usize) -> DVec2 {
    let ratio = |at: DVec2| ratio(cells, side, at);
    let brightest = (0..values.len()).max_by(|a, b| values[*a].total_cmp(&values[*b])).unwrap_or(0);
    let middle = (side / 2) as f64;
    let mut at = DVec2::new((brightest % side) as f64 - middle, (brightest / side) as f64 - middle);
    let mut best = ratio(at);
    let mut step = 0.5;
    // To 1/1000 of a pixel: near its top irradiance is flat.
    while step > 1e-3 {
        let around = [DVec2::X, DVec2::NEG_X, DVec2::Y, DVec2::NEG_Y].map(|d| at + d * step);
        let found = around.into_iter().map(|p| (ratio(p), p)).max_by(|a, b| a.0.total_cmp(&b.0));
        match found.filter(|f| f.0 > best) {
            Some(better) => (best, at) = better,
            None => step *= 0.5,
        }
    }
    at
}

/// Bessel function J₁ for arguments from 0, to 1e-7 (Abramowitz & Stegun 9.4.4 and 9.4.6).
fn bessel_j1(x: f64) -> f64 {
    let horner = |t: f64, c: &[f64]| c.iter().rev().fold(0.0, |sum, c| sum * t + c);
    if x < 3.0 {
        let t = (x / 3.0).powi(2);
        return x * horner(t, &[0.5, -0.562_499_85, 0.210_935_73, -0.039_542_89, 0.004_433_19, -0.000_317_61, 0.000_011_09]);
    }
    let t = 3.0 / x;
    let amplitude =
        horner(t, &[0.797_884_56, 0.000_001_56, 0.016_596_67, 0.000_171_05, -0.002_495_11, 0.001_136_53, -0.000_200_33]);
    let phase =
        x + horner(t, &[-2.356_194_49, 0.124_996_12, 0.000_056_5, -0.006_378_79, 0.000_743_48, 0.000_798_24, -0.000_291_66]);
    amplitude * phase.cos() / x.sqrt()
}

#[cfg(test)]
mod tests {
    use super::super::wavefront::oracle;
    use super::*;
    use crate::analysis::test_lenses::parabola;
    use crate::compound::{Configured, FilmPlace, configure};
    use crate::embedded;
    use crate::glass::D_NM;

    const NM: [f64; 2] = [550.0, 550.0];

    /// Sine of the edge of the axial cone of the f/8 parabola: tan(u/2) = h / 2f.
    fn sine() -> f64 {
        (2.0 * (12.5f64 / 400.0).atan()).sin()
    }

    /// Jₙ by its integral (Abramowitz & Stegun 9.1.21); exact for a periodic integrand.
    fn bessel(n: f64, x: f64) -> f64 {
        const STEPS: usize = 400;
        let angle = |i: usize| (i as f64 + 0.5) * PI / STEPS as f64;
        (0..STEPS).map(|i| (n * angle(i) - x * angle(i).sin()).cos()).sum::<f64>() / STEPS as f64
    }

    fn double_gauss(f_number: f64) -> Configured {
        let focus = FilmPlace::Focused(crate::Focus::Infinity);
        configure(&embedded("double-gauss-50mm").unwrap(), None, Some(f_number), None, focus).unwrap()
    }

    #[test]
    fn bessel_functions_are_those_of_the_integral() {
        for x in [0.0, 0.4, 2.9, 3.1, 7.0, 40.0, 150.0] {
            assert!((bessel_j1(x) - bessel(1.0, x)).abs() < 1e-7, "{x}: {} {}", bessel_j1(x), bessel(1.0, x));
        }
    }

    #[test]
    fn a_perfect_lens_has_the_airy_pattern() {
        let system = parabola(200.0, 25.0);
        let bench = Bench::at_infinity(&system);
        let pixel = 0.5 * bench.largest_psf_pixel(0.0, 550.0, 550.0).unwrap();
        let psf = bench.diffraction_psf(0.0, NM, 0.0, pixel).unwrap();
        assert!(!psf.geometric && psf.pixel == pixel);
        let unit = 550e-6 / sine();
        // (2 J1(v)/v)² with v = 2π r sin u / λ; its largest irradiance is π sin²u / λ².
        let peak = PI / (unit * unit) * pixel * pixel;
        let mut checked = 0;
        for (i, value) in psf.values.iter().enumerate() {
            let at = DVec2::new(psf.place(i % psf.side), psf.place(i / psf.side));
            if at.length() > 4.0 * unit {
                continue;
            }
            let v = TAU * at.length() / unit;
            let airy = if v == 0.0 { 1.0 } else { (2.0 * bessel(1.0, v) / v).powi(2) };
            assert!((value / peak - airy).abs() < 2e-3, "{at}: {} {airy}", value / peak);
            checked += 1;
        }
        assert!(checked > 500, "{checked}");
        // The first dark ring holds 83.78 % (Born & Wolf §8.5.2): 1 − J0² − J1² (Rayleigh).
        let radii = [0.25, 0.609_835, 1.116, 3.0].map(|r| r * unit);
        for (r, found) in radii.iter().zip(psf.encircled_energy(&radii)) {
            let v = TAU * r / unit;
            let exact = 1.0 - bessel(0.0, v).powi(2) - bessel(1.0, v).powi(2);
            assert!((found - exact).abs() < 1e-3, "{r}: {found} {exact}");
        }
        assert!((psf.encircled_energy(&[0.609_835 * unit])[0] - 0.8378).abs() < 1e-3);
        // Cells of 1/57 of the pupil's radius dim the image by (π r / width)² / 3 at r, where the image is 57 units wide: 0.1 % of all within 10.
        let far = psf.encircled_energy(&[10.0 * unit])[0];
        let exact = 1.0 - 2.0 / (PI * TAU * 10.0);
        assert!((far - exact).abs() < 2.5e-3, "{far} {exact}");
        assert!((psf.strehl.unwrap() - 1.0).abs() < 1e-3, "{:?}", psf.strehl);
        // All light but what the sharp edge sends beyond the image, 28 units from its middle: 2 / (π 2π 28) is 1.1 %, less in the corners.
        let sum: f64 = psf.values.iter().sum();
        assert!((0.985..1.0).contains(&sum), "{sum}");
        // The dark ring itself, to a tenth of a pixel (2 %): 1.2197 λN from the middle with N = 1 / (2 sin u): 0.60984 λ / sin u.
        let ring = psf.line_dark_radius();
        assert!((ring / (1.2197 * 0.5 * unit) - 1.0).abs() < 0.02, "{ring}");
    }

    impl Psf {
        /// Where the row through the middle first falls to zero, mm: of the amplitude, which changes its sign there, between the darkest
        /// pixel and the darker of its neighbours.
        fn line_dark_radius(&self) -> f64 {
            let middle = self.side / 2;
            let row = &self.values[middle * self.side + middle..(middle + 1) * self.side];
            let i = (1..row.len() - 1).find(|i| row[*i] < row[i - 1] && row[*i] <= row[i + 1]).unwrap();
            let first = if row[i - 1] < row[i + 1] { i - 1 } else { i };
            let [before, after] = [row[first], row[first + 1]].map(f64::sqrt);
            (first as f64 + before / (before + after)) * self.pixel
        }
    }

    #[test]
    fn small_aberrations_lower_the_strehl_ratio_as_marechal_says() {
        // Defocus of W waves at the edge: (sin πW / πW)² (Born & Wolf §9.1.3), near exp(−(2πσ)²) with σ = W / √12 (Mahajan 1982).
        let system = parabola(200.0, 25.0);
        let bench = Bench::at_infinity(&system);
        let pixel = 0.5 * bench.largest_psf_pixel(0.0, 550.0, 550.0).unwrap();
        for sigma in [0.03, 0.07] {
            let waves = sigma * 12f64.sqrt();
            let defocus = waves * 550e-6 / (1.0 - (1.0 - sine().powi(2)).sqrt());
            let psf = bench.diffraction_psf(0.0, NM, defocus, pixel).unwrap();
            let found = psf.strehl.unwrap();
            let exact = ((PI * waves).sin() / (PI * waves)).powi(2);
            assert!((found - exact).abs() < 2e-3, "{sigma}: {found} {exact}");
            assert!((found - (-(TAU * sigma).powi(2)).exp()).abs() < 5e-3, "{sigma}: {found}");
        }
    }

    #[test]
    fn the_strehl_ratio_on_the_axis_is_the_integral_over_the_pupil() {
        // |∫ exp(2πi W) l dl|² / |∫ l dl|² over the direction cosine l of forward rays, by 4000 trapezoids: the spherical aberration of the Tessar, and of a
        // double Gauss with more of it, brightest on the axis.
        for (name, f_number) in [("tessar-50mm-f2.8", 8.0), ("double-gauss-50mm", 5.6), ("double-gauss-50mm", 4.0)] {
            let focus = FilmPlace::AsPublished;
            let set = configure(&embedded(name).unwrap(), None, Some(f_number), None, focus).unwrap();
            let bench = Bench::at_infinity(&set.system);
            let (beam, n) = (bench.beam(0.0, D_NM).unwrap(), set.system.indices(D_NM));
            let reach = bench.axial_reach(D_NM).unwrap();
            const STEPS: usize = 4000;
            let samples: Vec<(f64, f64)> = (0..=STEPS)
                .map(|i| {
                    let at = DVec2::new(0.0, reach * i as f64 / STEPS as f64);
                    let ray = set
                        .system
                        .trace(beam.ray(at), &n, crate::ray::TraceDirection::ToFilm, crate::ray::Apertures::Ignore)
                        .unwrap();
                    (ray.direction.y.abs(), bench.opd_of(&beam, at, D_NM).unwrap())
                })
                .collect();
            let [re, im, light] = samples.windows(2).fold([0.0; 3], |[re, im, light], w| {
                let (l, dl) = (0.5 * (w[0].0 + w[1].0), w[1].0 - w[0].0);
                let (s, c) = (PI * (w[0].1 + w[1].1)).sin_cos();
                [re + c * l * dl, im + s * l * dl, light + l * dl]
            });
            let exact = (re * re + im * im) / (light * light);
            let pixel = 0.5 * bench.largest_psf_pixel(0.0, D_NM, D_NM).unwrap();
            let found = bench.diffraction_psf(0.0, [D_NM; 2], 0.0, pixel).unwrap().strehl.unwrap();
            // Cells of 1/120 of the radius, with slopes of the phase of up to 10 rad a radius: (10/120)² / 24 of the amplitude.
            assert!((found - exact).abs() < 3e-4, "{name} f/{f_number}: {found} {exact}");
            assert!((0.3..0.97).contains(&exact), "{exact}");
        }
    }

    #[test]
    fn the_transform_is_huygens_sum() {
        // Off the axis of the double Gauss: forward rays, their wavefront on the reference sphere, and wavelets from there.
        let set = double_gauss(4.0);
        let bench = Bench::at_infinity(&set.system);
        let pixel = 0.5 * bench.largest_psf_pixel(14.0, D_NM, D_NM).unwrap();
        let psf = bench.diffraction_psf(14.0, [D_NM, D_NM], 0.0, pixel).unwrap();
        let wavelets = oracle(&bench, 14.0, D_NM, 161);
        let peak = psf.values.iter().copied().fold(0.0, f64::max);
        let middle = psf.side / 2;
        let mut pairs = vec![];
        for row in (middle - 24..=middle + 24).step_by(4) {
            for column in (middle - 24..=middle + 24).step_by(4) {
                let at = psf.origin + DVec2::new(psf.place(column), psf.place(row));
                pairs.push((psf.values[row * psf.side + column] / peak, wavelets(at)));
            }
        }
        // The sum has no scale of its own: the one that fits best.
        let scale = pairs.iter().map(|(a, b)| a * b).sum::<f64>() / pairs.iter().map(|(_, b)| b * b).sum::<f64>();
        let worst = pairs.iter().map(|(a, b)| (a - b * scale).abs()).fold(0.0, f64::max);
        // Even amplitude over the entrance pupil or over direction cosines, and the steps of 161 rays: 1 % of the peak.
        assert!(worst < 0.015, "{worst}");
        // Turned upside down it is another image.
        let flipped: f64 =
            (0..pairs.len()).map(|i| (pairs[i].0 - pairs[pairs.len() - 1 - i].1 * scale).abs()).fold(0.0, f64::max);
        assert!(flipped > 2.0 * worst, "{flipped} {worst}");
    }

    #[test]
    fn the_line_spread_transforms_to_the_mtf() {
        let set = double_gauss(5.6);
        let bench = Bench::at_infinity(&set.system);
        let pixel = 0.5 * bench.largest_psf_pixel(10.0, D_NM, D_NM).unwrap();
        let psf = bench.diffraction_psf(10.0, [D_NM, D_NM], 0.05, pixel).unwrap();
        let frequencies = [5.0, 20.0, 60.0];
        let mtf = bench.diffraction_mtf(10.0, &[(D_NM, 1.0)], &frequencies, 0.05).unwrap();
        for tangential in [true, false] {
            let line = psf.line_spread(tangential);
            let total: f64 = line.iter().sum();
            for (i, f) in frequencies.iter().enumerate() {
                let [re, im] = line.iter().enumerate().fold([0.0; 2], |[re, im], (k, v)| {
                    let (s, c) = (TAU * f * psf.place(k)).sin_cos();
                    [re + v * c, im + v * s]
                });
                let expected = if tangential { mtf.tangential[i] } else { mtf.sagittal[i] };
                // A finite image cuts tails off, which are in the lowest frequencies.
                assert!((re.hypot(im) / total - expected).abs() < 0.01, "{tangential} {f}: {} {expected}", re.hypot(im) / total);
            }
            let edge = psf.edge_spread(tangential);
            assert!(edge.windows(2).all(|w| w[1] >= w[0]) && (edge[edge.len() - 1] - total * psf.pixel).abs() < 1e-9);
        }
    }

    #[test]
    fn a_geometric_image_out_of_focus_is_an_even_disk() {
        let system = parabola(200.0, 25.0);
        let bench = Bench::at_infinity(&system);
        let (defocus, pixel) = (0.8, 0.002);
        let psf = bench.geometric_psf(0.0, NM, defocus, pixel, 128).unwrap();
        let radius = defocus * (2.0 * (12.5f64 / 400.0).atan()).tan();
        let found = psf.encircled_energy(&[0.3 * radius, 0.6 * radius, 1.01 * radius]);
        for (found, exact) in found.iter().zip([0.09, 0.36, 1.0]) {
            assert!((found - exact).abs() < 0.01, "{found} {exact}");
        }
        assert!((psf.values.iter().sum::<f64>() - 1.0).abs() < 1e-9);
        // A wavefront of tens of waves is left to the rays.
        assert!(bench.diffraction_psf(0.0, NM, 20.0, 1e-3).unwrap().geometric);
    }

    #[test]
    fn files_have_their_rows_from_the_top() {
        let system = parabola(200.0, 25.0);
        let mut psf = Bench::at_infinity(&system).geometric_psf(0.0, NM, 0.0, 0.01, 8).unwrap();
        psf.values = vec![0.0; 64];
        // A pixel above and to the left of the middle one.
        psf.values[6 * 8 + 3] = 1.0;
        let raster = psf.cropped(6);
        let lit: Vec<usize> = (0..36).filter(|i| raster.values[*i] > 0.0).collect();
        // Columns 1..7 and rows 1..7 are left; row 6 is the top one.
        assert_eq!((raster.side, lit), (6, vec![2]));
    }
}
