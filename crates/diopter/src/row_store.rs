//! Numbers in rows: in memory, or in a temporary file of which some strips of rows are in memory.

use diopter_image::Raster;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;

/// Rows of a strip: those of a tile of an exposure.
const STRIP_ROWS: usize = 16;
/// Fewest strips in memory: those that a tile reaches, and one for what lands elsewhere.
const FEWEST_STRIPS: usize = 4;
/// Numbers that are turned to bytes at once.
const BLOCK: usize = 8192;

/// Numbers `[row][column][channel]` that are taken row by row.
pub trait RowStore {
    /// Pixels a row, rows, numbers a pixel.
    fn size(&self) -> [usize; 3];

    /// A row to look at.
    fn row(&mut self, row: usize) -> io::Result<&[f64]>;

    /// A row to change.
    fn row_mut(&mut self, row: usize) -> io::Result<&mut [f64]>;

    /// Copies a row out, and leaves what is in memory as it is.
    fn copy_row(&self, row: usize, to: &mut [f64]) -> io::Result<()>;
}

impl RowStore for Raster<f64> {
    fn size(&self) -> [usize; 3] {
        [self.width, self.height, self.channels]
    }

    fn row(&mut self, row: usize) -> io::Result<&[f64]> {
        let stride = self.width * self.channels;
        Ok(&self.data[row * stride..(row + 1) * stride])
    }

    fn row_mut(&mut self, row: usize) -> io::Result<&mut [f64]> {
        let stride = self.width * self.channels;
        Ok(&mut self.data[row * stride..(row + 1) * stride])
    }

    fn copy_row(&self, row: usize, to: &mut [f64]) -> io::Result<()> {
        let stride = self.width * self.channels;
        to.copy_from_slice(&self.data[row * stride..(row + 1) * stride]);
        Ok(())
    }
}

/// Rows in a temporary file, zero at first; the strips that were used last are in memory.
#[derive(Debug)]
pub struct PagedRows {
    size: [usize; 3],
    file: File,
    /// Whether a strip has been written; else it is zero.
    written: Vec<bool>,
    strips: Vec<Strip>,
    /// Most strips in memory.
    most: usize,
    /// Counts how often strips were used.
    uses: u64,
}

#[derive(Debug)]
struct Strip {
    number: usize,
    /// Whether it differs from the file.
    changed: bool,
    /// When it was used last.
    used: u64,
    numbers: Vec<f64>,
}

impl PagedRows {
    /// Rows of zeros, of a size (pixels a row, rows, numbers a pixel), with about `memory` bytes of them in memory, and the rest in a file in `folder`
    /// that goes away with the program. Folders for temporary files are in memory on many systems: another one is wanted here. Fails where no file can be made there.
    pub fn new(size: [usize; 3], memory: usize, folder: &Path) -> io::Result<Self> {
        let [width, height, channels] = size;
        let most = (memory / (8 * STRIP_ROWS * width * channels).max(1)).max(FEWEST_STRIPS);
        Ok(PagedRows {
            size,
            file: tempfile::tempfile_in(folder)?,
            written: vec![false; height.div_ceil(STRIP_ROWS)],
            strips: Vec::new(),
            most,
            uses: 0,
        })
    }

    /// Numbers of a row.
    fn stride(&self) -> usize {
        self.size[0] * self.size[2]
    }

    fn rows_of(&self, strip: usize) -> usize {
        STRIP_ROWS.min(self.size[1] - strip * STRIP_ROWS)
    }

    /// Where a row begins in the file, bytes.
    fn place(&self, row: usize) -> u64 {
        8 * row as u64 * self.stride() as u64
    }

    /// The place of a strip among those in memory, into which it is brought.
    fn bring(&mut self, number: usize) -> io::Result<usize> {
        self.uses += 1;
        if let Some(place) = self.strips.iter().position(|s| s.number == number) {
            self.strips[place].used = self.uses;
            return Ok(place);
        }
        let mut numbers = Vec::new();
        if self.strips.len() >= self.most
            && let Some(oldest) = (0..self.strips.len()).min_by_key(|k| self.strips[*k].used)
        {
            if self.strips[oldest].changed {
                let number = self.strips[oldest].number;
                write_numbers(&self.file, self.place(number * STRIP_ROWS), &self.strips[oldest].numbers)?;
                self.written[number] = true;
            }
            numbers = self.strips.swap_remove(oldest).numbers;
        }
        numbers.clear();
        numbers.resize(self.rows_of(number) * self.stride(), 0.0);
        if self.written[number] {
            read_numbers(&self.file, self.place(number * STRIP_ROWS), &mut numbers)?;
        }
        self.strips.push(Strip { number, changed: false, used: self.uses, numbers });
        Ok(self.strips.len() - 1)
    }
}

impl RowStore for PagedRows {
    fn size(&self) -> [usize; 3] {
        self.size
    }

    fn row(&mut self, row: usize) -> io::Result<&[f64]> {
        let place = self.bring(row / STRIP_ROWS)?;
        let start = row % STRIP_ROWS * self.stride();
        Ok(&self.strips[place].numbers[start..start + self.stride()])
    }

    fn row_mut(&mut self, row: usize) -> io::Result<&mut [f64]> {
        let place = self.bring(row / STRIP_ROWS)?;
        let stride = self.stride();
        let start = row % STRIP_ROWS * stride;
        let strip = &mut self.strips[place];
        strip.changed = true;
        Ok(&mut strip.numbers[start..start + stride])
    }

    fn copy_row(&self, row: usize, to: &mut [f64]) -> io::Result<()> {
        let (number, start) = (row / STRIP_ROWS, row % STRIP_ROWS * self.stride());
        if let Some(strip) = self.strips.iter().find(|s| s.number == number) {
            to.copy_from_slice(&strip.numbers[start..start + self.stride()]);
        } else if self.written[number] {
            read_numbers(&self.file, self.place(row), to)?;
        } else {
            to.fill(0.0);
        }
        Ok(())
    }
}

fn write_numbers(mut file: &File, place: u64, numbers: &[f64]) -> io::Result<()> {
    file.seek(SeekFrom::Start(place))?;
    let mut bytes = Vec::with_capacity(8 * BLOCK);
    for block in numbers.chunks(BLOCK) {
        bytes.clear();
        block.iter().for_each(|v| bytes.extend(v.to_le_bytes()));
        file.write_all(&bytes)?;
    }
    Ok(())
}

fn read_numbers(mut file: &File, place: u64, numbers: &mut [f64]) -> io::Result<()> {
    file.seek(SeekFrom::Start(place))?;
    let mut bytes = vec![0; 8 * BLOCK];
    for block in numbers.chunks_mut(BLOCK) {
        let bytes = &mut bytes[..8 * block.len()];
        file.read_exact(bytes)?;
        block.iter_mut().zip(bytes.as_chunks::<8>().0).for_each(|(v, b)| *v = f64::from_le_bytes(*b));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_on_the_disk_hold_what_rows_in_memory_hold() {
        let size = [7, 150, 4];
        let mut plain = Raster::<f64>::new(size[0], size[1], size[2]);
        let mut paged = PagedRows::new(size, 0, &std::env::temp_dir()).unwrap();
        let mut other = vec![0.0; 28];
        for step in 0..2000usize {
            // Rows near each other, and now and then one far away.
            let row = (step / 20 + step * step % 23 + if step % 17 == 0 { 71 * step } else { 0 }) % size[1];
            let column = step % 28;
            for rows in [plain.row_mut(row).unwrap(), paged.row_mut(row).unwrap()] {
                rows[column] = rows[column] * 0.5 + step as f64;
            }
            let looked = (step * 37) % size[1];
            assert_eq!(paged.row(looked).unwrap(), plain.row(looked).unwrap(), "{step}");
            paged.copy_row(step % size[1], &mut other).unwrap();
            assert_eq!(other, plain.row(step % size[1]).unwrap());
            assert!(paged.strips.len() <= FEWEST_STRIPS);
        }
        assert!(paged.written.iter().filter(|w| **w).count() > FEWEST_STRIPS);
    }

    #[test]
    fn a_folder_that_is_not_there_is_an_error() {
        assert!(PagedRows::new([7, 150, 4], 0, Path::new("/there/is/no/such/folder")).is_err());
    }
}
