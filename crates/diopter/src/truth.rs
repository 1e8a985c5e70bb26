//! What is true of each pixel of a raw file: for training and for tests, beside the noisy numbers.

use diopter_image::exr::{Part, TruthLayout};
use diopter_image::truth::{Recorded, Values};
use diopter_image::{FocalPlane, ImageError, RawImage, exr};
use diopter_sensor::{ReadOut, Window};
use std::io::{Seek, Write};

/// Writes the truth of a read-out as EXR, pixel for pixel with the mosaic. Channels:
///
/// - `electrons`: mean electrons of light of the pixel, through its filter and by its own response; `dark`: what leaks on average, e⁻;
/// - `dn`: the number it would read without noise of time (not rounded);
/// - `variance.sensor`: variance that a read-out adds, e⁻², see [`diopter_sensor::read_out::Expected`]; `variance.monte_carlo`: of
///   `electrons`, by the samples of the exposure, e⁻² (one degree of freedom a pixel);
/// - `clipped`: 1 where this read-out (of several, the first) reached the white level, 2 where the mean does, 3 both;
/// - each band of the plane (`R`, `G`, `B` ...): mean electrons through that filter at every pixel;
/// - the truth channels that the plane holds ([`diopter_image::channels`]): `Z` (m), `normal.X/Y/Z`, `albedo.R/G/B`, `id` ...
///
/// In several parts ([`TruthLayout::MultiPart`]) the bands are the part `light`, what concerns the read-out is the part `raw`, and each truth channel has one of its
/// own, by the name of the table (`depth`, `normal` ...); channels have the same names as in one part.
///
/// `recorded`: what is said of the truth, that of the plane, or the same with files of names beside ([`Recorded::beside`]).
///
/// All of it is in memory at once, about 80 bytes a pixel and what more truth was asked for. What blooms from one pixel into others is not in it. Fails where the file
/// cannot be written.
pub fn write(
    plane: &FocalPlane,
    reader: &ReadOut,
    raw: &RawImage,
    layout: TruthLayout,
    recorded: &Recorded,
    to: impl Write + Seek,
) -> Result<(), ImageError> {
    let (width, height) = (plane.width(), plane.height());
    let header = &raw.header;
    let n = width * height;
    let mut planes: [Vec<f32>; 5] = std::array::from_fn(|_| Vec::with_capacity(n));
    let mut clipped = Vec::with_capacity(n);
    let (mean, half) = (Window { first: 0, data: &plane.mean.data }, Window { first: 0, data: &plane.half_difference.data });
    for row in 0..height {
        let errors = reader.through_filters(&half, row);
        for (column, (e, error)) in reader.expected(&mean, row).into_iter().zip(errors).enumerate() {
            let i = row * width + column;
            for (plane, value) in planes.iter_mut().zip([e.electrons, e.dark, e.dn, e.variance, (error * error) as f32]) {
                plane.push(value);
            }
            clipped.push(u32::from(f64::from(raw.mosaic.data[i]) >= header.white_level) + 2 * u32::from(e.clipped));
        }
    }
    let names = ["electrons", "dark", "dn", "variance.sensor", "variance.monte_carlo"];
    let bands = plane.bands.iter().enumerate().map(|(b, band)| (band.name.as_str(), plane.mean.channel(b)));
    let mut parts = vec![
        Part { name: "light", floats: bands.collect(), whole: vec![] },
        Part { name: "raw", floats: names.into_iter().zip(planes).collect(), whole: vec![("clipped", clipped)] },
    ];
    for (channel, values) in plane.truth.iter() {
        let mut part = Part { name: channel.name, ..Part::default() };
        let exr = channel.exr.iter().enumerate();
        match values {
            Values::Float(raster) => part.floats.extend(exr.map(|(c, name)| (*name, raster.channel(c)))),
            Values::Whole(raster) => part.whole.extend(exr.map(|(c, name)| (*name, raster.channel(c)))),
        }
        parts.push(part);
    }
    exr::write_truth([width, height], parts, layout, recorded, &header.facts, to)
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter_image::ExposureFacts;
    use diopter_light::cie::illuminant;
    use diopter_sensor::{Reading, Sensor, read_out};
    use std::io::Cursor;

    #[test]
    fn channels_say_what_was_put_in() {
        let sensor = Sensor { prnu: 0.0, ..Sensor::named("canon-t2i").unwrap() };
        let facts = ExposureFacts { exposure_s: 0.01, ..Default::default() };
        let mut plane = FocalPlane::even(sensor.bands(), &[100.0, 1e6, 300.0], [6, 4], facts);
        plane.half_difference.data.fill(3.0);
        let white = illuminant("D65").unwrap();
        let reading = Reading::new(100.0, 1);
        let raw = read_out(&plane, &sensor, &reading, &white).unwrap();
        let reader = ReadOut::new(&sensor, &reading, [6, 4], &plane.bands, plane.facts.exposure_s).unwrap();
        let files = [TruthLayout::SinglePart, TruthLayout::MultiPart].map(|layout| {
            let mut file = Cursor::new(Vec::new());
            write(&plane, &reader, &raw, layout, plane.truth.recorded(), &mut file).unwrap();
            file.into_inner()
        });
        // Names of parts are attributes: name, type, length and text.
        let part = |text: &[u8]| files.each_ref().map(|file| file.windows(text.len()).any(|bytes| bytes == text));
        let [light, normal] = [part(b"name\0string\0\x05\0\0\0light"), part(b"name\0string\0\x06\0\0\0normal")];
        assert_eq!([light, normal], [[false, true]; 2]);
        let [single, multi] = files.each_ref().map(|file| move |name: &str| exr::read_plane(Cursor::new(file), name).unwrap());
        for name in ["electrons", "clipped", "G", "normal.Y", "id", "variance.sensor"] {
            assert_eq!(single(name), multi(name), "{name}");
        }
        let channel = multi;
        // The T2i's pattern is GB/RG: pixel 0 is green and full, 1 blue, 6 (the next row) red.
        assert_eq!([channel("electrons")[1], channel("electrons")[6], channel("B")[0]], [300.0, 100.0, 300.0]);
        assert_eq!([channel("clipped")[0], channel("clipped")[1]], [3.0, 0.0]);
        assert!(channel("variance.monte_carlo").iter().all(|v| (v - 9.0).abs() < 1e-4));
        let step = sensor.at_iso(100.0).unwrap();
        let expected = 300.0 + step.read_noise_e.powi(2) + step.row_noise_e.powi(2) + step.gain_e_per_dn.powi(2) / 12.0;
        assert!((f64::from(channel("variance.sensor")[1]) / expected - 1.0).abs() < 1e-3);
        assert!((f64::from(channel("dn")[1]) - 2048.0 - 300.0 / step.gain_e_per_dn).abs() < 0.01);
        assert!(channel("Z").iter().all(|z| z.is_infinite()));
    }
}
