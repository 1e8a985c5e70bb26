//! What is true of each pixel of a raw file: for training and for tests, beside the noisy numbers.

use diopter_image::{FocalPlane, ImageError, RawImage, exr};
use diopter_sensor::{ReadOut, Window};
use std::io::{Seek, Write};

/// Writes the truth of a read-out as EXR, pixel for pixel with the mosaic. Channels:
///
/// - `electrons`: mean electrons of light of the pixel, through its filter, without noise; `dark`: what leaks on average, e⁻;
/// - `dn`: the number expected of it (not rounded, not clipped);
/// - `variance.sensor`: variance that a read-out adds, e⁻²; `variance.monte_carlo`: of `electrons`, by the samples, e⁻²;
/// - `clipped`: 1 where this read-out reached the white level, 2 where the mean does, 3 both;
/// - each band of the plane (`R`, `G`, `B` ...): mean electrons through that filter at every pixel;
/// - `Z` (m), `normal.X/Y/Z`, `albedo.R/G/B`, `id`.
pub fn write(plane: &FocalPlane, reader: &ReadOut, raw: &RawImage, to: impl Write + Seek) -> Result<(), ImageError> {
    let (width, height, bands) = (plane.width(), plane.height(), plane.bands.len());
    let header = reader.header();
    let n = width * height;
    let mut planes: [Vec<f32>; 5] = std::array::from_fn(|_| Vec::with_capacity(n));
    let mut clipped = Vec::with_capacity(n);
    let window = Window { first: 0, data: &plane.mean.data };
    let per_electron = (header.white_level - header.black_level) * header.noise[0][0];
    for row in 0..height {
        for (column, e) in reader.expected(&window, row).into_iter().enumerate() {
            let i = row * width + column;
            let half = plane.half_difference.data[i * bands + header.cfa.channel_at(column, row)];
            let dn = header.black_level + f64::from(e.electrons + e.dark) * per_electron;
            for (plane, value) in planes.iter_mut().zip([e.electrons, e.dark, dn as f32, e.variance, half * half]) {
                plane.push(value);
            }
            clipped.push(u32::from(f64::from(raw.mosaic.data[i]) >= header.white_level) + 2 * u32::from(e.clipped));
        }
    }
    let names = ["electrons", "dark", "dn", "variance.sensor", "variance.monte_carlo"];
    let mut floats: Vec<(&str, Vec<f32>)> = names.into_iter().zip(planes).collect();
    floats.extend(plane.bands.iter().enumerate().map(|(b, band)| (band.name.as_str(), plane.mean.channel(b))));
    floats.push(("Z", plane.truth.depth.data.clone()));
    let normal = ["normal.X", "normal.Y", "normal.Z"];
    let albedo = ["albedo.R", "albedo.G", "albedo.B"];
    floats.extend(normal.iter().enumerate().map(|(c, name)| (*name, plane.truth.normal.channel(c))));
    floats.extend(albedo.iter().enumerate().map(|(c, name)| (*name, plane.truth.albedo.channel(c))));
    let whole = vec![("clipped", clipped), ("id", plane.truth.id.data.clone())];
    exr::write_planes([width, height], floats, whole, &header.facts, to)
}
