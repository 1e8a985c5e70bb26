//! Focal planes written and read by strips of rows, so that memory does not grow with the picture.
//!
//! What is written is what the `exr` crate writes of a whole picture: blocks of 16 rows from the top, packed one by one.

use super::{describe, description, few_bands, image_of, malformed, open, read_focal_plane, written};
use crate::channels::{Channel, PixelType};
use crate::focal_plane::{Band, FocalPlaneSource, STRIP_BYTES, Truth, bytes_a_pixel, ends_early, rows_within};
use crate::streams::{ReadSeek, WriteSeek};
use crate::truth::{Recorded, Values};
use crate::{ExposureFacts, FocalPlane, ImageError, Raster};
use exr::block::chunk::Chunk;
use exr::block::lines::{LineRef, LineRefMut};
use exr::block::writer::{ChunkWriter, ChunksWriter};
use exr::block::{BlockIndex, UncompressedBlock};
use exr::error::UnitResult;
use exr::io::Data;
use exr::meta::{BlockDescription, MetaData};
use exr::prelude::{AnyChannel, AnyChannels, FlatSamples, Image, Layer, LineOrder, SampleType, Vec2, WritableImage, f16};
use rayon::prelude::*;
use std::collections::VecDeque;
use std::io::{Read, Seek, SeekFrom, Write};

/// What a channel of a file holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Plane {
    Mean(usize),
    Variance(usize),
    HalfDifference(usize),
    /// Which of the channels that are recorded, and which of its values.
    Truth(usize, usize),
}

impl Plane {
    /// All planes, by the names that they have in files.
    fn all(bands: &[Band], channels: &[&'static Channel]) -> Vec<(String, Plane)> {
        let mut all = Vec::with_capacity(3 * bands.len() + 8);
        for (b, band) in bands.iter().enumerate() {
            all.push((band.name.clone(), Plane::Mean(b)));
            all.push((format!("variance.{}", band.name), Plane::Variance(b)));
            all.push((format!("half_difference.{}", band.name), Plane::HalfDifference(b)));
        }
        for (place, channel) in channels.iter().enumerate() {
            all.extend(channel.exr.iter().enumerate().map(|(part, name)| ((*name).into(), Plane::Truth(place, part))));
        }
        all
    }

    /// Fills a line of a block with a row of a plane.
    fn write(self, plane: &FocalPlane, row: usize, line: LineRefMut<'_>) -> UnitResult {
        let of = |raster: &Raster<f32>, channel: usize, line: LineRefMut<'_>| {
            let values = &raster.data[row * raster.width * raster.channels..];
            line.write_samples(|x| values[x * raster.channels + channel])
        };
        match self {
            Plane::Mean(band) => of(&plane.mean, band, line),
            Plane::HalfDifference(band) => of(&plane.half_difference, band, line),
            Plane::Variance(band) => line.write_samples(|x| {
                let difference = plane.half_difference.pixel(x, row)[band];
                difference * difference
            }),
            Plane::Truth(place, part) => match plane.truth.at(place) {
                Values::Float(raster) => of(raster, part, line),
                Values::Whole(raster) => line.write_samples(|x| raster.pixel(x, row)[part]),
            },
        }
    }

    /// Fills a row of a plane with a line of a block.
    fn read(self, line: LineRef<'_>, kind: SampleType, plane: &mut FocalPlane, row: usize) -> UnitResult {
        let width = plane.mean.width;
        let (raster, channel) = match self {
            Plane::Mean(band) => (&mut plane.mean, band),
            Plane::HalfDifference(band) => (&mut plane.half_difference, band),
            // Follows from the half difference.
            Plane::Variance(_) => return Ok(()),
            Plane::Truth(place, part) => match plane.truth.at_mut(place) {
                Values::Float(raster) => (raster, part),
                Values::Whole(raster) => {
                    let first = row * width * raster.channels + part;
                    let to = raster.data[first..].iter_mut().step_by(raster.channels).take(width);
                    // What another program made floating numbers of is no object's number.
                    return match kind {
                        SampleType::U32 => copy(line, to, |v: u32| v),
                        _ => Ok(()),
                    };
                }
            },
        };
        let first = row * width * raster.channels + channel;
        let to = raster.data[first..].iter_mut().step_by(raster.channels).take(width);
        match kind {
            SampleType::F32 => copy(line, to, |v: f32| v),
            SampleType::F16 => copy(line, to, |v: f16| v.to_f32()),
            SampleType::U32 => copy(line, to, |v: u32| v as f32),
        }
    }
}

fn copy<'a, T: Data, N: 'a>(line: LineRef<'_>, to: impl Iterator<Item = &'a mut N>, converted: impl Fn(T) -> N) -> UnitResult {
    for (to, value) in to.zip(line.read_samples::<T>()) {
        *to = converted(value?);
    }
    Ok(())
}

/// Blocks that are packed or unpacked at once: enough for all threads, no more than fit.
fn blocks_at_once(meta: &MetaData) -> usize {
    let bytes = meta.headers[0].max_block_byte_size().max(1);
    (STRIP_BYTES / bytes).clamp(1, 2 * rayon::current_num_threads().max(1))
}

/// A file without its pixels.
fn image_without_pixels(
    bands: &[Band],
    recorded: &Recorded,
    facts: &ExposureFacts,
    [width, height]: [usize; 2],
) -> Image<Layer<AnyChannels<FlatSamples>>> {
    let samples = |plane: Plane| match plane {
        Plane::Truth(place, _) if recorded.channels()[place].numbers == PixelType::Whole => FlatSamples::U32(Vec::new()),
        _ => FlatSamples::F32(Vec::new()),
    };
    let all = Plane::all(bands, recorded.channels());
    let channels = all.into_iter().map(|(name, plane)| AnyChannel::new(name.as_str(), samples(plane))).collect();
    image_of((width, height), channels, |_, layer| describe(bands, recorded, facts, layer))
}

/// Writes some rows of a picture, `first` on: whole blocks, unless they are the last ones.
fn write_rows<W: Write + Seek>(
    meta: &MetaData,
    bands: &[Band],
    strip: &FocalPlane,
    first: usize,
    writer: &mut ChunkWriter<W>,
) -> UnitResult {
    let header = &meta.headers[0];
    let all = Plane::all(bands, strip.truth.recorded().channels());
    let plane_of = |name: &exr::prelude::Text| all.iter().find(|(n, _)| *name == *n.as_str()).map(|(_, plane)| *plane);
    let planes: Vec<Plane> = header.channels.list.iter().filter_map(|c| plane_of(&c.name)).collect();
    assert_eq!(planes.len(), header.channels.list.len(), "channels of a focal plane have their names");
    let lines = header.compression.scan_lines_per_block();
    let pack = |row: usize| {
        let index = BlockIndex {
            layer: 0,
            pixel_position: Vec2(0, row),
            pixel_size: Vec2(strip.width(), lines.min(first + strip.height() - row)),
            level: Vec2(0, 0),
        };
        let block = UncompressedBlock::from_lines(&header.channels, index, |line| {
            let (channel, row) = (line.location.channel, line.location.position.1);
            planes[channel].write(strip, row - first, line).expect("a line takes as many numbers as it is wide");
        });
        block.compress_to_chunk(&meta.headers)
    };
    let blocks: Vec<usize> = (first..first + strip.height()).step_by(lines).collect();
    for some in blocks.chunks(blocks_at_once(meta)) {
        let chunks: Vec<exr::error::Result<Chunk>> = some.par_iter().map(|row| pack(*row)).collect();
        for (row, chunk) in some.iter().zip(chunks) {
            writer.write_chunk(row / lines, chunk?)?;
        }
    }
    Ok(())
}

/// Writes a focal plane with all its planes, 32-bit floats. Fails where writing does.
pub fn write_focal_plane(plane: &FocalPlane, mut to: impl Write + Seek) -> Result<(), ImageError> {
    write_focal_plane_to(plane, &mut to)
}

fn write_focal_plane_to(plane: &FocalPlane, to: &mut dyn WriteSeek) -> Result<(), ImageError> {
    let image = image_without_pixels(&plane.bands, plane.truth.recorded(), &plane.facts, [plane.width(), plane.height()]);
    let headers = image.write().infer_meta_data();
    exr::block::write(to, headers, true, |meta, writer| write_rows(&meta, &plane.bands, plane, 0, writer)).map_err(written)
}

/// Writes a focal plane strip by strip: the same file as [`write_focal_plane`] of the whole. Fails where the source or writing does.
pub fn write_strips(source: &mut dyn FocalPlaneSource, mut to: impl Write + Seek) -> Result<(), ImageError> {
    write_strips_to(source, &mut to)
}

fn write_strips_to(source: &mut dyn FocalPlaneSource, to: &mut dyn WriteSeek) -> Result<(), ImageError> {
    let (bands, facts, [width, height]) = (source.bands().to_vec(), source.facts().clone(), source.size());
    let image = image_without_pixels(&bands, source.recorded(), &facts, [width, height]);
    let headers = image.write().infer_meta_data();
    let mut failed = None;
    let wrote = exr::block::write(to, headers, true, |meta, writer| {
        // Whole blocks.
        let lines = meta.headers[0].compression.scan_lines_per_block();
        let rows = (source.rows_at_once() / lines).max(1) * lines;
        for first in (0..height).step_by(rows) {
            match source.next_rows(rows.min(height - first)) {
                Ok(strip) => write_rows(&meta, &bands, &strip, first, writer)?,
                Err(e) => {
                    failed = Some(e);
                    return Err(exr::error::Error::Aborted);
                }
            }
        }
        Ok(())
    });
    match failed {
        Some(e) => Err(e),
        None => wrote.map_err(written),
    }
}

/// Blocks of rows of a file, from the top.
struct Blocks {
    chunks: Box<dyn Iterator<Item = exr::error::Result<Chunk>>>,
    meta: MetaData,
    /// Rows that were read.
    read: usize,
}

impl Blocks {
    fn new<R: Read + Seek + 'static>(reader: exr::block::reader::Reader<R>) -> Result<Self, ImageError> {
        let meta = reader.meta_data().clone();
        Ok(Blocks { chunks: Box::new(reader.all_chunks(false).map_err(malformed)?), meta, read: 0 })
    }

    /// The blocks with the next rows, or some of them, unpacked by all threads.
    fn next(&mut self, rows: usize) -> Result<Vec<UncompressedBlock>, ImageError> {
        let lines = self.meta.headers[0].compression.scan_lines_per_block();
        let count = rows.div_ceil(lines).clamp(1, blocks_at_once(&self.meta));
        let chunks: Vec<Chunk> = self.chunks.by_ref().take(count).collect::<exr::error::Result<_>>().map_err(malformed)?;
        if chunks.is_empty() {
            return Err(ends_early());
        }
        let meta = &self.meta;
        let unpack = |chunk| UncompressedBlock::decompress_chunk(chunk, meta, false);
        let blocks: Vec<UncompressedBlock> =
            chunks.into_par_iter().map(unpack).collect::<exr::error::Result<_>>().map_err(malformed)?;
        for block in &blocks {
            if block.index.pixel_position.1 != self.read || block.index.layer != 0 {
                return Err(ImageError::Malformed {
                    format: "focal plane",
                    reason: "its rows are not in order from the top".into(),
                });
            }
            self.read += block.index.pixel_size.1;
        }
        Ok(blocks)
    }
}

/// The mean signal of a focal plane read row by row: no more of it is in memory than is asked for.
pub struct FocalPlaneRows {
    blocks: Blocks,
    bands: Vec<Band>,
    facts: ExposureFacts,
    size: [usize; 2],
    /// Place of each band among the channels of the file.
    channels: Vec<usize>,
    /// Numbers `[row][column][band]` that were read but not asked for yet.
    ready: Vec<f32>,
}

impl FocalPlaneRows {
    /// Opens a focal plane that [`write_focal_plane`] wrote. Fails where reading does, and on files that are no EXR, lack our description
    /// or a band, are not stored in rows, or announce more pixels than they can hold.
    pub fn open(from: impl Read + Seek + 'static) -> Result<Self, ImageError> {
        Self::open_boxed(Box::new(from))
    }

    fn open_boxed(from: Box<dyn ReadSeek>) -> Result<Self, ImageError> {
        let reader = open(from)?;
        let header =
            reader.headers().first().ok_or_else(|| ImageError::Malformed { format: "EXR", reason: "no layer".into() })?;
        let description = description(&header.own_attributes)?;
        few_bands(&description, header.channels.list.len())?;
        let size = [header.layer_size.0, header.layer_size.1];
        let find = |b: &Band| {
            let place = header.channels.list.iter().position(|c| c.name == *b.name.as_str() && c.sample_type == SampleType::F32);
            place.ok_or_else(|| ImageError::Missing {
                what: format!("the channel \"{}\" of 32-bit numbers", b.name),
                hint: "the file was written or cut by another program".into(),
            })
        };
        let channels = description.bands.iter().map(find).collect::<Result<Vec<_>, _>>()?;
        if header.deep || !matches!(header.blocks, BlockDescription::ScanLines) || channels.is_empty() {
            return Err(ImageError::Malformed { format: "focal plane", reason: "it is not stored in rows".into() });
        }
        let blocks = Blocks::new(reader)?;
        Ok(FocalPlaneRows { blocks, bands: description.bands, facts: description.facts, size, channels, ready: Vec::new() })
    }

    /// Its bands.
    pub fn bands(&self) -> &[Band] {
        &self.bands
    }

    /// Its facts.
    pub fn facts(&self) -> &ExposureFacts {
        &self.facts
    }

    /// Pixels a row, rows.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }

    /// The next rows, `[row][column][band]`. Fails where fewer are left, and where they are damaged or not in order from the top.
    pub fn next(&mut self, rows: usize) -> Result<Vec<f32>, ImageError> {
        let stride = self.size[0] * self.bands.len();
        while self.ready.len() < rows * stride {
            // More than is asked for: who asks for single rows has all threads at work, too.
            for block in self.blocks.next(usize::MAX)? {
                let first = block.index.pixel_position.1;
                let start = self.ready.len();
                self.ready.resize(start + block.index.pixel_size.1 * stride, 0.0);
                for line in block.lines(&self.blocks.meta.headers[0].channels) {
                    let Some(band) = self.channels.iter().position(|c| *c == line.location.channel) else { continue };
                    let row = start + (line.location.position.1 - first) * stride;
                    for (column, value) in line.read_samples::<f32>().enumerate() {
                        self.ready[row + column * self.bands.len() + band] = value.map_err(malformed)?;
                    }
                }
            }
        }
        Ok(self.ready.drain(..rows * stride).collect())
    }
}

/// A focal plane read strip by strip, all its planes.
pub struct FocalPlaneStrips {
    pixels: Pixels,
    bands: Vec<Band>,
    facts: ExposureFacts,
    recorded: Recorded,
    size: [usize; 2],
    /// Rows that were taken.
    next: usize,
}

/// Where the pixels of a focal plane come from.
enum Pixels {
    /// A file with blocks of rows from the top.
    Rows(Box<RowsOfFile>),
    /// Another program's file in another order, read as a whole.
    Whole(Box<FocalPlane>),
}

struct RowsOfFile {
    blocks: Blocks,
    /// Channels of the file and what they hold.
    planes: Vec<(usize, Plane)>,
    /// Blocks of which not all rows were taken.
    ready: VecDeque<UncompressedBlock>,
}

impl FocalPlaneStrips {
    /// Opens a focal plane that [`write_focal_plane`] wrote. What another program wrote again, in tiles or from below, is read as a whole.
    /// Fails where reading does, and on files that are no EXR, lack our description or a channel, or announce more pixels than they hold.
    pub fn open(from: impl Read + Seek + 'static) -> Result<Self, ImageError> {
        Self::open_boxed(Box::new(from))
    }

    fn open_boxed(mut from: Box<dyn ReadSeek>) -> Result<Self, ImageError> {
        let start = from.stream_position()?;
        let from_the_top = match open(&mut from)?.headers() {
            [header] => {
                !header.deep && matches!(header.blocks, BlockDescription::ScanLines) && header.line_order == LineOrder::Increasing
            }
            _ => false,
        };
        from.seek(SeekFrom::Start(start))?;
        if !from_the_top {
            let mut plane = read_focal_plane(from)?;
            let (bands, facts) = (std::mem::take(&mut plane.bands), std::mem::take(&mut plane.facts));
            let (size, recorded) = ([plane.width(), plane.height()], plane.truth.recorded().clone());
            return Ok(FocalPlaneStrips { pixels: Pixels::Whole(Box::new(plane)), bands, facts, recorded, size, next: 0 });
        }
        let reader = open(from)?;
        let header = &reader.headers()[0];
        let description = description(&header.own_attributes)?;
        few_bands(&description, header.channels.list.len())?;
        let recorded = description.recorded(&header.own_attributes, &header.channels.list, |channel| &channel.name)?;
        let mut planes = Vec::new();
        for (name, plane) in Plane::all(&description.bands, recorded.channels()) {
            match header.channels.list.iter().position(|c| c.name == *name.as_str()) {
                Some(place) => planes.push((place, plane)),
                None if matches!(plane, Plane::Variance(_)) => (),
                None => {
                    return Err(ImageError::Missing {
                        what: format!("the channel \"{name}\""),
                        hint: "the file was written or cut by another program".into(),
                    });
                }
            }
        }
        let size = [header.layer_size.0, header.layer_size.1];
        let pixels = Pixels::Rows(Box::new(RowsOfFile { blocks: Blocks::new(reader)?, planes, ready: VecDeque::new() }));
        Ok(FocalPlaneStrips { pixels, bands: description.bands, facts: description.facts, recorded, size, next: 0 })
    }
}

impl FocalPlaneSource for FocalPlaneStrips {
    fn bands(&self) -> &[Band] {
        &self.bands
    }

    fn facts(&self) -> &ExposureFacts {
        &self.facts
    }

    fn recorded(&self) -> &Recorded {
        &self.recorded
    }

    fn size(&self) -> [usize; 2] {
        self.size
    }

    fn rows_at_once(&self) -> usize {
        // A strip, and its channels as they are in the file.
        let bands = self.bands.len();
        rows_within(STRIP_BYTES, self.size[0], 2 * (bytes_a_pixel(bands) + self.recorded.more_bytes()) + 4 * bands)
    }

    fn next_rows(&mut self, rows: usize) -> Result<FocalPlane, ImageError> {
        let [width, height] = self.size;
        if rows > height - self.next {
            return Err(ends_early());
        }
        let (first, end) = (self.next, self.next + rows);
        let strip = match &mut self.pixels {
            Pixels::Whole(plane) => FocalPlane { bands: self.bands.clone(), facts: self.facts.clone(), ..plane.rows(first..end) },
            Pixels::Rows(file) => {
                let RowsOfFile { blocks, planes, ready } = file.as_mut();
                let mut strip = FocalPlane {
                    bands: self.bands.clone(),
                    mean: Raster::new(width, rows, self.bands.len()),
                    half_difference: Raster::new(width, rows, self.bands.len()),
                    truth: Truth::missing(self.recorded.clone(), width, rows),
                    facts: self.facts.clone(),
                };
                let mut filled = first;
                while filled < end {
                    if ready.is_empty() {
                        ready.extend(blocks.next(end - filled)?);
                    }
                    let Some(block) = ready.front() else { return Err(ends_early()) };
                    let block_end = block.index.pixel_position.1 + block.index.pixel_size.1;
                    let channels = &blocks.meta.headers[0].channels;
                    for line in block.lines(channels) {
                        let row = line.location.position.1;
                        if !(filled..end).contains(&row) {
                            continue;
                        }
                        for (_, plane) in planes.iter().filter(|(channel, _)| *channel == line.location.channel) {
                            let kind = channels.list[line.location.channel].sample_type;
                            plane.read(line, kind, &mut strip, row - first).map_err(malformed)?;
                        }
                    }
                    filled = block_end.min(end);
                    if block_end <= end {
                        ready.pop_front();
                    }
                }
                strip
            }
        };
        self.next = end;
        Ok(strip)
    }
}

#[cfg(test)]
mod tests;
