//! A ray for each pixel, as EXR: exact where no model is.
//!
//! Channels `origin.X`, `origin.Y`, `origin.Z` (m, from the camera's place) and `direction.X`, `direction.Y`, `direction.Z` (unit), 32 bits, in the axes of OpenCV: x right, y down, z
//! forward; of the centre of each pixel. A direction of 0 means that nothing is seen.

use super::observe::{PrincipalRay, ray};
use super::{CalibrationError, wrong};
use crate::camera::Film;
use diopter_image::{ImageError, exr};
use diopter_lens::Lens;
use diopter_lens::calibrated::RayTable;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use std::io::{Cursor, Seek, Write};

const CHANNELS: [&str; 6] = ["origin.X", "origin.Y", "origin.Z", "direction.X", "direction.Y", "direction.Z"];
const MM_PER_M: f64 = 1000.0;

/// Traces a ray for each pixel; pixels that see nothing have no ray. Fails on a film of less than two pixels a side.
pub fn trace(lens: &Lens, film: &Film, which: PrincipalRay) -> Result<RayTable, CalibrationError> {
    let [width, height] = [film.columns, film.rows];
    let rays = (0..width * height)
        .into_par_iter()
        .map(|i| ray(lens, film, DVec2::new((i % width) as f64, (i / width) as f64), which).unwrap_or([DVec3::ZERO; 2]))
        .collect();
    RayTable::new([width, height], rays).map_err(|e| wrong("ray table", e.to_string(), "a picture of two pixels or more a side"))
}

/// Writes a table: origins in m, unit directions, both 0 where there is no ray. Fails where `to` cannot be written.
pub fn write(table: &RayTable, to: impl Write + Seek) -> Result<(), ImageError> {
    let [width, height] = table.size();
    let all: Vec<[DVec3; 2]> = (0..width * height).map(|i| table.at(i % width, i / width).unwrap_or([DVec3::ZERO; 2])).collect();
    let plane = |k: usize| {
        let value = |[o, d]: &[DVec3; 2]| if k < 3 { o[k] / MM_PER_M } else { d[k - 3] };
        (CHANNELS[k], all.iter().map(|r| value(r) as f32).collect())
    };
    exr::write_maps(
        [width, height],
        (0..6).map(plane).collect(),
        &[("diopter.ray_table", "origin m, direction; x right, y down, z forward")],
        to,
    )
}

/// Whether an EXR has the channels of a table.
pub(super) fn is_one(bytes: &[u8]) -> bool {
    // Names of channels stand in the header.
    bytes[..bytes.len().min(1 << 16)].windows(CHANNELS[5].len()).any(|w| w == CHANNELS[5].as_bytes())
}

/// Reads a table that [`write()`] made; `name` is for messages. Fails on what is no EXR of these channels, below two pixels a side, and on numbers that are not finite.
pub fn read(bytes: &[u8], name: &str) -> Result<RayTable, CalibrationError> {
    let maps = exr::read_maps(Cursor::new(bytes), &CHANNELS)
        .map_err(|e| wrong(name, e.to_string(), "a ray table: origin and direction"))?;
    let vector = |first: usize, i: usize| DVec3::from_array(std::array::from_fn(|k| f64::from(maps.planes[first + k][i])));
    let [width, height] = maps.size;
    let rays = (0..width * height).map(|i| [vector(0, i) * MM_PER_M, vector(3, i).normalize_or_zero()]).collect();
    RayTable::new(maps.size, rays).map_err(|e| wrong(name, e.to_string(), "a ray for each pixel"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter_lens::compound::Setting;
    use diopter_lens::{CompoundLens, Focus, embedded};
    use diopter_light::units::Millimeters;

    #[test]
    fn a_table_holds_the_traced_rays() {
        let film = Film::new(36.0, 24.0, 24, 16);
        let focus = Focus::Distance(Millimeters(1500.0));
        let setting = Setting { focal_length: None, f_number: Some(8.0), focus, iris: None, film_mm: [36.0, 24.0] };
        let lens = CompoundLens::new(std::sync::Arc::new(embedded("double-gauss-50mm").unwrap()), &setting).unwrap();
        let lens = Lens::Compound(Box::new(lens));
        let table = trace(&lens, &film, PrincipalRay::CHIEF).unwrap();
        let mut file = Cursor::new(Vec::new());
        write(&table, &mut file).unwrap();
        assert!(is_one(file.get_ref()));
        let read = read(file.get_ref(), "rays.exr").unwrap();
        for (column, row) in [(0, 0), (23, 15), (7, 9), (12, 8)] {
            let ray = lens.chief_ray(film.point(column as f64 + 0.5, row as f64 + 0.5)).unwrap();
            let [o, d] = read.at(column, row).unwrap();
            // Rounding of 32 bits; origins lie some 0.05 m around.
            assert!((d * DVec3::new(1.0, -1.0, -1.0) - ray.direction).length() < 1e-6, "{column} {row}");
            assert!((o * DVec3::new(1.0, -1.0, -1.0) - ray.origin_mm).length() < 1e-5, "{column} {row}");
        }
    }
}
