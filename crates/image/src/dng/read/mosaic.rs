//! The pixels of a raw file, cropped to what a picture is made of.

use super::super::parts::{self, Storage};
use super::super::tag;
use super::{File, MADE_LEVELS, MOST_NUMBERS, made, malformed, missing};
use crate::{ImageError, Raster};
use std::io::{Read, Seek, SeekFrom};
use tiff::Directory;
use tiff::tags::Tag;

/// All numbers of the picture, row by row. `levels`: black and white of floating-point ones.
pub(super) fn pixels<R: Read + Seek>(
    file: &mut File<R>,
    raw: &Directory,
    storage: &Storage,
    levels: [f64; 2],
) -> Result<Raster<u16>, ImageError> {
    let mut side = |t: u16, what: &str| -> Result<usize, ImageError> {
        let told = file.number(raw, t)?.ok_or_else(|| missing(what))?;
        match (1.0..=1e6).contains(&told) {
            true => Ok(told as usize),
            false => Err(malformed(format!("{what} is {told}: expected 1 to 1000000"))),
        }
    };
    let (width, height) = (side(tag::WIDTH, "the width")?, side(tag::HEIGHT, "the height")?);
    let samples = storage.samples;
    if width * height * samples > MOST_NUMBERS {
        return Err(malformed(format!("{width} × {height} pixels are more than can be read")));
    }
    let tiled = raw.contains(Tag::from_u16_exhaustive(tag::TILE_OFFSETS));
    let (places, counts) = match tiled {
        true => (file.numbers(raw, tag::TILE_OFFSETS)?, file.numbers(raw, tag::TILE_BYTE_COUNTS)?),
        false => (file.numbers(raw, tag::STRIP_OFFSETS)?, file.numbers(raw, tag::STRIP_BYTE_COUNTS)?),
    };
    let part = |v: Option<f64>, whole: usize| v.map_or(whole, |v| (v as usize).clamp(1, 1 << 20));
    let (part_width, part_height) = match tiled {
        true => (part(file.number(raw, tag::TILE_WIDTH)?, width), part(file.number(raw, tag::TILE_LENGTH)?, height)),
        false => (width, part(file.number(raw, tag::ROWS_PER_STRIP)?, height).min(height)),
    };
    let across = width.div_ceil(part_width);
    let needed = across * height.div_ceil(part_height);
    if places.len() < needed || counts.len() < needed {
        return Err(malformed(format!("{} parts of the picture of {needed}", places.len().min(counts.len()))));
    }
    if part_width.checked_mul(part_height * samples).is_none_or(|n| n > MOST_NUMBERS) {
        return Err(malformed("a tile is too large"));
    }
    // Parts do not overlap, and their bytes become so many numbers at most: of no more pixels than that is memory asked for.
    let stored: f64 = counts[..needed].iter().sum();
    let length = file.decoder.inner().seek(SeekFrom::End(0))?;
    if stored > length as f64 {
        return Err(malformed(format!(
            "it ends early: the parts of the picture have {stored} bytes, and the file {length}: cut short"
        )));
    }
    let most = parts::most_numbers_a_byte(storage) * stored;
    if (width * height * samples) as f64 > most {
        return Err(malformed(format!(
            "{width} × {height} pixels are announced, and their {stored} bytes can become {most} numbers at most: damaged"
        )));
    }
    let linear = |v: f32| made((f64::from(v) - levels[0]) / (levels[1] - levels[0]));
    // Rows are added as their data are found: a file that lies about its size takes no memory for it.
    let mut data: Vec<u16> = Vec::new();
    let (row, part_row) = (width * samples, part_width * samples);
    for i in 0..needed {
        let (left, top) = (i % across * part_row, i / across * part_height);
        let rows = part_height.min(height - top);
        let source = file.decoder.inner();
        source.seek(SeekFrom::Start(places[i] as u64))?;
        let mut bytes = Vec::new();
        source.take(counts[i] as u64).read_to_end(&mut bytes)?;
        if (bytes.len() as f64) < counts[i] {
            return Err(malformed(format!("it ends early: part {} of {needed} of the picture is cut short", i + 1)));
        }
        let part = parts::numbers(&bytes, storage, [part_width, part_height, rows], linear)
            .map_err(|e| malformed(format!("part {} of {needed} of the picture: {e}", i + 1)))?;
        if left == 0 {
            data.resize((top + rows) * row, 0);
        }
        let w = part_row.min(row - left);
        for k in 0..rows {
            let to = (top + k) * row + left;
            data[to..to + w].copy_from_slice(&part[k * part_row..k * part_row + w]);
        }
    }
    let factor = |v: Option<f64>| v.map_or(1, |v| (v as usize).max(1));
    let across = factor(file.number(raw, tag::COLUMN_INTERLEAVE_FACTOR)?);
    let down = factor(file.number(raw, tag::ROW_INTERLEAVE_FACTOR)?);
    Ok(interleaved(Raster { width: row, height, channels: 1, data }, samples, [across, down]))
}

/// Fields put together: with factors 2 and 2, those of the four cells of a Bayer mosaic, which stand beside and below each other as four pictures.
/// Source: DNG 1.7.1, tags RowInterleaveFactor and ColumnInterleaveFactor.
pub(super) fn interleaved(fields: Raster<u16>, samples: usize, [across, down]: [usize; 2]) -> Raster<u16> {
    if [across, down] == [1, 1] {
        return fields;
    }
    // Where the numbers of a row or column belong: all of the first field come first, then all of the second.
    let places =
        |n: usize, factor: usize| (0..factor.min(n)).flat_map(move |field| (field..n).step_by(factor)).collect::<Vec<usize>>();
    let (columns, rows) = (places(fields.width / samples, across), places(fields.height, down));
    let mut data = vec![0; fields.data.len()];
    for (from, row) in fields.data.chunks(fields.width).zip(rows) {
        let to = &mut data[row * fields.width..][..fields.width];
        for (pixel, column) in from.chunks(samples).zip(&columns) {
            to[column * samples..][..samples].copy_from_slice(pixel);
        }
    }
    Raster { data, ..fields }
}

/// Top, left, bottom, right of the active area in pixels; the pattern of a DNG begins at its corner.
pub(super) fn active_area<R: Read + Seek>(
    file: &mut File<R>,
    raw: &Directory,
    [width, height]: [usize; 2],
) -> Result<[usize; 4], ImageError> {
    let area = file.numbers(raw, tag::ACTIVE_AREA)?;
    let [top, left, bottom, right] = area[..] else { return Ok([0, 0, height, width]) };
    let [top, left, bottom, right] = [top, left, bottom, right].map(|v| v.max(0.0) as usize);
    let (bottom, right) = (bottom.min(height), right.min(width));
    if top >= bottom || left >= right {
        return Err(malformed(format!("the active area {area:?} is empty")));
    }
    Ok([top, left, bottom, right])
}

/// The active area of the numbers.
pub(super) fn cropped(mosaic: Raster<u16>, [top, left, bottom, right]: [usize; 4], samples: usize) -> Raster<u16> {
    let (left, right) = (left * samples, right * samples);
    if (top, left, bottom, right) == (0, 0, mosaic.height, mosaic.width) {
        return mosaic;
    }
    let data = (top..bottom).flat_map(|r| mosaic.data[r * mosaic.width + left..r * mosaic.width + right].to_vec()).collect();
    Raster { width: right - left, height: bottom - top, channels: 1, data }
}

/// Black levels that differ by place or sample are brought to their mean: what a cell or a row or column has more is taken off its numbers.
/// `levels`: black and white as the file has them. How much higher than the mean the highest black of a plane is, by which less than from the mean to white stands for all light (DNG 1.7, "Rescaling").
pub(super) fn even_black<R: Read + Seek>(
    file: &mut File<R>,
    raw: &Directory,
    mosaic: &mut Raster<u16>,
    storage: &Storage,
    levels: [f64; 2],
) -> Result<f64, ImageError> {
    let samples = storage.samples;
    let cells = file.numbers(raw, tag::BLACK_LEVEL)?;
    let repeat = file.numbers(raw, tag::BLACK_REPEAT)?;
    let [rows, columns] = match repeat[..] {
        [r, c] if r >= 1.0 && c >= 1.0 && r * c * samples as f64 == cells.len() as f64 => [r as usize, c as usize],
        _ => [1, 1],
    };
    let [across, down] = [file.numbers(raw, tag::BLACK_DELTA[0])?, file.numbers(raw, tag::BLACK_DELTA[1])?];
    let differ = rows * columns * samples == cells.len() && cells.iter().any(|b| *b != levels[0]);
    if !differ && across.iter().chain(&down).all(|d| *d == 0.0) {
        return Ok(0.0);
    }
    // Floating-point samples have other levels by now.
    let unit = if storage.float { (MADE_LEVELS[1] - MADE_LEVELS[0]) / (levels[1] - levels[0]) } else { 1.0 };
    let width = mosaic.width;
    for (y, line) in mosaic.data.chunks_exact_mut(width).enumerate() {
        let of_row = down.get(y).copied().unwrap_or(0.0);
        for (i, dn) in line.iter_mut().enumerate() {
            let (x, sample) = (i / samples, i % samples);
            let cell = match differ {
                true => cells[(y % rows * columns + x % columns) * samples + sample] - levels[0],
                false => 0.0,
            };
            let more = cell + of_row + across.get(x).copied().unwrap_or(0.0);
            *dn = (f64::from(*dn) - more * unit).round().clamp(0.0, 65_535.0) as u16;
        }
    }
    // Each sample of a linear file is a plane of its own.
    let of_cells = if samples == 1 && differ { cells.iter().map(|b| b - levels[0]).fold(0.0, f64::max) } else { 0.0 };
    let highest = |all: &[f64]| all.iter().copied().reduce(f64::max).unwrap_or(0.0);
    Ok((of_cells + highest(&across) + highest(&down)) * unit)
}

/// What is to be shown of the active area (`size` pixels): left, top, width, height; `None` where all is.
pub(super) fn crop<R: Read + Seek>(
    file: &mut File<R>,
    raw: &Directory,
    [width, height]: [usize; 2],
) -> Result<Option<[usize; 4]>, ImageError> {
    let (origin, size) = (file.numbers(raw, tag::CROP_ORIGIN)?, file.numbers(raw, tag::CROP_SIZE)?);
    let ([x, y], [w, h]) = (
        match origin[..] {
            [x, y] => [x, y],
            _ => [0.0, 0.0],
        },
        match size[..] {
            [w, h] => [w, h],
            _ => return Ok(None),
        },
    );
    let [x, y, w, h] = [x, y, w, h].map(|v| v.round().max(0.0) as usize);
    let inside = w > 0 && h > 0 && x.saturating_add(w) <= width && y.saturating_add(h) <= height;
    Ok((inside && [x, y, w, h] != [0, 0, width, height]).then_some([x, y, w, h]))
}

/// Whether the rows of a matrix of three columns lie in a plane, or its numbers are no camera's: then colours cannot be made of it.
pub(super) fn flat(rows: &[f64]) -> bool {
    let rows = rows.as_chunks::<3>().0;
    let mut square = [[0.0; 3]; 3];
    for r in rows {
        (0..9).for_each(|i| square[i / 3][i % 3] += r[i / 3] * r[i % 3]);
    }
    let [a, b, c] = square;
    let det = a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) + a[2] * (b[0] * c[1] - b[1] * c[0]);
    let trace = a[0] + b[1] + c[2];
    // Those of cameras have numbers of about one.
    let largest = rows.as_flattened().iter().fold(0.0f64, |a, b| a.max(b.abs()));
    !(1e-2..=1e3).contains(&largest) || rows.len() >= 3 && !(det.abs() > 1e-9 * trace.powi(3))
}

/// The part of a crop that lies inside bounds (top, left, bottom, right); as it was where none does.
pub(super) fn trimmed(
    crop: Option<[usize; 4]>,
    [top, left, bottom, right]: [u32; 4],
    [width, height]: [usize; 2],
) -> Option<[usize; 4]> {
    let [x, y, w, h] = crop.unwrap_or([0, 0, width, height]);
    let (x1, y1) = ((x + w).min(right as usize), (y + h).min(bottom as usize));
    let (x0, y0) = (x.max(left as usize), y.max(top as usize));
    if x0 < x1 && y0 < y1 { Some([x0, y0, x1 - x0, y1 - y0]) } else { crop }
}
